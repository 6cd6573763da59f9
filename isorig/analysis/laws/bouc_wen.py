"""Hysteresis with adjustable sharpness of the loop's corners."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.jit import kernel
from isorig.analysis.laws.base import NO_LINK, ContactLaw, LinkConstants, Parameter
from isorig.analysis.laws.elements import Element, Formula
from isorig.analysis.laws.shapes import integrated

#: The curve of z in one direction: its step and its points, which reach z = 1 to rounding, and its distance from the rest at -1.
#: Linear in between, z is off by less than 1e-4 up to the largest practical sharpness.
STEP, POINTS, NEAR = 1.0 / 128.0, 4096, 1e-6


class BoucWen(ContactLaw, frozen=True, kw_only=True, tag="bouc_wen"):
    """force = friction_force z, dz/dt = (k / F) (v - b |v| z |z|^(n - 1) - (1 - b) v |z|^n), |z| never above 1.

    F is `friction_force` (N), k the `initial_stiffness` (N/m), n the `sharpness` of the loop's corners and b the `pinching` in
    [0, 1]: with 1 unloading is as stiff as loading. With n = 1 and b = 1 it is Dahl's law (Bouc 1967; Wen, J. Eng. Mech. Div.
    102, 1976).
    """

    friction_force: Annotated[float, Parameter("N", 1.0, 12.0, above=0.0)]
    initial_stiffness: Annotated[float, Parameter("N/m", 1e3, 1e4, above=0.0)]
    sharpness: Annotated[float, Parameter("1", 1.0, 3.0, least=1.0)] = 1.0
    pinching: Annotated[float, Parameter("1", 0.5, 1.0, least=0.0, most=1.0)] = 0.5
    remembers: ClassVar[bool] = True

    @property
    def _params(self) -> tuple[float, ...]:
        return self.friction_force, self.initial_stiffness, self.sharpness, self.pinching

    def element(self, link: LinkConstants) -> Element:
        return Element(formula=FORMULA, params=self._params, memories=1, steepest=(2.0 * self.initial_stiffness, 0.0))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return self.friction_force * memory[0]

    def rates(self, d: float, v: float, memory: FloatArray) -> FloatArray:
        z, n, b = memory, self.sharpness, self.pinching
        bent = b * abs(v) * z * np.abs(z) ** (n - 1.0) + (1.0 - b) * v * np.abs(z) ** n
        return np.asarray(self.initial_stiffness / self.friction_force * (v - bent))

    def along(self, d: FloatArray, v: FloatArray, rate: float, link: LinkConstants = NO_LINK) -> FloatArray:
        out = np.empty(len(v))
        bent_along(np.array(self._params), np.ascontiguousarray(v) / rate, np.empty(POINTS), out)
        return out


@kernel
def rate(p: FloatArray, z: float, v: float) -> float:
    """dz/dt."""
    near = abs(z) ** (p[2] - 1.0) if p[2] != 1.0 else 1.0
    return p[1] / p[0] * (v - near * (p[3] * abs(v) * z + (1.0 - p[3]) * v * abs(z)))


@kernel
def bent_along(p: FloatArray, distance: FloatArray, loading: FloatArray, out: FloatArray) -> None:
    """Forces after each of the distances (m), one after another, into `out`, shape (n,).

    In one direction z follows one curve over the distance, in units of F / k: from -1 to 1, that is from one reversal of a full
    loop to the other. `loading` is filled with it, and every reversal is a jump on the curve.
    """
    z = -1.0 + NEAR
    for k in range(len(loading)):
        loading[k] = z
        z = integrated(rate, p, z, p[2], 1.0, 1.0, 1.0, 0.0, 1.0, STEP * p[0] / p[1])
    sign, at = 1.0, place(loading, 0.0)
    for k in range(len(distance)):
        x = distance[k]
        if x * sign < 0.0:
            sign, at = -sign, place(loading, -between(loading, at))
        at += abs(x) * p[1] / (p[0] * STEP)
        out[k] = sign * p[0] * between(loading, at)


@kernel
def place(rising: FloatArray, value: float) -> float:
    """Index, with its fraction, at which an array that rises reaches a value; within the array."""
    low = min(max(int(np.searchsorted(rising, value, side="right")) - 1, 0), len(rising) - 2)
    part = (value - rising[low]) / max(rising[low + 1] - rising[low], 1e-300)
    return low + min(max(part, 0.0), 1.0)


@kernel
def between(values: FloatArray, at: float) -> float:
    """Value at an index with a fraction, linear in between; the last one beyond the end."""
    k = int(min(at, 1e9))
    return values[k] + (at - k) * (values[k + 1] - values[k]) if k < len(values) - 1 else values[-1]


@kernel
def resist(p: FloatArray, gate: float, memory: FloatArray, d: float, v: float, t: float) -> float:
    return p[0] * memory[0]


@kernel
def carry(
    p: FloatArray, memory: FloatArray, after: FloatArray, d0: float, d1: float, v0: float, vm: float, v1: float,
    low: float, high: float, h: float,
) -> None:  # fmt: skip
    after[0] = integrated(rate, p, memory[0], p[2] * p[1] / p[0], v0, vm, v1, low, high, h)


FORMULA = Formula(resist=resist, carry=carry)
