"""Forces with a memory that follows a differential equation: bristles, hysteresis loops, relaxation."""

from collections.abc import Callable
from functools import lru_cache
from typing import Annotated, ClassVar

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.jit import inlined, kernel
from isorig.analysis.laws.base import NO_LINK, ContactLaw, LinkConstants, Parameter, SpringLaw
from isorig.analysis.laws.elements import Element, Formula
from isorig.analysis.laws.friction import falling

#: Relative change of a state variable in one Runge-Kutta step, below which it is rounding: steady sliding is not integrated.
SATURATED = 1e-13
#: Runge-Kutta steps in the distance over which a state variable changes by a factor of e: (1/5)^5 / 120 = 3e-6 of error in each.
STEPS = 5.0
#: The curve of z in one direction: its step and its points, which reach z = 1 to rounding, and its distance from the rest at -1.
#: Linear in between, z is off by less than 1e-4 up to the largest practical sharpness.
STEP, POINTS, NEAR = 1.0 / 128.0, 4096, 1e-6
#: Largest exponent of a force that grows with the distance: a simulation that leaves the data stays finite.
STRONGEST = 50.0
#: Time constants up to which a relaxation is computed from a series: its error and rounding are below 1e-9 there.
SHORT = 0.01
#: Stiffness of a loop that stiffens, over its initial one, up to which the step of a simulation is fine. Chosen: published loops
#: reach three times.
STEEPENED = 4.0


@kernel
def turning(v0: float, vm: float, v1: float, low: float, high: float) -> float:
    """Zero between `low` and `high` (fractions of a step) of the parabola through three velocities; -1 if there is none."""
    b, c = -3.0 * v0 + 4.0 * vm - v1, 2.0 * (v0 - 2.0 * vm + v1)
    at_low, at_high = v0 + low * (b + c * low), v0 + high * (b + c * high)
    if at_low * at_high >= 0.0:
        return -1.0
    # Both zeros without cancellation; one of them lies in between.
    q = -0.5 * (b + np.copysign(np.sqrt(max(b * b - 4.0 * c * v0, 0.0)), b))
    x = v0 / q if q != 0.0 else low
    if not low <= x <= high and c != 0.0:
        x = q / c
    return min(max(x, low), high)


@kernel
def way(v0: float, vm: float, v1: float, low: float, x: float, h: float) -> float:
    """Distance in m from fraction `low` of a step of h seconds to fraction x with the parabola through three velocities."""
    b, c = -3.0 * v0 + 4.0 * vm - v1, 2.0 * (v0 - 2.0 * vm + v1)
    return h * ((x - low) * v0 + b * (x * x - low * low) / 2.0 + c * (x**3 - low**3) / 3.0)


@inlined
def integrated(
    rate: Callable[[FloatArray, float, float], float], p: FloatArray, z: float, fastest: float, v0: float, vm: float, v1: float,
    low: float, high: float, h: float,
) -> float:  # fmt: skip
    """State variable at the fraction `high` of a step of h seconds from its value z at `low`, by classical Runge-Kutta steps.

    ``rate(p, z, v)`` is dz/dt at the velocity v, and `fastest` the rate in 1/m at which z can change with the distance. The
    velocity is the parabola through three velocities. Steps end where it changes sign, because the rate has a kink there.
    """
    b, c = -3.0 * v0 + 4.0 * vm - v1, 2.0 * (v0 - 2.0 * vm + v1)
    steps = STEPS * fastest * max(abs(v0), abs(vm), abs(v1)) * h
    x = turning(v0, vm, v1, low, high)
    for begin, end in ((low, high), (high, high)) if x < 0.0 else ((low, x), (x, high)):
        parts = 1 + int(steps * (end - begin))
        dx = (end - begin) / parts
        for k in range(parts):
            x = begin + k * dx
            xm, x1 = x + 0.5 * dx, x + dx
            va, vb, vc = v0 + x * (b + c * x), v0 + xm * (b + c * xm), v0 + x1 * (b + c * x1)
            k1 = rate(p, z, va)
            k2 = rate(p, z + 0.5 * dx * h * k1, vb)
            if abs(k2) * dx * h <= SATURATED * abs(z):  # at x itself the velocity may be zero
                break
            k3 = rate(p, z + 0.5 * dx * h * k2, vb)
            k4 = rate(p, z + dx * h * k3, vc)
            z += dx * h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
    return z


@inlined
def carried(
    step: Callable[[float, FloatArray, float], float], p: FloatArray, f: float, d0: float, d1: float,
    v0: float, vm: float, v1: float, low: float, high: float, h: float,
) -> float:  # fmt: skip
    """Force at the fraction `high` of a step of h seconds from its value f at `low`.

    ``step(f, p, x)`` is the force after a distance x (m) in one direction; the step is split where the velocity changes sign.
    """
    x = turning(v0, vm, v1, low, high)
    if x < 0.0:
        return step(f, p, d1 - d0)
    gone = way(v0, vm, v1, low, x, h)
    return step(step(f, p, gone), p, d1 - d0 - gone)


@kernel
def remembered(p: FloatArray, gate: float, memory: FloatArray, d: float, v: float, t: float) -> float:
    return memory[0]


class Dahl(ContactLaw, frozen=True, kw_only=True, tag="dahl"):
    """df/dt = bristle_stiffness v (1 - f sign(v) / friction_force): elastic before it slides (N/m)."""

    friction_force: Annotated[float, Parameter("N", 1.0, 12.0, above=0.0)]
    bristle_stiffness: Annotated[float, Parameter("N/m", 1e3, 3e4, above=0.0)]
    remembers: ClassVar[bool] = True

    def element(self, link: LinkConstants) -> Element:
        params = (self.friction_force, self.bristle_stiffness)
        return Element(formula=DAHL, params=params, memories=1, steepest=(2.0 * self.bristle_stiffness, 0.0))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return memory[0]

    def rates(self, d: float, v: float, memory: FloatArray) -> FloatArray:
        return np.array([self.bristle_stiffness * (v - abs(v) * memory[0] / self.friction_force)])


@kernel
def slid(f: float, p: FloatArray, x: float) -> float:
    """Force after a distance x (m) in one direction: df/dx = k (1 - f sign(v) / Fc) in closed form."""
    s = 1.0 if x >= 0.0 else -1.0
    return s * p[0] + (f - s * p[0]) * np.exp(-p[1] * abs(x) / p[0])


@kernel
def dahl_carry(
    p: FloatArray, memory: FloatArray, after: FloatArray, d0: float, d1: float, v0: float, vm: float, v1: float,
    low: float, high: float, h: float,
) -> None:  # fmt: skip
    after[0] = carried(slid, p, memory[0], d0, d1, v0, vm, v1, low, high, h)


DAHL = Formula(resist=remembered, carry=dahl_carry)


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
        return Element(formula=BOUC_WEN, params=self._params, memories=1, steepest=(2.0 * self.initial_stiffness, 0.0))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return self.friction_force * memory[0]

    def rates(self, d: float, v: float, memory: FloatArray) -> FloatArray:
        z, n, b = memory, self.sharpness, self.pinching
        bent = b * abs(v) * z * np.abs(z) ** (n - 1.0) + (1.0 - b) * v * np.abs(z) ** n
        return np.asarray(self.initial_stiffness / self.friction_force * (v - bent))

    def along(self, d: FloatArray, v: FloatArray, rate: float, link: LinkConstants = NO_LINK) -> FloatArray:
        out = np.empty(len(v))
        bent_along(np.array(self._params), np.diff(d, prepend=d[:1]), _loading(self.sharpness, self.pinching), out)
        return out


@lru_cache(maxsize=64)  # of all runs, and of fits of the other two values
def _loading(sharpness: float, pinching: float) -> FloatArray:
    # z over the distance in one direction, in units of F / k: from -1 to 1, from one reversal of a full loop to the other.
    out = np.empty(POINTS)
    loaded(np.array([1.0, 1.0, sharpness, pinching]), out)
    return out


@kernel
def bend_rate(p: FloatArray, z: float, v: float) -> float:
    """dz/dt."""
    near = abs(z) ** (p[2] - 1.0) if p[2] != 1.0 else 1.0
    return p[1] / p[0] * (v - near * (p[3] * abs(v) * z + (1.0 - p[3]) * v * abs(z)))


@kernel
def loaded(p: FloatArray, out: FloatArray) -> None:
    """z at steps of the distance in one direction, from -1, into `out`, shape (points,); of a law with F = k."""
    z = -1.0 + NEAR
    for k in range(len(out)):
        out[k] = z
        z = integrated(bend_rate, p, z, p[2], 1.0, 1.0, 1.0, 0.0, 1.0, STEP)


@kernel
def bent_along(p: FloatArray, distance: FloatArray, loading: FloatArray, out: FloatArray) -> None:
    """Forces after each of the distances (m), one after another, into `out`, shape (n,).

    In one direction z follows one curve over the distance, `loading`, and every reversal is a jump on the curve.
    """
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
def bouc_wen_resist(p: FloatArray, gate: float, memory: FloatArray, d: float, v: float, t: float) -> float:
    return p[0] * memory[0]


@kernel
def bouc_wen_carry(
    p: FloatArray, memory: FloatArray, after: FloatArray, d0: float, d1: float, v0: float, vm: float, v1: float,
    low: float, high: float, h: float,
) -> None:  # fmt: skip
    after[0] = integrated(bend_rate, p, memory[0], p[2] * p[1] / p[0], v0, vm, v1, low, high, h)


BOUC_WEN = Formula(resist=bouc_wen_resist, carry=bouc_wen_carry)


class StiffeningHysteresis(SpringLaw, frozen=True, kw_only=True, tag="stiffening_hysteresis"):
    """df/dt = v (k + |f| (stiffening - dissipation sign(v f))), k the `initial_stiffness` (N/m): a loop that does not saturate.

    Loaded from f = 0 the stiffness changes by (stiffening - dissipation) |f|, unloaded by (stiffening + dissipation) |f|, both
    in 1/m: it is Bouc and Wen's law with n = 1, A = k, beta = `dissipation` and gamma = -`stiffening`, whose loop is limited only
    if beta + gamma > 0 (Ismail, Ikhouane and Rodellar, Arch. Comput. Methods Eng. 16, 161, 2009).
    """

    initial_stiffness: Annotated[float, Parameter("N/m", 1e3, 1e4, above=0.0)]
    stiffening: Annotated[float, Parameter("1/m", 10.0, 200.0, least=0.0)]
    dissipation: Annotated[float, Parameter("1/m", 10.0, 200.0, least=0.0)]
    remembers: ClassVar[bool] = True

    @property
    def _params(self) -> tuple[float, ...]:
        return self.initial_stiffness, self.stiffening - self.dissipation, self.stiffening + self.dissipation

    def element(self, link: LinkConstants) -> Element:
        return Element(
            formula=STIFFENING, params=self._params, memories=1, steepest=(STEEPENED * self.initial_stiffness, 0.0)
        )  # fmt: skip

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return memory[0]

    def rates(self, d: float, v: float, memory: FloatArray) -> FloatArray:
        f = memory[0]
        return np.array([v * (self.initial_stiffness + abs(f) * (self.stiffening - self.dissipation * np.sign(v * f)))])


@kernel
def grown(f: float, k: float, growth: float, x: float) -> float:
    """Solution of df/dx = k + growth f after a distance x."""
    exponent = min(growth * x, STRONGEST)
    return f + (k + growth * f) * (np.expm1(exponent) / growth if exponent != 0.0 else x)


@kernel
def stiffened(f: float, p: FloatArray, x: float) -> float:
    """Force after a distance x (m) in one direction, in closed form: unloaded to zero, then loaded."""
    s = 1.0 if x >= 0.0 else -1.0
    f, x = s * f, abs(x)
    if f < 0.0:
        unloaded = np.log1p(-p[2] * f / p[0]) / p[2] if p[2] != 0.0 else -f / p[0]
        if unloaded >= x:
            return s * grown(f, p[0], -p[2], x)
        f, x = 0.0, x - unloaded
    return s * grown(f, p[0], p[1], x)


@kernel
def stiffening_carry(
    p: FloatArray, memory: FloatArray, after: FloatArray, d0: float, d1: float, v0: float, vm: float, v1: float,
    low: float, high: float, h: float,
) -> None:  # fmt: skip
    after[0] = carried(stiffened, p, memory[0], d0, d1, v0, vm, v1, low, high, h)


STIFFENING = Formula(resist=remembered, carry=stiffening_carry)


class LuGre(ContactLaw, frozen=True, kw_only=True, tag="lugre"):
    """Bristles of mean deflection z: force = s0 z + s1 dz/dt + s2 v, dz/dt = v - s0 |v| z / g(v).

    g(v) = Fc + (Fs - Fc) exp(-|v / vs|^exponent); s0 is `bristle_stiffness` (N/m), s1 `bristle_damping` and s2
    `viscous_coefficient` (N s/m) (Canudas de Wit et al., IEEE Trans. Autom. Control 40, 1995).
    """

    bristle_stiffness: Annotated[float, Parameter("N/m", 1e3, 3e4, above=0.0)]
    friction_force: Annotated[float, Parameter("N", 1.0, 12.0, above=0.0)]
    static_force: Annotated[float, Parameter("N", 1.0, 20.0)]
    stribeck_velocity: Annotated[float, Parameter("m/s", 5e-3, 0.1, above=0.0)]
    bristle_damping: Annotated[float, Parameter("N s/m", 0.0, 20.0, least=0.0)] = 0.0
    viscous_coefficient: Annotated[float, Parameter("N s/m", 0.0, 20.0, least=0.0)] = 0.0
    exponent: Annotated[float, Parameter("1", 1.0, 2.0, above=0.0)] = 2.0
    remembers: ClassVar[bool] = True

    @property
    def _params(self) -> tuple[float, ...]:
        return (
            self.bristle_stiffness, self.bristle_damping, self.viscous_coefficient, self.friction_force,
            self.static_force - self.friction_force, self.stribeck_velocity, self.exponent,
        )  # fmt: skip

    def element(self, link: LinkConstants) -> Element:
        steepest = 2.0 * self.bristle_stiffness, 2.0 * (self.bristle_damping + self.viscous_coefficient)
        return Element(formula=LUGRE, memories=1, steepest=steepest, params=self._params)

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        moving = v - self.bristle_stiffness * np.abs(v) * memory[0] / self._level(v)
        return np.asarray(self.bristle_stiffness * memory[0] + self.bristle_damping * moving + self.viscous_coefficient * v)

    def rates(self, d: float, v: float, memory: FloatArray) -> FloatArray:
        return np.asarray(v - self.bristle_stiffness * abs(v) * memory / self._level(np.array(v)))

    def _level(self, v: FloatArray) -> FloatArray:
        return falling(v, self.friction_force, self.static_force, self.stribeck_velocity, self.exponent)


@kernel
def bristle_rate(p: FloatArray, z: float, v: float) -> float:
    """dz/dt of the mean bristle."""
    level = p[3] + p[4] * np.exp(-((abs(v) / p[5]) ** p[6]))
    return v - p[0] * abs(v) * z / level


@kernel
def lugre_resist(p: FloatArray, gate: float, memory: FloatArray, d: float, v: float, t: float) -> float:
    return p[0] * memory[0] + p[1] * bristle_rate(p, memory[0], v) + p[2] * v


@kernel
def lugre_carry(
    p: FloatArray, memory: FloatArray, after: FloatArray, d0: float, d1: float, v0: float, vm: float, v1: float,
    low: float, high: float, h: float,
) -> None:  # fmt: skip
    after[0] = integrated(bristle_rate, p, memory[0], p[0] / p[3], v0, vm, v1, low, high, h)


LUGRE = Formula(resist=lugre_resist, carry=lugre_carry)


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
        return Element(formula=MAXWELL, params=params, memories=1, steepest=(self.relaxation_stiffness, 0.0))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return memory[0]

    def rates(self, d: float, v: float, memory: FloatArray) -> FloatArray:
        return np.array([self.relaxation_stiffness * v - memory[0] / self.relaxation_time])


@kernel
def maxwell_carry(
    p: FloatArray, memory: FloatArray, after: FloatArray, d0: float, d1: float, v0: float, vm: float, v1: float,
    low: float, high: float, h: float,
) -> None:  # fmt: skip
    # In closed form: the integrals of exp(-t) times 1, t and t^2 over s time constants, the last by its series if s is small.
    b, c, part = -3.0 * v0 + 4.0 * vm - v1, 2.0 * (v0 - 2.0 * vm + v1), high - low
    s = part * h / p[1]
    third = (0.5 - (1.0 + np.expm1(-s) / s) / s) / s if s > SHORT else 1.0 / 6.0 - s / 24.0 + s * s / 120.0
    second = 0.5 - s * third
    first = 1.0 - s * second
    moved = (v0 + low * (b + c * low)) * first + part * ((b + 2.0 * c * low) * second + 2.0 * c * part * third)
    after[0] = memory[0] * (1.0 - s * first) + p[0] * part * h * moved


MAXWELL = Formula(resist=remembered, carry=maxwell_carry)
