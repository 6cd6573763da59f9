"""Units of other programs, and the SI unit that the recording format keeps for each."""

from __future__ import annotations

from dataclasses import dataclass

from analysis.measured import Quantity
from rig.errors import PlanError


@dataclass(frozen=True, kw_only=True)
class Unit:
    """What a unit measures, the SI unit it becomes, and the factor between them."""

    quantity: Quantity
    si: str
    factor: float


_FACTORS: dict[Quantity, tuple[str, dict[str, float]]] = {
    # g is the standard acceleration of 9.80665 m/s^2; the inch is 25.4 mm (BIPM, The International System of Units, 9th ed.).
    "acceleration": ("m/s^2", {"m/s^2": 1.0, "mm/s^2": 1e-3, "g": 9.80665, "mg": 9.80665e-3, "in/s^2": 0.0254, "Gal": 0.01}),
    "velocity": ("m/s", {"m/s": 1.0, "mm/s": 1e-3, "um/s": 1e-6, "in/s": 0.0254}),
    "displacement": ("m", {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "in": 0.0254, "mil": 2.54e-5}),
    "force": ("N", {"N": 1.0, "kN": 1e3, "mN": 1e-3, "lbf": 4.4482216152605}),
    "voltage": ("V", {"V": 1.0, "mV": 1e-3, "uV": 1e-6}),
    "current": ("A", {"A": 1.0, "mA": 1e-3}),
    "gain": ("1", {"1": 1.0, "%": 0.01}),
}
UNITS = {
    name: Unit(quantity=quantity, si=si, factor=factor)
    for quantity, (si, factors) in _FACTORS.items()
    for name, factor in factors.items()
}
#: How other programs write the same, in the order in which it is undone.
_SPELLINGS = (("µ", "u"), ("μ", "u"), ("²", "^2"), ("**", "^"), ("/s2", "/s^2"), ("/s/s", "/s^2"), ("m s^-2", "m/s^2"))
_WORDS = {"gn": "g", "g_n": "g", "G": "g", "volt": "V", "volts": "V", "Volt": "V", "Volts": "V", "newton": "N", "Newton": "N"}


def known_unit(text: str) -> str | None:
    """The table's name of a unit as other programs write it; None where it is not in the table."""
    name = text.strip().strip("[]()").strip()
    for old, new in _SPELLINGS:
        name = name.replace(old, new)
    name = _WORDS.get(name, name)
    return name if name in UNITS else None


def unit(text: str, where: str) -> Unit:
    """The unit of that name.

    Raises
    ------
    PlanError
        Where it is not in the table; `where` says which key.
    """
    name = known_unit(text)
    if name is None:
        raise PlanError(f"{where} has unit {text!r}; known are {', '.join(UNITS)}, so convert the data or set its sensitivity")
    return UNITS[name]
