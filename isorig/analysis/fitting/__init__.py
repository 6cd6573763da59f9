"""Fits of a rig's parameters to runs: the problem, the solver, the ladder of run lengths, and the score on held-out data."""
