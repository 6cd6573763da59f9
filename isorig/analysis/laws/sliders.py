"""Springs that are in series with sliders: their memory is where these are."""

from typing import Annotated, ClassVar

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import ModelError
from isorig.analysis.jit import kernel
from isorig.analysis.laws.base import ContactLaw, LinkConstants, Parameter, SpringLaw
from isorig.analysis.laws.elements import Element, Formula
from isorig.analysis.laws.hysteresis import turning, way

#: Maximum number of springs of a contact.
MOST = 16


@kernel
def reversal(d0: float, v0: float, vm: float, v1: float, low: float, high: float, h: float) -> float:
    """Elongation in m at which the velocity changes sign between `low` and `high`; d0, that at `low`, if it does not."""
    x = turning(v0, vm, v1, low, high)
    return d0 + way(v0, vm, v1, low, x, h) if x >= 0.0 else d0


@kernel
def dragged(u: float, give: float, d: float) -> float:
    """Position of a slider that is dragged once the elongation, moving linearly to d, leads it by more than `give`."""
    return d - give if d - u > give else (d + give if u - d > give else u)


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
        params = (1.0, self.clearance, self.spring_stiffness, self.slip_force)
        return Element(formula=SLIDERS, params=params, memories=1, steepest=(self.spring_stiffness, 0.0))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        x = d - memory[0]
        return np.asarray(self.spring_stiffness * np.sign(x) * np.maximum(np.abs(x) - self.clearance, 0.0))

    def rates(self, d: float, v: float, memory: FloatArray) -> FloatArray:
        lead = d - memory[0]
        slips = abs(lead) >= self.slip_force / self.spring_stiffness + self.clearance and lead * v > 0.0
        return np.array([v if slips else 0.0])


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
            formula=SLIDERS, params=(float(count), 0.0, *pairs), memories=count, steepest=(2.0 * sum(self.stiffnesses), 0.0)
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
    """The parameters of both laws are the number of springs, their clearance, and the stiffness and slip force of each."""
    force = 0.0
    for i in range(int(p[0])):
        x = d - memory[i]
        force += p[2 + 2 * i] * (x - min(max(x, -p[1]), p[1]))
    return force


@kernel
def carry(
    p: FloatArray, memory: FloatArray, after: FloatArray, d0: float, d1: float, v0: float, vm: float, v1: float,
    low: float, high: float, h: float,
) -> None:  # fmt: skip
    # Split where the velocity changes sign: the elongation is linear in between.
    turn = reversal(d0, v0, vm, v1, low, high, h)
    for i in range(int(p[0])):
        give = p[3 + 2 * i] / p[2 + 2 * i] + p[1]
        after[i] = dragged(dragged(memory[i], give, turn), give, d1)


@kernel
def to_kink(p: FloatArray, memory: FloatArray, d: float, sign: float) -> float:
    nearest = np.inf
    for i in range(int(p[0])):
        x = sign * (d - memory[i])
        # Until contact is lost, until it is made, until the slider moves.
        for kink in (-p[1], p[1], p[3 + 2 * i] / p[2 + 2 * i] + p[1]):
            if 0.0 < kink - x < nearest and (kink > p[1] or p[1] > 0.0):
                nearest = kink - x
    return nearest


SLIDERS = Formula(resist=resist, carry=carry, to_kink=to_kink)
