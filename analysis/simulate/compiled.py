"""A rig in a configuration as plain arrays for the kernel: phases, directions, laws by code."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis import laws
from analysis.errors import ModelError
from analysis.measured import FloatArray, IntArray
from analysis.model import GROUND, Link, RigModel, direction, matrices

#: Codes of the laws in the kernel; 10 to 13 but for Dahl's are those that stick.
CODES = {
    laws.Cubic: 1,
    laws.BoundedSoftening: 2,
    laws.Backlash: 3,
    laws.EndStop: 4,
    laws.QuadraticDamping: 5,
    laws.Drift: 6,
    laws.Coulomb: 10,
    laws.Stribeck: 11,
    laws.Dahl: 12,
    laws.Asymmetric: 13,
    laws.Arctan: 14,
    laws.Viscous: 15,
}
#: Parameters that a law may have.
WIDTH = 5


@dataclass(frozen=True, kw_only=True)
class Phases:
    """The linear system of every phase (set of sticking contacts, a bit each), m = 2 n states and q inputs.

    Parameters
    ----------
    system, inputs
        z' = system z + inputs u, shapes (phases, m, m) and (phases, m, q).
    step, start, end
        z(h) = step z + start u(0) + end u(h) for inputs linear in between.
    holding
        Force that holds each sticking contact, as rows on (z, u), shape (phases, contacts, m + q).
    """

    system: FloatArray
    inputs: FloatArray
    step: FloatArray
    start: FloatArray
    end: FloatArray
    holding: FloatArray


@dataclass(frozen=True, kw_only=True)
class Compiled:
    """A rig as the kernel takes it.

    Parameters
    ----------
    basis
        Full coordinates from the n free ones, shape (bodies, n).
    directions
        Weights of the coordinates in each element's elongation, shape (elements, n).
    shares, compliance
        Velocity that a unit impulse along each element makes, shape (elements, n), and along itself, (elements,).
    codes, params
        Law of each element, and its parameters (elements, WIDTH).
    sticking, limits
        Elements that stick and their breakaway forces forward and backward, shapes (contacts,), (contacts, 2).
    phases
        The systems.
    """

    basis: FloatArray
    directions: FloatArray
    shares: FloatArray
    compliance: FloatArray
    codes: IntArray
    params: FloatArray
    sticking: IntArray
    limits: FloatArray
    phases: Phases


@dataclass(frozen=True, kw_only=True)
class _Element:
    direction: FloatArray
    code: int
    row: list[float]
    limits: tuple[float, float] | None = None


def compile_rig(model: RigModel, configuration: str, h: float) -> Compiled:
    """Arrays of a rig for steps of `h` seconds.

    Raises
    ------
    ModelError
        Where the rig has no such configuration.
    """
    if configuration not in model.configurations:
        raise ModelError(f"configuration {configuration!r} is unknown; the rig has {', '.join(model.configurations)}")
    setup = model.configurations[configuration]
    mass, damping, stiffness = matrices(model)
    rigid = []
    for name in setup.rigid:
        link = model.link(name)
        if setup.lock_stiffness is None:
            rigid.append(link)
        else:
            w = direction(model, link.a, link.b, {})
            stiffness = stiffness + setup.lock_stiffness * np.outer(w, w)
            damping = damping + setup.lock_damping * np.outer(w, w)
    basis = constraint_basis(model, rigid)
    elements = _elements(model, frozenset(setup.rigid), basis)
    n = basis.shape[1]
    directions = np.array([e.direction for e in elements]).reshape(len(elements), n)
    inverse: FloatArray = np.linalg.inv(basis.T @ mass @ basis).astype(np.float64)
    push = np.zeros(len(model.bodies))
    for name, factor in model.drive.pushes.items():
        push += factor * model.drive.factor * direction(model, name, GROUND, {})
    sticking = [k for k, e in enumerate(elements) if e.limits is not None]
    motion: FloatArray = -inverse @ np.column_stack([basis.T @ stiffness @ basis, basis.T @ damping @ basis])
    inputs = inverse @ np.column_stack([basis.T @ push, directions.T])
    return Compiled(
        basis=basis,
        directions=directions,
        shares=np.ascontiguousarray(directions @ inverse),
        compliance=np.einsum("ij,jk,ik->i", directions, inverse, directions),
        codes=np.array([e.code for e in elements], dtype=np.int64),
        params=np.array([e.row + [0.0] * (WIDTH - len(e.row)) for e in elements]).reshape(len(elements), WIDTH),
        sticking=np.array(sticking, dtype=np.int64),
        limits=np.array([e.limits for e in elements if e.limits is not None]).reshape(len(sticking), 2),
        phases=_phases(motion, inputs, directions, inverse, sticking, h),
    )


def constraint_basis(model: RigModel, rigid: Sequence[Link]) -> FloatArray:
    """Full coordinates from those that rigid links leave free, shape (bodies, free)."""
    basis = np.eye(len(model.bodies))
    for link in rigid:
        row = direction(model, link.a, link.b, link.arms) @ basis
        gone = int(np.argmax(np.abs(row)))
        step = np.delete(np.eye(basis.shape[1]), gone, axis=1)
        step[gone] = -np.delete(row, gone) / row[gone]
        basis = basis @ step
    return basis


def _elements(model: RigModel, blocked: frozenset[str], basis: FloatArray) -> list[_Element]:
    # A lock grips: across it neither laws nor contacts act.
    found = []
    for link in model.links:
        if link.name not in blocked:
            w = direction(model, link.a, link.b, link.arms) @ basis
            found += [_Element(direction=w, code=CODES[type(law)], row=_link_row(link, law)) for law in link.laws]
    for contact in model.contacts:
        if contact.name not in blocked:
            w = direction(model, contact.a, contact.b, contact.arms) @ basis
            row, limits = _friction_row(contact.law)
            found.append(_Element(direction=w, code=CODES[type(contact.law)], row=row, limits=limits))
    return found


def _phases(
    motion: FloatArray,
    inputs: FloatArray,
    directions: FloatArray,
    inverse: FloatArray,
    sticking: Sequence[int],
    h: float,
) -> Phases:
    from scipy.linalg import expm

    n, m = motion.shape
    q, contacts = inputs.shape[1], len(sticking)
    count = 1 << contacts
    system, given = np.zeros((count, m, m)), np.zeros((count, m, q))
    step, start, end = np.zeros((count, m, m)), np.zeros((count, m, q)), np.zeros((count, m, q))
    holding = np.zeros((count, max(contacts, 1), m + q))
    for phase in range(count):
        acceleration = np.column_stack([motion, inputs])
        held = [c for c in range(contacts) if phase >> c & 1]
        if held:
            w = directions[[sticking[c] for c in held]]
            # The force that keeps the relative acceleration zero; two contacts along one line share it.
            force = np.linalg.pinv(w @ inverse @ w.T) @ w @ acceleration
            holding[phase, held] = force
            acceleration = acceleration - inverse @ w.T @ force
        system[phase, :n, n:] = np.eye(n)
        system[phase, n:] = acceleration[:, :m]
        given[phase, n:] = acceleration[:, m:]
        whole = np.zeros((m + 2 * q, m + 2 * q))
        whole[:m, :m] = system[phase] * h
        whole[:m, m : m + q] = given[phase] * h
        whole[m : m + q, m + q :] = np.eye(q)
        moved = expm(whole)
        step[phase] = moved[:m, :m]
        end[phase] = moved[:m, m + q :]
        start[phase] = moved[:m, m : m + q] - end[phase]
    return Phases(system=system, inputs=given, step=step, start=start, end=end, holding=holding)


def _link_row(link: Link, law: laws.LinkLaw) -> list[float]:
    match law:
        case laws.Cubic():
            return [law.cubic_stiffness]
        case laws.BoundedSoftening():
            return [link.stiffness, law.softening, law.scale]
        case laws.Backlash():
            return [link.stiffness * (1 - law.residual), law.clearance]
        case laws.EndStop():
            return [law.stroke, law.contact_stiffness, law.contact_damping]
        case laws.QuadraticDamping():
            return [law.quadratic_damping]
        case laws.Drift():
            return [link.stiffness, law.drift_rate, 1e18 if law.until is None else law.until]


def _friction_row(law: laws.FrictionLaw) -> tuple[list[float], tuple[float, float] | None]:
    # Parameters, and the breakaway forces each way of a law that sticks.
    match law:
        case laws.Coulomb():
            static = law.friction_force if law.static_force is None else law.static_force
            return [law.friction_force], (static, static)
        case laws.Stribeck():
            shape = 0.0 if law.shape == "exponential" else 1.0
            row = [law.friction_force, law.static_force, law.stribeck_velocity, law.exponent, shape]
            return row, (law.static_force, law.static_force)
        case laws.Asymmetric():
            row = [law.forward_force, law.backward_force, law.forward_viscosity, law.backward_viscosity]
            return row, (law.forward_force, law.backward_force)
        case laws.Dahl():
            return [law.friction_force, law.bristle_stiffness], None
        case laws.Arctan():
            return [law.friction_force, law.smoothing_velocity], None
        case laws.Viscous():
            return [law.viscous_coefficient], None
