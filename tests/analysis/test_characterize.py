"""The parameter table against the true parameters of a campaign made by another program."""

import json
from pathlib import Path

from rig.cli import main


def test_campaign_a(shared: Path, tmp_path: Path) -> None:
    truth = json.loads((shared / "campaigns" / "answers.json").read_text())["campaign-a"]["rig"]
    assert main(["characterize", str(shared / "campaigns" / "campaign-a.h5"), "-o", str(tmp_path)]) == 0
    table = json.loads((tmp_path / "parameters.json").read_text())["parameters"]
    for name, row in table.items():
        loose = name.endswith("damping") or name == "friction_force"
        assert abs(row["value"] / truth[name] - 1.0) < (0.02 if loose else 0.005), name
        assert abs(row["value"] - truth[name]) <= 3.0 * row["std"] + 0.002 * truth[name], name
