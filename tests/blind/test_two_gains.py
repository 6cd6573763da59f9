"""docs/plans/two-gains.toml, measured on sealed rigs: the diagnosis must say whether friction is Coulomb's or Stribeck's."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from envelopes import drawn_rig

from isorig.analysis.campaign import Campaign
from isorig.analysis.laws import Coulomb, FrictionLaw, Stribeck
from isorig.analysis.model.rig_model import Contact
from isorig.rig.acquire.plan_check import read_plan
from isorig.rig.cli import main
from isorig.rig.files.recording import write
from isorig.rig.wire_bonder.effects import amplitudes_of
from isorig.rig.wire_bonder.session import VirtualRun, known_of, virtual_campaign

PLAN = Path(__file__).parents[2] / "docs" / "plans" / "two-gains.toml"
SEEDS = range(1, 7)


def drawn(kind: str, seed: int) -> tuple[Campaign, FrictionLaw]:
    """What the plan measures on a drawn rig with a drawn law, and the law."""
    draw = np.random.default_rng([seed, kind == "stribeck"])
    rig = drawn_rig(draw)
    speed = amplitudes_of(rig).speed["isolation"]
    static = float(draw.uniform(12.0, 24.0))
    law: FrictionLaw = Coulomb(friction_force=static)
    if kind == "stribeck":
        sliding = static * float(draw.uniform(0.35, 0.75))
        law = Stribeck(friction_force=sliding, static_force=static, stribeck_velocity=speed * float(draw.uniform(0.01, 0.12)))
    rig = msgspec.structs.replace(rig, contacts=(Contact(name="isolation", a="motor", b="table", law=law),), free=())
    takes = [
        VirtualRun(
            id=run.id, configuration=run.configuration, gain=run.gain, seconds=run.seconds, start=100.0 * k,
            excitation=run.excitation, band=run.band or (0.5, 20.0), use=run.use,
        )
        for k, run in enumerate(read_plan(PLAN).runs)
    ]  # fmt: skip
    # The force gauge reads breakaway.
    return replace(virtual_campaign(rig, takes, seed=seed), known={**known_of(rig), "friction_force": static}), law


@pytest.mark.study
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", ["coulomb", "stribeck"])
def test_the_law_is_named(tmp_path: Path, kind: str, seed: int) -> None:
    campaign, law = drawn(kind, seed)
    write(tmp_path / "two-gains.h5", campaign)
    assert main(["diagnose", str(tmp_path / "two-gains.h5"), "-o", str(tmp_path / "out")]) == 0
    found = json.loads((tmp_path / "out" / "findings.json").read_text())
    named = [(step["cause"], step["location"]) for step in found["steps"]]
    print(kind, seed, law, found["verdict"], named, found["holdout"]["baseline"], found["holdout"]["extended"])
    if kind == "coulomb":
        assert (found["verdict"], named) == ("adequate", [])
        return
    assert (found["verdict"], named) == ("explained", [("stribeck_friction", "isolation")])
    assert found["steps"][0]["parameters"]["static_force"]["value"] == pytest.approx(law.static_force, rel=0.02)
