"""Isolation on a move: how far the heatblock moves on the table while the head moves, unlocked against locked, by level.

The bond is made on the heatblock, so what counts is its displacement relative to the table: how large it becomes, and how
long after the move's end it is until it stays inside the bond's tolerance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, pi

import msgspec
import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import DataError
from isorig.analysis.model.rig_model import RigModel, Sensor
from isorig.analysis.simulate import Excitation, simulate
from isorig.analysis.simulate.move_profile import Move, Shape, head_acceleration

#: Rest before the move, and time watched after it, s: the heatblock's ring has died out by then.
LEAD, WATCHED = 0.02, 1.0
#: Samples per second: the heatblock's 165 Hz and the shortest moves are well resolved.
RATE = 8192.0


@dataclass(frozen=True, kw_only=True)
class MoveResponse:
    """The heatblock on the table during one move in one configuration.

    Parameters
    ----------
    time, motion
        Seconds from the move's begin, and heatblock less table, m; shape (n,).
    largest
        max |motion|, m.
    settling
        Seconds from the move's end until `motion` stays inside the tolerance: 0 where it never leaves it, NaN where it is still
        outside when the record ends.
    """

    time: FloatArray
    motion: FloatArray
    largest: float
    settling: float


@dataclass(frozen=True, kw_only=True)
class MoveIsolation:
    """Isolation by the level of a move.

    Parameters
    ----------
    acceleration
        Peak of the head's acceleration, m/s^2, shape (levels,).
    unlocked, locked
        The responses at each level.
    tolerance
        The bond's, m either way.
    """

    acceleration: FloatArray
    unlocked: tuple[MoveResponse, ...]
    locked: tuple[MoveResponse, ...]
    tolerance: float

    @property
    def isolation(self) -> FloatArray:
        """1 - largest unlocked / largest locked at each level, shape (levels,)."""
        return 1.0 - np.array([u.largest / k.largest for u, k in zip(self.unlocked, self.locked, strict=True)])


def move_within(distance: float, seconds: float, *, shape: Shape = "sine", pause: float = 0.0) -> Move:
    """The move that takes so long: its peak acceleration is 2 pi d / T^2 (sine) or 4 d / T^2 (constant).

    Raises
    ------
    DataError
        Where distance or time cannot be used.
    """
    if not (isfinite(seconds) and seconds > 0.0):
        raise DataError(f"a move lasts {seconds:g} s; give a time above zero")
    factor = 2.0 * pi if shape == "sine" else 4.0
    return Move(distance=distance, acceleration=factor * abs(distance) / seconds**2, pause=pause, shape=shape)


def on_move(
    model: RigModel,
    move: Move,
    *,
    tolerance: float,
    configuration: str = "unlocked",
    body: str = "heatblock",
    base: str = "table",
) -> MoveResponse:
    """Simulate one move from rest and watch a body on its base.

    Parameters
    ----------
    model
        The rig.
    move
        What the head does.
    tolerance
        The bond's, m either way.
    configuration
        How the rig is set up.
    body, base
        What is watched, and relative to what.
    """
    watched = msgspec.structs.replace(
        model, sensors=(Sensor(channel="bond", body=body, relative_to=base, quantity="displacement"),), free=()
    )
    head = head_acceleration([move], RATE, lead=LEAD, tail=WATCHED)
    # Samples are short beside a move: straight lines between them keep its momentum.
    motion = simulate(watched, Excitation.prepare(head, RATE, oversample=1), configuration=configuration).channels["bond"]
    time = np.arange(len(motion)) / RATE - LEAD
    outside = np.flatnonzero(np.abs(motion) > tolerance)
    if len(outside) == 0:
        settling = 0.0
    elif outside[-1] == len(motion) - 1:
        settling = float("nan")
    else:
        settling = max(float(time[outside[-1] + 1]) - move.duration, 0.0)
    return MoveResponse(time=time, motion=motion, largest=float(np.abs(motion).max()), settling=settling)


def isolation_by_level(
    model: RigModel, distance: float, accelerations: Sequence[float] | FloatArray, *, tolerance: float, shape: Shape = "sine"
) -> MoveIsolation:
    """Isolation on moves of one distance at several levels.

    Friction is a constant force, so it matters the less the harder the move is: isolation grows with the level.

    Parameters
    ----------
    model
        A rig with a locked configuration.
    distance
        m.
    accelerations
        Peaks of the head's acceleration, m/s^2.
    tolerance
        The bond's, m either way.
    shape
        Of the moves.

    Raises
    ------
    DataError
        Where the rig cannot be locked, or a level cannot be used.
    """
    if "locked" not in model.configurations:
        raise DataError(f"the rig {model.name!r} has no locked configuration to compare with; describe one")
    moves = [Move(distance=distance, acceleration=float(a), pause=0.0, shape=shape) for a in accelerations]
    both = [tuple(on_move(model, move, tolerance=tolerance, configuration=c) for move in moves) for c in ("unlocked", "locked")]
    return MoveIsolation(
        acceleration=np.asarray(accelerations, dtype=np.float64), unlocked=both[0], locked=both[1], tolerance=tolerance
    )


def level_for(found: MoveIsolation, isolation: float) -> float:
    """Lowest level from which on the moves isolate at least so much, m/s^2, between levels by a straight line; NaN where none."""
    below = np.flatnonzero(found.isolation < isolation)
    if len(below) == 0:
        return float(found.acceleration[0])
    k = int(below[-1])
    if k == len(found.acceleration) - 1:
        return float("nan")
    share = (isolation - found.isolation[k]) / (found.isolation[k + 1] - found.isolation[k])
    return float(found.acceleration[k] + share * (found.acceleration[k + 1] - found.acceleration[k]))
