"""Power of the responses that a rig's linear part predicts for recorded drives, in bands, for any parameters.

No simulation and no fit over time: the responses to sinusoids, with dry friction as the viscous damper that takes the same
power from Gaussian motion (statistical linearization; Roberts and Spanos, Random Vibration and Statistical Linearization, 1990).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from isorig.analysis.campaign import MOTION, ComplexArray, FloatArray, IntArray, Run
from isorig.analysis.model.rig_model import GROUND, RigModel, direction
from isorig.analysis.simulate.compiled import imposed_coordinates, linear_part

#: Frequency bins are averaged to this many groups, evenly spaced in log frequency: an octave then has 80 to 150.
GROUPS = 600
#: Bands in an octave in which power is compared.
PER_OCTAVE = 3
#: Share of the largest power of a drive below which a frequency is not driven.
DRIVEN = 1e-4
#: Power relative to the sensor's noise below which a frequency is left out.
ABOVE_NOISE = 10.0
#: Share of a link's critical damping that an undamped link gets, so that a fit can increase it.
LEAST_DAMPING = 1e-3
#: Most iterations of the damper that replaces dry friction, the change of its logarithm below which they end, and the largest
#: change in one of them.
ROUNDS, SETTLED, FARTHEST = 15, 1e-6, 3.0


@dataclass(frozen=True, kw_only=True)
class Spectrum:
    """Spectra of a run at the driven frequencies.

    Parameters
    ----------
    run
        The run.
    omega
        rad/s, shape (groups,).
    drives
        Cross spectra of the drives, summed within each group, shape (groups, drives, drives).
    across
        Cross spectra of drives (conjugate) and responses, shape (groups, drives, responses).
    power
        Power of the responses, shape (groups, responses); NaN where the sensor's noise dominates.
    band
        Index of the band of each group, shape (groups,).
    square
        Factor from a sum of power over all groups to the mean square of the record.
    """

    run: Run
    omega: FloatArray
    drives: ComplexArray
    across: ComplexArray
    power: FloatArray
    band: IntArray
    square: float


def spectrum_of(model: RigModel, run: Run, samples: int, noise: Mapping[str, float]) -> Spectrum | None:
    """Spectra of the first samples of a run; None if it has no driven frequency.

    Parameters
    ----------
    model
        The rig, whose drives and sensors are the channels.
    run, samples
        The run, and the number of samples.
    noise
        Standard deviation of the channels' sensor noise.
    """
    window = np.hanning(samples)

    def lines(channel: str) -> ComplexArray:
        values = run.channel(channel).read(0, samples)
        return np.asarray(np.fft.rfft((values - values.mean()) * window))

    drives = np.stack([lines(drive.channel) for drive in model.drives])
    responses = np.stack([lines(sensor.channel) for sensor in model.sensors])
    frequency = np.fft.rfftfreq(samples, 1.0 / run.sample_rate)
    low, high = run.band or (0.0, 0.5 * run.sample_rate)
    inside = (frequency > max(low, 3.0 * run.sample_rate / samples)) & (frequency < min(high, 0.4 * run.sample_rate))
    if inside.sum() < 2:
        return None
    edges = np.geomspace(frequency[inside][0], frequency[inside][-1] * 1.000001, GROUPS + 1)
    group = np.searchsorted(edges, frequency[inside], side="right") - 1
    _, group = np.unique(group, return_inverse=True)
    count = np.bincount(group).astype(np.float64)

    def summed(products: ComplexArray) -> ComplexArray:
        found = np.zeros((len(count), *products.shape[1:]), dtype=np.complex128)
        np.add.at(found, group, products)
        return np.asarray(found)

    u, y = drives[:, inside].T, responses[:, inside].T
    of_drives = summed(u[:, :, None].conj() * u[:, None, :])
    power = summed(np.abs(y) ** 2 + 0j).real
    own = np.einsum("gdd->gd", of_drives).real / count[:, None]
    driven = (own > DRIVEN * own.max(axis=0)).any(axis=1) & own.any(axis=1)
    if not driven.any():
        return None
    levels = np.array([noise.get(sensor.channel, 0.0) for sensor in model.sensors]) ** 2 * float(window @ window)
    power[power < ABOVE_NOISE * levels * count[:, None]] = np.nan
    middle = np.bincount(group, frequency[inside]) / count
    across = summed(u[:, :, None].conj() * y[:, None, :])
    return Spectrum(
        run=run, omega=2.0 * np.pi * middle[driven], drives=of_drives[driven], across=across[driven], power=power[driven],
        band=np.floor(PER_OCTAVE * np.log2(middle[driven])).astype(np.int64),
        square=2.0 / (samples * float(window @ window)),
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class FreeMotion:
    """The motion of a rig's linear part without dampers in its contacts.

    Parameters
    ----------
    x, velocity
        Displacement of the bodies and velocity in the contacts per unit of each drive's channel, shapes (frequencies, bodies,
        drives) and (frequencies, contacts, drives).
    moved, mobility
        The same per unit of a force in each contact, shapes (frequencies, bodies, contacts), (frequencies, contacts, contacts).
    """

    x: ComplexArray
    velocity: ComplexArray
    moved: ComplexArray
    mobility: ComplexArray

    def rubbing(self, dampers: FloatArray) -> ComplexArray:
        """Velocity in the contacts with dampers in N s/m, shape (contacts,), there (Woodbury's identity)."""
        if len(dampers) == 1:
            return np.asarray(self.velocity / (1.0 + self.mobility * dampers))
        return np.asarray(np.linalg.solve(np.eye(len(dampers)) + self.mobility * dampers, self.velocity))


class LinearRig:
    """The frequency response of a rig's linear part in one configuration, as a function of its parameters."""

    def __init__(self, model: RigModel, configuration: str) -> None:
        self._model = model
        self._basis, _, base_damping, base_stiffness = linear_part(model, configuration)
        self._links = np.array([direction(model, link.a, link.b, link.arms) for link in model.links]).reshape(
            -1, len(model.bodies)
        )
        self._rubs = np.array([direction(model, c.a, c.b, c.arms) for c in model.contacts]).reshape(-1, len(model.bodies))
        # What a lock adds.
        own = [np.array([getattr(link, key) for link in model.links]) for key in ("damping", "stiffness")]
        self._damping, self._stiffness = (
            total - np.einsum("l,la,lb->ab", values, self._links, self._links)
            for total, values in zip((base_damping, base_stiffness), own, strict=True)
        )
        self._imposed = imposed_coordinates(model, self._basis)
        self._loose = np.setdiff1d(np.arange(self._basis.shape[1]), list(self._imposed.values()))

    @cached_property
    def _pushes(self) -> FloatArray:
        return np.array([[d.pushes.get(b.name, 0.0) * d.factor for d in self._model.drives] for b in self._model.bodies])

    def free_motion(self, omega: FloatArray, values: Parameters) -> FreeMotion:
        """The motion without dampers in the contacts."""
        s = np.asarray(1j * omega)[:, None, None]
        force = self._dynamic(s, replace(values, friction=np.zeros(len(self._rubs))))
        z = np.zeros((len(s), self._basis.shape[1], len(self._model.drives)), dtype=np.complex128)
        for k, drive in enumerate(self._model.drives):
            if drive.imposes is not None:
                z[:, self._imposed[drive.imposes], k] = 1.0 / (1j * omega) ** MOTION.get(drive.quantity, 0)
        held, loose = list(self._imposed.values()), self._loose
        side = (self._basis.T @ self._pushes)[None] - force[:, :, held] @ z[:, held]
        across = self._rubs @ self._basis
        pushed = np.broadcast_to(across[:, loose].T, (len(s), len(loose), len(across)))
        solved = np.linalg.solve(force[:, loose[:, None], loose[None, :]], np.concatenate([side[:, loose], pushed], axis=2))
        drives = z.shape[2]
        z[:, loose] = solved[:, :, :drives]
        moved = np.zeros((len(s), z.shape[1], len(across)), dtype=np.complex128)
        moved[:, loose] = solved[:, :, drives:]
        return FreeMotion(x=self._basis @ z, moved=self._basis @ moved, velocity=across @ z * s, mobility=across @ moved * s)

    def motion(self, omega: FloatArray, values: Parameters, free: FreeMotion | None = None) -> ComplexArray:
        """Displacement of all bodies per unit of each drive's channel, shape (frequencies, bodies, drives)."""
        free = self.free_motion(omega, values) if free is None else free
        return np.asarray(free.x - free.moved @ (values.friction[:, None] * free.rubbing(values.friction)))

    def responses(self, omega: FloatArray, values: Parameters, free: FreeMotion | None = None) -> ComplexArray:
        """Sensors' records per unit of each drive's channel, shape (frequencies, responses, drives).

        `free` is the motion without dampers in the contacts; computed if None.
        """
        x, s = self.motion(omega, values, free), np.asarray(1j * omega)[:, None]
        rows = []
        for sensor in self._model.sensors:
            if sensor.force_in is None:
                along = direction(self._model, sensor.body, sensor.relative_to, sensor.arms)
                row = (along @ x) * s ** MOTION[sensor.quantity]
            else:
                row = self._force(sensor.force_in, x, s, values)
            rows.append(row * sensor.chain.gain)
        return np.stack(rows, axis=1)

    def _force(self, place: str, x: ComplexArray, s: ComplexArray, values: Parameters) -> ComplexArray:
        kind, name = place.split(".", 1)
        names = {"links": [link.name for link in self._model.links], "contacts": [c.name for c in self._model.contacts]}
        if kind == "links":
            k = names["links"].index(name)
            ends = (self._model.links[k].a, self._model.links[k].b)
            total = (values.stiffness[k] + values.damping[k] * s) * (self._links[k] @ x)
            for j, contact in enumerate(self._model.contacts):
                if (contact.a, contact.b) == ends:
                    total = total + values.friction[j] * s * (self._rubs[j] @ x)
            return np.asarray(total)
        if kind == "contacts":
            j = names["contacts"].index(name)
            return np.asarray(values.friction[j] * s * (self._rubs[j] @ x))
        body = next(d.imposes for d in self._model.drives if d.channel == name)
        row = [b.name for b in self._model.bodies].index(body or GROUND)
        mass, damping, stiffness = self._matrices(values)
        total = (mass[row] * s[:, :, None] ** 2 + damping[row] * s[:, :, None] + stiffness[row])[:, 0]
        return np.asarray(np.einsum("gb,gbd->gd", total, x) - self._pushes[row])

    def _matrices(self, values: Parameters) -> tuple[FloatArray, FloatArray, FloatArray]:
        c = self._damping + np.einsum("l,la,lb->ab", values.damping, self._links, self._links)
        c = c + np.einsum("l,la,lb->ab", values.friction, self._rubs, self._rubs)
        k = self._stiffness + np.einsum("l,la,lb->ab", values.stiffness, self._links, self._links)
        return np.diag(values.mass), c, k

    def _dynamic(self, s: ComplexArray, values: Parameters) -> ComplexArray:
        m, c, k = (self._basis.T @ matrix @ self._basis for matrix in self._matrices(values))
        return np.asarray(m * s**2 + c * s + k)


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """The numbers of a rig's linear part: kg, N/m and N s/m by body, link and contact;"""

    mass: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    friction: FloatArray


def given_parameters(model: RigModel) -> Parameters:
    """Those of a description; undamped links get `LEAST_DAMPING`, contacts no damper yet."""
    heaviest = max(body.mass for body in model.bodies)
    stiffness = np.array([link.stiffness for link in model.links])
    least = 2.0 * LEAST_DAMPING * np.sqrt(stiffness * heaviest)
    return Parameters(
        mass=np.array([body.mass for body in model.bodies]), stiffness=stiffness,
        damping=np.maximum([link.damping for link in model.links], least), friction=np.zeros(len(model.contacts)),
    )  # fmt: skip


def dampers(
    free: FreeMotion, values: Parameters, spectrum: Spectrum, forces: Sequence[float], scale: FloatArray,
    near: FloatArray | None = None,
) -> FloatArray:  # fmt: skip
    """Dampers in N s/m with the power of dry friction of these forces in N, shape (contacts,).

    Parameters
    ----------
    free, values
        The rig's motion without them, and its other parameters.
    spectrum
        The run.
    forces
        Friction force of each contact.
    scale
        Factor for each drive's record, shape (drives,).
    near
        Dampers for similar parameters, which save iterations.
    """
    level = np.array(forces)
    if not level.any():
        return np.zeros_like(level)
    driven = spectrum.drives * scale[:, None] * scale[None, :]

    def wanted(log_damper: FloatArray) -> FloatArray:
        # What the velocities with these dampers require.
        v = free.rubbing(np.exp(log_damper))
        mean = np.einsum("gcd,gde,gce->c", v.conj(), driven, v).real * spectrum.square
        new = np.sqrt(2.0 / np.pi) * level / np.sqrt(np.maximum(mean, 1e-300))
        return np.asarray(np.log(np.clip(new, 1e-12, 1e12)))

    # The secant method for each contact, from a step halfway.
    weak = 1e-3 * np.sqrt(values.stiffness.max(initial=1.0) * values.mass.max())
    at = np.log(np.full(len(level), weak) if near is None else np.clip(near, 1e-12, 1e12))
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
    return np.asarray(np.where(level > 0.0, np.exp(at), 0.0))
