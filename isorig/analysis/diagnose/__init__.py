"""Diagnosis: what the simulation gets wrong, its cause, and how much the prediction improves with it."""
