"""A spring and a damper in series."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.jit import kernel
from isorig.analysis.laws.base import NO_LINK, LinkConstants, Parameter, SpringLaw
from isorig.analysis.laws.elements import Element, Formula


class Maxwell(SpringLaw, frozen=True, kw_only=True, tag="maxwell"):
    """A spring and a damper in series: df/dt = relaxation_stiffness v - f / relaxation_time (N/m, s).

    With the link's own spring it is the standard linear solid (Zener, Elasticity and Anelasticity of Metals, 1948), e.g. a rubber
    mount, a hose or a cable: its complex stiffness is k1 j w T / (1 + j w T), so it stiffens from zero to k1 around w = 1 / T.
    """

    relaxation_stiffness: Annotated[float, Parameter("N/m", 1e2, 1e4, least=0.0)]
    relaxation_time: Annotated[float, Parameter("s", 2e-3, 0.2, above=0.0)]
    remembers: ClassVar[bool] = True

    def element(self, link: LinkConstants) -> Element:
        params = (self.relaxation_stiffness, self.relaxation_time)
        return Element(formula=FORMULA, params=params, memories=1, steepest=(self.relaxation_stiffness, 0.0))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return memory[0]

    def rates(self, d: float, v: float, memory: FloatArray) -> FloatArray:
        return np.array([self.relaxation_stiffness * v - memory[0] / self.relaxation_time])

    def along(self, d: FloatArray, v: FloatArray, rate: float, link: LinkConstants = NO_LINK) -> FloatArray:
        from scipy.signal import lfilter

        # The damper's elongation, which lags behind d: a first-order filter, exact for an elongation linear between samples.
        steps = 1.0 / (rate * self.relaxation_time)
        kept = np.exp(-steps)
        new = 1.0 - (1.0 - kept) / steps
        lag = lfilter([new, 1.0 - kept - new], [1.0, -kept], d - d[0])
        return np.asarray(self.relaxation_stiffness * (d - d[0] - lag))


@kernel
def resist(p: FloatArray, gate: float, memory: FloatArray, d: float, v: float, t: float) -> float:
    return memory[0]


@kernel
def carry(
    p: FloatArray, memory: FloatArray, after: FloatArray, d0: float, d1: float, v0: float, vm: float, v1: float,
    low: float, high: float, h: float,
) -> None:  # fmt: skip
    # RK4 in sub-steps with parabolic velocity.
    b, c = -3.0 * v0 + 4.0 * vm - v1, 2.0 * (v0 - 2.0 * vm + v1)
    rate, f = 1.0 / p[1], memory[0]
    parts = 1 + int(5.0 * rate * (high - low) * h)
    dx = (high - low) / parts
    for k in range(parts):
        x = low + k * dx
        xm, x1 = x + 0.5 * dx, x + dx
        va, vb, vc = v0 + x * (b + c * x), v0 + xm * (b + c * xm), v0 + x1 * (b + c * x1)
        k1 = p[0] * va - rate * f
        k2 = p[0] * vb - rate * (f + 0.5 * dx * h * k1)
        k3 = p[0] * vb - rate * (f + 0.5 * dx * h * k2)
        k4 = p[0] * vc - rate * (f + dx * h * k3)
        f += dx * h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
    after[0] = f


FORMULA = Formula(resist=resist, carry=carry)
