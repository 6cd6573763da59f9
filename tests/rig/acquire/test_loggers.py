"""Slow loggers that run along: stored by the host's clock with their own rate, and never the end of a run."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from ramps import Watcher

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "drivers"))

from far import CsvFar, Far, FramedFar
from ramps import acquire
from test_sessions_attacked import wait_for

from isorig.drivers.errors import DriverError
from isorig.rig.acquire.plan import Plan
from isorig.rig.acquire.plan_check import read_plan
from isorig.rig.cli import main
from isorig.rig.errors import PlanError
from isorig.rig.files.recording import read
from isorig.rig.next.plan_file import plan_text

PLAN = """
[instrument]
kind = "framed"
port = "{instrument}"
sample_rate = 1000.0

[channels.head]
input = 0
sensitivity = 1.0

[channels.motor]
input = 1
sensitivity = 1.0

[loggers.climate]
kind = "lines"
port = "{logger}"
sample_rate = 10.0
start = ["go"]
stop = ["halt"]
fields = [{{what = "skip"}}, {{what = "skip"}}, {{unit = "mV"}}, {{unit = "degC"}}]

[loggers.climate.channels.bearing]
input = 1
unit = "degC"

[loggers.climate.channels.pressure]
input = 0
unit = "bar"
sensitivity = 4.0

[[runs]]
id = "a"
configuration = "unlocked"
gain = 1.0
excitation = "other"
seconds = {seconds}
"""


def planned(folder: Path, far: Far, logger: str, seconds: float = 2.0) -> Plan:
    text = PLAN.format(instrument=far.port, logger=logger, seconds=seconds)
    (folder / "plan.toml").write_text(text)
    return read_plan(folder / "plan.toml")


def temperatures() -> CsvFar:
    """Ten lines a second; the third word counts them, the fourth is three times the count."""
    return CsvFar(rate=10.0, speed=1.0)


def check_table(recording: Path, run: str = "a") -> None:
    with h5py.File(recording) as file:
        table = file[f"runs/{run}/logs/climate"]
        assert table.dtype.names == ("time", "bearing", "pressure")
        rows, about = table[:], dict(table.attrs)
        units = {key: about[key].decode() for key in about if key.startswith("unit_")}
    assert (units, about["sample_rate"]) == ({"unit_time": "s", "unit_bearing": "degC", "unit_pressure": "bar"}, 10.0)
    count = 4.0 * rows["pressure"]
    np.testing.assert_array_equal(rows["bearing"], 3.0 * count)
    np.testing.assert_array_equal(count, np.arange(len(count)))
    # Its own time axis, from the first sample of the run on: both start within half a second, on a busy host too.
    late = rows["time"] - 0.1 * count
    assert np.abs(late.min()) < 0.5


def test_a_logger_is_stored_with_its_own_rate_and_time(tmp_path: Path) -> None:
    watcher = Watcher()
    with FramedFar(frames=10**9, speed=1.0) as far, temperatures() as logger:
        acquire(planned(tmp_path, far, logger.port), far.port, tmp_path / "c.h5", watcher.operator)
        assert logger.told[-1] == "halt"
    assert watcher.runs[0].verdict.good
    assert not any("logger" in sentence for sentence in watcher.runs[0].verdict.advice)
    check_table(tmp_path / "c.h5")
    with h5py.File(tmp_path / "c.h5") as file:
        assert 15 <= len(file["runs/a/logs/climate"]) <= 30
    # For all other commands it is a recording as any other.
    assert set(read(tmp_path / "c.h5").runs[0].channels) == {"head", "motor", "gain"}
    assert main(["check", str(tmp_path / "c.h5")]) == 0


def test_a_second_part_of_the_session_keeps_the_first_ones_log(tmp_path: Path) -> None:
    with FramedFar(frames=10**9, speed=1.0) as far, temperatures() as logger:
        acquire(planned(tmp_path, far, logger.port), far.port, tmp_path / "c.h5", Watcher().operator)
    text = (tmp_path / "plan.toml").read_text()
    with FramedFar(frames=10**9, speed=1.0) as far, temperatures() as logger:
        plan = planned(tmp_path, far, logger.port)
        run = text[text.index("[[runs]]") :].replace('id = "a"', 'id = "b"')
        (tmp_path / "plan.toml").write_text((tmp_path / "plan.toml").read_text() + run)
        plan = read_plan(tmp_path / "plan.toml")
        acquire(plan, far.port, tmp_path / "c.h5", Watcher().operator, resume=True)
    check_table(tmp_path / "c.h5", "a")
    check_table(tmp_path / "c.h5", "b")


def test_the_log_of_a_killed_session_is_recovered(tmp_path: Path) -> None:
    with FramedFar(frames=10**9, speed=1.0) as far, temperatures() as logger:
        planned(tmp_path, far, logger.port, seconds=60.0)
        call = [sys.executable, "-P", "-m", "isorig", "acquire", "plan.toml", "--yes", "--force", "--json", "-o", "c.h5"]
        process = subprocess.Popen(call, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        wait_for(lambda: logger.running and logger.sent > 60)
        process.kill()
        process.communicate()
    assert main(["recover", str(tmp_path / "c.h5.partial"), "-o", str(tmp_path / "r.h5")]) == 0
    check_table(tmp_path / "r.h5")


class Dying(CsvFar):
    """Sends ten lines, then none that could be one."""

    def send(self) -> None:
        super().send()
        if self.sent > 10:
            self.say(b"hello\n" * 50)


class Dumb(CsvFar):
    """Accepts everything and sends nothing."""

    def send(self) -> None:
        self.sent += 1


@pytest.mark.parametrize(("logger", "says"), [
    (Dying(rate=10.0, speed=1.0), "The logger climate stored "), (Dumb(rate=10.0, speed=1.0), "The logger climate sent nothing"),
])  # fmt: skip
def test_a_logger_that_fails_is_reported_and_the_run_is_complete(logger: CsvFar, says: str, tmp_path: Path) -> None:
    watcher = Watcher()
    with FramedFar(frames=10**9, speed=1.0) as far, logger:
        acquire(planned(tmp_path, far, logger.port, seconds=3.0), far.port, tmp_path / "c.h5", watcher.operator)
    (run,) = read(tmp_path / "c.h5").runs
    assert len(run) >= 3000
    np.testing.assert_array_equal(run.channels["head"].samples, np.arange(len(run)))
    assert not run.gaps
    (sentence,) = [sentence for sentence in watcher.runs[0].verdict.advice if "logger" in sentence]
    assert sentence.startswith(says)
    assert "\n" not in sentence


def test_lost_frames_are_not_taken_for_damage_of_the_file(tmp_path: Path) -> None:
    def spoil(fields: dict) -> bytes:
        from far import frame

        return b"" if 600 <= fields["tick"] < 700 else frame(**fields)

    watcher = Watcher()
    with FramedFar(frames=10**9, speed=1.0, spoil=spoil) as far, temperatures() as logger:
        acquire(planned(tmp_path, far, logger.port), far.port, tmp_path / "c.h5", watcher.operator, force=True)
    assert watcher.runs[0].tally.lost == 100
    assert not any("damaged" in sentence for sentence in watcher.runs[0].verdict.advice)


def test_a_logger_that_is_not_there_is_refused_before_the_session(tmp_path: Path) -> None:
    with FramedFar(speed=1.0) as far, pytest.raises(DriverError, match="/dev/none"):
        acquire(planned(tmp_path, far, "/dev/none"), far.port, tmp_path / "c.h5", Watcher().operator)
    assert not (tmp_path / "c.h5.partial").exists()


@pytest.mark.parametrize(("old", "new", "says"), [
    ("sample_rate = 10.0", "sample_rate = 1001.0", "a logger has up to 1000 Hz"),
    ("sample_rate = 10.0", "sample_rate = 0.0", "a logger has up to 1000 Hz"),
    ('port = "L"', 'port = "P"', "which is another instrument's"), ("channels.bearing", "channels.time", "cannot be a name here"),
    ("input = 1\nunit", "input = -1\nunit", "inputs start at 0"), ("sensitivity = 4.0", "sensitivity = 0.0", "other than 0"),
    ('kind = "lines"', 'kind = "tape"', "loggers.climate.kind is 'tape'"),
    ('kind = "lines"', 'kind = "sr785"', "loggers.climate of kind sr785"),
    ("fields = [", "fields = [{what = \"count\"}, {what = \"count\"}, ", "of kind lines: fields has 2 fields of count"),
])  # fmt: skip
def test_a_logger_that_cannot_be_is_refused(old: str, new: str, says: str, tmp_path: Path) -> None:
    text = PLAN.format(instrument="P", logger="L", seconds=2.0)
    assert text.count(old) == 1
    (tmp_path / "plan.toml").write_text(text)
    whole = read_plan(tmp_path / "plan.toml")
    # A plan that is written says the same.
    (tmp_path / "again.toml").write_text(plan_text(whole, {}))
    assert read_plan(tmp_path / "again.toml") == whole
    (tmp_path / "plan.toml").write_text(text.replace(old, new))
    with pytest.raises(PlanError, match=says):
        read_plan(tmp_path / "plan.toml")


def test_a_logger_has_to_have_the_inputs_of_the_plan(tmp_path: Path) -> None:
    with FramedFar(speed=1.0) as far, temperatures() as logger:
        planned(tmp_path, far, logger.port)
        text = (tmp_path / "plan.toml").read_text().replace("input = 1\nunit", "input = 5\nunit")
        (tmp_path / "plan.toml").write_text(text)
        with pytest.raises((PlanError, DriverError), match="there is no input 5"):
            acquire(read_plan(tmp_path / "plan.toml"), far.port, tmp_path / "c.h5", Watcher().operator)
