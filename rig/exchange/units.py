"""Units of other programs, and the SI unit of the recording format for each."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import pi

from isorig.analysis.campaign import SI_UNIT, Quantity
from isorig.rig.errors import PlanError


@dataclass(frozen=True, kw_only=True)
class Unit:
    """The quantity of a unit, its SI unit, and the conversion factor."""

    quantity: Quantity
    si: str
    factor: float


#: A pound-force in N, and a turn in rad.
LBF, TURN = 4.4482216152605, 2.0 * pi
_FACTORS: dict[Quantity, dict[str, float]] = {
    # g is the standard acceleration of 9.80665 m/s^2; the inch is 25.4 mm (BIPM, The International System of Units, 9th ed.).
    "acceleration": {"m/s^2": 1.0, "mm/s^2": 1e-3, "g": 9.80665, "mg": 9.80665e-3, "in/s^2": 0.0254, "Gal": 0.01},
    "velocity": {"m/s": 1.0, "mm/s": 1e-3, "um/s": 1e-6, "in/s": 0.0254},
    "displacement": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "in": 0.0254, "mil": 2.54e-5},
    "force": {"N": 1.0, "kN": 1e3, "mN": 1e-3, "lbf": LBF, "kip": 1e3 * LBF},
    "voltage": {"V": 1.0, "mV": 1e-3, "uV": 1e-6},
    "current": {"A": 1.0, "mA": 1e-3},
    "gain": {"1": 1.0, "%": 0.01},
    "angle": {"rad": 1.0, "mrad": 1e-3, "urad": 1e-6, "deg": TURN / 360.0, "rev": TURN, "arcmin": TURN / 21600.0},
    "angular_velocity": {"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": TURN / 360.0, "rev/s": TURN, "rpm": TURN / 60.0},
    "angular_acceleration": {"rad/s^2": 1.0, "mrad/s^2": 1e-3, "deg/s^2": TURN / 360.0, "rev/s^2": TURN},
    "torque": {
        "N m": 1.0, "kN m": 1e3, "mN m": 1e-3, "N cm": 1e-2, "N mm": 1e-3, "lbf in": 0.0254 * LBF, "lbf ft": 0.3048 * LBF,
        "ozf in": 0.0254 * LBF / 16.0,
    },
}  # fmt: skip
UNITS = {
    name: Unit(quantity=quantity, si=SI_UNIT[quantity], factor=factor)
    for quantity, factors in _FACTORS.items()
    for name, factor in factors.items()
}
#: Units of converter counts, without a physical quantity.
COUNTS = ("count", "counts", "cts", "ticks", "lsb", "LSB", "inc", "increments")
#: Other spellings, in the order of their replacement.
_SPELLINGS = (("µ", "u"), ("μ", "u"), ("²", "^2"), ("**", "^"), ("/s2", "/s^2"), ("/s/s", "/s^2"), ("m s^-2", "m/s^2"))
_WORDS = {
    "gn": "g", "g_n": "g", "G": "g", "volt": "V", "volts": "V", "Volt": "V", "Volts": "V", "newton": "N", "Newton": "N",
    "newtons": "N", "Newtons": "N",
    "°": "deg", "degree": "deg", "degrees": "deg", "°/s": "deg/s", "°/s^2": "deg/s^2", "dps": "deg/s", "radian": "rad",
    "radians": "rad", "RPM": "rpm", "r/min": "rpm", "rev/min": "rpm", "1/min": "rpm", "turn": "rev", "turns": "rev",
    "revolution": "rev", "revolutions": "rev", "inch": "in", "inches": "in", "mils": "mil", "thou": "mil", "kips": "kip",
    "ft lbf": "lbf ft", "in lbf": "lbf in", "ft-lb": "lbf ft", "lb-ft": "lbf ft", "in-lb": "lbf in", "lb-in": "lbf in",
}  # fmt: skip
#: A torque without a space between force and length, or with a dot or a hyphen.
_TORQUE = re.compile(r"(N|kN|mN|lbf|ozf)[ .·*-]?(m|cm|mm|in|ft)")


def known_unit(text: str) -> str | None:
    """The table's name of a unit, for any known spelling; None if it is not in the table."""
    name = text.strip().strip("[]()").strip()
    for old, new in _SPELLINGS:
        name = name.replace(old, new)
    name = _WORDS.get(name, name)
    if torque := _TORQUE.fullmatch(name):
        name = f"{torque[1]} {torque[2]}"
    return name if name in UNITS else None


def unit(text: str, where: str) -> Unit:
    """The unit with that name.

    Raises
    ------
    PlanError
        It is not in the table; `where` names the key.
    """
    name = known_unit(text)
    if name is None and text.strip() in COUNTS:
        raise PlanError(
            f"{where} has unit {text!r}, which is not a physical unit; give the physical unit (deg, mm, V ...) and, as "
            "sensitivity, the number of counts per unit"
        )
    if name is None:
        raise PlanError(f"{where} has unit {text!r}; known are {', '.join(UNITS)}, so convert the data or set its sensitivity")
    return UNITS[name]
