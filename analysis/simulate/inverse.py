"""The force that a measured motion takes: how a rig is judged whose bodies no spring holds.

A free run of such a rig drifts, whatever its friction. Its motion is measured, so the drive follows from the equations of
motion: positions through a zero-phase low-pass, central differences, then force and prediction decimated alike
(Gautier, Janot and Vandanjon 2013, IEEE Trans. Control Syst. Technol. 21, 428).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import SimulationError
from isorig.analysis.model.rig_model import GROUND, Chain, Contact, Link, RigModel, matrices, single_drive

#: Corner of the low-pass as a share of the sample rate, its order, and the decimation behind it.
CORNER = 0.08
ORDER = 4
DECIMATION = 10
#: A motion whose stiffness is this share of what its bodies have each by itself is held by no spring but rounding.
SLACK = 1e-12
#: Decimated samples at either end that are left out.
EDGE = 20


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Position (m), velocity and acceleration of each body by name, each shape (n,), and the sample rate in Hz."""

    position: Mapping[str, FloatArray]
    velocity: Mapping[str, FloatArray]
    acceleration: Mapping[str, FloatArray]
    sample_rate: float


def floats(model: RigModel) -> bool:
    """Whether some body is held by no spring, directly or through others: some motion stretches none of them."""
    if model.free_free:
        # Its accelerations are those of a free run, wherever it floats to.
        return False
    loose = [k for k, body in enumerate(model.bodies) if body.name not in model.imposed]
    if not loose:
        return False
    stiffness = matrices(model)[2][np.ix_(loose, loose)]
    size = np.sqrt(np.diag(stiffness))
    if not size.all():
        return True
    return bool(np.linalg.eigvalsh(stiffness / np.outer(size, size))[0] < SLACK)


def motion_from(positions: Mapping[str, FloatArray], rate: float) -> Motion:
    """Smooth positions by body, and differentiate them twice."""
    from scipy.signal import butter, sosfiltfilt

    sections = butter(ORDER, CORNER * rate, fs=rate, output="sos")
    position = {body: np.asarray(sosfiltfilt(sections, values)) for body, values in positions.items()}
    velocity = {body: np.gradient(values, 1.0 / rate) for body, values in position.items()}
    acceleration = {body: np.gradient(values, 1.0 / rate) for body, values in velocity.items()}
    return Motion(position=position, velocity=velocity, acceleration=acceleration, sample_rate=rate)


def decimated(values: FloatArray) -> FloatArray:
    """A record at a tenth of its rate, without delay and without the ends, where the filters have not settled."""
    from scipy.signal import decimate

    return np.asarray(decimate(values, DECIMATION, ftype="iir", zero_phase=True))[EDGE:-EDGE]


def required_drive(model: RigModel, motion: Motion) -> FloatArray:
    """What the drive's channel would have recorded for a motion, decimated.

    Raises
    ------
    SimulationError
        Where the model has what a motion does not tell: a body that nobody measured, a fault of a sensor.
    """
    single_drive(model, "a rig that is judged by its drive")
    pushed = [name for name, weight in model.drive.pushes.items() if weight]
    unseen = [body.name for body in model.bodies if body.name not in motion.position]
    faults = [sensor.chain != Chain() for sensor in model.sensors]
    # What is compared is the drive's own record: nothing else could witness a fault of its channel, but for an offset.
    faults.append(model.drive.chain != Chain(offset=model.drive.chain.offset))
    if len(pushed) != 1 or unseen or any(faults):
        raise SimulationError(f"the rig {model.name!r} cannot be judged by its drive; every body must be measured, one be pushed")
    name = pushed[0]
    force = model.body(name).mass * motion.acceleration[name]
    for link in model.links:
        if name in (link.a, link.b):
            d, v = _relative(motion, link)
            resistance = link.stiffness * d + link.damping * v
            for law in link.laws:
                resistance = resistance + law.along(d, v, motion.sample_rate, link.stiffness)
            force = force + (1.0 if name == link.a else -1.0) * resistance
    for contact in model.contacts:
        if name in (contact.a, contact.b):
            resistance = contact.law.along(*_relative(motion, contact), motion.sample_rate)
            force = force + (1.0 if name == contact.a else -1.0) * resistance
    return decimated(force / (model.drive.factor * model.drive.pushes[name]) + model.drive.chain.offset)


def _relative(motion: Motion, part: Link | Contact) -> tuple[FloatArray, FloatArray]:
    d, v = motion.position[part.a], motion.velocity[part.a]
    if part.b == GROUND:
        return d, v
    return d - motion.position[part.b], v - motion.velocity[part.b]
