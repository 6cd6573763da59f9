"""Flexures instead of bearings: vertical leaf springs that guide the motor without friction, sized by closed formulas.

Every leaf is clamped at both ends and bends in an S shape as the motor moves along the axis. Its width is vertical, so that the
motor's weight bends it in its stiff direction and does not buckle it. With length L, width b, thickness t and n leaves

    k = n E b t^3 / L^3                      stiffness along the axis
    s = 3 E t d / L^2                        largest bending stress at a deflection d
    f_up = f (b / t)                         vertical natural frequency of the motor, by the same formula with b and t exchanged
    f_leaf = 22.37 / (2 pi L^2) sqrt(E t^2 / (12 rho))   first bending mode of a leaf alone
    P = 4.013 sqrt(E I G J) / (L / 2)^2      lateral buckling load of a leaf, I = b t^3 / 12, J = b t^3 / 3

The last one treats each half of a leaf as a cantilever loaded at the middle of the leaf, where the moment is zero. Leaves that
are not much longer than wide are vertically softer than the beam formula states.

(Euler-Bernoulli beams; Smith, Flexures: Elements of Elastic Mechanisms, 2000, ch. 4; Blevins, Formulas for Natural Frequency and
Mode Shape, 1979, table 8-1; Timoshenko and Gere, Theory of Elastic Stability, 1961, ch. 6.)
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, pi, sqrt

from isorig.analysis.errors import DataError

GRAVITY = 9.81
#: (beta L)^2 of the first mode of a beam clamped at both ends.
CLAMPED = 22.3733
#: Lateral buckling of a narrow cantilever under a load at its end.
SIDEWAYS = 4.013


@dataclass(frozen=True, kw_only=True)
class Material:
    """A spring material: moduli of tension and shear, N/m^2, density, kg/m^3, and endurance limit, N/m^2."""

    name: str
    modulus: float
    shear: float
    density: float
    endurance: float


#: Cold-rolled spring steel, e.g. 1.4310: handbook values; endurance limit for polished edges, half its usual value.
SPRING_STEEL = Material(name="spring steel", modulus=190e9, shear=73e9, density=7900.0, endurance=300e6)


@dataclass(frozen=True, kw_only=True)
class Flexure:
    """A set of leaves."""

    #: Number, and dimensions in m.
    leaves: int
    length: float
    width: float
    thickness: float
    #: Along the axis, N/m and Hz.
    stiffness: float
    frequency: float
    stress: float  #: Largest stress at the stroke, N/m^2.
    #: Natural frequencies of the motor in the vertical direction and of a leaf alone, Hz.
    upright: float
    leaf: float
    sag: float  #: Vertical deflection of the leaves due to the motor's weight, m.
    buckling: float  #: Lateral buckling load of a leaf, divided by its share of the motor's weight.


def flexure(
    mass: float, frequency: float, stroke: float, *, thickness: float, width: float, leaves: int = 4,
    material: Material = SPRING_STEEL,
) -> Flexure:  # fmt: skip
    """The leaves that give a mass a certain frequency, with stress and buckling load.

    The motor's mass is in kg, the frequency in Hz and the stroke, in either direction, in m. Thickness and width of a leaf are in
    m. Raises DataError if a number is not allowed.
    """
    given = {"mass": mass, "frequency": frequency, "stroke": stroke, "thickness": thickness, "width": width, "leaves": leaves}
    for name, value in given.items():
        if not (isfinite(value) and value > 0.0):
            raise DataError(f"the flexure's {name} is {value:g}; give a finite value above zero")
    stiffness = (2.0 * pi * frequency) ** 2 * mass
    length = thickness * (leaves * material.modulus * width / stiffness) ** (1.0 / 3.0)
    upright = leaves * material.modulus * thickness * width**3 / length**3
    bending, twisting = material.modulus * width * thickness**3 / 12.0, material.shear * width * thickness**3 / 3.0
    load = SIDEWAYS * sqrt(bending * twisting) / (0.5 * length) ** 2
    return Flexure(
        leaves=leaves, length=length, width=width, thickness=thickness, stiffness=stiffness, frequency=frequency,
        stress=3.0 * material.modulus * thickness * stroke / length**2, upright=frequency * width / thickness,
        leaf=CLAMPED / (2.0 * pi * length**2) * sqrt(material.modulus * thickness**2 / (12.0 * material.density)),
        sag=mass * GRAVITY / upright, buckling=load / (mass * GRAVITY / leaves),
    )  # fmt: skip


def thinnest(
    mass: float, frequency: float, stroke: float, *, width: float, leaves: int = 4, material: Material = SPRING_STEEL,
    safety: float = 1.5,
) -> Flexure:  # fmt: skip
    """The shortest leaves within endurance limit and lateral buckling load, both with a safety factor.

    With k given, L = t (n E b / k)^(1/3): the stress falls as 1 / t and the buckling load grows as t.
    """
    unit = flexure(mass, frequency, stroke, thickness=1e-3, width=width, leaves=leaves, material=material)
    thickness = 1e-3 * max(unit.stress * safety / material.endurance, safety / unit.buckling)
    return flexure(mass, frequency, stroke, thickness=thickness, width=width, leaves=leaves, material=material)
