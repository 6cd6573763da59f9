"""Isolation: the ratio unlocked over locked, isolation on moves, the design study and flexures."""
