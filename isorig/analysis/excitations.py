"""The kinds of excitation by the words for them in plans, descriptions of rigs and commands."""

from typing import Literal

PlannedExcitation = Literal["random", "multisine", "sine", "sweep", "moves", "steps", "free", "other"]
SyntheticExcitation = Literal["random", "multisine", "sweep", "half-sine", "hits", "moves", "free"]
#: Those of known drive that determine transfer functions in every frequency bin.
PLAYED_BROAD = ("random", "multisine", "sweep")
