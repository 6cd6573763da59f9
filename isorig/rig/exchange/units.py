"""Units of other programs, and the SI unit of the recording format for each."""

from __future__ import annotations

import re
from typing import NamedTuple

from isorig.analysis.campaign import Quantity
from isorig.analysis.units import FACTORS
from isorig.analysis.wording import did_you_mean
from isorig.rig.errors import PlanError


class Unit(NamedTuple):
    """The quantity of a unit, and its size in the SI unit of that quantity."""

    quantity: Quantity
    factor: float


UNITS = {name: Unit(quantity, factor) for quantity, factors in FACTORS.items() for name, factor in factors.items()}
#: Units of converter counts, without a physical quantity.
COUNTS = ("count", "counts", "cts", "ticks", "lsb", "LSB", "inc", "increments")
#: Units of quantities that no channel of a recording measures.
OTHER_UNITS = frozenset((
    "°C", "degC", "deg C", "C", "K", "°F", "degF", "bar", "mbar", "Pa", "hPa", "kPa", "MPa", "psi", "uE", "ue", "um/m", "µm/m",
    "strain", "ustrain", "microstrain", "Hz", "kHz", "dB", "W", "kW", "J", "kg", "Ohm", "Ω", "T", "%rH",
))  # fmt: skip
#: Other spellings, in the order of their replacement.
_SPELLINGS = (
    ("µ", "u"),
    ("μ", "u"),
    ("sec", "s"),
    ("²", "^2"),
    ("⁻", "-"),
    ("¹", "1"),
    ("**", "^"),
    ("·", " "),
    ("*", " "),
    ("/s2", "/s^2"),
    ("/s/s", "/s^2"),
    ("s^-2", "s-2"),
    ("s-^2", "s-2"),
    ("s^-1", "s-1"),
    (" s-2", "/s^2"),
    (" s-1", "/s"),
)
_WORDS = {
    "meter": "m", "metre": "m", "meters": "m", "metres": "m",
    "gn": "g", "g_n": "g", "G": "g", "g's": "g", "gs": "g",
    "volt": "V", "volts": "V", "Volt": "V", "Volts": "V", "newton": "N", "Newton": "N",
    "newtons": "N", "Newtons": "N", "feet": "ft", "kph": "km/h", "kp": "kgf", "pond": "gf",
    "°": "deg", "degree": "deg", "degrees": "deg", "°/s": "deg/s", "°/s^2": "deg/s^2", "dps": "deg/s", "radian": "rad",
    "radians": "rad", "RPM": "rpm", "r/min": "rpm", "rev/min": "rpm", "1/min": "rpm", "turn": "rev", "turns": "rev",
    "revolution": "rev", "revolutions": "rev", "inch": "in", "inches": "in", "mils": "mil", "thou": "mil", "kips": "kip",
    "ft lbf": "lbf ft", "in lbf": "lbf in", "ft-lb": "lbf ft", "lb-ft": "lbf ft", "in-lb": "lbf in", "lb-in": "lbf in",
}  # fmt: skip
#: A torque without a space between force and length, or with a dot or a hyphen.
_TORQUE = re.compile(r"(N|kN|mN|lbf|ozf|kgf|gf)[ .·*-]?(m|cm|mm|in|ft)")


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
    """The unit with that name. Raises PlanError if it is not in the table; `where` names the key."""
    name = known_unit(text)
    if name is None and text.strip() in COUNTS:
        raise PlanError(
            f"{where} has unit {text!r}, which is not a physical unit; give the physical unit (deg, mm, V ...) and, as "
            "sensitivity, the number of counts per unit"
        )
    if name is None:
        # A single letter is like too many.
        meant = did_you_mean(text, [each for each in (*UNITS, *_WORDS) if min(len(each), len(text)) > 1])
        raise PlanError(
            f"{where} has unit {text!r}{meant}; known are {', '.join(UNITS)}, so convert the data or set its sensitivity"
        )
    return UNITS[name]
