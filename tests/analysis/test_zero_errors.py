"""The mean of an accelerometer that is no motion is reported, by rig check and rig import; sound records have none."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

import isorig as iso
from isorig.analysis.campaign import Campaign
from isorig.analysis.spectra.zero_errors import MATTERS, zero_errors
from isorig.rig.cli import main
from isorig.rig.exchange.importing import shortcomings
from isorig.rig.files.rigfile import SHIPPED, read_rig
from isorig.rig.virtual.described import described_campaign
from isorig.rig.wire_bonder.session import SESSION


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    """The wire bonder at two gains and under moves."""
    takes = [replace(take, seconds=10.0) for take in SESSION if take.id in ("u70a", "u7", "umove")]
    return iso.virtual_campaign(iso.wire_bonder(), takes, seed=1)


def with_offset(campaign: Campaign, offset: float) -> Campaign:
    """The same with a mean added to the table's record."""
    return replace(
        campaign,
        runs=tuple(
            replace(run, channels={**run.channels, "table": replace(run.channels["table"], offset=offset)})
            for run in campaign.runs
        ),
    )


@pytest.mark.parametrize("offset", [0.05, -0.5, 3.0, 9.81])
def test_an_offset_is_reported(offset: float, campaign: Campaign, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = zero_errors(with_offset(campaign, offset))
    assert list(found) == ["table"]
    mean = re.search(r"has a mean of (\S+) m/s\^2 in run 'u7', and in \d more, which", found["table"])
    assert mean is not None
    assert float(mean[1]) == pytest.approx(offset, abs=1e-3)
    iso.write(tmp_path / "a.h5", with_offset(campaign, offset))
    assert main(["check", str(tmp_path / "a.h5")]) == 0
    assert "remove it by offset in the mapping" in capsys.readouterr().out
    assert any("Channel 'table' has a mean of" in sentence for sentence in shortcomings(with_offset(campaign, offset)))


@pytest.mark.parametrize(("share", "reported"), [(0.9, False), (1.2, True)])
def test_boundary_of_a_mean_that_matters(share: float, reported: bool, campaign: Campaign) -> None:
    largest = max(float(run.read("table").std()) for run in campaign.runs)
    assert ("table" in zero_errors(with_offset(campaign, share * MATTERS * largest))) is reported


@pytest.mark.parametrize("name", SHIPPED)
def test_sound_rigs_have_none(name: str) -> None:
    given = read_rig(name)
    assert zero_errors(described_campaign(given, seed=4, seconds=10.0, truth=given.model)) == {}


def test_moves_are_motion(campaign: Campaign) -> None:
    assert zero_errors(campaign) == {}
