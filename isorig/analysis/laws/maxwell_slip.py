"""Friction as many small springs, each with its own slider."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import ModelError
from isorig.analysis.jit import kernel
from isorig.analysis.laws.base import ContactLaw, LinkConstants, Parameter
from isorig.analysis.laws.elements import Element, Formula
from isorig.analysis.laws.shapes import dragged, reversal

#: Maximum number of springs of a contact.
MOST = 16


class MaxwellSlip(ContactLaw, frozen=True, kw_only=True, tag="maxwell_slip"):
    """Parallel springs; spring i of `stiffnesses` (N/m) slips at force i of `slip_forces` (N).

    It has a memory value for every spring, and therefore reproduces the nested hysteresis loops of rolling bearings (Iwan, J.
    Appl. Mech. 33, 1966; Lampaert, Swevers, Al-Bender, IEEE Trans. Autom. Control 47, 2002).
    """

    stiffnesses: Annotated[tuple[float, ...], Parameter("N/m", 1e2, 1e4)]
    slip_forces: Annotated[tuple[float, ...], Parameter("N", 0.3, 6.0)]
    remembers: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= len(self.stiffnesses) == len(self.slip_forces) <= MOST:
            raise ModelError(
                f"there are {len(self.stiffnesses)} stiffnesses but {len(self.slip_forces)} slip forces; "
                f"give one of each for 1 to {MOST} springs"
            )
        lowest = min((*self.stiffnesses, *self.slip_forces))
        if not (lowest > 0.0 and np.isfinite([*self.stiffnesses, *self.slip_forces]).all()):
            raise ModelError(f"a spring's stiffness or slip force is {lowest:g}; give finite numbers above zero")

    def element(self, link: LinkConstants) -> Element:
        pairs = [value for pair in zip(self.stiffnesses, self.slip_forces, strict=True) for value in pair]
        count = len(self.stiffnesses)
        return Element(
            formula=FORMULA, params=(float(count), *pairs), memories=count, steepest=(2.0 * sum(self.stiffnesses), 0.0)
        )

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return np.asarray(np.array(self.stiffnesses) @ (d - memory))

    def begun(self) -> FloatArray:
        return np.zeros(len(self.stiffnesses))

    def rates(self, d: float, v: float, memory: FloatArray) -> FloatArray:
        lead = d - memory
        slips = (np.abs(lead) >= np.array(self.slip_forces) / np.array(self.stiffnesses)) & (lead * v > 0.0)
        return np.where(slips, v, 0.0)


@kernel
def resist(p: FloatArray, gate: float, memory: FloatArray, d: float, v: float, t: float) -> float:
    force = 0.0
    for i in range(int(p[0])):
        force += p[1 + 2 * i] * (d - memory[i])
    return force


@kernel
def carry(
    p: FloatArray, memory: FloatArray, after: FloatArray, d0: float, d1: float, v0: float, vm: float, v1: float,
    low: float, high: float, h: float,
) -> None:  # fmt: skip
    turn = reversal(d0, v0, vm, v1, low, high, h)
    for i in range(int(p[0])):
        give = p[2 + 2 * i] / p[1 + 2 * i]
        after[i] = dragged(dragged(memory[i], give, turn), give, d1)


@kernel
def to_kink(p: FloatArray, memory: FloatArray, d: float, sign: float) -> float:
    nearest = np.inf
    for i in range(int(p[0])):
        # Until this spring slips.
        distance = p[2 + 2 * i] / p[1 + 2 * i] - sign * (d - memory[i])
        if 0.0 < distance < nearest:
            nearest = distance
    return nearest


FORMULA = Formula(resist=resist, carry=carry, to_kink=to_kink)
