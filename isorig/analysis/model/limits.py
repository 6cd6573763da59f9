"""Limits of a rig, from a description, a plan or a separate file."""

from __future__ import annotations

from math import isfinite
from typing import Any

import msgspec

from isorig.analysis.errors import ModelError


class Limits(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Limits of a run; None or absent if not given. Raises ModelError if a limit allows nothing."""

    stroke: dict[str, float] = {}  #: Largest deflection of a link in either direction, m (rad for a rotation), by link.
    drive: float | None = None  #: Largest magnitude of the drive channel, in its unit: for a head the acceleration in m/s^2.
    force: float | None = None  #: Largest magnitude of the drive's force, N.
    channels: dict[str, float] = {}  #: Largest magnitude of a sensor's record, in the channel's unit, by channel.
    gains: tuple[float, float] | None = None  #: Lowest and highest drive gain.
    band: tuple[float, float] | None = None  #: Lowest and highest frequency of a drive, Hz.
    seconds: float | None = None  #: Longest run, s.
    lock_price: float | None = None  #: Cost of a change of the configuration, in seconds of measuring.

    def __post_init__(self) -> None:
        single = {"drive": self.drive, "force": self.force, "seconds": self.seconds}
        named = {f"{kind}.{name}": value for kind in ("stroke", "channels") for name, value in getattr(self, kind).items()}
        for key, value in {**single, **named}.items():
            if value is not None and not (isfinite(value) and value > 0.0):
                raise ModelError(f"limits.{key} is {value:g}; give a finite value above zero, or leave it out")
        for key in ("gains", "band"):
            pair = getattr(self, key)
            if pair is not None and not 0.0 <= pair[0] < pair[1] < float("inf"):
                raise ModelError(f"limits.{key} is {list(pair)}; give [lowest, highest] with 0 <= lowest < highest")
        if self.lock_price is not None and not 0.0 <= self.lock_price < float("inf"):
            raise ModelError(f"limits.lock_price is {self.lock_price:g}; give seconds, 0 or more")

    def within(self, other: Limits) -> Limits:
        """The tighter of both limits, one by one; of two prices the other's."""
        return Limits(**{key: _tighter(key, getattr(self, key), getattr(other, key)) for key in self.__struct_fields__})


def _tighter(key: str, one: Any, other: Any) -> Any:
    if one is None or other is None:
        return other if one is None else one
    if isinstance(one, dict):
        return {name: min(each[name] for each in (one, other) if name in each) for name in one | other}
    if isinstance(one, tuple):
        both = max(one[0], other[0]), min(one[1], other[1])
        if not both[0] < both[1]:
            raise ModelError(f"limits.{key} is {list(one)} in one place and {list(other)} in another, which do not overlap")
        return both
    return other if key == "lock_price" else min(one, other)
