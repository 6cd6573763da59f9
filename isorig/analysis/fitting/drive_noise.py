"""Effect of noise in the recorded drive on fitted values: their bias, and its share of their uncertainty.

A fit that takes the recorded drive x + n as exact has a residual W (D n + b): D the rig's linear response to the noise, b the
mean response to its square (noise lets a contact slide more easily). Both depend on the fitted values, so least squares is
biased, by (J'J)^-1 (J'b + half the gradient of |D n|^2), J the derivatives of the residual (errors in variables: Pintelon and
Schoukens 2012, ch. 8; simulated as by Cook and Stefanski 1994). A contact that sticks and slides passes the noise only while it
slides, when the values matter most, so the residual's frequency bins are not independent: the uncertainty comes from draws of the
noise, not from the bins. All terms come from simulations with added noise of the same spectrum. The spectrum follows from the
residual: noise of the drive appears in all responses together, noise of the sensors does not.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from isorig.analysis.campaign import ComplexArray, FloatArray, IntArray
from isorig.analysis.fitting.division import coarsened
from isorig.analysis.fitting.excess import SIMULATION_LIMIT
from isorig.analysis.fitting.influence import normalised
from isorig.analysis.fitting.residuals import Problem
from isorig.analysis.fitting.solve import FAINT, Fit, at_coordinates, coordinates_of, slopes_of
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.model.rig_model import RigModel

#: Frequency bands of the noise's spectrum, and the least number of frequency bins in each.
BANDS, LEAST_BINS = 16, 40
#: Noise for the rig's linear response, as a share of the drive's rms.
PROBE = 1e-3
#: Draws for the uncertainty in all runs together, whose own relative uncertainty is 1 / sqrt(2 draws), and fewest draws of a run.
DRAWS, FEWEST = 24, 4
#: Relative uncertainty of the removed bias, for the noise's spectrum is estimated from few bins.
UNCERTAIN = 0.25
#: Share of the response's power to the noise whose runs represent all runs, for a bias up to `SMALL` standard uncertainties.
#: Chosen: what the others change of such a bias is less than half of one.
REPRESENTS, SMALL = 0.75, 1.0


@dataclass(frozen=True)
class DriveNoise:
    """Effect of the noise in the recorded drive on fitted values."""

    bias: FloatArray  #: In the values' units, shape (values,).
    #: Of the values, due to noise in drive and responses, and to the uncertainty of the bias, shape (values, values).
    covariance: FloatArray


def no_noise(done: Fit) -> DriveNoise:
    """The effect of noise where it is not determined."""
    return DriveNoise(np.zeros(len(done.free)), np.zeros((len(done.free), len(done.free))))


class _Noise(NamedTuple):
    # Spectrum of the drive's noise (rms in the bins of numpy's rfft of the record), and power of each response's own noise in the
    # bins of the weighted residual, shape (channels, bins).
    drive: FloatArray
    own: FloatArray


def drive_noise_effect(done: Fit, trials: Sequence[Trial]) -> DriveNoise:
    """Effect of the noise in the recorded drive; none for rigs with one response, or judged by their drive's force."""
    used = [coarsened(trial) for trial in trials if trial.fitted > 0]
    count = len(done.free)
    if not count or any(trial.motion is not None or len(trial.channels) < 2 for trial in used):
        return no_noise(done)
    generator = np.random.default_rng(17)
    white = [generator.normal(0.0, PROBE * t.excitation.recorded.std(), len(t.excitation.recorded)) for t in used]
    # All differences are those of one grid.
    calm = np.nan_to_num(Problem(used, share=SIMULATION_LIMIT).residuals([done.model])[0])
    response = _shaken(used, white, 1.0, [done.model])[0] - calm
    noises = [
        _noise(trial, left, seen, added)
        for trial, left, seen, added in zip(
            used, _split(done.residual, done.sizes), _split(response, done.sizes), white, strict=True
        )
    ]
    scale, jacobian, bread = normalised(done)
    # A value without any effect on the residual has no uncertainty here; it is reported as not identifiable.
    traced = (done.jacobian**2).sum(axis=0) > FAINT
    slope = slopes_of(done.model, done.free) * traced / np.where(traced, scale, 1.0)
    # The points of a curve hold each other, so noise moves them little.
    plain = np.flatnonzero([not free.follows for free in done.free])
    moved, steps = _moved(done, plain)
    draws = [_draw(generator, noise, trial) for noise, trial in zip(noises, used, strict=True)]
    up, down = (_shaken(used, draws, sign, [done.model])[0] for sign in (1.0, -1.0))
    odd, even = _split(0.5 * (up - down), done.sizes), 0.5 * (up + down) - calm

    def gradient(run: int) -> FloatArray:
        # Half the derivative of the squared response to the noise in one run.
        above, below = (_shaken([used[run]], [draws[run]], sign, moved, among=used) for sign in (1.0, -1.0))
        found = np.zeros(count)
        found[plain] = ((0.5 * (above - below) - odd[run]) / steps[:, None]) @ odd[run]
        return found

    powers = np.array([part @ part for part in odd])
    order = np.argsort(-powers)
    covered = np.cumsum(powers[order])
    runs = order[: int(np.searchsorted(covered, REPRESENTS * covered[-1])) + 1]

    def off(slopes: FloatArray) -> FloatArray:
        # J'r is zero at the fitted values and this at the true ones, so the fitted values are off by its negative.
        return np.asarray(-(bread @ (jacobian.T @ even + traced * slopes / np.where(traced, scale, 1.0))) * slope)

    strongest = np.sum([gradient(run) for run in runs], axis=0)
    slopes = strongest * (covered[-1] / max(covered[len(runs) - 1], 1e-300))
    std = np.maximum(np.array(list(done.std.values())), 1e-300)
    if np.max(np.abs(off(slopes) - off(np.zeros(count))) / std) > SMALL:
        slopes = strongest + np.sum([gradient(run) for run in order[len(runs) :]], axis=0)
    bias = off(slopes)
    # Without friction the response to noise is that of a linear rig, whose frequency bins are independent.
    count_of_draws = max(-(-DRAWS // len(used)), FEWEST) if done.model.contacts else 0
    moves = np.zeros((len(used), count_of_draws, count))
    for k in range(count_of_draws):
        draws = [_draw(generator, noise, trial) for noise, trial in zip(noises, used, strict=True)]
        change = _split(_shaken(used, draws, 1.0, [done.model])[0] - calm, done.sizes)
        for run, (part, rows) in enumerate(zip(change, np.split(jacobian, np.cumsum(done.sizes)[:-1]), strict=True)):
            moves[run, k] = (bread @ (rows.T @ part)) * slope
    own = np.concatenate([np.tile(noise.own.ravel(), 2) for noise in noises])
    sensors = bread @ (jacobian.T @ (0.5 * own[:, None] * jacobian)) @ bread * np.outer(slope, slope)
    covariance = _of_draws(moves) + sensors
    return DriveNoise(bias, covariance + UNCERTAIN**2 * np.outer(bias, bias))


def _of_draws(moves: FloatArray) -> FloatArray:
    # Covariance of the sum over runs from independent draws in each, moves of shape (runs, draws, values); widened by Student's
    # factor for the degrees of freedom that the shares of the runs leave (Welch-Satterthwaite).
    from scipy.special import stdtrit

    draws = moves.shape[1]
    if draws == 0:
        return np.zeros((moves.shape[2],) * 2)
    variances = (moves**2).mean(axis=1)
    total = variances.sum(axis=0)
    degrees = draws * total**2 / np.maximum((variances**2).sum(axis=0), 1e-300)
    wider = stdtrit(np.maximum(degrees, 1.0), 0.975) / stdtrit(np.inf, 0.975)
    flat = moves.reshape(-1, moves.shape[2])
    return np.asarray(flat.T @ flat / draws * np.outer(wider, wider))


def _moved(done: Fit, which: IntArray) -> tuple[list[RigModel], FloatArray]:
    # Models with one of these values moved by its finite difference each.
    theta, models = coordinates_of(done.model, done.free), []
    for i in which:
        there = theta.copy()
        there[i] += done.free[i].step
        models.append(at_coordinates(done.model, done.free, there))
    return models, np.array([done.free[i].step for i in which])


def _shaken(
    trials: Sequence[Trial], noises: Sequence[FloatArray], sign: float, models: Sequence[RigModel],
    among: Sequence[Trial] | None = None,
) -> FloatArray:  # fmt: skip
    # Weighted residuals with noise added to the drive, shape (models, size).
    added = [
        replace(t, excitation=t.excitation.with_drive(t.excitation.recorded + sign * noise))
        for t, noise in zip(trials, noises, strict=True)
    ]
    return np.nan_to_num(Problem(added, share=SIMULATION_LIMIT, among=among).residuals(models))


def _split(values: FloatArray, sizes: Sequence[int]) -> list[FloatArray]:
    return list(np.split(values, np.cumsum(sizes)[:-1]))


def _rows(values: FloatArray, channels: int) -> ComplexArray:
    # Complex weighted spectra, shape (channels, bins).
    real, imag = values.reshape(2, channels, -1)
    return np.asarray(real + 1j * imag)


def _noise(trial: Trial, residual: FloatArray, response: FloatArray, added: FloatArray) -> _Noise:
    # Where friction holds all bodies, the response to noise is rounding.
    passes = response if response @ response > FAINT else np.zeros_like(response)
    left, seen = _rows(residual, len(trial.channels)), _rows(passes, len(trial.channels))
    bins = left.shape[1]
    edges = _bands(bins)
    size = float(added.std())
    drive = np.abs(np.fft.rfft(trial.excitation.recorded[: trial.fitted])) ** 2 / trial.fitted
    pairs = [(i, j) for i in range(len(left)) for j in range(i)]
    power, own = np.zeros(bins), np.zeros(left.shape)
    for low, high in pairwise(edges):
        shared = [np.mean(seen[i, low:high] * np.conj(seen[j, low:high])) for i, j in pairs]
        common = [np.mean(left[i, low:high] * np.conj(left[j, low:high])) for i, j in pairs]
        known = sum(abs(one) ** 2 for one in shared)
        asked = sum(float((a * np.conj(b)).real) for a, b in zip(common, shared, strict=True))
        if known > 0.0:  # a response to noise
            # Never more than the whole drive there.
            power[low:high] = min(max(asked / known, 0.0), float(np.mean(drive[low:high])) / size**2)
        total, passed = ((np.abs(rows[:, low:high]) ** 2).mean(axis=1) for rows in (left, seen))
        own[:, low:high] = np.maximum(total - power[low] * passed, 0.0)[:, None]
    # Above the residual's ceiling the noise is taken as white.
    n = len(trial.excitation.recorded)
    at = (np.arange(n // 2 + 1) * trial.fitted) // n
    return _Noise(size * np.sqrt(n * power[np.minimum(at, bins - 1)]), own)


def _bands(bins: int) -> IntArray:
    # First bins of bands of increasing width, and the end of the last.
    edges = [0]
    for edge in np.geomspace(LEAST_BINS, max(bins, LEAST_BINS), BANDS).astype(int):
        if edge - edges[-1] >= LEAST_BINS:
            edges.append(int(edge))
    return np.array([*edges[:-1], bins] if len(edges) > 1 else [0, bins], dtype=np.int64)


def _draw(generator: np.random.Generator, noise: _Noise, trial: Trial) -> FloatArray:
    n = len(trial.excitation.recorded)
    white = np.fft.rfft(generator.normal(0.0, 1.0, n)) / np.sqrt(n)
    return np.asarray(np.fft.irfft(white * noise.drive, n))


def without_bias(done: Fit, noise: DriveNoise) -> Fit:
    """The fit with its values corrected for the bias by noise in the drive."""
    pairs = zip(done.free, done.values.values(), noise.bias, strict=True)
    moved = {free.path: min(max(value - bias, free.low), free.high) for free, value, bias in pairs}
    kept = {f.path: v for f, v in zip(done.free, moved.values(), strict=True) if np.isfinite(v) and (not f.log or v > 0.0)}
    return replace(done, model=done.model.replace(kept))
