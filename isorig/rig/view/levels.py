"""Level of each channel: rms and peak of the last second, highest peak so far, overloads, and time trace."""

import msgspec
import numpy as np

from isorig.analysis.campaign import FloatArray, Run
from isorig.analysis.spectra.overload import FULL

#: Seconds of samples for rms and peak, and seconds of samples in a trace.
RECENT, SHOWN = 1.0, 4.0
#: Points of a trace: minimum and maximum of each of half as many equal intervals.
POINTS = 500
#: Samples of a channel that are read at once.
BLOCK = 1 << 16


class ChannelLevel(msgspec.Struct, frozen=True, kw_only=True):
    """One channel: rms, peak and highest peak of the run in its unit; full scale if known; whether it was reached."""

    name: str
    unit: str
    rms: float
    peak: float
    held: float
    full: float | None
    over: bool


class Levels:
    """The levels of a growing run; each sample is read once."""

    def __init__(self, run: Run) -> None:
        self._names = list(run.sensors)
        self._rate = run.sample_rate
        self._units = {name: run.channels[name].unit for name in self._names}
        self._full = {name: run.channels[name].full_scale for name in self._names}
        self._bin = max(round(2.0 * SHOWN * run.sample_rate / POINTS), 1)
        self._held = np.zeros(len(self._names))
        self._over = np.zeros(len(self._names), bool)
        self._recent = np.zeros((len(self._names), 0))
        self._first = self._second = np.zeros((len(self._names), 0))
        self.seen = 0

    def add(self, run: Run) -> None:
        """Read the new samples since the last call, up to a whole interval of the trace."""
        end = len(run) // self._bin * self._bin
        step = max(BLOCK // self._bin, 1) * self._bin
        while self.seen < end:
            stop = min(self.seen + step, end)
            self._block(np.stack([run.channels[name].read(self.seen, stop) for name in self._names]))
            self.seen = stop

    def levels(self) -> tuple[ChannelLevel, ...]:
        """The level of each channel."""
        recent = self._recent if self._recent.shape[1] else np.zeros((len(self._names), 1))
        rms, peak = np.sqrt(np.mean(recent**2, axis=1)), np.abs(recent).max(axis=1)
        return tuple(
            ChannelLevel(
                name=name, unit=self._units[name], rms=float(rms[k]), peak=float(peak[k]), held=float(self._held[k]),
                full=self._full[name], over=bool(self._over[k]),
            )
            for k, name in enumerate(self._names)
        )  # fmt: skip

    def close(self) -> None:
        """Release the samples of the last second; nothing more will be added."""
        self._recent = np.zeros((len(self._names), 0))

    def recent(self) -> dict[str, FloatArray]:
        """The samples of the last second by channel."""
        return dict(zip(self._names, self._recent, strict=True))

    def trace(self) -> FloatArray:
        """Time in seconds, and a row for each channel, shape (1 + channels, points); empty before the first interval."""
        count = self._first.shape[1]
        first = self.seen // self._bin - count
        seconds = (first + np.repeat(np.arange(count), 2) + np.tile([0.25, 0.75], count)) * self._bin / self._rate
        return np.vstack([seconds, np.stack([self._first, self._second], axis=2).reshape(len(self._names), -1)])

    def _block(self, values: FloatArray) -> None:
        sizes = np.abs(values).max(axis=1)
        self._held = np.maximum(self._held, sizes)
        limits = np.array([np.inf if full is None else FULL * full for full in self._full.values()])
        self._over |= sizes >= limits
        self._recent = np.concatenate([self._recent, values], axis=1)[:, -max(round(RECENT * self._rate), 1) :]
        binned = values.reshape(len(self._names), -1, self._bin)
        kept, low, high = POINTS // 2, binned.min(axis=2), binned.max(axis=2)
        # In the order in which they occur: otherwise a slow wave looks like stairs.
        rises = binned.argmin(axis=2) <= binned.argmax(axis=2)
        self._first = np.concatenate([self._first, np.where(rises, low, high)], axis=1)[:, -kept:]
        self._second = np.concatenate([self._second, np.where(rises, high, low)], axis=1)[:, -kept:]
