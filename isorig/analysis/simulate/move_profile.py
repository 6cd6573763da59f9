"""Move profiles: the commanded acceleration of the head, which moves it by the exact distance."""

from collections.abc import Sequence
from math import isfinite, pi, sqrt
from typing import Literal

import msgspec
import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import DataError

Shape = Literal["sine", "constant"]
#: Minimum number of samples of a move: its acceleration has two halves of opposite sign. Largest number of moves.
SAMPLES, MOST = 4, 1000


class Move(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A move from rest to rest, and the pause after it; both are repeated."""

    distance: float  #: Signed distance, m.
    acceleration: float  #: Largest acceleration, m/s^2.
    pause: float  #: Pause after the move, s.
    #: "sine": one period of a sine, lasting T = sqrt(2 pi |d| / a); "constant": forward for the first half, backward for the
    #: second, lasting T = sqrt(4 |d| / a).
    shape: Shape = "sine"
    repeat: int = 1  #: Number of such moves.

    def __post_init__(self) -> None:
        if not (isfinite(self.distance) and self.distance != 0.0):
            raise DataError(f"a move has distance {self.distance:g} m; give a finite one other than zero")
        if not 0.0 < self.acceleration < np.inf:
            raise DataError(f"a move has acceleration {self.acceleration:g} m/s^2; it must be positive and finite")
        if not 0.0 <= self.pause < np.inf:
            raise DataError(f"a move has a pause of {self.pause:g} s; it must be zero or more")
        if self.repeat < 1:
            raise DataError(f"a move is repeated {self.repeat} times; give 1 or more moves")

    @property
    def duration(self) -> float:
        """Seconds from rest to rest."""
        return sqrt((2.0 * pi if self.shape == "sine" else 4.0) * abs(self.distance) / self.acceleration)

    def speed(self, t: FloatArray) -> FloatArray:
        """Speed of the head t seconds after the move began, m/s; zero before and after it."""
        period = self.duration
        inside = np.clip(t, 0.0, period)
        top = np.copysign(self.acceleration, self.distance)
        if self.shape == "sine":
            return np.asarray(top * period / (2.0 * pi) * (1.0 - np.cos(2.0 * pi * inside / period)))
        return np.asarray(top * np.minimum(inside, period - inside))


def head_acceleration(moves: Sequence[Move], sample_rate: float, *, lead: float = 0.02, tail: float = 1.0) -> FloatArray:
    """The head's acceleration in consecutive moves, shape (n,), m/s^2.

    Each sample is the mean over its step, so that the sum conserves the momentum of every move at any rate.

    Parameters
    ----------
    moves
        The moves in order.
    sample_rate
        Hz; the shortest move must last four samples.
    lead, tail
        Pause before and after, s.

    Raises
    ------
    DataError
        If there are no moves or more than `MOST`, or one is shorter than `SAMPLES`.
    """
    count = sum(move.repeat for move in moves)
    if not 1 <= count <= MOST:
        raise DataError(f"the profile has {count or 'no'} moves; give 1 to {MOST}")
    moves = [move for move in moves for _ in range(move.repeat)]
    shortest = min(move.duration for move in moves)
    if shortest * sample_rate < SAMPLES:
        raise DataError(
            f"a move lasts {shortest:.3g} s, fewer than {SAMPLES} samples at {sample_rate:g} Hz; raise the sample rate"
        )
    begins = lead + np.concatenate([[0.0], np.cumsum([move.duration + move.pause for move in moves])])
    n = int(np.ceil((begins[-1] + tail) * sample_rate)) + 1
    edges = (np.arange(n + 1) - 0.5) / sample_rate
    speed = np.zeros(n + 1)
    for begin, move in zip(begins[:-1], moves, strict=True):
        first, last = np.searchsorted(edges, (begin, begin + move.duration))
        speed[first:last] += move.speed(edges[first:last] - begin)
    return np.asarray(np.diff(speed) * sample_rate)
