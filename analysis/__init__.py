"""The science: arrays in, frozen results out. No files, no devices, no plots, no clock."""
