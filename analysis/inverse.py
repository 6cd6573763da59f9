"""The force that a measured motion takes: how a rig is judged whose bodies no spring holds.

A free run of such a rig drifts, whatever its friction. Its motion is measured, so the drive follows from the equations of
motion: positions through a zero-phase low-pass, central differences, then force and prediction decimated alike
(Gautier, Janot and Vandanjon 2013, IEEE Trans. Control Syst. Technol. 21, 428).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from analysis import laws
from analysis.errors import SimulationError
from analysis.measured import FloatArray
from analysis.model import GROUND, Chain, Contact, Link, RigModel

#: Corner of the low-pass as a share of the sample rate, its order, and the decimation behind it.
CORNER = 0.08
ORDER = 4
DECIMATION = 10
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
    """Whether some body is held by no spring, directly or through others."""
    held = {GROUND}
    springs = [(link.a, link.b) for link in model.links if link.stiffness > 0.0]
    while True:
        grown = held | {b for a, b in springs if a in held} | {a for a, b in springs if b in held}
        if grown == held:
            return any(body.name not in held for body in model.bodies)
        held = grown


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
            force = force + (1.0 if name == link.a else -1.0) * _link_force(link, d, v)
    for contact in model.contacts:
        if name in (contact.a, contact.b):
            _, v = _relative(motion, contact)
            force = force + (1.0 if name == contact.a else -1.0) * _friction(contact.law, v, motion.sample_rate)
    return decimated(force / (model.drive.factor * model.drive.pushes[name]) + model.drive.chain.offset)


def _relative(motion: Motion, part: Link | Contact) -> tuple[FloatArray, FloatArray]:
    d, v = motion.position[part.a], motion.velocity[part.a]
    if part.b == GROUND:
        return d, v
    return d - motion.position[part.b], v - motion.velocity[part.b]


def _link_force(link: Link, d: FloatArray, v: FloatArray) -> FloatArray:
    force = link.stiffness * d + link.damping * v
    for law in link.laws:
        match law:
            case laws.Cubic():
                force = force + law.cubic_stiffness * d**3
            case laws.QuadraticDamping():
                force = force + law.quadratic_damping * v * np.abs(v)
            case laws.EndStop():
                beyond = np.sign(d) * np.maximum(np.abs(d) - law.stroke, 0.0)
                force = force + law.contact_stiffness * beyond + law.contact_damping * v * (beyond != 0.0)
            case _:
                raise SimulationError(f"the law {type(law).__name__} is not judged by force; use a rig that a spring holds")
    return force


def _friction(law: laws.FrictionLaw, v: FloatArray, rate: float) -> FloatArray:
    side, speed = np.sign(v), np.abs(v)
    match law:
        case laws.Viscous():
            return law.viscous_coefficient * v
        case laws.Coulomb():
            return law.friction_force * side
        case laws.Stribeck():
            ratio = (speed / law.stribeck_velocity) ** law.exponent
            fall = np.exp(-ratio) if law.shape == "exponential" else 1.0 / (1.0 + ratio)
            return np.asarray((law.friction_force + (law.static_force - law.friction_force) * fall) * side)
        case laws.Arctan():
            return np.asarray(2.0 / np.pi * law.friction_force * np.arctan(v / law.smoothing_velocity))
        case laws.Asymmetric():
            forward = law.forward_force + law.forward_viscosity * speed
            backward = law.backward_force + law.backward_viscosity * speed
            return np.asarray(np.where(v > 0.0, forward, np.where(v < 0.0, -backward, 0.0)))
        case laws.Dahl():
            return _dahl(law, v, rate)
        case _:
            raise SimulationError(f"the law {type(law).__name__} is not judged by force; use a rig that a spring holds")


def _dahl(law: laws.Dahl, v: FloatArray, rate: float) -> FloatArray:
    # Over a step of one direction the law is linear in the way: it decays towards the level of that direction.
    level = law.friction_force * np.sign(v)
    kept = np.exp(-law.bristle_stiffness * np.abs(v) / (law.friction_force * rate))
    force, out = 0.0, np.empty(len(v))
    for k in range(len(v)):
        force = level[k] + (force - level[k]) * kept[k]
        out[k] = force
    return out
