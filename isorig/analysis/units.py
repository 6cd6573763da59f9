"""Units of the quantities that channels record: the factor from each to the SI unit."""

from collections.abc import Mapping
from math import pi

from isorig.analysis.campaign import Quantity

#: A pound-force in N, a kilogram-force in N (standard gravity), and a turn in rad.
LBF, KGF, TURN = 4.4482216152605, 9.80665, 2.0 * pi
#: SI value of one unit, by quantity and unit (BIPM, The International System of Units, 9th ed.; an inch is 25.4 mm).
FACTORS: Mapping[Quantity, Mapping[str, float]] = {
    "acceleration": {
        "m/s^2": 1.0, "mm/s^2": 1e-3, "g": KGF, "mg": 1e-3 * KGF, "in/s^2": 0.0254, "Gal": 0.01,
        "cm/s^2": 0.01, "ft/s^2": 0.3048, "um/s^2": 1e-6,
    },
    "velocity": {"m/s": 1.0, "mm/s": 1e-3, "um/s": 1e-6, "in/s": 0.0254, "cm/s": 1e-2, "ft/s": 0.3048, "km/h": 1.0 / 3.6},
    "displacement": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "in": 0.0254, "mil": 2.54e-5, "ft": 0.3048},
    "force": {
        "N": 1.0, "kN": 1e3, "mN": 1e-3, "kgf": KGF, "lbf": LBF, "kip": 1e3 * LBF, "daN": 10.0, "MN": 1e6, "gf": 1e-3 * KGF,
    },
    "voltage": {"V": 1.0, "mV": 1e-3, "uV": 1e-6},
    "current": {"A": 1.0, "mA": 1e-3, "uA": 1e-6},
    "gain": {"1": 1.0, "%": 0.01},
    "angle": {"rad": 1.0, "mrad": 1e-3, "urad": 1e-6, "deg": TURN / 360.0, "rev": TURN, "arcmin": TURN / 21600.0},
    "angular_velocity": {"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": TURN / 360.0, "rev/s": TURN, "rpm": TURN / 60.0},
    "angular_acceleration": {"rad/s^2": 1.0, "mrad/s^2": 1e-3, "deg/s^2": TURN / 360.0, "rev/s^2": TURN},
    "torque": {
        "N m": 1.0, "kN m": 1e3, "mN m": 1e-3, "N cm": 1e-2, "N mm": 1e-3, "lbf in": 0.0254 * LBF, "lbf ft": 0.3048 * LBF,
        "ozf in": 0.0254 * LBF / 16.0, "kgf m": KGF, "kgf cm": 1e-2 * KGF, "gf cm": 1e-5 * KGF,
    },
}  # fmt: skip
#: Units that hardly any record or description is in: not proposed where a level is wrong.
RARE = (
    "Gal", "mg", "um/s", "mil", "nm", "mN", "kip", "uV", "urad", "arcmin", "ozf in", "mN m", "kN m", "rev/s^2",
    "cm/s^2", "ft/s^2", "um/s^2", "cm/s", "ft/s", "km/h", "ft", "daN", "MN", "gf", "uA", "kgf m", "kgf cm", "gf cm",
)  # fmt: skip
#: Other units of the values of a description, by SI unit: SI value of one.
GIVEN: Mapping[str, Mapping[str, float]] = {
    "kg": {"lb": 0.45359237, "g": 1e-3, "t": 1e3}, "kg m^2": {"kg cm^2": 1e-4, "kg mm^2": 1e-6, "g cm^2": 1e-7},
    "N/m": {"N/mm": 1e3, "lbf/in": LBF / 0.0254}, "N m/rad": {"N m/deg": 360.0 / TURN, "N mm/rad": 1e-3, "kN m/rad": 1e3},
}  # fmt: skip


def mistaken(quantity: Quantity, unit: str | None = None) -> dict[str, float]:
    """Ratio of recorded to true value for every pair of units that are confused: "A read as B".

    B is `unit` if it is given. Otherwise one of the two is the SI unit, or they are inch and millimetre.
    """
    known = {name: factor for name, factor in FACTORS[quantity].items() if name not in RARE}
    if unit in known:
        return {f"{meant} read as {unit}": known[unit] / known[meant] for meant in known if meant != unit}
    si = next(iter(known))
    pairs = [(name, si) for name in known if name != si] + [(si, name) for name in known if name != si]
    if {"in", "mm"} <= known.keys():
        pairs += [("in", "mm"), ("mm", "in")]
    return {f"{meant} read as {read}": known[read] / known[meant] for meant, read in pairs}
