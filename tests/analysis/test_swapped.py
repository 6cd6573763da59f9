"""Exchanged channels are named for every pair, in one run or in all; sound sessions have none, with poor guesses too."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.analysis.fitting import plausible, swapped
from isorig.analysis.fitting.linear_spectra import spectra_of, spectrum_of
from isorig.analysis.fitting.plausible import doubts
from isorig.analysis.fitting.swapped import exceeds_noise, swapped_channels
from isorig.analysis.model.rig_model import RigModel, from_tree
from isorig.analysis.simulate import Excitation, simulate
from isorig.analysis.simulate.excitation import random
from isorig.rig.files.recording import read
from isorig.rig.model.baseline import baseline_model
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.session import VirtualRun, virtual_campaign

TAKES = (
    VirtualRun(id="u70", configuration="unlocked", gain=70.0, seconds=15.0, start=0.0),
    VirtualRun(id="u7", configuration="unlocked", gain=7.0, seconds=15.0, start=40.0, band=(0.5, 400.0)),
    VirtualRun(id="l7", configuration="locked", gain=7.0, seconds=15.0, start=80.0, band=(0.5, 400.0)),
)
#: Pairs that do not move alike, by run: below the heatblock's resonance it follows the table, a locked motor is the table.
SHAPED = {
    "u70": [("head", "motor"), ("head", "table"), ("head", "heatblock"), ("motor", "table"), ("motor", "heatblock")],
    "u7": [("head", "motor"), ("head", "table"), ("head", "heatblock"), ("motor", "heatblock"), ("table", "heatblock")],
    "l7": [("head", "motor"), ("head", "table"), ("head", "heatblock"), ("motor", "heatblock"), ("table", "heatblock")],
}  # fmt: skip


@pytest.fixture(scope="module")
def session() -> Campaign:
    return virtual_campaign(wire_bonder({**THESIS, "friction_force": 12.0}), TAKES, seed=2)


def guessed(seed: int) -> RigModel:
    """The wire bonder with first guesses off by up to a factor of 1.6."""
    rig, generator = wire_bonder(), np.random.default_rng(seed)
    return rig.replace({path: rig.get(path) * float(np.exp(generator.uniform(-0.5, 0.5))) for path in rig.free})


def exchanged(campaign: Campaign, runs: Iterable[str], a: str, b: str) -> Campaign:
    def one(run: Run) -> Run:
        if run.id not in runs:
            return run
        turned = {a: replace(run.channels[b], name=a), b: replace(run.channels[a], name=b)}
        return replace(run, channels={**run.channels, **turned})

    return replace(campaign, runs=tuple(one(run) for run in campaign.runs))


@pytest.mark.parametrize("seed", range(4))
def test_a_sound_session_has_none(session: Campaign, seed: int) -> None:
    assert not swapped_channels(guessed(seed), spectra_of(wire_bonder(), session))


@pytest.mark.parametrize("pair", list(combinations(("head", "motor", "table", "heatblock"), 2)), ids="/".join)
def test_every_pair(session: Campaign, pair: tuple[str, str]) -> None:
    """In one run alone, and in all of them at once."""
    shaped = [run for run, pairs in SHAPED.items() if pair in pairs]
    for runs in (*([run] for run in shaped), list(SHAPED)):
        wrong = exchanged(session, runs, *pair)
        found = swapped_channels(wire_bonder(), spectra_of(wire_bonder(), wrong))
        assert list(found) == [pair]
        assert set(found[pair]) == {run for run in runs if run in shaped}
    (doubt,) = (d for d in doubts(wire_bonder(), (), wrong) if d.kind == "swapped")
    assert f"{pair[0]} and {pair[1]} seem swapped" in doubt.text


def test_another_rig() -> None:
    """Two masses on a force: the two accelerations, and the force with either."""
    rig = from_tree(
        {
            "name": "chain", "bodies": [{"name": "block", "mass": 10.0}, {"name": "cap", "mass": 2.0}],
            "links": [
                {"name": "foot", "a": "block", "b": "ground", "stiffness": 4e4, "damping": 40.0},
                {"name": "neck", "a": "cap", "b": "block", "stiffness": 3e4, "damping": 10.0},
            ],
            "drive": {"channel": "force", "quantity": "force", "factor": 1.0, "pushes": {"block": 1.0}},
            "sensors": [{"channel": "block", "body": "block"}, {"channel": "cap", "body": "cap"}],
        }
    )  # fmt: skip
    force = random(samples=8192, sample_rate=512.0, rms=30.0, band=(1.0, 100.0), seed=1)
    truth = rig.replace({"links.foot.stiffness": 5e4, "bodies.cap.mass": 1.6})
    motion = simulate(truth, Excitation.prepare(force, 512.0), configuration="unlocked").channels
    channels = {name: Channel(name=name, samples=values) for name, values in {"force": force, **motion}.items()}
    run = Run(id="r", configuration="unlocked", sample_rate=512.0, gain=1.0, channels=channels, excitation="random",
              band=(1.0, 100.0))  # fmt: skip
    campaign = Campaign(runs=(run,))
    assert not swapped_channels(rig, spectra_of(rig, campaign))
    for pair in combinations(("force", "block", "cap"), 2):
        assert list(swapped_channels(rig, spectra_of(rig, exchanged(campaign, ["r"], *pair)))) == [pair]


def test_noise_beyond_the_drive_s_band_is_no_exchange() -> None:
    """A drive whose band is not stated: above it all records are noise, and their levels tell nothing."""
    rig = from_tree(
        {
            "name": "chain",
            "bodies": [{"name": "m0", "mass": 1.2}, {"name": "m1", "mass": 0.9}, {"name": "m2", "mass": 0.7}],
            "links": [
                {"name": "l0", "a": "m0", "b": "ground", "stiffness": 9e3, "damping": 6.0},
                {"name": "l1", "a": "m1", "b": "m0", "stiffness": 2.2e4, "damping": 4.0},
                {"name": "l2", "a": "m2", "b": "m1", "stiffness": 1.2e4, "damping": 3.0},
            ],
            "drive": {"channel": "force", "quantity": "force", "factor": 1.0, "pushes": {"m0": 1.0}},
            "sensors": [{"channel": "a0", "body": "m0"}, {"channel": "a2", "body": "m2"}],
        }
    )  # fmt: skip
    force = random(samples=16384, sample_rate=400.0, rms=25.0, band=(1.0, 20.0), seed=1)
    motion = simulate(rig, Excitation.prepare(force, 400.0), configuration="unlocked").channels
    draw, records = np.random.default_rng(3), {"force": force, **motion}
    levels = {"force": 1e-5, "a0": 1e-3, "a2": 1e-1}
    noisy = {name: values + draw.normal(0.0, levels[name] * values.std(), len(values)) for name, values in records.items()}
    channels = {name: Channel(name=name, samples=values) for name, values in noisy.items()}
    run = Run(id="r", configuration="unlocked", sample_rate=400.0, gain=1.0, channels=channels, excitation="random")
    campaign = Campaign(runs=(run,))
    assert not swapped_channels(rig, spectra_of(rig, campaign))
    wrong = exchanged(campaign, ["r"], "a0", "a2")
    assert list(swapped_channels(rig, spectra_of(rig, wrong))) == [("a0", "a2")]


@pytest.mark.parametrize(("share", "counts"), [(0.8, True), (1.25, False)])
def test_a_band_counts_if_half_of_its_power_is_no_noise(share: float, counts: bool) -> None:
    """Noise of a share of the motion's rms, both white."""
    draw = np.random.default_rng(5)
    drive, record = draw.normal(size=40_000), draw.normal(size=40_000) + share * draw.normal(size=40_000)
    rig = from_tree(
        {
            "name": "one", "bodies": [{"name": "m", "mass": 1.0}], "links": [{"name": "l", "a": "m", "b": "ground"}],
            "drive": {"channel": "f", "quantity": "force", "pushes": {"m": 1.0}}, "sensors": [{"channel": "a", "body": "m"}],
        }
    )  # fmt: skip
    channels = {name: Channel(name=name, samples=values) for name, values in (("f", drive), ("a", record))}
    run = Run(id="r", configuration="unlocked", sample_rate=256.0, gain=1.0, channels=channels, band=(5.0, 100.0))
    spectrum = spectrum_of(rig, run, {"a": share})
    assert spectrum is not None
    assert set(exceeds_noise(spectrum).tolist()) == {counts}


def test_no_unit_is_taken_for_an_exchange(session: Campaign) -> None:
    """A table that is a thousand times too large keeps its shape."""

    def larger(run: Run) -> Run:
        table = replace(run.channels["table"], scale=1e3 * run.channels["table"].scale)
        return replace(run, channels={**run.channels, "table": table})

    wrong = replace(session, runs=tuple(map(larger, session.runs)))
    assert not swapped_channels(wire_bonder(), spectra_of(wire_bonder(), wrong))


@pytest.mark.study
def test_campaigns_of_another_program_have_none(shared: object) -> None:
    from pathlib import Path

    for path in sorted((Path(str(shared)) / "campaigns").rglob("*.h5")):
        campaign = read(path)
        found = plausible.doubts_of_records(baseline_model(campaign), campaign)
        assert not [doubt for doubt in found if doubt.kind == "swapped"], path


def test_an_exchange_that_brings_the_shapes_no_nearer_is_none(session: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first response falls where it should rise; the second should be flat, and rises a little in the first case only."""
    rise = np.linspace(0.0, 3.0, 20)
    middle = np.where(np.abs(rise - 1.5) < 1.3, 0.1, -1.0) * (rise - 1.5)
    for first, second, named in ((-0.1 * rise, 0.02 * rise, True), (middle, 0.0 * rise, False)):
        recorded, predicted = np.stack([0.0 * rise, first, second]), np.stack([0.0 * rise, rise, 0.0 * rise])
        assert swapped._turned(first - second, rise)
        monkeypatch.setattr(swapped, "_shapes", lambda *more, shapes=(recorded, predicted): shapes)
        assert bool(swapped_channels(wire_bonder(), spectra_of(wire_bonder(), session))) is named


def test_a_rig_that_friction_holds_has_a_shape(session: Campaign) -> None:
    """With the channels exchanged, the described friction may hold every body: the predicted power is zero."""
    (spectrum, *_) = spectra_of(wire_bonder(), session)
    held = swapped._Predicted(wire_bonder(), spectrum)
    silent = replace(spectrum, power=0.0 * spectrum.power, drives=0.0 * spectrum.drives)
    assert all(np.isfinite(each).all() for each in swapped._shapes(held, silent, exceeds_noise(spectrum)))


@pytest.mark.parametrize(("worst", "named"), [(0.51, True), (0.49, False)])
def test_an_exchange_must_repair_the_phases_of_every_record(
    session: Campaign, worst: float, named: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The correlations of the records with their predictions, as recorded and after the exchange."""
    wrong = exchanged(session, list(SHAPED), "motor", "heatblock")
    agreements = iter([(None, np.full(4, 0.3)), (None, np.array([worst, 0.9, 0.9, 0.9]))])
    monkeypatch.setattr(plausible, "wrong_scale", lambda *more: next(agreements))
    assert [doubt.kind for doubt in plausible.doubts_of_records(wire_bonder(), wrong)] == ["swapped"] * named
