"""Bad data by name: each fault put into a sound session, found in its place, and nothing found where nothing is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from isorig.analysis.campaign import Campaign, Channel, FloatArray, Gap, Run
from isorig.analysis.spectra.quality import faults, sound, without
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.session import VirtualRun, virtual_campaign

TAKES = (
    VirtualRun(id="u70a", configuration="unlocked", gain=70.0, seconds=25.0, start=0.0),
    VirtualRun(id="u70b", configuration="unlocked", gain=70.0, seconds=25.0, start=40.0),
    VirtualRun(id="u70c", configuration="unlocked", gain=70.0, seconds=25.0, start=80.0),
    VirtualRun(id="u7", configuration="unlocked", gain=7.0, seconds=20.0, start=120.0, band=(0.5, 400.0)),
    VirtualRun(id="l70", configuration="locked", gain=70.0, seconds=20.0, start=160.0),
    VirtualRun(id="l7", configuration="locked", gain=7.0, seconds=20.0, start=200.0, band=(0.5, 400.0)),
)
Change = Callable[[FloatArray], FloatArray]


@pytest.fixture(scope="module")
def session() -> Campaign:
    return virtual_campaign(wire_bonder({**THESIS, "friction_force": 12.0}), TAKES, seed=2)


def changed(campaign: Campaign, run: str, channel: str, change: Change) -> Campaign:
    def one(item: Run) -> Run:
        if item.id != run:
            return item
        old = item.channels[channel]
        new = Channel(name=channel, samples=change(old.read()), full_scale=old.full_scale)
        return replace(item, channels={**item.channels, channel: new})

    return replace(campaign, runs=tuple(one(item) for item in campaign.runs))


def exchanged(campaign: Campaign, run: str, a: str, b: str) -> Campaign:
    first, second = (next(r for r in campaign.runs if r.id == run).read(name) for name in (a, b))
    return changed(changed(campaign, run, a, lambda _: second), run, b, lambda _: first)


def named(campaign: Campaign) -> set[tuple[str, str, str]]:
    return {(fault.run, fault.channel, fault.kind) for fault in faults(campaign, reference="head")}


@pytest.mark.parametrize("friction", [5.0, 12.0, 20.0])
def test_a_sound_session_has_none(friction: float) -> None:
    assert not faults(virtual_campaign(wire_bonder({**THESIS, "friction_force": friction}), TAKES, seed=3), reference="head")


def test_the_silent_drive_of_a_released_run_is_no_fault(session: Campaign) -> None:
    silent = changed(session, "u70b", "head", np.zeros_like)
    assert ("u70b", "head", "dead") in named(silent)
    released = replace(silent, runs=tuple(replace(r, excitation="free") if r.id == "u70b" else r for r in silent.runs))
    assert not named(released)
    # A sensor that does not follow a released rig is dead as in any other run.
    assert ("u70b", "motor", "dead") in named(changed(released, "u70b", "motor", np.zeros_like))


def test_a_plug_that_loses_the_signal(session: Campaign) -> None:
    def lost(values: FloatArray) -> FloatArray:
        out = values.copy()
        out[4000:4040] = out[9000:9200] = 0.0
        return out

    (fault,) = faults(changed(session, "u70b", "table", lost), reference="head")
    assert (fault.run, fault.channel, fault.kind) == ("u70b", "table", "stuck")
    assert "2 times for up to 0.2 s" in fault.text


def test_a_coarse_converter_and_a_pause_are_not_stuck(session: Campaign) -> None:
    def coarse(values: FloatArray) -> FloatArray:
        step = values.std()
        return step * np.round(values / step)

    assert "stuck" not in {kind for _, _, kind in named(changed(session, "l7", "heatblock", coarse))}
    paused = session
    for name in session.runs[0].channels:
        paused = changed(paused, "u70a", name, lambda x: np.where(np.arange(len(x)) < 3000, 0.0, x))
    assert "stuck" not in {kind for _, _, kind in named(paused)}


def test_clipped(session: Campaign) -> None:
    at_range = changed(session, "u70a", "motor", lambda x: np.clip(40.0 * x, -50.0, 50.0))
    assert ("u70a", "motor", "clipped") in named(at_range)
    unknown = changed(session, "l70", "table", lambda x: np.clip(x, -2.0 * x.std(), 2.0 * x.std()))
    assert named(unknown) == {("l70", "table", "clipped")}


@pytest.mark.parametrize("left", [0.0, 1e-5])
def test_dead(session: Campaign, left: float) -> None:
    generator = np.random.default_rng(0)
    hurt = changed(session, "u7", "heatblock", lambda x: left * generator.standard_normal(len(x)))
    assert named(hurt) == {("u7", "heatblock", "dead")}


def test_noisy(session: Campaign) -> None:
    generator = np.random.default_rng(0)
    once = changed(session, "u70b", "table", lambda x: x + 0.5 * x.std() * generator.standard_normal(len(x)))
    assert named(once) == {("u70b", "table", "noisy")}
    always = session
    for run in session.runs:
        always = changed(always, run.id, "heatblock", lambda x: x + 0.2 * generator.standard_normal(len(x)))
    assert {(run.id, "heatblock", "noisy") for run in session.runs} == named(always)


@pytest.mark.parametrize("pair", [("motor", "table"), ("head", "motor")])
def test_swapped_in_one_run(session: Campaign, pair: tuple[str, str]) -> None:
    assert named(exchanged(session, "u70b", *pair)) == {("u70b", "/".join(pair), "swapped")}


def test_table_and_heatblock_swapped_in_all_runs(session: Campaign) -> None:
    wrong = session
    for run in session.runs:
        wrong = exchanged(wrong, run.id, "table", "heatblock")
    # Below the heatblock's resonance the two move as one, so only the wide runs tell.
    assert named(wrong) == {(run, "table/heatblock", "swapped") for run in ("u7", "l7")}


def test_too_short(session: Campaign) -> None:
    run = session.runs[4]
    cut = {n: Channel(name=n, samples=c.read(0, 6000), full_scale=c.full_scale) for n, c in run.channels.items()}
    short = replace(session, runs=(*session.runs[:4], replace(run, channels=cut), session.runs[5]))
    assert named(short) == {("l70", "", "too short")}
    assert "measure 9 s or longer" in faults(short, reference="head")[0].text


@pytest.mark.parametrize(("share", "told"), [(0.9, False), (1.1, True)])
def test_a_position_that_ends_elsewhere_begins_at_rest(share: float, told: bool) -> None:
    """Its start differs from its mean, and the force that moved it is over: the motion in the first second tells."""
    rate, draw = 500.0, np.random.default_rng(4)
    t = np.arange(round(8.0 * rate)) / rate
    position = 2.0 / (1.0 + np.exp(-3.0 * (t - 2.5)))
    first = t < 1.0
    position[first] += 0.05 * share * position.std() * np.sqrt(2.0) * np.sin(2.0 * np.pi * 4.0 * t[first])
    channels = {
        "force": Channel(
            name="force", samples=np.where((t > 1.5) & (t < 2.5), 5.0 * (t - 1.5), 0.0) + draw.normal(0.0, 0.01, len(t))
        ),
        "x": Channel(name="x", samples=position),
    }
    run = Run(id="pull", configuration="unlocked", sample_rate=rate, gain=1.0, channels=channels)
    found = {fault.kind for fault in faults(Campaign(runs=(run,), source="pull"), reference="force")}
    assert ("not at rest" in found) is told


def test_not_at_rest(session: Campaign) -> None:
    # What a recording looks like that was begun while the drive was on.
    run = session.runs[4]
    late = {n: Channel(name=n, samples=c.read(4000, None), full_scale=c.full_scale) for n, c in run.channels.items()}
    moving = replace(session, runs=(*session.runs[:4], replace(run, channels=late), session.runs[5]))
    assert named(moving) == {("l70", "", "not at rest")}
    steady = replace(moving.runs[4], period=4000)
    assert named(replace(moving, runs=(*session.runs[:4], steady, session.runs[5]))) == set()
    names = list(run.channels)
    # An average does not mind, a simulation from rest does.
    assert "l70" in [r.id for r in without(moving, faults(moving, reference="head"), names).runs]
    assert "l70" not in [r.id for r in without(moving, faults(moving, reference="head"), names, from_rest=True).runs]


def test_a_drive_with_a_hole(session: Campaign) -> None:
    stop = signal.butter(8, (100.0, 200.0), "bandstop", fs=1024.0, output="sos")
    hollow = changed(session, "l7", "head", lambda x: np.asarray(signal.sosfiltfilt(stop, x)))
    (fault,) = (f for f in faults(hollow, reference="head") if f.kind == "no drive")
    assert (fault.run, fault.channel) == ("l7", "head")
    low, high = (float(part) for part in fault.text.split("from ")[1].split(" Hz")[0].split(" to "))
    assert 100.0 < low < 135.0
    assert 165.0 < high < 200.0


def test_bad_data_are_left_out_of_averages(session: Campaign) -> None:
    hurt = changed(session, "u70a", "table", lambda x: 0.0 * x)
    found = faults(hurt, reference="head")
    runs = hurt.select(configuration="unlocked", gain=70.0)
    assert [run.id for run in sound(runs, found, ["head", "table"])] == ["u70b", "u70c"]
    assert len(sound(runs, found, ["head", "motor"])) == 3
    assert [run.id for run in without(hurt, found, ["table"]).runs] == ["u70b", "u70c", "u7", "l70", "l7"]
    alone = changed(changed(session, "l70", "table", lambda x: 0.0 * x), "l7", "table", lambda x: 0.0 * x)
    assert len(without(alone, faults(alone, reference="head"), ["table"]).runs) == 6


@settings(max_examples=60, deadline=None)
@given(
    n=st.integers(2, 4000), rate=st.sampled_from([10.0, 1024.0, 25600.0]), seed=st.integers(0, 99),
    scales=st.lists(st.sampled_from([0.0, 1e-12, 1.0, 1e6]), min_size=1, max_size=4), steps=st.sampled_from([0, 2, 100]),
    gap=st.booleans(), top=st.sampled_from([None, 1e-3, 50.0]),
)  # fmt: skip
def test_any_data_gets_an_answer(
    n: int, rate: float, seed: int, scales: list[float], steps: int, gap: bool, top: float | None
) -> None:
    generator = np.random.default_rng(seed)
    rows = [scale * generator.standard_normal(n) for scale in scales]
    rows = [np.round(row * steps) if steps else row for row in rows]
    names = ("head", "motor", "table", "heatblock")
    channels = {name: Channel(name=name, samples=row, full_scale=top) for name, row in zip(names, rows, strict=False)}
    gaps = (Gap(first_tick=n // 2, count=5),) if gap else ()
    runs = tuple(
        Run(id=str(k), configuration="unlocked", sample_rate=rate, gain=1.0, channels=channels, gaps=gaps, excitation="random")
        for k in range(3)
    )
    campaign = Campaign(runs=runs, known={"heatblock_frequency": 165.0})
    for fault in faults(campaign, reference="head"):
        assert fault.run in fault.text
        assert fault.text.endswith(".")
    assert without(campaign, faults(campaign, reference="head"), names).runs


def spoilt(session: Campaign, size: float, channels: Sequence[str], at: int = 3000) -> Campaign:
    """A session with one sample of the last run off by so many times the rms, in these channels."""
    run = session.runs[-1]
    changed_ones = {}
    for name in channels:
        values = run.read(name).copy()
        values[at] += size * values.std()
        changed_ones[name] = replace(run.channels[name], samples=values, scale=1.0, offset=0.0)
    return replace(session, runs=(*session.runs[:-1], replace(run, channels={**run.channels, **changed_ones})))


@pytest.mark.parametrize(
    ("size", "channels", "told"), [(25.0, ["motor"], True), (0.5, ["motor"], False), (25.0, ["motor", "table"], False)]
)
def test_a_spike_that_no_other_channel_shows(size: float, channels: list[str], told: bool, session: Campaign) -> None:
    found = [fault for fault in faults(spoilt(session, size, channels), reference="head") if fault.kind == "spike"]
    assert [(fault.run, fault.channel) for fault in found] == ([(session.runs[-1].id, "motor")] if told else [])
    assert all("at 2.93 s that no other channel shows" in fault.text for fault in found)
