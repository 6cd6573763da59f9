"""Sound interfaces on a real audio stack: what is played comes back bit for bit, and what goes wrong is counted."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from itertools import pairwise
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
import sound_device
from campaign import read
from contract import Case, Served, Situation
from far import within
from sound_server import RATE, Server, loop

from isorig.drivers import sound
from isorig.drivers.block import Block, Status
from isorig.drivers.errors import ConnectionLostError, SettingError
from isorig.drivers.sound import FULL, SoundInstrument, SoundSettings
from isorig.drivers.waits import Waits

PLAYING = SoundSettings(full_scale=2.0, output=1, output_full_scale=4.0, drive_volts=0.01, limit=1.0, ramp=0.05)


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with loop() as one:
        yield one


def run(instrument: SoundInstrument, samples: int) -> list[Block]:
    """All blocks of a run."""
    instrument.start()
    blocks = read(instrument, samples, 5.0)
    instrument.stop()
    return blocks + read(instrument, 10**9, 0.1)


def test_the_drive_comes_back_bit_for_bit(server: Server) -> None:
    drive = np.concatenate([np.zeros(RATE // 2), np.random.default_rng(1).normal(0.0, 10.0, RATE // 2)])
    with closing(SoundInstrument("loop", PLAYING)) as instrument:
        assert instrument.prepare(sample_rate=RATE, channels=[0, 1]) == RATE
        instrument.set_gain(2.0)
        assert instrument.load_drive(drive) is True
        assert instrument.set_configuration("locked") is False
        blocks = run(instrument, RATE)
        sent = np.rint(instrument._drive[0 : len(drive)] / 4.0 * FULL).astype(np.int64)  # type: ignore[index]
        assert instrument.noticed == ()
    came = np.concatenate([block.samples for block in blocks]).astype(np.int64)
    assert all(a.end_tick == b.first_tick for a, b in pairwise(blocks))
    # The path delays; find the place by the largest sample, then every bit agrees.
    peak = int(np.argmax(np.abs(sent)))
    (place,) = np.flatnonzero(came[:, 1] == sent[peak])
    part = came[place - peak : place - peak + len(sent), 1]
    np.testing.assert_array_equal(part, sent[: len(part)])
    assert len(part) == len(sent)
    assert not came[:, 0].any()


def test_the_rate_agrees_with_the_hosts_clock(server: Server) -> None:
    with closing(SoundInstrument("loop", PLAYING)) as instrument:
        instrument.prepare(sample_rate=RATE, channels=[0])
        instrument.load_drive(np.zeros(1))
        blocks = run(instrument, RATE)
    first, last = blocks[0], blocks[-1]
    rate = (last.end_tick - first.end_tick) / (last.host_time - first.host_time)
    assert rate == pytest.approx(RATE, rel=0.1)


def test_the_drive_fades_out_when_it_is_stopped(server: Server) -> None:
    with closing(SoundInstrument("loop", PLAYING)) as instrument:
        instrument.prepare(sample_rate=RATE, channels=[0])
        instrument.load_drive(np.full(20 * RATE, 50.0))
        blocks = run(instrument, RATE)
    values = np.concatenate([block.samples for block in blocks])[:, 1] * 4.0 / FULL
    assert values.max() == pytest.approx(0.5)
    assert np.abs(np.diff(values)).max() < 0.002


def test_lost_samples_are_counted(server: Server) -> None:
    own = SoundSettings(full_scale=1.0)
    with closing(SoundInstrument("loop", own)) as instrument:
        instrument.prepare(sample_rate=RATE, channels=[0])
        instrument.start()
        blocks = read(instrument, RATE, 5.0)
        # A loss of half a second, as if the interface's samples had not been fetched.
        instrument._stream.stop()
        time.sleep(0.5)
        instrument._finished.clear()
        instrument._stream.start()
        blocks += read(instrument, 4 * RATE, 5.0)
        instrument.stop()
        blocks += read(instrument, 10**9, 0.1)
    gaps = [b.first_tick - a.end_tick for a, b in pairwise(blocks) if b.first_tick != a.end_tick]
    assert sum(gaps) / RATE == pytest.approx(0.5, abs=0.3)
    assert any(block.status & Status.CLOCKED for block in blocks)


def test_what_portaudio_reports_is_handed_on() -> None:
    instrument = SoundInstrument.__new__(SoundInstrument)
    instrument._rate, instrument._drive, instrument._settings = 1000.0, None, PLAYING
    instrument._clear()
    instrument._begun = True
    block = np.ones((10, 2), np.int32)
    fine = SimpleNamespace(input_overflow=False, output_underflow=False)
    instrument._heard(block, 10, None, fine)
    instrument._heard(block, 10, None, SimpleNamespace(input_overflow=True, output_underflow=True))
    instrument._sort()
    instrument._arrivals.finish()
    assert [bool(one.status & Status.LOST) for one in instrument._ready] == [False, True]
    assert instrument.noticed == ("PortAudio lost samples of the inputs 1 times", "the drive was interrupted 1 times")


def test_an_interface_that_goes_is_reported() -> None:
    with loop() as server, closing(SoundInstrument("loop", PLAYING, Waits(sound=0.5))) as instrument:
        instrument.prepare(sample_rate=RATE, channels=[0])
        instrument.load_drive(np.full(20 * RATE, 10.0))
        instrument.start()
        os.kill(server.process.pid, signal.SIGSTOP)
        try:
            with within(8.0), pytest.raises(ConnectionLostError, match="sends no samples any more"):
                read(instrument, 10**9, 20.0)
        finally:
            os.kill(server.process.pid, signal.SIGCONT)


def test_what_is_missing_is_named(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SettingError, match="there is no sound interface 'nowhere'"):
        SoundInstrument("nowhere", PLAYING)
    with closing(SoundInstrument("loop", PLAYING)) as instrument:
        with pytest.raises(SettingError, match="there is no input 2"):
            instrument.prepare(sample_rate=RATE, channels=[2])
        with pytest.raises(SettingError, match="refuses -5 Hz"):
            instrument.prepare(sample_rate=-5.0, channels=[0])
        instrument.prepare(sample_rate=RATE, channels=[0])
        with pytest.raises(SettingError, match="the drive reaches 1"):
            instrument.load_drive(np.full(10, 101.0))
    assert ("loop", "ALSA, 32 inputs, 32 outputs") in [(one.port, one.name) for one in sound.devices()]
    monkeypatch.setitem(sys.modules, "sounddevice", None)
    with pytest.raises(SettingError, match=r"pip install 'isorig\[sound\]'"):
        sound.devices()


@pytest.mark.parametrize(("changed", "says"), [
    ({"full_scale": None}, "is full_scale, or level_volts with level_reads"),
    ({"level_volts": 1.0, "level_reads": 0.5}, "give one of the two"),
    ({"full_scale": None, "level_volts": 1.0, "level_reads": 0.0}, "give values above 0"), ({"channels": 0}, "channels is 0"),
    ({"output": -1, "drive_volts": 1.0}, "numbered from 0"), ({"output": 0}, "drive_volts is 0"),
    ({"output": 0, "drive_volts": 1.0, "limit": 2.0}, "the output has 1 V at most"),
])  # fmt: skip
def test_settings_that_cannot_be_are_refused(changed: dict[str, object], says: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=says):
        msgspec.convert({"full_scale": 1.0, **changed}, SoundSettings)


def test_a_known_level_gives_the_full_scale() -> None:
    # 1 V rms that reads 0.25 of full scale, rms.
    assert SoundSettings(level_volts=1.0, level_reads=0.25).volts == 4.0


def test_a_drive_that_is_not_ready_is_silence() -> None:
    instrument = SoundInstrument.__new__(SoundInstrument)
    instrument._rate, instrument._drive, instrument._settings = 1000.0, None, PLAYING
    instrument._clear()
    instrument._begun = True
    instrument._parts.extend([np.full(5, 1.0), np.full(5, 2.0)])
    np.testing.assert_array_equal(instrument._next(7), [1.0] * 5 + [2.0] * 2)
    np.testing.assert_array_equal(instrument._next(6), [2.0] * 3 + [0.0] * 3)


@contextmanager
def serve_sound(situation: Situation) -> Iterator[Served]:
    # The driver begins to count half a second after the start, when samples come regularly.
    late = 4000
    device = sound_device.Device(
        clock=situation.clock, silent=situation.silent,
        lost=None if situation.lose is None else (situation.lose[0] + late, situation.lose[1]),
        mute_after=None if situation.mute_after is None else situation.mute_after + 3 * late,
    )  # fmt: skip
    with sound_device.card(device):
        yield Served("card", lambda: device.level != 0, device.gone.set)


CASES = (Case(kind="sound", serve=serve_sound, rate=8000.0, speed=1.0, lose=(8000, 4000), within=1600, reports=False),)
