"""Power of the responses that a rig's linear part predicts for recorded drives, in bands, for many sets of parameters at once.

No simulation and no fit over time: the responses to sinusoids, with dry friction as the viscous damper that takes the same
power from Gaussian motion (statistical linearization; Roberts and Spanos, Random Vibration and Statistical Linearization, 1990).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from isorig.analysis.campaign import MOTION, Campaign, ComplexArray, FloatArray, IntArray, Run, usable_stop
from isorig.analysis.derivative import derivative
from isorig.analysis.model.linear import floats, imposed_coordinates, linear_part, pushes_of
from isorig.analysis.model.rig_model import GROUND, Drive, RigModel, Sensor, weights_of
from isorig.analysis.spectra.noise import noise_levels, rests
from isorig.analysis.spectra.welch import DRIVEN
from isorig.analysis.spectra.windows import hanning

#: Minimum number of samples of a run before its first gap.
SHORTEST = 256
#: Frequency bins are averaged to this many groups, evenly spaced in log frequency: an octave then has 20 to 40. Levels in bands
#: of a third of an octave differ by less than a tenth of their usual error from those of four times as many groups.
GROUPS = 150
#: Bands in an octave in which power is compared.
PER_OCTAVE = 3
#: Share of a link's critical damping that an undamped link gets, so that a fit can increase it.
LEAST_DAMPING = 1e-3
#: Most iterations of the damper that replaces dry friction, the change of its logarithm below which they end, and the largest
#: change in one of them.
ROUNDS, SETTLED, FARTHEST = 15, 1e-6, 3.0
#: Mean of an imposed sliding speed, relative to its standard deviation, from which it drags. Derived: the damper with the power
#: of friction at a Gaussian speed with this mean is then exp(-1/2) of that without.
DRAGS = 1.0
#: Share of a drive's energy that a Hann window leaves, below which it hides the drive: that of a hammer, some hundredths of a run
#: after its start. Chosen: a drive that lasts keeps three eighths, one of the first fifth of a run a fortieth.
HIDDEN = 0.02
#: Samples from which the noise of a record is determined: a few per cent accurate.
LONGEST_NOISE = 1 << 13


@dataclass(frozen=True, kw_only=True)
class Spectrum:
    """Spectra of a run at the driven frequencies."""

    run: Run  #: The run.
    omega: FloatArray  #: rad/s, shape (groups,).
    drives: ComplexArray  #: Cross spectra of the drives, summed within each group, shape (drives, drives, groups).
    across: ComplexArray  #: Cross spectra of drives (conjugate) and responses, shape (drives, responses, groups).
    #: Power of the responses and of their sensors' noise, shape (responses, groups).
    power: FloatArray
    noise: FloatArray
    starts: IntArray  #: Index of the first group of each band, shape (bands,).
    square: float  #: Factor from a sum of power over all groups to the mean square of the record.

    def in_bands(self, power: FloatArray) -> FloatArray:
        """Sums of a quantity by group over each band, shape (..., groups) to (..., bands)."""
        return np.asarray(np.add.reduceat(power, self.starts, axis=-1))

    def predicted(self, response: ComplexArray) -> FloatArray:
        """Power with a response to the drives, shape (rows, drives, ..., groups) to (rows, ..., groups)."""
        return np.asarray(np.einsum("rd...g,deg,re...g->r...g", response.conj(), self.drives, response).real)


def spectra_of(model: RigModel, campaign: Campaign, groups: int = GROUPS) -> tuple[Spectrum, ...]:
    """Spectra of all runs that are driven, up to their first gaps, without those that drag a contact in one direction.

    The frequency bins of each are averaged to at most this number of groups.
    """
    names = tuple(drive.channel for drive in model.drives)
    # A rig that nothing holds is judged by the force of its drive; its positions may drift.
    noise = {} if floats(model) else noise_levels(campaign, names, LONGEST_NOISE)
    runs = (run for run in campaign.runs if not _drags_a_contact(model, run))
    return tuple(found for run in runs if (found := spectrum_of(model, run, noise, groups)) is not None)


def drags(speed: FloatArray) -> bool:
    """Whether an imposed sliding speed keeps its direction; friction is then a constant force, no damper."""
    return bool(abs(speed.mean()) > DRAGS * speed.std())


def _drags_a_contact(model: RigModel, run: Run) -> bool:
    samples, bodies = usable_stop(run), [body.name for body in model.bodies]
    imposed = [drive for drive in model.drives if drive.imposes and MOTION.get(drive.quantity, 2) < 2]
    if samples < SHORTEST or not imposed or not model.contacts:
        return False

    def speed(drive: Drive) -> FloatArray:
        values = run.channel(drive.channel).read(0, samples)
        return values if MOTION[drive.quantity] == 1 else derivative(values, run.sample_rate)

    speeds = {bodies.index(drive.imposes): speed(drive) for drive in imposed if drive.imposes}
    for contact in model.contacts:
        weights = weights_of(model, contact)
        sliding = np.sum([weights[body] * values for body, values in speeds.items()], axis=0)
        if drags(sliding):
            return True
    return False


def spectrum_of(model: RigModel, run: Run, noise: Mapping[str, float], groups: int = GROUPS) -> Spectrum | None:
    """Spectra of a run up to its first gap, with the standard deviations of its channels' noise.

    Its frequency bins are averaged to at most this number of groups, evenly spaced in log frequency. None if the gap comes too
    early for a fit, or no frequency is driven.
    """
    samples = usable_stop(run)
    if samples < SHORTEST:
        return None
    frequency = np.fft.rfftfreq(samples, 1.0 / run.sample_rate)
    low, high = run.band or (0.0, 0.5 * run.sample_rate)
    first = int(np.searchsorted(frequency, max(low, 3.0 * run.sample_rate / samples), side="right"))
    last = int(np.searchsorted(frequency, min(high, 0.4 * run.sample_rate)))
    if last - first < 2:
        return None
    inside = slice(first, last)
    edges = np.geomspace(frequency[first], frequency[last - 1] * 1.000001, groups + 1)
    starts = np.unique(np.searchsorted(frequency[inside], edges[:-1]))

    def read(channel: str) -> FloatArray:
        return run.channel(channel).read(0, samples)

    records = {drive.channel: read(drive.channel) for drive in model.drives}
    window = _window(records.values(), samples)

    def lines(values: FloatArray) -> ComplexArray:
        return np.asarray(np.fft.rfft((values - values.mean()) * window)[inside])

    def response(sensor: Sensor) -> ComplexArray:
        # A body that nothing holds ends elsewhere than it began, and so does its integral; its acceleration does not.
        values, missing = read(sensor.channel), 2 - MOTION[sensor.quantity] if sensor.force_in is None and floating else 0
        for _ in range(missing):
            values = derivative(values, run.sample_rate)
        return np.asarray(lines(values) / (2j * np.pi * frequency[inside]) ** missing)

    floating = floats(model)
    if all(rests(values, noise.get(name, 0.0)) for name, values in records.items()):
        return None
    drives = [lines(values) for values in records.values()]
    responses = [response(sensor) for sensor in model.sensors]

    def summed(products: ComplexArray) -> ComplexArray:
        return np.asarray(np.add.reduceat(products, starts))

    of_drives = np.array([[summed(a.conj() * b) for b in drives] for a in drives])
    count = np.diff([*starts, last - first])
    own = np.einsum("ddg->dg", of_drives).real / count
    driven = (own > DRIVEN * own.max(axis=1, keepdims=True)).any(axis=0) & own.any(axis=0)
    if not driven.any():
        return None
    levels = np.array([noise.get(sensor.channel, 0.0) for sensor in model.sensors]) ** 2 * float(window @ window)
    middle = (np.add.reduceat(frequency[inside], starts) / count)[driven]
    return Spectrum(
        run=run, omega=2.0 * np.pi * middle, drives=of_drives[..., driven],
        across=np.array([[summed(a.conj() * y)[driven] for y in responses] for a in drives]),
        power=np.array([summed(y.conj() * y).real[driven] for y in responses]), noise=levels[:, None] * count[driven],
        starts=np.unique(np.floor(PER_OCTAVE * np.log2(middle)), return_index=True)[1],
        square=2.0 / (samples * float(window @ window)),
    )  # fmt: skip


def _window(drives: Iterable[FloatArray], samples: int) -> FloatArray:
    # The Hann window, or, where a drive acts at the start only and that would hide it, its second half at the end of the run.
    whole = hanning(samples)
    if all(float((whole * drive) @ (whole * drive)) >= HIDDEN * float(drive @ drive) for drive in drives):
        return whole
    late = np.ones(samples)
    late[samples // 2 :] = whole[samples // 2 :]
    return late


@dataclass(frozen=True, kw_only=True)
class FreeMotion:
    """The motion of a rig's linear part without dampers in its contacts, for sets of parameters."""

    #: Displacement of the bodies and velocity in the contacts per unit of each drive's channel, shapes (bodies, drives, sets,
    #: frequencies) and (contacts, drives, sets, frequencies).
    x: ComplexArray
    velocity: ComplexArray
    #: The same per unit of a force in each contact, shapes (bodies, contacts, sets, frequencies), (contacts, contacts, sets,
    #: frequencies).
    moved: ComplexArray
    mobility: ComplexArray

    def rubbing(self, dampers: FloatArray) -> ComplexArray:
        """Velocity in the contacts with dampers in N s/m, shape (contacts, sets), there (Woodbury's identity)."""
        coupled = self.mobility * dampers[:, :, None]
        own = np.arange(len(dampers))
        coupled[own, own] += 1.0
        return _solved(coupled, self.velocity)


def _solved(matrix: ComplexArray, side: ComplexArray) -> ComplexArray:
    # Solutions of many systems at once, shapes (n, n, ...) and (n, k, ...). Elimination without exchange of rows: damping keeps
    # the pivots of a dynamic stiffness from zero, and vectorized steps take half the time of a library call for each system.
    n = len(matrix)
    if n == 1:
        return np.asarray(side / matrix[0])
    work = np.concatenate([matrix, side], axis=1)
    for k in range(n):
        work[k, k + 1 :] /= work[k, k]
        for row in range(k + 1, n):
            work[row, k + 1 :] -= work[row, k] * work[k, k + 1 :]
    for k in range(n - 1, 0, -1):
        for row in range(k):
            work[row, n:] -= work[row, k] * work[k, n:]
    return work[:, n:]


def _product(rows: FloatArray, columns: ComplexArray) -> ComplexArray:
    # Shapes (m, n) and (n, ...) to (m, ...), in half the time of `np.tensordot` with a real factor.
    flat = np.ascontiguousarray(columns).reshape(len(columns), -1).view(np.float64)
    return (rows @ flat).view(np.complex128).reshape(len(rows), *columns.shape[1:])


class LinearRig:
    """The frequency response of a rig's linear part in one configuration, as a function of its parameters."""

    def __init__(self, model: RigModel, configuration: str) -> None:
        self._model = model
        self._basis, _, base_damping, base_stiffness = linear_part(model, configuration)
        self._links = np.array([weights_of(model, link) for link in model.links]).reshape(-1, len(model.bodies))
        self._rubs = np.array([weights_of(model, c) for c in model.contacts]).reshape(-1, len(model.bodies))
        # What a lock adds.
        own = [np.array([getattr(link, key) for link in model.links]) for key in ("damping", "stiffness")]
        self._damping, self._stiffness = (
            total - np.einsum("l,la,lb->ab", values, self._links, self._links)
            for total, values in zip((base_damping, base_stiffness), own, strict=True)
        )
        self._imposed = imposed_coordinates(model, self._basis)
        self._loose = np.setdiff1d(np.arange(self._basis.shape[1]), list(self._imposed.values()))
        self._pushes = pushes_of(model)
        # What each body, link and lock adds to the matrices of the free coordinates, shape (free, free, bodies) and so on.
        along = (self._links @ self._basis).T
        self._of_body = self._basis.T[:, None] * self._basis.T
        self._of_link = along[:, None] * along
        self._of_lock = [(self._basis.T @ matrix @ self._basis)[..., None] for matrix in (self._damping, self._stiffness)]

    def free_motion(self, omega: FloatArray, values: Parameters, pushes: FloatArray | None = None) -> FreeMotion:
        """The motion without dampers in the contacts; `omega` in rad/s, shape (frequencies,) or (sets, frequencies).

        `pushes` are the forces on the bodies per unit of each drive's channel, shape (bodies, drives, sets); None: as described.
        """
        s, shape = 1j * omega, (values.mass.shape[1], omega.shape[-1])
        mass = (self._of_body @ values.mass)[..., None]
        damping, stiffness = (
            (of_lock + self._of_link @ each)[..., None]
            for of_lock, each in zip(self._of_lock, (values.damping, values.stiffness), strict=True)
        )
        force = np.empty((*mass.shape[:2], *shape), dtype=np.complex128)
        force.real, force.imag = stiffness - mass * omega**2, damping * omega
        across = self._rubs @ self._basis
        z = np.zeros((len(force), len(self._model.drives) + len(across), *shape), dtype=np.complex128)
        for k, drive in enumerate(self._model.drives):
            if drive.imposes is not None:
                z[self._imposed[drive.imposes], k] = 1.0 / s ** MOTION.get(drive.quantity, 0)
        held, loose = np.array([*self._imposed.values()], np.intp), self._loose
        pushed = np.tensordot(self._basis.T, self._pushes[..., None] if pushes is None else pushes, 1)
        of_contacts = np.broadcast_to(across.T[..., None], (*across.T.shape, pushed.shape[-1]))
        side = np.concatenate([pushed, of_contacts], axis=1)[loose][..., None]
        given: ComplexArray = np.einsum("ph...,hk...->pk...", force[np.ix_(loose, held)], z[held])
        z[loose] = _solved(force[np.ix_(loose, loose)], side - given)
        x, velocity = _product(self._basis, z), _product(across, z) * s
        drives = len(self._model.drives)
        return FreeMotion(x=x[:, :drives], moved=x[:, drives:], velocity=velocity[:, :drives], mobility=velocity[:, drives:])

    def motion(self, omega: FloatArray, values: Parameters, free: FreeMotion | None = None) -> ComplexArray:
        """Displacement of all bodies per unit of each drive's channel, shape (bodies, drives, sets, frequencies)."""
        free = self.free_motion(omega, values) if free is None else free
        if not len(self._rubs):
            return free.x
        rubbed = values.friction[:, None, :, None] * free.rubbing(values.friction)
        return np.asarray(free.x - np.einsum("bc...,cd...->bd...", free.moved, rubbed))

    def responses(
        self, omega: FloatArray, values: Parameters, free: FreeMotion | None = None, places: FloatArray | None = None
    ) -> ComplexArray:  # fmt: skip
        """Sensors' records per unit of each drive's channel, shape (responses, drives, sets, frequencies).

        `free` is the motion without dampers in the contacts, computed if None; `places` are the weights of the bodies in each
        sensor's motion, shape (responses, bodies, sets), as described if None.
        """
        x, s = self.motion(omega, values, free), np.asarray(1j * omega)
        rows = []
        for k, sensor in enumerate(self._model.sensors):
            if sensor.force_in is None:
                along = weights_of(self._model, sensor)
                seen = _product(along[None], x)[0] if places is None else np.einsum("bs,bdsg->dsg", places[k], x)
                row = seen * s ** MOTION[sensor.quantity]
            else:
                row = self._force(sensor.force_in, x, s, values)
            rows.append(row * sensor.chain.gain)
        return np.stack(rows)

    def _force(self, place: str, x: ComplexArray, s: ComplexArray, values: Parameters) -> ComplexArray:
        kind, name = place.split(".", 1)
        names = {"links": [link.name for link in self._model.links], "contacts": [c.name for c in self._model.contacts]}
        if kind == "links":
            k = names["links"].index(name)
            ends = (self._model.links[k].a, self._model.links[k].b)
            total = (values.stiffness[k, :, None] + values.damping[k, :, None] * s) * np.tensordot(self._links[k], x, 1)
            for j, contact in enumerate(self._model.contacts):
                if (contact.a, contact.b) == ends:
                    total = total + values.friction[j, :, None] * s * np.tensordot(self._rubs[j], x, 1)
            return np.asarray(total)
        if kind == "contacts":
            j = names["contacts"].index(name)
            return np.asarray(values.friction[j, :, None] * s * np.tensordot(self._rubs[j], x, 1))
        body = next(d.imposes for d in self._model.drives if d.channel == name)
        row = [b.name for b in self._model.bodies].index(body or GROUND)
        mass, damping, stiffness = (matrix[row, :, :, None] for matrix in self._matrices(values))
        total = np.einsum("bsg,bdsg->dsg", mass * s**2 + damping * s + stiffness, x)
        return np.asarray(total - self._pushes[row][:, None, None])

    def _matrices(self, values: Parameters) -> tuple[FloatArray, FloatArray, FloatArray]:
        # Mass, damping and stiffness, shape (bodies, bodies, sets).
        c = self._damping[..., None] + np.einsum("ls,la,lb->abs", values.damping, self._links, self._links)
        c = c + np.einsum("ls,la,lb->abs", values.friction, self._rubs, self._rubs)
        k = self._stiffness[..., None] + np.einsum("ls,la,lb->abs", values.stiffness, self._links, self._links)
        return np.eye(len(values.mass))[..., None] * values.mass, c, k


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """The numbers of a rig's linear part: kg, N/m and N s/m by body, link and contact, shapes (bodies, sets) and so on."""

    mass: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    friction: FloatArray


def given_parameters(model: RigModel) -> Parameters:
    """Those of a description, one set; undamped links get `LEAST_DAMPING`, contacts no damper yet."""
    heaviest = max(body.mass for body in model.bodies)
    stiffness = np.array([link.stiffness for link in model.links])
    least = 2.0 * LEAST_DAMPING * np.sqrt(stiffness * heaviest)
    damping = np.maximum([link.damping for link in model.links], least)
    return Parameters(
        mass=np.array([[body.mass] for body in model.bodies]), stiffness=stiffness[:, None], damping=damping[:, None],
        friction=np.zeros((len(model.contacts), 1)),
    )  # fmt: skip


def dampers(
    free: FreeMotion, values: Parameters, spectrum: Spectrum, forces: FloatArray, scale: FloatArray,
    near: FloatArray | None = None,
) -> FloatArray:  # fmt: skip
    """Dampers in N s/m with the power of dry friction of these forces in N, both of shape (contacts, sets).

    Parameters
    ----------
    free, values
        The rig's motion without them, and its other parameters.
    spectrum
        The run.
    forces
        Friction force of each contact.
    scale
        Factor for each drive's record, shape (drives, sets).
    near
        Dampers for similar parameters, shape (contacts, 1), which save iterations.
    """
    if not forces.any():
        return np.zeros_like(forces)
    free = replace(free, velocity=free.velocity * scale[:, :, None])

    def wanted(log_damper: FloatArray) -> FloatArray:
        # What the velocities with these dampers require.
        mean = spectrum.predicted(free.rubbing(np.exp(log_damper))).sum(axis=-1) * spectrum.square
        new = np.sqrt(2.0 / np.pi) * forces / np.sqrt(np.maximum(mean, 1e-300))
        return np.asarray(np.log(np.clip(new, 1e-12, 1e12)))

    # The secant method for each contact, from a step halfway.
    weak = 1e-3 * np.sqrt(values.stiffness.max(initial=1.0) * values.mass.max())
    at = np.log(np.clip(weak if near is None else near, 1e-12, 1e12)) + np.zeros_like(forces)
    off = wanted(at) - at
    step = 0.5 * off
    for _ in range(ROUNDS):
        at = at + np.clip(step, -FARTHEST, FARTHEST)
        now = wanted(at) - at
        if np.abs(now).max() < SETTLED:
            break
        slope = (now - off) / np.where(step == 0.0, 1.0, np.clip(step, -FARTHEST, FARTHEST))
        # More damping means less motion, which requires more damping: the slope lies between -1, where friction hardly changes
        # the motion, and 0, where it holds the bodies.
        off, step = now, np.where(slope < -0.2, -now / np.where(slope < -0.2, slope, -1.0), 0.5 * now)
    return np.asarray(np.where(forces > 0.0, np.exp(at), 0.0))


def friction_level(law: object) -> float:
    """The level of a friction law, N; 0 if it has none."""
    found = [getattr(law, key, None) for key in ("friction_force", "forward_force", "backward_force")]
    levels = [value for value in found if isinstance(value, float)]
    return float(np.mean(levels)) if levels else 0.0
