"""Sealed envelopes: an effect drawn by a seed is hidden in a recording, and the public command must find it."""

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest

from analysis import laws
from analysis.diagnose.mechanisms.springs import added
from analysis.model import RigModel
from analysis.rigs import THESIS, wire_bonder
from rig.cli import main
from rig.recording import write
from rig.virtual import SESSION, virtual_campaign


def drawn_rig(seed: int) -> RigModel:
    generator = np.random.default_rng(seed)
    spread = {
        "table_mass": 0.15, "table_frequency": 0.08, "table_damping": 0.5, "heatblock_frequency": 0.05,
        "heatblock_damping": 0.3, "motor_frequency": 0.1, "motor_damping": 0.3,
    }  # fmt: skip
    values = {**THESIS, "friction_force": 5.0 + 10.0 * generator.random()}
    for name, share in spread.items():
        values[name] *= 1.0 + share * (2.0 * generator.random() - 1.0)
    return wire_bonder(values)


def hidden(cause: str | None, seed: int) -> RigModel:
    model = drawn_rig(seed)
    generator = np.random.default_rng(seed + 1000)
    link = model.link("isolation")
    if cause == "hardening_stiffness":
        return added(model, link, laws.Cubic(cubic_stiffness=link.stiffness * 10 ** generator.uniform(4.0, 4.8)))
    if cause == "sensor_gain":
        sensors = tuple(
            msgspec.structs.replace(s, chain=msgspec.structs.replace(s.chain, gain=1.0 + generator.uniform(0.05, 0.2)))
            if s.channel == "motor"
            else s
            for s in model.sensors
        )
        return msgspec.structs.replace(model, sensors=sensors)
    return model


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ("cause", "place", "seed"),
    [(None, None, 11), ("hardening_stiffness", "isolation", 12), ("sensor_gain", "motor", 13)],
)
def test_sealed_envelope(cause: str | None, place: str | None, seed: int, tmp_path: Path) -> None:
    recording = tmp_path / "sealed.h5"
    write(recording, virtual_campaign(hidden(cause, seed), SESSION, seed=seed))
    assert main(["diagnose", str(recording), "-o", str(tmp_path / "out")]) == 0
    findings = json.loads((tmp_path / "out" / "findings.json").read_text())
    if cause is None:
        assert (findings["verdict"], findings["steps"]) == ("adequate", [])
    else:
        assert findings["verdict"] == "explained"
        named = [(s["cause"], s["location"]) for s in findings["steps"]]
        same = {(x["cause"], x["location"]) for group in findings["indistinguishable"] for x in group}
        assert named[0] == (cause, place) or (cause, place) in same
    for name in ("baseline.json", "model.json", "report.html"):
        assert (tmp_path / "out" / name).stat().st_size > 0
