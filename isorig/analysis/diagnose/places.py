"""Where the misfit of a partly measured rig can come from, without a simulation.

A fault at one place acts on the linear rig like one unknown force: in a link, on a body, or through the drive; a sensor's fault
adds to its record alone. At every frequency the misfit of all records must then be parallel to the rig's response to that force.
What a place cannot explain is the misfit's part across it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import MOTION, ComplexArray, FloatArray
from isorig.analysis.fitting.trials import Trial, expected
from isorig.analysis.model.linear import free_matrices
from isorig.analysis.model.rig_model import RigModel, weights_of

#: Share of the misfit's rms that the best place may leave to tell something. Chosen: half; a sound rig's noise leaves 0.8.
EXPLAINS = 0.5
#: Places that leave this many times what the best one leaves are excluded. Chosen: in 15 chains with a nonlinear spring or
#: damper the true place left least and the next wrong one 2.1 to 24 times as much; parameters biased by the fault blur this.
EXCLUDED = 2.0
#: Share of a place's largest response below which a frequency bin does not tell about it.
UNDETERMINED = 0.01
#: Most samples of a run that are used: more of them take time and tell the same.
ENOUGH = 2**15


@dataclass(frozen=True, kw_only=True)
class Places:
    """What each place leaves of the misfit."""

    bare: float  #: rms of the misfit in units of the sensors' noise.
    #: rms of its part that an unknown force at a place, or an unknown signal in a record, cannot explain: by the name of the
    #: link, body, or channel.
    left: Mapping[str, float]

    @property
    def possible(self) -> frozenset[str]:
        """The places that remain; empty if no single place explains the misfit."""
        best = min(self.left.values(), default=np.inf)
        if best > EXPLAINS * self.bare:
            return frozenset()
        return frozenset(name for name, left in self.left.items() if left <= EXCLUDED * best)

    def includes(self, location: str) -> bool:
        """Whether a cause may be there: a possible place, or one that was not compared."""
        return location in self.possible or location not in self.left


def compared_places(model: RigModel, trials: Sequence[Trial]) -> Places | None:
    """What each place of a rig leaves of the misfit of the fitted data; None if it is unknown.

    It is unknown for rigs with contacts, whose linear part alone is no model of them, with sensors of forces, or with fewer than
    two records.

    Parameters
    ----------
    model
        The fitted rig.
    trials
        The runs.
    """
    motions = all(sensor.force_in is None for sensor in model.sensors)
    if model.contacts or not motions or len(model.sensors) < 2 or any(trial.motion is not None for trial in trials):
        return None
    bare, count = 0.0, 0
    left: dict[str, float] = {}
    for trial in trials:
        lines, misfit = _misfit(model, trial)
        bare += float(np.sum(np.abs(misfit) ** 2))
        count += misfit.size
        for name, response in _responses(model, trial, lines).items():
            left[name] = left.get(name, 0.0) + _across(misfit, response)
    # One of the records' dimensions is spent at each frequency.
    spent = 1.0 - 1.0 / len(model.sensors)
    return Places(
        bare=float(np.sqrt(bare / count)), left={name: float(np.sqrt(power / count / spent)) for name, power in left.items()}
    )


def _misfit(model: RigModel, trial: Trial) -> tuple[FloatArray, ComplexArray]:
    # Frequency bins in rad/s, and the misfit there in units of the noise, shape (bins, channels).
    n = min(trial.fitted or trial.samples, ENOUGH)
    window = np.hanning(n)
    spectrum = np.fft.rfft((trial.measured - expected(model, trial))[:, :n] * window, axis=1)
    frequency = np.fft.rfftfreq(n, 1.0 / trial.sample_rate)
    kept = (frequency > 0.0) & (frequency <= min(trial.usable, trial.sample_rate / 2.0))
    scaled = spectrum[:, kept].T / (trial.noise * np.sqrt(np.sum(window**2)))
    return np.asarray(2.0 * np.pi * frequency[kept], dtype=np.float64), np.asarray(scaled, dtype=np.complex128)


def _responses(model: RigModel, trial: Trial, omega: FloatArray) -> dict[str, ComplexArray]:
    # Records, in units of the noise, per unit of an unknown force at each place, or of an unknown signal in a record.
    basis, mass, damping, stiffness = free_matrices(model, trial.run.configuration)
    names = [body.name for body in model.bodies]
    forces = {link.name: weights_of(model, link) for link in model.links}
    forces |= {name: np.eye(len(names))[k] for k, name in enumerate(names) if name not in model.imposed}
    for drive in model.drives:
        if drive.imposes is None:
            forces[drive.channel] = np.array([drive.pushes.get(name, 0.0) for name in names])
    s = 1j * omega[:, None, None]
    side = basis.T @ np.stack(list(forces.values()), axis=1)
    moved = basis @ np.linalg.solve(mass * s**2 + damping * s + stiffness, np.broadcast_to(side, (len(omega), *side.shape)))
    along = np.stack([weights_of(model, sensor) for sensor in model.sensors])
    order = np.array([MOTION[sensor.quantity] for sensor in model.sensors])
    gain = np.array([sensor.chain.gain for sensor in model.sensors])
    records = (along @ moved) * (s ** order[None, :, None]) * (gain / trial.noise)[None, :, None]
    found = {name: records[:, :, k] for k, name in enumerate(forces)}
    own = np.eye(len(model.sensors), dtype=np.complex128)
    return found | {sensor.channel: np.broadcast_to(own[k], records.shape[:2]) for k, sensor in enumerate(model.sensors)}


def _across(misfit: ComplexArray, response: ComplexArray) -> float:
    # Power of the misfit that is not parallel to a response.
    size = np.sum(np.abs(response) ** 2, axis=1)
    along = np.abs(np.sum(response.conj() * misfit, axis=1)) ** 2
    held = size > UNDETERMINED**2 * float(size.max())
    explained = np.divide(along, size, out=np.zeros_like(size), where=held)
    return float(np.sum(np.abs(misfit) ** 2) - np.sum(explained))
