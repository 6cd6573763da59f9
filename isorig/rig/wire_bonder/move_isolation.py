"""Isolation during a move: displacement of the heatblock relative to the table, unlocked compared with locked, over acceleration.

The bond is made on the heatblock, so its displacement relative to the table is relevant: its peak value, and the time after the
end of the move until it stays within the tolerance of the bond.
"""

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

#: Rest before the move, and time simulated after it, s: the heatblock's vibration has decayed by then.
LEAD, WATCHED = 0.02, 1.0
#: Sample rate, Hz: it resolves the heatblock's 165 Hz and the shortest moves.
RATE = 8192.0


@dataclass(frozen=True, kw_only=True)
class MoveResponse:
    """The heatblock relative to the table during one move in one configuration, m, shape (n,), its largest magnitude and
    settling.

    Time is in seconds from the start of the move. Settling is in seconds from its end until the motion stays within the
    tolerance: 0 if it never leaves it, NaN if it is still outside at the end of the record.
    """

    time: FloatArray
    motion: FloatArray
    largest: float
    settling: float


@dataclass(frozen=True, kw_only=True)
class MoveIsolation:
    """Isolation over the peak of the head's acceleration in a move, m/s^2, all of shape (levels,).

    The heatblock's largest displacement relative to the table, unlocked and locked, m, and its settling unlocked, s; `tolerance`
    is that of the bond, m in either direction.
    """

    acceleration: FloatArray
    unlocked: FloatArray
    locked: FloatArray
    settling: FloatArray
    tolerance: float

    @property
    def isolation(self) -> FloatArray:
        """1 - largest unlocked / largest locked at each acceleration, shape (levels,)."""
        return 1.0 - self.unlocked / self.locked


def move_within(distance: float, seconds: float, *, shape: Shape = "sine") -> Move:
    """The move with a given duration: its peak acceleration is 2 pi d / T^2 (sine) or 4 d / T^2 (constant). Raises DataError if
    distance or time is not allowed."""
    if not (isfinite(seconds) and seconds > 0.0):
        raise DataError(f"a move lasts {seconds:g} s; give a time above zero")
    factor = 2.0 * pi if shape == "sine" else 4.0
    return Move(distance=distance, acceleration=factor * abs(distance) / seconds**2, pause=0.0, shape=shape)


def response_to_move(model: RigModel, move: Move, *, tolerance: float, configuration: str = "unlocked") -> MoveResponse:
    """Simulate one move of the head from rest and evaluate the heatblock relative to the table.

    `tolerance` is that of the bond, m in either direction.
    """
    bond = Sensor(channel="bond", body="heatblock", relative_to="table", quantity="displacement")
    watched = msgspec.structs.replace(model, sensors=(bond,), free=())
    head = head_acceleration([move], RATE, lead=LEAD, tail=WATCHED)
    # The time between samples is short compared with a move: linear interpolation keeps its momentum.
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
    model: RigModel, distance: float, accelerations: Sequence[float] | FloatArray, *, tolerance: float
) -> MoveIsolation:
    """Isolation during moves of one distance (m) at peaks of the head's sinusoidal acceleration, m/s^2, shape (levels,).

    Friction is a constant force, so its influence decreases with acceleration: the isolation increases. `tolerance` is that of
    the bond, m in either direction. Raises DataError if the rig cannot be locked, or an acceleration is not allowed.
    """
    if "locked" not in model.configurations:
        raise DataError(f"the rig {model.name!r} has no locked configuration to compare with; describe one")
    moves = [Move(distance=distance, acceleration=float(a), pause=0.0) for a in accelerations]
    free, fixed = (
        [response_to_move(model, move, tolerance=tolerance, configuration=c) for move in moves] for c in ("unlocked", "locked")
    )
    return MoveIsolation(
        acceleration=np.asarray(accelerations, dtype=np.float64), unlocked=np.array([r.largest for r in free]),
        locked=np.array([r.largest for r in fixed]), settling=np.array([r.settling for r in free]), tolerance=tolerance,
    )  # fmt: skip
