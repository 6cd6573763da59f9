"""Choices that a user has in several commands, and their defaults."""

from typing import Literal

#: The wire bonder with Coulomb friction, or without any.
Baseline = Literal["coulomb", "linear"]
#: The wire bonder's values: by the joint fit, or by half-power.
Method = Literal["joint", "half-power"]
#: Default time limit for the search for causes in one recording, s.
TIME_LIMIT = 300.0
