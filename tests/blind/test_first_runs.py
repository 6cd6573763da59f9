"""Sealed rigs after the first runs of an investigation: a random run, and moves from rest that stick and slip."""

import json
from pathlib import Path

import pytest
from investigated import sealed

from isorig.rig.acquire.plan import RunPlan
from isorig.rig.cli import main
from isorig.rig.next.plan_file import with_runs

REST = RunPlan(id="next-1", configuration="unlocked", excitation="free", gain=100.0, seconds=5.0)
RANDOM = RunPlan(id="next-2", configuration="unlocked", gain=100.0, seconds=20.0, band=(0.5, 400.0), seed=1)
MOVES = RunPlan(id="next-3", configuration="unlocked", excitation="moves", gain=50.0, seconds=10.0, seed=24)


@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    ("kind", "seed", "runs"),
    [
        # The fit of all runs together has a local minimum with a hundred times the error; that of the random run has none.
        ("none", 7200052, (REST, RANDOM, MOVES)),
        # Here neither has: the equations of motion take friction that differs by direction for damping.
        ("asymmetric_friction", 7200004, (REST, RANDOM, MOVES)),
        # The play is nearly as large as the motion: a stop with hardly any spring inside has the same equations.
        pytest.param("backlash", 7100010, (REST, RANDOM), marks=pytest.mark.study),
    ],
)
def test_the_first_runs_are_explained(kind: str, seed: int, runs: tuple[RunPlan, ...], tmp_path: Path) -> None:
    rig = sealed(kind, 1.0, seed)
    rig.measure(with_runs(rig.plan, runs), tmp_path / "campaign.h5")
    assert main(["diagnose", str(tmp_path / "campaign.h5"), "-o", str(tmp_path / "out")]) == 0
    found = json.loads((tmp_path / "out" / "findings.json").read_text())
    assert found["verdict"] == ("explained" if rig.hidden.truth else "adequate")
    assert tuple((step["cause"], step["location"]) for step in found["steps"]) == rig.hidden.truth
