"""NI devices: the vendor's own classes on an interpreter with a chassis that runs in real time."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest
from campaign import read
from contract import Case, Served, Situation
from far import within
from ni_device import Device, chassis
from nidaqmx.errors import DaqError

from isorig.drivers import ni
from isorig.drivers.block import Block, Status
from isorig.drivers.errors import ConnectionLostError, InstrumentError, SettingError
from isorig.drivers.ni import NiInstrument, NiSettings
from isorig.rig.cli import main
from isorig.rig.files.recording import read as read_recording

INPUTS = ("cDAQ1Mod1/ai0", "cDAQ1Mod1/ai1", "cDAQ1Mod2/ai0")
PLAYING = NiSettings(inputs=INPUTS, output="cDAQ1Mod3/ao0", drive_volts=0.01, limit=1.0, iepe=2.0, coupling="AC")


def places(blocks: list[Block]) -> tuple[np.ndarray, np.ndarray]:
    samples = np.concatenate([block.samples for block in blocks])
    np.testing.assert_array_equal(samples[:, 1:], 3 * samples[:, :1] + [1, 2])
    return np.concatenate([np.arange(block.first_tick, block.end_tick) for block in blocks]), samples[:, 0]


def test_inputs_of_several_modules_run_on_one_clock_with_iepe() -> None:
    with chassis() as device, closing(NiInstrument("cDAQ1", PLAYING)) as instrument:
        assert instrument.prepare(sample_rate=2048.0, channels=[0, 2]) == 2048.0
        instrument.start()
        blocks = read(instrument, 4000)
        counted = instrument.stop()
        blocks += read(instrument, 10**9, 0.05)
    given, own = places(blocks)
    np.testing.assert_array_equal(given, np.arange(counted))
    np.testing.assert_array_equal(own, given)
    assert all(block.status == Status.NUMBERED for block in blocks)
    assert instrument.identity == "NI cDAQ-9178 cDAQ1"
    inputs, *_ = device.tasks.values()
    assert inputs["inputs"] == list(INPUTS)
    # Excitation source internal, a current, 2 mA; coupling AC.
    for name in INPUTS:
        assert [inputs["attributes"][name, number] for number in (0x17F4, 0x17F6, 0x17F5, 0x64)] == [10200, 10134, 2e-3, 10045]
    assert device.names().count("cfg_samp_clk_timing") == 1
    assert all(task.get("cleared") for task in device.tasks.values())


def test_the_drive_is_played_on_the_inputs_clock_and_fades_in_and_out() -> None:
    drive = np.concatenate([np.zeros(500), np.full(3000, 2.0)])
    with chassis() as device, closing(NiInstrument("cDAQ1", PLAYING)) as instrument:
        rate = instrument.prepare(sample_rate=2048.0, channels=[0])
        instrument.set_gain(20.0)
        assert instrument.load_drive(drive) is True
        assert instrument.set_configuration("locked") is False
        instrument.start()
        read(instrument, 6000)
        instrument.stop()
    played = np.array(device.played)
    ramp = round(0.1 * rate)
    assert not played[:500].any()
    np.testing.assert_allclose(played[500 + ramp : 3500 - ramp], 0.01 * 20.0 * 2.0)
    assert not played[3500:].any()
    assert np.abs(np.diff(played)).max() < 1.6 * 0.4 / ramp
    output = next(task for task in device.tasks.values() if task["outputs"])
    assert output["source"] == "/cDAQ1/ai/SampleClock"
    names = [name for name, _ in device.calls if name == "start_task"]
    assert names == ["start_task"] * len(names)
    started = [given[0] for name, given in device.calls if name == "start_task"]
    # The output waits for the clock of the inputs.
    assert [bool(device.tasks[handle]["outputs"]) for handle in started[:2]] == [True, False]


@pytest.mark.parametrize("end", ["stop", "close", "gone"])
def test_the_output_is_at_zero_after_every_end(end: str) -> None:
    device = Device(gone_after=3000 if end == "gone" else None)
    with chassis(device), closing(NiInstrument("cDAQ1", PLAYING)) as instrument:
        instrument.prepare(sample_rate=2048.0, channels=[0])
        instrument.set_gain(1.0)
        instrument.load_drive(np.full(100_000, 50.0))
        instrument.start()
        if end == "gone":
            with pytest.raises(ConnectionLostError, match="is gone"):
                read(instrument, 10**6)
        else:
            read(instrument, 1000)
            assert device.level == pytest.approx(0.5)
            if end == "stop":
                instrument.stop()
                assert device.level == 0.0
    assert device.level == 0.0
    # It does not jump: the voltages of a stop fall from the last one.
    steps = [given[3] for name, given in device.calls if name == "write_analog_scalar_f64"]
    if end != "gone":
        assert steps[0] == pytest.approx(0.5)
        assert np.abs(np.diff(steps)).max() < 0.05


def test_an_output_that_cannot_be_set_to_zero_is_reported() -> None:
    def fault(name: str) -> None:
        if name == "write_analog_scalar_f64":
            raise DaqError("Write failed.", -200290)

    with chassis(Device(fault=fault)), closing(NiInstrument("cDAQ1", PLAYING)) as instrument:
        instrument.prepare(sample_rate=2048.0, channels=[0])
        instrument.load_drive(np.full(100_000, 50.0))
        instrument.start()
        read(instrument, 1000)
        instrument.stop()
        assert any("could not be set to zero, so switch the amplifier off" in clause for clause in instrument.noticed)


def test_a_drive_above_the_limit_is_refused() -> None:
    with chassis(), closing(NiInstrument("cDAQ1", PLAYING)) as instrument:
        instrument.prepare(sample_rate=2048.0, channels=[0])
        instrument.set_gain(10.0)
        assert instrument.load_drive(np.full(100, 10.0)) is True
        with pytest.raises(SettingError, match=r"the drive reaches 1\.01 V .* limited to 1 V"):
            instrument.load_drive(np.full(100, 10.1))
        with pytest.raises(SettingError, match="not finite"):
            instrument.load_drive(np.array([np.nan]))


def test_without_an_output_there_is_no_drive() -> None:
    with chassis(), closing(NiInstrument("cDAQ1", NiSettings(inputs=INPUTS))) as instrument:
        instrument.prepare(sample_rate=2048.0, channels=[0])
        assert instrument.load_drive(np.ones(10)) is False


def test_samples_that_the_host_did_not_fetch_are_a_counted_gap() -> None:
    device = Device(buffer=2000)
    with chassis(device), closing(NiInstrument("cDAQ1", NiSettings(inputs=INPUTS))) as instrument:
        instrument.prepare(sample_rate=2048.0, channels=[0])
        instrument.start()
        blocks = read(instrument, 500)
        time.sleep(0.25)
        blocks += read(instrument, 9000)
        counted = instrument.stop()
        blocks += read(instrument, 10**9, 0.05)
        (clause,) = instrument.noticed
    given, own = places(blocks)
    np.testing.assert_array_equal(given, own)
    ((place, lost),) = [(a.end_tick, b.first_tick - a.end_tick) for a, b in pairwise(blocks) if a.end_tick != b.first_tick]
    assert lost > 2000
    assert len(own) + lost == counted
    assert clause == f"at tick {place} the host was late, and the device overwrote {lost} samples"


def test_overloads_and_open_sensors_are_reported() -> None:
    device = Device(overload_from=1000, open_from=3000)
    with chassis(device), closing(NiInstrument("cDAQ1", NiSettings(inputs=INPUTS))) as instrument:
        instrument.prepare(sample_rate=2048.0, channels=[0])
        instrument.start()
        blocks = read(instrument, 5000)
        instrument.stop()
    assert not blocks[0].status & Status.OVERLOAD
    assert blocks[-1].status & (Status.OVERLOAD | Status.FAULT) == Status.OVERLOAD | Status.FAULT
    assert "no sensor is connected to cDAQ1Mod1/ai1, or its cable is broken" in instrument.noticed


def test_a_device_that_reports_nothing_is_measured_all_the_same() -> None:
    with chassis(Device(unsupported=True)) as device, closing(NiInstrument("cDAQ1", PLAYING)) as instrument:
        instrument.prepare(sample_rate=2048.0, channels=[0])
        instrument.load_drive(np.ones(10))
        instrument.start()
        assert len(read(instrument, 1000)) > 0
        instrument.stop()
    assert device.names().count("get_read_attribute_bool") == 2


def test_a_rate_that_the_device_coerces_is_returned() -> None:
    with chassis(Device(coerced=51200.0 / 25)), closing(NiInstrument("cDAQ1", NiSettings(inputs=INPUTS))) as instrument:
        assert instrument.prepare(sample_rate=2000.0, channels=[0]) == 2048.0


def test_a_trigger_is_set() -> None:
    with chassis() as device, closing(NiInstrument("cDAQ1", NiSettings(inputs=INPUTS, trigger="/cDAQ1/PFI0"))) as instrument:
        instrument.prepare(sample_rate=2048.0, channels=[0])
        assert next(iter(device.tasks.values()))["trigger"] == "/cDAQ1/PFI0"


TURNING = NiSettings(inputs=INPUTS, tachometer="cDAQ1/_ctr0", tachometer_terminal="/cDAQ1/PFI1")


@pytest.mark.parametrize("pulses", [
    lambda ticks: ticks // 5,
    # The 32 bits of the counter return to zero every 2^8 ticks.
    lambda ticks: ticks << 24,
    lambda ticks: 0 * ticks,
])  # fmt: skip
def test_a_tachometer_is_counted_at_each_sample_of_the_inputs(pulses: Callable[[np.ndarray], np.ndarray]) -> None:
    with chassis(Device(pulses=pulses)) as device, closing(NiInstrument("cDAQ1", TURNING)) as instrument:
        instrument.prepare(sample_rate=2048.0, channels=[0])
        for _ in range(2):
            instrument.start()
            blocks = read(instrument, 3000)
            instrument.stop()
            blocks += read(instrument, 10**9, 0.05)
            samples = np.concatenate([block.samples for block in blocks])
            ticks = np.arange(len(samples))
            np.testing.assert_array_equal(samples[:, 0], ticks)
            np.testing.assert_array_equal(samples[:, -1], pulses(ticks))
    counter = next(task for task in device.tasks.values() if "counter" in task)
    assert (counter["counter"], counter["source"], counter["rate"]) == ("cDAQ1/_ctr0", "/cDAQ1/ai/SampleClock", 2048.0)
    assert "/cDAQ1/PFI1" in counter["attributes"].values()
    assert counter["cleared"]
    assert [(one.unit, one.counts) for one in instrument.inputs[-2:]] == [("V", False), ("pulses", True)]
    assert instrument.memory(len(INPUTS)) is None


def test_a_tachometer_that_rests_is_recorded_as_an_angle(tmp_path: Path) -> None:
    text = f"""
[instrument]
kind = "nidaqmx"
port = "cDAQ1"
sample_rate = 2048.0
inputs = {list(INPUTS)}
full_scale = 1e6
tachometer = "cDAQ1/_ctr0"
[channels.head]
input = 0
sensitivity = 0.01
[channels.shaft]
input = 3
quantity = "angle"
unit = "rad"
sensitivity = 159.15494309189535  # pulses per rad: 1000 in a turn
[[runs]]
id = "a"
configuration = "unlocked"
gain = 1.0
excitation = "other"
seconds = 1.0
"""
    (tmp_path / "plan.toml").write_text(text)
    # At rest for as long as the pre-run check lasts.
    with chassis(Device(speed=1.0, pulses=lambda ticks: np.maximum(ticks - 2047, 0))):
        assert main(["acquire", str(tmp_path / "plan.toml"), "--yes", "-o", str(tmp_path / "c.h5")]) == 0
    shaft = read_recording(tmp_path / "c.h5").runs[0].channels["shaft"]
    assert (shaft.quantity, shaft.unit) == ("angle", "rad")
    np.testing.assert_array_equal(shaft.read()[:2048], 0.0)
    np.testing.assert_allclose(np.diff(shaft.read()[2048:]), 2.0 * np.pi / 1000.0)


def test_a_tachometer_keeps_its_place_after_samples_that_the_host_did_not_fetch() -> None:
    with chassis(Device(lost=(1000, 300))), closing(NiInstrument("cDAQ1", TURNING)) as instrument:
        instrument.prepare(sample_rate=2048.0, channels=[0])
        instrument.start()
        blocks = read(instrument, 3000)
        instrument.stop()
    assert any(b.first_tick > a.end_tick for a, b in pairwise(blocks))
    for block in blocks:
        ticks = np.arange(block.first_tick, block.end_tick)
        np.testing.assert_array_equal(block.samples[:, [0, -1]], np.column_stack([ticks, ticks // 5]))


@pytest.mark.parametrize(("unit", "expected"), [(15891, 2.248e-3), (15892, 2.248e-3 / 4.4482216152605)])
def test_the_library_reads_the_memory_of_a_force_sensor(unit: int, expected: float) -> None:
    first, second, _ = INPUTS
    device = Device(memories={first: b"1", second: b"2"}, forces={first: (2.248, unit)})
    with chassis(device), closing(NiInstrument("cDAQ1", NiSettings(inputs=INPUTS))) as instrument:
        assert instrument.force_sensitivity(0) == pytest.approx(expected)
        assert [instrument.force_sensitivity(place) for place in (1, 2)] == [None, None]


def test_what_is_missing_is_named_in_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    # Here NI's runtime is not installed.
    said = r"NI-DAQmx is missing on this computer \([^.]*\); install it from ni\.com"
    with within(20.0), pytest.raises(SettingError, match=said):
        NiInstrument("cDAQ1", PLAYING)
    with chassis(), pytest.raises(ConnectionLostError, match="cDAQ7 is gone"):
        NiInstrument("cDAQ7", PLAYING)
    wrong = NiSettings(inputs=("Dev9/ai0",))
    with chassis(), closing(NiInstrument("cDAQ1", wrong)) as instrument, pytest.raises(InstrumentError, match="-200170"):
        instrument.prepare(sample_rate=2048.0, channels=[0])
    monkeypatch.setitem(sys.modules, "nidaqmx", None)
    with pytest.raises(SettingError, match=r"pip install 'isorig\[ni\]'"):
        NiInstrument("cDAQ1", PLAYING)


@pytest.mark.parametrize(("changed", "says"), [
    ({"inputs": []}, "give the physical channels"), ({"inputs": ["cDAQ1Mod1/ao0"]}, "give the physical channels"),
    ({"full_scale": 0.0}, "full_scale is 0"), ({"iepe": 3.0}, "iepe is 3 mA"), ({"output": "x/ao0"}, "drive_volts is 0"),
    ({"tachometer": "cDAQ1Mod1/ai0"}, "give a counter"), ({"tachometer_terminal": "/cDAQ1/PFI0"}, "without tachometer"),
    ({"limit": -1.0}, "limit is -1"), ({"ramp": 11.0}, "ramp is 11"), ({"coupling": "GND"}, "Invalid enum value"),
])  # fmt: skip
def test_settings_that_cannot_be_are_refused(changed: dict[str, object], says: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=says):
        msgspec.convert({"inputs": list(INPUTS), **changed}, NiSettings)


def test_the_driver_imports_the_package_when_it_is_opened() -> None:
    assert "nidaqmx" not in vars(ni)


@contextmanager
def serve_ni(situation: Situation) -> Iterator[Served]:
    # A loss is a host that is late: as long as it takes to overwrite the buffer.
    device = Device(
        clock=situation.clock, silent=situation.silent, overload_from=situation.overload_at, lost=situation.lose,
        mute_after=situation.mute_after,
    )  # fmt: skip

    def unplug() -> None:
        device.gone_after = 0

    with chassis(device):
        yield Served("cDAQ1", lambda: device.level != 0.0, unplug)


CASES = (Case(kind="nidaqmx", serve=serve_ni, rate=2048.0),)
