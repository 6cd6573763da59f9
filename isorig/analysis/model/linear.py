"""The linear part of a rig in a configuration: matrices, the coordinates that locks leave free, whether springs hold it."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import MOTION, ComplexArray, FloatArray
from isorig.analysis.errors import ModelError
from isorig.analysis.model.rig_model import GROUND, Link, RigModel, direction, matrices, weights_of

#: Normalised eigenvalue of the stiffness matrix below which a motion counts as held by no spring (rounding).
SLACK = 1e-12
#: Share of a rigid-body motion in a sensor's position below which it does not show there (rounding of an eigenvector).
UNMOVED = 1e-6
#: Weight of a force in a sum of equations of motion below which it cancels, up to rounding.
ROUNDED = 1e-9
#: Time constants of the slowest speed in a run from which on a simulation of speeds does not drift. Chosen: an error of the first
#: speed has fallen below a hundredth.
SETTLED = 5.0


def linear_part(model: RigModel, configuration: str) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Basis of the coordinates that a configuration leaves free, (bodies, free), and mass, damping and stiffness on all bodies.

    A lock with a stiffness adds to the last two; the links of a perfect lock remove coordinates from the basis. Raises ModelError
    if the rig has no such configuration.
    """
    if configuration not in model.configurations:
        raise ModelError(f"configuration {configuration!r} is unknown; the rig has {', '.join(model.configurations)}")
    setup = model.configurations[configuration]
    mass, damping, stiffness = matrices(model)
    rigid = [model.link(name) for name in setup.rigid]
    if setup.lock_stiffness is not None:
        for link in rigid:
            w = direction(model, link.a, link.b, {})
            stiffness = stiffness + setup.lock_stiffness * np.outer(w, w)
            damping = damping + setup.lock_damping * np.outer(w, w)
    return constraint_basis(model, rigid if setup.lock_stiffness is None else []), mass, damping, stiffness


def moving_together(model: RigModel, group: Collection[str], first: str) -> FloatArray:
    """How far joined bodies of a group move when the first moves by one and nothing between them is strained, shape (bodies,).

    The sum of their equations of motion with these weights contains no force between them. With links at arms that strain in any
    common motion each weight is one.
    """
    index = {body.name: k for k, body in enumerate(model.bodies)}
    others = [index[name] for name in group if name != first]
    found = np.zeros(len(index))
    found[[index[first], *others]] = 1.0
    inside = [joint for joint in model.joints if len(joint.joined - {GROUND}) > 1 and joint.joined <= {*group, GROUND}]
    rows = np.array([weights_of(model, joint) for joint in inside])
    if len(rows) and np.any(rows @ found):
        strained = -rows[:, index[first]]
        moved, *_ = np.linalg.lstsq(rows[:, others], strained, rcond=None)
        if np.allclose(rows[:, others] @ moved, strained):
            found[others] = moved
    return found


def imposed_coordinates(model: RigModel, basis: FloatArray) -> dict[str, int]:
    """Index of each imposed body's coordinate in a basis, by body."""
    rows = {body.name: row for body, row in zip(model.bodies, basis, strict=True)}
    return {name: int(np.argmax(np.abs(rows[name]))) for name in model.imposed}


def _not_imposed(n: int, imposed: Mapping[str, int]) -> list[int]:
    # Every fit asks this thousands of times, which functions for sets of arrays are too slow for.
    return [k for k in range(n) if k not in imposed.values()]


def accelerations(model: RigModel, configuration: str) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Accelerations of the n coordinates that a configuration leaves free, by coordinates and speeds and by the drives.

    An imposed coordinate has the acceleration that its drive states. Raises ModelError if the rig has no such configuration.

    Returns
    -------
    tuple
        Basis (bodies, n); matrix from forces on the coordinates to their accelerations, (n, n), zero for imposed ones; matrix
        from coordinates and speeds, (n, 2 n); matrix from the drives' values, (n, drives).
    """
    basis, mass, damping, stiffness = linear_part(model, configuration)
    imposed = imposed_coordinates(model, basis)
    whole = basis.T @ mass @ basis
    # No force changes an imposed coordinate: its mobility is zero.
    inverse = np.zeros_like(whole)
    free = _not_imposed(len(whole), imposed)
    loose = np.ix_(free, free)
    inverse[loose] = np.linalg.inv(whole[loose])
    pushes, by_drives = pushes_of(model), np.zeros((len(whole), len(model.drives)))
    for k, drive in enumerate(model.drives):
        if drive.imposes is not None:
            by_drives[:, k] = -inverse @ whole[:, imposed[drive.imposes]]
            by_drives[imposed[drive.imposes], k] = 1.0
        else:
            by_drives[:, k] = inverse @ basis.T @ pushes[:, k]
    return basis, inverse, inverse @ basis.T @ np.hstack([-stiffness @ basis, -damping @ basis]), by_drives


def free_matrices(model: RigModel, configuration: str) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Matrix from the n coordinates that are neither locked nor imposed to all bodies, and their mass, damping and stiffness.

    Shape (bodies, n) of the first, (n, n) of the others.
    """
    basis, *matrices = linear_part(model, configuration)
    basis = basis[:, _not_imposed(basis.shape[1], imposed_coordinates(model, basis))]
    mass, damping, stiffness = (basis.T @ matrix @ basis for matrix in matrices)
    return basis, mass, damping, stiffness


def free_part(model: RigModel, configuration: str) -> tuple[FloatArray, FloatArray]:
    """The free vibration of a configuration, without imposed motions: basis and system matrix.

    Returns the matrix of `free_matrices`, shape (bodies, n), and that from coordinates and speeds to their rates, (2 n, 2 n).
    """
    basis, mass, damping, stiffness = free_matrices(model, configuration)
    n = len(mass)
    return basis, np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)]])


@dataclass(frozen=True)
class LinearResponse:
    """The response of a rig's linear part at some frequencies."""

    moved: ComplexArray  #: Displacements of the bodies per unit of each drive's channel, shape (bins, bodies, drives).
    compliance: ComplexArray  #: Displacements of the bodies by forces on them, shape (bins, bodies, bodies).
    seen: ComplexArray  #: Weights of the bodies' displacements in the sensors' records, shape (bins, sensors, bodies).

    @property
    def records(self) -> ComplexArray:
        """Of the sensors per unit of each drive's channel, shape (bins, sensors, drives)."""
        return self.seen @ self.moved


def linear_response(model: RigModel, configuration: str, omega: FloatArray) -> LinearResponse:
    """The response in a configuration at frequencies in rad/s, shape (bins,), without friction and nonlinear forces."""
    basis, *parts = linear_part(model, configuration)
    mass, damping, stiffness = (basis.T @ part @ basis for part in parts)
    imposed = imposed_coordinates(model, basis)
    free = _not_imposed(len(mass), imposed)
    s = 1j * omega[:, None, None]
    force = mass * s**2 + damping * s + stiffness
    compliance = np.zeros_like(force)
    compliance[np.ix_(range(len(s)), free, free)] = np.linalg.inv(force[:, free][:, :, free])
    z = np.zeros((len(s), len(mass), len(model.drives)), dtype=complex)
    for k, drive in enumerate(model.drives):
        if drive.imposes is not None:
            z[:, imposed[drive.imposes], k] = 1.0 / (1j * omega) ** MOTION.get(drive.quantity, 0)
    z = z + compliance @ (basis.T @ pushes_of(model) - force @ z)
    along = np.stack([weights_of(model, sensor) for sensor in model.sensors])
    order = np.array([MOTION[sensor.quantity] for sensor in model.sensors])
    gain = np.array([sensor.chain.gain for sensor in model.sensors])
    to_bodies = basis.astype(np.complex128)
    return LinearResponse(
        moved=to_bodies @ z, compliance=to_bodies @ compliance @ to_bodies.T, seen=along * (s[:, 0] ** order * gain)[:, :, None]
    )


def transfer(model: RigModel, configuration: str, frequency: FloatArray) -> ComplexArray:
    """Transfer functions from the main drive's channel to every sensor at frequencies in Hz, shape (sensors, bins)."""
    return linear_response(model, configuration, 2.0 * np.pi * frequency).records[:, :, 0].T


def pushes_of(model: RigModel) -> FloatArray:
    """Force on each body per unit of each drive's channel, shape (bodies, drives)."""
    return np.array([[drive.factor * drive.pushes.get(body.name, 0.0) for drive in model.drives] for body in model.bodies])


def constraint_basis(model: RigModel, rigid: Sequence[Link]) -> FloatArray:
    """Matrix from the coordinates that rigid links leave free to all coordinates, shape (bodies, free). Raises ModelError if a
    rigid link joins two imposed motions."""
    basis = np.eye(len(model.bodies))
    for link in rigid:
        row = weights_of(model, link) @ basis
        # An imposed motion stays a coordinate; the body rigidly linked to it is removed.
        choice = np.abs(row)
        choice[list(imposed_coordinates(model, basis).values())] = 0.0
        if model.imposed and not choice.any():
            raise ModelError(f"link {link.name!r} is rigid between motions that are imposed; leave it free in this configuration")
        gone = int(np.argmax(choice))
        step = np.delete(np.eye(basis.shape[1]), gone, axis=1)
        step[gone] = -np.delete(row, gone) / row[gone]
        basis = basis @ step
    return basis


def floats(model: RigModel) -> bool:
    """Whether no spring holds some body, directly or through others: a rigid-body motion exists."""
    # Accelerations of a free-free rig are compared in a free run, independent of its drift.
    return not model.free_free and rigid_motions(model).shape[1] > 0


def rigid_motions(model: RigModel) -> FloatArray:
    """Displacements of the bodies that no spring resists, shape (bodies, count)."""
    loose = [k for k, body in enumerate(model.bodies) if body.name not in model.imposed]
    stiffness = matrices(model)[2][np.ix_(loose, loose)]
    size = np.sqrt(np.diag(stiffness))
    size[size == 0.0] = 1.0
    values, vectors = np.linalg.eigh(stiffness / np.outer(size, size))
    found = np.zeros((len(model.bodies), int(np.sum(values < SLACK))))
    found[loose] = (vectors / size[:, None])[:, values < SLACK]
    return found


def drifts(model: RigModel, seconds: float) -> bool:
    """Whether a simulation of runs of this length drifts away from the records although the rig's values are right.

    It does where no spring holds some body, unless no position that changes with it is measured and dampers hold its speed: an
    error of a speed has died away long before the end of a run then.
    """
    if not floats(model):
        return False
    rigid = rigid_motions(model)
    positions = [sensor for sensor in model.sensors if sensor.force_in is None and MOTION[sensor.quantity] == 0]
    if any(np.any(np.abs(weights_of(model, sensor) @ rigid) > UNMOVED * np.abs(rigid).max(axis=0)) for sensor in positions):
        return True
    return any(_slowest_speed(model, name) * seconds < SETTLED for name in model.configurations)


def _slowest_speed(model: RigModel, configuration: str) -> float:
    # The slowest rate at which a speed decays, 1/s; each rigid-body motion has a position that nothing brings back.
    _, _, _, stiffness = free_matrices(model, configuration)
    _, rates = free_part(model, configuration)
    rigid = len(stiffness) - int(np.linalg.matrix_rank(stiffness, hermitian=True))
    values = np.linalg.eigvals(rates)
    decaying = values[np.argsort(np.abs(values))][rigid:]
    return float(np.min(-decaying.real, initial=np.inf))
