"""One pass of Welch's method over all channels: auto and cross spectra, transfer functions, coherence, error bars.

Welch (1967) averages windowed segments. Segments are read in blocks, so a record on disk costs no more memory than one block,
and no segment reaches across a gap.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from isorig.analysis.campaign import ComplexArray, FloatArray, Run
from isorig.analysis.errors import DataError
from isorig.analysis.spectra.groups import Grouping, Groups, Sums, group_size, joined
from isorig.analysis.spectra.inputs import Drives, Estimator, partial_coherence
from isorig.analysis.spectra.windows import HANN, OVERLAP_MOST, Window

#: Segments that are transformed at a time.
BLOCK = 8
OVERLAP = 0.5
#: With fewer averages nothing scatters: deviations are then given as large as the values.
FEWEST = 1.5
#: Arrays over the lines of a transfer function, beside the frequencies themselves.
FRF_ROWS = ("value", "coherence", "magnitude_std", "phase_std", "multiple_coherence")


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
    multiple_coherence
        Share of the response that all drives together explain, shape (lines,); None where there is one drive, whose
        `coherence` it is. With several, `coherence` is what this drive explains of what the others leave.
    units
        Of the response and of the reference; empty where unknown.
    window, overlap
        What the segments were seen through, and the share by which they overlap; no window where whole records were transformed
        that begin and end at rest.
    decay
        Rate of an exponential window on all channels, 1/s: values are those at s = decay + 2 pi i f.
    left_out
        The values at lines of the given frequencies (Hz, shape (lines,)) without each group of segments in turn, complex, shape
        (groups, lines): what the deviations of figures that are read off the lines come from. None where groups were not kept.
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
    multiple_coherence: FloatArray | None = None
    units: tuple[str, str] = ("", "")
    window: Window | None = HANN
    overlap: float = OVERLAP
    decay: float = 0.0
    left_out: Callable[[FloatArray], ComplexArray] | None = field(default=None, repr=False, compare=False)


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
    units
        Of the channels, in their order; empty where unknown.
    window, overlap
        What the segments were seen through, and the share by which they overlap; no window where whole records were transformed
        that begin and end at rest.
    decay
        Rate of an exponential window on all channels, 1/s: values are those at s = decay + 2 pi i f.
    groups
        The same spectra of consecutive groups of segments; None where they were not kept.
    """

    channels: tuple[str, ...]
    frequency: FloatArray
    auto: FloatArray
    cross: dict[str, ComplexArray] = field(repr=False)
    averages: float
    segments: int
    resolution: float
    units: tuple[str, ...] = ()
    window: Window | None = HANN
    overlap: float = OVERLAP
    decay: float = 0.0
    groups: Groups | None = field(default=None, repr=False, compare=False)

    def density(self, channel: str) -> FloatArray:
        """Power spectral density of a channel, unit^2 / Hz, shape (lines,)."""
        return np.asarray(self.auto[self.channels.index(channel)])

    def frf(self, response: str, reference: str, estimator: Estimator = "H1") -> Frf:
        """The transfer function from `reference` to `response`, where nothing else drives: `frfs` of one reference."""
        return self.frfs(response, (reference,), estimator)[0]

    def frfs(self, response: str, references: Sequence[str], estimator: Estimator = "H1") -> tuple[Frf, ...]:
        """The transfer functions from each of `references` to `response`, all of them driving at once.

        H1 = Sxy Sxx^-1, H2 = Syy / Syx, Hv the total least squares estimate between (Rocklin, Crowley and Vold 1985): equal
        noise in all channels where they have one unit, noise in proportion to each channel's rms where not.
        std of |H| is |H| sqrt((1 - g2) / (2 g2 n)), of the phase the same without |H| (Bendat and Piersol 2010, 9.2), g2 the
        partial coherence and n the averages less the other drives.

        Raises
        ------
        DataError
            Where a reference was not among those of the estimate, the drives cannot be separated, or H2 is asked of several.
        """
        for reference in references:
            if reference not in self.cross:
                raise DataError(
                    f"{reference!r} is no reference of these spectra ({', '.join(self.cross)}); estimate them with it"
                )
        if estimator == "H2" and len(references) > 1:
            raise DataError(
                f"H2 was asked of {len(references)} drives at once, where no response has one of its own; take H1 or Hv, or name "
                "one reference"
            )
        row = self.channels.index(response)
        matrix = np.stack([np.stack([self.cross[i][self.channels.index(j)] for j in references], -1) for i in references], -2)
        drives = Drives(matrix, tuple(references), self.averages)
        cross, power = np.stack([self.cross[name][row] for name in references], axis=-1), self.auto[row]
        h1 = drives.h1(cross)
        explained = np.minimum(drives.explained(cross), power)
        known = partial_coherence(h1, drives, power - explained)
        if estimator == "H1":
            value = h1
        elif estimator == "H2":
            value = power[:, None] / np.where(cross == 0.0, np.finfo(float).tiny, np.conj(cross))
        else:
            value = drives.hv(cross, power, self._scales((*references, response)))
        averages = self.averages - (len(references) - 1)
        relative = np.sqrt((1.0 - known) / np.maximum(2.0 * known * averages, np.finfo(float).tiny))
        if self.averages < FEWEST:
            relative = np.ones_like(relative)
        multiple = np.asarray(explained / np.maximum(power, np.finfo(float).tiny))
        return tuple(
            Frf(
                response=response, reference=name, frequency=self.frequency, value=np.asarray(value[:, j]),
                coherence=np.asarray(known[:, j]), magnitude_std=np.abs(value[:, j]) * relative[:, j],
                phase_std=np.minimum(relative[:, j], np.pi), averages=averages, resolution=self.resolution, estimator=estimator,
                multiple_coherence=multiple if len(references) > 1 else None, units=(self.unit(response), self.unit(name)),
                window=self.window, overlap=self.overlap, decay=self.decay,
                left_out=partial(_left_out, self, response, tuple(references), j, estimator) if self.groups else None,
            )
            for j, name in enumerate(references)
        )  # fmt: skip

    def without_groups(self, frequency: FloatArray) -> Iterator[Spectra]:
        """The spectra at lines of the given frequencies, Hz, without each group of segments in turn; nothing without groups."""
        lines = np.searchsorted(self.frequency, frequency - 0.5 * self.resolution)
        for left in self.groups.without(lines) if self.groups else ():
            yield replace(
                self, frequency=self.frequency[lines], auto=left.auto, cross=left.cross,
                averages=self.averages * left.segments / self.segments, segments=left.segments, groups=None,
            )  # fmt: skip

    def unit(self, channel: str) -> str:
        """The unit of a channel; empty where unknown."""
        return self.units[self.channels.index(channel)] if self.units else ""

    def _scales(self, channels: Sequence[str]) -> FloatArray:
        if len({self.unit(name) for name in channels}) == 1:
            return np.ones(len(channels))
        return np.array([np.sqrt(max(float(self.density(name).sum()), np.finfo(float).tiny)) for name in channels])


def _left_out(
    spectra: Spectra, response: str, references: tuple[str, ...], j: int, estimator: Estimator, frequency: FloatArray
) -> ComplexArray:  # fmt: skip
    return np.stack([part.frfs(response, references, estimator)[j].value for part in spectra.without_groups(frequency)])


def estimate(
    runs: Sequence[Run], *, references: Sequence[str], channels: Sequence[str] | None = None, resolution: float = 0.25,
    window: Window = HANN, overlap: float = OVERLAP,
) -> Spectra:  # fmt: skip
    """Auto and cross spectra of runs, averaged over all of them, the mean taken off each segment.

    Parameters
    ----------
    runs
        Runs; of several sample rates each rate is averaged by itself, then all on the lines that they have in common.
    references
        Channels whose cross spectra with all others are kept.
    channels
        What is estimated; the channels of the first run where None.
    resolution
        Wanted distance of lines, Hz; the segment is the next even number of samples.
    window, overlap
        What segments are seen through, and the share by which they overlap, 0 to `OVERLAP_MOST`.

    Raises
    ------
    DataError
        Where the runs lack a channel, the resolution does not go with a sample rate, or no stretch without a gap is as long as a
        segment.

    Examples
    --------
    >>> import isorig as iso
    >>> runs = iso.read("campaign.h5").select(configuration="locked", gain=7.0)
    >>> spectra = iso.estimate(runs, references=["table"], resolution=0.5)
    >>> frf = spectra.frf("heatblock", "table")
    >>> bool(abs(frf.frequency[abs(frf.value).argmax()] - 164.5) <= 1.0)
    True
    >>> spectra.density("table").shape == spectra.frequency.shape
    True
    """
    if not runs:
        raise DataError("no run was given; name at least one")
    if not 0.0 <= overlap <= OVERLAP_MOST:
        raise DataError(f"segments cannot overlap by {overlap:g} of their length; give a share of 0 to {OVERLAP_MOST:g}")
    names = tuple(channels or runs[0].sensors)
    names = tuple(dict.fromkeys((*references, *names)))
    slowest = min(run.sample_rate for run in runs)
    if not 0.0 < resolution <= slowest / 8.0:
        raise DataError(
            f"a resolution of {resolution:g} Hz does not go with {slowest:g} samples/s; give one up to {slowest / 8:g} Hz"
        )
    parts = []
    for rate in dict.fromkeys(run.sample_rate for run in runs):
        length = 2 * max(4, round(rate / resolution / 2.0))
        alike = [(run, *ends) for run in runs if run.sample_rate == rate for ends in stretches(run)]
        hop = _hop(length, overlap)
        count = sum(_segments(stop - start, length, hop) for _, start, stop in alike)
        sums = _Sums(names, references, length, group=group_size(count, BLOCK), window=window, overlap=overlap)
        for run, start, stop in alike:
            for block in _blocks(run, names, start, stop, length, hop):
                sums.add(block)
        if count:
            parts.append(sums.spectra(rate, _units(alike[0][0], names)))
    if not parts:
        longest = max((stop - start) / run.sample_rate for run in runs for start, stop in (*stretches(run), (0, 0)))
        raise DataError(
            f"the longest stretch without a gap has {longest:.3g} s, but a resolution of {resolution:g} Hz needs "
            f"{1.0 / resolution:.3g} s; give a coarser resolution or measure longer"
        )
    if len(parts) == 1:
        return parts[0]
    lines, spacing = common_lines(parts)
    return merged([_on_lines(part, lines, spacing) for part in parts])


def _units(run: Run, names: Sequence[str]) -> tuple[str, ...]:
    return tuple(run.channel(name).unit for name in names)


def common_lines(parts: Sequence[Spectra | Frf]) -> tuple[FloatArray, float]:
    """The lines (Hz) that spectra or transfer functions of several sample rates have in common, and their distance (Hz).

    They are those of the coarsest resolution, up to the lowest of the highest frequencies. Segments hold whole samples, so two
    rates may give resolutions that differ by one sample in a segment.
    """
    end = min(float(part.frequency[-1]) for part in parts)
    coarsest = max(parts, key=lambda part: part.resolution)
    return np.asarray(coarsest.frequency[coarsest.frequency <= end * (1.0 + 1e-9)]), coarsest.resolution


def frfs_on_common_lines(frfs: Sequence[Frf]) -> list[Frf]:
    """Transfer functions on the lines that they have in common, so that they can be compared line by line."""
    lines, spacing = common_lines(frfs)
    return [
        replace(
            frf, frequency=lines, resolution=spacing,
            **{
                name: _moved(frf.frequency, rows[None], lines)[0]
                for name in FRF_ROWS
                if (rows := getattr(frf, name)) is not None
            },
        )
        for frf in frfs
    ]  # fmt: skip


def _on_lines(part: Spectra, lines: FloatArray, spacing: float) -> Spectra:
    return replace(
        part, frequency=lines, resolution=spacing, auto=_moved(part.frequency, part.auto, lines),
        cross={name: _moved(part.frequency, rows, lines) for name, rows in part.cross.items()},
        groups=part.groups.moved(lambda rows: _moved(part.frequency, rows, lines)) if part.groups else None,
    )  # fmt: skip


def _moved(frequency: FloatArray, rows: Any, lines: FloatArray) -> Any:
    # Rows over `frequency` as they are on `lines`: cut where the lines are the same, else joined by straight lines.
    if len(frequency) >= len(lines) and np.allclose(frequency[: len(lines)], lines, rtol=1e-9, atol=0.0):
        return rows[:, : len(lines)]
    return np.stack([np.interp(lines, frequency, row) for row in rows])


class RunningSpectra:
    """Auto and cross spectra of a run that is still growing: at its end, those that `estimate` gives of the whole.

    Parameters
    ----------
    run
        The run as far as it has got; its channels are estimated.
    references
        Channels whose cross spectra with all others are kept.
    resolution
        Wanted distance of lines, Hz, as in `estimate`.
    highest
        Lines above this frequency are not kept, Hz; all are where None.
    """

    def __init__(self, run: Run, *, references: Sequence[str], resolution: float, highest: float | None = None) -> None:
        names = dict.fromkeys((*references, *run.sensors))
        self._length, self._rate = 2 * max(4, round(run.sample_rate / resolution / 2.0)), run.sample_rate
        lines = None if highest is None else int(highest * self._length / self._rate) + 1
        self._sums = _Sums(tuple(names), references, self._length, lines)
        self._units = _units(run, tuple(names))
        self._next = 0

    def add(self, run: Run) -> None:
        """Add the segments that have been completed since the last call."""
        for start, stop in stretches(run):
            self._next = max(start, self._next)
            for block in _blocks(run, self._sums.names, self._next, stop, self._length, self._sums.hop):
                self._sums.add(block)
                # Block by block: where one cannot be read now, the next call goes on with it.
                self._next += block.shape[1] * self._sums.hop

    @property
    def segments(self) -> int:
        """Segments that have been added."""
        return self._sums.segments + self._sums.group.segments

    def spectra(self) -> Spectra:
        """The spectra so far; at least one segment is needed."""
        return self._sums.spectra(self._rate, self._units)


def merged(parts: Sequence[Spectra]) -> Spectra:
    """The average of spectra of the same channels and lines, each weighted by its segments.

    Raises
    ------
    DataError
        Where they have other channels or lines.
    """
    first = parts[0]
    if any(part.channels != first.channels or not np.array_equal(part.frequency, first.frequency) for part in parts):
        raise DataError("the spectra have other channels or lines; average spectra of the same only")
    weights = np.array([part.segments for part in parts]) / sum(part.segments for part in parts)
    return replace(
        first, auto=np.asarray(sum(w * part.auto for w, part in zip(weights, parts, strict=True))),
        cross={
            name: np.asarray(sum(w * part.cross[name] for w, part in zip(weights, parts, strict=True))) for name in first.cross
        },
        averages=sum(part.averages for part in parts), segments=sum(part.segments for part in parts),
        groups=joined([part.groups for part in parts]),
    )  # fmt: skip


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


def _hop(length: int, overlap: float = OVERLAP) -> int:
    return max(1, round(length * (1.0 - overlap)))


def _segments(samples: int, length: int, hop: int) -> int:
    return (samples - length) // hop + 1 if samples >= length else 0


def _blocks(run: Run, names: Sequence[str], start: int, stop: int, length: int, hop: int) -> Iterator[FloatArray]:
    # Segments of all channels, shape (channels, segments, length).
    count = _segments(stop - start, length, hop)
    for first in range(0, count, BLOCK):
        many = min(BLOCK, count - first)
        begin = start + first * hop
        end = begin + (many - 1) * hop + length
        rows = np.stack([run.channel(name).read(begin, end) for name in names])
        yield np.lib.stride_tricks.sliding_window_view(rows, length, axis=1)[:, ::hop]


class _Sums:
    """What is added up over segments, of the first `lines` lines (all where None), in groups of so many segments at first."""

    def __init__(
        self, names: tuple[str, ...], references: Sequence[str], length: int, lines: int | None = None, group: int = 1, *,
        window: Window = HANN, overlap: float = OVERLAP,
    ) -> None:  # fmt: skip
        self.lines = lines = min(length // 2 + 1, lines or length)
        self.names, self.references, self.length = names, tuple(references), length
        self.seen_through, self.overlap, self.hop = window, overlap, _hop(length, overlap)
        self.window = window.samples(length)
        self.auto = np.zeros((len(names), lines))
        self.cross = {name: np.zeros((len(names), lines), dtype=np.complex128) for name in references}
        self.segments = 0
        self.buffer = np.empty((BLOCK, length))
        # Of the group that is being added to; what is above is of those before it.
        self.grouping = Grouping(group)
        self.group = Sums(0, np.zeros_like(self.auto), {name: np.zeros_like(values) for name, values in self.cross.items()})

    def add(self, block: FloatArray) -> None:
        many = block.shape[1]
        start = 0
        while start < many:
            stop = min(many, start + self.grouping.size - self.group.segments)
            self._add(block[:, start:stop])
            start = stop
            if self.group.segments == self.grouping.size:
                self._close()

    def _add(self, block: FloatArray) -> None:
        from scipy.fft import rfft

        many, auto, cross = block.shape[1], self.group.auto, self.group.cross
        seen: dict[str, ComplexArray] = {}
        # References come first among the names, so that a channel meets all of them when its own turn comes.
        for row, name in enumerate(self.names):
            part = self.buffer[:many]
            np.subtract(block[row], block[row].mean(axis=1, keepdims=True), out=part)
            part *= self.window
            lines = rfft(part, axis=1)[:, : self.lines]
            auto[row] += np.einsum("sf,sf->f", lines.real, lines.real) + np.einsum("sf,sf->f", lines.imag, lines.imag)
            if name in cross:
                seen[name] = np.conj(lines)
            for reference, conjugate in seen.items():
                cross[reference][row] += np.einsum("sf,sf->f", conjugate, lines)
        self.group.segments += many

    def _close(self) -> None:
        # The group is full: it is kept for itself, and added to the whole.
        self.segments += self.group.segments
        self.auto += self.group.auto
        for name in self.references:
            self.cross[name] += self.group.cross[name]
        self.grouping.add(self._mirrored(self.group).single())
        self.group.clear()

    def _mirrored(self, sums: Sums) -> Sums:
        # The cross spectra of two references are each other's conjugates; only one of them has been added up.
        for row, name in enumerate(self.references):
            for column, later in enumerate(self.references[row + 1 :], row + 1):
                sums.cross[later][row] = np.conj(sums.cross[name][column])
        return sums

    def spectra(self, rate: float, units: tuple[str, ...]) -> Spectra:
        each = np.full(self.length // 2 + 1, 2.0 / (rate * (self.window**2).sum()))
        each[[0, -1]] /= 2.0
        each, frequency = each[: self.lines], np.fft.rfftfreq(self.length, 1.0 / rate)[: self.lines]
        segments = self.segments + self.group.segments
        whole = self._mirrored(Sums(self.segments, self.auto, self.cross).plus(self.group))
        return Spectra(
            channels=self.names, frequency=frequency.astype(np.float64), auto=whole.auto * each / segments,
            cross={name: values * each / segments for name, values in whole.cross.items()},
            averages=effective_averages(self.window, segments, self.hop), segments=segments, resolution=rate / self.length,
            groups=self.grouping.groups(self._mirrored(self.group).single(), each), units=units, window=self.seen_through,
            overlap=self.overlap,
        )  # fmt: skip


def averages_in(samples: int, length: int) -> float:
    """Number of independent averages that a record of so many samples without a gap is worth, in segments of `length`."""
    hop = _hop(length)
    count = _segments(samples, length, hop)
    return effective_averages(HANN.samples(length), count, hop) if count else 0.0


def effective_averages(window: FloatArray, segments: int, hop: int) -> float:
    """Number of independent averages that overlapping segments are worth (Welch 1967)."""
    power, total = float((window**2).sum()), 1.0
    for j in range(1, min(segments, (len(window) - 1) // hop + 1)):
        shared = float((window[: len(window) - j * hop] * window[j * hop :]).sum()) / power
        total += 2.0 * (1.0 - j / segments) * shared**2
    return segments / total
