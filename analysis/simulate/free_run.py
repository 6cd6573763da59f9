"""The free run: a rig, a drive, and what the sensors would say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import MOTION, FloatArray, IntArray
from isorig.analysis.errors import SimulationError
from isorig.analysis.model.rig_model import RigModel, direction
from isorig.analysis.simulate.compiled import Compiled, compile_rig
from isorig.analysis.simulate.kernel import run
from isorig.analysis.simulate.sampling import TAPS, Excitation, sampled, shift

#: Times as many steps that a run takes where curved forces bend too much within one, in turn.
FINER = (1, 2, 4, 8, 16)
#: Share of the steps that may bend so much: cut into pieces one takes as long as two dozen others.
SPLIT = 0.1
#: What the kernel says where contacts cannot be settled.
UNSETTLED = -3


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
        if chain.taps:
            y = np.convolve(y, chain.taps, mode="same")
        if chain.bend:
            y = y + _bent(y, chain.bend)
        if chain.offset:
            y = y + chain.offset
        for source, fraction in chain.crosstalk.items():
            if fraction:
                y = y + fraction * motion[source]
        if chain.limit is not None:
            y = np.clip(y, -chain.limit, chain.limit)
        out[name] = y
    return out


def _bent(values: FloatArray, bend: tuple[tuple[float, float], ...]) -> FloatArray:
    from scipy.interpolate import CubicSpline

    at, added = np.array(bend).T
    curve = CubicSpline(at, added, bc_type="natural")
    inside = np.clip(values, at[0], at[-1])
    slope = np.where(values < at[0], curve(at[0], 1), curve(at[-1], 1))
    return np.asarray(curve(inside) + slope * (values - inside))


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

    Examples
    --------
    >>> import numpy as np
    >>> import isorig as iso
    >>> drive = iso.Excitation.prepare(3.0 * np.random.default_rng(0).normal(size=2048), 1024.0)
    >>> response = iso.simulate(iso.wire_bonder(), drive, configuration="locked")
    >>> sorted(response.channels), response.channels["table"].shape
    (['heatblock', 'motor', 'table'], (2048,))
    """
    rate, over = excitation.sample_rate, excitation.oversample
    n = len(excitation.recorded) if samples is None else samples
    total = min((n + 2 * TAPS) * over, len(excitation.fine))
    h = 1.0 / (rate * over)
    sense = sense_of(model, compile_rig(model, configuration, h))
    motion = np.zeros((len(model.sensors), total))
    run_rig(model, configuration, true_fine(model, excitation)[:total], h, start_time, sense, motion)
    return response_of(model, excitation, motion, n, as_recorded=as_recorded)


def sense_of(model: RigModel, compiled: Compiled) -> FloatArray:
    """What the sensors need of the coordinates and their speeds, shape (sensors, 2 n): an acceleration's is the speed."""
    order = compiled.basis.shape[1]
    sense = np.zeros((len(model.sensors), 2 * order))
    for k, sensor in enumerate(model.sensors):
        place = slice(0, order) if MOTION[sensor.quantity] == 0 else slice(order, None)
        sense[k, place] = direction(model, sensor.body, sensor.relative_to, sensor.arms) @ compiled.basis
    return sense


def response_of(model: RigModel, excitation: Excitation, motion: FloatArray, n: int, *, as_recorded: bool) -> Response:
    """Records of `n` samples from the sensors' values on the fine grid, see `sense_of`."""
    rate, over = excitation.sample_rate, excitation.oversample
    channels = {
        sensor.channel: sampled(motion[k], over, n, 1.0 / (rate * over), differentiate=MOTION[sensor.quantity] == 2)
        for k, sensor in enumerate(model.sensors)
    }
    if as_recorded:
        recorded = record(model, {model.drive.channel: true_drive(model, excitation)[:n], **channels}, rate)
        channels = {name: recorded[name] for name in channels}
    return Response(sample_rate=rate, channels=channels)


def run_rig(
    model: RigModel,
    configuration: str,
    drive: FloatArray,
    h: float,
    start_time: float,
    sense: FloatArray,
    out: FloatArray,
    *,
    curved: FloatArray | None = None,
    modes: IntArray | None = None,
    log: FloatArray | None = None,
) -> tuple[int, Compiled]:
    """Run a rig through a true drive on steps of `h` seconds; give the number of changes of state, and what was run.

    Parameters
    ----------
    sense, out
        Rows on the coordinates and their speeds, (sensors, 2 n), and where their values go, (sensors, steps).
    curved, modes, log
        Where wanted: the curved forces (curves, steps), the mode (steps,), the changes (room, 3); see `kernel.run`.

    Raises
    ------
    SimulationError
        Where the motion grows without bound.
    """
    changes = 0
    for finer in FINER:
        compiled = compile_rig(model, configuration, h, finer)
        order, step = compiled.basis.shape[1], h / compiled.cuts
        rows = sense.copy()
        rows[:, order:] /= step
        changes = run(
            np.ascontiguousarray(drive), compiled.cuts, step, start_time, order, compiled.whole, compiled.blocks,
            compiled.series, compiled.terms, compiled.exits, compiled.limits, compiled.settle, compiled.possible,
            compiled.kinds, compiled.strides, compiled.states, compiled.curve_of, compiled.codes, compiled.params,
            compiled.directions, compiled.gates, rows, out,
            np.zeros((len(compiled.codes), 0)) if curved is None else curved,
            np.zeros(0, dtype=np.int64) if modes is None else modes,
            np.zeros((0, 3)) if log is None else log,
            SPLIT if finer < FINER[-1] else np.inf,
            compiled.memories,
        )  # fmt: skip
        if changes >= 0:
            return changes, compiled
        if len(compiled.codes) == 0:
            break
    if changes == UNSETTLED:
        names = ", ".join(name for name, rubs in zip(compiled.elements, compiled.rubs, strict=True) if rubs)
        raise SimulationError(
            f"the contacts {names} of the rig {model.name!r} change their state without end; "
            "choose friction forces and masses that differ less in size"
        )
    raise SimulationError(f"the rig {model.name!r} grows without bound; correct its stiffness and damping")


def true_fine(model: RigModel, excitation: Excitation) -> FloatArray:
    """The drive's true values on the fine grid, its own chain's gain and delay undone."""
    chain = model.drive.chain
    return (shift(excitation.fine, -chain.delay, excitation.sample_rate * excitation.oversample) - chain.offset) / chain.gain
