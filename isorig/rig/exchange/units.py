"""Units of other programs, and the SI unit of the recording format for each."""

import re
from typing import NamedTuple

from isorig.analysis.campaign import Quantity
from isorig.analysis.units import FACTORS
from isorig.analysis.wording import did_you_mean
from isorig.rig.errors import PlanError
from isorig.rig.exchange.clock import seconds_per


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
    (".s-2", "/s^2"),
    (".s-1", "/s"),
)
_WORDS = {
    "meter": "m", "metre": "m", "meters": "m", "metres": "m", "millimeter": "mm", "millimetre": "mm", "millimeters": "mm",
    "millimetres": "mm", "micron": "um", "microns": "um", "micrometer": "um", "micrometre": "um", "ips": "in/s", "gₙ": "g",
    "mG": "mg", "milli-g": "mg", "mgn": "mg", "mps2": "m/s^2", "ms^-2": "m/s^2", "ms-2": "m/s^2", "mps": "m/s",
    "lb": "lbf", "lbs": "lbf",
    "gn": "g", "g_n": "g", "G": "g", "g's": "g", "gs": "g",
    "volt": "V", "volts": "V", "Volt": "V", "Volts": "V", "newton": "N", "Newton": "N",
    "newtons": "N", "Newtons": "N", "feet": "ft", "kph": "km/h", "kp": "kgf", "pond": "gf",
    "°": "deg", "degree": "deg", "degrees": "deg", "°/s": "deg/s", "°/s^2": "deg/s^2", "dps": "deg/s", "radian": "rad",
    "radians": "rad", "RPM": "rpm", "r/min": "rpm", "rev/min": "rpm", "1/min": "rpm", "turn": "rev", "turns": "rev",
    "revolution": "rev", "revolutions": "rev", "inch": "in", "inches": "in", "mils": "mil", "thou": "mil", "kips": "kip",
    "ft lbf": "lbf ft", "in lbf": "lbf in", "ft-lb": "lbf ft", "lb-ft": "lbf ft", "in-lb": "lbf in", "lb-in": "lbf in",
}  # fmt: skip
#: The kind of an amplitude after a unit: the samples of a time record have the unit itself.
_AMPLITUDE = re.compile(r"[ _,]*\(?(?:rms|pk|peak|eff)\.?\)?$", re.IGNORECASE)
#: The sensitivity of a sensor in a header: 100 mV/g, 0,01 V/N, (10.2 mV/(m/s²)).
_SENSITIVITY = re.compile(
    r"[(\[]?\s*(?P<number>\d+(?:[.,]\d+)?(?:e[+-]?\d+)?)\s*(?P<signal>[mµμu]?V)\s*/\s*(?P<per>\([^()]+\)|[^\s()\[\]]+)\s*[)\]]?",
    re.IGNORECASE,
)
#: A torque without a space between force and length, or with a dot or a hyphen.
_TORQUE = re.compile(r"(N|kN|mN|lbf|ozf|kgf|gf)[ .·*-]?(m|cm|mm|in|ft)")


def known_unit(text: str) -> str | None:
    """The table's name of a unit, for any known spelling; None if it is not in the table."""
    name = _AMPLITUDE.sub("", text.strip()).strip("[]()").strip()
    for old, new in _SPELLINGS:
        name = name.replace(old, new)
    name = _WORDS.get(name, name)
    if torque := _TORQUE.fullmatch(name):
        name = f"{torque[1]} {torque[2]}"
    return name if name in UNITS else None


def sensitivity_in(text: str) -> tuple[str, float, str, str] | None:
    """The rest of a text that states a sensitivity ("acc [V] 100 mV/g"), and its number, unit of the signal, and unit of the
    quantity; None if it states none."""
    found = _SENSITIVITY.search(text)
    signal, per = (known_unit(found["signal"]), known_unit(found["per"])) if found else (None, None)
    if not found or signal is None or per is None or not (number := float(found["number"].replace(",", "."))):
        return None
    return (text[: found.start()] + text[found.end() :]).strip(), number, signal, per


def name_and_unit(head: str) -> tuple[str, str]:
    """The name and the unit in the head of a column: "force [N]", "force (N)", "force / N"; the unit is "" if there is none."""
    found = re.fullmatch(r"(.+?)\s*[\[(]([^\])]+)[\])]", head)
    if found and not re.search(r"\S[\[(]\d+.$", head):
        return found[1], found[2]
    whole = re.fullmatch(r"(.+)[\s_]([^\s_()\[\]]+/[^\s_()\[\]]+)", head)
    if whole and known_unit(whole[2]):
        return whole[1], whole[2]
    found = re.fullmatch(r"(.+?)(?:\s*/\s*|\s+in\s+|,\s*)([^/].*)", head)
    if found and (known_unit(found[2]) or seconds_per(found[2])):
        return found[1], found[2]
    return head, ""


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
