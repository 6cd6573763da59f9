"""Where the misfit of a partly measured rig comes from: an unknown force at each place, with the rig's values fitted along.

A cause at one place, of any law, acts on the rest of the rig like one force there: in a link, on a body, or through the
drive. A sensor's fault adds to its record alone. So at every frequency the misfit of all records must be parallel to the rig's
response to that force. For each place, the rig's free values are fitted to the part of the misfit that is not (variable
projection; Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973, in the form of Kaufman, BIT 15, 1975). At the right place noise
remains, and its force gives what no sensor records (`at_place`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from isorig.analysis.campaign import ComplexArray, FloatArray
from isorig.analysis.deadline import ask_time
from isorig.analysis.equations.hidden import WITHIN
from isorig.analysis.equations.spectral import ACCURACY
from isorig.analysis.equations.system import CausePlace
from isorig.analysis.errors import ModelError, SimulationError
from isorig.analysis.fitting.linear_spectra import LEAST_DAMPING
from isorig.analysis.fitting.trials import Trial, expected
from isorig.analysis.model.linear import LinearResponse, linear_response
from isorig.analysis.model.rig_model import RigModel, weights_of
from isorig.analysis.simulate.free_run import true_drives
from isorig.analysis.spectra.noise import rests
from isorig.analysis.spectra.windows import hanning

#: Share of the misfit's rms that the best place may leave to tell something. Chosen: half; a sound rig's noise leaves all.
EXPLAINS = 0.5
#: Places that leave this many times what the best one leaves are excluded. Chosen: in chains with one fault the right place left
#: least in all that had no further disturbance, and the next one 2.6 to 11 times as much.
EXCLUDED = 2.0
#: The same before the last fits. Chosen: the right place was within this factor of the best one in all of these.
LATER = 3.0
#: Share of a place's largest response below which a frequency bin does not tell about it: in the first fits, in which weak bins
#: would take up what values far from the right ones leave, and in the later ones. Chosen: above a sweep the records are small
#: and so is the error allowed in them; below a hundredth of the response to a force at such a frequency lay the two octaves of a
#: sweep in which a beam's tip hardened.
UNDETERMINED, LEAST_RESPONSE = 0.01, 5e-4
#: Most samples of a run that are used, relative spacing of its frequency bins, and the most of them.
LONGEST, SPACING, BINS = 2**16, 1.0 / 240.0, 200
#: Of these, one in so many is used by the first fits of a place, which only choose among starting points and places.
FEWER = 3
#: Lowest frequency bin in use: the window spreads a record's zero over two.
SLOWEST = 4
#: Weight of what the unknown force explains of the misfit. Chosen: just large enough that the values of the place itself, which
#: no other part of the misfit tells, make the force small: windows spread a large one over neighbouring bins.
ALONG = 0.003
#: Power of a bin over that of noise from which it is used.
SHOWS = 4.0
#: Most further fits of a place, each about the simulation with the values of the one before, which contains the start of the
#: motion; the share of the rest by which one must be better to go on; and evaluations of each.
FITS, BETTER, EVALUATIONS = 5, 0.03, 25
#: Part of a description that holds the values of a place.
OWNERS = {"link": "links", "body": "bodies"}


@dataclass(frozen=True, kw_only=True)
class Located:
    """A place, and what it leaves of the misfit."""

    place: CausePlace
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
        return any(one.place.name == location for one in self.possible) or all(one.place.name != location for one in self.located)


def compared_places(model: RigModel, trials: Sequence[Trial], starts: Sequence[RigModel] = ()) -> Places | None:
    """What each place of a rig leaves of the misfit of the fitted data; None if it is unknown.

    It is unknown for rigs with contacts, whose linear part alone is no model of them, with sensors of forces, with fewer than two
    records, and without a run that a drive moves from rest. `starts` are the same rig with other starting values.
    """
    motions = all(sensor.force_in is None for sensor in model.sensors)
    driven = [trial for trial in trials if tells(model, trial)]
    if model.contacts or not model.links or not motions or len(model.sensors) < 2 or not driven:
        return None
    runs, few = ([_Bins(model, trial, every) for trial in driven] for every in (1, FEWER))
    begun = [_Rig(start, few) for start in (model, *starts)]
    bare = min((rig.fitted(None) for rig in begun), key=lambda one: one.left).settled(None, runs)
    begun.append(_Rig(bare.model, few))

    def fitted(place: CausePlace) -> _Fitted:
        # The best start shows once the motion is simulated again with the values to which it led.
        return min((rig.fitted(place).again(place, few) for rig in begun), key=lambda one: one.left)

    found = {place: fitted(place) for place in places_of(model)}
    near = LATER * min(one.left for one in found.values())
    found = {
        place: one.settled(place, runs).settled(place, runs, LEAST_RESPONSE) if one.left <= near else one
        for place, one in found.items()
    }
    located = [Located(place=place, left=one.left, model=one.model) for place, one in found.items()]
    located.sort(key=lambda one: one.left)
    # Of a sound rig every place leads to the right values.
    from_best = _Rig(located[0].model, runs).fitted(None)
    return Places(bare=min(bare.left, from_best.left), located=tuple(located))


def tells(model: RigModel, trial: Trial) -> bool:
    """Whether a run shows the response to its drives alone: one moves it from rest."""
    drives = (each.recorded for each in (trial.excitation, *trial.excitation.others))
    return trial.motion is None and trial.moving is None and not all(rests(values, trial.drive_noise) for values in drives)


def places_of(model: RigModel) -> list[CausePlace]:
    """The places of a rig at which a cause may be."""
    return [
        *(CausePlace("link", link.name) for link in model.links),
        *(CausePlace("body", body.name) for body in model.bodies if body.name not in model.imposed),
        *(CausePlace("drive", drive.channel) for drive in model.drives if drive.imposes is None),
        *(CausePlace("sensor", sensor.channel) for sensor in model.sensors),
    ]


class _Bins:
    # A run at some frequencies: the errors that are allowed, the true drives, and the misfit of a rig.

    def __init__(self, model: RigModel, trial: Trial, every: int) -> None:
        self.trial, self._samples = trial, min(trial.fitted or trial.samples, LONGEST)
        frequency = np.fft.rfftfreq(self._samples, 1.0 / trial.sample_rate)
        measured = self._spectrum(trial.measured)
        size = np.sum(np.abs(measured / trial.noise) ** 2, axis=1)
        slowest = SLOWEST * trial.sample_rate / self._samples
        kept = np.flatnonzero((size > SHOWS * len(trial.noise)) & (frequency >= slowest) & (frequency <= trial.usable))
        # Of neighbouring bins the one with the largest records.
        cell = np.floor(np.log(frequency[kept]) / np.log1p(SPACING))
        order = kept[np.lexsort((-size[kept], cell))]
        first = np.sort(order[np.unique(np.sort(cell), return_index=True)[1]])
        self._used = first[:: every * max(1, len(first) // BINS)]
        self.omega = np.asarray(2.0 * np.pi * frequency[self._used], dtype=np.float64)
        self.sigma = np.hypot(trial.noise, ACCURACY * np.abs(measured[self._used]))
        drives = true_drives(model.without_faults, trial.excitation)
        self.drives = np.stack([self._spectrum(drives[drive.channel])[self._used] for drive in model.drives], axis=-1)[..., None]

    def misfit(self, model: RigModel) -> ComplexArray:
        # Of the simulated records, over the allowed errors, shape (bins, sensors).
        return self._spectrum(self.trial.measured - expected(model, self.trial))[self._used] / self.sigma

    def _spectrum(self, records: FloatArray) -> ComplexArray:
        # Of the first samples, shape (..., n) to (bins, ...).
        records, window = records[..., : self._samples], hanning(self._samples)
        return np.asarray(np.fft.rfft((records - records.mean(axis=-1, keepdims=True)) * window) / np.linalg.norm(window)).T


def _acting(model: RigModel, place: CausePlace) -> FloatArray:
    # The forces on the bodies by a unit of the unknown force.
    names = [body.name for body in model.bodies]
    if place.kind == "link":
        return weights_of(model, model.link(place.name))
    if place.kind == "body":
        return np.asarray([float(name == place.name) for name in names], dtype=np.float64)
    drive = next(drive for drive in model.drives if drive.channel == place.name)
    return np.asarray([drive.pushes.get(name, 0.0) for name in names], dtype=np.float64)


class _Fitted(NamedTuple):
    # The rms of what is left of the misfit, over noise, and the rig's values.
    left: float
    model: RigModel

    def again(self, place: CausePlace | None, runs: Sequence[_Bins], least_response: float = UNDETERMINED) -> _Fitted:
        # The better one of this and a fit about the simulation with its values, if these can be simulated.
        try:
            return min(self, _Rig(self.model, runs, least_response).fitted(place), key=lambda one: one.left)
        except (ModelError, SimulationError):
            return self

    def settled(self, place: CausePlace | None, runs: Sequence[_Bins], least_response: float = UNDETERMINED) -> _Fitted:
        # The same until the values are final.
        best = self
        for _ in range(FITS):
            before, best = best, best.again(place, runs, least_response)
            if best.left > (1.0 - BETTER) * before.left:
                break
        return best


class _Rig:
    # The misfit of a rig's records as a function of its free values, and what an unknown force explains of it.

    def __init__(self, model: RigModel, runs: Sequence[_Bins], least_response: float = UNDETERMINED) -> None:
        self._model, self._bins, self._least = model, runs, least_response
        self._names = [body.name for body in model.bodies]
        self._misfits = [bins.misfit(model) for bins in runs]

    @staticmethod
    def _response(bins: _Bins, model: RigModel) -> LinearResponse:
        # By the drives of a run together, over the allowed errors.
        found = linear_response(model, bins.trial.run.configuration, bins.omega)
        return replace(found, moved=found.moved @ bins.drives, seen=found.seen / bins.sigma[:, :, None])

    def fitted(self, place: CausePlace | None) -> _Fitted:
        """The values that leave least of the misfit across the response to a force at a place."""
        from scipy.optimize import least_squares

        ask_time()
        start, about = self._model, [self._response(bins, self._model).records for bins in self._bins]
        stiffest, heaviest = max(x.stiffness for x in start.links), max(body.mass for body in start.bodies)
        least = 2.0 * LEAST_DAMPING * np.sqrt(stiffest * heaviest)
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

        def residual(logs: FloatArray) -> FloatArray:
            return evaluated(logs)[0]

        def slopes(logs: FloatArray) -> FloatArray:
            return evaluated(logs)[1]

        # Of the records' dimensions one is spent at each frequency.
        count = len(self._model.sensors)
        dimensions = sum(misfit.size for misfit in self._misfits) * (1.0 - (place is not None) / count)
        most = np.log(WITHIN)
        best = start
        if paths:
            done = least_squares(
                residual, np.zeros(len(paths)), jac=slopes, bounds=(-most, most), x_scale="jac", max_nfev=EVALUATIONS,
                ftol=1e-4, xtol=1e-6,
            )  # fmt: skip
            best = at(done.x)
        responses = [self._response(bins, best) for bins in self._bins]
        parts = (
            force_at(place, best, response, self._least).beyond(misfit - (response.records - before)[..., 0])
            for misfit, response, before in zip(self._misfits, responses, about, strict=True)
        )
        left = float(np.sqrt(sum(float(np.sum(np.abs(part) ** 2)) for part in parts) / dimensions))
        return _Fitted(left, best)

    def _left(
        self, place: CausePlace | None, paths: Sequence[str], model: RigModel, about: Sequence[ComplexArray]
    ) -> tuple[FloatArray, FloatArray]:
        # The misfit across the response to a force at a place, and its derivatives with respect to the logarithms of the values.
        parts, slopes = [], []
        for bins, simulated, before in zip(self._bins, self._misfits, about, strict=True):
            response = self._response(bins, model)
            misfit = simulated - (response.records - before)[..., 0]
            by_force = response.seen @ response.compliance
            force = force_at(place, model, response, self._least)
            moved = response.moved[..., 0] + force.moved * force.estimated(misfit)[:, None]
            parts.append(force.across(misfit).ravel())
            every = (self._slope(path, model, bins.omega, response, by_force, moved) for path in paths)
            own = [force.across(slope).ravel() for slope in every]
            slopes.append(np.stack(own, axis=-1))
        left, slope = np.concatenate(parts), np.concatenate(slopes)
        return np.concatenate([left.real, left.imag]), np.concatenate([slope.real, slope.imag])

    def _slope(
        self, path: str, model: RigModel, omega: FloatArray, response: LinearResponse, by_force: ComplexArray, moved: ComplexArray
    ) -> ComplexArray:  # fmt: skip
        # The change of the misfit with the logarithm of a value, whose force by a motion of all bodies acts on the rig.
        part, _, rest = path.partition(".")
        if part == "drive":
            return -response.records[..., 0]
        name, _, what = rest.rpartition(".")
        if part == "bodies":
            k = self._names.index(name)
            return np.asarray(by_force[:, :, k] * (-(omega**2) * moved[:, k] * model.body(name).mass)[:, None])
        link = model.link(name)
        along = weights_of(model, link)
        size = link.stiffness if what == "stiffness" else 1j * omega * link.damping
        return np.asarray((by_force @ along) * ((moved @ along) * size)[:, None])


class UnknownForce(NamedTuple):
    """The response to an unknown force at a place."""

    records: ComplexArray  #: Of the sensors by a unit of it, shape (bins, sensors).
    moved: ComplexArray  #: Displacements of the bodies by a unit of it, shape (bins, bodies).
    weight: FloatArray  #: Inverse of the records' power, shape (bins,); zero where they tell nothing.

    @classmethod
    def with_records(cls, records: ComplexArray, moved: ComplexArray, least: float) -> UnknownForce:
        """With these records, without the bins in which they are below a share `least` of the largest."""
        power = np.sum(np.abs(records) ** 2, axis=1)
        shown = power > least**2 * float(power.max(initial=0.0))
        return cls(records, moved, np.divide(1.0, power, out=np.zeros_like(power), where=shown))

    def estimated(self, misfit: ComplexArray) -> ComplexArray:
        """The force that explains most of a misfit of shape (bins, sensors), shape (bins,)."""
        return np.asarray(np.einsum("fs,fs->f", self.records.conj(), misfit) * self.weight)

    def beyond(self, misfit: ComplexArray) -> ComplexArray:
        """What it cannot explain of a misfit, shape (bins, sensors)."""
        return misfit - self.records * self.estimated(misfit)[:, None]

    def across(self, misfit: ComplexArray) -> ComplexArray:
        """The same, and `ALONG` of what it explains."""
        return misfit - (1.0 - ALONG) * self.records * self.estimated(misfit)[:, None]


def force_at(place: CausePlace | None, model: RigModel, response: LinearResponse, least: float) -> UnknownForce:
    """The unknown force at a place of a rig with this response; one without any effect if the place is None.

    Bins with less than a share `least` of the largest response tell nothing.
    """
    return UnknownForce.with_records(*response_to_force(place, model, response), least)


def response_to_force(place: CausePlace | None, model: RigModel, response: LinearResponse) -> tuple[ComplexArray, ComplexArray]:
    """Records of the sensors, shape (bins, sensors), and displacements of the bodies, shape (bins, bodies), by a unit force."""
    records, moved = np.zeros(response.seen.shape[:2], dtype=complex), np.zeros_like(response.moved[..., 0])
    if place is not None and place.kind == "sensor":
        records[:, [sensor.channel for sensor in model.sensors].index(place.name)] = 1.0
    elif place is not None:
        moved = response.compliance @ _acting(model, place)
        records = np.einsum("fsb,fb->fs", response.seen, moved)
    return records, moved


def is_linear(path: str) -> bool:
    """Whether a parameter is a link's spring or damper, a mass, or the drive's factor."""
    if path == "drive.factor":
        return True
    part, _, rest = path.partition(".")
    name, _, what = rest.rpartition(".")
    return "." not in name and (part, what) in {("links", "stiffness"), ("links", "damping"), ("bodies", "mass")}


def rest_of(model: RigModel, place: CausePlace) -> dict[str, float]:
    """The free values of a rig's linear part by path, without those at a place, which are a part of the unknown force there."""
    return {path: model.get(path) for path in model.free if is_linear(path) and not is_own(path, place)}


def is_own(path: str, place: CausePlace) -> bool:
    """Whether a parameter at a place scales a force that is a part of the unknown one there."""
    if place.kind == "sensor":
        return False
    return path == "drive.factor" if place.kind == "drive" else path.startswith(f"{OWNERS[place.kind]}.{place.name}.")
