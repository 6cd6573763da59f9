"""Envelopes: a rig, an effect and its size drawn by a seed, and the recording that a lab would have made of it.

The code under test gets the recording alone. `KINDS` names everything that can be drawn; `OUTSIDE` are effects that no
catalogue names.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import Campaign
from isorig.analysis.diagnose.kinds import kind_of
from isorig.analysis.model.rig_model import RigModel
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.effects import CAUSES, KINDS, OUTSIDE, campaign_with, drawn_effect, generator_of
from isorig.rig.wire_bonder.session import LATER, SESSION, VirtualRun

__all__ = ["CAUSES", "KINDS", "OUTSIDE", "Envelope", "Place", "draw_envelope", "drawn_rig", "is_right"]

#: A cause, or a kind of causes, and its place.
Place = tuple[str, str]


@dataclass(frozen=True, kw_only=True)
class Envelope:
    """What was hidden, and what the lab measured.

    `truth` has cause and place, empty if the catalogue has no such cause; `outside` then has kind and place, if they are defined.
    """

    kind: str
    truth: tuple[Place, ...]
    outside: tuple[Place, ...]
    parameters: Mapping[str, float]
    campaign: Campaign
    later: Campaign


def drawn_rig(draw: np.random.Generator) -> RigModel:
    """A wire bonder similar to the thesis's."""
    spread = {
        "head_mass": 0.15, "table_mass": 0.15, "table_frequency": 0.08, "table_damping": 0.5, "heatblock_mass": 0.2,
        "heatblock_frequency": 0.05, "heatblock_damping": 0.4, "motor_mass": 0.1, "motor_frequency": 0.12, "motor_damping": 0.3,
    }  # fmt: skip
    values = {**THESIS, "friction_force": draw.uniform(5.0, 18.0)}
    for name, share in spread.items():
        values[name] *= 1.0 + share * draw.uniform(-1.0, 1.0)
    return wire_bonder(values)


def draw_envelope(kind: str, size: float, seed: int, takes: Sequence[VirtualRun] = SESSION) -> Envelope:
    """Draw the rig, the effect's place and its numbers by the seed, and play the session and the one after it."""
    draw = generator_of(seed, kind)
    hidden = drawn_effect(kind, drawn_rig(draw), size, draw)
    return Envelope(
        kind=kind, truth=hidden.truth, outside=hidden.outside, parameters=hidden.parameters,
        campaign=campaign_with(hidden, takes, seed), later=campaign_with(hidden, LATER, seed + 1),
    )  # fmt: skip


def is_right(
    kind: str, truth: tuple[Place, ...], outside: tuple[Place, ...], verdict: str, named: list[Place],
    alike: Mapping[Place, set[Place]],
) -> bool:  # fmt: skip
    """Whether an answer is right: every name, or one that is indistinguishable from it, was hidden at that place.

    A free shape is right if a cause of its kind was hidden at its place.

    Parameters
    ----------
    kind, truth, outside
        What was hidden, as in `Envelope`.
    verdict, named
        The answer: its verdict, and causes with places.
    alike
        For every cause, those that are indistinguishable from it.
    """
    meant = {*truth, *((kind_of(cause), place) for cause, place in truth), *outside}
    if truth:
        return bool(named) and all((alike.get(name, set()) | {name}) & meant for name in named)
    return all(name in meant for name in named) and (verdict == "adequate" or kind != "none")
