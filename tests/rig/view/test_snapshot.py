"""What the screen shows of a session, against numpy and scipy: levels, traces, transfer functions, ratio, words."""

from __future__ import annotations

import time
import tracemalloc
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from isorig.analysis.campaign import Campaign, Channel, Gap, Run
from isorig.analysis.spectra.welch import estimate
from isorig.rig.acquire.notes import notes_in
from isorig.rig.files.recording import write
from isorig.rig.view.levels import Levels
from isorig.rig.view.messages import Judgement, Planned, SessionState, planned_as
from isorig.rig.view.running_frfs import MEMORY, RESOLUTION, AveragedRuns, GrowingSpectra
from isorig.rig.view.server import frame, read_frame
from isorig.rig.view.snapshot import Snapshot, SnapshotBuilder
from isorig.rig.view.sources import Reading, beginning_of, replayed, watched
from isorig.rig.view.state import Subject, state_of
from isorig.rig.wire_bonder.description import wire_bonder
from isorig.rig.wire_bonder.session import SESSION, virtual_campaign


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    """Two gains, one of them both ways, 12 seconds each."""
    takes = [replace(take, seconds=12.0) for take in SESSION if take.id in ("u70a", "u7", "l70")]
    return virtual_campaign(wire_bonder(), takes, seed=4)


def seen(campaign: Campaign, *, planned: tuple[Planned, ...] = (), pieces: int = 5, judge: bool = True) -> Snapshot:
    """What a builder shows behind a session that grew in pieces."""
    builder, pictures = SnapshotBuilder(planned, judge=judge), [Snapshot()]
    done: list[Run] = []
    for run in campaign.runs:
        for k in range(1, pieces):
            growing = beginning_of(run, k * len(run) // pieces)
            reading = Reading(campaign=replace(campaign, runs=(*done, growing)), whole=frozenset(item.id for item in done))
            builder.see(reading, pictures.append)
        done.append(run)
    builder.see(Reading(campaign=campaign, whole=frozenset(run.id for run in campaign.runs)), pictures.append)
    return pictures[-1]


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 99), n=st.integers(1, 9000), rate=st.sampled_from([100.0, 1024.0, 51200.0]),
    cuts=st.lists(st.integers(1, 9000), max_size=6), full=st.sampled_from([None, 2.0, 100.0]),
)  # fmt: skip
def test_levels_are_those_of_the_samples(seed: int, n: int, rate: float, cuts: list[int], full: float | None) -> None:
    values = np.random.default_rng(seed).standard_normal((2, n))
    channels = {name: Channel(name=name, samples=row, full_scale=full) for name, row in zip("ab", values, strict=True)}
    run = Run(id="r", configuration="unlocked", sample_rate=rate, gain=1.0, channels=channels)
    levels = Levels(run)
    for stop in [*sorted(cut for cut in cuts if cut < n), n]:
        levels.add(beginning_of(run, stop))
    # All but what does not fill a point of the trace yet.
    assert n - 2.0 * 4.0 * rate / 500 - 1 < levels.seen <= n
    read = values[:, : levels.seen]
    recent = read[:, -round(rate) :]
    for k, level in enumerate(levels.levels()):
        if levels.seen:
            assert level.rms == pytest.approx(np.sqrt(np.mean(recent[k] ** 2)))
            assert (level.peak, level.held) == (np.abs(recent[k]).max(), np.abs(read[k]).max())
        assert level.over == (full is not None and bool((np.abs(read[k]) >= 0.999 * full).any()))
    trace = levels.trace()
    assert trace.shape[1] <= 500
    if trace.shape[1]:
        shown = read[:, round(trace[0, 0] * rate - 0.25 * max(round(8.0 * rate / 500), 1)) :]
        np.testing.assert_array_equal(trace[1:].max(axis=1), shown.max(axis=1))
        np.testing.assert_array_equal(trace[1:].min(axis=1), shown.min(axis=1))
        assert np.all(np.diff(trace[0]) > 0.0)


def test_a_slow_wave_is_drawn_without_stairs() -> None:
    """The extremes of an interval are drawn in the order in which they occur."""
    wave = np.sin(2.0 * np.pi * np.arange(4000) / 2000.0)
    run = Run(id="r", configuration="unlocked", sample_rate=1000.0, gain=1.0, channels={"a": Channel(name="a", samples=wave)})
    levels = Levels(run)
    levels.add(run)
    (_, shown) = levels.trace()
    # A sine turns twice in each of its two periods.
    assert np.count_nonzero(np.diff(np.sign(np.diff(shown))) != 0) <= 8


def test_a_phase_has_no_line_where_it_wraps_and_no_band_is_that_of_the_drive(campaign: Campaign) -> None:
    last = campaign.runs[-1]
    picture = seen(replace(campaign, runs=(*campaign.runs[:-1], replace(last, band=None))))
    rows = picture.plots["frf"].rows
    assert rows[0].max() < 1.2 * last.band[1]
    for k in range(len(picture.plots["frf"].names)):
        steps = np.abs(np.diff(rows[3 + 5 * k]))
        assert np.nanmax(steps) <= 180.0


def test_transfer_functions_and_ratio_are_those_of_scipy(campaign: Campaign) -> None:
    picture = seen(campaign)
    unlocked, locked = (next(run for run in campaign.runs if run.id == name) for name in ("u70a", "l70"))
    length = round(unlocked.sample_rate / RESOLUTION)

    def welch(run: Run) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        same = {"fs": run.sample_rate, "window": "hann", "nperseg": length, "noverlap": length // 2, "detrend": "constant"}
        head = run.read("head")
        _, power = scipy.signal.welch(head, **same)
        found = {}
        for name in run.channels:
            f, cross = scipy.signal.csd(head, run.read(name), **same)
            found[name] = cross / power, scipy.signal.coherence(head, run.read(name), **same)[1]
        return {"f": (f, f), **found}

    plot = picture.plots["frf"]  # of the run that was taken last
    last = campaign.runs[-1]
    found, rows = welch(last), plot.rows
    kept = np.isin(found["f"][0], rows[0].astype(float))
    assert kept.sum() == rows.shape[1] > 20
    assert rows[0].min() >= last.band[0]
    assert rows[0].max() <= last.band[1]
    for k, name in enumerate(plot.names):
        size, _, phase, _, coherence = rows[1 + 5 * k : 6 + 5 * k]
        np.testing.assert_allclose(size, np.abs(found[name][0][kept]), rtol=1e-5)
        np.testing.assert_allclose(np.exp(1j * np.radians(phase)), np.exp(1j * np.angle(found[name][0][kept])), atol=1e-4)
        np.testing.assert_allclose(coherence, found[name][1][kept], atol=1e-5)
    ratio = picture.plots["isolation"]
    assert ratio.names == ("gain 70",)
    up, low = welch(unlocked), welch(locked)
    kept = np.isin(up["f"][0], ratio.rows[0].astype(float))
    np.testing.assert_allclose(ratio.rows[1], np.abs(up["heatblock"][0] / low["heatblock"][0])[kept], rtol=1e-4)


def test_words_say_how_far_it_is(campaign: Campaign) -> None:
    planned = tuple(replace_seconds(item, 48.0) for item in planned_as(campaign.runs))
    first = replace(campaign, runs=(beginning_of(campaign.runs[0], len(campaign.runs[0]) // 2),))
    builder, pictures = SnapshotBuilder(planned, judge=True), []
    builder.see(Reading(campaign=first, whole=frozenset()), pictures.append)
    state = state_of(Subject(title="lab.h5", mode="watch", planned=planned), pictures[-1], None)
    about = state["run"]
    assert (about["id"], about["number"], about["count"], about["of"]) == ("u70a", 1, 3, 48.0)
    assert about["seconds"] == pytest.approx(6.0, abs=0.01)
    assert state["session_left"] == pytest.approx(42.0 + 96.0, abs=0.01)
    assert state["phase"] == "measures"
    assert state["verdict"] == "Provisional: no run has been measured yet."
    words = state["averaged"].split()
    now, at_end = float(words[words.index("error") + 1]), float(words[words.index("now,") + 1])
    done, of = float(words[words.index("averages") + 1]), float(words[words.index("of") + 1].rstrip(","))
    assert done < of
    # The error falls with the root of the averages.
    assert at_end == pytest.approx(now * np.sqrt(done / of), rel=0.15)
    whole = state_of(Subject(title="lab.h5", mode="watch"), seen(campaign), None)
    assert whole["verdict"].startswith("Provisional, 3 runs checked: ")
    assert "findings in u7" in whole["verdict"]
    assert any("friction was not overcome" in line for line in whole["advice"])
    assert whole["phase"] == "over"


def test_an_error_that_cannot_be_computed_is_no_number(campaign: Campaign) -> None:
    spectra = estimate(campaign.runs[:1], references=["head"], resolution=0.5)
    runs = AveragedRuns(
        configuration="unlocked", gain=70.0, drive="head", band=(7.1, 7.2), spectra=spectra, planned=100.0
    )  # fmt: skip
    assert runs.text(alone=True).endswith(", error not available: no response has a frequency bin within the band")
    assert "%" in replace(runs, band=(5.0, 20.0)).text(alone=True)


def replace_seconds(item: Planned, seconds: float) -> Planned:
    return Planned(id=item.id, configuration=item.configuration, gain=item.gain, seconds=seconds, broad=item.broad)


def test_overloads_are_latched_by_channel_and_run_and_losses_are_reported() -> None:
    values = np.random.default_rng(0).standard_normal(4096)
    loud = values.copy()
    loud[100] = 12.0
    faint = 0.01 * values

    def run(name: str, motor: np.ndarray, gaps: tuple[Gap, ...] = ()) -> Run:
        records = {"head": values, "motor": motor, "table": faint}
        channels = {key: Channel(name=key, samples=row, full_scale=10.0) for key, row in records.items()}
        return Run(id=name, configuration="locked", sample_rate=1024.0, gain=1.0, channels=channels, gaps=gaps)

    runs = (run("a", loud), run("b", values, (Gap(first_tick=7, count=30),)))
    picture = seen(Campaign(runs=runs), judge=False)
    state = state_of(Subject(title="x", mode="watch"), picture, SessionState(phase="measures", run="b"))
    assert {channel["name"]: channel["over"] for channel in state["channels"]} == {"head": [], "motor": ["a"], "table": []}
    assert state["lost"] == 30
    assert any("30 samples were lost" in line for line in state["advice"])
    assert any("table uses 0.4 % of its range" in line or "table uses 0.3" in line for line in state["advice"])
    assert not any("motor" in line for line in state["advice"])


def test_a_repeated_run_replaces_the_first_on_the_screen(campaign: Campaign) -> None:
    first = campaign.runs[0]
    other = replace(campaign.runs[1], id=first.id, gain=first.gain, band=first.band)
    pictures: list[Snapshot] = []
    builder = SnapshotBuilder(judge=False)
    for run in (first, other):
        builder.see(Reading(campaign=replace(campaign, runs=(run,)), whole=frozenset()), pictures.append)
    alone = seen(replace(campaign, runs=(other,)), pieces=1, judge=False)
    np.testing.assert_allclose(pictures[-1].plots["frf"].rows, alone.plots["frf"].rows, rtol=1e-5)
    assert pictures[-1].runs[first.id].seconds == alone.runs[first.id].seconds


def test_the_screen_reports_the_session_s_own_verdict(campaign: Campaign) -> None:
    judged = {"u70a": Judgement(good=False, advice=("motor clipped 3 times.",)), "u7": Judgement(good=True, advice=())}
    standing = SessionState(phase="asks", run="l70", last="u7", may=("next", "note"), judged=judged, stopped=("u70a",))
    subject = Subject(title="lab.h5", mode="session", planned=planned_as(campaign.runs))
    state = state_of(subject, seen(replace(campaign, runs=campaign.runs[:2]), judge=False), standing)
    assert state["verdict"] == "Provisional, 2 of 3 runs checked: repeat u70a."
    assert state["advice"] == ["u70a: motor clipped 3 times."]
    assert [run["state"] for run in state["runs"]] == ["stopped", "taken", "planned"]
    assert state["may"] == ["next", "note"]


def test_a_frame_is_read_as_it_was_written(campaign: Campaign) -> None:
    picture = seen(campaign)
    head, plots = read_frame(frame(7, {"title": "µ </script>"}, picture.plots))
    assert (head["frame"], head["state"]) == (7, {"title": "µ </script>"})
    assert plots.keys() == {"time", "frf", "isolation"}
    for name, plot in picture.plots.items():
        np.testing.assert_array_equal(plots[name], plot.rows)


def test_a_recording_is_played_back_at_its_own_pace(tmp_path: Path, campaign: Campaign) -> None:
    write(tmp_path / "c.h5", campaign)
    began, lengths, whole = time.monotonic(), [], []
    for reading in replayed(tmp_path / "c.h5", speed=24.0, every=0.05):
        lengths.append(sum(len(run) for run in reading.campaign.runs))
        whole.append(len(reading.whole))
        assert all(len(run.read("motor")) == len(run) for run in reading.campaign.runs[-1:])
    assert lengths == sorted(lengths)
    assert lengths[-1] == sum(len(run) for run in campaign.runs)
    assert whole[-1] == 3
    assert time.monotonic() - began >= 0.9  # no faster; a busy machine is slower
    assert len(lengths) > 15


@given(n=st.integers(1, 60), gaps=st.lists(st.tuples(st.integers(0, 80), st.integers(1, 9)), max_size=4))
def test_a_beginning_has_the_gaps_between_its_samples(n: int, gaps: list[tuple[int, int]]) -> None:
    samples, lost = np.arange(60.0), 0
    ledger = []
    for index, count in sorted(gaps):  # a gap before the sample of that index
        ledger.append(Gap(first_tick=min(index, 60) + lost, count=count))
        lost += count
    run = Run(
        id="r", configuration="unlocked", sample_rate=1.0, gain=1.0, channels={"a": Channel(name="a", samples=samples)},
        gaps=tuple(ledger),
    )  # fmt: skip
    begun = beginning_of(run, n)
    np.testing.assert_array_equal(begun.read("a"), samples[:n])
    assert begun.gaps == tuple(gap for gap, (index, _) in zip(ledger, sorted(gaps), strict=True) if min(index, 60) < n)


def test_a_finished_recording_is_shown_whole(tmp_path: Path, campaign: Campaign) -> None:
    write(tmp_path / "c.h5", campaign)
    readings = watched(tmp_path / "c.h5", lambda: True, every=0.05)
    assert [len(reading.whole) for reading in readings] == [3]


class _Flaky:
    """Samples that cannot be read every third time."""

    def __init__(self, samples: np.ndarray) -> None:
        self._samples, self._reads = samples, 0
        self.shape = samples.shape

    def __getitem__(self, key: slice, /) -> np.ndarray:
        self._reads += 1
        if self._reads % 3 == 0:
            raise OSError("read between two writes")
        return self._samples[key]


def test_a_temporarily_unreadable_file_is_read_at_the_next_poll(campaign: Campaign) -> None:
    sound = campaign.runs[0]
    flaky = replace(sound, channels={n: replace(c, samples=_Flaky(np.asarray(c.samples[:]))) for n, c in sound.channels.items()})
    builder, pictures, failures = SnapshotBuilder(judge=False), [Snapshot()], 0
    for n in [*range(2000, len(sound), 700), *[len(sound)] * 30]:
        reading = Reading(campaign=replace(campaign, runs=(beginning_of(flaky, n),)), whole=frozenset())
        try:
            builder.see(reading, pictures.append)
        except OSError:
            failures += 1
    assert failures > 5
    expected = seen(replace(campaign, runs=(sound,)), pieces=1, judge=False)
    assert pictures[-1].runs["u70a"].levels == expected.runs["u70a"].levels
    for name, plot in expected.plots.items():
        np.testing.assert_allclose(pictures[-1].plots[name].rows, plot.rows, rtol=1e-4, atol=1e-6)


def test_notes_of_others_are_read_from_the_file_itself_alone(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "other.h5", "w") as file:
        for key in ("time", "run", "text"):
            file.create_dataset(f"notes/{key}", data=[b"secret"], dtype=h5py.string_dtype("utf-8", 6))
    assert len(notes_in(tmp_path / "other.h5")) == 1
    # The walk through a file reads no text of variable length.
    with h5py.File(tmp_path / "variable.h5", "w") as file:
        for key in ("time", "run", "text"):
            file.create_dataset(f"notes/{key}", data=["secret"], dtype=h5py.string_dtype())
    with h5py.File(tmp_path / "group.h5", "w") as file:
        file["notes"] = h5py.ExternalLink("other.h5", "/notes")
    with h5py.File(tmp_path / "data.h5", "w") as file:
        for key in ("time", "run", "text"):
            file[f"notes/{key}"] = h5py.ExternalLink("other.h5", f"/notes/{key}")
    with h5py.File(tmp_path / "kind.h5", "w") as file:
        for key in ("time", "run", "text"):
            file[f"notes/{key}"] = np.arange(3)
    with h5py.File(tmp_path / "flat.h5", "w") as file:
        file["notes"] = np.arange(3)
    (tmp_path / "text.h5").write_text("no")
    for name in ("variable", "group", "data", "kind", "flat", "text", "absent"):
        assert notes_in(tmp_path / f"{name}.h5") == [], name


def test_the_spectra_of_a_wide_run_take_bounded_memory() -> None:
    rate, names = 51200.0, tuple("abcdefgh")
    values = np.random.default_rng(0).standard_normal(round(60 * rate)).astype(np.float32)

    def measured(seconds: float) -> Run:
        samples = values[: round(seconds * rate)]
        channels = {name: Channel(name=name, samples=samples) for name in names}
        return Run(id="r", configuration="unlocked", sample_rate=rate, gain=1.0, channels=channels)

    tracemalloc.start()
    try:
        response = GrowingSpectra(measured(2.0), "a")
        sizes = []
        for seconds in range(4, 61, 4):
            response.add(measured(float(seconds)))
            sizes.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    # Sums in double precision and the buffer of the transforms, besides the groups.
    assert max(sizes) < MEMORY + (48 << 20)
    assert response.segments == 59
    assert response.spectra() is not None


def test_finished_runs_keep_no_samples() -> None:
    """A session of an hour has thirty runs of two minutes: only the current one needs its last second."""
    values = np.random.default_rng(1).standard_normal(51200)
    names = ("head", "motor", "table", "heatblock", "a", "b", "c", "d")
    runs = tuple(
        Run(
            id=f"r{k}", configuration="unlocked", sample_rate=51200.0, gain=1.0, excitation="moves",
            channels={name: Channel(name=name, samples=values) for name in names},
        )
        for k in range(8)
    )  # fmt: skip
    builder, pictures = SnapshotBuilder(judge=False), [Snapshot()]

    def grown(first: int, last: int) -> int:
        tracemalloc.start()
        for k in range(first, last):
            whole = frozenset(run.id for run in runs[:k])
            builder.see(
                Reading(campaign=Campaign(runs=runs[: k + 1]), whole=whole), lambda picture: pictures.__setitem__(0, picture)
            )
        size = tracemalloc.get_traced_memory()[0]
        tracemalloc.stop()
        return size

    grown(0, 2)
    assert grown(2, 8) < 2 * len(names) * values.nbytes
    first = pictures[0].runs["r0"].levels[0]
    assert (first.rms, first.held) == (pytest.approx(values.std(), rel=1e-3), np.abs(values).max())
