"""Quantities and units: what files say becomes SI, and counts alone are refused."""

from __future__ import annotations

from math import pi
from pathlib import Path

import numpy as np
import pytest
from scipy import constants

from isorig.analysis.campaign import SI_UNIT
from isorig.rig.cli import main
from isorig.rig.exchange.units import UNITS, unit
from isorig.rig.files.recording import read


@pytest.mark.parametrize(
    ("text", "si", "factor"),
    [
        ("deg", "rad", constants.degree),
        ("°", "rad", constants.degree),
        ("arcmin", "rad", constants.arcminute),
        ("rpm", "rad/s", 2.0 * pi / constants.minute),
        ("1/min", "rad/s", 2.0 * pi / constants.minute),
        ("deg/s²", "rad/s^2", constants.degree),
        ("Nm", "N m", 1.0),
        ("N·m", "N m", 1.0),
        ("mNm", "N m", 1e-3),
        ("lbf-ft", "N m", constants.lbf * constants.foot),
        ("in-lb", "N m", constants.lbf * constants.inch),
        ("kip", "N", 1e3 * constants.lbf),
        ("in", "m", constants.inch),
        ("mil", "m", constants.mil),
        ("thou", "m", constants.mil),
        ("g", "m/s^2", constants.g),
    ],
)
def test_units_of_others(text: str, si: str, factor: float) -> None:
    """The factors are those of scipy.constants."""
    found = unit(text, "here")
    assert SI_UNIT[found.quantity] == si
    assert found.factor == pytest.approx(factor, rel=1e-12)


def test_every_unit_is_of_a_quantity() -> None:
    """What is imported can be stored: the SI unit of each is the one that the format keeps for its quantity."""
    assert {SI_UNIT[item.quantity] for item in UNITS.values()} == set(SI_UNIT.values())


MAPPING = """
[channels.torque]
source = "torque"
unit = "lbf in"

[channels.shaft]
source = "encoder"
unit = "rev"
sensitivity = 8192.0

[[runs]]
id = "one"
file = "servo.csv"
configuration = "unlocked"
gain = 1.0
sample_rate = 1000.0
"""


def test_counts_with_their_scale(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An encoder of 8192 counts a turn becomes rad; counts without a scale are refused in one sentence."""
    counts = np.arange(400) % 91
    rows = "\n".join(f"{0.5 * k},{k}" for k in counts)
    (tmp_path / "servo.csv").write_text(f"torque,encoder\n{rows}\n")
    mapping = tmp_path / "servo.toml"
    mapping.write_text(MAPPING)
    assert main(["import", str(mapping), "-o", str(tmp_path / "servo.h5")]) == 0
    run = read(tmp_path / "servo.h5").runs[0]
    assert (run.channel("shaft").quantity, run.channel("shaft").unit) == ("angle", "rad")
    assert np.allclose(run.read("shaft"), counts * 2.0 * pi / 8192.0)
    assert run.channel("torque").unit == "N m"
    assert np.allclose(run.read("torque"), 0.5 * counts * constants.lbf * constants.inch)
    capsys.readouterr()
    mapping.write_text(MAPPING.replace('unit = "rev"', 'unit = "counts"'))
    assert main(["import", str(mapping), "-o", str(tmp_path / "other.h5")]) == 2
    said = capsys.readouterr().err
    assert "channels.shaft" in said
    assert "the number of counts" in said
    assert not (tmp_path / "other.h5").exists()
