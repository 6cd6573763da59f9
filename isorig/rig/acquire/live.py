"""What a display shows of a running measurement: levels and coherence, advice on the levels, what the equations tell."""

import time
from collections.abc import Mapping

import msgspec
import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.spectra.windows import HANN
from isorig.drivers.block import Block
from isorig.drivers.instrument import Stream
from isorig.rig.acquire.layout import Layout
from isorig.rig.acquire.plan import RunPlan
from isorig.rig.acquire.policy import LARGE_SHARE, SMALL_SHARE
from isorig.rig.acquire.recorder import Tally

#: Seconds between two updates of the levels, and of a segment of the coherence.
LOOK, SEGMENT = 0.25, 2.0


class LiveState(msgspec.Struct, frozen=True, kw_only=True):
    """The live state of a run.

    rms and peak of each channel in its unit since the last update, its highest peak so far, its full scale if known, and the
    median coherence with the drive within its band so far. Then the number of the run, the number of runs, and the remaining
    seconds of the session.
    """

    run: str
    seconds: float
    of: float
    rms: dict[str, float]
    peak: dict[str, float]
    full_scale: dict[str, float]
    coherence: dict[str, float]
    overloads: int
    lost: int
    damaged: int
    highest: dict[str, float] = {}
    number: int = 1
    runs: int = 1
    left: float = 0.0


class EquationsReport(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the equations of motion tell of a run from its first `seconds`.

    The residual of each equation is over noise: about one if it holds, as it does up to `limit`. `known` is whether the answer is
    certain, `text` the answer in words, empty without one.
    """

    run: str
    seconds: float
    residuals: dict[str, float]
    limit: float
    known: bool
    text: str

    @property
    def sentence(self) -> str:
        """The answer in a sentence."""
        return f"{self.run}, from {self.seconds:.0f} s: {self.text or 'no answer yet'}" + (", certain" if self.known else "")


class BlockSummary:
    """Summarizes the blocks of a run between two updates."""

    def __init__(self, layout: Layout, run: RunPlan, instrument: Stream, drive: str) -> None:
        self._instrument, self._run, self._layout = instrument, run, layout
        self._full = {name: about.full_scale for name, about in layout.channels.items() if about.full_scale is not None}
        self._coherence = RunningCoherence(tuple(layout.channels), drive=drive, band=run.band, rate=layout.sample_rate)
        self._blocks: list[Block] = []
        self._seconds = 0.0
        self._highest = dict.fromkeys(layout.channels, 0.0)
        self._at = time.monotonic()

    def add(self, block: Block) -> bool:
        """Add a block; returns whether an update is due."""
        self._blocks.append(block)
        return time.monotonic() - self._at > LOOK

    def state(self, name: str, tally: Tally) -> LiveState:
        """The state since the last update."""
        values = {}
        if any(len(block.samples) for block in self._blocks):
            raw = np.concatenate([block.samples for block in self._blocks])
            values = {key: raw[:, about.input] * about.scale + about.offset for key, about in self._layout.channels.items()}
            self._coherence.add(values)
            self._seconds = self._blocks[-1].end_tick / self._layout.sample_rate
        self._blocks, self._at = [], time.monotonic()
        peak = {key: float(np.abs(v).max()) for key, v in values.items()}
        self._highest |= {key: max(self._highest[key], size) for key, size in peak.items()}
        return LiveState(
            run=name, seconds=min(self._seconds, self._run.seconds), of=self._run.seconds,
            rms={key: float(np.sqrt(np.mean(v**2))) for key, v in values.items()}, peak=peak, full_scale=self._full,
            coherence=self._coherence.medians(), overloads=tally.overloads, lost=tally.lost,
            damaged=getattr(self._instrument, "damaged", 0), highest=dict(self._highest),
        )  # fmt: skip


class RunningCoherence:
    """Accumulates spectra segment by segment (Welch without overlap, ignoring gaps, for display); `band` and `rate` in Hz."""

    def __init__(self, channels: tuple[str, ...], *, drive: str, band: tuple[float, float] | None, rate: float) -> None:
        self._channels = channels
        self._length = max(round(SEGMENT * rate), 16)
        frequency = np.fft.rfftfreq(self._length, 1.0 / rate)
        self._inside = np.zeros(len(frequency), bool) if band is None else (frequency >= band[0]) & (frequency <= band[1])
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


def shares(highest: Mapping[str, float], full_scale: Mapping[str, float]) -> dict[str, float]:
    """Highest peak divided by full scale, for each channel with a known full scale."""
    return {name: peak / full_scale[name] for name, peak in highest.items() if full_scale.get(name, 0.0) > 0.0}


def advice(highest: Mapping[str, float], full_scale: Mapping[str, float]) -> list[str]:
    """Advice on the levels, a sentence for each channel."""
    sentences = []
    for name, share in shares(highest, full_scale).items():
        if 0.0 < share < SMALL_SHARE:
            sentences.append(f"{name} uses {100.0 * share:.1g} % of its range: choose a smaller range or a higher gain.")
        elif share > LARGE_SHARE:
            sentences.append(f"{name} reaches {100.0 * share:.0f} % of its range: choose a larger range or a lower gain.")
    return sentences
