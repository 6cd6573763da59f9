"""Detects records, given values and sample rates that are wrong by a factor or a derivative, before any fit over time.

The power of each response in bands of a third of an octave is compared with what the linear part of the given rig predicts for
the recorded drive. Given values may be inaccurate, dampings unknown, and an unmodelled cause changes the levels in some bands.
So every explanation (nothing is wrong; one channel, all responses, a stiffness, a mass or the sample rate is wrong by a factor;
channels are another derivative of the motion) gets its most likely parameters, with heavy-tailed distributions for the errors of
given values and of levels, and the cheapest explanation wins.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import combinations
from math import exp, log
from typing import Literal

import numpy as np

from isorig.analysis.campaign import MOTION, BoolArray, ComplexArray, FloatArray, IntArray, Quantity
from isorig.analysis.fitting.linear_spectra import (
    LEAST_DAMPING,
    LinearRig,
    Spectrum,
    dampers,
    friction_level,
    given_parameters,
)
from isorig.analysis.fitting.resonances import Resonance, resonance
from isorig.analysis.model.linear import pushes_of
from isorig.analysis.model.parameter_units import unit_of
from isorig.analysis.model.rig_model import GROUND, Link, RigModel, direction
from isorig.analysis.units import GIVEN

#: Usual errors of given values, as standard deviations of the logarithm: a mass that was weighed, a mass or stiffness that is an
#: estimate, dampings and frictions. Chosen: descriptions are up to a quarter off, dampings by a factor.
WEIGHED, ESTIMATED, LOSSES = 0.1, 0.25, 1.0
#: Usual error of a predicted level (log of amplitude) due to what the linear part leaves out, and the number of independent
#: levels that the bands of one channel count as: an unmodelled cause changes neighbouring bands alike.
LEVEL, INDEPENDENT = 0.35, 6.0
#: Cost below which the levels agree: that of 50 of 60 linear rigs with descriptions up to a quarter off.
CLEAR = 1.5
#: By how much the cost must fall for an explanation after which levels and phases agree, and for one after which they do not: an
#: unmodelled cause may make a wrong explanation fit better, but not well.
MARGIN, PRICE = 1.5, 4.0
#: Mean correlation of records with predictions in bands from which the phases agree: linear rigs have 0.94 to 0.99 with their own
#: parameters, rigs with friction, play or a cubic spring mostly less.
LINEAR = 0.93
#: Ratios of levels below this are no wrong unit: an unmodelled cause changes levels by up to two, and a description by a quarter;
#: nor are those below the second one if the drive's factor is unknown.
LEAST_RATIO, LEAST_UNKNOWN = 3.0, 8.0
#: Mean correlation of records with predictions in bands, below which a record is inverted: ideally 1, and -1 if inverted.
INVERTED = -0.5
#: Mean correlation of every record with its prediction from which the phases agree with another derivative of a record: it is 0
#: without this derivative, as phases then differ by 90 degrees; a cause that is not modelled yet disturbs them.
TURNED = 0.5
#: Share of the unexplained power that may be left with a sensor on another body or with two masses exchanged, unless the cost
#: falls by `PRICE`; and mean correlation of every record with its prediction from which the phases agree with that. Chosen: of 69
#: rigs as described, half of them with a cause, none costs less by more than 1.0 with such a mistake.
REPAIRED, AGREES = 1.0 / 3.0, 0.7
#: Mistakes after which bodies are not where they are described: these are judged by the phases, too.
ELSEWHERE = ("place", "pushed", "exchange")
#: Masses that differ by less than this factor are not exchanged: a description may be a quarter off, either way.
UNLIKE = 1.6
#: Runs compared: those with the largest level of each configuration.
RUNS = 2
#: Power relative to the sensor's noise below which a frequency is left out.
ABOVE_NOISE = 10.0
#: Factors by which a sample rate is mistaken: the next settings of an instrument (powers of two, or 1, 2, 5), kHz read as Hz.
RATES = (0.5, 2.0, 0.25, 4.0, 0.2, 5.0, 0.1, 10.0, 1e-3, 1e3)
#: Change of the cost below which a fit ends, a hundredth of what decides; the most steps of one; difference of its derivatives.
CONVERGED, STEPS, DIFFERENCE = 0.01 * MARGIN, 25, 1e-4
#: Levenberg-Marquardt dampings that are tried at once, relative to the last one.
DAMPINGS = np.array([0.1, 1.0, 10.0, 1e3])
#: A resonance that is recorded at a multiple of the described frequency confirms a wrong rate of this multiple within this
#: factor: masses and stiffnesses that are a quarter off change a frequency by as much.
CONFIRMED = 1.25
#: Number of explanations that are fitted, the most likely ones at the given values.
FITTED = 4


@dataclass(frozen=True, kw_only=True)
class WrongScale:
    """What is wrong, and by which factor."""

    #: "responses": all responses compared with the drive; "sensor"; "drive": one of several drives; "stiffness"; "mass"; "rate":
    #: the sample rate; "sign": inverted records; "derivative": records of another derivative of the motion; "place": a sensor on
    #: another body, or two on each other's; "pushed": a drive that acts on another body; "exchange": the masses of two bodies;
    #: "damping": given dampings are damping ratios; "reversed": the records run backwards in time.
    kind: Literal[
        "responses", "sensor", "drive", "stiffness", "mass", "rate", "sign", "derivative", "place", "pushed", "exchange",
        "damping", "reversed",
    ]  # fmt: skip
    #: The channels, links or bodies; all responses or the only drive for "responses", nothing for "rate" and "reversed".
    names: tuple[str, ...]
    #: Recorded over predicted level; given over likely value for "stiffness" and "mass"; given over likely sample rate; -1 for
    #: inverted records, 1 for reversed ones and damping ratios. For another derivative 1, or the factor of a drive whose factor
    #: is unknown.
    ratio: float
    derivative: int = 0  #: Number of time derivatives of the records minus that of the given rig's sensors or drive.
    #: The body on which a sensor is, followed by others for which that is hardly less likely; those of two sensors; the body on
    #: which a drive acts.
    bodies: tuple[str, ...] = ()
    #: Share of power that the rig does not explain, of the sensors' records as described and on the other bodies, or of all
    #: records with a drive, or the masses, as given and otherwise; None for all other mistakes.
    left: tuple[float, float] | None = None


@dataclass(frozen=True)
class _Explanation:
    # What is wrong, and its factor; a continuous one is fitted if None. Indices of sensors, drives, links or bodies. Records with
    # further time derivatives are those of sensors, or of drives if `driven`; `bodies` are those on which the sensors are
    # ("place"), or on which the drive acts ("pushed").
    kind: Literal[
        "sound", "responses", "sensor", "drive", "stiffness", "mass", "rate", "sign", "derivative", "place", "pushed", "exchange",
        "damping", "reversed",
    ]  # fmt: skip
    places: tuple[int, ...] = ()
    factor: float | None = 1.0
    derivative: int = 0
    driven: bool = False
    bodies: tuple[int, ...] = ()


def wrong_scale(given: RigModel, spectra: Sequence[Spectrum]) -> tuple[WrongScale | None, FloatArray]:
    """The factor by which a record, a given value or the sample rate is wrong, None if there is none; and how well the phases of
    each record agree with the rig apart from it: at most 1, shape (responses,).
    """
    if not spectra:
        return None, np.zeros(len(given.sensors))
    compared = _Compared(given, spectra)
    best = _Explanation("sound")
    ((least, found),) = compared.fitted([best])
    unknown = "drive.factor" in given.free
    described, settled = (best, found), found
    if least > CLEAR:
        sound = least
        (before,) = compared.begun([best])
        if unknown:
            best = _Explanation("responses", tuple(range(len(given.sensors))), None)
            ((least, found),) = compared.fitted([best], settled)
            sound, before = min(sound, least), min(before, *compared.begun([best]))
            described = best, found
        explanations = list(_explanations(given))
        begun = dict(zip(explanations, compared.begun(explanations), strict=True))
        # An explanation that must beat the sound rig by a margin beats it by as much at the given values.
        # Dampings have an effect only where the resonances are as described.
        likely = [
            each for each in sorted(begun, key=lambda each: begun[each])
            if begun[each] + MARGIN < before or each.kind == "damping"
        ]  # fmt: skip
        shown = resonance(given, spectra) if any(each.kind == "rate" for each in likely[:FITTED]) else None
        for each, (cost, here) in zip(likely, compared.fitted(likely[:FITTED], settled), strict=False):
            far = cost + PRICE < sound
            if each.kind in ELSEWHERE:
                enough = compared.repairs(each, here, described, far=far)
            else:
                # Friction that is not described yet looks like a larger damping.
                far = far and each.kind != "damping"
                enough = far or _confirmed(each, shown) or compared.agree(each, cost, here)
                enough = enough and (each.kind != "derivative" or compared.correlation(each, here).min() >= TURNED)
            if cost < least and cost + MARGIN < sound and enough:
                best, least, found = each, cost, here
    ratio = best.factor if best.factor is not None else exp(float(found[-1]))
    smallest = LEAST_UNKNOWN if unknown and best.kind == "responses" else LEAST_RATIO
    if best.factor is None and best.kind in ("responses", "sensor", "drive") and abs(log(ratio)) < log(smallest):
        best = _Explanation("sound")
    correlation = compared.correlation(best, found)
    agreement = np.abs(correlation)
    if best.kind == "sound":
        inverted = tuple(np.flatnonzero(correlation < INVERTED).tolist())
        backwards = compared.correlation(best, found, backwards=True)
        if backwards.min() >= AGREES and _left(backwards) <= REPAIRED * _left(correlation):
            best, agreement = _Explanation("reversed"), backwards
        elif inverted:
            best, ratio = _Explanation("sign", inverted), -1.0
        else:
            return None, agreement
    channels, drives = [sensor.channel for sensor in given.sensors], [drive.channel for drive in given.drives]
    names = {
        "sensor": channels, "responses": channels, "sign": channels, "drive": drives,
        "derivative": drives if best.driven else channels, "place": channels, "pushed": drives,
        "exchange": [b.name for b in given.bodies],
        "stiffness": [link.name for link in given.links], "mass": [body.name for body in given.bodies],
        "damping": [link.name for link in given.links],
    }  # fmt: skip
    assert best.kind != "sound"
    wrong = tuple(names.get(best.kind, [])[k] for k in best.places)
    return WrongScale(
        kind=best.kind, names=wrong, ratio=ratio, derivative=best.derivative,
        bodies=compared.bodies(best, least, settled),
        left=(compared.left(best, *described), compared.left(best, best, found)) if best.kind in ELSEWHERE else None,
    ), agreement  # fmt: skip


def _confirmed(explanation: _Explanation, shown: Resonance | None) -> bool:
    # Whether a resonance is recorded at the frequency that a wrong rate predicts.
    if explanation.kind != "rate" or explanation.factor is None or shown is None:
        return False
    return abs(log(shown.ratio / explanation.factor)) < log(CONFIRMED)


def _explanations(given: RigModel) -> Iterator[_Explanation]:
    sensors = range(len(given.sensors))
    yield _Explanation("responses", tuple(sensors), None)
    for k in sensors if len(sensors) > 1 else ():
        yield _Explanation("sensor", (k,), None)
    alike = {s.quantity: tuple(k for k in sensors if given.sensors[k].quantity == s.quantity) for s in given.sensors}
    for places in alike.values():
        if 1 < len(places) < len(sensors):
            yield _Explanation("sensor", places, None)
    for k in range(len(given.drives)) if given.more_drives else ():
        yield _Explanation("drive", (k,), None)
    stiff = [k for k, link in enumerate(given.links) if link.stiffness > 0.0]
    heavy = [k for k, body in enumerate(given.bodies) if body.name not in given.imposed]
    factor = None if "drive.factor" in given.free else 1.0
    yield from _derivatives(given, alike, factor)
    elsewhere = list(_elsewhere(given))
    yield from (_Explanation("place", (k,), factor, bodies=(body,)) for k, body in elsewhere)
    own = [next((k for k, body in enumerate(given.bodies) if body.name == sensor.body), -1) for sensor in given.sensors]
    # Of one quantity they would be swapped cables.
    yield from (
        _Explanation("place", (k, j), factor, bodies=(own[j], own[k])) for k, j in combinations(sensors, 2)
        if given.sensors[k].quantity != given.sensors[j].quantity and {(k, own[j]), (j, own[k])} <= {*elsewhere}
    )  # fmt: skip
    yield from (_Explanation("pushed", (k,), factor, bodies=(body,)) for k, body in _pushed(given))
    yield from (
        _Explanation("exchange", pair, factor) for pair in combinations(range(len(given.bodies)), 2) if _unlike(given, *pair)
    )
    scaleless = all(drive.imposes for drive in given.drives)
    units = [unit_of(f"links.{link.name}.stiffness", given) for link in given.links]
    yield from _given("stiffness", stiff, units, scaleless=scaleless)
    units = [unit_of(f"bodies.{body.name}.mass", given) for body in given.bodies]
    yield from _given("mass", heavy, units, scaleless=scaleless)
    if ratios := tuple(k for k in stiff if _may_be_ratio(given, given.links[k])):
        yield _Explanation("damping", ratios)
    # A rate shows in the frequencies of resonances; without a spring there are none.
    yield from (_Explanation("rate", (), factor) for factor in RATES if stiff)


def as_ratio(given: RigModel, link: Link) -> float:
    """The damping of a link in N s/m whose given one is a damping ratio, relative to the lighter of its ends."""
    return 2.0 * link.damping * float(np.sqrt(link.stiffness * given.constants_of(link).mass))


def _may_be_ratio(given: RigModel, link: Link) -> bool:
    # Whether a given damping is hardly any as described; a damping that is fitted may have any starting value.
    little = 0.0 < link.damping**2 < LEAST_DAMPING * as_ratio(given, link)
    return little and link.damping < 1.0 and f"links.{link.name}.damping" not in given.free


def _derivatives(given: RigModel, alike: Mapping[Quantity, tuple[int, ...]], factor: float | None) -> Iterator[_Explanation]:
    # One sensor or all of one quantity, or the motion that drives, has another derivative than described.
    for quantity, places in alike.items():
        for change in _changes(quantity):
            yield from (_Explanation("derivative", (k,), factor, change) for k in places)
            if len(places) > 1:
                yield _Explanation("derivative", places, factor, change)
    for k, drive in enumerate(given.drives):
        yield from (_Explanation("derivative", (k,), factor, change, driven=True) for change in _changes(drive.quantity))


def _elsewhere(given: RigModel) -> Iterator[tuple[int, int]]:
    # Indices of a sensor, and of a body on which it may be instead. One on a body whose motion is imposed would repeat the drive.
    for k, sensor in enumerate(given.sensors):
        if sensor.body and not sensor.arms:
            motion = given.body(sensor.body).motion
            for j, body in enumerate(given.bodies):
                if body.motion == motion and body.name not in (sensor.body, sensor.relative_to, *given.imposed):
                    yield k, j


def _pushed(given: RigModel) -> Iterator[tuple[int, int]]:
    # Indices of a drive that acts on one body, and of a body on which it may act instead.
    for k, drive in enumerate(given.drives):
        for name in drive.pushes if len(drive.pushes) == 1 else ():
            for j, body in enumerate(given.bodies):
                if body.motion == given.body(name).motion and body.name not in (name, *given.imposed):
                    yield k, j


def _unlike(given: RigModel, one: int, other: int) -> bool:
    # Whether the masses of two bodies that move alike differ by more than a description's errors.
    a, b = given.bodies[one], given.bodies[other]
    imposed = a.name in given.imposed or b.name in given.imposed
    return not imposed and a.motion == b.motion and abs(log(a.mass / b.mass)) >= log(UNLIKE)


def _changes(quantity: Quantity) -> list[int]:
    # Further derivatives that a record of a motion may have.
    return [order - MOTION[quantity] for order in (0, 1, 2) if order != MOTION[quantity]] if quantity in MOTION else []


def _given(
    kind: Literal["stiffness", "mass"], places: Sequence[int], units: Sequence[str], *, scaleless: bool
) -> Iterator[_Explanation]:
    # All values with one unit, or one of them, are given in another unit. Without a force only ratios of masses and stiffnesses
    # show, and hysteresis changes a stiffness by as much as a small factor.
    for unit in dict.fromkeys(units[k] for k in places):
        alike = tuple(k for k in places if units[k] == unit)
        for si in GIVEN.get(unit, {}).values():
            if scaleless and abs(log(si)) < log(LEAST_RATIO):
                continue
            yield _Explanation(kind, alike, 1.0 / si)
            if len(alike) > 1:
                yield from (_Explanation(kind, (k,), 1.0 / si) for k in alike)


class _Compared:
    # The recorded and the predicted levels of a rig's runs.

    def __init__(self, given: RigModel, spectra: Sequence[Spectrum]) -> None:
        self._given = given
        self._spectra = _strongest(spectra)
        self._rigs = {s.run.configuration: LinearRig(given, s.run.configuration) for s in self._spectra}
        self._forces = np.array([friction_level(contact.law) for contact in given.contacts])[:, None]
        self._values = given_parameters(given)
        self._rubs: dict[str, FloatArray] = {}
        # Distances of the levels by the parameters of a sound rig.
        self._aways: dict[bytes, FloatArray] = {}
        # Usual errors of masses, stiffnesses, dampings and frictions.
        mass = [ESTIMATED if f"bodies.{b.name}.mass" in given.free else WEIGHED for b in given.bodies]
        links, contacts = len(given.links), len(given.contacts)
        self._usual = np.array([*mass, *[ESTIMATED] * links, *[LOSSES] * links, *[LOSSES] * contacts])
        self._known = [s.power >= ABOVE_NOISE * s.noise for s in self._spectra]
        recorded = [_levels(s, known, s.power) for s, known in zip(self._spectra, self._known, strict=True)]
        self._compared = [np.isfinite(each) for each in recorded]
        self._recorded = np.concatenate([each[here] for each, here in zip(recorded, self._compared, strict=True)])
        self._channel = np.concatenate([np.nonzero(here)[0] for here in self._compared])
        count = np.bincount(self._channel, minlength=len(given.sensors))
        self._weights = (INDEPENDENT / np.maximum(count, INDEPENDENT))[self._channel]

    def _with_factor(self, explanation: _Explanation, theta: FloatArray) -> FloatArray:
        # The parameters, and the median of a fitted factor.
        if explanation.factor is not None:
            return theta
        key = theta.tobytes()
        if key not in self._aways:
            self._aways[key] = self._away(self._sets(_Explanation("sound"), theta[:, None]))[:, 0]
        touched = self._touches(explanation)[self._channel]
        return np.append(theta, np.median(self._aways[key][touched]) if touched.any() else 0.0)

    def _touches(self, explanation: _Explanation) -> BoolArray:
        every = np.arange(len(self._given.sensors))
        return np.asarray(np.isin(every, explanation.places if explanation.kind in ("responses", "sensor") else every))

    def begun(self, explanations: Sequence[_Explanation]) -> FloatArray:
        """Cost of each explanation at the given values, shape (explanations,)."""
        given = np.zeros(len(self._usual))
        sets = [self._sets(each, self._with_factor(each, given)[:, None]) for each in explanations]
        return self._cost(self._residuals(_Sets.joined(sets)))

    def _residuals(self, sets: _Sets) -> FloatArray:
        # Errors of the given values and of the levels, in usual ones, shape (errors, sets).
        return np.concatenate([sets.thetas / self._usual[:, None], self._away(sets) / LEVEL])

    def _cost(self, residuals: FloatArray) -> FloatArray:
        # Negative log likelihood of each set, relative to a perfect agreement.
        weights = np.concatenate([np.ones(len(self._usual)), self._weights])
        return np.asarray(weights @ np.log1p(residuals**2) / 2.0)

    def fitted(
        self, explanations: Sequence[_Explanation], settled: FloatArray | None = None
    ) -> list[tuple[float, FloatArray]]:  # fmt: skip
        """Least cost of each explanation, and its parameters.

        Fits start from the given values, or from the parameters of the sound rig if these cost less. They advance together: a
        prediction for the sets of parameters of all takes little longer than for those of one.
        """
        fits = [self._fit(each, settled) for each in explanations]
        wanted = {k: next(fit) for k, fit in enumerate(fits)}
        found: dict[int, tuple[float, FloatArray]] = {}
        while wanted:
            residuals = self._residuals(_Sets.joined(list(wanted.values())))
            ends = np.cumsum([sets.count for sets in wanted.values()])
            for k, own in zip(list(wanted), np.split(residuals, ends[:-1], axis=1), strict=True):
                try:
                    wanted[k] = fits[k].send(own)
                except StopIteration as end:
                    del wanted[k]
                    found[k] = end.value
        return [found[k] for k in range(len(fits))]

    def _fit(
        self, explanation: _Explanation, settled: FloatArray | None
    ) -> Generator[_Sets, FloatArray, tuple[float, FloatArray]]:
        # One fit, which asks for the residuals of sets of parameters: Levenberg-Marquardt with the weights of the heavy-tailed
        # distributions; the derivatives, and the steps with several dampings, are of several sets each.
        near = [np.zeros(len(self._usual))] + ([] if settled is None else [settled])
        weights = np.concatenate([np.ones(len(self._usual)), self._weights])
        tried = np.stack([self._with_factor(explanation, each) for each in near], axis=1)
        away = yield self._sets(explanation, tried)
        costs = self._cost(away)
        best = int(np.argmin(costs))
        theta, residual, cost, damping = tried[:, best], away[:, best], float(costs[best]), 1e-2
        for _ in range(STEPS):
            moved = yield self._sets(explanation, theta[:, None] + DIFFERENCE * np.eye(len(theta)))
            slopes = (moved - residual[:, None]) / DIFFERENCE
            pull = weights / (1.0 + residual**2)
            normal, gradient = slopes.T @ (pull[:, None] * slopes), slopes.T @ (pull * residual)
            scale = np.diag(np.maximum(np.diag(normal), 1e-12))
            steps = [np.linalg.solve(normal + damping * each * scale, gradient) for each in DAMPINGS]
            tried = theta[:, None] - np.stack(steps, axis=1)
            away = yield self._sets(explanation, tried)
            costs = self._cost(away)
            best, before = int(np.argmin(costs)), cost
            if costs[best] < cost:
                theta, residual, cost = tried[:, best], away[:, best], float(costs[best])
            damping = min(max(damping * float(DAMPINGS[best]), 1e-6), 1e6)
            if before - cost < CONVERGED:
                break
        return cost, theta

    def agree(self, explanation: _Explanation, cost: float, theta: FloatArray) -> bool:
        """Whether levels and phases of the records agree with an explanation."""
        return cost <= CLEAR and bool(np.abs(self.correlation(explanation, theta)).min() >= LINEAR)

    def repairs(
        self, explanation: _Explanation, theta: FloatArray, described: tuple[_Explanation, FloatArray], *, far: bool
    ) -> bool:  # fmt: skip
        """Whether a sensor or a drive on another body, or exchanged masses, make the records agree in phase, and leave little of
        their power that the rig as `described` does not explain; the latter is not needed if the cost falls by `far`."""
        less = self.left(explanation, explanation, theta) <= REPAIRED * self.left(explanation, *described)
        return (far or less) and bool(self.correlation(explanation, theta).min() >= AGREES)

    def bodies(self, place: _Explanation, cost: float, settled: FloatArray) -> tuple[str, ...]:
        """The bodies of a wrong place at this cost; of one sensor or drive followed by those with which it is hardly less likely,
        as they move alike."""
        others = []
        if len(place.bodies) == 1:
            every = _elsewhere(self._given) if place.kind == "place" else _pushed(self._given)
            others = [body for k, body in every if (k,) == place.places and (body,) != place.bodies]
        fits = self.fitted([replace(place, bodies=(body,)) for body in others], settled)
        near = [body for body, fit in zip(others, fits, strict=True) if fit[0] < cost + MARGIN]
        return tuple(self._given.bodies[body].name for body in (*place.bodies, *near))

    def left(self, mistake: _Explanation, explanation: _Explanation, theta: FloatArray) -> float:
        """Share of power that an explanation with these parameters leaves, on average over the records that a mistake is about:
        the sensor's of a wrong place, or all."""
        rows = list(mistake.places) if mistake.kind == "place" else slice(None)
        return _left(self.correlation(explanation, theta)[rows])

    def correlation(self, explanation: _Explanation, theta: FloatArray, *, backwards: bool = False) -> FloatArray:
        """Mean over runs and bands of the correlation of each response with its prediction, shape (responses,); of records that
        are read backwards in time if `backwards`."""
        rows = []
        every = zip(self._spectra, self._known, self._responses(self._sets(explanation, theta[:, None])), strict=True)
        for spectrum, known, response in every:
            across = spectrum.across.conj() if backwards else spectrum.across
            together = np.einsum("cdg,dcg->cg", response[:, :, 0].conj(), across).real
            predicted = spectrum.predicted(response)[:, 0]
            sums = [spectrum.in_bands(known * each) for each in (together, predicted, spectrum.power)]
            with np.errstate(divide="ignore", invalid="ignore"):
                rows.append(sums[0] / np.sqrt(sums[1] * sums[2]))
        all_bands = np.concatenate(rows, axis=1)
        return np.asarray(np.nansum(all_bands, axis=1) / np.maximum(np.isfinite(all_bands).sum(axis=1), 1))

    def _away(self, sets: _Sets) -> FloatArray:
        # Log of recorded over predicted amplitude in every run, band and channel, shape (levels, sets).
        every = zip(self._spectra, self._known, self._compared, self._responses(sets), strict=True)
        levels = [
            _levels(spectrum, known[:, None], spectrum.predicted(response)).swapaxes(1, 2)[compared]
            for spectrum, known, compared, response in every
        ]
        away = self._recorded[:, None] - np.concatenate(levels) - sets.sensors[self._channel]
        return np.asarray(np.nan_to_num(np.clip(away, -50.0, 50.0), nan=50.0))

    def _sets(self, explanation: _Explanation, thetas: FloatArray) -> _Sets:
        # What an explanation does to the rig, for sets of its parameters.
        count, places, given = thetas.shape[1], list(explanation.places), self._given
        factor = explanation.factor
        log_factor = np.clip(thetas[-1], -50.0, 50.0) if factor is None else np.full(count, log(factor))
        rows = {
            kind: np.zeros((len(each), count))
            for kind, each in (
                ("mass", given.bodies), ("stiffness", given.links), ("damping", given.links), ("drive", given.drives),
                ("sensor", given.sensors),
            )
        }  # fmt: skip
        if explanation.kind in ("mass", "stiffness", "drive"):
            rows[explanation.kind][places] = -log_factor
        elif explanation.kind in ("responses", "derivative", "place", "pushed"):
            rows["drive"] += log_factor
        elif explanation.kind == "sensor":
            rows["sensor"][places] = log_factor
        elif explanation.kind == "damping":
            ratios = [as_ratio(given, given.links[k]) for k in places]
            rows["damping"][places] = np.log(np.array(ratios)[:, None] / self._values.damping[places])
        elif explanation.kind == "exchange":
            rows["drive"] += log_factor
            masses = [given.bodies[k].mass for k in places]
            rows["mass"][places] = np.log(np.array(masses[::-1]) / masses)[:, None]
        bodies, pushed = np.full((len(given.sensors), count), -1), np.full((len(given.drives), count), -1)
        if explanation.bodies:
            (bodies if explanation.kind == "place" else pushed)[places] = np.array(explanation.bodies)[:, None]
        orders, driven_orders = np.zeros((len(given.sensors), count)), np.zeros((len(given.drives), count))
        (driven_orders if explanation.driven else orders)[places if explanation.derivative else []] = explanation.derivative
        rates = log_factor if explanation.kind == "rate" else np.zeros(count)
        return _Sets(
            thetas=thetas[: len(self._usual)], mass=rows["mass"], stiffness=rows["stiffness"], damping=rows["damping"],
            drives=rows["drive"], sensors=rows["sensor"], rates=rates, orders=orders, driven_orders=driven_orders,
            bodies=bodies, pushed=pushed,
        )  # fmt: skip

    def _places(self, sets: _Sets) -> FloatArray | None:
        # Weights of the bodies in each sensor's motion, shape (responses, bodies, sets); None if all are as described.
        if (sets.bodies < 0).all():
            return None
        given = self._given
        described = np.stack([direction(given, s.body or GROUND, s.relative_to, s.arms) for s in given.sensors])
        found = np.repeat(described[:, :, None], sets.count, axis=2)
        for k, one in zip(*np.nonzero(sets.bodies >= 0), strict=True):
            sensor, body = given.sensors[k], given.bodies[sets.bodies[k, one]].name
            found[k, :, one] = direction(given, body, sensor.relative_to, sensor.arms)
        return found

    def _pushes(self, sets: _Sets) -> FloatArray | None:
        # Forces on the bodies per unit of each drive, shape (bodies, drives, sets); None if all act as described.
        if (sets.pushed < 0).all():
            return None
        found = np.repeat(pushes_of(self._given)[:, :, None], sets.count, axis=2)
        for k, one in zip(*np.nonzero(sets.pushed >= 0), strict=True):
            force = found[:, k, one].sum()
            found[:, k, one] = 0.0
            found[sets.pushed[k, one], k, one] = force
        return found

    def _responses(self, sets: _Sets) -> Iterator[ComplexArray]:
        # Of every run, per unit of each drive's recorded value.
        given = self._values
        b, k = len(given.mass), len(given.stiffness)
        change = np.exp(np.clip(sets.thetas, -20.0, 20.0))
        forces = self._forces * change[b + 2 * k : b + 2 * k + len(self._forces)]
        values = replace(
            given, mass=given.mass * change[:b] * np.exp(sets.mass),
            damping=given.damping * change[b + k : b + 2 * k] * np.exp(sets.damping),
            stiffness=given.stiffness * change[b : b + k] * np.exp(sets.stiffness),
        )  # fmt: skip
        drives, places, pushes = np.exp(sets.drives), self._places(sets), self._pushes(sets)
        for spectrum in self._spectra:
            rig = self._rigs[spectrum.run.configuration]
            omega = spectrum.omega / np.exp(sets.rates)[:, None] if sets.rates.any() else spectrum.omega
            free = rig.free_motion(omega, values, pushes)
            if sets.driven_orders.any():
                # The true motion of the drive is that of its record divided by s, for each further derivative.
                true = (1j * spectrum.omega) ** -sets.driven_orders[..., None]
                free = replace(free, x=free.x * true, velocity=free.velocity * true)
            rubs = dampers(free, values, spectrum, forces, drives, self._rubs.get(spectrum.run.id))
            # The next ones are similar.
            self._rubs[spectrum.run.id] = rubs[:, :1]
            response = rig.responses(omega, replace(values, friction=rubs), free, places) * drives[:, :, None]
            yield response * (1j * spectrum.omega) ** sets.orders[:, None, :, None] if sets.orders.any() else response


@dataclass(frozen=True, kw_only=True)
class _Sets:
    # Sets of parameters in columns: logarithms of the changes of given values, and of the factors of an explanation on masses,
    # stiffnesses, dampings, drives, records and the sample rate; further derivatives of the records and of the drives;
    # the body of each sensor, and that on which each drive acts, -1 as described.
    thetas: FloatArray
    mass: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    drives: FloatArray
    sensors: FloatArray
    rates: FloatArray
    orders: FloatArray
    driven_orders: FloatArray
    bodies: IntArray
    pushed: IntArray

    @property
    def count(self) -> int:
        return len(self.rates)

    @classmethod
    def joined(cls, several: Sequence[_Sets]) -> _Sets:
        names = [field.name for field in fields(cls)]
        return cls(**{name: np.concatenate([getattr(each, name) for each in several], axis=-1) for name in names})


def _left(correlation: FloatArray) -> float:
    # Share of power that predictions with these correlations leave.
    return float(np.mean(1.0 - np.maximum(correlation, 0.0) ** 2))


def _levels(spectrum: Spectrum, known: BoolArray, power: FloatArray) -> FloatArray:
    # Log amplitude in each band, shape (channels, ..., bands); NaN where none is known.
    total = spectrum.in_bands(known * power)
    return np.asarray(0.5 * np.log(np.where(total > 0.0, total, np.nan)))


def _strongest(spectra: Sequence[Spectrum]) -> list[Spectrum]:
    # The runs with the largest drive, of every configuration.
    by: dict[str, list[Spectrum]] = {}
    for spectrum in sorted(spectra, key=lambda each: -each.square * float(each.drives[0, 0].real.sum())):
        by.setdefault(spectrum.run.configuration, []).append(spectrum)
    return [spectrum for several in by.values() for spectrum in several[:RUNS]]
