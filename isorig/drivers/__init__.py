"""Instruments: they read bytes from a port and return blocks of samples. Independent of the rig and of analysis."""
