"""The mean of an accelerometer that is no motion is reported, by rig check and rig import; sound records have none."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

import isorig as iso
from isorig.analysis.campaign import Campaign, Run
from isorig.analysis.fitting.preparation import prepare, without_zero
from isorig.analysis.fitting.preparation import zero_errors as wandering_zeros
from isorig.analysis.fitting.trials import expected
from isorig.analysis.model.rig_model import Body, Drive, Link, RigModel, Sensor
from isorig.analysis.spectra.zero_errors import MATTERS, WANDERS, wandering_in_words, zero_errors
from isorig.rig.cli import main
from isorig.rig.exchange.importing import shortcomings
from isorig.rig.files.rigfile import SHIPPED, read_rig
from isorig.rig.virtual.simulated_recording import described_campaign
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


def test_an_offset_of_an_angular_acceleration_is_reported(campaign: Campaign) -> None:
    def turned(run: Run) -> Run:
        channel = replace(run.channels["table"], quantity="angular_acceleration", unit="rad/s^2")
        return replace(run, channels={**run.channels, "table": channel})

    turning = replace(campaign, runs=tuple(map(turned, with_offset(campaign, 3.0).runs)))
    (said,) = zero_errors(turning).values()
    assert "has a mean of 3 rad/s^2 in run" in said
    assert "gravity" not in said
    assert list(wandering_zeros(turning, iso.wire_bonder())) == ["table"]


def test_the_mean_of_an_acceleration_of_a_rig_on_springs_does_not_count(campaign: Campaign) -> None:
    rig = iso.wire_bonder()
    for trial in prepare(with_offset(campaign, 0.3), rig):
        left = (trial.measured - expected(rig, trial))[trial.channels.index("table")]
        assert abs(left.mean()) < 1e-3 * 0.3


def test_which_means_say_nothing_of_a_rig() -> None:
    """Not that of a position in a driven run, which its force moves, nor that of an acceleration that no spring bounds."""
    cart = RigModel(
        name="cart", bodies=(Body(name="cart", mass=1.0),), links=(Link(name="spring", a="cart", stiffness=9.0),),
        drive=Drive(channel="push", factor=1.0, pushes={"cart": 1.0}, quantity="force"),
        sensors=(
            Sensor(channel="x", body="cart", quantity="displacement"), Sensor(channel="a", body="cart", quantity="acceleration"),
            Sensor(channel="cell", force_in="links.spring", quantity="force"),
        ),
    )  # fmt: skip
    assert without_zero(cart, released=False) == {"a"}
    assert without_zero(cart, released=True) == {"x", "a"}
    loose = msgspec.structs.replace(cart, links=(msgspec.structs.replace(cart.links[0], stiffness=0.0, damping=1.0),))
    assert without_zero(loose, released=False) == set()
    moved = Drive(channel="floor", factor=1.0, pushes={}, quantity="displacement", imposes="cart")
    assert "cell" in without_zero(msgspec.structs.replace(cart, drive=moved), released=False)


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


def with_wander(campaign: Campaign, share: float, period: float, name: str = "table") -> Campaign:
    """The same with a slow sine in a record, a share of its rms, of a period in s."""

    def spoilt(run: Run) -> Run:
        values = run.read(name)
        slow = np.sqrt(2.0) * share * values.std() * np.sin(2.0 * np.pi * np.arange(len(run)) / (period * run.sample_rate))
        channel = replace(run.channels[name], samples=values + slow, scale=1.0, offset=0.0)
        return replace(run, channels={**run.channels, name: channel})

    return replace(campaign, runs=tuple(map(spoilt, campaign.runs)))


@pytest.mark.parametrize(("share", "told"), [(0.0, False), (0.7 * WANDERS, False), (1.5 * WANDERS, True), (0.2, True)])
def test_a_zero_that_wanders_is_told(share: float, told: bool, campaign: Campaign) -> None:
    model = iso.wire_bonder()
    found = wandering_zeros(with_wander(campaign, share, 8.0), model)
    assert list(found) == (["table"] if told else [])
    assert bool(wandering_in_words(found, 10.0)) is told


def test_several_wandering_zeros_are_one_sentence() -> None:
    one, other = {"a1": (0.041, "r2")}, {"a2": (0.031, "r2")}
    ends = "below 1 Hz: no motion of a rig on springs is so slow, so"
    assert wandering_in_words(one, 10.0) == (
        f"Zero: that of channel 'a1' (4.1 % of the signal in run 'r2') is wrong or wanders {ends} it does not count."
    )
    assert wandering_in_words(one | other, 10.0) == (
        "Zero: those of channels 'a1' (4.1 % of the signal in run 'r2'), 'a2' (3.1 % of the signal in run 'r2') are wrong or "
        f"wander {ends} they do not count."
    )


def test_errors_of_a_wandering_zero_do_not_count(campaign: Campaign) -> None:
    """The difference from the sound records is the wander, and none of it remains in the error."""
    model, errors = iso.wire_bonder(), []
    for measured in (campaign, with_wander(campaign, 0.2, 8.0)):
        trial = prepare(measured, model)[0]
        row = trial.channels.index("table")
        errors.append((expected(model, trial) - trial.measured)[row])
    assert np.std(errors[1] - errors[0]) < 0.01 * float(campaign.runs[0].read("table").std())


@pytest.mark.parametrize("name", SHIPPED)
def test_no_sound_rig_wanders(name: str) -> None:
    given = read_rig(name)
    assert wandering_zeros(described_campaign(given, seed=4, seconds=10.0, truth=given.model), given.model) == {}
