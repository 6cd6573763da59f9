"""Instruments: bytes on a wire in, blocks of samples out. Knows nothing of the rig or of analysis."""
