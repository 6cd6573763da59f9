"""Equations without dry friction, in the frequency domain: residuals over noise, and what brings them down.

The signals are the channels of each run as displacement, velocity and acceleration, in Hann segments. An equation is a row of
signals with unknown real coefficients: its residual power over what noise and the accuracy of the terms allow is one if the
equation holds. Noise enters all terms: its own matrix is subtracted before coefficients are solved for (errors in variables).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from isorig.analysis.campaign import ComplexArray, FloatArray
from isorig.analysis.rounding import is_rounded, sensor_noise

#: Relative accuracy of each channel's part in each term of an equation, rms, and of its largest values. Chosen: calibrations of
#: sensors agree to half a per cent, so the elongation of a stiff link, a small difference of two large motions, is known only to
#: half a per cent of these; and their curves bend as much, which spreads strong motion over frequencies with hardly any.
ACCURACY = 0.005
#: Distance of neighbouring frequency bins in use, as a share of the frequency: denser ones repeat each other.
SPACING = 1.0 / 120.0
#: Rounds of solving for the coefficients and weighting by them, and the factor from the given values within which weights use
#: them. Chosen: coefficients of a wrong equation may be anything, and weights from them would hide the fault.
ROUNDS, TRUSTED = 3, 2.0
#: Fewest samples of a segment.
SHORTEST = 256
#: rms of a channel in the first half segment of a run over that of the whole run, from which on its start is the loudest part, as
#: after a release. Chosen: a steady motion has 1, a decay within a quarter of the run 2.
LOUD = 1.5
#: Weights of the penalty on a curve's second differences: the one that leaves least of the other segments counts. Chosen: a
#: strongly bent curve costs as much as many frequency bins tell, and a straight one needs the full weight.
TIES = (1.0, 0.03, 1e-3)

#: Power of a combination of columns over that of its noise, from which on its coefficient is determined; and over the largest
#: power of any combination, below which it is zero. Chosen: noise is known to about a fifth; two thirds of double precision.
DETERMINED, SINGULAR = 0.2, 1e-10

#: A row of an equation: coefficients of signals, each a number or one value per frequency bin.
Row = Mapping[tuple[str, int], "complex | ComplexArray"]


@dataclass(frozen=True, kw_only=True)
class RunSpectra:
    """Spectra of the signals of a run."""

    run: int  #: Index of the run.
    segments: ComplexArray  #: Shape (signals, segments, bins).
    power: ComplexArray  #: Cross-spectral matrices averaged over segments, shape (bins, signals, signals).
    noise: ComplexArray  #: Those of the sensors' noise, of the same shape.
    #: Those of errors by `ACCURACY` of each record's largest value in proportion to its square, of the same shape.
    bent: ComplexArray


@dataclass(frozen=True, kw_only=True)
class Solved:
    """An equation solved for its coefficients."""

    residual: float  #: Its weighted residual power: about one if it holds.
    values: FloatArray  #: The coefficients, shape (unknown,).


class Prepared:
    """An equation with its weights, from its own terms, summed over runs.

    Parameters
    ----------
    spectra
        Where its signals are.
    rows
        The known row first, then the unknown ones: known = sum of value * unknown.
    runs
        The runs in which it holds.
    start
        First values of the coefficients, shape (unknown,), for the weights.
    """

    def __init__(
        self, spectra: Spectra, rows: Sequence[Row], runs: Sequence[int], start: FloatArray, rounds: int = ROUNDS
    ) -> None:
        self.spectra, self.rows, self.runs = spectra, tuple(rows), tuple(runs)
        self._matrix = matrix = spectra.matrix(rows)
        chosen = [item for item in spectra.runs if item.run in self.runs]
        grams = [np.real(_gram(matrix, item.power)) for item in chosen]
        noises = [np.real(_gram(matrix, item.noise)) for item in chosen]
        parts = [spectra.parts(matrix, item.power) for item in chosen]
        bent = [np.real(_gram(matrix, item.bent)) for item in chosen]
        given = np.asarray(start, dtype=float)
        values = given
        for again in range(rounds + 1):
            row = np.concatenate([[1.0], -np.clip(values, given / TRUSTED, given * TRUSTED)])
            weights = [
                spectra.octaves
                / np.maximum(np.einsum("p,fpq,q->f", row, noise + curve, row) + ACCURACY**2 * (part @ row**2), 1e-300)
                for part, curve, noise in zip(parts, bent, noises, strict=True)
            ]
            if not len(values) or again == rounds:
                break
            totals = [np.asarray(sum(map(_weighted, weights, parts))) for parts in (grams, noises)]
            values = _corrected(*totals)
        self.weights = dict(zip((item.run for item in chosen), weights, strict=True))
        count = len(chosen)
        self.size = sum(item.segments.shape[1] for item in chosen) * len(spectra.bins)
        self.power, self.noise = (
            sum(w[:, None, None] * power for w, power in zip(weights, powers, strict=True)) / count
            for powers in ([item.power for item in chosen], [item.noise for item in chosen])
        )
        self._kept: dict[tuple[tuple[int, ...], int], tuple[ComplexArray, ComplexArray]] = {}
        self._own = tuple(np.real(_gram(matrix, power)).sum(axis=0) for power in (self.power, self.noise))
        self.solved = _solve(*self._own)
        self.count = count

    def _powers(self, kept: tuple[int, ...], every: int) -> tuple[ComplexArray, ComplexArray]:
        # Of signals and noise, of these signals alone, or of all if none is given; in each `every`-th frequency bin.
        if (kept, every) not in self._kept:
            power, noise = (part[::every] for part in (self.power, self.noise))
            self._kept[kept, every] = (power[:, kept][:, :, kept], noise[:, kept][:, :, kept]) if kept else (power, noise)
        return self._kept[kept, every]

    def solve(
        self, more: Sequence[Row] = (), known: Row | None = None, correction: ComplexArray | None = None,
        kept: Sequence[int] = (), every: int = 1,
    ) -> Solved:  # fmt: skip
        """Solve with more unknown rows, with a further known part, or with corrected signals.

        Parameters
        ----------
        more
            Further unknown rows.
        known
            Added to the known row.
        correction
            True signals in terms of the recorded ones, shape (bins, signals, signals), or (bins, signals, kept).
        kept
            Places of the signals on which all others depend.
        every
            Only each `every`-th frequency bin counts; those of `correction` are these.
        """
        matrix = np.concatenate([self._matrix, self.spectra.matrix(more)], axis=1)[::every]
        if known is not None:
            matrix[:, :1] += self.spectra.matrix([known])[::every]
        if correction is not None:
            matrix = matrix @ correction
        gram, noise = (np.real(_gram(matrix, power)).sum(axis=0) for power in self._powers(tuple(kept), every))
        return _solve(gram, noise)

    def without_fault(self, added: FloatArray, gains: ComplexArray) -> list[Solved]:
        """Solve with true signals = recorded + gain * added @ recorded, for each of these gains.

        Where such signals are all that is known of an equation's size, the residual is relative to theirs: any equation is nearer
        to zero after it is made smaller.

        Parameters
        ----------
        added
            Shape (signals, signals).
        gains
            Shape (values, bins).
        """
        matrix = self._matrix
        more = matrix @ added
        # Of power P, the rows M + g N have (M + g N)* P (M + g N)^T, summed over frequency bins.
        totals = []
        for own, power in zip(self._own, (self.power, self.noise), strict=True):
            cross = np.real(np.tensordot(gains, _between(matrix, more, power), axes=1))
            square = np.tensordot(np.abs(gains) ** 2, np.real(_gram(more, power)), axes=1)
            totals.append(own + cross + cross.transpose(0, 2, 1) + square)
        found = [_solve(*pair) for pair in zip(*totals, strict=True)]
        if np.any(matrix[:, 0][:, ~added.any(axis=1)]):
            return found
        before, after = self._own[0][0, 0], totals[0][:, 0, 0]
        return [
            replace(one, residual=float(one.residual * before / max(size, 1e-300)))
            for one, size in zip(found, after, strict=True)
        ]

    def scan(self, row: Row, gains: ComplexArray) -> FloatArray:
        """Residual as a function of the coefficient c of one more row, filtered with each of these gains.

        Parameters
        ----------
        row
            The further row.
        gains
            Shape (filters, bins).

        Returns
        -------
        FloatArray
            Coefficients of the parabolas p0 + p1 c + p2 c^2 that remain with the other unknowns solved for, shape (filters, 3).
        """
        matrix = self.spectra.matrix([*self.rows, row])
        gram, noise = _gram(matrix, self.power), _gram(matrix, self.noise)
        totals = [np.real(part).sum(axis=0) for part in (gram, noise)]
        found = []
        for gain in gains:
            both = []
            for part, total in zip((gram, noise), totals, strict=True):
                other = total.copy()
                cross = np.real(part[:, :, -1] * gain[:, None]).sum(axis=0)
                other[:, -1] = other[-1, :] = cross
                other[-1, -1] = float((np.real(part[:, -1, -1]) * np.abs(gain) ** 2).sum())
                both.append(other)
            found.append(_parabola(*both))
        return np.array(found)

    def least(self, rows: Sequence[Row], gains: ComplexArray) -> FloatArray:
        """Residual with further rows, filtered with each of these gains, all solved for.

        Parameters
        ----------
        rows
            The further rows.
        gains
            Shape (filters, bins).

        Returns
        -------
        FloatArray
            Shape (filters,).
        """
        matrix = self.spectra.matrix([*self.rows, *rows])
        gram, noise = _gram(matrix, self.power), _gram(matrix, self.noise)
        own, found = len(self.rows), []
        for gain in gains:
            by_row = np.ones((len(gain), len(gram[0])), dtype=complex)
            by_row[:, own:] = gain[:, None]
            both = [np.real(np.einsum("fp,fpq,fq->pq", by_row.conj(), part, by_row)) for part in (gram, noise)]
            found.append(_solve(*both).residual)
        return np.array(found)

    def share_kept(self, values: FloatArray) -> float:
        """Share of the own terms, by projection, that other coefficients also give, one of an equation without unknown terms;
        those of further columns follow them."""
        before, own = self.solved.values, self._own[0][1:, 1:]
        return float(before @ own @ values[: len(before)] / max(before @ own @ before, 1e-300)) if len(before) else 1.0

    def shaped(
        self, columns: Mapping[int, ComplexArray], penalty: FloatArray | None = None, held_out: bool = True, first: int = 0
    ) -> Solved:  # fmt: skip
        """Residual with further unknown columns that are no linear functions of the signals.

        The columns' coefficients are determined from every second segment, and from the others by how much they reduce the
        residual: rare events may be in few segments.

        Parameters
        ----------
        columns
            Their spectra by run, shape (columns, segments, bins).
        penalty
            Quadratic form of the columns' coefficients, for residuals in multiples of what is allowed; None for none.
        held_out
            Whether the residual is that of the other segments; otherwise all segments determine both.
        first
            The first of the segments that determine the coefficients, 0 or 1.
        """
        p = len(self.rows)
        matrix = self.spectra.matrix(self.rows)
        grams = []
        for item in self.spectra.runs:
            if item.run not in columns or item.run not in self.weights:
                continue
            w = np.sqrt(self.weights[item.run] / item.segments.shape[1])
            own = np.einsum("fpi,isf->psf", matrix, item.segments, optimize=True)
            both = np.concatenate([own, columns[item.run]]) * w
            for part in range(2):
                half = both[:, part::2].reshape(len(both), -1)
                grams.append((part, np.real(half.conj() @ half.T)))
        fit = sum(gram for part, gram in grams if part == first or not held_out)
        test = sum(gram for part, gram in grams if part != first or not held_out)
        assert not isinstance(fit, int)
        assert not isinstance(test, int)
        noise = np.zeros_like(fit)
        noise[:p, :p] = self._own[1] * self.count * (0.5 if held_out else 1.0)
        bare = np.concatenate([[1.0], -_corrected(fit[:p, :p], noise[:p, :p])])
        before = max(float(bare @ test[:p, :p] @ bare), 1e-300)

        def solved(weight: float) -> Solved:
            tied = fit.copy()
            if penalty is not None:
                tied[p:, p:] += weight * self.count / self.size * penalty
            values = _corrected(tied, noise)
            row = np.concatenate([[1.0], -values])
            return Solved(residual=self.solved.residual * float(row @ test @ row) / before, values=values)

        return min(map(solved, TIES if penalty is not None else TIES[:1]), key=lambda one: one.residual)


class Spectra:
    """The spectra of all signals of all runs at chosen frequency bins.

    Parameters
    ----------
    rate
        Hz.
    length
        Samples of a segment.
    low, high
        Band in Hz.
    names
        The signals: channel and order of the derivative.
    orders
        The measured derivative of each channel.
    """

    def __init__(
        self, rate: float, length: int, low: float, high: float, names: Sequence[tuple[str, int]],
        orders: Mapping[str, int],
    ) -> None:  # fmt: skip
        self.rate, self.length, self.names = rate, length, tuple(names)
        self.index = {name: k for k, name in enumerate(self.names)}
        frequency = np.fft.rfftfreq(length, 1.0 / rate)
        kept: list[int] = []
        for k, f in enumerate(frequency):
            if low <= f <= high and (not kept or f - frequency[kept[-1]] >= SPACING * f - 1e-9):
                kept.append(k)
        self.bins = np.array(kept, dtype=np.int64)
        self.frequency = np.asarray(frequency[self.bins], dtype=np.float64)
        self.omega = 2.0 * np.pi * self.frequency
        self.octaves = (1.0 / self.frequency) / (1.0 / self.frequency).sum()
        self.orders = orders
        self.runs: list[RunSpectra] = []
        self.largest_at_start: set[int] = set()

    def _independent(self, power: Mapping[str, FloatArray]) -> ComplexArray:
        # Cross-spectral matrices of independent errors with these power spectra in the channels, shape (bins, signals, signals).
        found = np.zeros((len(self.bins), len(self.names), len(self.names)), dtype=complex)
        for channel, values in power.items():
            own = [(k, (1j * self.omega) ** (order - self.orders.get(channel, order)))
                   for (name, order), k in self.index.items() if name == channel]  # fmt: skip
            for i, a in own:
                for j, b in own:
                    found[:, i, j] = values * a.conj() * b
        return found

    def add(
        self, run: int, signals: Mapping[tuple[str, int], FloatArray], noise: Mapping[str, float], *, free: bool = False
    ) -> None:  # fmt: skip
        """Add a run: its signals, each shape (n,), and the standard deviation of the sensor noise in each measured channel.

        `free` is whether nothing drives it: then its start may be its loudest part.
        """
        half = self.length // 2
        motions = [signals[channel, order] for channel, order in self.orders.items()]
        if free and any(float(np.std(values[:half])) > LOUD * float(np.std(values)) for values in motions):
            self.largest_at_start.add(run)
        segments = np.stack([self.segments(signals[name], run) for name in self.names])
        count = segments.shape[1]
        if count:
            power = np.einsum("isf,jsf->fij", segments.conj(), segments, optimize=True) / count
            window = float((np.hanning(self._own(len(signals[self.names[0]]))) ** 2).sum())
            of_noise = {name: np.full(len(self.bins), level**2 * window) for name, level in noise.items()}
            for name, order in self.orders.items():
                values, level = signals[name, order], noise.get(name, 0.0)
                if is_rounded(values, level):
                    error = self.segments(sensor_noise(values, level, np.random.default_rng(run)), run)
                    of_noise[name] = np.mean(np.abs(error) ** 2, axis=0)
            bent = {}
            for name, order in self.orders.items():
                values = signals[name, order]
                error = self.segments(ACCURACY * values**2 / max(float(np.abs(values).max()), 1e-300), run)
                bent[name] = np.mean(np.abs(error) ** 2, axis=0)
            self.runs.append(
                RunSpectra(
                    run=run, segments=segments, power=power, noise=self._independent(of_noise), bent=self._independent(bent)
                )
            )

    def segments(self, values: FloatArray, run: int) -> ComplexArray:
        """Spectra of a signal's segments in a run at the chosen bins, shape (segments, bins).

        The first segment lacks the ends of integrated motions. Where the motion is largest at the start of a run, its middle is
        there: before, all signals are zero, which satisfies any equation. A run shorter than a segment has its own, which zeros
        lengthen.
        """
        own = self._own(len(values))
        step = own // 2
        if run in self.largest_at_start:
            values = np.concatenate([np.zeros(step + step // 2), values])
        starts = np.arange(step // 2, len(values) - own + 1, step)
        if len(starts) == 0:
            starts = np.arange(0, max(len(values) - own, 0) + 1, own)
        if len(values) < own:
            return np.zeros((0, len(self.bins)), dtype=complex)
        view = np.lib.stride_tricks.sliding_window_view(values, own)[starts]
        return np.asarray(np.fft.rfft(view * np.hanning(own), self.length, axis=1)[:, self.bins])

    def _own(self, samples: int) -> int:
        # Samples of a segment in a run: a power of two with at least two segments in it if the run is too short.
        shorter = 2 ** int(np.log2(max(samples // 2, 1)))
        return self.length if samples >= self.length or shorter < SHORTEST else shorter

    def parts(self, matrix: ComplexArray, power: ComplexArray) -> FloatArray:
        """Power of each row's parts, summed over channels, shape (bins, rows)."""
        found = np.zeros(matrix.shape[:2])
        for channel in dict.fromkeys(channel for channel, _ in self.names):
            own = [k for (name, _), k in self.index.items() if name == channel]
            part = matrix[:, :, own]
            found += np.real(np.einsum("fpi,fij,fpj->fp", part.conj(), power[:, own][:, :, own], part, optimize=True))
        return found

    def matrix(self, rows: Sequence[Row]) -> ComplexArray:
        """Rows as coefficients of all signals, shape (bins, rows, signals)."""
        found = np.zeros((len(self.bins), len(rows), len(self.names)), dtype=complex)
        for i, row in enumerate(rows):
            for name, value in row.items():
                found[:, i, self.index[name]] += value
        return found


def _gram(matrix: ComplexArray, power: ComplexArray) -> ComplexArray:
    return _between(matrix, matrix, power)


def _between(one: ComplexArray, other: ComplexArray, power: ComplexArray) -> ComplexArray:
    return np.asarray(one.conj() @ power @ other.transpose(0, 2, 1))


def _weighted(weight: FloatArray, power: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("f,fpq->pq", weight, power))


def _corrected(gram: FloatArray, noise: FloatArray) -> FloatArray:
    # Coefficients of the unknown rows, from the matrix of the known row and the unknown ones without that of the noise: the
    # smallest among those that the noise does not tell apart. Columns of unit size.
    clean = (gram - noise)[1:, 1:]
    size = 1.0 / np.sqrt(np.abs(np.diag(clean)) + 1e-300)
    power, axes = np.linalg.eigh(clean * size[:, None] * size)
    own = np.einsum("ki,kl,li->i", axes, noise[1:, 1:] * size[:, None] * size, axes)
    kept = power > np.maximum(DETERMINED * own, SINGULAR * np.max(power, initial=0.0))
    chosen = axes[:, kept]
    return np.asarray(size * (chosen @ (chosen.T @ (size * (gram - noise)[1:, 0]) / power[kept])))


def _solve(gram: FloatArray, noise: FloatArray) -> Solved:
    values = _corrected(gram, noise)
    row = np.concatenate([[1.0], -values])
    return Solved(residual=float(row @ gram @ row), values=values)


def _parabola(gram: FloatArray, noise: FloatArray) -> FloatArray:
    # Residual over the last coefficient, with the others solved for.
    last = [-1, *range(1, len(gram) - 1)]
    here = _corrected(gram[:-1, :-1], noise[:-1, :-1])
    there = _corrected(gram[np.ix_(last, last)], noise[np.ix_(last, last)])
    first = np.concatenate([[1.0], -here, [0.0]])
    slope = np.concatenate([[0.0], there, [-1.0]])
    return np.array([first @ gram @ first, 2.0 * (first @ gram @ slope), slope @ gram @ slope])
