"""One pass of Welch's method over all channels: auto and cross spectra, transfer functions, coherence, error bars.

Welch (1967) averages windowed segments. Segments are read in blocks, so a record on disk costs no more memory than one block,
and no segment reaches across a gap.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from analysis.errors import DataError
from analysis.measured import ComplexArray, FloatArray, Run

Estimator = Literal["H1", "H2", "Hv"]
#: Segments that are transformed at a time.
BLOCK = 8
OVERLAP = 0.5


@dataclass(frozen=True, kw_only=True)
class Frf:
    """A transfer function with its error bars.

    Parameters
    ----------
    response, reference
        Channel names: response over reference.
    frequency
        Hz, shape (lines,).
    value
        Complex, shape (lines,), in the response's unit over the reference's.
    coherence
        0 to 1, shape (lines,).
    magnitude_std, phase_std
        One standard deviation of the magnitude (in the unit of `value`) and of the phase (rad), shape (lines,).
    averages
        Effective number of independent averages.
    resolution
        Distance of lines, Hz.
    estimator
        "H1", "H2" or "Hv".
    """

    response: str
    reference: str
    frequency: FloatArray
    value: ComplexArray
    coherence: FloatArray
    magnitude_std: FloatArray
    phase_std: FloatArray
    averages: float
    resolution: float
    estimator: Estimator


@dataclass(frozen=True, kw_only=True)
class Spectra:
    """Averaged spectra of several channels, one-sided densities.

    Parameters
    ----------
    channels
        Names, in the order of the spectra.
    frequency
        Hz, shape (lines,).
    auto
        Power spectral densities, unit^2 / Hz, shape (channels, lines).
    cross
        Cross spectral densities conj(reference) * channel by reference, each shape (channels, lines).
    averages
        Effective number of independent averages: segments over 1 + 2 sum (1 - j/K) rho_j^2, rho_j the correlation of segments
        j apart (Welch 1967).
    segments
        Number of segments.
    resolution
        Distance of lines, Hz.
    """

    channels: tuple[str, ...]
    frequency: FloatArray
    auto: FloatArray
    cross: dict[str, ComplexArray] = field(repr=False)
    averages: float
    segments: int
    resolution: float

    def density(self, channel: str) -> FloatArray:
        """Power spectral density of a channel, unit^2 / Hz, shape (lines,)."""
        return np.asarray(self.auto[self.channels.index(channel)])

    def frf(self, response: str, reference: str, estimator: Estimator = "H1") -> Frf:
        """The transfer function from `reference` to `response`.

        H1 = Sxy / Sxx, H2 = Syy / Syx, Hv the total least squares estimate between (Rocklin, Crowley and Vold 1985).
        std of |H| is |H| sqrt((1 - g2) / (2 g2 n)), of the phase the same without |H| (Bendat and Piersol 2010, 9.2).

        Raises
        ------
        DataError
            Where the reference was not among those of the estimate.
        """
        if reference not in self.cross:
            raise DataError(f"{reference!r} is no reference of these spectra ({', '.join(self.cross)}); estimate them with it")
        sxx, syy = self.density(reference), self.density(response)
        sxy = self.cross[reference][self.channels.index(response)]
        tiny = np.finfo(float).tiny
        coherence = np.clip(np.abs(sxy) ** 2 / np.maximum(sxx * syy, tiny), 0.0, 1.0)
        h1 = sxy / np.maximum(sxx, tiny)
        if estimator == "H1":
            value = h1
        elif estimator == "H2":
            value = syy / np.where(sxy == 0.0, tiny, np.conj(sxy))
        else:
            value = _total_least_squares(sxx, syy, sxy)
        relative = np.sqrt((1.0 - coherence) / np.maximum(2.0 * coherence * self.averages, tiny))
        return Frf(
            response=response, reference=reference, frequency=self.frequency, value=np.asarray(value), coherence=coherence,
            magnitude_std=np.abs(value) * relative, phase_std=np.minimum(relative, np.pi), averages=self.averages,
            resolution=self.resolution, estimator=estimator,
        )  # fmt: skip


def _total_least_squares(sxx: FloatArray, syy: FloatArray, sxy: ComplexArray) -> ComplexArray:
    # The eigenvector of the larger eigenvalue of [[sxx, syx], [sxy, syy]].
    larger = 0.5 * (sxx + syy + np.sqrt((sxx - syy) ** 2 + 4.0 * np.abs(sxy) ** 2))
    return np.asarray(sxy / np.maximum(larger - syy, np.finfo(float).tiny))


def hann(length: int) -> FloatArray:
    """The periodic Hann window, shape (length,)."""
    return np.asarray(0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length))


def estimate(
    runs: Sequence[Run], *, references: Sequence[str], channels: Sequence[str] | None = None, resolution: float = 0.25
) -> Spectra:
    """Auto and cross spectra of runs, averaged over all of them: Hann window, half overlap, mean taken off each segment.

    Parameters
    ----------
    runs
        Runs of one sample rate.
    references
        Channels whose cross spectra with all others are kept.
    channels
        What is estimated; the channels of the first run where None.
    resolution
        Wanted distance of lines, Hz; the segment is the next even number of samples.

    Raises
    ------
    DataError
        Where the runs do not go together, lack a channel, or no stretch without a gap is as long as a segment.
    """
    if not runs:
        raise DataError("no run was given; name at least one")
    rate = runs[0].sample_rate
    other = next((run for run in runs if run.sample_rate != rate), None)
    if other is not None:
        raise DataError(
            f"run {other.id!r} has {other.sample_rate:g} samples/s and run {runs[0].id!r} {rate:g}; average runs of one rate only"
        )
    if not 0.0 < resolution <= rate / 8.0:
        raise DataError(f"a resolution of {resolution:g} Hz does not go with {rate:g} samples/s; give one up to {rate / 8:g} Hz")
    names = tuple(channels or (name for name, channel in runs[0].channels.items() if channel.quantity != "gain"))
    names = tuple(dict.fromkeys((*references, *names)))
    length = 2 * max(4, round(rate / resolution / 2.0))
    sums = _Sums(names, references, length)
    for run in runs:
        for start, stop in stretches(run):
            for block in _blocks(run, names, start, stop, length):
                sums.add(block)
    if sums.segments == 0:
        longest = max((stop - start for run in runs for start, stop in stretches(run)), default=0) / rate
        raise DataError(
            f"the longest stretch without a gap has {longest:.3g} s, but a resolution of {resolution:g} Hz needs "
            f"{length / rate:.3g} s; give a coarser resolution or measure longer"
        )
    return sums.spectra(rate)


def stretches(run: Run) -> Iterator[tuple[int, int]]:
    """First and last + 1 stored sample of each stretch of a run that no gap breaks."""
    start = lost = 0
    for gap in sorted(run.gaps, key=lambda gap: gap.first_tick):
        at = min(max(gap.first_tick - lost, start), len(run))
        if at > start:
            yield start, at
        start, lost = at, lost + gap.count
    if len(run) > start:
        yield start, len(run)


def _blocks(run: Run, names: Sequence[str], start: int, stop: int, length: int) -> Iterator[FloatArray]:
    # Segments of all channels, shape (channels, segments, length).
    hop = round(length * (1.0 - OVERLAP))
    count = (stop - start - length) // hop + 1 if stop - start >= length else 0
    for first in range(0, count, BLOCK):
        many = min(BLOCK, count - first)
        begin = start + first * hop
        end = begin + (many - 1) * hop + length
        rows = np.stack([run.channel(name).read(begin, end) for name in names])
        yield np.lib.stride_tricks.sliding_window_view(rows, length, axis=1)[:, ::hop]


class _Sums:
    """What is added up over segments."""

    def __init__(self, names: tuple[str, ...], references: Sequence[str], length: int) -> None:
        lines = length // 2 + 1
        self.names, self.references, self.length = names, tuple(references), length
        self.window = hann(length)
        self.auto = np.zeros((len(names), lines))
        self.cross = {name: np.zeros((len(names), lines), dtype=np.complex128) for name in references}
        self.segments = 0
        self.buffer = np.empty((BLOCK, length))

    def add(self, block: FloatArray) -> None:
        from scipy.fft import rfft

        many = block.shape[1]
        seen: dict[str, ComplexArray] = {}
        # References come first among the names, so that a channel meets all of them when its own turn comes.
        for row, name in enumerate(self.names):
            part = self.buffer[:many]
            np.subtract(block[row], block[row].mean(axis=1, keepdims=True), out=part)
            part *= self.window
            lines = rfft(part, axis=1)
            self.auto[row] += np.einsum("sf,sf->f", lines.real, lines.real) + np.einsum("sf,sf->f", lines.imag, lines.imag)
            if name in self.cross:
                seen[name] = np.conj(lines)
            for reference, conjugate in seen.items():
                self.cross[reference][row] += np.einsum("sf,sf->f", conjugate, lines)
        for row, name in enumerate(self.references):
            for column, later in enumerate(self.references[row + 1 :], row + 1):
                self.cross[later][row] = np.conj(self.cross[name][column])
        self.segments += many

    def spectra(self, rate: float) -> Spectra:
        scale = np.full(self.length // 2 + 1, 2.0 / (rate * (self.window**2).sum() * self.segments))
        scale[[0, -1]] /= 2.0
        return Spectra(
            channels=self.names, frequency=np.fft.rfftfreq(self.length, 1.0 / rate).astype(np.float64), auto=self.auto * scale,
            cross={name: values * scale for name, values in self.cross.items()},
            averages=effective_averages(self.window, self.segments, round(self.length * (1.0 - OVERLAP))),
            segments=self.segments, resolution=rate / self.length,
        )  # fmt: skip


def effective_averages(window: FloatArray, segments: int, hop: int) -> float:
    """Number of independent averages that overlapping segments are worth (Welch 1967)."""
    power, total = float((window**2).sum()), 1.0
    for j in range(1, min(segments, (len(window) - 1) // hop + 1)):
        shared = float((window[: len(window) - j * hop] * window[j * hop :]).sum()) / power
        total += 2.0 * (1.0 - j / segments) * shared**2
    return segments / total
