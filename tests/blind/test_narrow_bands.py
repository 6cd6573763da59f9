"""Wire bonders: a drive that never reaches a resonance, a mass that is not as weighed, and effects that resemble others."""

import json
from pathlib import Path

import numpy as np
import pytest
from envelopes import drawn_rig

from isorig.rig.cli import main
from isorig.rig.files.recording import write
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.effects import Hidden, amplitudes_of, campaign_with, one_effect
from isorig.rig.wire_bonder.session import VirtualRun, virtual_campaign

#: Nothing drives the heatblock's resonance at 165 Hz.
NARROW = (
    VirtualRun(id="g20", configuration="unlocked", gain=20.0, seconds=20.0, start=0.0),
    VirtualRun(id="g35", configuration="unlocked", gain=35.0, seconds=20.0, start=30.0),
    VirtualRun(id="l70", configuration="locked", gain=70.0, seconds=20.0, start=60.0),
)
WIDE = (
    *NARROW,
    VirtualRun(id="u70", configuration="unlocked", gain=70.0, seconds=30.0, start=90.0),
    VirtualRun(id="u7", configuration="unlocked", gain=7.0, seconds=30.0, start=130.0, band=(0.5, 400.0)),
    VirtualRun(id="l7", configuration="locked", gain=7.0, seconds=30.0, start=170.0, band=(0.5, 400.0)),
)


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.study) for seed in range(2, 6))])
def test_a_sound_rig_whose_drive_never_reaches_the_heatblock_is_adequate(seed: int, tmp_path: Path) -> None:
    # From some starting values the heatblock's stiffness grows without bound, where the data no longer depend on it.
    rig = drawn_rig(np.random.default_rng([seed, 5]))
    write(tmp_path / "campaign.h5", virtual_campaign(rig, NARROW, seed=seed))
    assert main(["diagnose", str(tmp_path / "campaign.h5"), "-o", str(tmp_path / "out")]) == 0
    found = json.loads((tmp_path / "out" / "findings.json").read_text())
    assert (found["verdict"], found["steps"]) == ("adequate", [])
    stiffness = found["baseline"]["parameters"]["links.heatblock.stiffness"]["value"]
    assert stiffness == pytest.approx(rig.link("heatblock").stiffness, rel=0.01)


@pytest.mark.study
@pytest.mark.timeout(300)
def test_a_wrong_mass_is_named_before_the_added_mode_with_equal_physics(tmp_path: Path) -> None:
    # 4.3 kg at the heatblock's frequency explain a heatblock of 10.3 kg given as 6 kg just as well, with three parameters.
    rig = wire_bonder({**THESIS, "heatblock_mass": 10.3, "friction_force": 9.0})
    write(tmp_path / "campaign.h5", campaign_with(Hidden(model=rig, known={"heatblock_mass": 6.0}), WIDE, 1))
    assert main(["diagnose", str(tmp_path / "campaign.h5"), "-o", str(tmp_path / "out")]) == 0
    found = json.loads((tmp_path / "out" / "findings.json").read_text())
    (step,) = found["steps"]
    assert (step["cause"], step["location"]) == ("wrong_mass", "heatblock")
    assert step["parameters"]["mass"]["value"] == pytest.approx(10.3, rel=0.01)


@pytest.mark.study
@pytest.mark.timeout(600)
@pytest.mark.parametrize("kind", ["softening_stiffness", "moment_coupling", "presliding_friction"])
@pytest.mark.parametrize("size", [1.0, 0.33])
def test_effects_that_resemble_others_are_named_alone(kind: str, size: float, tmp_path: Path) -> None:
    draw = np.random.default_rng([7, 5])
    rig = drawn_rig(draw)
    hidden = one_effect(kind, rig, amplitudes_of(rig), size, draw)
    write(tmp_path / "campaign.h5", campaign_with(hidden, WIDE, 7))
    assert main(["diagnose", str(tmp_path / "campaign.h5"), "-o", str(tmp_path / "out")]) == 0
    found = json.loads((tmp_path / "out" / "findings.json").read_text())
    assert found["verdict"] == "explained"
    assert tuple((step["cause"], step["location"]) for step in found["steps"]) == hidden.truth
