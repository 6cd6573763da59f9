"""Residuals of a rig's equations over noise, and every kind of cause at every place ranked by the residuals that it removes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Protocol
from weakref import WeakKeyDictionary

import numpy as np

from isorig.analysis.campaign import ComplexArray, FloatArray, IntArray
from isorig.analysis.deadline import ask_time
from isorig.analysis.derivative import derivative
from isorig.analysis.equations.balances import Balance, Element, Lock
from isorig.analysis.equations.columns import (
    CORNERS,
    DRY_FRICTION,
    PER_COEFFICIENT,
    PERIODIC,
    RARE_STOP,
    SHAPES,
    Shape,
    dissipates,
    periodic,
    relaxing,
)
from isorig.analysis.equations.errors import DRIVE_ERRORS, ERRORS
from isorig.analysis.equations.filters import filtered, resonator, rocked, rocker
from isorig.analysis.equations.known import law_columns
from isorig.analysis.equations.motion import derivatives
from isorig.analysis.equations.repeats import pitch_of
from isorig.analysis.equations.sliding import Sliding, SlidingFit, SlidingRun, shortly_low_passed
from isorig.analysis.equations.spectral import Prepared, Row
from isorig.analysis.equations.system import CUT, HOLDS, CausePlace, Equations
from isorig.analysis.model.rig_model import damps
from isorig.analysis.simulate.sampling import lagging

#: Attached resonators: damping ratios, number of frequencies over the band, and the refinement around the best.
COARSE_DAMPING, FINE_DAMPING = 0.02, (0.008, 0.015, 0.03, 0.06)
RESONATORS, CLOSER, WITHIN = 180, 13, 0.02
#: Highest frequency of an attached resonator as a share of the usable band. Chosen: above it, it is only a mass.
HIGHEST = 0.85
#: Lowest frequency of an attached resonator over that of the spectra. Chosen: an absorber is tuned to a mode, the lowest, too.
LEAST_ABOVE = 1.5
#: Half bandwidth, in frequency resolutions of the segments, below which a resonator rings beyond a segment, and evaluations of
#: the search for such a one.
NARROW, RINGING = 1.5, 30
#: Elastic locks: stiffnesses as multiples of mass times the square of the lowest mode, and relaxation times in s.
LOCK_RATIOS, LOCK_TIMES = np.geomspace(1e2, 5e4, 50), (0.0, 4e-4, 1e-3)
#: Sensor faults: gains, delays of a sensor and of the drive in samples, crosstalk; refinements.
GAINS = np.linspace(0.6, 1.6, 41)
DELAYS = np.linspace(0.1, 6.0, 60)
LATE = np.linspace(-30.0, 6.0, 73)
SHARES = np.linspace(-0.4, 0.4, 33)
#: Delay or lag in samples below which phases hardly turn. Derived: the highest usable frequency turns by three degrees then.
TURNS = 0.02
#: Time constants of a drive's lag, in samples.
LAGS = np.linspace(0.2, 40.2, 41)
#: Corner frequencies of a sensor's high-pass, in multiples of the rig's lowest mode.
CORNERS_BELOW = np.linspace(0.01, 1.21, 41)
#: Those of a sensor's low-pass, as shares of the sample rate; refinements stay above zero.
CUTOFFS = np.linspace(0.02, 0.82, 81)
FINER, ROUNDS = 9, 2
#: Rocking: number of frequencies, and what its score is charged with.
ROCKERS, ROCKING_CHARGE = 60, 4
#: Share of an element's own force that must remain with rocking. Chosen: the torque contains that force, so that without its
#: resonance it is the force itself; a wrong mass or drive changes coefficients by less than half.
OWN = 0.3
#: Gauss-Newton steps with a mass: the samples' slow parts were found with the given one.
LOADED = 4
#: Residual from which an equation is explained where none is broken although a simulation misfits. Chosen: the median of sound
#: equations is 0.9.
HINTS = 1.3
#: Share of the excess residuals below which nothing is left to explain, and weight of each equation's own ratio (see `score_of`).
#: Chosen: disturbances of a few per cent of the signal are in every rig.
NEGLIGIBLE, MINOR = 0.03, 0.1


def _late(force: FloatArray, samples: float) -> FloatArray:
    time = np.arange(len(force))
    return np.asarray(np.interp(time + samples, time, force))


def _lagging(force: FloatArray, samples: float) -> FloatArray:
    # A search may look below zero, where nothing lags.
    return lagging(force, 1.0 / (2.0 * np.pi * samples), 1.0) if samples > 0.0 else force


#: How a drive acts otherwise than its record tells, by samples: the values of a search, and the force.
ACTING = {"delay": (LATE, _late), "lag": (LAGS, _lagging)}


@dataclass(frozen=True, kw_only=True, eq=False)
class Explanation:
    """A kind of cause at a place, and the residuals that remain with it."""

    #: As in the findings.
    kind: str
    place: str
    what: str  #: The shape or fault, e.g. "force over deflection" or "gain".
    score: float  #: How much it reduces the residuals (`score_of`).
    residuals: Mapping[str, float]  #: Residual of each equation with it, by name.
    values: Mapping[str, float]  #: What the regression gives: a gain, a frequency.
    source: str = ""  #: The other channel of a crosstalk.


@dataclass(frozen=True, kw_only=True)
class Ranking:
    """All explanations, best first, and the residuals of the equations without any."""

    residuals: Mapping[str, float]  #: Residual of each equation that counts over noise, by name: about one if it holds.
    explanations: tuple[Explanation, ...]  #: Best first.

    @property
    def worst(self) -> float:
        """The largest residual."""
        return max(self.residuals.values(), default=1.0)

    @property
    def broken(self) -> bool:
        """Whether any equation does not hold."""
        return self.worst >= HOLDS


@dataclass
class _Done:
    # The regressions of some equations so far: their number, and what they found.
    parts: int = 0
    found: list[Explanation] = field(default_factory=list)


class Regressions:
    """The regressions of every kind at every place.

    Parameters
    ----------
    on
        The equations.
    done
        Those that were done before; it is updated, so that an interrupted ranking is continued.
    """

    def __init__(self, on: Equations, done: _Done) -> None:
        self.on, self._done = on, done
        worst = max(on.residuals().values(), default=0.0)
        self.least = HOLDS if worst >= HOLDS else HINTS  # residual from which an equation is explained
        # What breaks an equation of measured motions is in it; an error of the model anywhere breaks those of estimated ones.
        measured = {name: value for name, value in on.residuals().items() if name not in on.with_estimates}
        counted = measured if max(measured.values(), default=0.0) >= HOLDS else on.residuals()
        self._counted = {name: value for name, value in counted.items() if on.only is None or on.contains(name, on.only)}
        self._balances = [balance for balance in on.balances if balance.name in self._counted]
        self._prepared = {name: item for name, item in on.prepared.items() if name in self._counted}
        self._sliding = {name: item for name, item in on.sliding.items() if name in self._counted}

    def ranked(self) -> Ranking:
        """Every kind at every place, best first. Raises OutOfTimeError when the time of the deadline in force has ended."""
        before, found = self._counted, self._done.found

        def add(
            kind: str, place: str, what: str, after: Mapping[str, float], charge: float, source: str = "", **values: float
        ) -> None:  # fmt: skip
            found.append(
                Explanation(
                    kind=kind, place=place, what=what, score=score_of(before, after) - PER_COEFFICIENT * charge,
                    residuals={**before, **after}, values=values, source=source,
                )
            )  # fmt: skip

        parts: list[Callable[[], None]] = [
            *(partial(self._shape, one, shape, add) for one in self._elements for shape in self._shapes(one, before)),
            *(partial(self._rarer, balance, add, before, found) for balance in self._balances),
            *(partial(self._body, body, add, before) for body in self.on.combos.measured if self.on.tested("body", body)),
            partial(self._rocking, add), partial(self._locks, add), *self._sensors(add, before),
        ]  # fmt: skip
        for part in parts[self._done.parts :]:
            ask_time()
            part()
            self._done.parts += 1
        return Ranking(residuals=before, explanations=tuple(sorted(found, key=lambda item: -item.score)))

    @property
    def _elements(self) -> list[Element]:
        # Those at which causes are tested.
        return [one for one in self.on.elements() if self.on.tested("link", one.name)]

    def _shapes(self, element: Element, before: Mapping[str, float]) -> list[Shape]:
        rubbing = element.contact is not None
        mine = [balance.name for balance in self._balances if balance.contains(element)]
        if all(before.get(name, 0.0) < self.least for name in mine) and not any(
            lock.element.name == element.name and before[name] >= self.least for name, lock in self.on.stuck.items()
        ):
            return []
        # A contact's friction replaces the plain one; without a contact there is only the plain one and what it may become.
        left_out = {DRY_FRICTION.name} if rubbing else {s.name for s in SHAPES if s.with_friction and s.name != "slip"}
        left_out |= {s.name for s in SHAPES if s.kind == "drift" and not self.on.timed}
        if element.link is not None and not damps(self.on.model, element.link):
            left_out |= {s.name for s in SHAPES if s.kind == "damping_shape"}
        return [shape for shape in SHAPES if shape.name not in left_out]

    def _shape(self, element: Element, shape: Shape, add: _Add, **values: float) -> None:
        after: dict[str, float] = {}
        for balance in self._balances:
            if not balance.contains(element):
                continue
            if balance.name in self._prepared and shape.name == "relaxation":
                after[balance.name] = self._relaxed(balance, element)
            elif balance.name in self._prepared:
                after[balance.name] = self._bent(balance, element, shape)
            elif balance.name in self._sliding and self.on.primary(balance).name == element.name:
                sliding, base = self._sliding[balance.name]
                fitted = self.on.slid(element, sliding, base, shape, self.on.own_frequency(element, balance))
                passive = shape.name != "relaxation" or dissipates(fitted.values[len(base.values) :])
                after[balance.name] = sliding.residual(fitted, base) if passive else sliding.residual(base)
            elif balance.name in self._sliding and (found := self.on.in_time(balance, element)) is not None:
                excess = self._counted[balance.name] - 1.0
                after[balance.name] = 1.0 + excess * self._reduced(balance, element, shape, *found)
        if shape.name == "slip":
            for name, lock in self.on.stuck.items():
                if lock.element.name == element.name:
                    after[name], _ = self._elastic(lock, name)
        if after:
            add(shape.kind, element.name, shape.name, after, float(shape.charge), "", **values)

    def _rarer(self, balance: Balance, add: _Add, before: Mapping[str, float], found: Sequence[Explanation]) -> None:
        # In an equation that no other shape repairs, what a smooth curve does not follow: a stop that is reached a few times, and
        # a force that repeats with the position in more than a few periods.
        whole = before.get(balance.name, 0.0)  # none where nothing of it remains to be tested
        if whole < self.least or min((item.residuals[balance.name] for item in found), default=whole) < self.least:
            return
        for element in (element for element in self._elements if balance.contains(element)):
            if all((item.place, item.what) != (element.name, RARE_STOP.name) for item in found):
                self._shape(element, RARE_STOP, add)
            in_time = self.on.in_time(balance, element)
            if in_time is not None:
                pitch = pitch_of(*in_time, self.on.base_columns(element))
                if pitch is not None:
                    self._shape(element, periodic(pitch), add, pitch=pitch)

    def _bent(self, balance: Balance, element: Element, shape: Shape) -> float:
        # Residual of an equation without friction with a shape. The time domain is better where the slow part of an integrated
        # deflection shifts a curve over it, where rare events count, and for friction, which holds while the element slides:
        # there the ratio of the residuals counts. Rigs that are moved and rest have few segments that tell, except a decay.
        before = self._prepared[balance.name].solved.residual
        moved = self.on.in_time(balance, element, sliding=True)
        if moved is not None and moved[0].rests and not self.on.spectra.largest_at_start:
            return before * self.on.in_motion(balance, element, shape)
        left = self.on.shaped(balance, element, shape).residual
        if left <= self.least or before < self.least:
            return left
        if shape.name in (DRY_FRICTION.name, PERIODIC):
            return min(left, before * self.on.in_motion(balance, element, shape))
        found = self.on.in_time(balance, element)
        if found is None or found[0].residual(found[1]) < HINTS:
            return left
        return min(left, before * self._reduced(balance, element, shape, *found))

    def _reduced(self, balance: Balance, element: Element, shape: Shape, sliding: Sliding, base: SlidingFit) -> float:
        # The ratio by which a shape reduces what an equation leaves in the time domain.
        fitted = self.on.slid(element, sliding, base, shape, self.on.own_frequency(element, balance))
        return (sliding.residual(fitted, base) - 1.0) / (sliding.residual(base) - 1.0)

    def _relaxed(self, balance: Balance, element: Element) -> float:
        # Residual with one relaxation of positive stiffness.
        prepared = self._prepared[balance.name]
        sign = next(s for e, s in balance.crossing if e.name == element.name)
        row = {name: sign * weight for name, weight in self.on.motion_row(element.weights, 0).items()}
        ratio = np.asarray(1j * self.on.spectra.frequency / self.on.own_frequency(element, balance), dtype=np.complex128)
        scans = prepared.scan(row, np.stack([relaxing(ratio, corner) for corner in CORNERS]))
        after, _, _ = _joint({balance.name: scans}, {balance.name}, 0.0)
        return after.get(balance.name, prepared.solved.residual)

    def _body(self, body: str, add: _Add, before: Mapping[str, float]) -> None:
        band = self.on.spectra.frequency
        frequencies = np.geomspace(LEAST_ABOVE * band[0], HIGHEST * band[-1], RESONATORS)
        if body in self.on.model.imposed or body in self.on.hidden:
            return
        row, mass = self.on.body_row(body), self.on.model.body(body).mass
        inside = [b for b in self._balances if b.weights.get(body) == 1.0]
        if all(before.get(b.name, 0.0) < self.least for b in inside):
            return
        inside = sorted(inside, key=self.on.unknown_scale)
        spectral = {b.name: self._prepared[b.name] for b in inside if b.name in self._prepared}
        slid = {b.name: self._sliding[b.name] for b in inside if b.name in self._sliding}
        # Where this inertia is all that is known, its mass is only the scale.
        scaled = {b.name for b in inside if self.on.scales(b)}
        if f"bodies.{body}.mass" not in self.on.model.free:
            one = np.ones((1, len(band)), dtype=complex)
            scans = {name: item.scan(row, one)[0] for name, item in spectral.items()}
            after, change = self._shared(scans, slid, {n: self._time_row(n, row) for n in slid}, scaled, -0.9 * mass)
            # An equation whose scale is this mass alone grows with it, and so does the noise in it.
            grown = (1.0 + change / mass) ** 2
            after = {name: value if name in scaled else value / grown for name, value in after.items()}
            if after:
                add("known_value", body, "mass", after, 1, mass=mass + change)
        frequency, damping = self._fitted_mode(spectral, slid, row, scaled, frequencies)
        narrow = spectral and damping * frequency < NARROW * self.on.rate / self.on.length
        if narrow:
            frequency, damping = self._narrow_mode(spectral, row, frequency, damping)
        gain = resonator(self.on.spectra.omega, frequency, damping)[None]
        of_filter = {name: item.scan(row, gain) for name, item in spectral.items()}
        signals = {name: self._time_row(name, row, (frequency, damping)) for name in slid}
        if scaled:
            after, added = self._shared({n: scan[0] for n, scan in of_filter.items()}, slid, signals, scaled, 0.0)
        else:
            after, added, _ = _attached(of_filter, scaled)
            for name, pair in slid.items():
                after[name], added = self._linear(self.on.primary(self.on.balance_of(name)), *pair, [signals[name]])
        if narrow:
            exact, inertia = self._ringing(spectral, self._base_spectra(row), (frequency, damping))
            if inertia > 0.0:
                after, added = after | exact, inertia
        if after:
            add("added_motion", body, "resonator", after, 3, frequency=frequency, damping=damping, mass=added)

    def _fitted_mode(
        self, spectral: Mapping[str, Prepared], slid: Mapping[str, tuple[Sliding, SlidingFit]], row: Row,
        scaled: Collection[str], frequencies: FloatArray,
    ) -> tuple[float, float]:  # fmt: skip
        # Frequency and damping ratio of the resonator at a body that leaves least.
        if not spectral:
            return self._scanned(slid, row, frequencies)
        omega = self.on.spectra.omega
        coarse = np.stack([resonator(omega, f, COARSE_DAMPING) for f in frequencies])
        best = frequencies[_attached({name: item.scan(row, coarse) for name, item in spectral.items()}, scaled)[2]]
        grid = [(float(best * u), z) for u in np.linspace(1.0 - WITHIN, 1.0 + WITHIN, CLOSER) for z in FINE_DAMPING]
        fine = np.stack([resonator(omega, f, z) for f, z in grid])
        return grid[_attached({name: item.scan(row, fine) for name, item in spectral.items()}, scaled)[2]]

    def _narrow_mode(self, spectral: Mapping[str, Prepared], row: Row, frequency: float, damping: float) -> tuple[float, float]:
        from scipy.optimize import minimize

        bases = self._base_spectra(row)

        def left(place: FloatArray) -> float:
            if place[1] > np.log(NARROW * self.on.rate / self.on.length / (damping * frequency)):
                return np.inf  # no longer narrow
            after, _ = self._ringing(spectral, bases, (frequency * float(np.exp(place[0])), damping * float(np.exp(place[1]))))
            return float(sum(np.log10(max(value, 1.0)) for value in after.values()))

        start = np.array([[0.0, 0.0], [WITHIN, 0.0], [0.0, 0.7]])
        done = minimize(left, start[0], method="Nelder-Mead", options={"initial_simplex": start, "maxfev": RINGING})
        return frequency * float(np.exp(done.x[0])), damping * float(np.exp(done.x[1]))

    def _base_spectra(self, row: Row) -> dict[int, tuple[ComplexArray, int]]:
        # Spectrum and number of samples of a body's acceleration in each run.
        motions = {r.index: self.on.combined(s, row) for r, s in zip(self.on.records, self.on.signals, strict=True)}
        return {run: (np.asarray(np.fft.rfft(values)), len(values)) for run, values in motions.items()}

    def _ringing(
        self, spectral: Mapping[str, Prepared], bases: Mapping[int, tuple[ComplexArray, int]], mode: tuple[float, float]
    ) -> tuple[dict[str, float], float]:  # fmt: skip
        # Residuals with a resonator that rings longer than a segment, filtered over whole runs, and its mass.
        columns = {
            run: self.on.spectra.segments(filtered(spectrum, n, self.on.rate, mode), run)[None]
            for run, (spectrum, n) in bases.items()
        }
        solved = {
            name: item.shaped({run: columns[run] for run in item.weights}, held_out=False) for name, item in spectral.items()
        }
        return {name: one.residual for name, one in solved.items()}, float(next(iter(solved.values())).values[-1])

    def _shared(
        self, scans: Mapping[str, FloatArray], slid: Mapping[str, tuple[Sliding, SlidingFit]],
        signals: Mapping[str, Mapping[int, FloatArray]], scaled: Collection[str], least: float,
    ) -> tuple[dict[str, float], float]:  # fmt: skip
        """Residuals with one coefficient, above `least`, common to equations in both domains, and that coefficient.

        The scans are parabolas over the coefficient by equation, shape (3,), and the signals have it as their factor in the
        sliding equations; the `scaled` equations determine it.
        """
        values = [_joint({name: scan[None] for name, scan in scans.items()}, scaled, least)[1]]
        values += [
            self._linear(self.on.primary(self.on.balance_of(name)), *pair, [signals[name]])[1]
            for name, pair in slid.items()
            if name in scaled
        ]
        best: tuple[float, dict[str, float], float] = (np.inf, {}, 0.0)
        for value in (value for value in values if value > least and value != 0.0):
            after = {name: float(scan @ (1.0, value, value**2)) for name, scan in scans.items()}
            for name, (sliding, base) in slid.items():
                after[name] = self._loaded(self.on.primary(self.on.balance_of(name)), sliding, base, signals[name], value)
            total = float(sum(np.log10(max(left, 1.0)) for left in after.values()))
            best = min(best, (total, after, value), key=lambda item: item[0])
        return best[1:]

    def _loaded(
        self, element: Element, sliding: Sliding, base: SlidingFit, signal: Mapping[int, FloatArray], value: float
    ) -> float:  # fmt: skip
        # Residual of a sliding equation with a further known force.
        state, columns = sliding.state(), self.on.base_columns(element)
        forces = {run.run: value * shortly_low_passed(signal[run.run], sliding.rate, self.on.edge) for run in sliding.runs}
        for run in sliding.runs:
            run.force -= forces[run.run]
        fitted = sliding.fit(columns, base.values, LOADED)
        sliding.restore(state)
        for run in sliding.runs:
            run.force += forces[run.run]
        return sliding.residual(fitted, base)

    def _scanned(self, slid: Mapping[str, tuple[Sliding, SlidingFit]], row: Row, frequencies: FloatArray) -> tuple[float, float]:
        best = (np.inf, float(frequencies[0]))
        for f in frequencies[:: max(1, RESONATORS // 24)]:
            total = sum(
                np.log10(
                    self._linear(
                        self.on.primary(self.on.balance_of(name)), sliding, base, [self._time_row(name, row, (f, COARSE_DAMPING))]
                    )[0]
                )
                for name, (sliding, base) in slid.items()
            )
            best = min(best, (float(total), float(f)))
        return best[1], COARSE_DAMPING

    def _time_row(self, name: str, row: Row, mode: tuple[float, float] | None = None) -> dict[int, FloatArray]:
        # A row as a signal of each run of a sliding equation, with the sign of its force, through a resonator.
        balance = self.on.balance_of(name)
        sign = next(s for e, s in balance.crossing if e.contact is not None)
        found = {}
        for record, signals in zip(self.on.records, self.on.signals, strict=True):
            if any(run.run == record.index for run in self._sliding[name][0].runs):
                values = np.sign(sign) * self.on.combined(signals, row)
                if mode is not None:
                    values = filtered(np.asarray(np.fft.rfft(values)), len(values), self.on.rate, mode)
                found[record.index] = self.on.thinned(values)
        return found

    def _linear(
        self, element: Element, sliding: Sliding, base: SlidingFit, signals: Sequence[Mapping[int, FloatArray]], own: float = 0.0
    ) -> tuple[float, float]:
        # Residual with further known signals with unknown factors, and the first factor; as before where less than the share
        # `own` of the element's own force would remain.
        fitted = self._with_signals(element, sliding, base, signals)
        if own and sliding.share_kept(self.on.base_columns(element), base.values, fitted.values[: len(base.values)]) < own:
            return sliding.residual(base), 0.0
        return sliding.residual(fitted, base), float(fitted.values[len(base.values)])

    def _with_signals(
        self, element: Element, sliding: Sliding, base: SlidingFit, signals: Sequence[Mapping[int, FloatArray]]
    ) -> SlidingFit:  # fmt: skip
        # A sliding equation with further known signals, whose factors follow its own coefficients.
        state, plain = sliding.state(), self.on.base_columns(element)

        def columns(d: FloatArray, v: FloatArray, run: SlidingRun, place: IntArray) -> FloatArray:
            return np.column_stack([plain(d, v, run, place), *(signal[run.run][place] for signal in signals)])

        fitted = sliding.fit(columns, np.concatenate([base.values, np.zeros(len(signals))]), 1)
        sliding.restore(state)
        return fitted

    def _rocking(self, add: _Add) -> None:
        # A body that the drive pushes and that a lock can hold rocks while it is free, and not while it is locked.
        drive = self.on.model.drive
        blocked = {name for setup in self.on.model.configurations.values() for name in setup.rigid}
        key = (drive.channel, -1)
        if key not in self.on.spectra.index:
            return
        for pushed in (body for body in drive.pushes if self.on.tested("body", body)):
            links = {link.name for link in self.on.model.links if link.name in blocked and pushed in (link.a, link.b)}
            if not links:
                continue
            free = [n for n, setup in self.on.model.configurations.items() if not links & set(setup.rigid)]
            inside = [b for b in self._balances if pushed in b.bodies]
            loose = [r.index for r in self.on.records if r.configuration in free]
            parts: dict[str, tuple[Prepared, float, int, int]] = {}
            for balance in inside:
                if balance.name not in self._prepared:
                    continue
                whole = self._prepared[balance.name]
                mine = [run for run in whole.runs if run in loose]
                others = [run for run in whole.runs if run not in loose]
                if not mine:
                    continue
                rows, _ = self.on.rows(balance)
                apart = Prepared(self.on.spectra, rows, mine, whole.solved.values, rounds=1)
                rest = Prepared(self.on.spectra, rows, others, whole.solved.values, rounds=1).solved.residual if others else 0.0
                parts[balance.name] = apart, rest, len(mine), len(others)
            if not parts:
                continue
            band = self.on.spectra.frequency
            frequencies = np.geomspace(2.0 * self.on.lowest, min(12.0 * self.on.lowest, 0.5 * band[-1]), ROCKERS)
            gains = np.stack([-rocker(self.on.spectra.omega, f) for f in frequencies])
            # The drive and the link's force make it rock: the latter is that of the drive less the inertia.
            driving = [{key: 1.0}, self.on.body_row(pushed)]
            scans = {name: part[0].least(driving, gains) for name, part in parts.items()}
            k = int(np.argmin(sum(np.log10(np.maximum(r, 1.0)) for r in scans.values())))
            if k in (0, ROCKERS - 1):
                continue  # at the end of the grid it is a mass or a spring
            # Both make one torque: in the shares that the equation shows in which most is left.
            apart = max((part[0] for part in parts.values()), key=lambda item: item.solved.residual)
            shares = apart.solve([{n: gains[k] * w for n, w in row.items()} for row in driving]).values[-len(driving) :]
            torque: dict[tuple[str, int], complex | ComplexArray] = {}
            for share, row in zip(shares, driving, strict=True):
                torque |= {name: float(share) * weight for name, weight in row.items()}
            after = {}
            for name, (apart, rest, mine_count, other_count) in parts.items():
                total = self._prepared[name].solved.residual
                old = apart.solved.residual * mine_count + rest * other_count
                new = float(scans[name][k]) * mine_count + rest * other_count
                after[name] = new * total / max(old, 1e-9)
            for balance in inside:
                if balance.name in self._sliding:
                    sliding, base = self._sliding[balance.name]
                    after[balance.name], _ = self._linear(
                        self.on.primary(balance), sliding, base, self._rocked(balance, torque, float(frequencies[k])), OWN
                    )
            add("added_motion", pushed, "rocking", after, ROCKING_CHARGE, frequency=float(frequencies[k]))

    def _rocked(self, balance: Balance, torque: Row, frequency: float) -> list[dict[int, FloatArray]]:
        found: list[dict[int, FloatArray]] = [{}, {}, {}]
        for record, signals in zip(self.on.records, self.on.signals, strict=True):
            if any(run.run == record.index for run in self._sliding[balance.name][0].runs):
                moved = rocked(self.on.combined(signals, torque), self.on.rate, frequency)
                for part, values in zip(found, moved, strict=True):
                    part[record.index] = self.on.thinned(values)
        return found

    def _locks(self, add: _Add) -> None:
        for lock in self.on.locks:
            if lock.beyond is not None and lock.name in self._prepared:
                residual, stiffness = self._elastic(lock, lock.name)
                add("added_motion", "lock", "elastic lock", {lock.name: residual}, 2, stiffness=stiffness)

    def _elastic(self, lock: Lock, name: str) -> tuple[float, float]:
        # Residual of a lock's equation if its ends differ by its force over a stiffness with damping, and that stiffness.
        beyond = lock.beyond
        assert beyond is not None
        prepared, sign = self._prepared[name], beyond.crossing[0][1]
        force = self.on.force_row(beyond)
        for body in self.on.unknown_masses(beyond):
            force = dict(force)
            for key, weight in self.on.body_row(body).items():
                force[key] = force.get(key, 0.0) - self.on.model.body(body).mass * weight
        mass = sum(self.on.model.body(body).mass for body in beyond.bodies) or 1.0
        base = mass * (2.0 * np.pi * self.on.lowest) ** 2
        row = self.on.motion_row(lock.element.weights, 2)
        best = (np.inf, 0.0)
        for ratio in LOCK_RATIOS:
            for relax in LOCK_TIMES:
                stiffness = base * ratio
                # d = force / (k + j w c), so its second derivative is -w^2 of that.
                give = self.on.spectra.omega**2 / (stiffness * (1.0 + 1j * self.on.spectra.omega * relax)) / sign
                changed: dict[tuple[str, int], complex | ComplexArray] = dict(row)
                for key, weight in force.items():
                    changed[key] = changed.get(key, 0.0) + give * weight
                matrix = self.on.spectra.matrix([changed])
                total = np.real(np.einsum("fi,fij,fj->", matrix[:, 0].conj(), prepared.power, matrix[:, 0], optimize=True))
                best = min(best, (float(total), float(stiffness)))
        return best

    def _sensors(self, add: _Add, before: Mapping[str, float]) -> Iterator[Callable[[], None]]:
        # The regressions of each channel's faults.
        orders = self.on.combos.orders
        channels = [c for c in self.on.model.channels if c in orders or (c, -1) in self.on.spectra.index]
        for channel in channels:
            if not (self.on.tested("sensor", channel) or self.on.tested("drive", channel)):
                continue
            inside = {
                name: item for name, item in self._prepared.items() if any(key[0] == channel for row in item.rows for key in row)
            }
            slid = {name: pair for name, pair in self._sliding.items() if self.on.contains(name, CausePlace("sensor", channel))}
            # A fault of a channel breaks all equations that contain it.
            seen = [before[name] for name in inside] or [before[name] for name in slid]
            if all(value < self.least for value in seen):
                continue
            yield partial(self._linear_faults, add, channel, inside, slid, before)
            errors = ERRORS if channel in orders else DRIVE_ERRORS if channel == self.on.model.drive.channel else {}
            for what, error in errors.items():
                yield partial(self._nonlinear_fault, add, channel, what, error, inside, slid)

    def _nonlinear_fault(
        self, add: _Add, channel: str, what: str, error: Callable[[FloatArray, float, float], list[FloatArray]],
        inside: Mapping[str, Prepared], slid: Mapping[str, tuple[Sliding, SlidingFit]],
    ) -> None:  # fmt: skip
        of_runs = self._errors(channel, error)
        if count := max(map(len, of_runs)):
            add("sensor", channel, what, self._erring(channel, of_runs, inside, slid), count)

    def _linear_faults(
        self, add: _Add, channel: str, inside: Mapping[str, Prepared], slid: Mapping[str, tuple[Sliding, SlidingFit]],
        before: Mapping[str, float],
    ) -> None:  # fmt: skip
        # Gains, delays, filters and crosstalk of a channel.
        orders = self.on.combos.orders
        sources = [c for c in orders if c != channel and c in self.on.model.channels] if channel in orders else []
        # A drive acts later than its record tells; with one sensor that is the sensor's delay.
        alone, drives = len(self.on.model.sensors) == 1, channel == self.on.model.drive.channel
        delays = ((DELAYS if alone else LATE) if drives else (-LATE[::-1] if alone else DELAYS)) / self.on.rate
        faults: list[tuple[str, FloatArray, str | None]] = [("gain", GAINS, None), ("delay", delays, None)]
        if channel == self.on.model.drive.channel and "drive.factor" in self.on.model.free:
            faults = faults[1:]
        if drives and channel not in orders:
            faults.append(("lag", LAGS / self.on.rate, None))
        if channel in orders:
            faults.append(("high-pass", CORNERS_BELOW * self.on.lowest, None))
            if inside:  # moment by moment it acts as a delay
                faults.append(("low-pass", CUTOFFS * self.on.rate, None))
        faults += [("crosstalk", SHARES, source) for source in sources]
        for what, values, source in faults:
            best, value, after = -np.inf, 0.0, {}
            grid, step = values, float(values[1] - values[0])
            for _ in range(ROUNDS + 1):
                added, gains = self.on.fault(what, channel, grid, source)
                left = {name: [one.residual for one in item.without_fault(added, gains)] for name, item in inside.items()}
                for k, trial in enumerate(grid):
                    found = {name: residuals[k] for name, residuals in left.items()}
                    score = sum(np.log10(max(before[name], 1.0) / max(r, 1.0)) for name, r in found.items())
                    if score > best:
                        best, value, after = score, float(trial), found
                if not inside:
                    break
                grid, step = np.linspace(value - step, value + step, FINER), step / 4.0
            after = dict(after)
            for name in slid:
                after[name], fault = self._sliding_fault(name, what, channel, source, alone=not inside)
                value = value if inside else fault
            least = LATE[0] / self.on.rate if what == "delay" and not inside else values[0]
            if not least < value < values[-1]:
                continue  # at the end of the grid, or beyond, it is no optimum
            if after:
                add("sensor", channel, what, after, 1, source or "", value=value)

    def _sliding_fault(self, name: str, what: str, channel: str, source: str | None, *, alone: bool) -> tuple[float, float]:
        # Residual of a sliding equation with a fault of a channel, and its value; `alone` if no other equation contains it.
        sliding, base = self._sliding[name]
        if what in ACTING and channel not in self.on.combos.orders and alone and not sliding.integrated:
            return self._acting(name, channel, *ACTING[what])
        element = self.on.primary(self.on.balance_of(name))
        fitted = self._with_signals(element, sliding, base, [self._faulty(name, what, channel, source, base)])
        count = len(base.values)
        residual, value = sliding.residual(fitted, base), float(fitted.values[count])
        for _ in range(ROUNDS):
            size = value * self.on.rate if what == "lag" else abs(value) * self.on.rate
            if what not in ACTING or not TURNS < size < np.max(np.abs(ACTING[what][0])):
                break
            # It turns phases, and biases the other coefficients: the error of this size with these, not that of a small one.
            known = replace(base, values=fitted.values[:count])
            fitted = self._with_signals(element, sliding, known, [self._faulty(name, what, channel, source, known, value)])
            residual, value = min((residual, value), (sliding.residual(fitted, base), value * float(fitted.values[count])))
        if what != "gain":
            return residual, value
        gain = 1.0 / (1.0 + value)  # a record that is true (1 + error) has true values that are less by the error
        # Where that record alone sets the scale of an equation, zero solves it.
        return residual if GAINS[0] < gain < GAINS[-1] else sliding.residual(base), gain

    def _acting(self, name: str, channel: str, samples: FloatArray, acts: Callable[..., FloatArray]) -> tuple[float, float]:
        # Residual of a sliding equation with a drive that acts otherwise than its record tells, and by how much in s: a command
        # changes at once, so its derivative does not tell.
        sliding, base = self._sliding[name]
        balance = self.on.balance_of(name)
        element, sign = next((e, s) for e, s in balance.crossing if e.contact is not None)
        weight = float(np.sign(sign) * np.real(self.on.force_row(balance)[channel, -1]))
        best = (np.inf, 0.0)
        grid, step = samples / self.on.rate, float(samples[1] - samples[0]) / self.on.rate
        for _ in range(ROUNDS + 1):
            for value in grid:
                shifts = {}
                for record, signals in zip(self.on.records, self.on.signals, strict=True):
                    force = weight * signals[channel, -1]
                    shifts[record.index] = self.on.thinned(acts(force, value * self.on.rate) - force)
                best = min(best, (self._loaded(element, sliding, base, shifts, -1.0), float(value)))
            grid, step = np.linspace(best[1] - step, best[1] + step, FINER), step / 4.0
        return best

    def _errors(
        self, channel: str, errors: Callable[[FloatArray, float, float], list[FloatArray]]
    ) -> list[list[Mapping[int, FloatArray]]]:  # fmt: skip
        # The errors of a channel's record in each run, by derivative; zero where a run has none.
        order = self.on.combos.orders.get(channel, -1)
        peak = max(float(np.abs(signals[channel, order]).max()) for signals in self.on.signals) or 1.0
        found = [errors(signals[channel, order], peak, self.on.rate) for signals in self.on.signals]
        count = max(map(len, found))

        def by_order(values: FloatArray) -> Mapping[int, FloatArray]:
            moves = order >= 0
            return derivatives(values, order, self.on.rate, CUT * self.on.lowest, np.inf).orders if moves else {order: values}

        return [
            [by_order(values) for values in own or [np.zeros(len(signals[channel, order]))] * count]
            for own, signals in zip(found, self.on.signals, strict=True)
        ]

    def _erring(
        self, channel: str, errors: Sequence[Sequence[Mapping[int, FloatArray]]], inside: Mapping[str, Prepared],
        slid: Mapping[str, tuple[Sliding, SlidingFit]],
    ) -> dict[str, float]:  # fmt: skip
        # Residuals with errors of a channel's record, each with an unknown factor; as before where these cancel the record, so
        # that hardly a share `OWN` of the equation's own terms would remain.
        after: dict[str, float] = {}
        for name, item in inside.items():
            columns = {
                record.index: np.stack(
                    [
                        self.on.spectra.segments(self._error(item.rows, item.solved.values, channel, error), record.index)
                        for error in own
                    ]
                )
                for record, own in zip(self.on.records, errors, strict=True)
                if record.index in item.weights
            }
            found = item.shaped(columns)
            after[name] = found.residual if item.share_kept(found.values) >= OWN else item.solved.residual
        for name, (sliding, base) in slid.items():
            rows, values, way = self._signed_rows(name, base)
            signals = [
                {
                    record.index: self.on.thinned(way * self._error(rows, values, channel, own[k]))
                    for record, own in zip(self.on.records, errors, strict=True)
                }
                for k in range(len(errors[0]))
            ]
            after[name], _ = self._linear(self.on.primary(self.on.balance_of(name)), sliding, base, signals, OWN)
        return after

    @staticmethod
    def _error(rows: Sequence[Row], values: FloatArray, channel: str, found: Mapping[int, FloatArray]) -> FloatArray:
        # What an equation leaves if a channel's error is `found` (by derivative); the known row first.
        total = np.zeros(len(next(iter(found.values()))))
        for row, factor in zip(rows, [1.0, *(-values)], strict=True):
            for (other, order), weight in row.items():
                if other == channel:
                    total += factor * float(np.real(weight)) * found[order]  # type: ignore[arg-type]
        return total

    def _signed_rows(self, name: str, base: SlidingFit) -> tuple[list[Row], FloatArray, float]:
        # The known row of a sliding equation, its other rows with their coefficients, and the sign of the force.
        balance = self.on.balance_of(name)
        element, sign = next((e, s) for e, s in balance.crossing if e.contact is not None)
        way = float(np.sign(sign))
        fixed = [row for _, row in self.on.fixed_rows(balance, element)]
        rows = [self.on.force_row(balance), *(self.on.motion_row(element.weights, order) for order in (0, 1)), *fixed]
        own = 3 + law_columns(element)
        return rows, np.concatenate([way * base.values[:2], base.values[own : own + len(fixed)]]), way

    def _faulty(
        self, name: str, what: str, channel: str, source: str | None, base: SlidingFit, value: float = 0.0
    ) -> dict[int, FloatArray]:  # fmt: skip
        # The change of a sliding equation by a fault of a channel, as a signal of each run: by one of a `value`, or its
        # derivative with respect to the fault.
        rows, values, way = self._signed_rows(name, base)
        found = {}
        for record, signals in zip(self.on.records, self.on.signals, strict=True):
            if not any(run.run == record.index for run in self._sliding[name][0].runs):
                continue
            errors = {}
            for order in (-1, 0, 1, 2):
                own = signals.get((channel, order))
                if own is None:
                    continue
                error = signals[source, order] if source is not None and order >= 0 else own
                if value:
                    error = error - ACTING[what][1](error, value * self.on.rate)
                elif what in ("delay", "low-pass", "lag"):
                    error = derivative(error, self.on.rate) * (-1.0 if what == "delay" else 1.0)
                elif what == "high-pass":
                    error = derivatives(error, 1, self.on.rate, CUT * self.on.lowest, np.inf).orders[0]
                errors[order] = error
            total = way * self._error(rows, values, channel, errors)
            found[record.index] = self.on.thinned(total)
        return found


def share_left(before: Mapping[str, float], after: Mapping[str, float]) -> float | None:
    """Share of the excess residuals, summed over equations, that remains; None without an excess."""
    whole = sum(max(value, 1.0) - 1.0 for value in before.values())
    left = sum(max(after.get(name, value), 1.0) - 1.0 for name, value in before.items())
    return left / whole if whole > 0.0 else None


def removed(before: Mapping[str, float], after: Mapping[str, float]) -> float:
    """Share of the excess residuals, summed over equations, that goes; 0 without an excess."""
    left = share_left(before, after)
    return 0.0 if left is None else 1.0 - left


def score_of(before: Mapping[str, float], after: Mapping[str, float]) -> float:
    """How much an explanation reduces the residuals of the equations.

    Minus log10 of the share of the excess residuals, summed over equations, that remains, and `MINOR` times the sum over
    equations of log10 of the ratio by which it reduces their residuals: a cause must explain what is largest, since small
    imperfections of a rig may have many causes; of two that do, the one that also repairs small residuals is better.
    """
    left = share_left(before, after)
    if left is None:
        return 0.0
    # A regression without samples to check it leaves an infinite residual.
    ratios = sum(np.log10(max(before[name], 1.0)) - np.log10(max(value, 1.0)) for name, value in after.items())
    return float(-np.log10(max(left, NEGLIGIBLE)) + MINOR * ratios)


def _joint(scans: Mapping[str, FloatArray], scaled: Collection[str], least: float) -> tuple[dict[str, float], float, int]:
    """Residuals with one coefficient, above `least`, common to several equations, that coefficient, and the best filter.

    The scans are parabolas over the coefficient by equation, shape (filters, 3); the `scaled` equations determine it.
    """
    best: tuple[float, dict[str, float], float, int] = (np.inf, {}, 0.0, 0)
    givers = [name for name in scans if name in scaled]
    for k in range(len(next(iter(scans.values()))) if givers else 0):
        for giver in givers:
            _, slope, bend = scans[giver][k]
            if bend < 1e-300:  # it does not change this equation
                continue
            value = -slope / (2.0 * bend)
            if value <= least:
                continue
            residuals = {name: float(scan[k] @ (1.0, value, value**2)) for name, scan in scans.items()}
            total = float(sum(np.log10(max(r, 1.0)) for r in residuals.values()))
            if total < best[0]:
                best = total, residuals, float(value), k
    return best[1:]


def _attached(scans: Mapping[str, FloatArray], scaled: Collection[str]) -> tuple[dict[str, float], float, int]:
    """Residuals with an attached resonator, its mass and the best filter (as `_joint`).

    Where no equation has a known scale, each one has a coefficient of its own; the mass is that of the first.
    """
    if any(name in scaled for name in scans):
        return _joint(scans, scaled, 0.0)
    found = {}
    masses: FloatArray | None = None
    for name, scan in scans.items():
        values = np.maximum(-scan[:, 1] / np.maximum(2.0 * scan[:, 2], 1e-300), 0.0)
        found[name] = scan[:, 0] + scan[:, 1] * values + scan[:, 2] * values**2
        masses = values if masses is None else masses
    if masses is None:
        return {}, 0.0, 0
    k = int(np.argmin(sum(np.log10(np.maximum(left, 1.0)) for left in found.values())))
    return {name: float(left[k]) for name, left in found.items()}, float(masses[k]), k


_RANKED: WeakKeyDictionary[Equations, Ranking] = WeakKeyDictionary()
_BEGUN: WeakKeyDictionary[Equations, _Done] = WeakKeyDictionary()


def ranking(equations: Equations) -> Ranking:
    """Every kind of cause at every place, ranked by the residuals that it removes; the same equations are ranked once.

    Raises OutOfTimeError when the time of the deadline in force has ended; the next call continues.
    """
    if equations not in _RANKED:
        _RANKED[equations] = Regressions(equations, _BEGUN.setdefault(equations, _Done())).ranked()
        del _BEGUN[equations]
    return _RANKED[equations]


class _Add(Protocol):
    # The callback that lists an explanation.
    def __call__(
        self, kind: str, place: str, what: str, after: Mapping[str, float], charge: float, source: str = "", **values: float
    ) -> None: ...
