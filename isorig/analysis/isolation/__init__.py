"""Isolation: the isolation ratio, the isolation as one number, and the best values of parameters."""
