"""From a stranger's file to the answer: rigs that scipy simulated, one hidden cause each, described up to a fifth off.

Three rigs are diagnosed by default, all of them in the study (`pytest -m "study or not study" tests/rig/test_strangers.py`).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import fftconvolve, firwin
from strange_rigs import Law, StrangeRig, cubic, dry, noise, play

import isorig as iso
from isorig.analysis.campaign import SI_UNIT, Campaign, Channel, FloatArray, Run
from isorig.rig.cli import main
from isorig.rig.files.rigfile import description_text

#: Rates of the simulation and of the record, Hz (scipy joins the drive's samples by straight lines, which at 12 Hz of 4096 Hz
#: takes 3e-5 of it away); seconds of a run; noise of every channel as a share of its rms.
FINE, RATE, SECONDS, NOISE = 4096.0, 256.0, 12.0, 1e-3
#: The converter's filter before decimation: its gain differs from one by less than 1e-5 up to 100 Hz. One that ripples by 0.1 %
#: changes a stroke or a clearance by as much, and no record shows it.
FILTER = firwin(6001, 112.0, fs=FINE, window=("kaiser", 10.0))
#: A description's stiffness and damping are off by these factors.
OFF = (1.2, 0.85, 1.1, 0.9)


def drag(factor: float) -> Law:
    """Damping with the square of the velocity."""
    return lambda e, r: np.asarray(factor * r * np.abs(r))


def stop(stiffness: float, stroke: float) -> Law:
    """A stop on both sides."""
    return lambda e, r: np.asarray(stiffness * (e - np.clip(e, -stroke, stroke)))


@dataclass(frozen=True, kw_only=True)
class Stranger:
    """A rig with its hidden cause: name, place, and the parameter that the answer must give with its true value."""

    rig: StrangeRig
    cause: str
    place: str
    parameter: str
    value: float
    levels: tuple[float, ...] = (10.0, 25.0)
    band: tuple[float, float] = (0.5, 12.0)
    gains: Mapping[str, float] = field(default_factory=dict)
    late: Mapping[str, int] = field(default_factory=dict)
    given: Mapping[str, float] = field(default_factory=dict)
    #: Seconds before the record: it begins in motion.
    before: float = 0.0


def one(law: Mapping[int, Law] | None = None, quantity: str = "displacement") -> StrangeRig:
    """A mass on a spring."""
    return StrangeRig(masses=(4.0,), joints=((0, -1, 4e3, 12.0),), sensors=(("x", 0, quantity),), laws=law or {})  # type: ignore[arg-type]


def two(law: Mapping[int, Law] | None = None) -> StrangeRig:
    """Two masses in a chain, force on the first."""
    return StrangeRig(
        masses=(2.0, 3.0), joints=((0, -1, 6e3, 15.0), (1, 0, 9e3, 14.0)),
        sensors=(("a", 0, "acceleration"), ("b", 1, "acceleration")), laws=law or {},
    )  # fmt: skip


def three(law: Mapping[int, Law] | None = None) -> StrangeRig:
    """Three masses in a chain, force on the first."""
    return StrangeRig(
        masses=(3.0, 2.0, 1.5), joints=((0, -1, 7e3, 12.0), (1, 0, 6e3, 8.0), (2, 1, 5e3, 6.0)),
        sensors=(("base_plate", 0, "displacement"), ("arm", 1, "displacement"), ("tip", 2, "displacement")), laws=law or {},
    )  # fmt: skip


def torsion(law: Mapping[int, Law] | None = None) -> StrangeRig:
    """Two inertias on a shaft."""
    return StrangeRig(
        masses=(0.02, 0.05), joints=((0, -1, 40.0, 0.06), (1, 0, 90.0, 0.05)),
        sensors=(("p", 0, "angle"), ("q", 1, "angle")), drive="torque", drive_quantity="torque", rotary=True, laws=law or {},
    )  # fmt: skip


def frame(law: Mapping[int, Law] | None = None) -> StrangeRig:
    """Seven masses on two springs to the ground, force on the first; three of them have a sensor."""
    return StrangeRig(
        masses=(1.2, 0.9, 1.0, 0.8, 1.1, 0.9, 0.7),
        joints=(
            (0, -1, 9e3, 6.0), (1, 0, 2.2e4, 4.0), (2, 1, 1.8e4, 4.0), (3, 2, 2.5e4, 5.0), (4, 3, 1.5e4, 3.0), (5, 4, 2e4, 4.0),
            (6, 5, 1.2e4, 3.0), (4, -1, 6e3, 5.0),
        ),
        sensors=(("a0", 0, "acceleration"), ("a3", 3, "acceleration"), ("a6", 6, "acceleration")), laws=law or {},
    )  # fmt: skip


def platform(law: Mapping[int, Law] | None = None) -> StrangeRig:
    """A mass on a moved base."""
    return StrangeRig(
        masses=(5.0,), joints=((0, -1, 3e3, 20.0),), sensors=(("top", 0, "acceleration"),), drive="floor",
        drive_quantity="acceleration", base=True, laws=law or {},
    )  # fmt: skip


STRANGERS: Mapping[str, Stranger] = {
    "hardening on a mass": Stranger(
        rig=one({0: cubic(4e7)}), cause="hardening_stiffness", place="l0", parameter="cubic_stiffness", value=4e7
    ),
    "gain in a chain": Stranger(
        rig=two(), cause="sensor_gain", place="b", parameter="factor", value=1.15, gains={"b": 1.15}
    ),
    "play in a coupling": Stranger(
        rig=two({1: play(9e3, 4e-4)}), cause="backlash", place="l1", parameter="clearance", value=4e-4
    ),
    "dry friction on a mass": Stranger(
        rig=one({0: dry(2.0, 1e-4)}), cause="coulomb_friction", place="l0", parameter="friction_force", value=2.0
    ),
    "stop at a mass": Stranger(
        rig=one({0: stop(1.2e4, 5e-3)}), cause="end_stop", place="l0", parameter="stroke", value=5e-3
    ),
    "stop in a chain, far within the motion": Stranger(
        rig=three({1: stop(2e4, 1.5e-3)}), cause="end_stop", place="l1", parameter="stroke", value=1.5e-3, levels=(8.0, 20.0)
    ),
    "drag in a chain": Stranger(
        rig=two({0: drag(80.0)}), cause="quadratic_damping", place="l0", parameter="quadratic_damping", value=80.0
    ),
    "hardening shaft": Stranger(
        rig=torsion({1: cubic(4e4)}), cause="hardening_stiffness", place="l1", parameter="cubic_stiffness", value=4e4,
        levels=(1.0, 2.5),
    ),
    "play in a shaft": Stranger(
        rig=torsion({1: play(90.0, 3e-3)}), cause="backlash", place="l1", parameter="clearance", value=3e-3, levels=(1.0, 2.5)
    ),
    "late angle": Stranger(
        rig=torsion(), cause="channel_delay", place="q", parameter="delay", value=32 / FINE, levels=(1.0, 2.5), late={"q": 32}
    ),
    "hardening isolation": Stranger(
        rig=platform({0: cubic(3e7)}), cause="hardening_stiffness", place="l0", parameter="cubic_stiffness", value=3e7,
        levels=(1.0, 4.0),
    ),
    "drag in an isolation": Stranger(
        rig=platform({0: drag(150.0)}), cause="quadratic_damping", place="l0", parameter="quadratic_damping", value=150.0,
        levels=(1.0, 4.0),
    ),
    "hardening between bodies without sensors": Stranger(
        rig=frame({2: cubic(6e9)}), cause="hardening_stiffness", place="l2", parameter="cubic_stiffness", value=6e9,
        levels=(10.0, 25.0, 40.0), band=(1.0, 38.0),
    ),
    "wrong mass in a chain": Stranger(
        rig=two(), cause="wrong_mass", place="m1", parameter="mass", value=3.0, given={"bodies.m1.mass": 1.15}
    ),
    "dry friction, cut out of a motion": Stranger(
        rig=one({0: dry(2.0, 1e-4)}), cause="coulomb_friction", place="l0", parameter="friction_force", value=2.0, before=4.0
    ),
    "play in a coupling, cut out of a motion": Stranger(
        rig=two({1: play(9e3, 4e-4)}), cause="backlash", place="l1", parameter="clearance", value=4e-4, before=4.0
    ),
}  # fmt: skip
#: Diagnosed by default.
QUICK = ("gain in a chain", "late angle")


def recorded(stranger: Stranger, seed: int) -> Campaign:
    """Its runs, simulated at a fine rate and decimated, with noise on every channel."""
    draw = np.random.default_rng(seed)
    runs = []
    for k, level in enumerate(stranger.levels):
        fine = stranger.rig.recorded(noise(stranger.before + SECONDS, FINE, level, stranger.band, 100 * seed + k), FINE)
        channels = {}
        for name, quantity in stranger.rig.quantities().items():
            values: FloatArray = np.roll(fine[name], stranger.late.get(name, 0)) * stranger.gains.get(name, 1.0)
            values = fftconvolve(values, FILTER, mode="same")[:: round(FINE / RATE)]
            values = values[round(stranger.before * RATE) :]
            values = values + draw.normal(0.0, NOISE * values.std(), len(values))
            channels[name] = Channel(name=name, samples=values, quantity=quantity, unit=SI_UNIT[quantity])
        runs.append(Run(id=f"r{k}", configuration="unlocked", sample_rate=RATE, gain=level, channels=channels,
                        excitation="random", band=stranger.band))  # fmt: skip
    joints = len(stranger.rig.joints)
    wrong = {f"links.l{k}.{key}": OFF[(2 * k + n) % 4] for k in range(joints) for n, key in enumerate(("stiffness", "damping"))}
    described = stranger.rig.description({**wrong, **stranger.given})
    return replace(Campaign(runs=tuple(runs), source="stranger"), description=description_text(described, {}))


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", [n if n in QUICK else pytest.param(n, marks=pytest.mark.study) for n in STRANGERS])
def test_the_answer_names_what_is_hidden_with_its_value(name: str, tmp_path: Path) -> None:
    stranger = STRANGERS[name]
    iso.write(tmp_path / "a.h5", recorded(stranger, list(STRANGERS).index(name) + 1))
    assert main(["diagnose", str(tmp_path / "a.h5"), "-o", str(tmp_path / "d")]) == 0
    found = json.loads((tmp_path / "d" / "findings.json").read_text())
    assert found["verdict"] == "explained"
    (step,) = found["steps"]
    assert (step["cause"], step["location"]) == (stranger.cause, stranger.place)
    row = step["parameters"][stranger.parameter]
    assert abs(row["value"] - stranger.value) <= 3.0 * row["std"], row
