"""Detects records, given values and sample rates that are wrong by a factor, before any fit over time.

The power of each response in bands of a third of an octave is compared with what the linear part of the given rig predicts for
the recorded drive. Given values may be inaccurate, dampings unknown, and an unmodelled cause changes the levels in some bands.
So every explanation (nothing is wrong; one channel, all responses, a stiffness, a mass or the sample rate is wrong by a factor)
gets its most likely parameters, with heavy-tailed distributions for the errors of given values and of levels, and the cheapest
explanation wins.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import exp, log
from typing import Any, Literal

import numpy as np
from scipy.optimize import least_squares

from isorig.analysis.campaign import BoolArray, ComplexArray, FloatArray
from isorig.analysis.fitting.linear_spectra import (
    LinearRig,
    Spectrum,
    dampers,
    given_parameters,
    spectrum_of,
)
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.model.parameter_units import unit_of
from isorig.analysis.model.rig_model import RigModel
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
#: Runs compared: those with the largest level of each configuration.
RUNS = 2
#: Factors by which a sample rate is mistaken: the next setting of an instrument, its power of ten, kHz read as Hz.
RATES = (0.5, 2.0, 0.25, 4.0, 0.1, 10.0, 1e-3, 1e3)
#: Relative change of cost and parameters below which a fit ends: the differences that decide are a thousand times larger.
CONVERGED = 1e-4
#: Number of explanations that are fitted, the most likely ones at the given values.
FITTED = 4


@dataclass(frozen=True, kw_only=True)
class WrongScale:
    """What is wrong, and by which factor.

    Parameters
    ----------
    kind
        "responses": all responses compared with the drive; "sensor"; "drive": one of several drives; "stiffness"; "mass";
        "rate": the sample rate; "sign": inverted records.
    names
        The channels, links or bodies; all responses or the only drive for "responses", nothing for "rate".
    ratio
        Recorded over predicted level; given over likely value for "stiffness" and "mass"; given over likely sample rate; -1 for
        inverted records.
    """

    kind: Literal["responses", "sensor", "drive", "stiffness", "mass", "rate", "sign"]
    names: tuple[str, ...]
    ratio: float


@dataclass(frozen=True)
class _Explanation:
    # What is wrong, and its factor; a continuous one is fitted if None. Indices of sensors, drives, links or bodies.
    kind: Literal["sound", "responses", "sensor", "drive", "stiffness", "mass", "rate", "sign"]
    places: tuple[int, ...] = ()
    factor: float | None = 1.0


def wrong_scale(given: RigModel, trials: Sequence[Trial]) -> tuple[WrongScale | None, bool]:
    """The factor by which a record, a given value or the sample rate is wrong, None if there is none; and whether the phases of
    all records agree with the rig apart from it, so that nothing is exchanged.

    Parameters
    ----------
    given
        The rig with known values and starting values.
    trials
        The runs; those without a drive are skipped.
    """
    compared = _Compared(given, trials)
    if not compared.spectra:
        return None, False
    best = _Explanation("sound")
    least, found = compared.fitted(best)
    unknown = "drive.factor" in given.free
    if least > CLEAR:
        sound, before = least, compared.begun(best)
        if unknown:
            best = _Explanation("responses", tuple(range(len(given.sensors))), None)
            least, found = compared.fitted(best)
            sound, before = min(sound, least), min(before, compared.begun(best))
        begun = {each: compared.begun(each) for each in _explanations(given)}
        # An explanation that must beat the sound rig by a margin beats it by as much at the given values.
        likely = [each for each in sorted(begun, key=lambda each: begun[each]) if begun[each] + MARGIN < before]
        for each in likely[:FITTED]:
            cost, here = compared.fitted(each)
            if cost < least and cost + MARGIN < sound and (cost + PRICE < sound or compared.agree(each, cost, here)):
                best, least, found = each, cost, here
    ratio = best.factor if best.factor is not None else exp(float(found[-1]))
    if best.factor is None and abs(log(ratio)) < log(LEAST_UNKNOWN if unknown and best.kind == "responses" else LEAST_RATIO):
        best = _Explanation("sound")
    correlation = compared.correlation(best, found)
    together = bool((np.abs(correlation) >= LINEAR).all())
    if best.kind == "sound":
        inverted = tuple(np.flatnonzero(correlation < INVERTED).tolist())
        if not inverted:
            return None, together
        best, ratio = _Explanation("sign", inverted), -1.0
    channels = [sensor.channel for sensor in given.sensors]
    names = {
        "sensor": channels, "responses": channels, "sign": channels, "drive": [drive.channel for drive in given.drives],
        "stiffness": [link.name for link in given.links], "mass": [body.name for body in given.bodies],
    }  # fmt: skip
    assert best.kind != "sound"
    return WrongScale(kind=best.kind, names=tuple(names.get(best.kind, [])[k] for k in best.places), ratio=ratio), together


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
    yield from _given("stiffness", stiff, [unit_of(f"links.{link.name}.stiffness", given) for link in given.links])
    yield from _given("mass", heavy, [unit_of(f"bodies.{body.name}.mass", given) for body in given.bodies])
    yield from (_Explanation("rate", (), factor) for factor in RATES)


def _given(kind: Literal["stiffness", "mass"], places: Sequence[int], units: Sequence[str]) -> Iterator[_Explanation]:
    # All values with one unit, or one of them, are given in another unit.
    for unit in dict.fromkeys(units[k] for k in places):
        alike = tuple(k for k in places if units[k] == unit)
        for si in GIVEN.get(unit, {}).values():
            yield _Explanation(kind, alike, 1.0 / si)
            if len(alike) > 1:
                yield from (_Explanation(kind, (k,), 1.0 / si) for k in alike)


class _Compared:
    # The recorded and the predicted levels of a rig's runs.

    def __init__(self, given: RigModel, trials: Sequence[Trial]) -> None:
        self._given = given
        self.spectra = [s for trial in _strongest(trials) if (s := _spectrum(given, trial)) is not None]
        self._rigs = {s.run.configuration: LinearRig(given, s.run.configuration) for s in self.spectra}
        self._forces = [_friction(contact.law) for contact in given.contacts]
        self._values = given_parameters(given)
        self._rubs: dict[str, FloatArray] = {}
        self._usual = self._errors()
        self._recorded = [_levels(s.power, s) for s in self.spectra]
        count = np.zeros(len(given.sensors))
        for each in self._recorded:
            count += np.isfinite(each).sum(axis=0)
        self._weights = (
            np.concatenate(
                [
                    np.broadcast_to(INDEPENDENT / np.maximum(count, INDEPENDENT), each.shape)[np.isfinite(each)]
                    for each in self._recorded
                ]
            )
            if self.spectra
            else np.zeros(0)
        )

    def _errors(self) -> FloatArray:
        # Usual errors of masses, stiffnesses, dampings and frictions.
        given = self._given
        mass = [ESTIMATED if f"bodies.{b.name}.mass" in given.free else WEIGHED for b in given.bodies]
        links, contacts = len(given.links), len(given.contacts)
        return np.array([*mass, *[ESTIMATED] * links, *[LOSSES] * links, *[LOSSES] * contacts])

    def start(self, explanation: _Explanation) -> FloatArray:
        """The given values, and the median of a fitted factor."""
        theta = np.zeros(len(self._usual))
        if explanation.factor is not None:
            return theta
        away = self._away(theta, replace(explanation, factor=1.0))
        rows = np.concatenate(
            [np.broadcast_to(self._touches(explanation), each.shape)[np.isfinite(each)] for each in self._recorded]
        )
        return np.append(theta, np.median(away[rows]) if rows.any() else 0.0)

    def _touches(self, explanation: _Explanation) -> BoolArray:
        every = np.arange(len(self._given.sensors))
        return np.asarray(np.isin(every, explanation.places if explanation.kind in ("responses", "sensor") else every))

    def begun(self, explanation: _Explanation) -> float:
        """Cost at the given values."""
        return self.cost(explanation, self.start(explanation))

    def cost(self, explanation: _Explanation, theta: FloatArray) -> float:
        """Negative log likelihood of parameters, relative to a perfect agreement."""
        away = self._away(theta, explanation) / LEVEL
        usual = theta[: len(self._usual)] / self._usual
        return float(np.sum(np.log1p(usual**2)) + np.sum(self._weights * np.log1p(away**2))) / 2.0

    def fitted(self, explanation: _Explanation) -> tuple[float, FloatArray]:
        """Least cost, and its parameters."""
        free = len(self._usual)

        def residuals(theta: FloatArray) -> FloatArray:
            return np.concatenate([theta[:free] / self._usual, self._away(theta, explanation) / LEVEL])

        weights = np.concatenate([np.ones(free), self._weights])

        def logarithm(squares: FloatArray) -> FloatArray:
            return np.asarray(np.stack([np.log1p(squares), 1.0 / (1.0 + squares), -1.0 / (1.0 + squares) ** 2]) * weights)

        loss: Any = logarithm
        begin = self.start(explanation)
        solved = least_squares(
            residuals, begin, loss=loss, method="trf", max_nfev=25, diff_step=[1e-4], ftol=CONVERGED, xtol=CONVERGED
        )
        found = np.asarray(solved.x)
        costs = [(self.cost(explanation, theta), theta) for theta in (begin, found)]
        return min(costs, key=lambda each: each[0])

    def agree(self, explanation: _Explanation, cost: float, theta: FloatArray) -> bool:
        """Whether levels and phases of the records agree with an explanation."""
        return cost <= CLEAR and bool(np.abs(self.correlation(explanation, theta)).min() >= LINEAR)

    def correlation(self, explanation: _Explanation, theta: FloatArray) -> FloatArray:
        """Mean over runs and bands of the correlation of each response with its prediction, shape (responses,)."""
        rows = []
        for spectrum, response in zip(self.spectra, self._responses(theta, explanation), strict=True):
            known = ~np.isnan(spectrum.power)
            together = np.einsum("gcd,gdc->gc", response.conj(), spectrum.across).real
            predicted = np.einsum("gcd,gde,gce->gc", response.conj(), spectrum.drives, response).real
            sums = [_summed(np.where(known, each, 0.0), spectrum) for each in (together, predicted, spectrum.power)]
            with np.errstate(divide="ignore", invalid="ignore"):
                rows.append(sums[0] / np.sqrt(sums[1] * sums[2]))
        every = np.concatenate(rows)
        return np.asarray(np.nansum(every, axis=0) / np.maximum(np.isfinite(every).sum(axis=0), 1))

    def _away(self, theta: FloatArray, explanation: _Explanation) -> FloatArray:
        # Log of recorded over predicted amplitude in every run, band and channel.
        sensors = np.zeros(len(self._given.sensors))
        if explanation.kind == "sensor":
            sensors[list(explanation.places)] = log(_factor(explanation, theta))
        rows = []
        every = zip(self.spectra, self._recorded, self._responses(theta, explanation), strict=True)
        for spectrum, recorded, response in every:
            power = np.einsum("gcd,gde,gce->gc", response.conj(), spectrum.drives, response).real
            away = recorded - _levels(np.where(np.isnan(spectrum.power), np.nan, power), spectrum) - sensors
            rows.append(away[np.isfinite(recorded)])
        return np.nan_to_num(np.clip(np.concatenate(rows), -50.0, 50.0), nan=50.0)

    def _responses(self, theta: FloatArray, explanation: _Explanation) -> Iterator[ComplexArray]:
        # Of every run, per unit of each drive's recorded value.
        given, factor, places = self._values, _factor(explanation, theta), list(explanation.places)
        b, k = len(given.mass), len(given.stiffness)
        change = np.exp(np.clip(theta, -20.0, 20.0))
        mass, stiffness = given.mass * change[:b], given.stiffness * change[b : b + k]
        if explanation.kind in ("mass", "stiffness"):
            (mass if explanation.kind == "mass" else stiffness)[places] /= factor
        forces = np.array(self._forces) * change[b + 2 * k : b + 2 * k + len(self._forces)]
        values = replace(given, mass=mass, stiffness=stiffness, damping=given.damping * change[b + k : b + 2 * k])
        drives = np.ones(len(self._given.drives))
        if explanation.kind == "drive":
            drives[places] /= factor
        elif explanation.kind == "responses":
            drives *= factor
        for spectrum in self.spectra:
            rig = self._rigs[spectrum.run.configuration]
            seen = replace(spectrum, omega=spectrum.omega / factor) if explanation.kind == "rate" else spectrum
            free = rig.free_motion(seen.omega, values)
            rubs = self._rubs[spectrum.run.id] = dampers(
                free, values, seen, forces.tolist(), drives, self._rubs.get(spectrum.run.id)
            )
            yield rig.responses(seen.omega, replace(values, friction=rubs), free) * drives


def _factor(explanation: _Explanation, theta: FloatArray) -> float:
    return explanation.factor if explanation.factor is not None else exp(float(np.clip(theta[-1], -50.0, 50.0)))


def _summed(power: FloatArray, spectrum: Spectrum) -> FloatArray:
    _, band = np.unique(spectrum.band, return_inverse=True)
    total = np.zeros((int(band.max()) + 1, power.shape[1]))
    np.add.at(total, band, power)
    return total


def _levels(power: FloatArray, spectrum: Spectrum) -> FloatArray:
    # Log amplitude in each band, shape (bands, channels); NaN where none is known.
    total = _summed(np.nan_to_num(power), spectrum)
    return np.asarray(0.5 * np.log(np.where(total > 0.0, total, np.nan)))


def _strongest(trials: Sequence[Trial]) -> list[Trial]:
    # The runs with the largest drive, of every configuration.
    by: dict[str, list[Trial]] = {}
    for trial in sorted(trials, key=lambda each: -float(np.std(each.excitation.recorded))):
        by.setdefault(trial.run.configuration, []).append(trial)
    return [trial for several in by.values() for trial in several[:RUNS]]


def _spectrum(given: RigModel, trial: Trial) -> Spectrum | None:
    samples = min((gap.first_tick for gap in trial.run.gaps), default=len(trial.run))
    noise = {} if trial.motion is not None else dict(zip(trial.channels, trial.noise.tolist(), strict=True))
    return spectrum_of(given, trial.run, samples, noise)


def _friction(law: object) -> float:
    # The level of a friction law, N.
    found = [getattr(law, key, None) for key in ("friction_force", "forward_force", "backward_force")]
    levels = [value for value in found if isinstance(value, float)]
    return float(np.mean(levels)) if levels else 0.0
