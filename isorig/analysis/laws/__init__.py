"""The laws by name: forces of a link or a contact beyond a linear spring and damper, one file for each law.

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

from isorig.analysis.laws.arctan import Arctan as Arctan
from isorig.analysis.laws.asymmetric import Asymmetric as Asymmetric
from isorig.analysis.laws.backlash import Backlash as Backlash
from isorig.analysis.laws.base import ContactLaw as ContactLaw
from isorig.analysis.laws.base import Law as Law
from isorig.analysis.laws.base import Parameter as Parameter
from isorig.analysis.laws.base import SpringLaw as SpringLaw
from isorig.analysis.laws.bouc_wen import BoucWen as BoucWen
from isorig.analysis.laws.bounded_softening import BoundedSoftening as BoundedSoftening
from isorig.analysis.laws.coulomb import Coulomb as Coulomb
from isorig.analysis.laws.cubic import Cubic as Cubic
from isorig.analysis.laws.curve import Curve as Curve
from isorig.analysis.laws.dahl import Dahl as Dahl
from isorig.analysis.laws.drift import DampingDrift as DampingDrift
from isorig.analysis.laws.drift import Drift as Drift
from isorig.analysis.laws.elasto_slip import ElastoSlip as ElastoSlip
from isorig.analysis.laws.elements import Formula
from isorig.analysis.laws.end_stop import EndStop as EndStop
from isorig.analysis.laws.friction_curve import FrictionCurve as FrictionCurve
from isorig.analysis.laws.karnopp import Karnopp as Karnopp
from isorig.analysis.laws.lugre import LuGre as LuGre
from isorig.analysis.laws.maxwell import Maxwell as Maxwell
from isorig.analysis.laws.maxwell_slip import MaxwellSlip as MaxwellSlip
from isorig.analysis.laws.periodic import Periodic as Periodic
from isorig.analysis.laws.position_dependent import PositionDependent as PositionDependent
from isorig.analysis.laws.quadratic_damping import QuadraticDamping as QuadraticDamping
from isorig.analysis.laws.stribeck import Stribeck as Stribeck
from isorig.analysis.laws.viscous import Viscous as Viscous

L = TypeVar("L", bound=Law)
#: Every file of the package.
FILES = [import_module(f"{__name__}.{module.name}") for module in iter_modules(__path__)]


def _found(kind: type[L]) -> tuple[type[L], ...]:
    named = {value.__struct_config__.tag: value for file in FILES for value in vars(file).values() if _is_law(value, kind)}
    return tuple(named[tag] for tag in sorted(named))


def _is_law(value: object, kind: type[Law]) -> bool:
    # A base class of laws has no tag of its own.
    return isinstance(value, type) and issubclass(value, kind) and value.__struct_config__.tag != value.__name__


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
