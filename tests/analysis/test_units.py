"""Every unit has the value that NIST SP 811 (2008, appendix B.8) or the SI brochure states."""

from __future__ import annotations

from math import pi

import pytest

from isorig.analysis.units import FACTORS, GIVEN, mistaken

#: Of SP 811: to be multiplied by, to get the SI unit.
STATED = {
    "g": 9.80665, "mg": 9.80665e-3, "Gal": 1.0e-2, "in/s^2": 2.54e-2, "mm/s^2": 1e-3, "m/s^2": 1.0,
    "m/s": 1.0, "mm/s": 1e-3, "um/s": 1e-6, "in/s": 2.54e-2,
    "m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "in": 2.54e-2, "mil": 2.54e-5,
    "N": 1.0, "kN": 1e3, "mN": 1e-3, "kgf": 9.80665, "lbf": 4.448222, "kip": 4.448222e3,
    "V": 1.0, "mV": 1e-3, "uV": 1e-6, "A": 1.0, "mA": 1e-3, "1": 1.0, "%": 1e-2,
    "rad": 1.0, "mrad": 1e-3, "urad": 1e-6, "deg": 1.745329e-2, "rev": 2.0 * pi, "arcmin": 2.908882e-4,
    "rad/s": 1.0, "mrad/s": 1e-3, "deg/s": 1.745329e-2, "rev/s": 2.0 * pi, "rpm": 1.047198e-1,
    "rad/s^2": 1.0, "mrad/s^2": 1e-3, "deg/s^2": 1.745329e-2, "rev/s^2": 2.0 * pi,
    "N m": 1.0, "kN m": 1e3, "mN m": 1e-3, "N cm": 1e-2, "N mm": 1e-3, "lbf in": 1.129848e-1, "lbf ft": 1.355818,
    "ozf in": 7.061552e-3, "cm/s^2": 1e-2, "ft/s^2": 3.048e-1, "um/s^2": 1e-6, "cm/s": 1e-2, "ft/s": 3.048e-1,
    "km/h": 2.7777778e-1, "ft": 3.048e-1, "daN": 10.0, "MN": 1e6, "gf": 9.80665e-3, "uA": 1e-6, "kgf m": 9.80665,
    "kgf cm": 9.80665e-2, "gf cm": 9.80665e-5,
}  # fmt: skip
STATED_GIVEN = {
    ("kg", "lb"): 4.535924e-1, ("kg", "g"): 1e-3, ("kg", "t"): 1e3, ("kg m^2", "kg cm^2"): 1e-4, ("kg m^2", "kg mm^2"): 1e-6,
    ("kg m^2", "g cm^2"): 1e-7, ("N/m", "N/mm"): 1e3, ("N/m", "lbf/in"): 1.751268e2, ("N m/rad", "N m/deg"): 1.0 / 1.745329e-2,
    ("N m/rad", "N mm/rad"): 1e-3, ("N m/rad", "kN m/rad"): 1e3,
}  # fmt: skip


@pytest.mark.parametrize(("quantity", "unit"), [(quantity, unit) for quantity, units in FACTORS.items() for unit in units])
def test_a_unit_of_a_channel_is_as_stated(quantity: str, unit: str) -> None:
    assert FACTORS[quantity][unit] == pytest.approx(STATED[unit], rel=5e-7)  # type: ignore[index]


def test_units_of_descriptions_are_as_stated() -> None:
    found = {(si, unit): factor for si, units in GIVEN.items() for unit, factor in units.items()}
    assert found == pytest.approx(STATED_GIVEN, rel=5e-7)


def test_confusions_are_with_the_si_unit_and_of_inch_and_millimetre() -> None:
    found = mistaken("displacement")
    assert found["mm read as m"] == pytest.approx(1000.0)
    assert found["m read as mm"] == pytest.approx(0.001)
    assert found["in read as mm"] == pytest.approx(1.0 / 25.4)
    assert found["mm read as in"] == pytest.approx(25.4)
    assert "mm read as um" not in found
    # Units that hardly anybody records in are no explanation.
    assert not any("mil" in name or "nm" in name for name in found)
    assert mistaken("displacement", "in") == {
        f"{unit} read as in": pytest.approx(STATED["in"] / STATED[unit]) for unit in ("m", "cm", "mm", "um")
    }
    assert set(mistaken("acceleration")) == {
        f"{a} read as {b}" for unit in ("mm/s^2", "g", "in/s^2") for a, b in ((unit, "m/s^2"), ("m/s^2", unit))
    }
