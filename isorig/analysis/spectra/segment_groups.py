"""Spectra of consecutive groups of segments, for jackknife estimates: results are recomputed without each group.

The assumptions of an error bar from the coherence (Gaussian noise on the response only, a Gaussian white drive) need not hold for
the scatter from group to group (Tukey 1958; Efron and Stein 1981).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from isorig.analysis.campaign import FloatArray, IntArray

#: Number of groups of a record of known length; it determines a standard deviation to 13 %.
USUAL = 28
#: Number of groups of a growing record at which neighbouring groups are merged in pairs.
MOST = 48
#: The same where memory is short: half of it determines a standard deviation to 35 %.
FEWEST_GROUPS = 8


@dataclass
class Sums:
    """Sums over some segments: their number, auto spectra (channels, bins), and cross spectra by reference, the same shape."""

    segments: int
    auto: NDArray[Any]
    cross: Mapping[str, NDArray[Any]]

    @classmethod
    def of(cls, channels: int, bins: int, references: Sequence[str]) -> Self:
        """The sums over no segment."""
        cross = {name: np.zeros((channels, bins), dtype=np.complex128) for name in references}
        return cls(0, np.zeros((channels, bins)), cross)

    def add(self, other: Sums) -> None:
        """Add the sums over further segments."""
        self.segments += other.segments
        self.auto += other.auto
        for name, values in other.cross.items():
            np.add(self.cross[name], values, out=self.cross[name])

    def plus(self, other: Sums) -> Sums:
        """The sums over the segments of both."""
        cross = {name: values + other.cross[name] for name, values in self.cross.items()}
        return Sums(self.segments + other.segments, self.auto + other.auto, cross)

    def single(self) -> Sums:
        """The same in single precision, which suffices for the change due to one group."""
        cross = {name: values.astype(np.complex64) for name, values in self.cross.items()}
        return Sums(self.segments, self.auto.astype(np.float32), cross)

    def clear(self) -> None:
        """Reset to no segment."""
        self.segments = 0
        for values in (self.auto, *self.cross.values()):
            values[:] = 0.0


@dataclass(frozen=True)
class Groups:
    """Sums of consecutive groups of segments, and the density corresponding to a sum of 1 over one segment, shape (bins,)."""

    parts: tuple[Sums, ...]
    scale: FloatArray

    def __len__(self) -> int:
        return len(self.parts)

    def without(self, lines: IntArray) -> Iterator[Sums]:
        """The densities over the segments that remain without each group in turn, in some of the frequency bins."""
        scale = self.scale[lines]
        auto = sum(part.auto[:, lines].astype(np.float64) for part in self.parts)
        names = self.parts[0].cross if self.parts else ()
        cross = {name: sum(part.cross[name][:, lines].astype(np.complex128) for part in self.parts) for name in names}
        whole = sum(part.segments for part in self.parts)
        for part in self.parts:
            segments = whole - part.segments
            rest = {name: (cross[name] - part.cross[name][:, lines]) * scale / segments for name in names}
            yield Sums(segments, (auto - part.auto[:, lines]) * scale / segments, rest)

    def moved(self, move: Callable[[Any], Any]) -> Groups:
        """The groups in other frequency bins, to make several rates compatible: `move` converts rows, shape (channels, bins)."""
        parts = []
        for part in self.parts:
            cross = {name: move(values * self.scale).astype(np.complex64) for name, values in part.cross.items()}
            parts.append(Sums(part.segments, move(part.auto * self.scale).astype(np.float32), cross))
        return Groups(tuple(parts), np.ones(parts[0].auto.shape[1]))


def joined(groups: Sequence[Groups | None]) -> Groups | None:
    """All groups of several spectra; None where any has none."""
    kept = [group for group in groups if group is not None]
    return Groups(tuple(part for group in kept for part in group.parts), kept[0].scale) if len(kept) == len(groups) else None


def group_bytes(channels: int, references: int, bins: int) -> int:
    """Memory of a stored group in bytes, in single precision."""
    return channels * bins * (np.dtype(np.float32).itemsize + references * np.dtype(np.complex64).itemsize)


def group_size(segments: int, block: int) -> int:
    """Segments of a group in a record of this length: whole blocks, or equal parts of one, for about `USUAL` groups."""
    size = segments / USUAL
    parts = [part for part in (1, 2, 4) if part < block]
    return min((*parts, block * max(1, round(size / block))), key=lambda allowed: abs(allowed - size))


class Grouping:
    """Groups of `size` segments each: few at first if the length of the record is unknown.

    At `most` groups, an even number, neighbouring groups are merged.
    """

    def __init__(self, size: int, most: int) -> None:
        self._parts: list[Sums] = []
        self.size, self._most = size, most

    def add(self, group: Sums) -> None:
        """Store a group of `size` segments."""
        self._parts.append(group)
        if len(self._parts) == self._most:
            self._parts = [one.plus(other) for one, other in zip(self._parts[0::2], self._parts[1::2], strict=True)]
            self.size *= 2

    def groups(self, last: Sums, scale: FloatArray) -> Groups | None:
        """All groups including the last; if it has less than half of the others' segments it is added to the one before."""
        parts = list(self._parts)
        if parts and 0 < 2 * last.segments < self.size:
            parts[-1] = parts[-1].plus(last)
        elif last.segments:
            parts.append(last)
        return Groups(tuple(parts), scale) if len(parts) > 1 else None
