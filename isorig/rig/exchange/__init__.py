"""Measurements from and to other programs: import according to a mapping, and export."""
