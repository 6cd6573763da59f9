"""NI-DAQmx devices through National Instruments' own package: inputs of one chassis on one clock, an output for the drive, a
counter for a tachometer.

The device counts its samples: each block is placed by the read position, so that samples which the host did not fetch in time
(error -200279) are a counted gap. The output is clocked by the inputs' sample clock and starts with them. Overloads and open
sensors are reported where the device reports them.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, Literal, TypeVar

import numpy as np

from isorig.drivers.block import Block, FloatArray, Input, Status
from isorig.drivers.errors import ConnectionLostError, DriverError, InstrumentError, SettingError, brief
from isorig.drivers.kinds import Connected, StreamKind
from isorig.drivers.voltage import AnalogOutput, OutputSettings, fade
from isorig.drivers.waits import WAITS, Waits

T = TypeVar("T")
#: Seconds of samples in the buffer of the driver, and seconds of drive written in advance.
BUFFER, AHEAD = 10.0, 2.0
#: Samples fetched at once.
MOST = 16384
#: NI's error codes: the samples were overwritten; the attribute is not available on this device; the device is gone.
OVERWRITTEN = -200279
UNSUPPORTED = (-200452, -200197)
GONE = (-201003, -200220, -88705, -88708)
#: IEPE currents of NI's modules, mA; 0 is off.
CURRENTS = (0.0, 2.0, 2.1, 4.0, 6.0, 10.0)
#: Values of a soft stop, written one by one.
STEPS = 50
#: Newtons in a pound-force, exactly (0.45359237 kg times standard gravity).
POUND = 4.4482216152605


class NiSettings(OutputSettings, frozen=True, kw_only=True):
    """Inputs and output."""

    #: Physical channels in the order of the plan's inputs, e.g. ["cDAQ1Mod1/ai0", "cDAQ1Mod1/ai1", "cDAQ1Mod2/ai0"].
    inputs: tuple[str, ...]
    full_scale: float = 5.0  #: Range of the inputs, V.
    coupling: Literal["AC", "DC"] | None = None  #: AC or DC; the device's default without it.
    iepe: float = 0.0  #: Current of the IEPE supply in mA, 0 for none.
    output: str = ""  #: Physical channel that plays the drive, e.g. "cDAQ1Mod3/ao0".
    trigger: str = ""  #: Terminal of a start trigger, e.g. "/cDAQ1/PFI0".
    #: Counter of a tachometer's or encoder's pulses, e.g. "cDAQ1/_ctr0": the input after the others, in pulses since the start.
    tachometer: str = ""
    tachometer_terminal: str = ""  #: Terminal of the pulses, e.g. "/cDAQ1/PFI1"; the counter's default without it.

    def __post_init__(self) -> None:
        self.check_output()
        if not self.inputs or any("/ai" not in name or not name.isprintable() or "," in name for name in self.inputs):
            raise ValueError(f'inputs is {list(self.inputs)}; give the physical channels, e.g. ["cDAQ1Mod1/ai0"]')
        if self.tachometer and "ctr" not in self.tachometer.rsplit("/", maxsplit=1)[-1]:
            raise ValueError(f"tachometer is {self.tachometer!r}; give a counter, e.g. cDAQ1/_ctr0")
        if self.tachometer_terminal and not self.tachometer:
            raise ValueError("tachometer_terminal is given without tachometer; give its counter, e.g. cDAQ1/_ctr0")
        if not 0.0 < self.full_scale < math.inf:
            raise ValueError(f"full_scale is {self.full_scale:g}; give the range of the inputs in V, e.g. 5.0")
        if self.iepe not in CURRENTS:
            raise ValueError(f"iepe is {self.iepe:g} mA; give one of {', '.join(f'{mA:g}' for mA in CURRENTS)}")


class NiInstrument(AnalogOutput):
    """A device or chassis of National Instruments, by its name, e.g. cDAQ1. Raises SettingError if the package, NI's runtime, or
    the device is missing."""

    def __init__(self, port: str, settings: NiSettings, waits: Waits = WAITS) -> None:
        self._ni, self._errors = _package()
        super().__init__(port, settings)
        self._settings, self._waits = settings, waits
        one = Input(unit="V", per_count=1.0, full_scale=settings.full_scale, dtype="float64")
        pulses = Input(unit="pulses", per_count=1.0, full_scale=None, dtype="float64", counts=True)
        self.inputs: Sequence[Input] = (one,) * len(settings.inputs) + (pulses,) * bool(settings.tachometer)
        device = self._call(lambda: self._ni.system.System.local().devices[port].product_type)
        self.identity = f"NI {device} {port}"
        self._task: Any = None
        self._output: Any = None
        self._tachometer: Tachometer | None = None
        self._written = 0
        self._running = False
        self._ready: deque[Block] = deque()
        #: Anomalies since the last start, one clause each.
        self.noticed: list[str] = []
        # Whether the device reports overloads and open sensors; unknown until asked.
        self._reports = {"overloaded_chans_exist": True, "open_chans_exist": True}

    def prepare(self, *, sample_rate: float, channels: Sequence[int]) -> float:
        """Set up all inputs on one clock; returns the rate that the device has."""
        self._close_tasks()
        task = self._task = self._call(self._ni.Task)
        self._call(lambda: self._set_inputs(task, sample_rate))
        self._rate = float(self._call(lambda: task.timing.samp_clk_rate))
        if self._settings.tachometer:
            self._tachometer = self._call(self._counter)
        return self._rate

    def memory(self, place: int) -> bytes | None:
        """The memory of the sensor at an input; None if it has none, or the module reads none."""
        if place >= len(self._settings.inputs):
            return None
        channel = self._ni.system.PhysicalChannel(self._settings.inputs[place])
        try:
            return bytes(int(byte) for byte in channel.teds_bit_stream)
        except self._errors.DaqError:
            # The module reads no memories, or there is none at this input.
            return None

    def force_sensitivity(self, place: int) -> float | None:
        """V per N by the memory of a force sensor, as NI's library reads it; None if it does not."""
        name, constants = self._settings.inputs[place], self._ni.constants
        try:
            self._ni.system.PhysicalChannel(name).configure_teds()
            # The task is not started: the library fills in what the memory states.
            with self._ni.Task() as task:
                channel = task.ai_channels.add_teds_ai_force_iepe_chan(name)
                sensitivity, unit = channel.ai_force_iepe_sensor_sensitivity, channel.ai_force_iepe_sensor_sensitivity_units
        except self._errors.DaqError:
            return None
        newtons = 1.0 if unit == constants.ForceIEPESensorSensitivityUnits.MILLIVOLTS_PER_NEWTON else POUND
        return 1e-3 * float(sensitivity) / newtons

    def start(self) -> None:
        """Start the inputs, and the output with them."""
        self._ready.clear()
        self.noticed = []
        if self._drive is not None:
            self._call(self._arm_output)
        if self._tachometer is not None:
            self._call(self._tachometer.start)
        self._call(self._task.start)
        self._running = True

    def read(self, timeout: float) -> Block | None:
        """The samples that the device has, or None."""
        end = time.monotonic() + timeout
        while not self._ready and self._running:
            if self._fetch():
                self._top_up()
                break
            if time.monotonic() >= end:
                break
            time.sleep(self._waits.fetch)
        return self._ready.popleft() if self._ready else None

    def stop(self) -> int | None:
        """Stop output and inputs; returns the number of samples that the device acquired."""
        if not self._running:
            return None
        self._running = False
        try:
            counted = int(self._call(lambda: self._task.in_stream.total_samp_per_chan_acquired))
            end = time.monotonic() + BUFFER
            while self._fetch(until=counted) and time.monotonic() < end:
                pass
            return counted
        finally:
            self._silence()
            with suppress(DriverError):
                self._call(self._task.stop)
                if self._tachometer is not None:
                    self._call(self._tachometer.stop)

    def close(self) -> None:
        """Switch the output off and release the device."""
        if self._running:
            self._running = False
            self._silence()
        self._close_tasks()

    def _set_inputs(self, task: Any, rate: float) -> None:
        constants, own = self._ni.constants, self._settings
        for name in own.inputs:
            channel = task.ai_channels.add_ai_voltage_chan(name, min_val=-own.full_scale, max_val=own.full_scale)
            if own.coupling is not None:
                channel.ai_coupling = constants.Coupling[own.coupling]
            if own.iepe:
                channel.ai_excit_src = constants.ExcitationSource.INTERNAL
                channel.ai_excit_voltage_or_current = constants.ExcitationVoltageOrCurrent.USE_CURRENT
                channel.ai_excit_val = 1e-3 * own.iepe
        task.timing.cfg_samp_clk_timing(
            rate, sample_mode=constants.AcquisitionType.CONTINUOUS, samps_per_chan=round(BUFFER * rate)
        )
        # A host that is late loses the oldest samples; they are counted, and the run goes on.
        task.in_stream.overwrite = constants.OverwriteMode.OVERWRITE_UNREAD_SAMPLES
        if own.trigger:
            task.triggers.start_trigger.cfg_dig_edge_start_trig(own.trigger)

    def _counter(self) -> Tachometer:
        own = self._settings
        return Tachometer(
            self._ni, own.tachometer, own.tachometer_terminal, rate=self._rate, clock=self._task.timing.samp_clk_term,
            buffer=round(BUFFER * self._rate),
        )  # fmt: skip

    def _arm_output(self) -> None:
        assert self._drive is not None
        self._close_output()
        constants, ahead = self._ni.constants, round(AHEAD * self._rate)
        task = self._output = self._ni.Task()
        channel = self._output_channel(task)
        # Not every output has a behavior at rest; the soft stop writes zero in any case.
        with suppress(self._errors.DaqError):
            channel.ao_idle_output_behavior = constants.AOIdleOutputBehavior.ZERO_VOLTS
        # The inputs' clock: one output sample for each tick.
        task.timing.cfg_samp_clk_timing(
            self._rate, source=self._task.timing.samp_clk_term, sample_mode=constants.AcquisitionType.CONTINUOUS,
            samps_per_chan=2 * ahead,
        )  # fmt: skip
        task.out_stream.regen_mode = constants.RegenerationMode.DONT_ALLOW_REGENERATION
        self._written = self._write(task, 0, ahead)
        task.start()

    def _output_channel(self, task: Any) -> Any:
        limit = self._settings.limit
        return task.ao_channels.add_ao_voltage_chan(self._settings.output, min_val=-limit, max_val=limit)

    def _top_up(self) -> None:
        if self._output is None:
            return
        room = int(self._call(lambda: self._output.out_stream.space_avail))
        if room > 0:
            count = min(room, round(AHEAD * self._rate))
            self._written += self._call(lambda: self._write(self._output, self._written, count))

    def _write(self, task: Any, first: int, count: int) -> int:
        assert self._drive is not None
        writer = self._ni.stream_writers.AnalogSingleChannelWriter(task.out_stream, auto_start=False)
        return int(writer.write_many_sample(np.ascontiguousarray(self._drive[first : first + count]), timeout=1.0))

    def _silence(self) -> None:
        # From the voltage of this moment softly to zero, sample by sample.
        if self._output is None or self._drive is None:
            return
        now = 0.0
        with suppress(Exception):
            played = int(self._output.out_stream.total_samp_per_chan_generated)
            now = float(self._drive[played : played + 1][0])
        self._close_output()
        try:
            self._call(lambda: self._lower(now))
        except DriverError as error:
            self.noticed.append(f"the output could not be set to zero, so switch the amplifier off: {error}")

    def _lower(self, volts: float) -> None:
        with self._ni.Task() as task:
            self._output_channel(task)
            writer = self._ni.stream_writers.AnalogSingleChannelWriter(task.out_stream, auto_start=True)
            for value in volts * fade(np.linspace(1.0, 0.0, STEPS)):
                writer.write_one_sample(float(value))
                time.sleep(self._settings.ramp / STEPS)

    def _fetch(self, until: int | None = None) -> bool:
        # The samples that the device has beyond the read position, as a block; whether there were any.
        stream = self._task.in_stream
        first = int(self._call(lambda: stream.curr_read_pos))
        count = min(int(self._call(lambda: stream.avail_samp_per_chan)), MOST)
        if until is not None:
            count = min(count, until - first)
        if count <= 0:
            return False
        data = np.empty((len(self.inputs), count))
        volts = data[: len(self._settings.inputs)]
        try:
            reader = self._ni.stream_readers.AnalogMultiChannelReader(stream)
            got = reader.read_many_sample(volts, number_of_samples_per_channel=count, timeout=1.0)
            if self._tachometer is not None:
                data[-1, :got] = self._tachometer.edges(first, got)
        except self._errors.DaqError as error:
            if error.error_code != OVERWRITTEN:
                raise self._failure(error) from None
            self._call(lambda: self._skip(stream, first))
            return True
        status = Status.NUMBERED | self._status(stream)
        self._ready.append(
            Block(first_tick=first, samples=np.ascontiguousarray(data[:, :got].T), host_time=time.monotonic(), status=status)
        )
        return True

    def _skip(self, stream: Any, first: int) -> None:
        # Go on at the newest sample: what was overwritten is the gap before the next block.
        relative = self._ni.constants.ReadRelativeTo
        stream.relative_to, stream.offset = relative.MOST_RECENT_SAMPLE, 0
        data = np.empty((len(self._settings.inputs), 1))
        reader = self._ni.stream_readers.AnalogMultiChannelReader(stream)
        reader.read_many_sample(data, number_of_samples_per_channel=1, timeout=1.0)
        stream.relative_to, stream.offset = relative.CURRENT_READ_POSITION, 0
        lost = int(stream.curr_read_pos) - first
        self.noticed.append(f"at tick {first} the host was late, and the device overwrote {lost} samples")

    def _status(self, stream: Any) -> Status:
        status = Status.GOOD
        for name, flag in (("overloaded_chans_exist", Status.OVERLOAD), ("open_chans_exist", Status.FAULT)):
            if not self._reports[name]:
                continue
            try:
                found = bool(getattr(stream, name))
            except self._errors.DaqError as error:
                if error.error_code not in UNSUPPORTED:
                    raise self._failure(error) from None
                self._reports[name] = False
                continue
            if found:
                status |= flag
                if flag == Status.FAULT:
                    self._notice_open(stream)
        return status

    def _notice_open(self, stream: Any) -> None:
        names = ", ".join(self._call(lambda: stream.open_chans))
        clause = f"no sensor is connected to {names}, or its cable is broken"
        if clause not in self.noticed:
            self.noticed.append(clause)

    def _close_tasks(self) -> None:
        self._close_output()
        if self._tachometer is not None:
            self._tachometer.close()
            self._tachometer = None
        _close(self._task)
        self._task = None

    def _close_output(self) -> None:
        _close(self._output)
        self._output = None

    def _call(self, action: Callable[[], T]) -> T:
        try:
            return action()
        except self._errors.DaqError as error:
            raise self._failure(error) from None
        except (self._errors.Error, OSError) as error:
            raise SettingError(_not_installed(error)) from None

    def _failure(self, error: Any) -> DriverError:
        code, said = error.error_code, brief(error)
        if code in GONE:
            return ConnectionLostError(f"{self._name} is gone (NI error {code}: {said}); reconnect it and resume")
        return InstrumentError(f"{self._name} reports NI error {code} ({said}); correct the plan or the device's set-up")


class Tachometer:
    """Counts rising edges on the clock of the inputs: its sample k belongs to their sample k.

    The pulses arrive at a terminal, that of the counter by default. The inputs have a rate in Hz, and `buffer` samples are kept
    for the host.
    """

    def __init__(self, package: Any, counter: str, terminal: str, *, rate: float, clock: str, buffer: int) -> None:
        self._package, self._task = package, package.Task()
        self._total = self._last = 0
        try:
            channel = self._task.ci_channels.add_ci_count_edges_chan(counter)
            if terminal:
                channel.ci_count_edges_term = terminal
            self._task.timing.cfg_samp_clk_timing(
                rate, source=clock, sample_mode=package.constants.AcquisitionType.CONTINUOUS, samps_per_chan=buffer
            )
            self._task.in_stream.overwrite = package.constants.OverwriteMode.OVERWRITE_UNREAD_SAMPLES
        except BaseException:
            self.close()
            raise

    def start(self) -> None:
        """Count from zero; before the inputs, whose first sample clocks the first count."""
        self._total = self._last = 0
        self._task.start()

    def stop(self) -> None:
        """Stop counting."""
        self._task.stop()

    def edges(self, first: int, count: int) -> FloatArray:
        """Edges since the start at the samples from `first` on, shape (count,)."""
        stream = self._task.in_stream
        # Not zero after samples that the host did not fetch.
        stream.offset = first - int(stream.curr_read_pos)
        counts = np.zeros(count, np.uint32)
        reader = self._package.stream_readers.CounterReader(stream)
        reader.read_many_sample_uint32(counts, number_of_samples_per_channel=count, timeout=1.0)
        # The counter has 32 bits: differences remain right when it returns to zero.
        steps = np.diff(counts, prepend=np.uint32(self._last))
        edges = self._total + np.cumsum(steps, dtype=np.int64)
        self._total, self._last = int(edges[-1]), int(counts[-1])
        return edges.astype(np.float64)

    def close(self) -> None:
        """Release the counter."""
        with suppress(Exception):
            self._task.close()


def devices() -> list[Connected]:
    """Devices of this computer with analog inputs; the modules of a chassis belong to it. Raises SettingError if the package or
    NI's runtime is missing."""
    package, errors = _package()
    found: dict[str, tuple[str, list[str], list[str]]] = {}
    try:
        for device in package.system.System.local().devices:
            try:
                chassis = str(device.compact_daq_chassis_device.name)
            except errors.DaqError:
                chassis = str(device.name)
            _, inputs, outputs = found.setdefault(chassis, (f"NI {device.product_type}", [], []))
            inputs += map(str, device.ai_physical_chans.channel_names)
            outputs += map(str, device.ao_physical_chans.channel_names)
    except errors.DaqError as error:
        raise SettingError(f"NI devices cannot be listed ({brief(error)}); check them in NI's own tool") from None
    except (errors.Error, OSError) as error:
        raise SettingError(_not_installed(error)) from None
    return [
        Connected(bus="ni", port=port, name=name, settings={"inputs": inputs} | ({"output": outputs[0]} if outputs else {}))
        for port, (name, inputs, outputs) in found.items()
        if inputs
    ]


def _package() -> tuple[Any, Any]:
    # Imported here: it takes long, and only this instrument needs it.
    try:
        import nidaqmx
        import nidaqmx.constants
        import nidaqmx.stream_readers
        import nidaqmx.stream_writers
        import nidaqmx.system
        from nidaqmx import errors
    except ImportError:
        raise SettingError(
            "NI devices need the package nidaqmx, which is missing; install it with pip install 'isorig[ni]'"
        ) from None
    return nidaqmx, errors


def _close(task: Any) -> None:
    if task is not None:
        with suppress(Exception):
            task.close()


def _not_installed(error: Exception) -> str:
    # NI's first sentence; the others say the same as ours.
    said = " ".join(str(error).split()).split(". ", maxsplit=1)[0].rstrip(".")[:120]
    return f"NI's runtime NI-DAQmx is missing on this computer ({said}); install it from ni.com, then start again"


EXAMPLE = """
sample_rate = 2048.0
inputs = ["cDAQ1Mod1/ai0", "cDAQ1Mod1/ai1", "cDAQ1Mod1/ai2", "cDAQ1Mod1/ai3"]
coupling = "AC"
iepe = 2.0
output = "cDAQ1Mod2/ao0"
drive_volts = 0.01
limit = 1.0
[channels.head]
input = 0
sensitivity = 0.0102
[channels.motor]
input = 3
sensitivity = 0.0102
"""
KIND = StreamKind(name="nidaqmx", open=NiInstrument, example=EXAMPLE, settings=NiSettings, buses=("ni",), plays=True)
