"""Diagnosis: what the simulation gets wrong, which cause is behind it, and how much naming it improves the prediction."""
