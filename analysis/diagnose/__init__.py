"""Diagnosis: what the simulation gets wrong, which cause is behind it, and what naming it gains."""
