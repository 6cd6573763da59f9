"""The thesis's simulation of friction, for comparison only: its law as printed, integrated by an adaptive Runge-Kutta 4(5)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import ModelError
from isorig.analysis.laws import Coulomb
from isorig.analysis.model.rig_model import GROUND, RigModel, direction, matrices, weights_of

#: Speed in m/s below which the thesis treats a contact as at rest.
BAND = 1e-6


@dataclass(frozen=True, kw_only=True)
class LiteralRun:
    """The simulated response with the law as printed.

    Parameters
    ----------
    states
        Coordinates in m and their speeds in m/s at every sample, shape (n, 2 bodies).
    friction
        The contact's friction force in N at every sample, shape (n,).
    evaluations
        Number of evaluations of the right-hand side.
    """

    states: FloatArray
    friction: FloatArray
    evaluations: int


def literal_run(
    model: RigModel,
    force: FloatArray,
    sample_rate: float,
    *,
    velocity: Literal["relative", "own"] = "relative",
    holding: Literal["body", "contact"] = "body",
    smoothing: float | None = None,
    between: Literal["nearest", "straight"] = "nearest",
    method: Literal["RK45", "LSODA"] = "RK45",
    rtol: float = 1e-3,
    atol: float = 1e-6,
) -> LiteralRun:
    """Simulate a rig with one Coulomb contact as the thesis does.

    |v| > 1e-6 m/s: fr = Fc sign(v); else fr = Fnet where |Fnet| < Fc, and Fc sign(Fnet) beyond; Fnet is the force on the
    contact's first body alone. On a moving base that force does not keep the bodies together: the relative speed leaves the band
    at once and its sign alternates.

    Parameters
    ----------
    model
        A rig whose only law is one contact's Coulomb friction.
    force
        The drive's force in N, shape (n,).
    sample_rate
        Hz.
    velocity
        The contact's relative speed, or as in the thesis's shortcut the speed of the first body.
    holding
        Static friction force: the thesis's Fnet, the force on the contact's first "body" alone, or the force that keeps both
        sides of the "contact" together, (force_a / m_a - force_b / m_b) / (1 / m_a + 1 / m_b).
    smoothing
        Speed in m/s of the law (2 / pi) Fc arctan(v / smoothing), which replaces the law above; None for the law above.
    between
        Drive force between samples: of the nearest sample, as in the thesis, or linearly interpolated.
    method, rtol, atol
        Arguments of scipy's `solve_ivp`.

    Raises
    ------
    ModelError
        If the rig has other laws.
    """
    from scipy.integrate import solve_ivp

    if len(model.contacts) != 1 or not isinstance(model.contacts[0].law, Coulomb) or any(link.laws for link in model.links):
        raise ModelError(f"the rig {model.name!r} has other laws than one Coulomb contact; use `simulate` for it")
    contact, law = model.contacts[0], model.contacts[0].law
    n = len(model.bodies)
    mass, damping, stiffness = matrices(model)
    weights = np.diag(mass)
    rub = weights_of(model, contact)
    alone = direction(model, contact.a, GROUND, {})
    holds = alone if holding == "body" else (rub / weights) / float(rub @ (rub / weights))
    seen = rub if velocity == "relative" else alone
    push = np.zeros(n)
    for name, factor in model.drive.pushes.items():
        push += factor * direction(model, name, GROUND, {})
    last = len(force) - 1

    def nearest(t: float) -> float:
        return float(force[min(round(t * sample_rate), last)])

    def straight(t: float) -> float:
        k = min(int(t * sample_rate), last - 1)
        return float(force[k] + (force[k + 1] - force[k]) * (t * sample_rate - k))

    at: Callable[[float], float] = nearest if between == "nearest" else straight

    def resistance(t: float, z: FloatArray) -> tuple[float, FloatArray]:
        forces = push * at(t) - stiffness @ z[:n] - damping @ z[n:]
        v = float(seen @ z[n:])
        if smoothing is not None:
            friction = law.friction_force * 2.0 / np.pi * np.arctan(v / smoothing)
        elif abs(v) > BAND:
            friction = law.friction_force * np.sign(v)
        else:
            friction = np.clip(holds @ forces, -law.friction_force, law.friction_force)
        return float(friction), forces

    def rates(t: float, z: FloatArray) -> FloatArray:
        friction, forces = resistance(t, z)
        return np.concatenate([z[n:], (forces - rub * friction) / weights])

    times = np.arange(len(force)) / sample_rate
    # A step of the solver may miss a short pulse.
    found = solve_ivp(rates, (0.0, times[-1]), np.zeros(2 * n), method=method, t_eval=times, rtol=rtol, atol=atol)
    states: FloatArray = found.y.T
    friction = np.array([resistance(t, z)[0] for t, z in zip(times, states, strict=True)])
    return LiteralRun(states=states, friction=friction, evaluations=int(found.nfev))
