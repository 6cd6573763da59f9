"""Coherence during a run: segments are added as they arrive."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.spectra.windows import HANN

#: Seconds of a segment.
SEGMENT = 2.0


class RunningCoherence:
    """Accumulates spectra segment by segment (Welch without overlap, ignoring gaps, for display); `band` and `rate` in Hz."""

    def __init__(self, channels: tuple[str, ...], *, drive: str, band: tuple[float, float], rate: float) -> None:
        self._channels = channels
        self._length = max(round(SEGMENT * rate), 16)
        frequency = np.fft.rfftfreq(self._length, 1.0 / rate)
        self._inside = (frequency >= band[0]) & (frequency <= band[1])
        self._drive = channels.index(drive) if drive in channels and self._inside.any() else None
        self._waiting = np.zeros((len(channels), 0))
        self._auto = np.zeros((len(channels), int(self._inside.sum())))
        self._cross = self._auto.astype(complex)
        self._segments = 0

    def add(self, values: Mapping[str, FloatArray]) -> None:
        """Add samples of all channels, with equal lengths."""
        if self._drive is None:
            return
        new = np.stack([values[name] for name in self._channels])
        waiting = np.concatenate([self._waiting, new], axis=1)
        while waiting.shape[1] >= self._length:
            part, waiting = waiting[:, : self._length], waiting[:, self._length :]
            windowed = HANN.samples(self._length) * (part - part.mean(axis=1, keepdims=True))
            lines = np.fft.rfft(windowed)[:, self._inside]
            self._auto += np.abs(lines) ** 2
            self._cross += np.conj(lines[self._drive]) * lines
            self._segments += 1
        self._waiting = waiting

    def medians(self) -> dict[str, float]:
        """Median coherence of each response with the drive within the band; empty before the third segment."""
        if self._drive is None or self._segments < 3:
            return {}
        power = np.maximum(self._auto * self._auto[self._drive], np.finfo(float).tiny)
        medians = np.median(np.abs(self._cross) ** 2 / power, axis=1)
        return {name: float(medians[k]) for k, name in enumerate(self._channels) if k != self._drive}
