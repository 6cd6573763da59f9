"""The parameter table: against a campaign made by another program, its stated deviations, and with records that are spoilt."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from intervals import NOISES, SHORT, truths, with_noise
from intervals import TAKES as LONGER
from scipy.signal import lfilter
from shortened import shortened
from small_rigs import guessed, played, stage

from isorig.analysis.campaign import Channel
from isorig.analysis.fitting.uncertainty import MOST_NOISE
from isorig.analysis.jackknife import deviation
from isorig.analysis.parameters.joint_fit import characterize
from isorig.analysis.simulate import free_run, sampling
from isorig.rig.cli import main
from isorig.rig.files.recording import read, write
from isorig.rig.model.baseline import baseline_model
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.session import VirtualRun, virtual_campaign

#: The runs of the study of intervals, half as long.
TAKES = [replace(take, seconds=0.5 * take.seconds) for take in LONGER]


@pytest.mark.parametrize("seconds", [15.0, pytest.param(100.0, marks=pytest.mark.study)])
def test_campaign_a(seconds: float, shared: Path, tmp_path: Path) -> None:
    truth = json.loads((shared / "campaigns" / "answers.json").read_text())["campaign-a"]["rig"]
    write(tmp_path / "campaign.h5", shortened(read(shared / "campaigns" / "campaign-a.h5"), seconds))
    assert main(["characterize", str(tmp_path / "campaign.h5"), "-o", str(tmp_path)]) == 0
    table = json.loads((tmp_path / "parameters.json").read_text())["parameters"]
    for name, row in table.items():
        loose = name.endswith("damping") or name == "friction_force"
        assert abs(row["value"] / truth[name] - 1.0) < (0.02 if loose else 0.005), name
        assert abs(row["value"] - truth[name]) <= 3.0 * row["std"] + 0.002 * truth[name], name


def test_deviation_is_the_scatter_of_means() -> None:
    """One value, the mean of a hundred: each line moves it by its share."""
    generator = np.random.default_rng(0)
    values = generator.standard_normal((2000, 100))
    found = [deviation((row - row.mean())[:, None] / (len(row) - 1.0), np.ones(1)) for row in values]
    assert np.mean(np.abs(values.mean(axis=1)) <= 1.959964 * np.array(found)) == pytest.approx(0.95, abs=0.015)
    # Few lines: Student's distribution makes up for it.
    few = values[:, :6]
    found = [deviation((row - row.mean())[:, None] / (len(row) - 1.0), np.ones(1)) for row in few]
    assert np.mean(np.abs(few.mean(axis=1)) <= 1.959964 * np.array(found)) > 0.9


@pytest.mark.parametrize("size", [1e-135, 1e135])
def test_deviation_has_the_unit_of_its_value(size: float) -> None:
    """The fourth powers of tiny changes would be zero, those of large ones infinite."""
    moves = np.random.default_rng(1).standard_normal((20, 1))
    assert deviation(size * moves, np.ones(1)) == pytest.approx(size * deviation(moves, np.ones(1)))
    assert deviation(0.0 * moves, np.ones(1)) == 0.0


def test_intervals_hold_the_truth_and_are_no_wider_than_they_need() -> None:
    model = wire_bonder({**THESIS, "friction_force": 9.0, "table_mass": 92.0})
    campaign = virtual_campaign(model, TAKES, seed=1)
    found = characterize(campaign, baseline_model(campaign))
    assert found.adequate
    for name, truth in truths(model).items():
        entry = found.table[name]
        if not entry.fixed:
            assert entry.value is not None
            assert entry.std is not None
            assert abs(entry.value - truth) <= 4.0 * entry.std, name
            assert entry.std < 5e-4 * truth, name


@pytest.mark.parametrize("noise", [pytest.param(NOISES[2], marks=pytest.mark.study), NOISES[3]])
def test_intervals_hold_the_truth_with_other_noise_than_white(noise: str) -> None:
    """Coloured noise, and noise mostly in the drive: neither is a misfit of the model."""
    model = wire_bonder({**THESIS, "friction_force": 9.0, "table_mass": 92.0})
    campaign = with_noise(virtual_campaign(model, SHORT, seed=1, noise=0.0), noise, "head", 1)
    found = characterize(campaign, baseline_model(campaign))
    assert found.adequate
    # White noise of the drive's sensor is known from its spectrum.
    assert (
        "is related to neither the drive nor the motion beyond 0.80 % of the signal: it is taken as noise" in found.noise
    ) == (noise == NOISES[2])
    for name, truth in truths(model).items():
        entry = found.table[name]
        if not entry.fixed:
            assert entry.value is not None
            assert entry.std is not None
            assert abs(entry.value - truth) <= 3.5 * entry.std, name
            assert entry.std < 0.02 * truth, name
    assert found.table["motor_frequency"].std == pytest.approx(0.0, abs=1e-3 * truths(model)["motor_frequency"])


def test_a_wrong_model_is_not_taken_as_noise() -> None:
    """Friction that is missing in the model is related to the motion."""
    model = wire_bonder({**THESIS, "friction_force": 9.0})
    campaign = virtual_campaign(model, SHORT, seed=1)
    found = characterize(campaign, baseline_model(campaign, "linear"))
    assert not found.adequate
    assert found.noise == ""


@pytest.mark.parametrize(("share", "noise"), [(1.03, True), (1.15, False)])
def test_an_error_above_the_limit_is_a_misfit_whatever_its_relation(share: float, noise: bool) -> None:
    """Coloured noise in the responses, related to nothing, just below and just above `MOST_NOISE` of each signal."""
    clean = played(stage(), seed=4)
    draw = np.random.default_rng(4)
    runs = []
    for run in clean.runs:
        channels = dict(run.channels)
        for sensor in stage().sensors:
            values = run.read(sensor.channel)
            added = lfilter([1.0], [1.0, -0.9], draw.standard_normal(len(values)))
            samples = values + share * MOST_NOISE * np.std(values) / np.std(added) * added
            channels[sensor.channel] = replace(channels[sensor.channel], samples=samples)
        runs.append(replace(run, channels=channels))
    found = characterize(replace(clean, runs=tuple(runs)), guessed(stage(), 4))
    # The slow part of this noise does not count: a zero that wanders.
    assert found.score.figure == pytest.approx(MOST_NOISE, rel=0.1)
    assert (found.score.figure < MOST_NOISE) == noise
    assert (bool(found.noise), found.adequate) == (noise, noise)


def test_a_spoilt_run_takes_no_part_and_is_named(tmp_path: Path) -> None:
    model = wire_bonder({**THESIS, "friction_force": 9.0})
    again = VirtualRun(id="again", configuration="unlocked", gain=70.0, seconds=12.0, start=200.0)
    campaign = virtual_campaign(model, [replace(take, seconds=12.0) for take in (*SHORT, again)], seed=2)
    last = campaign.runs[-1]
    clipped = Channel(name="motor", samples=np.clip(last.read("motor"), -1.0, 1.0))
    hurt = replace(campaign, runs=(*campaign.runs[:-1], replace(last, channels={**last.channels, "motor": clipped})))
    write(tmp_path / "hurt.h5", hurt)
    assert main(["characterize", str(tmp_path / "hurt.h5"), "-o", str(tmp_path)]) == 0
    answer = json.loads((tmp_path / "parameters.json").read_text())
    assert any("'again': motor seems clipped" in text for text in answer["faults"])
    for name, truth in truths(model).items():
        assert answer["parameters"][name]["value"] == pytest.approx(truth, rel=2e-3), name
    assert "motor seems clipped" in (tmp_path / "fits.html").read_text()
    for name in ("set-ups.png", "error-surface.png"):
        assert (tmp_path / name).stat().st_size > 10_000


def _forget_filters() -> None:
    # Those of another length.
    sampling._lowpass.cache_clear()
    sampling._sampler.cache_clear()


@pytest.mark.parametrize("taps", [12, 40])
def test_another_sampling_filter_is_within_what_is_stated(taps: int, monkeypatch: pytest.MonkeyPatch) -> None:
    model = wire_bonder({**THESIS, "friction_force": 9.0})
    with monkeypatch.context() as patch:
        # The recorder's filter, of the same kind and another length; only what played the rig knows.
        patch.setattr(sampling, "TAPS", taps)
        patch.setattr(free_run, "TAPS", taps)
        _forget_filters()
        campaign = virtual_campaign(model, TAKES, seed=5)
    _forget_filters()
    found = characterize(campaign, baseline_model(campaign))
    for name, truth in truths(model).items():
        entry = found.table[name]
        if entry.value is not None and entry.std:
            assert abs(entry.value - truth) <= 3.5 * entry.std, name


def test_effects_that_the_runs_do_not_show_are_not_reported() -> None:
    model = wire_bonder({**THESIS, "friction_force": 9.0})
    campaign = virtual_campaign(model, TAKES, seed=1)
    for runs, silent in ((campaign.runs[2:], "locked"), (campaign.runs[1::2], "stuck")):
        found = characterize(replace(campaign, runs=runs), baseline_model(campaign))
        for name in ("motor_frequency", "motor_damping", "friction_force"):
            assert found.table[name].value is None, (name, silent)
            assert "not identifiable" in found.table[name].note
        for name in ("table_mass", "table_frequency", "heatblock_frequency", "heatblock_damping"):
            entry = found.table[name]
            assert entry.value is not None
            assert entry.std is not None
            assert abs(entry.value - truths(model)[name]) <= 4.0 * entry.std, (name, silent)
    narrow = characterize(replace(campaign, runs=campaign.runs[::2]), baseline_model(campaign))
    # Far below its resonance the heatblock's damping is a matter of milliradians: known far worse, and said to be.
    damping = narrow.table["heatblock_damping"]
    assert damping.value is not None
    assert damping.std is not None
    assert abs(damping.value - truths(model)["heatblock_damping"]) <= 3.0 * damping.std
    assert damping.std > 0.01 * damping.value
    assert narrow.table["motor_frequency"].value == pytest.approx(5.06, rel=1e-4)


def test_a_guess_of_friction_that_lets_nothing_slide() -> None:
    model = wire_bonder({**THESIS, "friction_force": 2.0})
    campaign = virtual_campaign(model, [replace(take, seconds=8.0) for take in TAKES], seed=1)
    assert campaign.known["friction_force"] == 20.0
    found = characterize(replace(campaign, runs=campaign.runs[1::2]), baseline_model(campaign))
    assert found.table["friction_force"].value == pytest.approx(2.0, rel=1e-3)
