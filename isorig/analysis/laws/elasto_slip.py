"""Play, a spring and a slider in series."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.jit import kernel
from isorig.analysis.laws.base import NO_LINK, LinkConstants, Parameter, SpringLaw
from isorig.analysis.laws.elements import Element, Formula
from isorig.analysis.laws.shapes import dragged, reversal


class ElastoSlip(SpringLaw, frozen=True, kw_only=True, tag="elasto_slip"):
    """Play, a spring and a slider in series: force = spring_stiffness * (part of d - u beyond `clearance`).

    u is the slider's position. It moves only as far as needed to keep |force| at slip_force (N). `clearance` (m) is half the
    play; without play it is Jenkin's element, and several in parallel are the Maxwell-slip (Iwan) model of hysteresis (Iwan, J.
    Appl. Mech. 33, 1966).
    """

    spring_stiffness: Annotated[float, Parameter("N/m", 3e2, 1e4, above=0.0)]
    slip_force: Annotated[float, Parameter("N", 1.0, 10.0, least=0.0)]
    clearance: Annotated[float, Parameter("m", 0.0, 5e-3, least=0.0)] = 0.0
    remembers: ClassVar[bool] = True

    def element(self, link: LinkConstants) -> Element:
        params = (self.spring_stiffness, self.slip_force, self.clearance)
        return Element(formula=FORMULA, params=params, memories=1, steepest=(self.spring_stiffness, 0.0))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        x = d - memory[0]
        return np.asarray(self.spring_stiffness * np.sign(x) * np.maximum(np.abs(x) - self.clearance, 0.0))

    def rates(self, d: float, v: float, memory: FloatArray) -> FloatArray:
        lead = d - memory[0]
        slips = abs(lead) >= self.slip_force / self.spring_stiffness + self.clearance and lead * v > 0.0
        return np.array([v if slips else 0.0])

    def along(self, d: FloatArray, v: FloatArray, rate: float, link: LinkConstants = NO_LINK) -> FloatArray:
        sliders = np.empty(len(d))
        dragged_along(self.slip_force / self.spring_stiffness + self.clearance, np.ascontiguousarray(d), sliders)
        return self.force(d, v, d, sliders[None], link)


@kernel
def resist(p: FloatArray, gate: float, memory: FloatArray, d: float, v: float, t: float) -> float:
    x, clearance = d - memory[0], p[2]
    return p[0] * (x - clearance if x > clearance else (x + clearance if x < -clearance else 0.0))


@kernel
def carry(
    p: FloatArray, memory: FloatArray, after: FloatArray, d0: float, d1: float, v0: float, vm: float, v1: float,
    low: float, high: float, h: float,
) -> None:  # fmt: skip
    # Split where the velocity changes sign: the elongation is linear in between.
    give = p[1] / p[0] + p[2]
    after[0] = dragged(dragged(memory[0], give, reversal(d0, v0, vm, v1, low, high, h)), give, d1)


@kernel
def dragged_along(give: float, d: FloatArray, out: FloatArray) -> None:
    """Positions of a slider for elongations d (m), linear between samples, into `out`, shape (n,)."""
    u = 0.0
    for k in range(len(d)):
        u = dragged(u, give, d[k])
        out[k] = u


@kernel
def to_kink(p: FloatArray, memory: FloatArray, d: float, sign: float) -> float:
    clearance, x = p[2], sign * (d - memory[0])
    # In order along the motion: contact is lost, contact is made, the slider moves.
    if clearance > 0.0 and x < clearance:
        return -clearance - x if x < -clearance else clearance - x
    slips = p[1] / p[0] + clearance
    return slips - x if x < slips else np.inf


FORMULA = Formula(resist=resist, carry=carry, to_kink=to_kink)
