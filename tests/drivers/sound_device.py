"""A sound interface in place of PortAudio, for what a real audio stack does not do on request: losses, silence, unplugging."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np

from isorig.drivers import sound


class PortAudioError(Exception):
    """What the library raises."""


@dataclass
class Device:
    """An interface of two inputs and two outputs whose first input counts samples.

    Parameters
    ----------
    rate, clock
        Hz; true rate over the nominal one.
    lost
        Samples that never arrive, from one on, and how many, with or without a report of the library.
    refuses
        Refuses to open or to start.
    """

    rate: float = 8000.0
    clock: float = 1.0
    lost: tuple[int, int] | None = None
    told: bool = True
    silent: bool = False
    mute_after: int | None = None
    refuses: str = ""
    gone: threading.Event = field(default_factory=threading.Event)
    #: What the output plays now.
    level: int = 0

    def package(self) -> Any:
        """The library with this interface."""

        def query_devices(name: str | None = None) -> Any:
            one = {"name": "card", "index": 0, "hostapi": 0, "max_input_channels": 2, "max_output_channels": 2}
            if name not in (None, "card"):
                raise ValueError(f"No device matching {name!r}")
            return [one] if name is None else one

        def opened(**settings: Any) -> Stream:
            if self.refuses == "open":
                raise PortAudioError("Invalid sample rate [PaErrorCode -9997]")
            return Stream(self, **settings)

        return SimpleNamespace(
            query_devices=query_devices, query_hostapis=lambda: [{"name": "here"}], Stream=opened, InputStream=opened,
            PortAudioError=PortAudioError,
        )  # fmt: skip


class Stream:
    """A stream: a thread that calls back with the samples that are due."""

    def __init__(
        self, card: Device, *, callback: Callable[..., None], finished_callback: Callable[[], None], samplerate: float,
        channels: Any, **settings: Any,
    ) -> None:  # fmt: skip
        self._device, self._callback, self._finished, self.samplerate = card, callback, finished_callback, samplerate
        self._inputs, self._outputs = channels if isinstance(channels, tuple) else (channels, 0)
        self._over = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def active(self) -> bool:
        """Whether it runs."""
        return self._thread is not None and self._thread.is_alive()

    def start(self) -> None:
        """Start."""
        if self._device.refuses == "start":
            raise PortAudioError("Unanticipated host error [PaErrorCode -9999]")
        self._over.clear()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop; the output is silent."""
        self._over.set()
        if self._thread is not None:
            self._thread.join(2.0)
        self._device.level = 0

    abort = close = stop

    def _work(self) -> None:
        device, sent, began = self._device, 0, time.monotonic()
        overflow = False
        while not self._over.wait(0.01) and not device.gone.is_set():
            due = int((time.monotonic() - began) * device.rate * device.clock)
            if device.mute_after is not None:
                due = min(due, device.mute_after)
            if device.silent or due <= sent:
                continue
            first, sent = sent, due
            ticks = np.arange(first, sent)
            if device.lost is not None:
                kept = (ticks < device.lost[0]) | (ticks >= sum(device.lost))
                overflow = overflow or (device.told and not kept.all())
                ticks = ticks[kept]
            if not len(ticks):
                continue
            status = SimpleNamespace(input_overflow=overflow, output_underflow=False)
            overflow = False
            data = np.zeros((len(ticks), self._inputs), np.int32)
            data[:, 0] = ticks
            if self._outputs:
                out = np.zeros((len(ticks), self._outputs), np.int32)
                self._callback(data, out, len(ticks), None, status)
                device.level = int(np.abs(out[-1]).max())
            else:
                self._callback(data, len(ticks), None, status)
        device.level = 0
        self._finished()


@contextmanager
def card(device: Device) -> Iterator[Device]:
    """While this lasts, the driver talks to the interface."""
    with mock.patch.object(sound, "_package", return_value=device.package()):
        yield device
