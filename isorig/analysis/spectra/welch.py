"""Welch's method in one pass over all channels: auto and cross spectra, transfer functions, coherence, error bars.

Welch (1967) averages windowed segments. Segments are read in blocks, so a record on disk needs the memory of one block only, and
no segment crosses a gap.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any, get_args

import numpy as np

from isorig.analysis.campaign import BoolArray, ComplexArray, FloatArray, IntArray, Run, given_runs
from isorig.analysis.errors import DataError
from isorig.analysis.given import channel_names, flag, number, of_type, one_of, text, whole
from isorig.analysis.parallel import cores, side_by_side
from isorig.analysis.spectra.estimators import Drives, Estimator
from isorig.analysis.spectra.segment_groups import FEWEST_GROUPS, MOST, Grouping, Groups, Sums, group_bytes, group_size, joined
from isorig.analysis.spectra.windows import HANN, OVERLAP_MOST, Window
from isorig.analysis.views import Viewed

#: Samples of the segments that are transformed at a time, and of those that are multiplied: with fewer, calls take a large share
#: of the time; more leave the processor's caches. Chosen as the fastest with segments of 2048 and of 8192 samples.
AT_ONCE, CACHED = 3 << 16, 1 << 15
#: Number of responses for which another thread is worthwhile.
SHARE = 8
#: Segments of which a group consists, or of equal parts of them.
BLOCK = 8
OVERLAP = 0.5
#: With fewer averages there is no scatter: the standard deviations are then set to the size of the values.
FEWEST = 1.5
#: Share of the largest power density of a drive below which a frequency is not driven, and below which it is driven too weakly
#: for the coherence to be judged. Chosen.
DRIVEN, WELL_DRIVEN = 1e-4, 1e-2
#: Bins on each side of a line that a Hann window's main lobe reaches.
LOBE = 2
#: Arrays over frequency of a transfer function, other than the frequencies themselves.
FRF_ROWS = ("value", "coherence", "magnitude_std", "phase_std", "multiple_coherence")


@dataclass(frozen=True, kw_only=True)
class Frf(Viewed):
    """A transfer function with its error bars.

    Parameters
    ----------
    response, reference
        Channel names: response over reference.
    frequency
        Hz, shape (bins,).
    value
        Complex, shape (bins,), in the response's unit divided by the reference's.
    coherence
        0 to 1, shape (bins,).
    magnitude_std, phase_std
        One standard deviation of the random error of the magnitude (in the unit of `value`) and of the phase (rad), shape
        (bins,); `isorig.analysis.spectra.magnitude_limits` adds leakage and noise on the reference.
    averages
        Effective number of independent averages.
    resolution
        Frequency resolution, Hz.
    estimator
        "H1", "H2" or "Hv".
    multiple_coherence
        Share of the response explained by all drives together, shape (bins,); None for one drive, for which it equals
        `coherence`. With several, `coherence` is the share explained by this drive of what the others leave.
    units
        Of the response and of the reference; empty if unknown.
    window, overlap
        Window of the segments, and their relative overlap; no window for transforms of whole records that start and end at rest.
    decay
        Rate of an exponential window on all channels, 1/s: values are those at s = decay + 2 pi i f.
    group_changes
        The changes of the values in the bins of the given frequencies (Hz, shape (bins,)) due to each group of segments, complex,
        shape (groups, bins): the sum of their squares is the variance. None if groups were not stored.
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
    group_changes: Callable[[FloatArray], ComplexArray] | None = field(default=None, repr=False, compare=False)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.in_words})"

    @property
    def in_words(self) -> str:
        """Channels, estimator, frequencies and averages."""
        f = self.frequency
        band = f"{f[0]:.4g} to {f[-1]:.4g} Hz in steps of {self.resolution:.3g} Hz" if len(f) else "no frequencies"
        return f"{self.response} over {self.reference}, {self.estimator}, {band}, {self.averages:.0f} averages"

    def bins(self, kept: IntArray | BoolArray | slice) -> Frf:
        """The same in some of its frequency bins."""
        plain = {item.name: getattr(self, item.name) for item in fields(Frf)}
        rows = {name: plain[name][kept] for name in ("frequency", *FRF_ROWS) if plain[name] is not None}
        return Frf(**(plain | rows))

    def within(self, band: tuple[float, float]) -> Frf:
        """The same in the frequency bins of a band, Hz."""
        return self.bins((self.frequency >= band[0]) & (self.frequency <= band[1]))


@dataclass(frozen=True, kw_only=True)
class Spectra:
    """Averaged spectra of several channels, one-sided densities.

    Parameters
    ----------
    channels
        Names, in the order of the spectra.
    frequency
        Hz, shape (bins,).
    auto
        Power spectral densities, unit^2 / Hz, shape (channels, bins).
    cross
        Cross spectral densities conj(reference) * channel by reference, each shape (channels, bins).
    averages
        Effective number of independent averages: segments divided by 1 + 2 sum (1 - j/K) rho_j^2, with rho_j the correlation of
        segments j apart (Welch 1967).
    segments
        Number of segments.
    resolution
        Frequency resolution, Hz.
    units
        Of the channels, in their order; empty if unknown.
    window, overlap
        Window of the segments, and their relative overlap; no window for transforms of whole records that start and end at rest.
    decay
        Rate of an exponential window on all channels, 1/s: values are those at s = decay + 2 pi i f.
    groups
        The same spectra of consecutive groups of segments; None if they were not stored.
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

    def __repr__(self) -> str:
        over = f"0 to {self.frequency[-1]:g} Hz in steps of {self.resolution:g} Hz, {self.averages:.3g} averages"
        return f"Spectra({', '.join(self.channels)} over {', '.join(self.cross)}, {over})"

    def density(self, channel: str) -> FloatArray:
        """Power spectral density of a channel, unit^2 / Hz, shape (bins,).

        Raises
        ------
        ArgumentError
            Its name is no text.
        DataError
            These spectra do not have it.
        """
        return np.asarray(self.auto[self._row(channel)])

    def _row(self, channel: str) -> int:
        text(channel, "the name of a channel", self.channels[-1])
        if channel not in self.channels:
            raise DataError(
                f"{channel!r} is not a channel of these spectra ({', '.join(self.channels)}); give one, or estimate them with it"
            )
        return self.channels.index(channel)

    def extent(self, channel: str) -> tuple[float, float]:
        """The lowest and the highest frequency at which a channel has power, Hz; not zero and its neighbour, where means leak,
        nor the bins next to its band, into which the window leaks."""
        frequency, density = self.frequency[2:], self.density(channel)[2:]
        driven = np.flatnonzero(density >= DRIVEN * density.max())
        first, last = int(driven[0]), int(driven[-1])
        inside = first + LOBE * (first > 0), last - LOBE * (last < len(density) - 1)
        low, high = frequency[list(inside if inside[0] < inside[1] else (first, last))]
        return float(low), float(high)

    def frf(self, response: str, reference: str, estimator: Estimator = "H1") -> Frf:
        """The transfer function from `reference` to `response` with a single drive: `frfs` of one reference."""
        return self.frfs(response, (text(reference, "the reference", self.channels[0]),), estimator)[0]

    def frfs(self, response: str, references: Sequence[str], estimator: Estimator = "H1") -> tuple[Frf, ...]:
        """The transfer functions from each of `references` to `response`, with all of them driving at once.

        H1 = Sxy Sxx^-1, H2 = Syy / Syx, Hv the total least squares estimate between (Rocklin, Crowley and Vold 1985): equal noise
        on all channels if they have one unit, otherwise noise proportional to each channel's rms. The standard deviation of |H|
        is |H| sqrt((1 - g2) / (2 g2 n)), of the phase the same without |H| (Bendat and Piersol 2010, 9.2), with g2 the partial
        coherence and n the averages minus the number of other drives.

        Raises
        ------
        ArgumentError
            An argument is of another type.
        DataError
            There is no reference, a channel is not among those of the estimate, the drives cannot be separated, or H2 is
            requested for several.
        """
        references, row = channel_names(references, "the argument references"), self._row(response)
        one_of(estimator, get_args(Estimator), "the estimator")
        if not references:
            raise DataError("no reference was given; give one of " + ", ".join(self.cross))
        for reference in references:
            if reference not in self.cross:
                raise DataError(
                    f"{reference!r} is not a reference of these spectra ({', '.join(self.cross)}); estimate them with it"
                )
        if estimator == "H2" and len(references) > 1:
            raise DataError(
                f"H2 was requested for {len(references)} simultaneous drives, for which it is not defined; use H1 or Hv, or name "
                "one reference"
            )
        matrix = np.stack([np.stack([self.cross[i][self.channels.index(j)] for j in references], -1) for i in references], -2)
        drives = Drives(matrix, tuple(references), self.averages)
        cross, power = np.stack([self.cross[name][row] for name in references], axis=-1), self.auto[row]
        h1 = drives.h1(cross)
        explained = np.minimum(np.einsum("ki,ki->k", np.conj(cross), h1).real, power)
        known = drives.partial_coherence(h1, power - explained)
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
                group_changes=partial(_group_changes, self, response, tuple(references), j, estimator) if self.groups else None,
            )
            for j, name in enumerate(references)
        )  # fmt: skip

    def unit(self, channel: str) -> str:
        """The unit of a channel; empty if unknown."""
        row = self._row(channel)
        return self.units[row] if self.units else ""

    def _scales(self, channels: Sequence[str]) -> FloatArray:
        if len({self.unit(name) for name in channels}) == 1:
            return np.ones(len(channels))
        return np.array([np.sqrt(max(float(self.density(name).sum()), np.finfo(float).tiny)) for name in channels])


def _group_changes(
    spectra: Spectra, response: str, references: tuple[str, ...], j: int, estimator: Estimator, frequency: FloatArray
) -> ComplexArray:
    # Leaving a group out changes the estimate by 1 / (1 - h) times its contribution, h being its share of the power. The root
    # of that factor makes the sum of squares unbiased (HC2 of MacKinnon and White 1985).
    row, lines = spectra.channels.index(references[j]), np.searchsorted(spectra.frequency, frequency - 0.5 * spectra.resolution)
    whole, power = spectra.frfs(response, references, estimator)[j].value[lines], spectra.auto[row, lines] * spectra.segments
    changed = []
    for left in spectra.groups.without(lines) if spectra.groups else ():
        part = replace(
            spectra, frequency=spectra.frequency[lines], auto=left.auto, cross=dict(left.cross),
            averages=spectra.averages * left.segments / spectra.segments, segments=left.segments, groups=None,
        )  # fmt: skip
        rest = np.sqrt(left.auto[row] * left.segments / np.maximum(power, np.finfo(float).tiny))
        changed.append((part.frfs(response, references, estimator)[j].value - whole) * rest)
    return np.stack(changed)


def estimate(
    runs: Sequence[Run], *, references: Sequence[str], channels: Sequence[str] | None = None, resolution: float = 0.25,
    window: Window = HANN, overlap: float = OVERLAP, jackknife: bool = True, longest: int | None = None,
) -> Spectra:  # fmt: skip
    """Auto and cross spectra, averaged over all runs, with the mean of each segment removed.

    Parameters
    ----------
    runs
        Runs; those of each sample rate are averaged first, then all in their common frequency bins.
    references
        Channels whose cross spectra with all others are computed.
    channels
        The channels to estimate; those of the first run if None.
    resolution
        Requested frequency resolution, Hz; the segment is the next even number of samples.
    window, overlap
        Window of the segments, and their relative overlap, 0 to `OVERLAP_MOST`.
    jackknife
        Whether groups of segments are kept for the uncertainty of modes; without them it takes less time and memory.
    longest
        Samples from the start of each run that are used; all if None.

    Raises
    ------
    ArgumentError
        An argument is of another type.
    DataError
        The runs lack a channel, the resolution does not suit a sample rate, or no interval without a gap is as long as a segment.

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
    runs, references = given_runs(runs), channel_names(references, "the argument references")
    channels = None if channels is None else channel_names(channels, "the argument channels")
    resolution, overlap = number(resolution, "the resolution"), number(overlap, "the overlap")
    of_type(window, Window, "the window", "a Window; leave it out, or give iso.frf the name of a window")
    longest, jackknife = None if longest is None else whole(longest, "the argument longest", 1), flag(jackknife, "the jackknife")
    if not runs:
        raise DataError("no run was given; give at least one")
    if not 0.0 <= overlap <= OVERLAP_MOST:
        raise DataError(f"segments cannot overlap by {overlap:g} of their length; give a share of 0 to {OVERLAP_MOST:g}")
    names = tuple(channels or runs[0].sensors)
    names = tuple(dict.fromkeys((*references, *names)))
    slowest = min(run.sample_rate for run in runs)
    if not 0.0 < resolution <= slowest / 8.0:
        raise DataError(
            f"a resolution of {resolution:g} Hz does not suit {slowest:g} samples/s; give one up to {slowest / 8:g} Hz"
        )
    parts = []
    for rate in dict.fromkeys(run.sample_rate for run in runs):
        length = segment_length(rate, resolution)
        alike = [(run, *ends) for run in runs if run.sample_rate == rate for ends in stretches(run, longest)]
        hop = _hop(length, overlap)
        count = sum(_segments(stop - start, length, hop) for _, start, stop in alike)
        group = group_size(count, BLOCK) if jackknife else count + 1
        sums = _Sums(names, references, length, group=group, window=window, overlap=overlap)
        for run, start, stop in alike:
            blocks = _Blocks(run, sums, start, stop)
            for many in blocks:
                sums.add(blocks, many)
        if count:
            parts.append(sums.spectra(rate, _units(alike[0][0], names), finished=True))
    if not parts:
        seconds = max((stop - start) / run.sample_rate for run in runs for start, stop in (*stretches(run), (0, 0)))
        raise DataError(
            f"the longest interval without a gap has {seconds:.3g} s, but a resolution of {resolution:g} Hz needs "
            f"{1.0 / resolution:.3g} s; give a coarser resolution or measure longer"
        )
    if len(parts) == 1:
        return parts[0]
    lines, spacing = common_bins(parts)
    return merged([_on_lines(part, lines, spacing) for part in parts])


def _units(run: Run, names: Sequence[str]) -> tuple[str, ...]:
    return tuple(run.channel(name).unit for name in names)


def common_bins(parts: Sequence[Spectra | Frf]) -> tuple[FloatArray, float]:
    """The frequency bins (Hz) common to spectra or transfer functions with several sample rates, and their distance (Hz).

    They have the coarsest resolution, up to the lowest of the highest frequencies. Segments consist of whole samples, so the
    resolutions of two rates may differ by one sample in a segment.
    """
    end = min(float(part.frequency[-1]) for part in parts)
    coarsest = max(parts, key=lambda part: part.resolution)
    return np.asarray(coarsest.frequency[coarsest.frequency <= end * (1.0 + 1e-9)]), coarsest.resolution


def frfs_in_common_bins(frfs: Sequence[Frf]) -> list[Frf]:
    """Transfer functions in their common frequency bins, so that they can be compared."""
    lines, spacing = common_bins(frfs)
    return [
        replace(
            frf,
            frequency=lines,
            resolution=spacing,
            **{
                name: _moved(frf.frequency, rows[None], lines)[0] for name in FRF_ROWS if (rows := getattr(frf, name)) is not None
            },
        )
        for frf in frfs
    ]


def _on_lines(part: Spectra, lines: FloatArray, spacing: float) -> Spectra:
    return replace(
        part, frequency=lines, resolution=spacing, auto=_moved(part.frequency, part.auto, lines),
        cross={name: _moved(part.frequency, rows, lines) for name, rows in part.cross.items()},
        groups=part.groups.moved(lambda rows: _moved(part.frequency, rows, lines)) if part.groups else None,
    )  # fmt: skip


def _moved(frequency: FloatArray, rows: Any, lines: FloatArray) -> Any:
    # Rows over `frequency` converted to `lines`: cut if the bins are the same, otherwise interpolated linearly.
    if len(frequency) >= len(lines) and np.allclose(frequency[: len(lines)], lines, rtol=1e-9, atol=0.0):
        return rows[:, : len(lines)]
    return np.stack([np.interp(lines, frequency, row) for row in rows])


class RunningSpectra:
    """Auto and cross spectra of a growing run: at its end, equal to those that `estimate` gives for the whole.

    Parameters
    ----------
    run
        The samples of the run that have been measured; its channels are estimated.
    references
        Channels whose cross spectra with all others are computed.
    resolution
        Requested frequency resolution, Hz, as in `estimate`.
    highest
        Bins above this frequency are not stored, Hz; all are if None.
    memory
        Bytes that the groups of segments may take; with fewer groups, the error bars are less certain.
    """

    def __init__(
        self, run: Run, *, references: Sequence[str], resolution: float, highest: float | None = None, memory: int | None = None
    ) -> None:
        names = dict.fromkeys((*references, *run.sensors))
        self._length, self._rate = segment_length(run.sample_rate, resolution), run.sample_rate
        lines = None if highest is None else int(highest * self._length / self._rate) + 1
        size = group_bytes(len(names), len(references), min(self._length // 2 + 1, lines or self._length))
        groups = MOST if memory is None else min(max(memory // size // 2 * 2, FEWEST_GROUPS), MOST)
        self._sums = _Sums(tuple(names), references, self._length, lines, groups=groups)
        self._units = _units(run, tuple(names))
        self._next = 0

    def add(self, run: Run) -> None:
        """Add the segments that have been completed since the last call."""
        for start, stop in stretches(run):
            self._next = max(start, self._next)
            blocks = _Blocks(run, self._sums, self._next, stop, ahead=True)
            for many in blocks:
                self._sums.add(blocks, many)
                # Block by block: if one cannot be read now, the next call continues with it.
                self._next += many * self._sums.hop

    @property
    def segments(self) -> int:
        """Number of segments so far."""
        return self._sums.segments

    def spectra(self) -> Spectra:
        """The spectra so far; at least one segment is needed."""
        return self._sums.spectra(self._rate, self._units)


def merged(parts: Sequence[Spectra]) -> Spectra:
    """The average of spectra with the same channels and bins, weighted by their segments. Raises DataError if they have different
    channels or bins."""
    first = parts[0]
    if any(part.channels != first.channels or not np.array_equal(part.frequency, first.frequency) for part in parts):
        raise DataError("the spectra have different channels or frequency bins; average compatible spectra only")
    weights = np.array([part.segments for part in parts]) / sum(part.segments for part in parts)
    return replace(
        first, auto=np.asarray(sum(w * part.auto for w, part in zip(weights, parts, strict=True))),
        cross={
            name: np.asarray(sum(w * part.cross[name] for w, part in zip(weights, parts, strict=True))) for name in first.cross
        },
        averages=sum(part.averages for part in parts), segments=sum(part.segments for part in parts),
        groups=joined([part.groups for part in parts]),
    )  # fmt: skip


def stretches(run: Run, longest: int | None = None) -> Iterator[tuple[int, int]]:
    """First and last + 1 stored sample of each interval without a gap of a run, or of its first `longest` samples."""
    start, lost, end = 0, 0, min(len(run), longest or len(run))
    for gap in sorted(run.gaps, key=lambda gap: gap.first_tick):
        at = min(max(gap.first_tick - lost, start), end)
        if at > start:
            yield start, at
        start, lost = at, lost + gap.count
    if end > start:
        yield start, end


def segment_length(rate: float, resolution: float) -> int:
    """Samples of a segment for a requested resolution, both in Hz: an even number."""
    return 2 * max(4, round(rate / resolution / 2.0))


def _hop(length: int, overlap: float = OVERLAP) -> int:
    return max(1, round(length * (1.0 - overlap)))


def _segments(samples: int, length: int, hop: int) -> int:
    return (samples - length) // hop + 1 if samples >= length else 0


class _Buffer:
    """Samples of one channel, and their segments: finding these takes longer than their mean."""

    def __init__(self, segments: int, length: int, hop: int) -> None:
        self.values = np.empty(segments * hop + length - hop)
        self.segments = np.lib.stride_tricks.sliding_window_view(self.values, length)[::hop]


class _Blocks:
    """Segments of the channels of an interval in blocks; every sample is read once, and no channel is stored whole.

    Iterating gives the number of segments of each block; `segments` then gives those of each channel. With `ahead` all channels
    of a block are read before the block is given, so that no block is incomplete if one cannot be read.
    """

    def __init__(self, run: Run, sums: _Sums, start: int, stop: int, *, ahead: bool = False) -> None:
        self._channels = [run.channel(name) for name in sums.names]
        self._sums, self._start = sums, start
        self._count = _segments(stop - start, sums.length, sums.hop)
        most = min(_at_once(sums.length), self._count)
        self._ahead = [_Buffer(most, sums.length, sums.hop) for _ in self._channels if ahead and most]
        #: What the last segment of a block shares with the first one of the next block.
        self._kept = np.empty((len(self._channels), sums.length - sums.hop))
        self._first, self._given, self._many = 0, 0, 0

    def __iter__(self) -> Iterator[int]:
        while self._first < self._count:
            many = min(_at_once(self._sums.length), self._count - self._first)
            for row, buffer in enumerate(self._ahead):
                self._read(row, many, buffer)
            if not self._ahead:
                many = min(many, self._sums.room)
            self._given = 0
            while self._given < many:
                self._many = min(many - self._given, self._sums.room)
                yield self._many
                self._given += self._many
            self._first += many

    def segments(self, row: int, buffer: _Buffer) -> FloatArray:
        """The segments of a channel, shape (segments, length); in `buffer`, unless all channels have been read."""
        if self._ahead:
            buffer = self._ahead[row]
        else:
            self._read(row, self._many, buffer)
        return buffer.segments[self._given : self._given + self._many]

    def _read(self, row: int, many: int, buffer: _Buffer) -> None:
        values, kept, hop = buffer.values, self._kept[row], self._sums.hop
        begin, size, held = self._start + self._first * hop, many * hop + len(kept), len(kept) if self._first else 0
        values[:held] = kept[:held]
        self._channels[row].read_into(values[held:size], begin + held)
        kept[:] = values[many * hop : size]


def _at_once(length: int) -> int:
    return max(1, AT_ONCE // length)


class _Work:
    """What one thread needs for a channel: memory that is new for each block would take longer than the transform."""

    def __init__(self, length: int, hop: int, lines: int) -> None:
        most = _at_once(length)
        self.buffer = _Buffer(most, length, hop)
        self.windowed = np.empty((most, length))
        self.transformed = np.empty((most, length // 2 + 1), dtype=np.complex128)
        self.products = np.empty((max(1, CACHED // length), lines), dtype=np.complex128)
        self.product, self.squares, self.power = np.empty(lines, dtype=np.complex128), np.empty(2 * lines), np.empty(lines)


class _Sums:
    """Sums over segments, for the first `lines` bins (all if None), in groups of initially `size` segments."""

    def __init__(
        self, names: tuple[str, ...], references: Sequence[str], length: int, lines: int | None = None, group: int = 1, *,
        window: Window = HANN, overlap: float = OVERLAP, groups: int = MOST,
    ) -> None:  # fmt: skip
        self.lines = lines = min(length // 2 + 1, lines or length)
        self.names, self.references, self.length = names, tuple(references), length
        self.seen_through, self.overlap, self.hop = window, overlap, _hop(length, overlap)
        self.window = window.samples(length)
        responses = range(len(self.references), len(names))
        threads = max(1, min(cores(), len(responses) // SHARE))
        #: The responses of each thread, and its arrays.
        self._shares = [(responses[k::threads], _Work(length, self.hop, lines)) for k in range(threads)]
        #: Transforms of the references in the current block, conjugated when they have been added.
        self._conjugates = {name: np.empty((_at_once(length), length // 2 + 1), dtype=np.complex128) for name in references}
        # Of the current group, and of all groups before it.
        self.grouping = Grouping(group, groups)
        self.earlier: Sums | None = None
        self.group = Sums.of(len(names), lines, self.references)

    @property
    def segments(self) -> int:
        """Number of segments so far."""
        return self.group.segments + (self.earlier.segments if self.earlier else 0)

    @property
    def room(self) -> int:
        """Number of segments that the current group still takes."""
        return self.grouping.size - self.group.segments

    def add(self, blocks: _Blocks, many: int) -> None:
        """Add the current block of `many` segments."""

        def add_share(share: tuple[Sequence[int], _Work]) -> None:
            rows, work = share
            for row in rows:
                self._add_channel(blocks, many, row, work)

        # References come first, so that a channel meets all of them when it is processed.
        add_share((range(len(self.references)), self._shares[0][1]))
        if len(self._shares) == 1:
            add_share(self._shares[0])
        else:
            side_by_side(add_share, self._shares)
        self.group.segments += many
        if not self.room:
            self._close()

    def _add_channel(self, blocks: _Blocks, many: int, row: int, work: _Work) -> None:
        name, auto, cross = self.names[row], self.group.auto, self.group.cross
        segments, part = blocks.segments(row, work.buffer), work.windowed[:many]
        mean = np.add.reduce(segments, axis=1, keepdims=True)
        mean /= self.length
        np.subtract(segments, mean, out=part)
        part *= self.window
        held = self._conjugates.get(name, work.transformed)[:many]
        lines = np.fft.rfft(part, axis=1, out=held)[:, : self.lines]
        parts = np.ascontiguousarray(lines).view(np.float64)
        np.einsum("sf,sf->f", parts, parts, out=work.squares)
        auto[row] += np.add(work.squares[0::2], work.squares[1::2], out=work.power)
        for reference in self.references[:row]:
            conjugates = self._conjugates[reference][:many, : self.lines]
            for first in range(0, many, len(work.products)):
                some = slice(first, first + len(work.products))
                products = np.multiply(conjugates[some], lines[some], out=work.products[: many - first])
                cross[reference][row] += np.add.reduce(products, axis=0, out=work.product)
        if name in cross:
            cross[name][row] += work.power
            np.conj(lines, out=lines)

    def _close(self) -> None:
        # The group is full: it is stored separately, and added to the total.
        self.grouping.add(self._mirrored(self.group).single())
        if self.earlier is None:
            self.earlier = Sums.of(len(self.names), self.lines, self.references)
        self.earlier.add(self.group)
        self.group.clear()

    def _mirrored(self, sums: Sums) -> Sums:
        # The cross spectra of two references are complex conjugates; only one of them is accumulated.
        for row, name in enumerate(self.references):
            for column, later in enumerate(self.references[row + 1 :], row + 1):
                sums.cross[later][row] = np.conj(sums.cross[name][column])
        return sums

    def spectra(self, rate: float, units: tuple[str, ...], *, finished: bool = False) -> Spectra:
        """The spectra of a record with this sample rate in Hz; if it is `finished`, no segment can be added."""
        each = np.full(self.length // 2 + 1, 2.0 / (rate * (self.window**2).sum()))
        each[[0, -1]] /= 2.0
        each, frequency = each[: self.lines], np.fft.rfftfreq(self.length, 1.0 / rate)[: self.lines]
        segments, group = self.segments, self._mirrored(self.group)
        whole = self.earlier.plus(group) if self.earlier else group
        # In place, if they are needed no longer: these are the largest arrays of an estimate.
        auto, *cross = (
            np.multiply(values, each / segments, out=values if self.earlier or finished else None)
            for values in (whole.auto, *whole.cross.values())
        )
        return Spectra(
            channels=self.names, frequency=frequency.astype(np.float64), auto=np.asarray(auto),
            cross=dict(zip(whole.cross, map(np.asarray, cross), strict=True)),
            averages=effective_averages(self.window, segments, self.hop), segments=segments, resolution=rate / self.length,
            groups=self.grouping.groups(group.single(), each) if self.earlier else None, units=units, window=self.seen_through,
            overlap=self.overlap,
        )  # fmt: skip


def averages_in(samples: int, length: int) -> float:
    """Number of independent averages in a record of this many samples without a gap, in segments of `length`."""
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
