"""Simulation of many parameter sets at once, for scans: time-stepping in vector lanes and on all cores."""

from collections.abc import Callable, Mapping, Sequence
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isorig.analysis import laws
from isorig.analysis.campaign import MOTION, FloatArray
from isorig.analysis.errors import SimulationError
from isorig.analysis.jit import fast_kernel
from isorig.analysis.model.linear import constraint_basis
from isorig.analysis.model.rig_model import GROUND, RigModel, direction, weights_of
from isorig.analysis.parallel import side_by_side
from isorig.analysis.simulate.free_run import sense_of
from isorig.analysis.simulate.sampling import Excitation, sampled
from isorig.analysis.simulate.simulation import simulate

#: Single precision halves the memory traffic, which limits the kernel; rounding is far below the discretisation error.
Singles = NDArray[np.float32]
Records = Singles | FloatArray
ZERO, ONE, TWO = np.float32(0.0), np.float32(1.0), np.float32(2.0)
#: Number of simulations in one call of the vectorised kernel.
LANES = 128
#: Number of terms of the series of an exponential: accurate to rounding for a norm of one half.
TERMS = 14


def scan(
    models: Sequence[RigModel], excitation: Excitation, figure: Callable[[Mapping[str, Records]], NDArray[Any]], *,
    configuration: str = "unlocked",
) -> NDArray[Any]:  # fmt: skip
    """Compute a quantity of many rigs under one drive, from rest; simulate the final ones with `simulate`.

    Rigs of one structure (same parts, other values) that are linear except for at most one Coulomb contact take fixed
    steps of the excitation's grid, each with its exact matrices; the mean friction of a step follows from the time of
    its reversal within the step (time-stepping after Moreau, with second-order events): within 1.2 % of `simulate` at
    2048 Hz and 60 N rms, 2 % at 25 N. Others are simulated one by one on all cores.

    To scan the isolation frequency of the built-in rig under moves::

        drive = excitation.moves(samples=8192, sample_rate=2048.0)
        models = [wire_bonder({**THESIS, "motor_frequency": f}) for f in np.linspace(0.4, 6.0, 200)]
        prepared = Excitation.prepare(drive, 2048.0, oversample=1)
        largest = scan(models, prepared, lambda seen: np.abs(seen["motor"]).max(axis=1))   # shape (200,)

    A displacement or a stroke comes from a `Sensor(quantity="displacement", relative_to="table")` in the model.

    Parameters
    ----------
    models
        The rigs, with the same sensors and drive channel.
    excitation
        The drive. With `oversample=1` the steps are the samples, linearly interpolated; finer grids take proportionally
        longer and are low-pass filtered like recordings.
    figure
        Computes the quantity, shape (rigs, ...), from the records of a block of rigs by channel, each shape (rigs, n), which are
        overwritten afterwards: memory that is newly allocated for records takes longer than the simulation.
    configuration
        Configuration of the rigs.

    Returns
    -------
    NDArray
        The quantity for all rigs, shape (models, ...).

    Raises
    ------
    SimulationError
        If a rig's motion grows without bound.
    """
    names = [sensor.channel for sensor in models[0].sensors]
    spare: SimpleQueue[Singles] = SimpleQueue()

    def alone(model: RigModel) -> NDArray[Any]:
        seen = simulate(model, excitation, configuration=configuration).channels
        return np.array(figure({name: values[None] for name, values in seen.items()}))

    def block(first: int) -> NDArray[Any]:
        part = models[first : first + LANES]
        try:
            room = spare.get_nowait()
        except Empty:
            room = np.empty((len(names), len(excitation.fine), LANES), dtype=np.float32)
        whole = room if len(part) == LANES else np.empty((*room.shape[:2], len(part)), dtype=np.float32)
        records = _records(part, excitation, configuration, whole)
        found = np.array(figure({name: rows.T for name, rows in zip(names, records, strict=True)}))
        spare.put(room)
        return found

    if not _alike(models, configuration):
        return np.concatenate(side_by_side(alone, models))
    return np.concatenate(side_by_side(block, range(0, len(models), LANES)))


def _records(models: Sequence[RigModel], excitation: Excitation, configuration: str, room: Singles) -> Records:
    # Records of the sensors, shape (sensors, n, models).
    over, n = excitation.oversample, len(excitation.recorded)
    fine = _lanes(models, excitation, configuration, room)
    if not np.isfinite(fine[:, -1]).all():
        raise SimulationError("a rig of the batch grows without bound; correct its stiffness and damping")
    if over == 1:
        return fine
    out = np.empty((len(fine), n, len(models)))
    for k, sensor in enumerate(models[0].sensors):
        for lane in range(len(models)):
            values = fine[k, :, lane].astype(np.float64)
            out[k, :, lane] = sampled(values, over, n, excitation.step, differentiate=MOTION[sensor.quantity] == 2)
    return out


def _alike(models: Sequence[RigModel], configuration: str) -> bool:
    # Whether the batch engine can simulate them together.
    pattern = _structure(models[0], configuration)
    return _steppable(models[0], configuration) and all(_structure(model, configuration) == pattern for model in models[1:])


def _structure(model: RigModel, configuration: str) -> object:
    # What must be equal in models that are simulated together: everything except values that enter the matrices.
    return (
        [body.name for body in model.bodies],
        [(part.name, part.a, part.b, part.arms, [type(law) for law in part.laws]) for part in model.links],
        [(part.name, part.a, part.b, part.arms, type(part.law)) for part in model.contacts],
        model.sensors,
        model.configurations[configuration].rigid,
        model.configurations[configuration].lock_stiffness is None,
        (model.drive.chain.delay, model.drive.chain.offset),
    )


def _steppable(model: RigModel, configuration: str) -> bool:
    blocked = model.configurations[configuration].rigid
    sticking = [contact for contact in model.contacts if contact.name not in blocked]
    setup = model.configurations[configuration]
    return (
        model.drive.chain.delay == model.drive.chain.offset == 0.0
        and model.drive.acts_as_recorded
        and not (model.more_drives or model.imposed or setup.initial_position or setup.initial_velocity)
        and all(sensor.force_in is None for sensor in model.sensors)
        and all(not link.laws or link.name in blocked for link in model.links)
        and len(sticking) <= 1
        and all(isinstance(contact.law, laws.Coulomb) for contact in sticking)
    )


def _lanes(models: Sequence[RigModel], excitation: Excitation, configuration: str, out: Singles) -> Singles:
    # Responses of one block of models, written to `out`, shape (sensors, n, models).
    over = excitation.oversample
    h = excitation.step
    first = models[0]
    setup = first.configurations[configuration]
    rigid = [first.link(name) for name in setup.rigid]
    basis = constraint_basis(first, rigid if setup.lock_stiffness is None else [])
    order = basis.shape[1]
    contacts = [contact for contact in first.contacts if contact.name not in setup.rigid]
    row = weights_of(first, contacts[0]) @ basis if contacts else np.zeros(order)
    count = len(models)
    whole = np.zeros((count, 2 * order + 4, 2 * order + 4))
    friction = np.zeros((2, count))
    along = np.array([weights_of(first, link) for link in first.links]).reshape(-1, len(basis)) @ basis
    mass = _assembled(basis, np.array([[body.mass for body in model.bodies] for model in models]))
    stiffness = _assembled(along, np.array([[link.stiffness for link in model.links] for model in models]))
    damping = _assembled(along, np.array([[link.damping for link in model.links] for model in models]))
    if setup.lock_stiffness is not None:
        across = np.array([direction(first, link.a, link.b, {}) for link in rigid]).reshape(-1, len(basis)) @ basis
        given = [model.configurations[configuration] for model in models]
        stiffness += _assembled(across, np.array([[lock.lock_stiffness or 0.0] * len(rigid) for lock in given]))
        damping += _assembled(across, np.array([[lock.lock_damping] * len(rigid) for lock in given]))
    forces = np.zeros((count, order, 2 * order + 2))
    forces[:, :, :order], forces[:, :, order : 2 * order], forces[:, :, -1] = -stiffness, -damping, row
    for lane, model in enumerate(models):
        for name, weight in model.drive.pushes.items():
            size = weight * model.drive.factor / model.drive.chain.gain
            forces[lane, :, 2 * order] += size * direction(model, name, GROUND, {}) @ basis
        if contacts:
            law = model.contact(contacts[0].name).law
            assert isinstance(law, laws.Coulomb)
            friction[:, lane] = law.friction_force, law.friction_force if law.static_force is None else law.static_force
    whole[:, order : 2 * order, : 2 * order + 2] = np.linalg.solve(mass, forces) * h
    whole[:, :order, order : 2 * order] = np.eye(order) * h
    whole[:, 2 * order, 2 * order + 2] = 1.0
    whole[:, 2 * order + 1, 2 * order + 3] = 1.0
    moved = np.moveaxis(exponentials(whole), 0, -1)[: 2 * order]
    end = moved[:, 2 * order + 2]
    central = np.array([MOTION[sensor.quantity] == 2 and over == 1 for sensor in first.sensors], dtype=np.bool_)
    _step_many(
        _single(excitation.fine), np.float32(0.5 / h), _single(moved[:, : 2 * order]), _single(moved[:, 2 * order] - end),
        _single(end), _single(moved[:, 2 * order + 1]), _single(row), _single(friction), _single(sense_of(first, basis)), central,
        out,
    )  # fmt: skip
    return out


def exponentials(matrices: FloatArray) -> FloatArray:
    """exp of each matrix, shape (..., n, n), by scaling and squaring a Taylor series.

    For stacks of small matrices it takes a fifth of the time of a library function. No balancing is needed, because the series
    is evaluated at a norm below one half.
    """
    norm = float(np.abs(matrices).sum(axis=-1).max(initial=0.0))
    squarings = max(0, int(np.ceil(np.log2(max(norm, 1e-300) / 0.5))))
    scaled = matrices / 2.0**squarings
    # Without the identity, so that small increments keep their precision in the squarings.
    term = scaled.copy()
    total = scaled.copy()
    for k in range(2, TERMS):
        term = term @ scaled / k
        total = total + term
    for _ in range(squarings):
        total = 2.0 * total + total @ total
    return total + np.eye(total.shape[-1])


def _assembled(rows: FloatArray, sizes: FloatArray) -> FloatArray:
    # Sum over the parts of size * row' row for each model; rows (parts, n), sizes (models, parts).
    return np.asarray(np.einsum("mp,pi,pj->mij", sizes, rows, rows))


def _single(values: FloatArray) -> Singles:
    return np.ascontiguousarray(values, dtype=np.float32)


@fast_kernel
def read_out(weights: Singles, z: Singles, out: Singles) -> None:
    """Weighted sum of the states, shape (lanes,)."""
    begun = False
    for i in range(len(weights)):
        w = weights[i]
        if w != ZERO:
            if begun:
                for k in range(len(out)):
                    out[k] += w * z[i, k]
            else:
                for k in range(len(out)):
                    out[k] = w * z[i, k]
                begun = True


@fast_kernel
def _step_many(
    u: Singles, half_rate: np.float32, step: Singles, start: Singles, end: Singles, impulse: Singles, row: Singles,
    friction: Singles, sense: Singles, central: NDArray[np.bool_], out: Singles,
) -> None:  # fmt: skip
    """Step one block of rigs through a drive; fills `out` (sensors, n, lanes).

    z1 = step z + start u0 + end u1 + impulse f, where f is the contact's mean force in the step: sliding friction while it
    slides, the static force if it comes to rest, and if it reverses the time-weighted mean of sliding friction in both
    directions. `central` sensors record the central difference of their value.
    """
    m, lanes = step.shape[0], step.shape[2]
    n = m // 2
    z = np.zeros((m, lanes), dtype=np.float32)
    z1 = np.zeros((m, lanes), dtype=np.float32)
    v = np.zeros(lanes, dtype=np.float32)
    gain = np.zeros(lanes, dtype=np.float32)
    free = np.zeros(lanes, dtype=np.float32)
    value = np.zeros(lanes, dtype=np.float32)
    force = np.zeros(lanes, dtype=np.float32)
    before = np.zeros((sense.shape[0], lanes), dtype=np.float32)
    now = np.zeros((sense.shape[0], lanes), dtype=np.float32)
    for i in range(n):
        for k in range(lanes):
            gain[k] += row[i] * impulse[n + i, k]
    sixes = 6 if m >= 6 else 0
    towards = np.zeros(m, dtype=np.float32)
    towards[n:] = row
    rubs = np.abs(row).sum() > ZERO
    for t in range(len(u)):
        last = t == len(u) - 1
        if not last:
            u0, u1 = u[t], u[t + 1]
            for i in range(m):
                # Six columns, or two, in one loop, for less memory traffic. The number of columns is even: twice the coordinates.
                if sixes:
                    for k in range(lanes):
                        z1[i, k] = (
                            start[i, k] * u0
                            + end[i, k] * u1
                            + step[i, 0, k] * z[0, k]
                            + step[i, 1, k] * z[1, k]
                            + step[i, 2, k] * z[2, k]
                            + step[i, 3, k] * z[3, k]
                            + step[i, 4, k] * z[4, k]
                            + step[i, 5, k] * z[5, k]
                        )
                else:
                    for k in range(lanes):
                        z1[i, k] = start[i, k] * u0 + end[i, k] * u1
                for j in range(sixes, m, 2):
                    for k in range(lanes):
                        z1[i, k] += step[i, j, k] * z[j, k] + step[i, j + 1, k] * z[j + 1, k]
            if rubs:
                read_out(towards, z1, free)
                for k in range(lanes):
                    v0 = v[k]
                    side = ONE if (v0 if v0 != ZERO else free[k]) > ZERO else -ONE
                    sliding = -side * friction[0, k]
                    slid = free[k] + gain[k] * sliding
                    share = v0 / (v0 - slid) if v0 != slid else ZERO
                    turned = sliding * (TWO * share - ONE)
                    held = -free[k] / gain[k]
                    after = free[k] + gain[k] * turned
                    resting = held if side * after > ZERO else turned
                    # From rest it slides if sticking requires more than the breakaway force.
                    stays = abs(held) <= friction[1, k] if v0 == ZERO else side * slid <= ZERO
                    rest = held if v0 == ZERO else resting
                    f = rest if stays else sliding
                    force[k] = f
                    v[k] = ZERO if stays and f == held else free[k] + gain[k] * f
                for i in range(m):
                    for k in range(lanes):
                        z1[i, k] += impulse[i, k] * force[k]
        for r in range(sense.shape[0]):
            if central[r]:
                if last:
                    for k in range(lanes):
                        value[k] = TWO * now[r, k] - before[r, k]
                else:
                    read_out(sense[r], z1, value)
                for k in range(lanes):
                    out[r, t, k] = half_rate * (value[k] - before[r, k])
                    before[r, k] = now[r, k]
                    now[r, k] = value[k]
            else:
                read_out(sense[r], z, out[r, t])
        z, z1 = z1, z
