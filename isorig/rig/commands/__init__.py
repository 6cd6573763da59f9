"""The commands of `rig`, one file each."""
