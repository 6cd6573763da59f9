"""The laws by name: forces of a link or a contact beyond a linear spring and damper, one file for each family.

Every file of this package is searched: descriptions and model files can use a law in a new file, and the engine simulates it.

Examples
--------
>>> import isorig as iso
>>> sliding = iso.laws.Stribeck(friction_force=18.0, static_force=26.0, stribeck_velocity=0.005)
>>> sliding.static_force
26.0
"""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING, TypeVar, Union

from isorig.analysis.laws.base import ContactLaw, Law, Parameter, SpringLaw
from isorig.analysis.laws.elements import Formula
from isorig.analysis.laws.friction import Arctan, Asymmetric, Coulomb, Karnopp, PositionDependent, Stribeck, Viscous
from isorig.analysis.laws.hysteresis import BoucWen, Dahl, LuGre, Maxwell, StiffeningHysteresis
from isorig.analysis.laws.sliders import ElastoSlip, MaxwellSlip
from isorig.analysis.laws.springs import (
    AsymmetricDamping,
    Backlash,
    Bilinear,
    BoundedSoftening,
    Cubic,
    DampingDrift,
    Drift,
    EndStop,
    Periodic,
    Polynomial,
    QuadraticDamping,
)
from isorig.analysis.laws.tables import Curve, FrictionCurve

__all__ = [
    "CONTACT_LAWS", "FORMULAS", "LAWS", "SPRING_LAWS", "Arctan", "Asymmetric", "AsymmetricDamping", "Backlash", "Bilinear",
    "BoucWen", "BoundedSoftening", "ContactLaw", "Coulomb", "Cubic", "Curve", "Dahl", "DampingDrift", "Drift", "ElastoSlip",
    "EndStop", "FrictionCurve", "FrictionLaw", "Karnopp", "Law", "LinkLaw", "LuGre", "Maxwell", "MaxwellSlip", "Parameter",
    "Periodic", "Polynomial", "PositionDependent", "QuadraticDamping", "SpringLaw", "StiffeningHysteresis", "Stribeck", "Viscous",
]  # fmt: skip

L = TypeVar("L", bound=Law)
#: Every file of the package.
FILES = [import_module(f"{__name__}.{module.name}") for module in iter_modules(__path__)]


def _found(kind: type[L]) -> tuple[type[L], ...]:
    classes = [value for file in FILES for value in vars(file).values() if isinstance(value, type) and issubclass(value, kind)]
    # A base class of laws has no tag of its own.
    named = {str(law.__struct_config__.tag): law for law in classes if law.__struct_config__.tag != law.__name__}
    return tuple(named[tag] for tag in sorted(named))


#: The available laws of links and of contacts.
SPRING_LAWS, CONTACT_LAWS = _found(SpringLaw), _found(ContactLaw)
LAWS: tuple[type[Law], ...] = (*SPRING_LAWS, *CONTACT_LAWS)
#: Their nonlinear parts, those with memory last.
FORMULAS = sorted(
    {value: None for file in FILES for value in vars(file).values() if isinstance(value, Formula)},
    key=lambda formula: formula.carry is not None,
)

if TYPE_CHECKING:
    LinkLaw = SpringLaw
    FrictionLaw = ContactLaw
else:
    # Types allowed in a description, for its decoder.
    LinkLaw = Union[SPRING_LAWS]  # noqa: UP007
    FrictionLaw = Union[CONTACT_LAWS]  # noqa: UP007
