"""Sessions under attack, as processes of their own: what ends them stops the drive, nothing that is shown holds up the wire."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import h5py
import msgspec
import numpy as np
import pytest
from plans import plan_text

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "drivers"))

from far import DataqFar, FramedFar, frame, scan_bytes, within
from ramps import Watcher, acquire, plan_of
from rich.console import Console

from isorig.drivers.errors import ConnectionLostError, InstrumentError
from isorig.drivers.waits import Waits
from isorig.rig.acquire.drive import FADE, PART, drive_of
from isorig.rig.acquire.live import LiveState
from isorig.rig.acquire.plan import Plan
from isorig.rig.acquire.policy import SESSION_WAITS, SessionWaits
from isorig.rig.acquire.terminal import levels
from isorig.rig.files.recording import read
from isorig.rig.virtual.levels import HEAD_PER_GAIN

#: Seconds until a session that would never come to it has failed: a busy computer starts a process in ten.
PATIENCE = 100.0


def plan(seconds: float, **run: object) -> Plan:
    """Two inputs at 1 kHz."""
    made = plan_of({"id": "a", "seconds": seconds, "gain": 1.0, **run}, rate=1000.0)
    return Plan(
        instrument=made.instrument, channels={k: made.channels[k] for k in ("head", "motor")}, runs=made.runs, rig=made.rig
    )


def session(folder: Path, port: str, *options: str, seconds: float = 60.0, **more: object) -> subprocess.Popen[bytes]:
    """`rig acquire`, begun."""
    (folder / "plan.toml").write_text(
        plan_text({"id": "a", "gain": 1.0, "seconds": seconds}, channels={"motor": 0, "table": 1}, rate=1000.0)
    )
    call = [sys.executable, "-m", "isorig", "acquire", str(folder / "plan.toml"), "--port", port, "-o", str(folder / "c.h5")]
    # A test run under nohup hands its children a SIGHUP that is ignored.
    more.setdefault("preexec_fn", lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL))
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **more}
    return subprocess.Popen([*call, "--force", "--yes", *options], **pipes)  # type: ignore[call-overload,no-any-return]


def wait_for(condition: Callable[[], bool], seconds: float = PATIENCE) -> None:
    """Until it holds."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


@contextmanager
def killed(process: subprocess.Popen[bytes]) -> Iterator[subprocess.Popen[bytes]]:
    """However the test ends, the process has ended behind it."""
    with process:
        try:
            yield process
        finally:
            process.kill()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_signal_stops_the_drive_and_keeps_the_run(tmp_path: Path, number: signal.Signals) -> None:
    with FramedFar(frames=10**9, speed=1.0) as far, killed(session(tmp_path, far.port)) as process:
        wait_for(lambda: far.sent > 10)
        process.send_signal(number)
        process.send_signal(number)
        _, said = process.communicate(timeout=PATIENCE)
        assert process.returncode == (130 if number == signal.SIGINT else 128 + number)
        assert far.running is False
        assert far.stopped == 1
    assert b"Traceback" not in said
    assert f"the measured data are in {tmp_path / 'c.h5'}".encode() in said
    run = read(tmp_path / "c.h5").runs[0]
    np.testing.assert_array_equal(run.channels["motor"].samples, np.arange(len(run)))


def test_output_that_is_not_read_does_not_delay_the_session(tmp_path: Path) -> None:
    own, other = os.pipe()
    os.set_blocking(other, False)
    # A pipe that is full before the first line.
    while True:
        try:
            os.write(other, bytes(4096))
        except BlockingIOError:
            break
    os.set_blocking(other, True)
    far = FramedFar(frames=60, speed=2.0)
    with far, killed(session(tmp_path, far.port, "--json", seconds=3.0, stdout=other)) as process:
        assert process.wait(PATIENCE) == 0
    os.close(own)
    os.close(other)
    run = read(tmp_path / "c.h5").runs[0]
    assert (len(run), run.gaps) == (3000, ())


def test_a_suspended_terminal_does_not_delay_the_session(tmp_path: Path) -> None:
    own, other = os.openpty()
    # Ctrl-S: what the session writes fills the terminal's buffer, which nobody empties.
    with FramedFar(frames=100, speed=4.0) as far, killed(session(tmp_path, far.port, seconds=5.0, stderr=other)):
        wait_for((tmp_path / "c.h5").exists)
    os.close(own)
    os.close(other)
    run = read(tmp_path / "c.h5").runs[0]
    assert (len(run), run.gaps) == (5000, ())


def test_a_reader_that_exits_does_not_end_the_session(tmp_path: Path) -> None:
    with FramedFar(frames=60, speed=2.0) as far, killed(session(tmp_path, far.port, "--json", seconds=3.0)) as process:
        assert process.stdout is not None
        assert json.loads(process.stdout.readline())["event"] == "live"
        process.stdout.close()
        assert process.stderr is not None
        said = process.stderr.read()
        assert process.wait(PATIENCE) == 0
    assert b"Traceback" not in said
    assert b"Exception" not in said
    assert len(read(tmp_path / "c.h5").runs[0]) == 3000


def test_one_session_at_a_time_on_an_output_and_on_a_port(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    link = tmp_path / "tty"
    with FramedFar(frames=10**9, speed=1.0) as far, killed(session(tmp_path, far.port)) as first:
        link.symlink_to(far.port)
        wait_for(lambda: far.sent > 4)
        sent = far.heard
        for folder, port, options, says in (
            (
                tmp_path,
                "/dev/elsewhere",
                ["--resume"],
                f"{tmp_path / 'c.h5'} is being measured by another session (process {first.pid})",
            ),
            (tmp_path / "other", str(link), [], f"the port {link} is in use by another session (process {first.pid})"),
        ):
            with killed(session(folder, port, *options)) as second:
                _, said = second.communicate(timeout=PATIENCE)
                assert second.returncode == 2
            assert says in said.decode()
        assert far.heard == sent
        first.kill()
        first.wait()
        # The locks died with their process.
        with killed(session(tmp_path / "other", far.port, seconds=1.0)) as third:
            far.frames = far.sent + 10**6
            assert third.wait(PATIENCE) == 0
    assert not list((tmp_path / "other").glob(".*lock"))


class Silent(FramedFar):
    """Keeps what is due for a while, and then sends all of it."""

    def __init__(self, *, at: int, seconds: float, **more: object) -> None:
        super().__init__(**more)  # type: ignore[arg-type]
        self.at, self.seconds, self.until = at, seconds, 0.0

    def work(self) -> None:
        if self.sent == self.at and not self.until:
            self.until = time.monotonic() + self.seconds
        if time.monotonic() >= self.until:
            super().work()


def test_an_instrument_that_is_silent_for_a_while_goes_on(tmp_path: Path) -> None:
    class Counting(Silent):
        def obey(self, word: str, words: list[str]) -> None:
            # It counts what it takes, sent or not.
            kept, self.sent = self.sent, round((time.monotonic() - self._began) * self.speed * self.rate / self.rows)
            super().obey(word, words) if word == "COUNT" else None
            self.sent = kept
            if word != "COUNT":
                super().obey(word, words)

    with Counting(at=20, seconds=2.2, frames=100, speed=1.5) as far:
        acquire(plan(4.0), far.port, tmp_path / "c.h5", Watcher().operator, force=True, waits=SessionWaits(silence=0.5))
    run = read(tmp_path / "c.h5").runs[0]
    np.testing.assert_array_equal(run.channels["head"].samples[:4000], np.arange(4000))


def test_a_run_continues_after_a_reconnection_and_the_gap_is_counted(tmp_path: Path) -> None:
    link = tmp_path / "ttyUSB0"
    watcher = Watcher()
    with FramedFar(frames=100, speed=2.0) as first, FramedFar(frames=10**6, speed=2.0) as second:
        link.symlink_to(first.port)

        def pull() -> None:
            # The same instrument at another port, under the same name: it has gone on measuring meanwhile.
            wait_for(lambda: first.sent >= 30)
            link.unlink()
            first.unplug()
            second._began, second.sent, second.running = first._began, 60, True
            wait_for(lambda: time.monotonic() - first._began > 60 * 50 / 2000.0)
            link.symlink_to(second.port)

        thread = threading.Thread(target=pull)
        thread.start()
        acquire(plan(5.0), str(link), tmp_path / "c.h5", watcher.operator, force=True, waits=SESSION_WAITS)
        thread.join()
    run = read(tmp_path / "c.h5").runs[0]
    (gap,) = run.gaps
    ticks = np.arange(len(run)) + np.where(np.arange(len(run)) >= gap.first_tick, gap.count, 0)
    np.testing.assert_array_equal(run.channels["head"].samples, ticks)
    assert gap.first_tick + gap.count >= 3000
    assert any("was lost and restored" in sentence for sentence in watcher.runs[0].verdict.advice)


def test_messages_of_instrument_and_driver_are_reported(tmp_path: Path) -> None:
    def spoil(fields: dict) -> bytes:
        status = {10: 2, 11: 4}.get(fields["sequence"], 0)
        return frame(**(fields | {"status": status, "tick": fields["tick"] - 500 * (fields["tick"] >= 1000)}))

    watcher = Watcher()
    with FramedFar(frames=40, spoil=spoil, speed=4.0) as far:
        acquire(plan(2.0), far.port, tmp_path / "c.h5", watcher.operator, force=True)
    verdict = watcher.runs[0].verdict
    assert not verdict.good
    told = " ".join(verdict.advice)
    assert "The instrument lost samples internally in 1 blocks from 0.5 s on" in told
    assert "The instrument reported a fault in 1 blocks from 0.55 s on" in told
    assert "disagree 1 times from 1 s on" in told
    run = read(tmp_path / "c.h5").runs[0]
    assert run.gaps == ()
    np.testing.assert_array_equal(run.channels["head"].samples, np.arange(len(run)))


def test_an_instrument_that_does_not_stop_is_refused(tmp_path: Path) -> None:
    class Endless(FramedFar):
        def obey(self, word: str, words: list[str]) -> None:
            super().obey(word, words)
            self.running = self.running or (word == "STOP" and self.sent > 0)

    with Endless(frames=10**9, speed=4.0) as far, within(15.0), pytest.raises(InstrumentError, match="keeps sending"):
        acquire(plan(1.0), far.port, tmp_path / "c.h5", Watcher().operator, force=True, waits=SessionWaits(transit=0.05))
    assert len(read(tmp_path / "c.h5").runs[0]) >= 1000


def test_an_instrument_that_was_restarted_ends_the_run_and_its_drive(tmp_path: Path) -> None:
    def spoil(fields: dict) -> bytes:
        k = fields["sequence"]
        back = {"tick": fields["tick"] - 1000, "sequence": k - 20, "clock": fields["clock"] - 10**6} if k >= 20 else {}
        return frame(**(fields | back))

    with FramedFar(frames=100, spoil=spoil, speed=4.0) as far:
        with pytest.raises(InstrumentError, match="restarted or is defective"):
            acquire(plan(4.0), far.port, tmp_path / "c.h5", Watcher().operator, force=True)
        wait_for(lambda: not far.running)
    run = read(tmp_path / "c.h5").runs[0]
    np.testing.assert_array_equal(run.channels["head"].samples, np.arange(1000))


def test_no_drive_is_sent_for_a_run_without_a_drive(tmp_path: Path) -> None:
    waits = SessionWaits(drivers=Waits(start=0.3))
    far = FramedFar(answer=lambda word: b"" if word == "START" else None)
    with far, pytest.raises(ConnectionLostError):
        acquire(plan(3600.0, excitation="other"), far.port, tmp_path / "c.h5", Watcher().operator, force=True, waits=waits)
    assert b"DRIVE 1\n" + bytes(4) in far.heard


def test_a_long_drive_is_made_part_by_part() -> None:
    run = plan_of({"id": "a", "excitation": "random", "band": [0.5, 200.0], "seconds": 3 * PART / 1024.0 + 3.0}).runs[0]
    drive = drive_of(run, 0, 1024.0)
    assert len(drive) == 3 * PART + 3072
    at = [0, 1000, PART - 10, PART + FADE + 10, 2 * PART + 77, len(drive)]
    parts = np.concatenate([drive[begin:end] for begin, end in pairwise(at)])
    np.testing.assert_array_equal(parts, drive[:])
    assert parts.std() == pytest.approx(HEAD_PER_GAIN, rel=0.01)
    # Where one part fades into the next the drive is as strong, and stays in its band.
    seam = parts[PART : PART + FADE]
    assert seam.std() == pytest.approx(HEAD_PER_GAIN, rel=0.05)
    spectrum = np.abs(np.fft.rfft(parts[PART - FADE : PART + 2 * FADE] * np.hanning(3 * FADE))) ** 2
    frequency = np.fft.rfftfreq(3 * FADE, 1.0 / 1024.0)
    assert spectrum[frequency > 205.0].sum() < 1e-6 * spectrum.sum()


@pytest.mark.parametrize("excitation", ["moves", "multisine"])
def test_any_part_of_a_drive_is_that_part_of_the_whole(excitation: str) -> None:
    run = plan_of({"id": "a", "excitation": excitation, "band": [1.0, 50.0], "seconds": 12.0}).runs[0]
    drive = drive_of(run, 0, 1024.0)
    parts = np.concatenate([drive[begin:end] for begin, end in pairwise([0, 5, 3000, 4096, 9999, len(drive)])])
    np.testing.assert_allclose(parts, drive[:], atol=1e-9)
    assert len(parts) == run.ticks(1024.0)


def test_the_terminal_shows_progress_and_levels_in_eighty_columns() -> None:
    names = ("head", "motor", "table", "heatblock")
    live = LiveState(
        run="unlocked-70-2", seconds=12.0, of=120.0, rms=dict.fromkeys(names, 1.23456e-3), peak=dict.fromkeys(names, 3.2e-5),
        full_scale=dict.fromkeys(names, 50.0), coherence=dict.fromkeys(names, 0.987), overloads=0, lost=1234567, damaged=0,
        highest={"head": 45.0, "motor": 1.2, "table": 12.0, "heatblock": 50.0}, number=2, runs=6, left=4000.0,
    )  # fmt: skip
    console = Console(width=80, file=io.StringIO())
    console.print(levels(live))
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert max(map(len, lines)) <= 80
    assert not any("…" in line for line in lines)
    assert lines[0].startswith("unlocked-70-2 (run 2 of 6): 108 s left; all runs 66 min, to about ") or "1 min left" in lines[0]
    text = "\n".join(line.rstrip() for line in lines)
    assert "head reaches 90 % of its range: choose a larger range or a lower gain." in text
    assert "motor uses 2 % of its range: choose a smaller range or a higher gain." in text
    assert "table uses" not in text


def test_a_recording_states_how_reliable_its_time_axis_is(tmp_path: Path) -> None:
    far = FramedFar(frames=40, spoil=lambda f: frame(**(f | {"tick": f["tick"] + 77 * (f["tick"] >= 1000)})), speed=4.0)
    with far:
        acquire(plan(2.0), far.port, tmp_path / "framed.h5", Watcher().operator, force=True)
    with h5py.File(tmp_path / "framed.h5") as file:
        about = dict(file["runs/a"].attrs)
    assert (about["time_axis"], about["time_axis_unseen"], about["time_axis_doubts"]) == (b"instrument", 0.0, 1)

    scans = plan_of(
        {"id": "a", "seconds": 1.0, "excitation": "other"}, rate=2000.0, instrument={"kind": "di1100", "full_scale": 10.0}
    )
    scans = msgspec.structs.replace(scans, channels={name: scans.channels[name] for name in ("head", "motor")})
    watcher = Watcher()
    with DataqFar(stream=lambda first, last: scan_bytes(first, last)[: -1 if first <= 1000 < last else None]) as wire:
        acquire(scans, wire.port, tmp_path / "scans.h5", watcher.operator, force=True)
    with h5py.File(tmp_path / "scans.h5") as file:
        about = dict(file["runs/a"].attrs)
    assert (about["time_axis"], about["time_axis_doubts"]) == (b"host", 1)
    assert 0.01 <= about["time_axis_unseen"] < 0.3
    assert any("Bytes were lost 1 times" in sentence for sentence in watcher.runs[0].verdict.advice)


def test_a_counter_at_the_digital_inputs_makes_the_time_axis_the_instruments(tmp_path: Path) -> None:
    own = {"kind": "di1100", "full_scale": 10.0, "counter": 50.0}
    scans = plan_of({"id": "a", "seconds": 1.0, "excitation": "other"}, rate=2000.0, instrument=own)
    scans = msgspec.structs.replace(scans, channels={name: scans.channels[name] for name in ("head", "motor")})

    def stream(first: int, last: int) -> bytes:
        words = np.frombuffer(scan_bytes(first, last, digital=0), "<u2").reshape(-1, 2).copy()
        words[:, 0] |= (np.arange(first, last) // 40 % 4).astype(np.uint16)
        return words.tobytes()

    with DataqFar(stream=stream) as wire:
        acquire(scans, wire.port, tmp_path / "scans.h5", Watcher().operator, force=True)
    with h5py.File(tmp_path / "scans.h5") as file:
        about = dict(file["runs/a"].attrs)
    assert (about["time_axis"], about["time_axis_unseen"], about["time_axis_doubts"]) == (b"instrument", 0.0, 0)


def test_a_slow_clock_is_reported_and_not_taken_for_a_loss(tmp_path: Path) -> None:
    scans = plan_of(
        {"id": "a", "seconds": 3.0, "excitation": "other"}, rate=2000.0, instrument={"kind": "di1100", "full_scale": 10.0}
    )
    scans = msgspec.structs.replace(scans, channels={name: scans.channels[name] for name in ("head", "motor")})
    watcher = Watcher()
    with DataqFar(clock=0.97) as wire:
        acquire(scans, wire.port, tmp_path / "c.h5", watcher.operator, force=True)
    assert watcher.runs[0].tally.lost == 0
    (told,) = (sentence for sentence in watcher.runs[0].verdict.advice if "deviates from the host's" in sentence)
    assert told.startswith("Its clock deviates from the host's by -3")
