"""Isolation: the isolation ratio, isolation during moves, the design study and flexures."""
