"""Implausible records and fitted values: inverted, exchanged, wrong by a unit conversion factor or a decade, or at a bound.

A force in N read as kN makes masses a thousand times too large, an acceleration in g read as m/s^2 makes them 9.8 times too
large, and the model may still agree with the data. So the records are compared with the given rig before any fit
(`wrong_scale`, `swapped`), and every fit with the given values.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import exp, inf, log, pi
from statistics import median
from typing import TYPE_CHECKING, Literal

from isorig.analysis.campaign import MOTION, ROTARY, Campaign, Quantity, Run
from isorig.analysis.errors import ModelError, SimulationError
from isorig.analysis.fitting.linear_spectra import Spectrum, spectra_of
from isorig.analysis.fitting.resonances import Resonance, resonance
from isorig.analysis.fitting.swapped import swapped_channels
from isorig.analysis.fitting.wrong_scale import ELSEWHERE, LINEAR, WrongScale, as_ratio, wrong_scale
from isorig.analysis.model.drafted import drafted
from isorig.analysis.model.parameter_units import unit_of
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.spectra.clocks import clock_errors
from isorig.analysis.units import GIVEN, mistaken
from isorig.analysis.wording import words

if TYPE_CHECKING:
    from isorig.analysis.fitting.solve import Fit, Free

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
#: Correlation of every record with its prediction from which an exchange repairs the phases: 0.61 and more after 45 exchanges on
#: 15 rigs with a hidden cause; at most 0.42 where the sample rate or a stiffness was wrong instead. An imperfect lock reaches
#: 0.60, but agrees worse than without the exchange.
EXCHANGED = 0.5
#: A ratio of levels is that of two units if it is within this factor of it: an unmodelled cause changes levels.
ROUGHLY = 2.0
#: Ratio of the levels of a run that starts from a given position above which its unit is wrong.
RELEASED = 5.0
#: Parameters compared with given values; dampings and frictions are seldom known.
_KNOWN = re.compile(r"bodies\.(?P<body>\w+)\.mass|links\.(?P<link>\w+)\.stiffness|drive\.(?P<drive>factor)|.*\.chain\.gain")
_FRICTION = re.compile(r"contacts\.\w+\.law\.friction_force")


#: Mean square weighted residual up to which a fit explains the records; ratios to given values up to which fitted ones are
#: close, and up to which they are plausible if no unit factor is near. Chosen: a residual of three times what is allowed; below
#: the smallest unit factor; half a decade, as starting values of fits may differ.
EXPLAINS, CLOSE_BY, FAR_BY = 10.0, 1.6, 5.0


@dataclass(frozen=True, kw_only=True)
class Doubt:
    """A value that contradicts the units of the data, the description or the fit."""

    #: Its path in the model, or drive, sensors or channels with the channel's name, or sample_rate; several are joined by "+".
    parameter: str
    #: "drafted": the records contradict values that are still those of a draft; "swapped": two channels or masses are exchanged;
    #: "place": a sensor or a drive is on another body; "clock": its samples have another rate; "reversed": the records run
    #: backwards in time; "sign": inverted; "derivative": another derivative of the motion; "unit": different by a unit conversion
    #: factor; "decade": different by another factor, of three or more for records and ten or more for fitted values; "limit": at
    #: a bound.
    kind: Literal["drafted", "swapped", "place", "clock", "reversed", "sign", "derivative", "unit", "decade", "limit"]
    #: Fitted divided by given, or recorded by predicted; for drafted values and a sample rate that of the largest resonance; for
    #: a given value that the records contradict, given divided by likely; for a limit the value divided by it, for swapped
    #: channels or masses, another body, another derivative, reversed records and damping ratios 1, for inverted ones -1; of a
    #: clock the distance of its samples divided by that of the drive's.
    ratio: float
    text: str  #: One sentence.


def doubts(given: RigModel, fits: Sequence[Fit], campaign: Campaign | None = None) -> tuple[Doubt, ...]:
    """Implausible fitted values and levels of the records, the most significant first.

    Parameters
    ----------
    given
        The rig with known values and starting values.
    fits
        Fits of it, or of models that extend it; each parameter is reported once.
    campaign
        The measurement: the levels of its channels are compared with those of the given rig with the same drive.
    """
    # A model that explains the records with values close to the given ones needs no search for a wrong scale.
    settled = any(explains_as_given(given, fitted) for fitted in fits)
    if not settled and campaign is not None and (records := doubts_of_records(given, campaign)):
        # What the fits get wrong follows from it.
        return records
    found: dict[str, Doubt] = {}
    # Where the records agree with the given units, the values of a fit that misfits are off because of what the model lacks.
    for fitted in fits if campaign is None else [each for each in fits if each.cost <= EXPLAINS]:
        for doubt in (*_of_units(given, fitted), *_at_limits(given, fitted)):
            if not any(path in other.split("+") for other in found for path in doubt.parameter.split("+")):
                found[doubt.parameter] = doubt
    order = ("unit", "decade", "limit")
    return tuple(sorted(found.values(), key=lambda doubt: order.index(doubt.kind)))


def explains_as_given(given: RigModel, fitted: Fit) -> bool:
    """Whether a fit explains the records with values that no wrong scale could imitate.

    A mass that is known sets the scale of all records; free values may differ from the given ones, but by no unit factor.
    """
    others = [free.path for free in fitted.free if free.path not in given.free]
    weighed = any(f"bodies.{body.name}.mass" not in given.free for body in given.bodies if body.name not in given.imposed)
    given_ones = {f"bodies.{body.name}.mass" for body in given.bodies}
    if not weighed or fitted.cost > EXPLAINS or any(path in given_ones or path.endswith((".gain", ".factor")) for path in others):
        return False
    sized = [path for path in given.free if path.endswith((".mass", ".stiffness", ".factor"))]
    return all(is_near(fitted.values.get(path, given.get(path)), given.get(path)) for path in sized)


def is_near(value: float, given: float) -> bool:
    """Whether a value is close to the given one, or not far and by no unit factor."""
    if not (value > 0.0 and given > 0.0):
        return False
    ratio = value / given
    return abs(log(ratio)) < log(CLOSE_BY) or (abs(log(ratio)) < log(FAR_BY) and unit_factor(ratio) is None)


def doubts_of_records(given: RigModel, campaign: Campaign, units: Mapping[str, str] | None = None) -> tuple[Doubt, ...]:
    """Records, given values or a sample rate that contradict each other, before any fit.

    Parameters
    ----------
    given
        The rig with known values and starting values.
    campaign
        The measurement.
    units
        The unit that each channel was read as; SI where none is stated.
    """
    if clocks := tuple(_of_clocks(given, campaign)):
        return clocks
    spectra = spectra_of(given, campaign)
    found, agreement = wrong_scale(given, spectra)
    if found is not None and _held_back(given, found):
        found = None
    placeholders = drafted(given)
    if placeholders and (found is not None or (agreement < LINEAR).any()):
        first = _of_draft(given, placeholders, resonance(given, spectra))
        whole = len(placeholders) == len(given.bodies) - len(given.imposed) + len(given.links)
        # No record can contradict a rig without a description.
        return (first,) if whole or found is None else (first, _of_scale(given, found, units or {}, spectra))
    if (agreement < LINEAR).any():
        # A wrong factor may look like an exchange and vice versa, but only one of them makes everything agree.
        swapped = {}
        for pair, runs in swapped_channels(given, spectra).items():
            other, after = wrong_scale(given, spectra_of(given, _exchanged(campaign, *pair)))
            elsewhere = other is not None and other.kind == "place"
            if not elsewhere and after.min() >= EXCHANGED and after.mean() > agreement.mean():
                swapped[pair] = runs
        # Runs that contradict each other show a rig that behaves otherwise, not a cable.
        if len(swapped) == 1:
            return tuple(_of_swaps(swapped))
    return tuple(_released(given, campaign)) if found is None else (_of_scale(given, found, units or {}, spectra),)


def _of_clocks(given: RigModel, campaign: Campaign) -> Iterable[Doubt]:
    for name, error in clock_errors(campaign, given.drive.channel).items():
        stated = max(run.sample_rate for run in campaign.runs if name in run.channels)
        yield Doubt(
            parameter=f"sensors.{name}", kind="clock", ratio=1.0 + error,
            text=f"The delay between {name!r} and the drive changes steadily, by {1e3 * abs(error):.2g} ms in each second: their "
            f"clocks differ, and the sample rate of {name!r} is {stated / (1.0 + error):.6g} Hz instead of {stated:.6g} Hz; "
            "measure both with one clock, or resample the record.",
        )  # fmt: skip


def _held_back(given: RigModel, found: WrongScale) -> bool:
    # Without springs, friction and cogging that the description lacks reduce the motion by any factor: only one of units tells.
    less = found.kind in ("responses", "sensor") and found.ratio < 1.0
    return less and unit_factor(found.ratio) is None and all(link.stiffness == 0.0 for link in given.links)


def _exchanged(campaign: Campaign, one: str, other: str) -> Campaign:
    def exchanged(run: Run) -> Run:
        a, b = run.channel(one), run.channel(other)
        return replace(run, channels={**run.channels, one: replace(b, name=one), other: replace(a, name=other)})

    return replace(campaign, runs=tuple(exchanged(run) for run in campaign.runs))


def unit_factor(ratio: float) -> tuple[float, str] | None:
    """The unit conversion factor close to a ratio, or to its inverse, and the units; None if there is none."""
    size = exp(abs(log(ratio)))
    factor = min(UNIT_FACTORS, key=lambda each: abs(log(size / each)))
    return (factor, UNIT_FACTORS[factor]) if abs(log(size / factor)) <= log(1.0 + NEAR) else None


def _of_swaps(swapped: Mapping[tuple[str, str], Sequence[str]]) -> Iterable[Doubt]:
    for (one, other), runs in swapped.items():
        several = f"runs {', '.join(map(repr, runs))}" if len(runs) > 1 else f"run {runs[0]!r}"
        yield Doubt(
            parameter=f"channels.{one}/{other}", kind="swapped", ratio=1.0,
            text=f"In {several} {one} and {other} seem swapped, their ratio over frequency is the inverse of the given rig's: "
            "check the cables or rename the channels.",
        )  # fmt: skip


def _of_draft(given: RigModel, names: Sequence[str], found: Resonance | None) -> Doubt:
    shown = "" if found is None else f" {_resonance_text(found)}."
    return Doubt(
        parameter="description", kind="drafted", ratio=1.0 if found is None else found.ratio,
        text=f"The description still has the drafted values of {' and '.join(names)}: give the rig's own masses, stiffnesses and "
        f"dampings before anything else.{shown}",
    )  # fmt: skip


def _resonance_text(found: Resonance) -> str:
    return (
        f"The largest resonance of {found.channel} is recorded at {found.recorded:.3g} Hz, {found.ratio:.2g} times the "
        f"{found.given:.3g} Hz of the given rig"
    )


def _of_scale(given: RigModel, found: WrongScale, units: Mapping[str, str], spectra: Sequence[Spectrum] = ()) -> Doubt:
    names, drive = " and ".join(found.names), given.drive.channel
    if found.kind == "rate":
        shown = resonance(given, spectra)
        text = "The resonances are not recorded at the frequencies of the given rig" if shown is None else _resonance_text(shown)
        return Doubt(
            parameter="sample_rate", kind="decade", ratio=found.ratio if shown is None else shown.ratio,
            text=f"{text}, and no unit explains this: check the sample rate in the mapping, and the masses and stiffnesses of "
            "the description.",
        )  # fmt: skip
    if found.kind == "sign":
        if len(found.names) == len(given.sensors):
            subject, also = ("All responses have", "") if len(found.names) > 1 else (f"{names} has", f" and of {names}'s sensor")
            return Doubt(
                parameter=f"drive.{drive}", kind="sign", ratio=-1.0,
                text=f"{subject} the opposite sign of what the given rig predicts: check the direction of {drive}{also}, and "
                "the signs in the description's pushes and arms.",
            )  # fmt: skip
        return Doubt(
            parameter="+".join(f"sensors.{name}" for name in found.names), kind="sign", ratio=-1.0,
            text=f"{names} has the opposite sign of what the given rig predicts: check the direction of its sensor, and correct "
            "it with a negative sensitivity in the mapping.",
        )  # fmt: skip
    if found.kind in ("stiffness", "mass"):
        kind, key = ("links", "stiffness") if found.kind == "stiffness" else ("bodies", "mass")
        paths = [f"{kind}.{name}.{key}" for name in found.names]
        si = unit_of(paths[0], given)
        other = min(GIVEN[si], key=lambda each: abs(log(found.ratio * GIVEN[si][each])))
        text = f"The given {key} of {names} is" if len(paths) == 1 else f"The given values of {key} of {names} are"
        return Doubt(
            parameter="+".join(paths), kind="unit", ratio=found.ratio,
            text=f"{text} about {found.ratio:.3g} times what the records show, the factor between {other} and {si}: give "
            f"{'it' if len(paths) == 1 else 'them'} in {si} in the description.",
        )  # fmt: skip
    others: dict[str, Callable[[], Doubt]] = {
        "derivative": lambda: _of_derivative(given, found, spectra), "damping": lambda: _of_damping(given, found),
        "reversed": _of_reversed, **dict.fromkeys(ELSEWHERE, lambda: _of_place(given, found)),
    }  # fmt: skip
    if found.kind in others:
        return others[found.kind]()
    paths, channels = _suspects(given, found)
    near = [text for name, ratio in channels.items() for text in _near(_quantity(given, name), name, ratio, units.get(name))]
    between = f", as if {' or '.join(near)}" if near else ", which no confusion of units explains"
    advice = "unit" if near else "unit, the sensitivity and the amplifier's range"
    subject = "All responses are" if found.kind == "responses" and len(found.names) > 1 else f"{names} is"
    if found.kind == "drive":
        subject = f"The drive {names} is"
    every = "all responses" if len(found.names) > 1 else names
    said = {
        "sensor": f", and the others are not: check the {advice} of {names}.",
        "drive": f": check the {advice} of {names}.",
        "responses": f": check the {advice} of the drive channel {drive}, and of {every}.",
    }[found.kind]  # fmt: skip
    relative = "the responses require" if found.kind == "drive" else "the given rig predicts for the recorded drive"
    return Doubt(
        parameter="+".join(paths), kind="unit" if near else "decade", ratio=found.ratio,
        text=f"{subject} about {found.ratio:.3g} times as large as {relative}{between}{said}",
    )  # fmt: skip


def _of_reversed() -> Doubt:
    return Doubt(
        parameter="channels", kind="reversed", ratio=1.0,
        text="The records agree with the given rig only if time runs backwards: their samples are in reverse order; reverse "
        "the order of the rows in the files.",
    )  # fmt: skip


def _of_damping(given: RigModel, found: WrongScale) -> Doubt:
    links = [given.link(name) for name in found.names]
    unit = unit_of(f"links.{links[0].name}.damping", given)
    values, likely = (
        " and ".join(f"{value:.3g}" for value in each) + f" {unit}"
        for each in ([link.damping for link in links], [as_ratio(given, link) for link in links])
    )
    return Doubt(
        parameter="+".join(f"links.{link.name}.damping" for link in links), kind="unit", ratio=1.0,
        text=f"The given damping of {' and '.join(found.names)}, {values}, is far below what the records show, but agrees with "
        f"them as a damping ratio: give it in {unit}, twice the ratio times √(stiffness × mass), about {likely}.",
    )  # fmt: skip


def _of_place(given: RigModel, found: WrongScale) -> Doubt:
    assert found.left is not None
    before, after = (f"{100.0 * share:.2g} %" for share in found.left)
    if found.kind != "exchange":
        rank, verb = ("drive", "act") if found.kind == "pushed" else ("sensors", "be")
        own = {drive.channel: " and ".join(drive.pushes) for drive in given.drives}
        own |= {sensor.channel: sensor.body or "" for sensor in given.sensors}
        bodies = found.bodies if len(found.names) > 1 else [" or ".join(found.bodies)]
        places = [
            f"{name} seems to {verb} on {body} instead of {own[name]}" for name, body in zip(found.names, bodies, strict=True)
        ]
        # A single response is the same with drive and sensor exchanged (reciprocity).
        both = "the places of sensor and drive, and their bodies" if len(given.sensors) == 1 else "the place, and the body"
        return Doubt(
            parameter="+".join(f"{rank}.{name}" for name in found.names), kind="place", ratio=1.0,
            text=f"{' and '.join(places)}: there, the linear rig leaves about {after} of the power unexplained instead of "
            f"{before}; check {both} in the description.",
        )  # fmt: skip
    masses = " and ".join(f"{given.body(name).mass:.4g}" for name in found.names)
    unit = unit_of(f"bodies.{found.names[0]}.mass", given)
    return Doubt(
        parameter="+".join(f"bodies.{name}.mass" for name in found.names), kind="swapped", ratio=1.0,
        text=f"The given masses of {' and '.join(found.names)} ({masses} {unit}) seem exchanged: with them exchanged, the linear "
        f"rig leaves about {after} of the records' power unexplained instead of {before}; check the given values.",
    )  # fmt: skip


def _of_derivative(given: RigModel, found: WrongScale, spectra: Sequence[Spectrum]) -> Doubt:
    wrong = {found.names: found.derivative}
    if {*found.names} == {sensor.channel for sensor in given.sensors}:
        # All responses relative to the drive: the drive may be the one.
        wrong[given.drive.channel,] = -found.derivative
    shown = {names: quantity for names, change in wrong.items() if (quantity := _derived(_quantity(given, names[0]), change))}
    # A recording that has what its values show contradicts the description.
    run = spectra[0].run
    right = [names for names, quantity in shown.items() if {run.channel(name).quantity for name in names} == {quantity}]
    drives = [drive.channel for drive in given.drives]
    said, paths = [], []
    for names in right or shown:
        is_, but = (f"{'an' if one[0] == 'a' else 'a'} {words(one)}" for one in (shown[names], _quantity(given, names[0])))
        varies = "varies" if len(names) == 1 else "vary"
        said.append(f"{' and '.join(names)} {varies} with frequency like {is_}, but the description has {but}")
        paths += [f"{'drive' if name in drives else 'sensors'}.{name}" for name in names]
    advice = (
        "correct the quantity in the description, since the recording has that"
        if right
        else "check the unit in the mapping and the quantity in the description"
    )
    return Doubt(
        parameter="+".join(paths), kind="derivative", ratio=1.0, text=f"In size and phase, {', or '.join(said)}: {advice}."
    )


def _derived(quantity: Quantity, change: int) -> Quantity | None:
    # The quantity with further time derivatives; None if there is none.
    family = {MOTION[each]: each for each in MOTION if (each in ROTARY) == (quantity in ROTARY)}
    return family.get(MOTION[quantity] + change) if quantity in MOTION else None


def _suspects(given: RigModel, found: WrongScale) -> tuple[list[str], dict[str, float]]:
    # Paths of the channels, and the ratio of recorded to true value of each that would explain the finding.
    if found.kind == "drive":
        return [f"drive.{name}" for name in found.names], dict.fromkeys(found.names, found.ratio)
    if found.kind == "sensor":
        return [f"sensors.{name}" for name in found.names], dict.fromkeys(found.names, found.ratio)
    # Either the drive is wrong, or all responses are, which needs one quantity.
    alike = len({sensor.quantity for sensor in given.sensors}) == 1
    drive = given.drive.channel
    return [f"drive.{drive}"], {drive: 1.0 / found.ratio, **({found.names[0]: found.ratio} if alike else {})}


def _quantity(given: RigModel, channel: str) -> Quantity:
    return next((drive.quantity for drive in given.drives if drive.channel == channel), None) or given.sensor(channel).quantity


def _near(quantity: Quantity, channel: str, ratio: float, unit: str | None) -> list[str]:
    # The confusion of units closest to a ratio of recorded to true value.
    pairs = mistaken(quantity, unit)
    if not pairs:
        return []
    best = min(pairs, key=lambda pair: abs(log(ratio / pairs[pair])))
    return [f"{channel} were in {best}"] if abs(log(ratio / pairs[best])) <= log(ROUGHLY) else []


def _released(given: RigModel, campaign: Campaign) -> Iterable[Doubt]:
    # A run without a drive starts from a given position: levels in wrong units differ by more than any cause changes them.
    free = tuple(run for run in campaign.runs if not any(run.read(drive.channel).any() for drive in given.drives))
    if not free:
        return
    from isorig.analysis.fitting.preparation import prepare
    from isorig.analysis.fitting.trials import simulated, true_motion

    ratios: dict[str, list[float]] = {}
    for trial in prepare(replace(campaign, runs=free), given):
        if trial.motion is None and not trial.excitation.recorded.any():
            with suppress(SimulationError):
                shown = simulated(given, trial, true_motion(given, trial)).std(axis=1)
                measured = trial.measured.std(axis=1)
                for name, ours, theirs in zip(trial.channels, shown, measured, strict=True):
                    if 0.0 < ours < inf and theirs > 0.0:
                        ratios.setdefault(name, []).append(float(theirs / ours))
    for name, each in ratios.items():
        ratio = median(each)
        if abs(log(ratio)) >= log(RELEASED):
            yield _of_scale(given, WrongScale(kind="sensor", names=(name,), ratio=ratio), {})


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


def _at_limits(given: RigModel, fitted: Fit) -> Iterable[Doubt]:
    # Of the rig's own parameters: that a cause has no limit, or is sharp, is part of the answer.
    for free in (free for free in fitted.free if free.path in given.free):
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
    last = words(parts[-1])
    return f"The {last} of {parts[1]!r}" if len(parts) > 2 else f"The {parts[0]}'s {last}"
