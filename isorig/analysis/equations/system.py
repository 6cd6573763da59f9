"""The equations of a campaign: the signals of all runs, each equation solved without any further cause."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from isorig.analysis.campaign import BROAD, Campaign, ComplexArray, FloatArray, IntArray, Run, usable_stop
from isorig.analysis.equations.balances import Balance, Element, Lock, balances, elements, is_measured, locks
from isorig.analysis.equations.columns import Course, Shape, direction_of
from isorig.analysis.equations.hidden import adjacent, estimable, estimated, fitted, transfer
from isorig.analysis.equations.known import law_columns, law_forces, law_of, true_records
from isorig.analysis.equations.motion import (
    Combinations,
    derivatives,
    estimate_of,
    without_slow_part,
)
from isorig.analysis.equations.sliding import (
    ROUNDS,
    TAPS,
    Columns,
    Sliding,
    SlidingFit,
    SlidingRun,
    direction_of_sliding,
    shortly_low_passed,
)
from isorig.analysis.equations.spectral import SHORTEST, Prepared, Row, Solved, Spectra
from isorig.analysis.fitting.preparation import zero_errors
from isorig.analysis.laws import Coulomb, FrictionLaw
from isorig.analysis.laws.base import NO_LINK
from isorig.analysis.lowpass import derivative_edge, fast_length, force_edge, low_passed
from isorig.analysis.model.linear import floats
from isorig.analysis.model.rig_model import GROUND, Link, RigModel
from isorig.analysis.rounding import is_command
from isorig.analysis.simulate.natural import lowest_mode
from isorig.analysis.simulate.sampling import as_held
from isorig.analysis.spectra.noise import noise_of_runs, rests

#: Periods of the lowest mode in a segment.
SEGMENT_PERIODS = 20.0
#: Lowest frequency of spectra, and below which integrals have no content, in multiples of the lowest mode.
LOWEST, CUT = 0.3, 0.1
#: Frequency up to which the slow part of an element's integrated deflection is fitted, at most, in multiples of the lowest mode;
#: otherwise `CUT` times the element's own: what its sensors' errors integrate to there exceeds the motion of a stiff element.
HIGHEST_CUT = 0.4
#: The same, in multiples of the element's own frequency, if the zero of one of its sensors wanders: its integral reaches up to
#: the motion. Chosen: with 0.2 to 0.4 simulated joints with such sensors showed their curve, with 0.1 they did not.
WANDERING_CUT = 0.3
#: Noise of an element's integrated deflection, as a share of its rms, above which its slow part is fitted up to a higher
#: frequency. Chosen: noise of a tenth makes a stiffness appear one per cent lower.
NOISY = 0.1
#: Ratio of the motion in an octave to that in the next one above from which it is an integrated error. Chosen: white errors of an
#: acceleration give 2.8, a spring's deflection by a force with a flat spectrum 0.7.
STEEP = 2.0
#: Share of it from which on all content is in the integral: the slow part that is fitted along bends little faster.
SURE = 0.5
#: Share of the signal's edge at which a record of displacements is cut before its second derivative.
EDGE = 1.0
#: Least number of periods in a run of the frequency up to which the slow force of other elements is fitted. Chosen: so few
#: unknowns leave a friction that reverses as often visible.
PERIODS_OF_CUT = 4.0
#: Seconds at both ends of a run that are left out where anything is integrated, in periods of the lowest mode.
ENDS = 2.5
#: Where the sensors show no motion at the lowest mode, their edge in multiples of the frequency that takes its place. Chosen: a
#: decade of motions remains, as around a mode.
SLOWER = 10.0
#: Index of dry friction in the columns of an equation in the time domain: after spring and damper.
FRICTION_COLUMN = 2
#: Samples per period of the edge: more repeat each other.
SAMPLES = 8.0
#: Sample rate in multiples of the corner frequency of the low-pass before it.
PASSED = 2.5
#: rms velocity of an element in a run, as a share of the largest, below which its contact sticks for the whole run.
STUCK = 0.06
#: Quantile of the force's magnitude in such a run that must stay below the friction.
HELD = 0.999
#: Faults of a channel that `Equations.fault` takes out.
CHANNEL_FAULTS = ("gain", "delay", "crosstalk", "high-pass", "low-pass", "lag")
#: Frequency bins from which the values behind estimated motions are fitted. Chosen: enough for ten times as many values.
FITTED_BINS = 100
#: Residual up to which an equation holds. Chosen: sound rigs with descriptions a quarter off stay below it.
HOLDS = 2.0


class CausePlace(NamedTuple):
    """A place in a rig, and what it is: a sensor is named by its channel, as is a drive."""

    kind: Literal["link", "body", "drive", "sensor"]
    name: str


@dataclass(kw_only=True)
class Record:
    """A run: its samples and noise by channel, the seconds since the campaign's start, and whether its drive is broad-band."""

    index: int
    configuration: str
    broad: bool
    start: float
    channels: dict[str, FloatArray]
    noise: dict[str, float]


def is_shaped(friction: FrictionLaw) -> bool:
    """Whether a friction depends on more than its direction: its column is then the law's own force."""
    return not isinstance(friction, Coulomb)


class Equations:
    """The equations of a campaign.

    Parameters
    ----------
    campaign
        The measurement.
    model
        The rig with its given or fitted values.
    noise
        Standard deviation of each channel's sensor noise in each run, by channel.
    wandering
        Channels of acceleration whose zero wanders.
    only
        The only place where causes are tested; None for all.
    like
        Equations of another model with whose residuals these are compared: they use the same frequencies and segments.
    """

    def __init__(
        self, campaign: Campaign, model: RigModel, noise: Sequence[Mapping[str, float]], wandering: Collection[str] = (),
        only: CausePlace | None = None, like: Equations | None = None,
    ) -> None:  # fmt: skip
        self.wandering, self.only = frozenset(wandering), only
        self.hidden = estimable(model) if only is None else ()
        self.model, self.combos = model, Combinations(model, self.hidden)
        self.imposing = {drive.channel for drive in model.drives if drive.imposes}
        # Where no spring holds a body, its position counts from the start of a run.
        self.counted = floats(model) and max(self.combos.orders.values(), default=0) < 2
        self.usable = min(run.usable for run in campaign.runs)
        self.rate = max((run.sample_rate for run in campaign.runs), default=1.0)
        self.records = [
            Record(
                index=k, configuration=run.configuration, broad=run.excitation in BROAD, start=campaign.seconds_since_start(run),
                channels=true_records(model, _read(run, model), run.sample_rate),
                noise={name: own.get(name, 0.0) for name in model.channels},
            )
            for k, (run, own) in enumerate(zip(campaign.runs, noise, strict=True))
            if run.sample_rate == self.rate
        ]  # fmt: skip
        # A drive that rests in all runs pushes nothing, and does not tell the size of any mass.
        silent = {
            drive.channel
            for drive in model.drives
            if all(rests(r.channels[drive.channel], r.noise[drive.channel]) for r in self.records)
        }
        self.balances = tuple(
            replace(balance, pushes={channel: weight for channel, weight in balance.pushes.items() if channel not in silent})
            for balance in balances(model, self.combos)
        )
        self.locks = locks(model, self.balances, self.combos)
        longest = max((len(next(iter(r.channels.values()))) for r in self.records), default=0)
        # In a decay a change in time is one with the amplitude, unless other runs begin later.
        self.timed = len(silent) < len(model.drives) or len({r.start for r in self.records}) > 1
        self.end = max((r.start + len(next(iter(r.channels.values()))) / self.rate for r in self.records), default=1.0)
        self._cuts: dict[tuple[str, str], float] = {} if like is None else {**like._cuts}
        self.lowest: float
        self.edge: float
        self.length: int
        self.lowest, self.edge, self.length = self._band(longest) if like is None else (like.lowest, like.edge, like.length)
        self.assumed = model
        self.every = max(1, int(self.rate / (SAMPLES * self.edge))) if np.isfinite(self.edge) else 1
        self._prepare()
        if self.hidden and self.prepared:
            self.assumed = fitted(model, adjacent(model, self.hidden), self._left)
            self._prepare()

    def _band(self, longest: int) -> tuple[float, float, int]:
        # The rig's lowest frequency, the one at which the equations are cut, and the samples of a segment.
        lowest, edge = lowest_frequency(self.model, longest / self.rate), float(np.inf)
        # Displacements carry no signal in the second derivative above some frequency: there equations are cut. An imposed speed
        # is not differentiated where no equation has the inertia of its body.
        weighed = {sensor.force_in for sensor in self.model.sensors}
        as_it_is = {
            channel for channel in self.imposing if f"drive.{channel}" not in weighed and self.combos.orders.get(channel) == 1
        }
        for channel, order in self.combos.orders.items():
            if order < 2 and channel in self.model.channels and channel not in as_it_is:
                moved = [r.channels[channel] for r in self.records if len(r.channels[channel]) > SHORTEST]
                found = derivative_edge(moved, self.rate, 2 - order)
                if np.isfinite(found):
                    edge = min(edge, EDGE * max(found, self._pushed_edge(channel, 2 - order)))
        if edge < lowest:  # a slow motion, as which the rig moves without any mode
            lowest = max(edge / SLOWER, 4.0 * self.rate / max(longest, 1))
        length = 2 ** round(np.log2(max(SEGMENT_PERIODS / lowest * self.rate, SHORTEST)))
        while length > SHORTEST and length > longest // 2:
            length //= 2
        return lowest, edge, min(length, longest)

    def _pushed_edge(self, channel: str, derivatives: int) -> float:
        # The `force_edge` of a motion that one recorded force causes alone, over all runs; 0 for any other channel.
        cause = self._force_on(channel)
        if cause is None:
            return 0.0
        force, factor, body = cause
        mass, records = self.model.body(body).mass, (r.channels for r in self.records if len(r.channels[channel]) > SHORTEST)
        return max((force_edge(factor * r[force], r[channel], self.rate, mass, derivatives) for r in records), default=0.0)

    def _force_on(self, channel: str) -> tuple[str, float, str] | None:
        # The channel of the force behind a recorded motion, its factor, and the body: the only drive pushes it alone, or imposes
        # the motion with a measured force.
        drive, sensors = self.model.drive, self.model.sensors
        if self.model.more_drives:
            return None
        if channel == drive.channel and drive.imposes:
            force = next((sensor.channel for sensor in sensors if sensor.force_in == f"drive.{channel}"), None)
            return (force, 1.0, drive.imposes) if force is not None else None
        sensor = next((sensor for sensor in sensors if sensor.channel == channel), None)
        if sensor is None or set(drive.pushes) != {sensor.body} or sensor.relative_to != GROUND or sensor.arms:
            return None
        return drive.channel, drive.factor * drive.pushes[sensor.body], sensor.body

    def _left(self, assumed: RigModel) -> float:
        # What the equations leave if the motion of bodies without sensors is that of a rig with these values.
        spectra = self.spectra
        seen = [body.name for body in self.model.bodies if body.name not in self.hidden]
        every = max(1, len(spectra.bins) // FITTED_BINS)
        omega = spectra.omega[::every]
        of_bodies, of_drives = transfer(assumed, self.hidden, seen, omega)
        correction = np.zeros((len(omega), len(spectra.names), len(spectra.names)), dtype=complex)
        correction[:, range(len(spectra.names)), range(len(spectra.names))] = 1.0
        rows = [self.body_row(body) for body in seen]
        for i, body in enumerate(self.hidden):
            for order in range(3):
                k = spectra.index[estimate_of(body), order]
                integral = (1j * omega) ** (order - 2)
                correction[:, k] = 0.0
                for j, row in enumerate(rows):
                    for name, weight in row.items():
                        correction[:, k, spectra.index[name]] += integral * of_bodies[:, i, j] * weight
                for channel, gain in of_drives.items():
                    correction[:, k, spectra.index[channel, -1]] += integral * gain[:, i]
        hidden = {estimate_of(body) for body in self.hidden}
        kept = [k for k, (name, _) in enumerate(spectra.names) if name not in hidden]
        estimates = [item for name, item in self.prepared.items() if name in self.with_estimates]
        solved = (item.solve(correction=correction[:, :, kept], kept=kept, every=every) for item in estimates)
        return float(sum(np.log(max(each.residual, 0.1)) for each in solved))

    def _prepare(self) -> None:
        names: list[tuple[str, int]] = []
        orders = self.combos.orders
        for channel in self.model.channels:
            names += [(channel, order) for order in range(3)] if channel in orders else [(channel, -1)]
        names += [(estimate_of(body), order) for body in self.hidden for order in range(3)]
        names += [(law_of(element, k), -1) for element in elements(self.model) for k in range(law_columns(element))]
        high = min(self.usable, self.edge)
        self.spectra = Spectra(self.rate, self.length, LOWEST * self.lowest, high, names, orders)
        self.signals: list[dict[tuple[str, int], FloatArray]] = [self._signals_of(record) for record in self.records]
        drives = [drive.channel for drive in self.model.drives]
        for record, signals in zip(self.records, self.signals, strict=True):
            free = all(rests(record.channels[name], record.noise[name]) for name in drives)
            self.spectra.add(record.index, signals, record.noise, free=free)
        self.prepared: dict[str, Prepared] = {}
        self.sliding: dict[str, tuple[Sliding, SlidingFit]] = {}
        self._in_time: dict[tuple[str, str, bool], tuple[Sliding, SlidingFit] | None] = {}
        self._scales: dict[tuple[str, str], tuple[float, float, float]] = {}
        self._runs: dict[tuple[str, str], tuple[list[SlidingRun], float, float]] = {}
        self._base_columns: dict[tuple[str, bool], Columns] = {}
        self._slid: dict[tuple[int, str], tuple[SlidingFit, list[tuple[FloatArray, ...]]]] = {}
        for balance in self.balances:
            if balance.rubs:
                self._slide(balance)
            else:
                runs = [r.index for r in self.records if r.configuration in balance.configurations]
                if any(item.run in runs for item in self.spectra.runs):
                    rows, start = self.rows(balance)
                    self.prepared[balance.name] = Prepared(self.spectra, rows, runs, start)
        for lock in self.locks:
            runs = [r.index for r in self.records if r.configuration == lock.configuration]
            if any(item.run in runs for item in self.spectra.runs):
                self.prepared[lock.name] = Prepared(self.spectra, [self.motion_row(lock.element.weights, 2)], runs, np.zeros(0))
        for channel, others in self.combos.repeated.items():
            row = {(channel, 2): 1.0} | {(other, 2): -weight for other, weight in others.items()}
            runs = [item.run for item in self.spectra.runs]
            if runs:
                self.prepared[f"{channel} as {' + '.join(others)}"] = Prepared(self.spectra, [row], runs, np.zeros(0))
        self.stuck = self._stuck()

    def _signals_of(self, record: Record) -> dict[tuple[str, int], FloatArray]:
        # Each channel as displacement, velocity and acceleration; estimated bodies; the forces of laws.
        orders = self.combos.orders
        signals: dict[tuple[str, int], FloatArray] = {}
        for channel, values in record.channels.items():
            if channel in orders:
                low = 0.0 if self.counted else (LOWEST if channel in self.wandering else CUT) * self.lowest
                steady = channel in self.imposing
                found = derivatives(values, orders[channel], self.rate, low, np.inf, steady=steady)
                signals |= {(channel, order): part for order, part in found.orders.items()}
            else:
                signals[channel, -1] = values
        if self.hidden:
            seen = [body.name for body in self.model.bodies if body.name not in self.hidden]
            motions = {body: self.combined(signals, self.body_row(body)) for body in seen}
            for body, values in estimated(self.assumed, self.hidden, motions, record.channels, self.rate).items():
                found = derivatives(values, 2, self.rate, CUT * self.lowest, np.inf)
                signals |= {(estimate_of(body), order): part for order, part in found.orders.items()}
        for element in elements(self.model):
            if law_columns(element) and self.combos.of(element.weights, 0) is not None:
                d, v = (self.combined(signals, self.motion_row(element.weights, order)) for order in (0, 1))
                time = record.start + np.arange(len(d)) / self.rate
                for k, part in enumerate(law_forces(self.model, element, d, v, time, self.rate).T):
                    signals[law_of(element, k), -1] = part
            else:
                signals |= {(law_of(element, k), -1): np.zeros(len(values)) for k in range(law_columns(element))}
        return signals

    def motion_row(self, weights: FloatArray, order: int) -> Row:
        """A combination of coordinates as a row of signals."""
        combo = self.combos.of(weights, order)
        assert combo is not None
        return {(channel, order): weight for channel, weight in combo.items()}

    def body_row(self, body: str, order: int = 2) -> Row:
        """A body's motion as a row."""
        weights = np.zeros(len(self.model.bodies))
        weights[[b.name for b in self.model.bodies].index(body)] = 1.0
        return self.motion_row(weights, order)

    def force_row(self, balance: Balance) -> Row:
        """The known part of an equation: drives and measured forces minus the inertia of given masses."""
        row: dict[tuple[str, int], complex | ComplexArray] = {}
        for drive in self.model.drives:
            if drive.channel in balance.pushes:
                key = (drive.channel, -1)
                row[key] = row.get(key, 0.0) + balance.pushes[drive.channel] * drive.factor
        for channel, sign in balance.forces.items():
            row[channel, -1] = row.get((channel, -1), 0.0) + sign
        if not self.unknown_scale(balance):
            for name, weight in self.inertia_row(balance).items():
                row[name] = row.get(name, 0.0) - weight
        return row

    def inertia_row(self, balance: Balance) -> Row:
        """The inertia of the given masses of a balance."""
        row: dict[tuple[str, int], complex | ComplexArray] = {}
        for body, share in balance.weights.items():
            if body not in self.unknown_masses(balance):
                for name, weight in self.body_row(body).items():
                    row[name] = row.get(name, 0.0) + share * self.model.body(body).mass * weight
        return row

    @cached_property
    def with_estimates(self) -> frozenset[str]:
        """The names of the equations in which a motion is estimated."""
        return frozenset(balance.name for balance in self.balances if not is_measured(balance, self.combos))

    def unknown_masses(self, balance: Balance) -> tuple[str, ...]:
        """The masses of a balance that are solved for: the free ones, unless nothing else sets the scale."""
        free = self._free_masses(balance)
        return tuple(body for body in free if f"bodies.{body}.mass" != self.assumed_scale(balance))

    def _free_masses(self, balance: Balance) -> list[str]:
        return [body for body in balance.bodies if f"bodies.{body}.mass" in self.model.free and body not in self.hidden]

    def assumed_scale(self, balance: Balance) -> str:
        """Path of the free value that a balance takes as given because nothing else sets its scale; empty if something does."""
        free = self._free_masses(balance)
        if len(free) < len(balance.bodies) or balance.forces or not free:
            return ""
        if balance.pushes:
            return "drive.factor" if self.model.drive.channel in balance.pushes and "drive.factor" in self.model.free else ""
        return f"bodies.{max(free, key=lambda name: self.model.body(name).mass)}.mass"

    def unknown_scale(self, balance: Balance) -> bool:
        """Whether the drive's factor is to be found from the given masses; the equation is then scaled to the drive."""
        drive = self.model.drive
        given = len(self.unknown_masses(balance)) < len(balance.bodies)
        return "drive.factor" in self.model.free and drive.channel in balance.pushes and given

    def scales(self, balance: Balance) -> bool:
        """Whether a single mass of a balance shows: something else is known of its size."""
        others = len(balance.bodies) - len(self.unknown_masses(balance))
        forced = bool(balance.pushes or balance.forces)
        return (forced and not self.unknown_scale(balance)) or others > 1

    @property
    def unscaled(self) -> frozenset[str]:
        """The bodies whose given mass no equation tests: each equation with one of them holds with any value of its mass."""
        given = {body.name for body in self.model.bodies if f"bodies.{body.name}.mass" not in self.model.free}
        tested = {body for balance in self.balances if self.scales(balance) for body in balance.bodies}
        return frozenset({body for balance in self.balances for body in balance.bodies} & given - tested)

    def unknown_rows(self, balance: Balance) -> list[tuple[str, Row, float]]:
        """Masses that are solved for, alone or as a scale of all given ones: path (empty for the scale), row and given value."""
        found: list[tuple[str, Row, float]] = []
        for body in self.unknown_masses(balance):
            row = {name: balance.weights[body] * weight for name, weight in self.body_row(body).items()}
            found.append((f"bodies.{body}.mass", row, self.model.body(body).mass))
        if self.unknown_scale(balance):
            found.append(("", self.inertia_row(balance), 1.0))
        return found

    def rows(self, balance: Balance) -> tuple[list[Row], FloatArray]:
        """The rows of an equation without friction, and its coefficients as given: the known row first."""
        rows: list[Row] = [self.force_row(balance)]
        start: list[float] = []
        for _, row, value in self.unknown_rows(balance):
            rows.append(row)
            start.append(value)
        for element, sign in balance.crossing:
            if element.link is None:
                continue
            for order, value in ((1, element.link.damping), (0, element.link.stiffness)):
                row = self.motion_row(element.weights, order) if order or self.springs(element.link) else {}
                rows.append({name: sign * weight for name, weight in row.items()})
                start.append(value)
            for k in range(law_columns(element)):
                rows.append({(law_of(element, k), -1): sign})
                start.append(1.0)
        return rows, np.array(start)

    def springs(self, link: Link) -> bool:
        """Whether the stiffness of a link is solved for: the deflections of two without one would add up to that of another."""
        return link.stiffness > 0.0 or f"links.{link.name}.stiffness" in self.model.free

    def combined(self, signals: Mapping[tuple[str, int], FloatArray], row: Row) -> FloatArray:
        """A row with real coefficients as a signal, shape (n,)."""
        n = len(next(iter(signals.values())))
        found = np.zeros(n)
        for name, weight in row.items():
            found += float(np.real(weight)) * signals[name]  # type: ignore[arg-type]
        return found

    def _slide(self, balance: Balance) -> None:
        found = self.in_time(balance, self.primary(balance))
        if found is not None:
            self.sliding[balance.name] = found

    def in_time(self, balance: Balance, element: Element, *, sliding: bool | None = None) -> tuple[Sliding, SlidingFit] | None:
        """An equation in the time domain, with the motion of one of its elements; None if there are too few samples.

        Only samples that slide count if `sliding`, or if that is None and the element has a contact; in an equation with another
        element's contact, those in which that slides. Where the low-pass is so long that all are close to a reversal, an element
        without a contact is assumed to slide through these.
        """
        rubs = element.contact is not None if sliding is None else sliding
        key = balance.name, element.name, rubs
        if key not in self._in_time:
            sign = next(s for e, s in balance.crossing if e.name == element.name)
            place = balance.name, element.name
            if place not in self._cuts:
                self._cuts[place] = self.cut(balance, element)
            cut = self._cuts[place]
            if key[:2] not in self._runs:
                self._runs[key[:2]] = self._sliding_runs(balance, element, sign, self.records, self.signals, cut)
            shared, noise, velocity_noise = self._runs[key[:2]]
            runs = [run.without_slow_part() for run in shared]
            self._in_time[key] = None
            if not rubs and balance.rubs:
                runs = self._while_others_slide(balance, runs)
            if runs:
                stiffness = element.link.stiffness if element.link is not None else 0.0
                found = Sliding(
                    runs, self.rate / self.every, CUT / cut, integrated=self.integrated(element),
                    drifts=self.drifts(balance, element), stiffness=abs(sign) * stiffness, noise=noise,
                    velocity_noise=velocity_noise, parts=self._parts(balance), edge=self.edge, rubs=rubs,
                )  # fmt: skip
                if not found.usable and rubs and element.contact is None:
                    found.slide_through_reversals()
                if found.usable:
                    settled = self._settled(found, element, sign)
                    if found.usable:  # the samples that slide are chosen again as the slow part becomes known
                        self._in_time[key] = found, settled
        return self._in_time[key]

    def _while_others_slide(self, balance: Balance, runs: Sequence[SlidingRun]) -> list[SlidingRun]:
        # The signals of an equation in the samples in which its contact slides; none if it never does.
        if balance.name not in self.sliding:
            return []
        sliding, _ = self.sliding[balance.name]
        slides = {run.run: sliding.slides(run) for run in sliding.runs}
        return [replace(run, usable=run.usable & slides[run.run]) for run in runs if run.run in slides]

    def in_motion(self, balance: Balance, element: Element, shape: Shape) -> float:
        """The ratio by which a shape reduces what an equation without friction leaves, while the element moves."""
        found = self.in_time(balance, element, sliding=True)
        if found is None:
            return 1.0
        sliding, with_friction = found
        state, values = sliding.state(), np.delete(with_friction.values, FRICTION_COLUMN)
        without = sliding.fit(self.base_columns(element, dry=False), values, ROUNDS)
        sliding.restore(state)
        fitted = self._with_shape(element, sliding, without, shape, self.own_frequency(element, balance), dry=False)
        sliding.restore(state)
        return (sliding.residual(fitted) - 1.0) / (sliding.residual(without) - 1.0)

    def integrated(self, element: Element) -> bool:
        """Whether an element's deflection is an integral, so that its slow part is unknown.

        A position that is counted from the start of a velocity's record is known, but not its small difference from another one.
        """
        orders = [self.combos.orders[channel] for channel in self.combos.of(element.weights, 0) or {}]
        if self.counted:
            return len(orders) > 1 and element.link is not None and element.link.stiffness > 0.0 and max(orders) > 0
        return all(order > 0 for order in orders)

    def cut(self, balance: Balance, element: Element) -> float:
        """Frequency in Hz up to which the slow part of an element's integrated deflection is fitted, or that of others' forces.

        The sensors' errors integrate to more than the motion there, or their noise to more than `NOISY` of it.
        """
        if self.drifts(balance, element):
            return self._cut_of_others(balance, element)
        own = self.own_frequency(element, balance)
        if self.wandering & set(self.combos.of(element.weights, 0) or {}):
            return WANDERING_CUT * own
        highest = CUT * own
        found = min(highest, HIGHEST_CUT * self.lowest)
        while found < highest and self.noise_share(element, SURE * found) > NOISY:
            found = min(2.0 * found, highest)
        # Above, the rig's motion may grow towards its lowest mode, too.
        while found < WANDERING_CUT * self.lowest and self.grows_below(element, found):
            found = min(2.0 * found, WANDERING_CUT * self.lowest)
        return found

    def drifts(self, balance: Balance, element: Element) -> bool:
        """Whether the element's motion is known, and another one's force in its equation has an unknown slow part.

        It has where its deflection is the small difference of two counted positions.
        """
        return self.counted and not self.integrated(element) and any(self.integrated(o) for o, _ in balance.others(element))

    def _cut_of_others(self, balance: Balance, element: Element) -> float:
        # Frequency in Hz from which the noise of other elements' integrated deflections makes no more of their force than the
        # rest of the equation's noise; at most where integrals are cut otherwise, and so high that a run has `PERIODS_OF_CUT`.
        allowed = self._force_noise(balance, element, self.records[0], len(next(iter(self.records[0].channels.values()))))
        stiff = [(abs(sign) * o.link.stiffness, o) for o, sign in balance.others(element) if o.link and self.integrated(o)]
        found = CUT * self.lowest
        shortest = min(len(next(iter(record.channels.values()))) for record in self.records) / self.rate
        while found >= 2.0 * PERIODS_OF_CUT / shortest:
            noise = (k * self._deflection_noise(other, SURE * found / 2.0, self.records[0]) for k, other in stiff)
            if float(np.linalg.norm(list(noise))) > allowed:
                break
            found /= 2.0
        return found

    def grows_below(self, element: Element, frequency: float) -> bool:
        """Whether an element's integrated deflection is mostly error below this frequency in Hz.

        It is where, in the median over runs, the octave below has more than `NOISY` of the rms motion, and `STEEP` times what the
        octave above has: errors of an acceleration are divided by the square of the frequency, and a driven motion is not.
        """
        shares = []
        for signals in self.signals:
            parts = (
                float(np.var(self.elongation(signals, element, low)[0])) for low in (frequency, 2.0 * frequency, SURE * frequency)
            )
            here, above, below = parts
            shares.append((max(below - here, 0.0) / max(here, 1e-300), max(here - above, 0.0) / max(here, 1e-300)))
        below, above = np.sqrt(np.median(shares, axis=0))
        return bool(below > NOISY and below > STEEP * above)

    def noise_share(self, element: Element, low: float) -> float:
        """Noise of an element's deflection, integrated from this frequency in Hz on, as its least share of a run's rms."""
        shares = []
        for record, signals in zip(self.records, self.signals, strict=True):
            motion = float(np.std(self.elongation(signals, element, low)[0]))
            shares.append(self._deflection_noise(element, low, record) / max(motion, 1e-300))
        return min(shares, default=0.0)

    def _deflection_noise(self, element: Element, low: float, record: Record) -> float:
        # Standard deviation of the noise of an element's deflection in m, integrated from this frequency in Hz on.
        variance = 0.0
        for channel, weight in (self.combos.of(element.weights, 0) or {}).items():
            power = 2 * self.combos.orders[channel]
            if power:  # an estimate has no noise of its own
                # White noise of an n-th derivative, integrated n times: the integral of 1 / (2 pi f)^2n from that frequency on.
                density = 2.0 * (weight * record.noise.get(channel, 0.0)) ** 2 / self.rate
                variance += density / ((2.0 * np.pi) ** power * (power - 1) * low ** (power - 1))
        return float(np.sqrt(variance))

    def _settled(self, sliding: Sliding, element: Element, sign: float) -> SlidingFit:
        laws = law_columns(element)
        start = np.zeros(3 + laws + sliding.runs[0].fixed.shape[1])
        start[3 : 3 + laws] = abs(sign)
        if element.link is not None:
            start[0], start[1] = abs(sign) * element.link.stiffness, abs(sign) * element.link.damping
        return sliding.settle(self.base_columns(element), start)

    def base_columns(self, element: Element, *, dry: bool = True) -> Columns:
        """Spring, damper, and `dry` friction of an element, its laws, and the columns that do not depend on its motion."""
        key = element.name, dry
        if key not in self._base_columns:
            self._base_columns[key] = self._columns_of(element, dry=dry)
        return self._base_columns[key]

    def _columns_of(self, element: Element, *, dry: bool) -> Columns:
        laws = law_columns(element)
        friction = element.contact.law if element.contact is not None else None

        def columns(d: FloatArray, v: FloatArray, run: SlidingRun, place: IntArray) -> FloatArray:
            rubbing: FloatArray = direction_of_sliding(v, run.creep)
            if friction is not None and friction.remembers:
                if "friction" not in run.memory:
                    run.memory["friction"] = friction.along(run.deflection, run.velocity, self.rate / self.every)
                rubbing = run.memory["friction"][place]
            elif friction is not None and is_shaped(friction):
                rubbing = friction.force(d, v, run.time[place], np.zeros((1, len(d))), NO_LINK)
            parts = [d, v, rubbing] if dry else [d, v]
            if laws:
                parts.append(law_forces(self.model, element, d, v, run.time[place], self.rate / self.every, run, place))
            return np.column_stack([*parts, run.fixed[place]])

        return columns

    def _sliding_runs(
        self, balance: Balance, element: Element, sign: float, records: Sequence[Record],
        all_signals: Sequence[Mapping[tuple[str, int], FloatArray]], cut: float,
    ) -> tuple[list[SlidingRun], float, float]:  # fmt: skip
        # The signals of an equation in all runs, and the noise of its force (N, rms) and of a measured velocity (m/s, largest).
        runs: list[SlidingRun] = []
        way = np.sign(sign)
        noise: list[float] = []
        velocity_noise: list[float] = []
        for record, signals in zip(records, all_signals, strict=True):
            if record.configuration not in balance.configurations or len(next(iter(signals.values()))) < SHORTEST:
                continue
            force = way * self.combined(signals, self.force_row(balance))
            d, v = self.elongation(signals, element, SURE * cut)
            fixed = [way * self.combined(signals, row) for _, row, _ in self.unknown_rows(balance)]
            for other, other_sign in balance.others(element):
                od, ov = self.elongation(signals, other, SURE * cut if self.counted else CUT * self.lowest)
                if other.link is not None and not element.has_ends_of(other):
                    fixed += [way * other_sign * od * self.springs(other.link), way * other_sign * ov]
                    fixed += [way * other_sign * signals[law_of(other, k), -1] for k in range(law_columns(other))]
                if other.contact is not None:
                    fixed.append(way * other_sign * direction_of(ov, max(float(np.std(ov)), 1e-12)))
            columns = np.column_stack(fixed) if fixed else np.zeros((len(force), 0))
            noise.append(self._force_noise(balance, element, record, len(force)))
            if not self.integrated(element):
                combo = self.combos.of(element.weights, 0) or {}
                velocity_noise.append(self._processed_noise(record, [(name, 1, abs(w)) for name, w in combo.items()], len(force)))
            force, d, v, columns = map(self.thinned, (force, d, v, columns))
            force = shortly_low_passed(force, self.rate / self.every, self.edge)
            n = len(force)
            usable = np.zeros(n, dtype=bool)
            ends = ENDS / self.lowest if any(self.combos.orders.values()) else TAPS / self.edge
            margin = min(round(ends * self.rate / self.every), n // 10)
            usable[margin : n - margin] = True
            runs.append(
                SlidingRun(
                    run=record.index, force=force, deflection=d, velocity=v, fixed=columns,
                    time=record.start + np.arange(n) * self.every / self.rate, usable=usable, slow=np.zeros(n),
                    slow_velocity=np.zeros(n),
                )
            )  # fmt: skip
        return runs, float(np.sqrt(np.mean(np.square(noise)))) if noise else 0.0, max(velocity_noise, default=0.0)

    def fixed_rows(self, balance: Balance, element: Element) -> list[tuple[str, Row]]:
        """The rows of `SlidingRun.fixed` with the parameters whose values are their coefficients, by path.

        The path is "-" where the equation does not give one: for an integrated deflection, whose slow part is unknown. The row is
        empty for a direction of sliding, and for a spring that is not solved for, whose coefficient means nothing.
        """
        found: list[tuple[str, Row]] = [(path, row) for path, row, _ in self.unknown_rows(balance)]
        for other, sign in balance.others(element):
            if other.link is not None and not element.has_ends_of(other):
                known = not self.integrated(other)
                for order, name in enumerate(("stiffness", "damping")):
                    row = self.motion_row(other.weights, order) if order or self.springs(other.link) else {}
                    path = f"links.{other.link.name}.{name}" if known else "-"
                    found.append((path, {key: sign * weight for key, weight in row.items()}))
                found += [("-", {(law_of(other, k), -1): sign}) for k in range(law_columns(other))]
            if other.contact is not None:
                found.append(("-", {}))
        return found

    def thinned(self, values: FloatArray) -> FloatArray:
        """Records, shape (n, ...), at the samples of sliding equations."""
        if self.every == 1:
            return values
        return low_passed(values, self.rate, self.rate / self.every / PASSED)[:: self.every]

    def _parts(self, balance: Balance) -> float:
        # Largest mean square of the channels' parts in an equation's known force, N^2.
        found = 0.0
        for record, signals in zip(self.records, self.signals, strict=True):
            if record.configuration in balance.configurations:
                parts: dict[str, FloatArray] = {}
                for name, weight in self.force_row(balance).items():
                    part = float(np.real(weight)) * signals[name]  # type: ignore[arg-type]
                    parts[name[0]] = parts.get(name[0], 0.0) + low_passed(part, self.rate, self.edge)
                found = max(found, sum(float(np.mean(part**2)) for part in parts.values()))
        return found

    def elongation(
        self, signals: Mapping[tuple[str, int], FloatArray], element: Element, low: float
    ) -> tuple[FloatArray, FloatArray]:
        """Deflection and velocity of an element in a run, integrals from `low` Hz on."""
        combo = self.combos.of(element.weights, 0)
        assert combo is not None
        orders = self.combos.orders
        n = len(next(iter(signals.values())))
        d, v = np.zeros(n), np.zeros(n)
        for channel, weight in combo.items():
            order = orders[channel]
            steady = channel in self.imposing
            found = derivatives(signals[channel, order], order, self.rate, 0.0 if self.counted else low, self.edge, steady=steady)
            d += weight * found.orders[0]
            v += weight * found.orders[1]
        if self.counted and self.integrated(element):
            d, v = without_slow_part(d, self.rate, low), v - v.mean()
        if 0 in (orders[channel] for channel in combo):
            d = low_passed(d, self.rate, self.edge)
        return d, v

    def _force_noise(self, balance: Balance, element: Element, record: Record, n: int) -> float:
        # Standard deviation of the noise of an equation: of its known part, of the inertia of masses that are solved for, and of
        # the forces of springs and dampers, with the values of the rig. Most of that of an integrated deflection is in the slow
        # part that is fitted.
        parts = [(channel, order, abs(complex(weight))) for (channel, order), weight in self.force_row(balance).items()]
        for _, row, value in self.unknown_rows(balance):
            parts += [(channel, order, abs(value * complex(weight))) for (channel, order), weight in row.items()]
        for other, _ in balance.crossing:
            if other.link is not None and not (other.name == element.name and self.integrated(element)):
                for order, value in enumerate((other.link.stiffness, other.link.damping)):
                    combo = self.combos.of(other.weights, 0) or {}
                    parts += [(channel, order, abs(value * weight)) for channel, weight in combo.items()]
        return self._processed_noise(record, parts, n)

    def _processed_noise(self, record: Record, parts: Sequence[tuple[str, int, float]], n: int) -> float:
        # Standard deviation of a sum of derivatives of channels (order, weight), from noise through the same processing.
        generator = np.random.default_rng(5)
        total = 0.0
        for channel, order, weight in parts:
            level = record.noise.get(channel, 0.0) * weight
            if level == 0.0:
                continue
            values = generator.normal(0.0, 1.0, min(n, 8192))
            if order >= 0:
                own = self.combos.orders[channel]
                values = derivatives(values, own, self.rate, CUT * self.lowest, np.inf).orders[order]
            passed = low_passed(values, self.rate, self.edge)
            # At the ends of a record its derivatives are much larger, and no equation uses them.
            total += level**2 * float(np.mean(passed[len(passed) // 8 : -(len(passed) // 8)] ** 2))
        return float(np.sqrt(total))

    def _stuck(self) -> dict[str, Lock]:
        # Contacts that stick for whole runs: there their ends move alike.
        found: dict[str, Lock] = {}
        for balance in self.balances:
            for element, _ in balance.crossing:
                if element.contact is None or self.combos.of(element.weights, 2) is None:
                    continue
                speed = {
                    r.index: float(np.std(self.combined(s, self.motion_row(element.weights, 1))))
                    for r, s in zip(self.records, self.signals, strict=True)
                    if r.configuration in balance.configurations
                }
                most = max(speed.values(), default=0.0)
                still = [run for run, value in speed.items() if value < STUCK * most and self._held(run, balance)]
                if still and any(item.run in still for item in self.spectra.runs) and len(balance.crossing) == 1:
                    lock = Lock(element=element, configuration=balance.configurations[0], beyond=balance)
                    name = f"stuck {element.name}"
                    self.prepared[name] = Prepared(self.spectra, [self.motion_row(element.weights, 2)], still, np.zeros(0))
                    found[name] = lock
        return found

    def _held(self, run: int, balance: Balance) -> bool:
        # Whether the force in a run never reaches the friction that the others show.
        if balance.name not in self.sliding:
            return True
        force = self.combined(self.signals[[r.index for r in self.records].index(run)], self.force_row(balance))
        _, base = self.sliding[balance.name]
        contact = self.primary(balance).contact
        level = getattr(contact.law, "friction_force", 1.0) if contact is not None and is_shaped(contact.law) else 1.0
        return bool(np.quantile(np.abs(force), HELD) < level * base.values[FRICTION_COLUMN])

    def residuals(self) -> dict[str, float]:
        """Residual of each equation over noise."""
        found = {name: item.solved.residual for name, item in self.prepared.items()}
        return found | {name: sliding.residual(fit) for name, (sliding, fit) in self.sliding.items()}

    def elements(self) -> list[Element]:
        """The elements whose forces occur in the equations."""
        found: dict[str, Element] = {}
        for balance in self.balances:
            for element, _ in balance.crossing:
                found.setdefault(element.name, element)
        return list(found.values())

    @property
    def complete(self) -> bool:
        """Whether every link and contact occurs in an equation of measured bodies, so that a fault at any place shows."""
        named = {name for element in self.elements() for name in element.names}
        every = {link.name for link in self.model.links} | {contact.name for contact in self.model.contacts}
        return bool(self.prepared or self.sliding) and not self.hidden and every <= named

    def tested(self, kind: str, name: str) -> bool:
        """Whether causes at a place are tested."""
        return self.only is None or self.only == (kind, name)

    def contains(self, name: str, place: CausePlace) -> bool:
        """Whether a fault at a place breaks the equation of this name."""
        balance = next((balance for balance in self.balances if balance.name == name), None)
        if place.kind == "link":
            return balance is not None and any(element.name == place.name for element, _ in balance.crossing)
        if place.kind == "body":
            return balance is not None and place.name in balance.bodies
        rows: Sequence[Row] = self.prepared[name].rows if balance is None else [self.force_row(balance)]
        if balance is not None:
            rows = [*rows, *(self.motion_row(element.weights, 0) for element, _ in balance.crossing)]
        return any(key[0] == place.name for row in rows for key in row)

    def balance_of(self, name: str) -> Balance:
        return next(balance for balance in self.balances if balance.name == name)

    def primary(self, balance: Balance) -> Element:
        """The element of a sliding equation whose contact slides."""
        return next(e for e, _ in balance.crossing if e.contact is not None)

    def slid(self, element: Element, sliding: Sliding, base: SlidingFit, shape: Shape, own: float) -> SlidingFit:
        """Fit of a sliding equation with a shape, from its base fit; the slow parts are as before afterwards."""
        key = id(sliding), shape.name
        if key not in self._slid:
            state = sliding.state()
            self._slid[key] = self._with_shape(element, sliding, base, shape, own), sliding.state()
            sliding.restore(state)
        return self._slid[key][0]

    def slow_parts(self, sliding: Sliding, shape: Shape) -> list[tuple[FloatArray, ...]]:
        """The slow parts of a fit by `slid`."""
        return self._slid[id(sliding), shape.name][1]

    def _with_shape(
        self, element: Element, sliding: Sliding, base: SlidingFit, shape: Shape, own: float, *, dry: bool = True
    ) -> SlidingFit:
        columns = self.columns_with(element, sliding, shape, own, dry=dry)
        few = sliding.active[0]
        at = few.first + few.used[:2]
        before = len(base.values)
        count = columns(np.zeros(2), np.ones(2) * sliding.speed, few.run, at).shape[1] - before
        values = np.concatenate([base.values, np.zeros(count)])
        return sliding.fit(columns, values, ROUNDS, shape.penalty(count, before, sliding.power, sliding.allowed))

    def columns_with(self, element: Element, sliding: Sliding, shape: Shape, own: float, *, dry: bool = True) -> Columns:
        """The columns of a sliding equation with a shape, and with `dry` friction."""
        plain = self.base_columns(element, dry=dry)

        def columns(d: FloatArray, v: FloatArray, run: SlidingRun, place: IntArray) -> FloatArray:
            course = Course(
                deflection=d, velocity=v, time=run.time[place], whole=run.deflection, place=place, rate=self.rate / self.every,
                low=sliding.range[0], high=sliding.range[1], fastest=sliding.fastest, speed=sliding.speed, swing=sliding.swing,
                own=own, end=self.end, memory=run.memory,
            )  # fmt: skip
            return np.column_stack([plain(d, v, run, place), shape.columns(course)])

        return columns

    def course(self, run: int, element: Element, balance: Balance) -> Course:
        """The motion of an element in a run, of which a spectral equation uses the whole."""
        k = next(k for k, record in enumerate(self.records) if record.index == run)
        signals = self.signals[k]
        d, v = (self.combined(signals, self.motion_row(element.weights, order)) for order in (0, 1))
        scale = self._scale(element, balance)
        return Course(
            deflection=d, velocity=v, time=self.records[k].start + np.arange(len(d)) / self.rate, whole=d,
            place=np.arange(len(d), dtype=np.int64), rate=self.rate,
            low=-1.05 * scale[0], high=1.05 * scale[0], fastest=1.05 * scale[1],
            speed=scale[2], swing=scale[0], own=self.own_frequency(element, balance), end=self.end, memory={},
        )  # fmt: skip

    def _scale(self, element: Element, balance: Balance) -> tuple[float, float, float]:
        # Largest deflection and velocity of an element, and its rms velocity.
        key = element.name, balance.name
        if key not in self._scales:
            self._scales[key] = self._largest(element, balance)
        return self._scales[key]

    def _largest(self, element: Element, balance: Balance) -> tuple[float, float, float]:
        swing = fastest = speed = 0.0
        for record, signals in zip(self.records, self.signals, strict=True):
            if record.configuration in balance.configurations:
                d, v = (self.combined(signals, self.motion_row(element.weights, order)) for order in (0, 1))
                inside = slice(len(d) // 20, len(d) - len(d) // 20)
                swing, fastest = max(swing, float(np.abs(d[inside]).max())), max(fastest, float(np.abs(v[inside]).max()))
                speed = max(speed, float(np.std(v[inside])))
        return max(swing, 1e-12), max(fastest, 1e-12), max(speed, 1e-12)

    def own_frequency(self, element: Element, balance: Balance) -> float:
        """Frequency of an element's stiffness with the mass that it holds, Hz."""
        mass = sum(share**2 * self.model.body(body).mass for body, share in balance.weights.items())
        stiffness = element.link.stiffness if element.link is not None else 0.0
        return max(float(np.sqrt(stiffness / mass)) / (2.0 * np.pi) if mass > 0.0 else 0.0, self.lowest)

    def shaped(self, balance: Balance, element: Element, shape: Shape, first: int = 0) -> Solved:
        """An equation without friction solved with a shape at one of its elements, from every second segment."""
        prepared = self.prepared[balance.name]
        columns = {}
        for run in prepared.runs:
            course = self.course(run, element, balance)
            if not any(item.run == run for item in self.spectra.runs):
                continue
            parts = shape.columns(course)
            columns[run] = np.stack([self.spectra.segments(part, run) for part in parts.T])
        count = len(next(iter(columns.values())))
        penalty = None
        if shape.smooth:
            power = max(float(np.mean(self.combined(self.signals[k], prepared.rows[0]) ** 2)) for k in range(len(self.records)))
            penalty = shape.penalty(count, 0, power, 1.0)
        return prepared.shaped(columns, penalty, first=first)

    def fault(self, what: str, channel: str, values: FloatArray, source: str | None) -> tuple[FloatArray, ComplexArray]:
        """Signals that a fault of a channel adds, shape (signals, signals), and their gains in the true ones (values, bins).

        True signals = recorded + gain * added @ recorded.
        """
        spectra = self.spectra
        added = np.zeros((len(spectra.names),) * 2)
        for (name, order), k in spectra.index.items():
            if name == channel:
                added[k, k if source is None else spectra.index[source, order]] = 1.0
        omega, each = spectra.omega, values[:, None]
        if what == "delay":
            return added, np.asarray(np.exp(1j * omega * each) - 1.0)
        if what == "lag":
            return added, np.asarray(1.0 / (1.0 + 1j * omega * each) - 1.0)
        if what == "high-pass":
            return added, np.asarray(2.0 * np.pi * each / (1j * omega))
        if what == "low-pass":
            return added, np.asarray(1j * omega / (2.0 * np.pi * each))
        constant = 1.0 / each - 1.0 if what == "gain" else -each
        return added, np.asarray(np.broadcast_to(constant, (len(values), len(omega))), dtype=np.complex128)


def _read(run: Run, model: RigModel) -> dict[str, FloatArray]:
    held = {drive.channel for drive in model.drives if drive.imposes is None}
    stop = fast_length(usable_stop(run))
    records = {name: run.channel(name).read(0, stop) for name in model.channels}
    return {name: as_held(values, 1) if name in held and is_command(values) else values for name, values in records.items()}


def equations_of(campaign: Campaign, model: RigModel, like: Equations | None = None) -> Equations:
    """The equations of a campaign for a rig with the causes found so far, `like` those with which they are compared."""
    noise = noise_of_runs(campaign, tuple(drive.channel for drive in model.drives))
    return Equations(campaign, model, noise, zero_errors(campaign, model), like=like)


def lowest_frequency(model: RigModel, longest: float) -> float:
    """Frequency in Hz of the rig's lowest mode; of a rig without one, forty periods in its longest run of `longest` seconds."""
    found = lowest_mode(model)
    return max(found, 4.0 / max(longest, 1e-9)) if found else 40.0 / max(longest, 1e-9)
