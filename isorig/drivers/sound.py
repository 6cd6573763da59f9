"""Sound interfaces through PortAudio: inputs and the drive on one duplex stream.

A sound interface has no unit: its full scale in volts comes from its data sheet, or from a known level at its input. PortAudio
reports that samples were lost but not how many, so the host's clock counts them (`isorig.drivers.arrivals`). Mixers, volume
controls and sample rate converters of the operating system must be off: choose the hardware device, not a mixed one.
"""

import math
import threading
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from isorig.drivers.arrivals import Arrivals
from isorig.drivers.block import Block, FloatArray, Input, Raw, Status
from isorig.drivers.errors import ConnectionLostError, SettingError, brief
from isorig.drivers.kinds import Connected, StreamKind
from isorig.drivers.voltage import AnalogOutput, OutputSettings, fade
from isorig.drivers.waits import WAITS, Waits

#: Digital full scale of the samples, and largest number of channels of an interface.
FULL, MOST = 2**31, 64
#: Seconds of drive prepared in advance, and samples of a part of it.
AHEAD, PART = 2.0, 4096
#: Seconds that a soft stop may take beyond its ramp.
STOPPING = 1.0
#: Buffer of the stream in seconds: a delay does no harm, a late host does.
LATENCY = 0.2
#: A stream delivers regularly after so many successive steps of so many seconds, if this share of the samples of a step arrives.
#: Until then it fills its buffers.
STEP, STEPS, REGULAR = 0.2, 2, 0.3


class SoundSettings(OutputSettings, frozen=True, kw_only=True):
    """Inputs and output of a sound interface."""

    channels: int = 2  #: Number of inputs.
    full_scale: float | None = None  #: Voltage at an input at digital full scale, V.
    #: Instead of `full_scale`: a known voltage, and the reading at that voltage as a share of full scale, both rms.
    level_volts: float | None = None
    level_reads: float | None = None
    output: int | None = None  #: Output that plays the drive, from 0; none without it.
    output_full_scale: float = 1.0  #: Voltage at the output at digital full scale, V.

    def __post_init__(self) -> None:
        self.check_output()
        if not 1 <= self.channels <= MOST:
            raise ValueError(f"channels is {self.channels}; give the number of inputs, 1 to {MOST}")
        if self.output is not None and not 0 <= self.output < MOST:
            raise ValueError(f"output is {self.output}; outputs are numbered from 0")
        known = self.level_volts is not None and self.level_reads is not None
        if known == (self.full_scale is not None):
            raise ValueError(
                "the voltage at digital full scale is full_scale, or level_volts with level_reads; give one of the two"
            )
        if not 0.0 < self.volts < math.inf or not 0.0 < self.output_full_scale < math.inf:
            raise ValueError(f"full scale is {self.volts:g} V, of the output {self.output_full_scale:g} V; give values above 0")
        if self.output is not None and self.limit > self.output_full_scale:
            raise ValueError(f"limit is {self.limit:g} V; the output has {self.output_full_scale:g} V at most")

    @property
    def volts(self) -> float:
        """Voltage at digital full scale."""
        if self.full_scale is not None:
            return self.full_scale
        assert self.level_volts is not None
        assert self.level_reads is not None
        return self.level_volts / self.level_reads if self.level_reads else math.inf


class SoundInstrument(AnalogOutput):
    """A sound interface, by its name in the list of `rig instruments`, or a part of it that no other has. Raises SettingError if
    the package, PortAudio or the interface is missing."""

    def __init__(self, port: str, settings: SoundSettings, waits: Waits = WAITS) -> None:
        self._sound = _package()
        super().__init__(port, settings)
        self._settings, self._waits = settings, waits
        one = Input(unit="V", per_count=settings.volts / FULL, full_scale=settings.volts, dtype="int32")
        self.inputs: Sequence[Input] = (one,) * settings.channels
        try:
            self._device = self._sound.query_devices(port)
        except (ValueError, self._sound.PortAudioError) as error:
            raise SettingError(
                f"there is no sound interface {port!r} ({brief(error)}); choose one that rig instruments lists"
            ) from None
        self.identity = str(self._device["name"])
        self._stream: Any = None
        self._clear()

    @property
    def noticed(self) -> Sequence[str]:
        said = {"input_overflow": "PortAudio lost samples of the inputs", "output_underflow": "the drive was interrupted"}
        return tuple(f"{text} {self._flags[name]} times" for name, text in said.items() if self._flags[name])

    @property
    def held(self) -> int:
        return self._arrivals.held

    def prepare(self, *, sample_rate: float, channels: Sequence[int]) -> float:
        """Open the stream; returns the rate that the interface has."""
        if max(channels, default=0) >= self._settings.channels:
            raise SettingError(
                f"{self._name} is used with {self._settings.channels} inputs; there is no input {max(channels)}, set channels"
            )
        self._close_stream()
        own = self._settings
        way: tuple[Any, Any, Any] = self._sound.InputStream, own.channels, self._heard
        if own.output is not None:
            way = self._sound.Stream, (own.channels, own.output + 1), self._duplex
        stream, channels, callback = way
        try:
            made = stream(
                device=int(self._device["index"]), channels=channels, samplerate=sample_rate, dtype="int32", latency=LATENCY,
                callback=callback, finished_callback=self._finished.set,
            )  # fmt: skip
        except (ValueError, self._sound.PortAudioError) as error:
            raise SettingError(
                f"{self._name} refuses {sample_rate:g} Hz with {own.channels} inputs ({brief(error)}); correct the plan"
            ) from None
        self._stream = made
        self._rate = float(made.samplerate)
        return self._rate

    def start(self) -> None:
        self._clear()
        self._prepare_drive()
        try:
            self._stream.start()
        except self._sound.PortAudioError as error:
            raise ConnectionLostError(f"{self._name} does not start ({brief(error)}); reconnect it and resume") from None
        self._settle()
        self._latest = time.monotonic()
        self._running = self._begun = True

    def _settle(self) -> None:
        # Until samples arrive regularly: what comes before belongs to no time, and a drive would be lost.
        end, regular = time.monotonic() + self._waits.sound_start, 0
        while regular < STEPS:
            before = self._frames
            time.sleep(STEP)
            regular = regular + 1 if self._frames - before > REGULAR * STEP * self._rate else 0
            if time.monotonic() > end:
                self._stream.abort()
                raise ConnectionLostError(
                    f"{self._name} sends no samples within {self._waits.sound_start:g} s; reconnect it and resume"
                )

    def read(self, timeout: float) -> Block | None:
        """The samples that arrived, two seconds late, or None."""
        end = time.monotonic() + timeout
        while not self._ready and self._running:
            self._prepare_drive()
            self._sort()
            if self._ready or time.monotonic() >= end:
                break
            if self._finished.is_set() or time.monotonic() - self._latest > self._waits.sound:
                self._running = False
                raise ConnectionLostError(f"{self._name} sends no samples any more; reconnect it and resume")
            time.sleep(self._waits.fetch)
        return self._ready.popleft() if self._ready else None

    def stop(self) -> int | None:
        """Fade the drive out and stop the stream; PortAudio does not count the interface's samples."""
        if self._stream is None or not self._stream.active:
            self._running = False
            return None
        self._stopping = True
        end = time.monotonic() + self._settings.ramp + STOPPING
        while self._drive is not None and not self._silent.is_set() and time.monotonic() < end and self._stream.active:
            time.sleep(self._waits.fetch)
        with suppress(self._sound.PortAudioError):
            self._stream.stop()
        was, self._running = self._running, False
        if was:
            self._sort()
            self._arrivals.finish()
        return None

    def close(self) -> None:
        """Stop the stream and release the interface."""
        with suppress(Exception):
            self.stop()
        self._close_stream()

    def _clear(self) -> None:
        self._heard_blocks: deque[tuple[Raw, float, Status]] = deque()
        self._ready: deque[Block] = deque()
        self._arrivals: Arrivals[tuple[Raw, float, Status]] = Arrivals(self._rate, self._place)
        self._parts: deque[FloatArray] = deque()
        self._finished, self._silent = threading.Event(), threading.Event()
        self._flags = {"input_overflow": 0, "output_underflow": 0}
        self._running = self._stopping = self._begun = False
        self._frames = 0
        self._tick = self._made = self._played = self._faded = 0
        self._latest = time.monotonic()

    def _prepare_drive(self) -> None:
        # The stream's own thread only copies: a drive takes time to compute.
        if self._drive is None:
            return
        while self._made - self._played < AHEAD * self._rate:
            self._parts.append(self._drive[self._made : self._made + PART])
            self._made += PART

    def _heard(self, samples: Raw, frames: int, times: object, status: Any) -> None:
        now = time.monotonic()
        self._frames += frames
        if not self._begun:
            return
        for flag in self._flags:
            self._flags[flag] += bool(getattr(status, flag))
        self._heard_blocks.append((samples.copy(), now, Status.LOST if status.input_overflow else Status.GOOD))
        self._latest = now

    def _duplex(self, samples: Raw, out: Raw, frames: int, times: object, status: Any) -> None:
        self._heard(samples, frames, times, status)
        volts = self._next(frames)
        assert self._settings.output is not None
        out[:] = 0
        out[:, self._settings.output] = np.clip(np.rint(volts / self._settings.output_full_scale * FULL), -FULL, FULL - 1)

    def _next(self, frames: int) -> FloatArray:
        volts = np.zeros(frames)
        if not self._begun:
            return volts
        done = 0
        while done < frames and self._parts:
            part = self._parts[0]
            taken = min(len(part), frames - done)
            volts[done : done + taken] = part[:taken]
            done += taken
            if taken == len(part):
                self._parts.popleft()
            else:
                self._parts[0] = part[taken:]
        self._played += done
        if self._stopping:
            ramp = max(round(self._settings.ramp * self._rate), 1)
            share = 1.0 - np.minimum((self._faded + 1.0 + np.arange(frames)) / ramp, 1.0)
            volts *= fade(share)
            self._faded += frames
            if self._faded >= ramp:
                self._silent.set()
        return volts

    def _sort(self) -> None:
        while self._heard_blocks:
            item = self._heard_blocks.popleft()
            self._arrivals.add(item, len(item[0]), item[1])

    def _place(self, item: tuple[Raw, float, Status], missing: int) -> None:
        samples, now, status = item
        first = self._tick + missing
        self._tick = first + len(samples)
        status |= Status.CLOCKED if missing else Status.GOOD
        self._ready.append(Block(first_tick=first, samples=samples, host_time=now, status=status))

    def _close_stream(self) -> None:
        stream, self._stream = self._stream, None
        if stream is not None:
            with suppress(Exception):
                stream.close()


def devices() -> list[Connected]:
    """Sound interfaces with inputs. Raises SettingError if the package or PortAudio is missing."""
    package = _package()
    hosts = package.query_hostapis()
    return [
        Connected(
            bus="sound", port=str(one["name"]),
            name=f"{hosts[one['hostapi']]['name']}, {one['max_input_channels']} inputs, {one['max_output_channels']} outputs",
        )
        for one in package.query_devices()
        if one["max_input_channels"] > 0
    ]  # fmt: skip


def _package() -> Any:
    # Imported here: it loads PortAudio, and only this instrument needs it.
    try:
        import sounddevice
    except ImportError:
        raise SettingError(
            "sound interfaces need the package sounddevice, which is missing; install it with pip install 'isorig[sound]'"
        ) from None
    except OSError as error:
        raise SettingError(
            f"the library PortAudio is missing on this computer ({brief(error)}); install it, on Debian as libportaudio2"
        ) from None
    return sounddevice


EXAMPLE = """
sample_rate = 48000.0
channels = 2
full_scale = 1.0
output = 0
output_full_scale = 1.0
drive_volts = 0.001
limit = 0.5
[channels.head]
input = 0
sensitivity = 0.01
[channels.motor]
input = 1
sensitivity = 0.01
"""
KIND = StreamKind(name="sound", open=SoundInstrument, example=EXAMPLE, settings=SoundSettings, buses=("sound",), plays=True)
