"""Envelopes: a rig, an effect and its size drawn by a seed, and the recording that a lab would have made of it.

The code under test gets the recording alone. `KINDS` names everything that can be drawn; `OUTSIDE` are effects that no
catalogue names.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import Campaign
from isorig.rig.virtual.campaign import LATER, SESSION
from isorig.rig.virtual.effects import CAUSES, KINDS, OUTSIDE, drawn_effect, drawn_rig, played

__all__ = ["CAUSES", "KINDS", "OUTSIDE", "Envelope", "draw_envelope", "drawn_rig"]


@dataclass(frozen=True, kw_only=True)
class Envelope:
    """What was hidden (cause and place; None where nothing the catalogue names), and what the lab measured."""

    kind: str
    truth: tuple[tuple[str, str], ...]
    parameters: Mapping[str, float]
    campaign: Campaign
    later: Campaign


def draw_envelope(kind: str, size: float, seed: int) -> Envelope:
    """Draw the rig, the effect's place and its numbers by the seed, and play the session and the one after it."""
    draw = np.random.default_rng([seed, KINDS.index(kind)])
    hidden = drawn_effect(kind, drawn_rig(draw), size, draw)
    return Envelope(
        kind=kind, truth=hidden.truth, parameters=hidden.parameters,
        campaign=played(hidden, SESSION, seed), later=played(hidden, LATER, seed + 1),
    )  # fmt: skip
