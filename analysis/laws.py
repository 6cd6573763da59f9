"""The laws by name: what a link or a contact may do beyond a linear spring and damper, as data.

d is the relative displacement in m and v the relative velocity in m/s along the element; positive forces oppose
positive d and v. Formulas stand in each class.
"""

from __future__ import annotations

import math
from typing import Literal

import msgspec

from analysis.errors import ModelError


def _finite(value: float) -> bool:
    return math.isfinite(value)


class Law(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="law"):
    """Base of all laws: every number finite; those named in `positive` greater than zero, others as said."""

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            value = getattr(self, name)
            if isinstance(value, float) and not _finite(value):
                raise ModelError(f"{name} is {value}; give a finite number")

    def require(self, name: str, *, above: float | None = None, least: float | None = None) -> None:
        """Raise ModelError where the parameter lies at or below `above`, or below `least`."""
        value = getattr(self, name)
        if above is not None and value <= above:
            raise ModelError(f"{name} is {value:g}, which must be greater than {above:g}; correct it")
        if least is not None and value < least:
            raise ModelError(f"{name} is {value:g}, which must be at least {least:g}; correct it")


# ------------------------------------------------------------------------------------------------ links


class Cubic(Law, frozen=True, kw_only=True, tag="cubic"):
    """Force cubic_stiffness * d^3 added to the spring (N/m^3); negative softens."""

    cubic_stiffness: float


class BoundedSoftening(Law, frozen=True, kw_only=True, tag="bounded_softening"):
    """Spring force k ((1 - r) d + r s tanh(d / s)): softening r in [0, 1), scale s in m."""

    softening: float
    scale: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require("scale", above=0.0)
        if not 0.0 <= self.softening < 1.0:
            raise ModelError(f"softening is {self.softening:g}, which must lie in [0, 1); correct it")


class Backlash(Law, frozen=True, kw_only=True, tag="backlash"):
    """Spring acts only beyond `clearance` (m, half the play); inside a share `residual` of the stiffness stays."""

    clearance: float
    residual: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require("clearance", least=0.0)
        if not 0.0 <= self.residual <= 1.0:
            raise ModelError(f"residual is {self.residual:g}, which must lie in [0, 1]; correct it")


class EndStop(Law, frozen=True, kw_only=True, tag="end_stop"):
    """Second spring beyond `stroke` (m) each side: contact_stiffness N/m, contact_damping N s/m, never pulling."""

    stroke: float
    contact_stiffness: float
    contact_damping: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require("stroke", above=0.0)
        self.require("contact_stiffness", least=0.0)
        self.require("contact_damping", least=0.0)


class QuadraticDamping(Law, frozen=True, kw_only=True, tag="quadratic_damping"):
    """Force quadratic_damping * v |v| (N s^2/m^2)."""

    quadratic_damping: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require("quadratic_damping", least=0.0)


class Drift(Law, frozen=True, kw_only=True, tag="drift"):
    """Stiffness k (1 + drift_rate t), drift_rate in 1/s, t from the campaign's first sample, held after `until` s."""

    drift_rate: float
    until: float | None = None


LinkLaw = Cubic | BoundedSoftening | Backlash | EndStop | QuadraticDamping | Drift

# ------------------------------------------------------------------------------------------------ friction


class Viscous(Law, frozen=True, kw_only=True, tag="viscous"):
    """viscous_coefficient * v, N s/m."""

    viscous_coefficient: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require("viscous_coefficient", least=0.0)


class Coulomb(Law, frozen=True, kw_only=True, tag="coulomb"):
    """friction_force * sign(v) while sliding; at rest whatever holds, up to static_force (friction_force where None)."""

    friction_force: float
    static_force: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require("friction_force", least=0.0)
        if self.static_force is not None:
            _breakaway(self.static_force, self.friction_force)


class Stribeck(Law, frozen=True, kw_only=True, tag="stribeck"):
    """Falls from static_force Fs to friction_force Fc with speed.

    exponential: Fc + (Fs - Fc) exp(-|v / vs|^exponent); rational: Fc + (Fs - Fc) / (1 + |v / vs|^exponent).
    """

    friction_force: float
    static_force: float
    stribeck_velocity: float
    exponent: float = 1.0
    shape: Literal["exponential", "rational"] = "exponential"

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require("friction_force", least=0.0)
        self.require("stribeck_velocity", above=0.0)
        self.require("exponent", above=0.0)
        _breakaway(self.static_force, self.friction_force)


class Arctan(Law, frozen=True, kw_only=True, tag="arctan"):
    """(2 / pi) friction_force arctan(v / smoothing_velocity): never sticks."""

    friction_force: float
    smoothing_velocity: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require("friction_force", least=0.0)
        self.require("smoothing_velocity", above=0.0)


class Dahl(Law, frozen=True, kw_only=True, tag="dahl"):
    """df/dt = bristle_stiffness v (1 - f sign(v) / friction_force): elastic before it slides (N/m)."""

    friction_force: float
    bristle_stiffness: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require("friction_force", above=0.0)
        self.require("bristle_stiffness", above=0.0)


class Asymmetric(Law, frozen=True, kw_only=True, tag="asymmetric"):
    """Another dry level (N) and another viscous coefficient (N s/m) each way, forward being v > 0."""

    forward_force: float
    backward_force: float
    forward_viscosity: float = 0.0
    backward_viscosity: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.__struct_fields__:
            self.require(name, least=0.0)


class Karnopp(Law, frozen=True, kw_only=True, tag="karnopp"):
    """Coulomb with a band of speed in which the contact holds: |v| < band (m/s) resists up to static_force.

    Held in the band the speed stays what it was, it is not taken to zero (Karnopp, J. Dyn. Syst. Meas. Control 107,
    1985).
    """

    friction_force: float
    static_force: float
    band: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require("friction_force", least=0.0)
        self.require("band", above=0.0)
        _breakaway(self.static_force, self.friction_force)


class LuGre(Law, frozen=True, kw_only=True, tag="lugre"):
    """Bristles of mean deflection z: force = s0 z + s1 dz/dt + s2 v, dz/dt = v - s0 |v| z / g(v).

    g(v) = Fc + (Fs - Fc) exp(-|v / vs|^exponent); s0 is `bristle_stiffness` (N/m), s1 `bristle_damping` and s2
    `viscous_coefficient` (N s/m) (Canudas de Wit et al., IEEE Trans. Autom. Control 40, 1995).
    """

    bristle_stiffness: float
    friction_force: float
    static_force: float
    stribeck_velocity: float
    bristle_damping: float = 0.0
    viscous_coefficient: float = 0.0
    exponent: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("bristle_stiffness", "friction_force", "stribeck_velocity", "exponent"):
            self.require(name, above=0.0)
        for name in ("bristle_damping", "viscous_coefficient"):
            self.require(name, least=0.0)
        _breakaway(self.static_force, self.friction_force)


def _breakaway(static: float, sliding: float) -> None:
    if static < sliding:
        raise ModelError(
            f"static_force is {static:g} N, below friction_force {sliding:g} N; breakaway is never below sliding friction"
        )


FrictionLaw = Viscous | Coulomb | Stribeck | Arctan | Karnopp | Dahl | LuGre | Asymmetric
