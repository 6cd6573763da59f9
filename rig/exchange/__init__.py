"""Measurements from and to other programs: import after a mapping, export for whoever reads on."""
