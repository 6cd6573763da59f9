"""Inverse dynamics: the drive force from the measured motion, for rigs with bodies that no spring holds.

A simulated run of such a rig drifts away from the measurement. The measured force is therefore compared with the force from the
equations of motion: positions through a zero-phase low-pass, central differences, then both forces decimated in the same way
(Gautier, Janot and Vandanjon 2013, IEEE Trans. Control Syst. Technol. 21, 428).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import SimulationError
from isorig.analysis.model.rig_model import GROUND, Chain, Contact, Link, RigModel, single_drive

#: Corner frequency of the low-pass as a share of the sample rate, its order, and the decimation factor after it.
CORNER = 0.08
ORDER = 4
DECIMATION = 10
#: Number of decimated samples dropped at each end.
EDGE = 20


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Position (m), velocity and acceleration of each body by name, each shape (n,), and the sample rate in Hz."""

    position: Mapping[str, FloatArray]
    velocity: Mapping[str, FloatArray]
    acceleration: Mapping[str, FloatArray]
    sample_rate: float


def motion_from(positions: Mapping[str, FloatArray], rate: float) -> Motion:
    """Low-pass filter the positions of each body, and differentiate them twice."""
    from scipy.signal import butter, sosfiltfilt

    sections = butter(ORDER, CORNER * rate, fs=rate, output="sos")
    position = {body: np.asarray(sosfiltfilt(sections, values)) for body, values in positions.items()}
    velocity = {body: np.gradient(values, 1.0 / rate) for body, values in position.items()}
    acceleration = {body: np.gradient(values, 1.0 / rate) for body, values in velocity.items()}
    return Motion(position=position, velocity=velocity, acceleration=acceleration, sample_rate=rate)


def decimated(values: FloatArray) -> FloatArray:
    """A record decimated by `DECIMATION` without delay, without the filter transients at its ends."""
    from scipy.signal import decimate

    return np.asarray(decimate(values, DECIMATION, ftype="iir", zero_phase=True))[EDGE:-EDGE]


def required_drive(model: RigModel, motion: Motion) -> FloatArray:
    """The drive channel's record computed from a motion, decimated.

    Raises
    ------
    SimulationError
        If the motion does not determine the drive: a body is not measured, a sensor has a fault, or several bodies are driven.
    """
    single_drive(model, "a rig that is judged by its drive")
    pushed = [name for name, weight in model.drive.pushes.items() if weight]
    unseen = [body.name for body in model.bodies if body.name not in motion.position]
    faults = [sensor.chain != Chain() for sensor in model.sensors]
    # The drive's record itself is compared: of its channel's faults only an offset is identifiable.
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
                resistance = resistance + law.along(d, v, motion.sample_rate, model.constants_of(link))
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
