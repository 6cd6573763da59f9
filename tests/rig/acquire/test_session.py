"""A session as its user sees it: from a plan to a recording, over real ports."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from ramps import RampPlant, Watcher, acquire, plan_of, ramp_instrument

from isorig.drivers.block import Block, Input
from isorig.drivers.simulated.commanded import Faults
from isorig.drivers.simulated.served import served
from isorig.rig.acquire.journal import Reader
from isorig.rig.acquire.plan_check import read_plan
from isorig.rig.acquire.recorder import RunWriter, recording_into
from isorig.rig.acquire.recover import WorkingFileReader, follow
from isorig.rig.acquire.simulated_instruments import far_end
from isorig.rig.cli import main
from isorig.rig.errors import PlanError
from isorig.rig.files.recording import read
from isorig.rig.wire_bonder.description import wire_bonder

RANDOM = {"excitation": "random", "band": [0.5, 20.0], "seconds": 8.0}


def test_a_session_on_the_virtual_rig(tmp_path: Path) -> None:
    watcher, output = Watcher(), tmp_path / "c.h5"
    plan = plan_of(
        {"id": "u70", **RANDOM, "repeats": 2}, {"id": "m", "excitation": "multisine", "band": [1.0, 50.0], "seconds": 13.0},
        {"id": "l70", **RANDOM, "configuration": "locked", "seconds": 24.0}, {"id": "u7", **RANDOM, "gain": 7.0, "seed": 5},
        sensitivity=0.2,
    )  # fmt: skip
    acquire(plan, "virtual", output, watcher.operator)
    campaign = read(output)
    assert [run.id for run in campaign.runs] == ["u70-1", "u70-2", "m", "l70", "u7"]
    assert dict(campaign.known) == {"head_mass": 6.5}
    assert watcher.locks == []  # this rig locks by itself
    by_id = {run.id: run for run in campaign.runs}
    assert by_id["u70-1"].read("head").std() == pytest.approx(3.8, rel=0.01)
    assert not np.array_equal(by_id["u70-1"].read("head"), by_id["u70-2"].read("head"))
    assert (by_id["m"].period, len(by_id["m"])) == (4096, 12288)
    np.testing.assert_allclose(by_id["l70"].read("motor"), by_id["l70"].read("table"), atol=0.01)
    verdicts = {taken.id: taken.verdict for taken in watcher.runs}
    assert [item.periods for item in verdicts["m"].detections] == [2, 2, 2]
    # Dry friction is an odd distortion, far above the sensors' noise.
    (motor,) = (item for item in verdicts["m"].detections if item.response == "motor")
    assert motor.odd > 0.1
    assert motor.odd > 10.0 * motor.noise
    assert any("motor responds at frequencies that are not driven" in advice for advice in verdicts["m"].advice)
    assert any("friction was not overcome" in advice for advice in verdicts["u7"].advice)
    assert not any("friction" in advice for advice in verdicts["u70-1"].advice)
    assert verdicts["l70"].coherence["table"] > 0.9
    assert all(run.gaps == () for run in campaign.runs)
    assert watcher.seen[-1].seconds == watcher.seen[-1].of == 8.0
    assert watcher.seen[-1].full_scale == dict.fromkeys(("head", "motor", "table", "heatblock"), 50.0)


PLAN = """
rig = {head_mass = 6.5}
[instrument]
kind = "framed"
port = "virtual"
sample_rate = 1024.0
[channels]
head = {input = 0, sensitivity = 0.2}
motor = {input = 1, sensitivity = 0.2}
[[runs]]
id = "a"
configuration = "unlocked"
gain = 70.0
excitation = "random"
band = [0.5, 20.0]
seconds = 3.0
"""


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("sample_rate = 1024.0", "sample_rate = 0.0", "sample_rate is 0 Hz"),
        ("sample_rate = 1024.0", "", "sample_rate"),
        ("sensitivity = 0.2}\nmotor", "sensitivity = 0.0}\nmotor", "channels.head.sensitivity is 0"),
        ("head = {input = 0, sensitivity = 0.2}", "head = {input = 0}", "sensitivity"),
        ("input = 1", "input = 0", "share an input"),
        ("input = 1", "input = -1", "inputs start at 0"),
        ("head = {input = 0,", 'head = {input = 0, unit = "g",', "for acceleration give 'm/s^2'"),
        ("head = {input = 0,", 'head = {input = 0, quantity = "force",', "for force give 'N'"),
        ('"unlocked"', '"lokced"', "the rig has unlocked, locked"),
        ("rig = {head_mass = 6.5}", "rig = {head_mass = -6.5}", "rig.head_mass is -6.5"),
        ("rig = {head_mass = 6.5}", 'rig = {head_mass = "heavy"}', "rig.head_mass is the text"),
        ("rig = {head_mass = 6.5}", 'rig = {description = "[["}', "rig.description is not TOML"),
        ("rig = {head_mass = 6.5}", 'rig = {description = "name = 3"}', "rig.description"),
        ("band = [0.5, 20.0]", "band = [0.5, 0.6]", "contains no frequency of its drive"),
        ("sample_rate = 1024.0", "sample_rate = 1024.0\nbaud_rate = 0", "baud_rate is 0"),
        ("sample_rate = 1024.0", "sample_rate = 1024.0\nvolume = 11", "volume"),
        ("seconds = 3.0", "seconds = 0.0", "lasts 0 s"),
        ("seconds = 3.0", "seconds = nan", "lasts nan s"),
        ("band = [0.5, 20.0]", "band = [20.0, 0.5]", "low < high"),
        ("band = [0.5, 20.0]", "band = [0.5, 2000.0]", "half the sample rate"),
        ("band = [0.5, 20.0]", "", "has no band"),
        ("gain = 70.0", "gain = -1.0", "gain -1"),
        ('id = "a"', 'id = "a/b"', "without a slash"),
        ('id = "a"', 'id = "a"\nspeed = 3', "speed"),
        ('excitation = "random"', 'excitation = "loud"', "excitation"),
        ('kind = "framed"', 'kind = "telepathy"', "kind"),
        ('kind = "framed"', 'kind = "di1100"', "full_scale"),
        ('kind = "framed"', 'kind = "sr785"', "instrument.shows"),
        ("[[runs]]", "[[walks]]", "walks"),
        ("rig = {", "rig = {{", "not TOML"),
    ],
)
def test_a_bad_plan_is_refused_in_a_sentence(tmp_path: Path, old: str, new: str, says: str) -> None:
    assert old in PLAN
    plan = tmp_path / "plan.toml"
    plan.write_text(PLAN.replace(old, new, 1))
    with pytest.raises(PlanError) as refusal:
        read_plan(plan)
    assert says in str(refusal.value)
    assert "\n" not in str(refusal.value)


class Bad(RampPlant):
    """A plant with one input out of order."""

    def __init__(self, fault: str) -> None:
        super().__init__()
        self.fault = fault

    def play(self, drive: np.ndarray, *, sample_rate: float, gain: float, configuration: str) -> np.ndarray:
        noise = np.random.default_rng(0).normal(0.0, 50.0, (len(drive), 4))
        values = (noise + 1e6 * np.asarray(drive)[:, None] * (0.0 if self.fault == "no drive" else 1.0)).astype(np.int32)
        if self.fault == "dead":
            values[:, 1] = 0
        elif self.fault == "open":
            values[:, 1] = 4_000_000_000 // 2
        elif self.fault == "loud":
            values[::50, 1] = 2**31 - 1
        elif self.fault == "loose":
            values[:, 1] = noise[:, 1].astype(np.int32)
        return values


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        ("dead", "motor is constant to the last count"), ("open", "motor remains at the end"),
        ("loud", "motor exceeds"), ("loose", "motor does not respond"), ("no drive", "the drive causes no response"),
    ],
)  # fmt: skip
def test_a_rig_out_of_order_is_refused_before_the_run(
    tmp_path: Path, fault: str, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    plant = Bad(fault)
    plant.inputs = (4, "V", 1e-6, 2000.0)
    monkeypatch.setattr("ramps.RampPlant", lambda inputs: plant)
    plan, output = plan_of({"id": "a", **RANDOM, "seconds": 2.0}), tmp_path / "c.h5"
    with ramp_instrument() as (port, _):
        with pytest.raises(PlanError, match=says) as refusal:
            acquire(plan, port, output, Watcher().operator)
        assert "--force" in str(refusal.value)
        assert list(tmp_path.iterdir()) == []
        watcher = Watcher()
        acquire(plan, port, output, watcher.operator, force=True)
        assert len(watcher.runs) == 1


def test_a_drive_is_played_again_sample_for_sample(tmp_path: Path) -> None:
    plan = plan_of(
        {"id": "u70", **RANDOM, "repeats": 2, "seed": 3}, {"id": "again", **RANDOM, "repeat_of": "u70-2"},
        {"id": "thrice", **RANDOM, "repeat_of": "again"}, sensitivity=0.2,
    )  # fmt: skip
    kept: list[list[str | None]] = []

    def look(_: object) -> None:
        with closing(WorkingFileReader(tmp_path / "c.h5.partial")) as file:
            kept.append([item.run.repeat_of for item in file.runs() if item.run is not None])

    acquire(plan, "virtual", tmp_path / "c.h5", replace(Watcher().operator, taken=look))
    runs = {run.id: run for run in read(tmp_path / "c.h5").runs}
    assert {name: run.repeat_of for name, run in runs.items()} == {
        "u70-1": None, "u70-2": None, "again": "u70-2", "thrice": "again"
    }  # fmt: skip
    assert kept[-1] == [None, None, "u70-2", "again"]
    first = runs["u70-2"].read("head")
    # The sensor's noise is 1e-3 m/s^2; the drive itself has 3.8 m/s^2.
    assert [float((runs[name].read("head") - first).std()) < 3e-3 for name in runs] == [False, True, True, True]


def test_an_overload_and_a_wrong_rate_are_refused(tmp_path: Path) -> None:
    plan = plan_of({"id": "a", **RANDOM})
    with ramp_instrument(Faults(overload=1.0)) as (port, _), pytest.raises(PlanError, match="reports an overload"):
        acquire(plan, port, tmp_path / "c.h5", Watcher().operator)
    with ramp_instrument(Faults(ppm=50_000.0)) as (port, _), pytest.raises(PlanError, match=r"sample rate is 1075.2 Hz"):
        acquire(plan, port, tmp_path / "c.h5", Watcher().operator)


def test_an_operator_is_asked_where_the_rig_cannot_lock_by_itself(tmp_path: Path) -> None:
    plan = plan_of(
        {"id": "a", "excitation": "other", "seconds": 8.0}, {"id": "b", "excitation": "other", "seconds": 1.0},
        {"id": "c", "excitation": "other", "configuration": "locked", "seconds": 1.0},
        rate=2000.0, instrument={"kind": "di1100", "full_scale": 10.0}, sensitivity=0.2,
    )  # fmt: skip
    watcher = Watcher()
    # The signal is simulated at each start, while the session waits for its first sample: on a busy host a long one is too late.
    with served(far_end("di1100", wire_bonder(), noise=1e-3, seed=0, speed=2.0, seconds=2.0)) as port:
        # On a busy host the rate may be certain only in a later run.
        with pytest.raises(PlanError, match="Hz by the host's clock, not 2000"):
            acquire(plan, port, tmp_path / "refused.h5", Watcher().operator)
        acquire(plan, port, tmp_path / "c.h5", watcher.operator, force=True)
    assert watcher.locks == ["unlocked", "locked"]
    runs = read(tmp_path / "c.h5").runs
    assert [run.id for run in runs] == ["a", "b", "c"]
    assert all(len(run) >= 2000 for run in runs)
    assert runs[0].channels["motor"].full_scale == 50.0
    with pytest.raises(PlanError, match="plays none"), served(_quiet_dataq()) as port:
        acquire(msgspec.structs.replace(plan, runs=plan_of({"id": "x"}).runs), port, tmp_path / "d.h5", watcher.operator)


def _quiet_dataq() -> object:
    return far_end("di1100", wire_bonder(), noise=1e-3, seed=0, speed=8.0, seconds=2.0)


def test_an_accelerometer_on_can(tmp_path: Path) -> None:
    plan = plan_of({"id": "a", "excitation": "other", "seconds": 2.0}, rate=400.0, instrument={"kind": "mti600"})
    plan = msgspec.structs.replace(plan, channels={"motor": plan.channels["motor"]})
    with served(far_end("mti600", wire_bonder(), noise=1e-3, seed=0, speed=1.0, seconds=4.0)) as port:
        acquire(plan, port, tmp_path / "c.h5", Watcher().operator)
    run = read(tmp_path / "c.h5").runs[0]
    assert len(run) >= 800
    assert run.channels["motor"].scale == 2.0**-8
    assert 0.3 < run.read("motor").std() < 5.0


@pytest.mark.parametrize(
    ("kind", "traces"), [("sr785", ("0", "1")), ("35670a", ("XFR:POW:COH 1,2", "XTIM:VOLT 1"))]
)  # fmt: skip
def test_analyzers_give_spectra_and_time_records(tmp_path: Path, kind: str, traces: tuple[str, str]) -> None:
    shows = [
        {"trace": traces[0], "kind": "coherence", "channel": "motor", "reference": "head"},
        {"trace": traces[1], "kind": "time", "channel": "motor", "unit": "V"},
    ]
    plan = plan_of(
        {"id": "a", "excitation": "other"}, {"id": "b", "excitation": "other"},
        rate=256.0, instrument={"kind": kind, "shows": shows}, sensitivity=0.2,
    )  # fmt: skip
    watcher = Watcher()
    with served(far_end(kind, wire_bonder(), noise=1e-3, seed=0, speed=1.0, seconds=1.0)) as port:
        acquire(plan, port, tmp_path / "c.h5", watcher.operator)
    runs = read(tmp_path / "c.h5").runs
    assert [run.id for run in runs] == ["a", "b"]
    assert runs[0].sample_rate == pytest.approx(256.0, rel=1e-6)
    assert runs[0].usable_to == pytest.approx(100.0, rel=1e-6)
    assert 0.3 < runs[0].read("motor").std() < 5.0
    (spectrum,) = runs[0].spectra
    assert (spectrum.kind, spectrum.response, spectrum.reference) == ("coherence", "motor", "head")
    assert 0.0 <= spectrum.values.min() <= spectrum.values.max() <= 1.0 + 1e-6
    assert watcher.locks == ["unlocked"]


@contextmanager
def written(tmp_path: Path, blocks: list[Block]) -> Iterator[object]:
    plan, path = plan_of({"id": "a"}), tmp_path / "w.partial"
    inputs = [Input(unit="V", per_count=1.0, full_scale=None, dtype="int32")] * 4
    with recording_into(path, plan, inputs) as file, closing(WorkingFileReader(path)) as saved:
        writer = RunWriter(file, "a", period=None)
        for block in blocks:
            writer.put(block)
        writer.finish(None)
        yield saved.run("a")


def blocks_of(rate: float, seconds: float, step: float = 0.1, lose: range = range(0)) -> list[Block]:
    random = np.random.default_rng(0)
    return [
        Block(
            first_tick=64 * k, samples=np.full((64, 4), k, np.int32), host_time=64 * (k + 1) / rate + random.exponential(0.003),
            gain=70.0 * (1.0 + step * (k > 50)),
        )
        for k in range(int(seconds * rate / 64)) if k not in lose
    ]  # fmt: skip


def test_of_a_repeated_run_the_last_complete_one_counts(tmp_path: Path) -> None:
    plan, path = plan_of({"id": "a", "seconds": 1.0}), tmp_path / "w.partial"
    inputs = [Input(unit="V", per_count=1.0, full_scale=None, dtype="int32")] * 4
    kept = []
    with recording_into(path, plan, inputs) as file, closing(WorkingFileReader(path)) as saved:
        for value, blocks in ((1, 8), (2, 16), (3, 4), (4, 16)):
            writer = RunWriter(file, "a", period=None)
            for k in range(blocks):
                writer.put(Block(first_tick=64 * k, samples=np.full((64, 4), value, np.int32), host_time=k / 16.0))
            writer.finish(None)
            found = saved.run("a")
            kept.append((int(found.run.channels["motor"].samples[0:1][0]), found.stored, found.finished))
    assert kept == [(1, 512, False), (2, 1024, True), (2, 1024, True), (4, 1024, True)]


@pytest.mark.parametrize("ppm", [-200.0, 0.0, 53.0])
def test_clock_drift_is_reported_in_ppm_and_separately_from_losses(tmp_path: Path, ppm: float) -> None:
    # The plan says 1024 Hz, the device takes a little more; 100 blocks were lost on the way.
    with written(tmp_path, blocks_of(1024.0 * (1.0 + 1e-6 * ppm), 120.0, lose=range(300, 400))) as found:
        assert found.drift.ppm == pytest.approx(ppm, abs=min(10.0, 4.0 * found.drift.std))
        assert found.lost == 6400


def test_a_streamed_gain_is_recorded_with_every_sample(tmp_path: Path) -> None:
    with written(tmp_path, blocks_of(1024.0, 8.0, lose=range(10, 12))) as found:
        gains = found.run.read("gain")
        assert found.run.gain == pytest.approx(77.0)
        assert (np.unique(gains).round(6) == [70.0, 77.0]).all()
        # 51 blocks before the step, two of which were lost.
        assert int((gains < 71.0).sum()) == 49 * 64
    for step in (0.0, 1e-7):
        with written(tmp_path, blocks_of(1024.0, 8.0, step=step)) as found:
            gains = found.run.read("gain")
            assert found.run.gain == np.median(gains)
            assert len(gains) == len(found.run.channels["motor"])
            np.testing.assert_array_equal(gains, 70.0 * (1.0 + step * (np.arange(len(gains)) // 64 > 50)))
    with written(tmp_path, [replace(block, gain=None) for block in blocks_of(1024.0, 1.0)]) as found:
        assert "gain" not in found.run.channels


def test_a_recording_is_followed_while_it_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    output, sizes = tmp_path / "c.h5", []
    read_part = Reader.read

    def counted(self: Reader, place: int, count: int) -> bytes:
        if threading.current_thread() is threading.main_thread():
            sizes.append(count)
        return read_part(self, place, count)

    monkeypatch.setattr(Reader, "read", counted)
    with ramp_instrument(speed=4.0) as (port, _):
        plan = plan_of({"id": "a", "seconds": 8.0})
        session = threading.Thread(target=lambda: acquire(plan, port, output, Watcher().operator, force=True))
        session.start()
        while not output.with_name("c.h5.partial").exists():
            session.join(0.01)
        looks = [(len(campaign.runs[0]), finished) for campaign, finished in follow(output, every=0.1)]
        session.join()
    lengths = [length for length, _ in looks]
    assert lengths[-1] == 8 * 1024
    assert [finished for _, finished in looks] == [False] * (len(looks) - 1) + [True]
    assert len(lengths) >= 4
    # What was looked at once is not read again.
    assert sum(sizes) < 1.5 * 8 * 1024 * 16
    assert lengths == sorted(lengths)


def test_without_room_or_a_recording_nothing_is_recovered(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = tmp_path / "not.partial"
    plan.write_text("no")
    assert main(["recover", str(plan), "-o", str(tmp_path / "o.h5")]) == 2
    assert "is not a session's working file" in capsys.readouterr().err
    assert main(["acquire", str(plan), "-o", str(tmp_path / "o.h5")]) == 2
