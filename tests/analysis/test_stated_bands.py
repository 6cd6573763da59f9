"""A stated band in which the drive has hardly any power is reported; narrower bands and all bands of shipped rigs are not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import isorig as iso
from isorig.analysis.campaign import Campaign
from isorig.analysis.spectra.stated_drives import wrong_bands
from isorig.rig.cli import main
from isorig.rig.exchange.importing import shortcomings
from isorig.rig.files.rigfile import SHIPPED, read_rig
from isorig.rig.virtual.simulated_recording import described_campaign


def tones(shares: tuple[float, float], band: tuple[float, float]) -> Campaign:
    """A run whose drive has these shares of its power at 10 Hz and at 60 Hz."""
    time = np.arange(4096) / 1024.0
    drive = sum(np.sqrt(share) * np.sin(2.0 * np.pi * f * time) for share, f in zip(shares, (10.0, 60.0), strict=True))
    channels = {name: iso.Channel(name=name, samples=np.asarray(drive)) for name in ("head", "motor", "table", "heatblock")}
    run = iso.Run(id="a", configuration="unlocked", sample_rate=1024.0, gain=1.0, channels=channels, band=band)
    return iso.Campaign(runs=(run,))


@pytest.mark.parametrize(("share", "reported"), [(0.09, True), (0.11, False), (1.0, False), (0.0, True)])
def test_boundary_of_the_power_in_the_band(share: float, reported: bool) -> None:
    assert bool(wrong_bands(tones((share, 1.0 - share), (5.0, 20.0)), "head")) is reported


def test_it_is_reported_with_the_drives_own_band(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    campaign = tones((1.0, 0.0), (50.0, 80.0))
    (sentence,) = wrong_bands(campaign, "head")
    assert sentence.startswith(
        "Run 'a' states a band of 50 to 80 Hz, but 100 % of the power of its drive 'head' is outside, from 9.75 to 10.2 Hz"
    )
    assert sentence in shortcomings(campaign)
    iso.write(tmp_path / "a.h5", campaign)
    assert main(["check", str(tmp_path / "a.h5")]) == 0
    assert "states a band of 50 to 80 Hz" in capsys.readouterr().out


def test_a_drive_of_zero_has_no_band() -> None:
    assert wrong_bands(tones((0.0, 0.0), (5.0, 20.0)), "head") == []


@pytest.mark.parametrize("name", SHIPPED)
def test_bands_of_sound_rigs_are_right(name: str) -> None:
    given = read_rig(name)
    campaign = described_campaign(given, seed=4, seconds=10.0, truth=given.model)
    assert wrong_bands(campaign, given.model.drive.channel) == []
    stated = replace(campaign, runs=tuple(replace(run, band=run.band or (0.1, 0.4 * run.sample_rate)) for run in campaign.runs))
    assert wrong_bands(stated, given.model.drive.channel) == []
