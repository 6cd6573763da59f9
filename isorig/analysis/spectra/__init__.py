"""Spectra, transfer functions, modes, and the quality of measured data."""
