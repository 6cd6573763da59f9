"""Implausible fitted values: at a bound, a decade from the given value, or different by a unit conversion factor.

A force in N read as kN makes masses a thousand times too large, an acceleration in g read as m/s^2 makes them 9.8 times too
large, and the model may still agree with the data. So every fit is compared with the given values.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import exp, inf, log, pi
from statistics import median
from typing import Literal

from isorig.analysis.errors import ModelError, SimulationError
from isorig.analysis.fitting.solve import Fit, Free
from isorig.analysis.fitting.swapped import swapped_channels
from isorig.analysis.fitting.trials import Trial, expected
from isorig.analysis.model.rig_model import RigModel

#: A given mass, stiffness or factor that was weighed, read from a data sheet or estimated with care is not wrong by this ratio.
DECADE = 10.0
#: A ratio is a unit conversion factor if it is within this share of it: given values are seldom more accurate.
NEAR = 0.2
#: Ratios of masses and stiffnesses within this factor of their median are one ratio: their common scale is wrong.
ALIKE = 1.5
#: A value this close to a bound, as a share, is at the bound.
END = 1e-3
#: Ratios of units that are commonly confused (BIPM, The International System of Units, 9th ed.).
UNIT_FACTORS = {
    9.80665: "g and m/s^2, or kgf and N", 25.4: "inch and mm", 180.0 / pi: "degrees and radians",
    1000.0: "N and kN, mm and m, or mV and V", 1e6: "um and m",
}  # fmt: skip
#: Parameters compared with given values; dampings and frictions are seldom known.
_KNOWN = re.compile(r"bodies\.(?P<body>\w+)\.mass|links\.(?P<link>\w+)\.stiffness|drive\.(?P<drive>factor)|.*\.chain\.gain")
_FRICTION = re.compile(r"contacts\.\w+\.law\.friction_force")


@dataclass(frozen=True, kw_only=True)
class Doubt:
    """A value that contradicts the units of the data, the description or the fit.

    Parameters
    ----------
    parameter
        Its path in the model, or drive, sensors or channels with the channel's name; several are joined by "+".
    kind
        "swapped": two channels are exchanged; "unit": different by a unit conversion factor; "decade": different by ten or more;
        "limit": at a bound.
    ratio
        Fitted divided by given; for a limit the value divided by it, for swapped channels 1.
    text
        One sentence.
    """

    parameter: str
    kind: Literal["swapped", "unit", "decade", "limit"]
    ratio: float
    text: str


def doubts(given: RigModel, fits: Sequence[Fit], trials: Sequence[Trial] = ()) -> tuple[Doubt, ...]:
    """Implausible fitted values and levels of the records, the most significant first.

    Parameters
    ----------
    given
        The rig with known values and starting values.
    fits
        Fits of it, or of models that extend it; each parameter is reported once.
    trials
        The runs: the levels of their channels are compared with those of the given rig with the same drive.
    """
    found = {doubt.parameter: doubt for doubt in (*_of_swaps(given, trials), *_of_levels(given, trials))}
    for fitted in fits:
        for doubt in (*_of_units(given, fitted), *_at_limits(fitted)):
            if not any(path in other.split("+") for other in found for path in doubt.parameter.split("+")):
                found[doubt.parameter] = doubt
    order = ("swapped", "unit", "decade", "limit")
    return tuple(sorted(found.values(), key=lambda doubt: order.index(doubt.kind)))


def unit_factor(ratio: float) -> tuple[float, str] | None:
    """The unit conversion factor close to a ratio, or to its inverse, and the units; None if there is none."""
    size = exp(abs(log(ratio)))
    factor = min(UNIT_FACTORS, key=lambda each: abs(log(size / each)))
    return (factor, UNIT_FACTORS[factor]) if abs(log(size / factor)) <= log(1.0 + NEAR) else None


def levels(given: RigModel, trials: Sequence[Trial]) -> dict[str, float]:
    """By channel: measured level (rms about the mean, median of runs) divided by the level of the given rig."""
    ratios: dict[str, list[float]] = {}
    for trial in trials:
        if trial.motion is None:
            with suppress(SimulationError):
                shown, measured = expected(given, trial).std(axis=1), trial.measured.std(axis=1)
                for name, ours, theirs in zip(trial.channels, shown, measured, strict=True):
                    if 0.0 < ours < inf and theirs > 0.0:
                        ratios.setdefault(name, []).append(float(theirs / ours))
    return {name: median(each) for name, each in ratios.items()}


def _of_swaps(given: RigModel, trials: Sequence[Trial]) -> Iterable[Doubt]:
    for (one, other), runs in swapped_channels(given, trials).items():
        several = f"runs {', '.join(map(repr, runs))}" if len(runs) > 1 else f"run {runs[0]!r}"
        yield Doubt(
            parameter=f"channels.{one}/{other}", kind="swapped", ratio=1.0,
            text=f"In {several} {one} and {other} seem swapped, their ratio over frequency is the inverse of the given rig's: "
            "check the cables or rename the channels.",
        )  # fmt: skip


def _of_levels(given: RigModel, trials: Sequence[Trial]) -> Iterable[Doubt]:
    ratios = levels(given, trials)
    odd = {name: ratio for name, ratio in ratios.items() if unit_factor(ratio) is not None}
    if not odd:
        return
    middle = exp(median(log(ratio) for ratio in ratios.values()))
    if middle in odd.values() and all(abs(log(ratio / middle)) <= log(ALIKE) for ratio in ratios.values()):
        yield Doubt(
            parameter=f"drive.{given.drive.channel}", kind="unit", ratio=middle,
            text=f"All responses are about {middle:.3g} times as large as the given rig predicts for the recorded drive"
            f"{_between(unit_factor(middle))}: check the unit of the drive channel {given.drive.channel}, and of all responses.",
        )  # fmt: skip
        return
    for name, ratio in odd.items():
        rest = [other for key, other in ratios.items() if key != name]
        if rest and unit_factor(exp(median(map(log, rest)))) is None:
            yield Doubt(
                parameter=f"sensors.{name}", kind="unit", ratio=ratio,
                text=f"{name} is about {ratio:.3g} times as large as the given rig predicts for the recorded drive"
                f"{_between(unit_factor(ratio))}, and the others are not: check the unit of {name}.",
            )  # fmt: skip


def _of_units(given: RigModel, fitted: Fit) -> Iterable[Doubt]:
    ratios = {path: ratio for path in fitted.values if (ratio := _ratio(given, fitted, path)) is not None}
    scaled = {path: ratio for path, ratio in ratios.items() if path.startswith(("bodies.", "links."))}
    odd = {path: ratio for path, ratio in ratios.items() if _is_odd(path, ratio)}
    middle = median(log(ratio) for ratio in scaled.values()) if scaled else 0.0
    alike = {path: ratio for path, ratio in scaled.items() if abs(log(ratio) - middle) <= log(ALIKE)}
    if len(alike) > 1 and len(alike) == len(scaled) and alike.keys() & odd.keys():
        ratio = exp(middle)
        near = unit_factor(ratio)
        values = ", ".join(_value(given, fitted, path) for path in alike)
        yield Doubt(
            parameter="+".join(alike), kind="unit" if near else "decade", ratio=ratio,
            text=f"All fitted masses and stiffnesses are about {ratio:.3g} times the given ones ({values})"
            f"{_between(near)}: check the unit of the drive channel {given.drive.channel}, and of all responses.",
        )  # fmt: skip
        odd = {path: ratio for path, ratio in odd.items() if path not in alike}
    for path, ratio in odd.items():
        near = unit_factor(ratio)
        yield Doubt(
            parameter=path, kind="unit" if near else "decade", ratio=ratio,
            text=f"{_named(path)} is fitted as {fitted.values[path]:.4g}, {ratio:.3g} times the given {given.get(path):.4g}"
            f"{_between(near)}: check the units of the channels, and the given value.",
        )  # fmt: skip


def _is_odd(path: str, ratio: float) -> bool:
    size = exp(abs(log(ratio)))
    if _FRICTION.fullmatch(path):
        return size >= DECADE / (1.0 + NEAR) and unit_factor(ratio) is not None
    return size >= DECADE or unit_factor(ratio) is not None


def _ratio(given: RigModel, fitted: Fit, path: str) -> float | None:
    if not _KNOWN.fullmatch(path) and not _FRICTION.fullmatch(path):
        return None
    try:
        before, after = given.get(path), fitted.values[path]
    except (ModelError, KeyError, AttributeError):
        return None
    return after / before if before > 0.0 and after > 0.0 else None


def _at_limits(fitted: Fit) -> Iterable[Doubt]:
    for free in fitted.free:
        value = fitted.values[free.path]
        limit = _limit(free, value)
        if limit is not None:
            yield Doubt(
                parameter=free.path, kind="limit", ratio=value / limit,
                text=f"{_named(free.path)} ended at its bound, {limit:.4g}, which is "
                "implausible; check units and given values.",
            )  # fmt: skip


def _limit(free: Free, value: float) -> float | None:
    # The bound at which a value is. A damping or a friction at its lower bound is just absent.
    if free.follows or not free.log:
        return None
    if 0.0 < free.high < inf and value >= free.high * (1.0 - END):
        return free.high
    vanishes = not re.fullmatch(r"bodies\.\w+\.mass|links\.\w+\.stiffness|drive\.factor", free.path)
    return free.low if not vanishes and free.low > 0.0 and value <= free.low * (1.0 + END) else None


def _between(near: tuple[float, str] | None) -> str:
    return "" if near is None else f", near the factor {near[0]:.4g} between {near[1]}"


def _value(given: RigModel, fitted: Fit, path: str) -> str:
    name = path.split(".")[1] if path.count(".") > 1 else path
    return f"{name} {fitted.values[path]:.4g} for {given.get(path):.4g}"


def _named(path: str) -> str:
    # bodies.block.mass is the mass of 'block'.
    parts = path.split(".")
    words = parts[-1].replace("_", " ")
    return f"The {words} of {parts[1]!r}" if len(parts) > 2 else f"The {parts[0]}'s {words}"
