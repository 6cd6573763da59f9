"""The free run: a rig, a drive, and what the sensors would say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from analysis.errors import SimulationError
from analysis.measured import FloatArray
from analysis.model import RigModel, direction
from analysis.simulate.compiled import compile_rig
from analysis.simulate.kernel import run
from analysis.simulate.sampling import TAPS, Excitation, sampled, shift


@dataclass(frozen=True, kw_only=True)
class Response:
    """What the sensors would say: a record per sensor by channel, each shape (n,), at `sample_rate` Hz."""

    sample_rate: float
    channels: dict[str, FloatArray]


def record(model: RigModel, motion: Mapping[str, FloatArray], rate: float) -> dict[str, FloatArray]:
    """Put the faults of the measurement chains on true values, by channel; see `Chain`."""
    chains = {model.drive.channel: model.drive.chain, **{s.channel: s.chain for s in model.sensors}}
    out = {}
    for name, true in motion.items():
        chain = chains[name]
        y = chain.gain * shift(true, chain.delay, rate) if (chain.gain != 1.0 or chain.delay) else true
        if chain.offset:
            y = y + chain.offset
        for source, fraction in chain.crosstalk.items():
            if fraction:
                y = y + fraction * motion[source]
        if chain.limit is not None:
            y = np.clip(y, -chain.limit, chain.limit)
        out[name] = y
    return out


def true_drive(model: RigModel, excitation: Excitation) -> FloatArray:
    """The drive channel's true values, its own chain's offset, gain and delay undone."""
    chain = model.drive.chain
    return (shift(excitation.recorded, -chain.delay, excitation.sample_rate) - chain.offset) / chain.gain


def simulate(
    model: RigModel,
    excitation: Excitation,
    *,
    configuration: str = "unlocked",
    start_time: float = 0.0,
    as_recorded: bool = False,
    samples: int | None = None,
) -> Response:
    """The rig's free run from rest.

    Parameters
    ----------
    model
        The rig.
    excitation
        The drive channel as recorded; its own chain's gain and delay are undone.
    configuration
        How the rig is set up.
    start_time
        Seconds since the campaign began, for a stiffness that drifts.
    as_recorded
        Whether the faults of the sensors' chains are put on.
    samples
        Only the first samples; all where None.

    Raises
    ------
    SimulationError
        Where the motion grows without bound.
    """
    rate, over = excitation.sample_rate, excitation.oversample
    n = len(excitation.recorded) if samples is None else samples
    total = min((n + 2 * TAPS) * over, len(excitation.fine))
    h = 1.0 / (rate * over)
    compiled = compile_rig(model, configuration, h)
    phases = compiled.phases
    order = compiled.basis.shape[1]
    sense = np.zeros((len(model.sensors), 2 * order))
    for k, sensor in enumerate(model.sensors):
        place = slice(0, order) if sensor.quantity == "displacement" else slice(order, None)
        sense[k, place] = direction(model, sensor.body, sensor.relative_to, sensor.arms) @ compiled.basis
    motion = np.zeros((len(model.sensors), total))
    status = run(
        np.ascontiguousarray(_true_fine(model, excitation)[:total]),
        h,
        start_time,
        phases.system,
        phases.inputs,
        phases.step,
        phases.start,
        phases.end,
        compiled.directions,
        compiled.shares,
        compiled.compliance,
        phases.holding,
        compiled.codes,
        compiled.params,
        compiled.sticking,
        sense,
        motion,
        np.zeros(len(compiled.codes)),
        compiled.limits,
    )
    if status < 0:
        raise SimulationError(f"the rig {model.name!r} grows without bound; correct its stiffness and damping")
    channels = {
        sensor.channel: sampled(motion[k], over, n, h, differentiate=sensor.quantity == "acceleration")
        for k, sensor in enumerate(model.sensors)
    }
    if as_recorded:
        recorded = record(model, {model.drive.channel: true_drive(model, excitation)[:n], **channels}, rate)
        channels = {name: recorded[name] for name in channels}
    return Response(sample_rate=rate, channels=channels)


def _true_fine(model: RigModel, excitation: Excitation) -> FloatArray:
    chain = model.drive.chain
    return (shift(excitation.fine, -chain.delay, excitation.sample_rate * excitation.oversample) - chain.offset) / chain.gain
