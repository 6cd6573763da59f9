"""Runs that are equal to the last bit have no noise: the fits divide by nothing, and the linear algebra prints nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from isorig.rig.cli import main
from isorig.rig.files.recording import write
from isorig.rig.files.rigfile import read_rig
from isorig.rig.virtual.simulated_recording import described_campaign

#: Seconds of each run.
SECONDS = 4.0


@pytest.mark.parametrize("runs", [4, pytest.param(31, marks=pytest.mark.study)])
def test_lapack_prints_nothing(runs: int, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """It writes to the file descriptor, past Python's streams."""
    campaign = described_campaign(read_rig("absorber"), seed=4, seconds=SECONDS)
    run = campaign.runs[0]
    channels = {name: run.channels[name] for name in ("shaker", "platform")}
    equal = tuple(replace(run, id=f"r{k}", channels=channels) for k in range(runs))
    write(tmp_path / "a.h5", replace(campaign, runs=equal))
    assert main(["frf", str(tmp_path / "a.h5"), "-o", str(tmp_path / "out")]) == 0
    said = capfd.readouterr()
    assert "On entry to" not in said.out + said.err
    assert said.err == ""
