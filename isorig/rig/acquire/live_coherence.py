"""Coherence during a run: segments are added as they arrive."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.spectra.windows import HANN

#: Seconds of a segment.
SEGMENT = 2.0


class RunningCoherence:
    """Accumulates spectra segment by segment (Welch without overlap, ignoring gaps, for display only).

    Parameters
    ----------
    channels
        All channels.
    drive
        The drive channel.
    band
        Hz.
    rate
        Hz.
    """

    def __init__(self, channels: tuple[str, ...], *, drive: str, band: tuple[float, float], rate: float) -> None:
        self._drive = drive if drive in channels else None
        self._length = max(round(SEGMENT * rate), 16)
        frequency = np.fft.rfftfreq(self._length, 1.0 / rate)
        self._inside = (frequency >= band[0]) & (frequency <= band[1])
        self._window = HANN.samples(self._length)
        self._waiting: dict[str, FloatArray] = {name: np.zeros(0) for name in channels}
        self._auto = {name: np.zeros(int(self._inside.sum())) for name in channels}
        self._cross = {name: np.zeros(int(self._inside.sum()), complex) for name in channels}
        self._segments = 0

    def add(self, values: Mapping[str, FloatArray]) -> None:
        """Add samples of all channels, with equal lengths."""
        if self._drive is None or not self._inside.any():
            return
        for name, new in values.items():
            self._waiting[name] = np.concatenate([self._waiting[name], new])
        while len(self._waiting[self._drive]) >= self._length:
            self._segment({name: waiting[: self._length] for name, waiting in self._waiting.items()})
            self._waiting = {name: waiting[self._length :] for name, waiting in self._waiting.items()}

    def medians(self) -> dict[str, float]:
        """Median coherence of each response with the drive within the band; empty before the third segment."""
        if self._drive is None or self._segments < 3:
            return {}
        power = self._auto[self._drive]
        tiny = np.finfo(float).tiny
        return {
            name: float(np.median(np.abs(cross) ** 2 / np.maximum(power * self._auto[name], tiny)))
            for name, cross in self._cross.items()
            if name != self._drive
        }

    def _segment(self, values: Mapping[str, FloatArray]) -> None:
        assert self._drive is not None
        lines = {
            name: np.fft.rfft(self._window * (part - part.mean()))[self._inside] for name, part in values.items()
        }  # fmt: skip
        for name, line in lines.items():
            self._auto[name] += np.abs(line) ** 2
            self._cross[name] += np.conj(lines[self._drive]) * line
        self._segments += 1
