"""Campaigns made by another program: the cause by name, and predictions scored on runs measured afterwards."""

import json
from pathlib import Path

import numpy as np
import pytest

from isorig.rig.cli import main
from isorig.rig.files.recording import read


@pytest.mark.study
@pytest.mark.timeout(900)
@pytest.mark.parametrize("letter", "abcdefg")
def test_campaign(letter: str, shared: Path, tmp_path: Path) -> None:
    folder = shared / "campaigns"
    answer = json.loads((folder / "answers.json").read_text())[f"campaign-{letter}"]
    assert main(["diagnose", str(folder / f"campaign-{letter}.h5"), "-o", str(tmp_path)]) == 0
    findings = json.loads((tmp_path / "findings.json").read_text())
    named = [(step["cause"], step["location"]) for step in findings["steps"]]
    assert named == ([(answer["cause"], answer["location"])] if answer["cause"] else [])
    for step in findings["steps"]:
        for name, row in step["parameters"].items():
            if name in answer["parameters"]:
                assert row["value"] == pytest.approx(answer["parameters"][name], rel=0.02), name

    later, predicted = folder / f"campaign-{letter}-later.h5", tmp_path / "predicted.h5"
    errors = {}
    for model in ("baseline", "model"):
        assert main(["predict", str(tmp_path / f"{model}.json"), str(later), "-o", str(predicted), "--as-recorded"]) == 0
        pairs = zip(read(later).runs, read(predicted).runs, strict=True)
        errors[model] = float(
            np.median(
                [
                    np.std(guess.read(name) - run.read(name)) / np.std(run.read(name))
                    for run, guess in pairs
                    for name in ("motor", "table", "heatblock")
                ]
            )
        )
    print(f"campaign-{letter}: later runs, error {errors['baseline']:.4f} -> {errors['model']:.4f}")
    assert errors["model"] <= (0.15 if answer["cause"] else 1.0) * errors["baseline"]
