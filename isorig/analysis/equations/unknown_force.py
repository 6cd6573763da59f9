"""Where the misfit of a partly measured rig comes from: an unknown force at each place, with the rig's values fitted along.

Whatever its law, a cause at one place acts on the rest of the rig like one force there: in a link, on a body, or through the drive.
A sensor's fault adds to its record alone. So at every frequency the misfit of all records must be parallel to the rig's response
to that force. For each place, the rig's free values are fitted to the part of the misfit that is not (variable projection; Golub
and Pereyra, SIAM J. Numer. Anal. 10, 1973, in the form of Kaufman, BIT 15, 1975). At the right place noise remains, and its force
gives the motion of all bodies, with which the equations of motion of all bodies show kind and form.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import msgspec
import numpy as np

from isorig.analysis.campaign import MOTION, Campaign, Channel, ComplexArray, FloatArray, Run
from isorig.analysis.deadline import ask_time
from isorig.analysis.equations.motion import Combinations, estimate_of
from isorig.analysis.equations.system import Equations, Place
from isorig.analysis.fitting.linear_spectra import LEAST_DAMPING
from isorig.analysis.fitting.trials import Trial, expected, zero_errors
from isorig.analysis.model.linear import imposed_coordinates, linear_part
from isorig.analysis.model.rig_model import RigModel, Sensor, direction
from isorig.analysis.simulate import simulate
from isorig.analysis.simulate.free_run import true_drives
from isorig.analysis.spectra.noise import noise_of_runs, rests
from isorig.analysis.spectra.windows import hanning

#: Share of the misfit's rms that the best place may leave to tell something. Chosen: half; a sound rig's noise leaves all.
EXPLAINS = 0.5
#: Places that leave this many times what the best one leaves are excluded. Chosen: in chains with one fault the right place left
#: least in all that had no further disturbance, and the next one 2.6 to 11 times as much.
EXCLUDED = 2.0
#: The same before the last fits. Chosen: the right place was within this factor of the best one in all of these.
LATER = 3.0
#: Share of a place's largest response below which a frequency bin does not tell about it.
UNDETERMINED = 0.01
#: The same for the force itself, which noise limits; and the share of noise in its power up to which a bin tells of it.
FAINT, NOISY = 1e-3, 0.04
#: Most samples of a run that are used, relative spacing of its frequency bins, and the most of them.
LONGEST, SPACING, BINS = 2**16, 1.0 / 240.0, 400
#: Relative accuracy of records: calibrations of sensors agree to half a per cent.
ACCURACY = 0.005
#: Lowest frequency bin in use: the window spreads a record's zero over two.
SLOWEST = 4
#: Frequency bins whose responses are computed at once.
PART = 1 << 14
#: Weight of what the unknown force explains of the misfit. Chosen: just large enough that the values of the place itself, which no
#: other part of the misfit tells, make the force small: windows spread a large one over neighbouring bins.
ALONG = 0.003
#: Power of a bin over that of noise from which it is used.
SHOWS = 4.0
#: Most further fits of a place, each about the simulation with the values of the one before, which contains the start of the motion;
#: the share of the rest by which one must be better to go on; and evaluations of each.
FITS, BETTER, EVALUATIONS = 3, 0.03, 25
#: Part of a description that holds the values of a place.
OWNERS = {"link": "links", "body": "bodies"}
#: Largest factor between a fitted and its starting value.
WITHIN = 3.0


@dataclass(frozen=True, kw_only=True)
class Located:
    """A place, and what it leaves of the misfit."""

    place: Place
    left: float  #: rms of the part of the misfit that an unknown force there cannot explain, over noise.
    model: RigModel  #: The rig with the values with which that is least.


@dataclass(frozen=True, kw_only=True)
class Places:
    """What each place leaves of the misfit, that which leaves least first."""

    bare: float  #: rms of the misfit of the refitted rig without any unknown force, over noise.
    located: tuple[Located, ...]

    @property
    def possible(self) -> tuple[Located, ...]:
        """The places that remain, the best one first; empty if no single place explains the misfit."""
        best = min((one.left for one in self.located), default=np.inf)
        if best > EXPLAINS * self.bare:
            return ()
        return tuple(one for one in self.located if one.left <= EXCLUDED * best)

    def includes(self, location: str) -> bool:
        """Whether a cause may be there: a possible place, or one that was not compared."""
        return any(one.place.name == location for one in self.possible) or all(
            one.place.name != location for one in self.located
        )


def compared_places(model: RigModel, trials: Sequence[Trial], starts: Sequence[RigModel] = ()) -> Places | None:
    """What each place of a rig leaves of the misfit of the fitted data; None if it is unknown.

    It is unknown for rigs with contacts, whose linear part alone is no model of them, with sensors of forces, with fewer than two
    records, and without a run that a drive moves from rest.

    Parameters
    ----------
    model
        The fitted rig.
    trials
        The runs.
    starts
        The same rig with other starting values.
    """
    motions = all(sensor.force_in is None for sensor in model.sensors)
    driven = [trial for trial in trials if tells(model, trial)]
    if model.contacts or not motions or len(model.sensors) < 2 or not driven:
        return None
    begun = [_Rig(start, driven) for start in (model, *starts)]

    def fitted(place: Place | None) -> _Fitted:
        return min((rig.fitted(place) for rig in begun), key=lambda one: one.left).again(place, driven)

    found = {place: fitted(place) for place in places_of(model)}
    near = LATER * min(one.left for one in found.values())
    found = {place: one.settled(place, driven) if one.left <= near else one for place, one in found.items()}
    located = [Located(place=place, left=one.left, model=one.model) for place, one in found.items()]
    bare = fitted(None).settled(None, driven)
    return Places(bare=bare.left, located=tuple(sorted(located, key=lambda one: one.left)))


def tells(model: RigModel, trial: Trial) -> bool:
    """Whether a run shows the response to its drives alone: one moves it from rest."""
    drives = (each.recorded for each in (trial.excitation, *trial.excitation.others))
    return trial.motion is None and trial.moving is None and not all(rests(values, trial.drive_noise) for values in drives)


def places_of(model: RigModel) -> list[Place]:
    """The places of a rig at which a cause may be."""
    return [
        *(Place("link", link.name) for link in model.links),
        *(Place("body", body.name) for body in model.bodies if body.name not in model.imposed),
        *(Place("drive", drive.channel) for drive in model.drives if drive.imposes is None),
        *(Place("sensor", sensor.channel) for sensor in model.sensors),
    ]


def equations_at(located: Located, campaign: Campaign, trials: Sequence[Trial]) -> Equations:
    """The equations of a partly measured rig whose cause is at one place, which test causes there only.

    What no sensor records follows from the fitted values, the drives, and the force at this place that explains most of the misfit:
    of a link its elongation and force, otherwise the motion of all bodies without sensors.

    Parameters
    ----------
    located
        The place.
    campaign, trials
        The measurement.
    """
    model = located.model
    added = _added_sensors(model, located.place)
    kept = () if located.place.kind == "link" else model.sensors
    drives = tuple(drive.channel for drive in model.drives)
    levels = dict(zip((run.id for run in campaign.runs), noise_of_runs(campaign, drives), strict=True))
    runs, noise = [], []
    for trial in trials:
        if tells(model, trial):
            records, level = _estimated(located, trial, added)
            runs.append(_with_records(trial.run, records))
            noise.append({**levels[trial.run.id], **level})
    extended = msgspec.structs.replace(model, sensors=(*kept, *added))
    return Equations(replace(campaign, runs=tuple(runs)), extended, noise, zero_errors(campaign, model), only=located.place)


def _added_sensors(model: RigModel, place: Place) -> tuple[Sensor, ...]:
    # Those that would record what the equations need.
    if place.kind == "link":
        link = model.link(place.name)
        motion = Sensor(channel=f"elongation of {link.name}", body=link.a, relative_to=link.b, arms=link.arms)
        return motion, Sensor(channel=f"force in {link.name}", force_in=f"links.{link.name}", quantity="force")
    bodies = [body.name for body in model.bodies if body.name not in Combinations(model).measured]
    if place.kind == "sensor":  # what it records is known from the others alone
        bodies += [sensor.body for sensor in model.sensors if sensor.channel == place.name and sensor.body not in bodies]
    return tuple(Sensor(channel=estimate_of(body), body=body) for body in bodies)


def _with_records(run: Run, records: Mapping[str, FloatArray]) -> Run:
    # A run with further channels, zero where their records are shorter.
    more = {name: Channel(name=name, samples=np.pad(values, (0, len(run) - len(values)))) for name, values in records.items()}
    return replace(run, channels={**run.channels, **more})


def _estimated(
    located: Located, trial: Trial, sensors: Sequence[Sensor]
) -> tuple[dict[str, FloatArray], dict[str, float]]:  # fmt: skip
    # What sensors would record in a run, by channel, and the standard deviation of its noise.
    model, n = located.model, trial.samples
    sound = simulate(
        msgspec.structs.replace(model.without_faults, sensors=tuple(sensors)), trial.excitation,
        configuration=trial.run.configuration, start_time=trial.start_time, samples=n,
    ).channels  # fmt: skip
    # As long again: what follows the last sample is not known, and must not reach the first ones.
    frequency = np.fft.rfftfreq(2 * n, 1.0 / trial.sample_rate)
    used = np.flatnonzero((frequency > 0.0) & (frequency <= min(trial.usable, 0.5 * trial.sample_rate)))
    misfit = np.fft.rfft(trial.measured - expected(model, trial), 2 * n)[:, used].T / trial.noise
    force = _force_in_parts(located, trial, np.asarray(2.0 * np.pi * frequency[used], dtype=np.float64))
    values, omega = force.estimated(misfit), 2.0 * np.pi * frequency[used]
    # Wiener's filter: between the lines of a drive and outside its band the force is noise.
    share = np.divide(force.weight, np.abs(values) ** 2, out=np.ones(len(used)), where=values != 0.0)
    by_force = np.stack([_recorded(model, sensor, force.moved, omega) for sensor in sensors])
    added = np.zeros((len(sensors), len(frequency)), dtype=complex)
    added[:, used] = by_force * values * np.maximum(1.0 - share, 0.0)
    # Noise is white in the equations: as in most of the bins that tell of the force.
    told = share < NOISY
    gain = np.median((np.abs(by_force) ** 2 * force.weight)[:, told], axis=1) if told.any() else np.zeros(len(sensors))
    names = [sensor.channel for sensor in sensors]
    levels = dict(zip(names, np.sqrt(gain).tolist(), strict=True))
    corrections = np.fft.irfft(added, 2 * n)[:, :n]
    return {name: sound[name] + more for name, more in zip(names, corrections, strict=True)}, levels


def _force_in_parts(located: Located, trial: Trial, omega: FloatArray) -> _Force:
    # The unknown force at a place at many frequencies, whose matrices would need much memory at once.
    records, moved = [], []
    for part in np.array_split(omega, len(omega) // PART + 1):
        still = [np.zeros(len(part), dtype=complex)] * len(located.model.drives)
        response = _response(located.model, trial.run.configuration, part, still, trial.noise[None])
        one = _force(located.place, located.model, response)
        records.append(one.records)
        moved.append(one.moved)
    return _Force.with_records(np.concatenate(records), np.concatenate(moved), FAINT)


def _recorded(model: RigModel, sensor: Sensor, moved: ComplexArray, omega: FloatArray) -> ComplexArray:
    # The record of a sensor by a unit of the unknown force, which displaces the bodies by `moved`, shape (bins, bodies): an
    # acceleration, or the force that a link resists its elongation with, which is less by the unknown one.
    if sensor.force_in is None:
        return np.asarray(-(omega**2) * (moved @ direction(model, sensor.body, sensor.relative_to, sensor.arms)))
    link = model.link(sensor.force_in.partition(".")[2])
    return np.asarray((link.stiffness + 1j * omega * link.damping) * (moved @ direction(model, link.a, link.b, link.arms)) - 1.0)


class _Lines:
    # A run at some frequencies: its misfit and the true drives, with the errors that are allowed.

    def __init__(self, model: RigModel, trial: Trial) -> None:
        self.trial, n = trial, min(trial.fitted or trial.samples, LONGEST)
        window = hanning(n)

        def lines(records: FloatArray) -> ComplexArray:
            return np.asarray(np.fft.rfft((records - records.mean(axis=-1, keepdims=True)) * window) / np.linalg.norm(window)).T

        frequency = np.fft.rfftfreq(n, 1.0 / trial.sample_rate)
        measured = lines(trial.measured[:, :n])
        size = np.sum(np.abs(measured / trial.noise) ** 2, axis=1)
        slowest = SLOWEST * trial.sample_rate / n
        kept = np.flatnonzero((size > SHOWS * len(trial.noise)) & (frequency >= slowest) & (frequency <= trial.usable))
        # Of neighbouring bins the one with the largest records.
        cell = np.floor(np.log(frequency[kept]) / np.log1p(SPACING))
        order = kept[np.lexsort((-size[kept], cell))]
        first = np.sort(order[np.unique(np.sort(cell), return_index=True)[1]])
        used = first[:: max(1, len(first) // BINS)]
        self.omega = np.asarray(2.0 * np.pi * frequency[used], dtype=np.float64)
        self.sigma = np.hypot(trial.noise, ACCURACY * np.abs(measured[used]))
        self.misfit = lines(trial.measured[:, :n] - expected(model, trial)[:, :n])[used] / self.sigma
        drives = true_drives(model.without_faults, trial.excitation)
        self.drives = [lines(drives[drive.channel][:n])[used] for drive in model.drives]


@dataclass(frozen=True)
class _Response:
    # A rig's linear part at some frequencies: displacements of the bodies by the drives, shape (bins, bodies), and by forces on
    # them, shape (bins, bodies, bodies); the weights of the bodies in the sensors' records, shape (bins, sensors, bodies).
    moved: ComplexArray
    compliance: ComplexArray
    seen: ComplexArray

    @property
    def records(self) -> ComplexArray:
        # Of the sensors by the drives, shape (bins, sensors).
        return np.asarray(np.einsum("fsb,fb->fs", self.seen, self.moved))


def _response(
    model: RigModel, configuration: str, omega: FloatArray, drives: Sequence[ComplexArray], scale: FloatArray
) -> _Response:
    # `drives` are the spectra of the drives, each of shape (bins,); `scale` is a record that counts as one, shape (bins, sensors).
    names = [body.name for body in model.bodies]
    basis, mass, damping, stiffness = linear_part(model, configuration)
    imposed = imposed_coordinates(model, basis)
    free = [k for k in range(basis.shape[1]) if k not in imposed.values()]
    s = 1j * omega[:, None, None]
    force = basis.T @ (mass * s**2 + damping * s + stiffness) @ basis
    compliance = np.zeros_like(force)
    compliance[np.ix_(range(len(s)), free, free)] = np.linalg.inv(force[:, free][:, :, free])
    z, pushed = np.zeros((len(s), basis.shape[1]), dtype=complex), np.zeros((len(s), len(names)), dtype=complex)
    for drive, values in zip(model.drives, drives, strict=True):
        if drive.imposes is not None:
            z[:, imposed[drive.imposes]] += values / (1j * omega) ** MOTION.get(drive.quantity, 0)
        else:
            pushed += values[:, None] * drive.factor * np.array([drive.pushes.get(name, 0.0) for name in names])
    z = z + np.einsum("fij,fj->fi", compliance, pushed @ basis - np.einsum("fij,fj->fi", force, z))
    along = np.stack([direction(model, sensor.body, sensor.relative_to, sensor.arms) for sensor in model.sensors])
    order = np.array([MOTION[sensor.quantity] for sensor in model.sensors])
    gain = np.array([sensor.chain.gain for sensor in model.sensors])
    seen = along[None] * ((1j * omega[:, None]) ** order * gain / scale)[:, :, None]
    return _Response(moved=z @ basis.T, compliance=basis @ compliance @ basis.T, seen=seen)


def _acting(model: RigModel, place: Place) -> FloatArray:
    # The forces on the bodies by a unit of the unknown force.
    names = [body.name for body in model.bodies]
    if place.kind == "link":
        link = model.link(place.name)
        return direction(model, link.a, link.b, link.arms)
    if place.kind == "body":
        return np.eye(len(names))[names.index(place.name)]
    drive = next(drive for drive in model.drives if drive.channel == place.name)
    return np.array([drive.pushes.get(name, 0.0) for name in names])


class _Fitted(NamedTuple):
    # The rms of what is left of the misfit, over noise, and the rig's values.
    left: float
    model: RigModel

    def again(self, place: Place | None, trials: Sequence[Trial]) -> _Fitted:
        # The better one of this and a fit about the simulation with its values.
        return min(self, _Rig(self.model, trials).fitted(place), key=lambda one: one.left)

    def settled(self, place: Place | None, trials: Sequence[Trial]) -> _Fitted:
        # The same until the values are final.
        best = self
        for _ in range(FITS):
            before, best = best, best.again(place, trials)
            if best.left > (1.0 - BETTER) * before.left:
                break
        return best


class _Rig:
    # The misfit of a rig's records as a function of its free values, and what an unknown force explains of it. The values of the place
    # itself are a part of that force.

    def __init__(self, model: RigModel, trials: Sequence[Trial]) -> None:
        self._model, self._trials = model, trials
        self._names = [body.name for body in model.bodies]
        self._lines = [_Lines(model, trial) for trial in trials]

    @staticmethod
    def _records(lines: _Lines, model: RigModel) -> _Response:
        return _response(model, lines.trial.run.configuration, lines.omega, lines.drives, lines.sigma)

    def fitted(self, place: Place | None) -> _Fitted:
        """The values that leave least of the misfit across the response to a force at a place."""
        from scipy.optimize import least_squares

        ask_time()
        start, about = self._model, [self._records(lines, self._model).records for lines in self._lines]
        least = 2.0 * LEAST_DAMPING * np.sqrt(max(x.stiffness for x in start.links) * max(b.mass for b in start.bodies))
        paths = [path for path in start.free if is_linear(path)]
        given = np.array([max(start.get(path), least if path.endswith("damping") else 1e-12) for path in paths])
        known: dict[bytes, tuple[FloatArray, FloatArray]] = {}

        def at(logs: FloatArray) -> RigModel:
            return start.replace(dict(zip(paths, (given * np.exp(logs)).tolist(), strict=True)))

        def evaluated(logs: FloatArray) -> tuple[FloatArray, FloatArray]:
            if logs.tobytes() not in known:
                known.clear()
                known[logs.tobytes()] = self._left(place, paths, at(logs), about)
            return known[logs.tobytes()]

        # Of the records' dimensions one is spent at each frequency.
        count = len(self._model.sensors)
        dimensions = sum(lines.misfit.size for lines in self._lines) * (1.0 - (place is not None) / count)
        most = np.log(WITHIN)
        done = least_squares(
            lambda logs: evaluated(logs)[0], np.zeros(len(given)), jac=lambda logs: evaluated(logs)[1],
            bounds=(-most, most), x_scale="jac", max_nfev=EVALUATIONS, ftol=1e-4, xtol=1e-6,
        )  # fmt: skip
        best = at(done.x)
        responses = [self._records(lines, best) for lines in self._lines]
        parts = (
            _force(place, best, response).beyond(lines.misfit - (response.records - before))
            for lines, response, before in zip(self._lines, responses, about, strict=True)
        )
        left = float(np.sqrt(sum(float(np.sum(np.abs(part) ** 2)) for part in parts) / dimensions))
        return _Fitted(left, best)

    def _left(
        self, place: Place | None, paths: Sequence[str], model: RigModel, about: Sequence[ComplexArray]
    ) -> tuple[FloatArray, FloatArray]:
        # The misfit across the response to a force at a place, and its derivatives with respect to the logarithms of the values.
        parts, slopes = [], []
        for lines, before in zip(self._lines, about, strict=True):
            response = self._records(lines, model)
            misfit = lines.misfit - (response.records - before)
            by_force = response.seen @ response.compliance
            force = _force(place, model, response)
            moved = response.moved + force.moved * force.estimated(misfit)[:, None]
            parts.append(force.across(misfit).ravel())
            every = (self._slope(path, model, lines.omega, response, by_force, moved) for path in paths)
            own = [force.across(slope).ravel() for slope in every]
            slopes.append(np.stack(own, axis=-1))
        left, slope = np.concatenate(parts), np.concatenate(slopes)
        return np.concatenate([left.real, left.imag]), np.concatenate([slope.real, slope.imag])

    def _slope(
        self, path: str, model: RigModel, omega: FloatArray, response: _Response, by_force: ComplexArray, moved: ComplexArray
    ) -> ComplexArray:  # fmt: skip
        # The change of the misfit with the logarithm of a value, at a motion of all bodies: the force by that change acts on the rig.
        part, _, rest = path.partition(".")
        if part == "drive":
            return -response.records
        name, _, what = rest.rpartition(".")
        if part == "bodies":
            k = self._names.index(name)
            return np.asarray(by_force[:, :, k] * (-(omega**2) * moved[:, k] * model.body(name).mass)[:, None])
        link = model.link(name)
        along = direction(model, link.a, link.b, link.arms)
        size = link.stiffness if what == "stiffness" else 1j * omega * link.damping
        return np.asarray((by_force @ along) * ((moved @ along) * size)[:, None])


class _Force(NamedTuple):
    # An unknown force at a place: the records per unit of it, shape (bins, sensors), zero where they tell nothing, the displacements
    # of the bodies, shape (bins, bodies), and the inverse of the power of the former.
    records: ComplexArray
    moved: ComplexArray
    weight: FloatArray

    @classmethod
    def with_records(cls, records: ComplexArray, moved: ComplexArray, least: float) -> _Force:
        # Without the bins in which the response is below this share of the largest.
        power = np.sum(np.abs(records) ** 2, axis=1)
        told = power > least**2 * float(power.max(initial=0.0))
        return cls(records, moved, np.divide(1.0, power, out=np.zeros_like(power), where=told))

    def estimated(self, misfit: ComplexArray) -> ComplexArray:
        # The force that explains most of a misfit, shape (bins,).
        return np.asarray(np.einsum("fs,fs->f", self.records.conj(), misfit) * self.weight)

    def beyond(self, misfit: ComplexArray) -> ComplexArray:
        # What it cannot explain.
        return misfit - self.records * self.estimated(misfit)[:, None]

    def across(self, misfit: ComplexArray) -> ComplexArray:
        # What it cannot explain, and `ALONG` of what it does.
        return misfit - (1.0 - ALONG) * self.records * self.estimated(misfit)[:, None]


def _force(place: Place | None, model: RigModel, response: _Response) -> _Force:
    shape = response.seen.shape[:2]
    records, moved = np.zeros(shape, dtype=complex), np.zeros_like(response.moved)
    if place is not None and place.kind == "sensor":
        records[:, [sensor.channel for sensor in model.sensors].index(place.name)] = 1.0
    elif place is not None:
        moved = response.compliance @ _acting(model, place)
        records = np.einsum("fsb,fb->fs", response.seen, moved)
    return _Force.with_records(records, moved, UNDETERMINED)


def is_linear(path: str) -> bool:
    """Whether a parameter is a link's spring or damper, a mass, or the drive's factor."""
    if path == "drive.factor":
        return True
    part, _, rest = path.partition(".")
    name, _, what = rest.rpartition(".")
    return "." not in name and (part, what) in {("links", "stiffness"), ("links", "damping"), ("bodies", "mass")}


def is_own(path: str, place: Place | None) -> bool:
    """Whether a parameter at a place scales a force that is a part of the unknown one there."""
    if place is None or place.kind == "sensor":
        return False
    return path == "drive.factor" if place.kind == "drive" else path.startswith(f"{OWNERS[place.kind]}.{place.name}.")
