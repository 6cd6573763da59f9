"""Inverse dynamics: the drive force from the measured motion, for rigs with bodies that no spring holds.

A simulated run of such a rig drifts away from the measurement. The measured force is therefore compared with the force from the
equations of motion: positions through a zero-phase low-pass, differentiated, then both forces decimated in the same way
(Gautier, Janot and Vandanjon 2013, IEEE Trans. Control Syst. Technol. 21, 428). Where a velocity is not resolved, a dry contact
may stick: it transmits any force between those of slow sliding in both directions, so the drive is only known within their range.

The drive follows from the momentum of the pushed body, and also from that of the pushed body with those joined to it, each by as
much as it moves with it (a gear): the smaller the group, the more of the joints between the bodies it shows; the larger, the less
of their deflections' noise it contains. The deflection between two recorded velocities is the small difference of two integrals,
of which any error of a zero or of a gain is a large part. Its slow part is therefore taken as the one with which the slow part of
the drive agrees.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.derivative import derivative
from isorig.analysis.errors import SimulationError
from isorig.analysis.laws.base import NO_LINK
from isorig.analysis.lowpass import low_passed
from isorig.analysis.model.linear import ROUNDED, moving_together
from isorig.analysis.model.rig_model import Chain, Contact, Link, RigModel, single_drive, weights_by_body, weights_of
from isorig.analysis.simulate.free_run import delivered
from isorig.analysis.simulate.sampling import shift

#: Corner frequency of the low-pass in multiples of the sample rate after decimation, its order, and the decimation factors, of
#: which the first one is used whose low-pass leaves little noise. Chosen: 0.08 of the sample rate as in the source for the first.
CORNER = 0.8
ORDER = 8
DECIMATIONS = (10, 20, 40, 80)
#: A velocity is resolved from this many standard deviations of its noise on. Chosen: its sign is then right.
RESOLVED = 3.0
#: Largest number of corrections of a deflection's slow part, each as if its link were linear. Chosen: a spring that softens to a
#: quarter of its stiffness leaves a tenth of the error after eight.
CORRECTIONS = 8
#: Number of decimated samples dropped at each end.
EDGE = 20


@dataclass(frozen=True, kw_only=True)
class Motion:
    """The recorded motion of a rig; arrays of shape (n,)."""

    #: Of each body by name, m, m/s, m/s^2.
    position: Mapping[str, FloatArray]
    velocity: Mapping[str, FloatArray]
    acceleration: Mapping[str, FloatArray]
    sample_rate: float  #: Hz.
    drive: FloatArray  #: The drive channel's record.
    blur: Mapping[str, float] = field(default_factory=dict)  #: Standard deviation of the noise of each body's velocity, m/s.
    channels: Mapping[str, str] = field(default_factory=dict)  #: The channel that records each body.
    #: Sets of bodies from whose momentum the drive is computed; empty for the pushed body alone.
    groups: tuple[tuple[str, ...], ...] = ()
    decimation: int = DECIMATIONS[0]  #: Factor between the sample rates of the motion and of the computed drive.
    #: By link between two bodies whose velocities are recorded: the frequency in Hz below which its deflection is unknown.
    unknown: Mapping[str, float] = field(default_factory=dict)


def motion_from(
    positions: Mapping[str, FloatArray], rate: float, drive: FloatArray, decimation: int = DECIMATIONS[0]
) -> Motion:  # fmt: skip
    """Low-pass filter the positions of each body, and differentiate them twice; the noise of the velocities is not known."""
    from scipy.signal import butter, sosfiltfilt

    sections = butter(ORDER, CORNER / decimation * rate, fs=rate, output="sos")
    position = {body: np.asarray(sosfiltfilt(sections, values)) for body, values in positions.items()}
    velocity = {body: derivative(values, rate) for body, values in position.items()}
    acceleration = {body: derivative(values, rate) for body, values in velocity.items()}
    return Motion(
        position=position, velocity=velocity, acceleration=acceleration, sample_rate=rate, drive=drive, decimation=decimation
    )  # fmt: skip


def position_from(velocity: FloatArray, rate: float) -> FloatArray:
    """Position in m, from that at the start of a record of a velocity in m/s at a rate in Hz, shape (n,)."""
    from scipy.integrate import cumulative_trapezoid

    return np.asarray(cumulative_trapezoid(velocity, dx=1.0 / rate, initial=0))


def decimated(values: FloatArray, decimation: int) -> FloatArray:
    """Records, shape (..., n), decimated by one of `DECIMATIONS` without delay, without the filter transients at their ends."""
    from scipy.signal import sosfiltfilt

    once = DECIMATIONS[0]  # a filter for a larger factor at once is inaccurate
    for factor in (once, *[2] * round(np.log2(decimation / once))):
        values = np.asarray(sosfiltfilt(_antialias(factor), values))[..., ::factor]
    return values[..., EDGE:-EDGE]


@cache
def _antialias(factor: int) -> FloatArray:
    # The low-pass of scipy.signal.decimate, which designs it at each call.
    from scipy.signal import cheby1

    return np.asarray(cheby1(8, 0.05, 0.8 / factor, output="sos"))


def driven_groups(model: RigModel) -> tuple[tuple[str, ...], ...]:
    """The pushed body, and growing sets of it and the bodies that links or contacts join to it."""
    names = [body.name for body in model.bodies if body.name not in model.imposed]
    group = {name for name, weight in model.drive.pushes.items() if weight}
    found = []
    while group:
        found.append(tuple(name for name in names if name in group))
        joined = {name for joint in model.joints if joint.joined & group for name in joint.joined} & set(names)
        group = group | joined if joined - group else set()
    return tuple(found)


def required_drive(model: RigModel, motion: Motion) -> FloatArray:
    """The drive channel's record computed from a motion, decimated, for each group of bodies, shape (groups, n).

    Raises SimulationError if the motion does not determine the drive: a body is not measured, a channel has a fault other than a
    gain, a delay or, of the drive, an offset; or several bodies are driven.
    """
    single_drive(model, "a rig that is judged by its drive")
    pushed = [name for name, weight in model.drive.pushes.items() if weight]
    unseen = [body.name for body in model.bodies if body.name not in motion.position]
    faults = [sensor.chain != Chain(gain=sensor.chain.gain, delay=sensor.chain.delay) for sensor in model.sensors]
    chain = model.drive.chain
    faults.append(chain != Chain(gain=chain.gain, delay=chain.delay, offset=chain.offset))
    unused = [sensor.chain != Chain() for sensor in model.sensors if sensor.channel not in motion.channels.values()]
    if len(pushed) != 1 or unseen or any(faults) or any(unused):
        raise SimulationError(f"the rig {model.name!r} cannot be judged by its drive; every body must be measured, one be pushed")
    motion = _without_faults(motion, {sensor.channel: sensor.chain for sensor in model.sensors})
    scale, rate = chain.gain / (model.drive.factor * model.drive.pushes[pushed[0]]), motion.sample_rate
    command = shift((motion.drive - chain.offset) / chain.gain, -chain.delay, rate)
    recorded = command * chain.gain / scale
    acting = delivered(model.drive, command, rate) * chain.gain / scale
    # Errors are shares of what acts: a drive that delivers hardly anything of its command must not seem to fit.
    size = 1.0 if model.drive.acts_as_recorded else float(np.std(recorded)) / max(float(np.std(acting)), 1e-300)
    needed = [_balanced(model, motion, group, acting) for group in motion.groups or (tuple(pushed),)]
    errors = (size * (np.clip(acting, *ends) - acting) for ends in needed)
    drives = [shift(scale * (recorded + error), chain.delay, rate) + chain.offset for error in errors]
    return decimated(np.stack(drives), motion.decimation)


def _balanced(model: RigModel, motion: Motion, group: Sequence[str], acting: FloatArray) -> tuple[FloatArray, FloatArray]:
    # Least and largest force that moves a group of bodies as recorded; where the records do not tell the slow part of the
    # deflection of the link that joins it to the others, that part is as the acting force requires it.
    weights = moving_together(model, group, next(name for name, weight in model.drive.pushes.items() if weight))
    needed = _needed(model, motion, weights, {})
    signs = [(link, float(weights @ weights_of(model, link))) for link in model.links]
    joining = [(link, sign) for link, sign in signs if link.name in motion.unknown and abs(sign) > ROUNDED]
    if len(joining) != 1 or joining[0][0].stiffness <= 0.0:
        return needed
    ((link, sign),), slow, least = joining, np.zeros(len(acting)), np.inf
    for _ in range(CORRECTIONS):
        left = low_passed(acting - np.clip(acting, *needed), motion.sample_rate, motion.unknown[link.name])
        power = float(np.mean(left**2))
        if power >= least:
            break
        least, best = power, needed
        slow = slow + left / (sign * link.stiffness)
        needed = _needed(model, motion, weights, {link.name: slow})
    return best


def _needed(
    model: RigModel, motion: Motion, weights: FloatArray, slow: Mapping[str, FloatArray]
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    # Least and largest force that moves bodies with these weights as recorded; `slow` parts are added to the deflections of these
    # links.
    inertia = [w * body.mass * motion.acceleration[body.name] for body, w in zip(model.bodies, weights, strict=True) if w]
    least = np.sum(inertia, axis=0)
    most = least.copy()
    for part in model.joints:
        sign = float(weights @ weights_of(model, part))
        if abs(sign) < ROUNDED:
            continue  # its forces on both ends cancel, or act elsewhere
        ends = [sign * resistance for resistance in _resistances(model, motion, part, slow.get(part.name, 0.0))]
        least += np.minimum(*ends)
        most += np.maximum(*ends)
    return least, most


def _without_faults(motion: Motion, chains: Mapping[str, Chain]) -> Motion:
    # The true motion of bodies whose sensors have a gain or a delay.
    faulty = {body: chains[channel] for body, channel in motion.channels.items() if chains[channel] != Chain()}
    if not faulty:
        return motion

    def true(records: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        return {
            body: shift(values, -faulty[body].delay, motion.sample_rate) / faulty[body].gain if body in faulty else values
            for body, values in records.items()
        }

    return replace(
        motion, position=true(motion.position), velocity=true(motion.velocity), acceleration=true(motion.acceleration)
    )  # fmt: skip


def _resistances(
    model: RigModel, motion: Motion, part: Link | Contact, slow: FloatArray | float
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    # Force against the motion, and where the velocity is not resolved, that of slow sliding backward and forward.
    weights = weights_by_body(model, part)
    d, v = (np.sum([w * of[name] for name, w in weights.items()], axis=0) for of in (motion.position, motion.velocity))
    elongation = d + slow
    blur = RESOLVED * float(np.linalg.norm([w * motion.blur.get(name, 0.0) for name, w in weights.items()]))
    unresolved = np.abs(v) < blur
    laws = part.laws if isinstance(part, Link) else (part.law,)
    constants = model.constants_of(part) if isinstance(part, Link) else NO_LINK
    backward = forward = part.stiffness * elongation + part.damping * v if isinstance(part, Link) else np.zeros(len(v))
    for law in laws:
        known = law.remembers or not unresolved.any()
        speeds = (v,) if known else (np.where(unresolved, -blur, v), np.where(unresolved, blur, v))
        ends = [law.along(elongation, speed, motion.sample_rate, constants) for speed in speeds]
        backward, forward = backward + ends[0], forward + ends[-1]
    return backward, forward
