"""The parts of a free run: true drives, the run of a compiled rig, and the sensors' records."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from isorig.analysis.campaign import MOTION, SI_UNIT, FloatArray, IntArray, Run
from isorig.analysis.errors import SimulationError
from isorig.analysis.laws.tables import read
from isorig.analysis.lowpass import velocity_corner
from isorig.analysis.model.rig_model import Drive, RigModel, weights_of
from isorig.analysis.rounding import is_command
from isorig.analysis.simulate.compiled import SETTLING, Compiled, compile_rig
from isorig.analysis.simulate.curves import load_laws
from isorig.analysis.simulate.kernel import run
from isorig.analysis.simulate.sampling import AS_IT_IS, TAPS, Excitation, high_passed, interpolate, lagging, sampled, shift
from isorig.analysis.views import Viewed

#: Refinements of the time step, tried in this order, if curved forces need more than one parabola per step.
FINER = (1, 2, 4, 8, 16)
#: Maximum share of such steps before the refinement: a divided step takes as long as about 24 others.
SPLIT = 0.1
#: No imposed motion.
NOWHERE: Mapping[str, tuple[float, float]] = MappingProxyType({})
#: The kernel's result if no consistent combination of contact states is found.
UNSETTLED = -3


@dataclass(frozen=True, kw_only=True)
class Response(Viewed):
    """The sensors' simulated records by channel, each shape (n,), at `sample_rate` Hz; `units` are their SI units."""

    sample_rate: float
    channels: dict[str, FloatArray]
    units: dict[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        n = max((len(values) for values in self.channels.values()), default=0)
        return f"Response({n / self.sample_rate:g} s at {self.sample_rate:g} Hz, {', '.join(self.channels)})"


def record(model: RigModel, motion: Mapping[str, FloatArray], rate: float) -> dict[str, FloatArray]:
    """Apply the faults of the measurement chains to true values, by channel; see `Chain`."""
    chains = {drive.channel: drive.chain for drive in model.drives} | {s.channel: s.chain for s in model.sensors}
    out = {}
    for name, true in motion.items():
        chain = chains[name]
        y = chain.gain * shift(true, chain.delay, rate) if (chain.gain != 1.0 or chain.delay) else true
        if chain.corner:
            y = high_passed(y, chain.corner, rate)
        if chain.cutoff:
            y = lagging(y, chain.cutoff, rate)
        if chain.taps:
            y = np.convolve(y, chain.taps, mode="same")
        y = _bent(y, chain.bend)
        if chain.offset:
            y = y + chain.offset
        for source, fraction in chain.crosstalk.items():
            if fraction:
                y = y + fraction * motion[source]
        if chain.limit is not None:
            y = np.clip(y, -chain.limit, chain.limit)
        out[name] = y
    return out


def _bent(values: FloatArray, curve: Sequence[tuple[float, float]]) -> FloatArray:
    # Values with a static curve added.
    if not curve:
        return values
    at, added = zip(*curve, strict=True)
    return values + read(at, added, values, straight=True)


def true_drives(model: RigModel, excitation: Excitation, samples: int | None = None) -> dict[str, FloatArray]:
    """True values of every drive by channel, the first `samples` or all: its record with its chain's offset, gain and delay
    corrected, as it acts."""
    return {
        drive.channel: acting(drive, each.recorded, each.sample_rate)[:samples]
        for drive, each in zip(model.drives, (excitation, *excitation.others), strict=True)
    }


def acting(drive: Drive, values: FloatArray, rate: float) -> FloatArray:
    """What acts of a drive's record, shape (n,): its chain's offset, gain and delay corrected, limited, and lagging."""
    chain = drive.chain
    if not (chain.delay == 0.0 and chain.offset == 0.0 and chain.gain == 1.0):
        values = (shift(values, -chain.delay, rate) - chain.offset) / chain.gain
    return delivered(drive, values, rate)


def delivered(drive: Drive, command: FloatArray, rate: float) -> FloatArray:
    """A drive's command, shape (n,), by its curve, limited and lagging."""
    bent = _bent(command, drive.curve)
    limited = bent if drive.limit is None else np.clip(bent, -drive.limit, drive.limit)
    return lagging(limited, 1.0 / (2.0 * np.pi * drive.lag), rate) if drive.lag else limited


def excitation_of(model: RigModel, run: Run, *, oversample: int = 8, stop: int | None = None) -> Excitation:
    """The recorded drives of a run, up to sample `stop`; a command that pushes is held from sample to sample.

    A position or velocity that is imposed is differentiated, so it is taken without the frequencies at which it is noise. Raises
    DataError if the run lacks one of them.
    """
    first, *others = (
        Excitation.prepare(
            values,
            run.sample_rate,
            oversample=oversample,
            held=drive.imposes is None and is_command(values),
            corner=velocity_corner(values, run.sample_rate)
            if drive.imposes is not None and MOTION[drive.quantity] < 2
            else np.inf,
        )
        for drive in model.drives
        for values in [run.channel(drive.channel).read(0, stop)]
    )
    return replace(first, others=tuple(others))


def sense_of(model: RigModel, basis: FloatArray) -> FloatArray:
    """Matrix from the coordinates of a basis, (bodies, n), and their speeds to the sensors, shape (sensors, 2 n); for an
    acceleration it gives the speed."""
    order = basis.shape[1]
    sense = np.zeros((len(model.sensors), 2 * order))
    for k, sensor in enumerate(model.sensors):
        if sensor.force_in is not None:
            continue
        place = slice(0, order) if MOTION[sensor.quantity] == 0 else slice(order, None)
        sense[k, place] = weights_of(model, sensor) @ basis
    return sense


def response_of(model: RigModel, excitation: Excitation, motion: FloatArray, n: int, *, as_recorded: bool) -> Response:
    """Records of `n` samples from the sensors' values on the fine grid, see `sense_of`."""
    rate, over = excitation.sample_rate, excitation.oversample
    channels = {
        sensor.channel: sampled(motion[k], over, n, excitation.step, differentiate=MOTION.get(sensor.quantity) == 2)
        for k, sensor in enumerate(model.sensors)
    }
    if as_recorded:
        recorded = record(model, {**true_drives(model, excitation, n), **channels}, rate)
        channels = {name: recorded[name] for name in channels}
    units = {sensor.channel: SI_UNIT[sensor.quantity] for sensor in model.sensors}
    return Response(sample_rate=rate, channels=channels, units=units)


def run_rig(
    model: RigModel, configuration: str, drive: FloatArray, h: float, start_time: float, sense: FloatArray, out: FloatArray, *,
    begun: Mapping[str, tuple[float, float]] = NOWHERE, curved: FloatArray | None = None, modes: IntArray | None = None,
    log: FloatArray | None = None,
) -> tuple[int, Compiled]:  # fmt: skip
    """Simulate a rig under its true drives; return the number of changes of state, and the arrays used.

    Parameters
    ----------
    model, configuration
        The rig, and the name of its configuration.
    drive
        See `true_fine`, shape (drives, steps); (steps,) if there is one.
    h
        Duration of a step, s.
    start_time
        Time of the first step since the start of the campaign, s.
    sense, out
        Rows on the coordinates and their speeds, (sensors, 2 n), and the array for their values, (sensors, steps).
    begun
        Initial position and velocity of the bodies whose motion is imposed; see `imposed_start`.
    curved, modes, log
        Optional arrays for the curved forces (curves, steps), the mode (steps,), the changes (n, 3); see `kernel.run`.

    Raises
    ------
    SimulationError
        If the motion grows without bound.
    """
    changes = 0
    first, *others = np.atleast_2d(drive)
    more = np.array(others).reshape(len(others), len(first))
    peaks = np.zeros(1 + len(others))
    for finer in FINER:
        compiled = compile_rig(model, configuration, h, finer)
        rows = sense.copy()
        rows[:, compiled.rig.n :] /= compiled.rig.step
        start, mode = initial_state(model, configuration, compiled, begun)
        if len(compiled.rig.codes):  # only curved forces need these
            load_laws()
            peaks = np.abs(np.atleast_2d(drive)).max(axis=1)
        changes = run(
            np.ascontiguousarray(first), more, peaks, start, mode, compiled.cuts, start_time, compiled.rig, rows, out,
            np.zeros((len(compiled.rig.codes), 0)) if curved is None else curved,
            np.zeros(0, dtype=np.int64) if modes is None else modes,
            np.zeros((0, 3)) if log is None else log,
            SPLIT if finer < FINER[-1] else np.inf,
            compiled.memories,
        )  # fmt: skip
        if changes >= 0:
            return changes, compiled
        if len(compiled.rig.codes) == 0:
            break
    if changes == UNSETTLED:
        names = ", ".join(name for name, rubs in zip(compiled.elements, compiled.rubs, strict=True) if rubs)
        raise SimulationError(
            f"the contacts {names} of the rig {model.name!r} change their state without end; "
            "choose friction forces and masses that differ less in size"
        )
    raise SimulationError(f"the rig {model.name!r} grows without bound; correct its stiffness and damping")


def true_fine(model: RigModel, excitation: Excitation) -> FloatArray:
    """The drives' true values on the fine grid, shape (drives, steps).

    For an imposed motion its acceleration: linear between the grid points, it integrates to the recorded motion at them (the
    second derivative of a cubic spline is piecewise linear).
    """
    rows = []
    for drive, each in zip(model.drives, (excitation, *excitation.others), strict=True):
        if drive.imposes is None or MOTION[drive.quantity] == 2:
            rows.append(acting(drive, each.fine, each.sample_rate * each.oversample))
        else:
            rows.append(_imposed(drive, each)[2])
    return np.stack(rows) if len(rows) > 1 else rows[0][None]


def imposed_start(model: RigModel, excitation: Excitation) -> dict[str, tuple[float, float]]:
    """Position and velocity of every imposed body at the first sample."""
    found = {}
    for drive, each in zip(model.drives, (excitation, *excitation.others), strict=True):
        if drive.imposes is not None:
            position, velocity, _ = _imposed(drive, each)
            found[drive.imposes] = float(position[0]), float(velocity[0])
    return found


@lru_cache(maxsize=16)
def _splined(key: bytes, order: int, rate: float, over: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    from scipy.interpolate import CubicSpline

    values = np.frombuffer(key)
    # Band-limited interpolation treats the signal outside the record as zero; mirrored at its first and last point it goes on.
    beyond = np.pad(values, TAPS, mode="reflect", reflect_type="odd")
    fine = interpolate(beyond, over, AS_IT_IS)[TAPS * over : -TAPS * over]
    time = np.arange(len(fine)) / (rate * over)
    spline = CubicSpline(time, fine)
    if order == 1:
        spline = CubicSpline(time, spline.antiderivative()(time))
    return spline(time), spline(time, 1), spline(time, 2)


def _imposed(drive: Drive, excitation: Excitation) -> tuple[FloatArray, FloatArray, FloatArray]:
    # Position, velocity and acceleration on the fine grid.
    order = MOTION[drive.quantity]
    if order == 2:
        zero = np.zeros(1)
        return zero, zero, zero
    true = acting(drive, excitation.recorded, excitation.sample_rate)
    return _splined(true.tobytes(), order, excitation.sample_rate, excitation.oversample)


def initial_state(
    model: RigModel, configuration: str, compiled: Compiled, imposed: Mapping[str, tuple[float, float]]
) -> tuple[FloatArray, int]:
    """Initial coordinates and speeds, shape (2 n,), and the initial mode: contacts with a relative speed slide. Raises
    SimulationError if links that are rigid in this configuration do not allow the initial state."""
    setup = model.configurations[configuration]
    order = compiled.basis.shape[1]
    start = np.zeros(2 * order)
    if not (setup.initial_position or setup.initial_velocity or imposed):
        return start, 0
    position, velocity = dict(setup.initial_position), dict(setup.initial_velocity)
    for name, (at, speed) in imposed.items():
        position[name], velocity[name] = at, speed
    for half, given in ((slice(0, order), position), (slice(order, None), velocity)):
        whole = np.array([given.get(body.name, 0.0) for body in model.bodies])
        # Bodies without a given value follow the others through rigid links.
        named = [k for k, body in enumerate(model.bodies) if body.name in given]
        if named:
            start[half] = np.linalg.lstsq(compiled.basis[named], whole[named])[0]
        if named and not np.allclose(compiled.basis[named] @ start[half], whole[named], atol=1e-12):
            raise SimulationError(
                f"the initial state of configuration {configuration!r} moves bodies apart that its rigid links join; "
                "give them the same values"
            )
    mode = 0
    for k, across in enumerate(compiled.across):
        speed = float(across @ start[order:])
        if compiled.rig.kinds[k] == SETTLING and speed != 0.0:
            mode += int(compiled.rig.strides[k]) * (1 if speed > 0.0 else 2)
    return start, mode
