"""The white noise of a record, where neither the drive nor friction is: in quiet bands, between reversals, next to the drive."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import pi, sqrt
from statistics import NormalDist

import numpy as np

from isorig.analysis.campaign import Campaign, ComplexArray, FloatArray, Run, once
from isorig.analysis.rounding import is_command, rounding
from isorig.analysis.spectra.windows import hanning, segment_spectra

#: Parts of the spectrum whose medians are compared, and the largest share of the sample rate: filters fall off close to half.
PARTS, HIGHEST = 6, 0.475
#: Share of the sample rate below which most converters' filters still pass noise, and ratio of its levels in the halves of the
#: band from the usable one up to there, above which a filter falls off. Chosen: filters that are flat there agree to a tenth.
PASSED, LEVEL_WITHIN = 0.44, 1.3
#: Ratio of powers in the upper half of the usable band up to which a record is white there, and of the levels by different ways
#: up to which they agree. Chosen: white noise in some thousand samples stays within both; friction, impacts and a drive do not.
WHITE, AGREE = 1.5, 1.1
#: Friction changes at once where the motion reverses, so its spectrum is broad. Between reversals the upper part of the usable
#: band, from this share of it on, contains noise only; this share of all moments is far enough from reversals, and this one, too,
#: where nothing reverses.
UPPER, CALM, MOST = 0.77, 0.25, 0.9
#: Length of the filter of the upper band, in samples, the parameter of its Kaiser window, and the least share of the largest
#: value that counts: a record that stays at one count has no noise to measure.
TAPS, KAISER, MOVES = 33, 8.0, 1e-9
#: A drive whose rms is below this multiple of its channel's noise does not move the rig: such a run is at rest, and shows the
#: sensors' noise only. Chosen: the level that `noise_levels` determines from half a spectrum is accurate to a few per cent.
AT_REST = 1.5
#: Samples from which checks determine a level: the median of a sixth of their spectrum is accurate to a per cent.
ENOUGH = 1 << 18
#: Samples of a segment of averaged spectra, and segments for each related channel.
SEGMENT, AVERAGES = 128, 8


@once
def noise_level(run: Run, name: str, longest: int | None = None) -> float | None:
    """Standard deviation of a channel's noise in its unit, from the first `longest` samples of its record (all if None).

    None if the record is too short. The noise is assumed white within the usable band. Its level is the lowest of three:

    - the median power of each sixth of the spectrum (of a chi-square variable with 2 degrees of freedom it is ln 2 times the
      mean), which is the noise where the drive and friction do not reach;
    - the same in the band just above the usable one, where the drive does not reach, if the converter's filter is flat there;
    - the level in the calmest quarter of the record above most of the drive, which is the noise where friction does not reverse.

    A converter's count adds at least its own rounding.
    """
    found = _estimated(_Records(run, longest), name, ())
    return None if found is None else found.least


class _Records:
    # The first samples of a run's channels and their short spectra, each computed once: channels are related to each other.

    def __init__(self, run: Run, longest: int | None) -> None:
        self.run, self._longest = run, longest
        self._values: dict[str, FloatArray] = {}
        self._segments: dict[str, ComplexArray] = {}

    def values(self, name: str) -> FloatArray:
        """Of a channel, shape (n,)."""
        if name not in self._values:
            self._values[name] = self.run.channel(name).read(0, self._longest)
        return self._values[name]

    def segments(self, name: str) -> ComplexArray:
        """Transforms of a channel's half-overlapping segments, shape (bins, segments)."""
        if name not in self._segments:
            self._segments[name] = segment_spectra(self.values(name), hanning(SEGMENT), SEGMENT // 2).T
        return self._segments[name]


@dataclass(frozen=True)
class _Estimated:
    # The lowest estimate of a record's noise, and whether all of them agree: the noise is white, does not change with the motion
    # and is not coherent with the other side of the rig.
    least: float
    sure: bool = False


def _estimated(records: _Records, name: str, others: Sequence[str]) -> _Estimated | None:
    run, values = records.run, records.values(name)
    channel, n = run.channel(name), len(values)
    if n < 2 * SEGMENT:
        return None
    usable = min(run.usable, HIGHEST * run.sample_rate)
    lines = np.fft.rfft((values - values.mean()) * hanning(n))
    power = (lines.real**2 + lines.imag**2) / (n * 0.375)
    spectra = [[middle / np.log(2.0) for middle in _middles(power, usable / run.sample_rate)]]
    if others and n >= AVERAGES * len(others) * SEGMENT:
        own = _own(records.segments(name), np.stack([records.segments(other) for other in others], axis=1))
        spectra.append(_middles(own, usable / run.sample_rate))
    squares = [*(square for each in spectra for square in each), *_above(power, usable / run.sample_rate)]
    taps = _band(UPPER * usable / run.sample_rate, usable / run.sample_rate)
    high = np.abs(np.convolve(values - values.mean(), taps, mode="valid"))
    moving = high[high > MOVES * high.max()]
    if len(moving):
        normal = np.array([NormalDist().inv_cdf(0.5 + 0.5 * share) for share in (CALM, MOST)])
        calm, most = (np.quantile(moving, (CALM, MOST)) / normal) ** 2 / float(np.sum(taps**2))
        squares.append(float(calm))
    counted = np.asarray(channel.samples[:1]).dtype.kind in "iu"
    least = max(sqrt(min(squares, default=0.0)), abs(channel.scale) / sqrt(12.0) if counted else 0.0)
    upper = [each[PARTS // 2 :] for each in spectra]
    if len(moving) == 0 or len(spectra) < 2 or any(len(each) < PARTS // 2 or max(each) > WHITE * min(each) for each in upper):
        return _Estimated(least)
    levels = np.sqrt([*(np.mean(each) for each in upper), calm, most])
    return _Estimated(least, sure=bool(levels.max() <= AGREE * levels.min()))


@once
def noise_levels(campaign: Campaign, drives: tuple[str, ...] = (), longest: int | None = None) -> Mapping[str, float]:
    """Standard deviation of each channel's sensor noise, in the channel's unit.

    The lowest `noise_level` of any run, and at least that of rounding to counts: a record at rest at one count shows no noise. A
    drive that is a command with levels has none. The median power of the part that is not coherent with the other side of the
    rig, whose noise is independent (the drives for a response, the responses for a drive), is a fourth level: the noise where a
    drive falls off slowly (Bendat, Piersol, Random Data, 4th ed., section 7.3). Of each run the first `longest` samples are read,
    all if None.
    """
    levels: dict[str, float] = {}
    counts: dict[str, float] = {}
    for each in _estimates(campaign, drives, longest):
        for name, (found, count) in each.items():
            levels[name] = min(found.least, levels.get(name, np.inf))
            counts[name] = max(count, counts.get(name, 0.0))
    return {name: max(level, counts[name]) for name, level in levels.items()}


@once
def noise_of_runs(campaign: Campaign, drives: tuple[str, ...]) -> tuple[Mapping[str, float], ...]:
    """The same for each run, as `noise_levels`: an instrument with several ranges has another noise in each.

    A run's own level counts if every estimate of it agrees, that of all runs otherwise: friction and impacts also reach high
    frequencies.
    """
    least = noise_levels(campaign, drives)
    return tuple(
        {**least, **{name: max(found.least, least[name]) for name, (found, _) in each.items() if found.sure}}
        for each in _estimates(campaign, drives, None)
    )


@once
def _estimates(
    campaign: Campaign, drives: tuple[str, ...], longest: int | None
) -> tuple[Mapping[str, tuple[_Estimated, float]], ...]:  # fmt: skip
    # Of each run and channel the noise and that of rounding to counts.
    found = []
    for run in campaign.runs:
        records, each = _Records(run, longest), dict[str, tuple[_Estimated, float]]()
        for name in run.channels:
            values = records.values(name)
            related = [other for other in run.sensors if drives and (other in drives) != (name in drives)]
            exact = name in drives and is_command(values)
            estimated = _Estimated(0.0) if exact else _estimated(records, name, related)
            if estimated is not None:
                each[name] = estimated, 0.0 if exact else rounding(values)
        found.append(each)
    return tuple(found)


def rests(drive: FloatArray, noise: float) -> bool:
    """Whether a record of the drive, shape (n,), contains only the noise of its channel: the rig was at rest."""
    return bool(np.std(drive) <= AT_REST * noise)


@lru_cache(maxsize=16)
def _band(low: float, high: float) -> FloatArray:
    # Taps of a band-pass between shares of the sample rate: the windowed ideal one, with gain 1 in the middle of its band.
    place = np.arange(TAPS) - 0.5 * (TAPS - 1)
    taps = (2.0 * high * np.sinc(2.0 * high * place) - 2.0 * low * np.sinc(2.0 * low * place)) * np.kaiser(TAPS, KAISER)
    taps = taps / float(taps @ np.cos(pi * (low + high) * place))
    taps.flags.writeable = False
    return np.asarray(taps)


def _middles(power: FloatArray, share: float) -> list[float]:
    # Medians of the parts of a spectrum up to a share of the sample rate, without its lowest bins; a narrow one has fewer parts.
    top = int(2.0 * share * len(power))
    parts = np.array_split(power[max(len(power) // 32, 2) : top], PARTS)
    return [float(np.median(part)) for part in parts if len(part)]


def _above(power: FloatArray, share: float) -> list[float]:
    # The larger median of the halves of the band above the usable one; nothing where a filter falls off or it is too narrow.
    low, high = (round(2.0 * each * len(power)) for each in (share, PASSED))
    if high - low < 2 * SEGMENT:
        return []
    first, second = (float(np.median(part)) / np.log(2.0) for part in np.array_split(power[low:high], 2))
    return [max(first, second)] if max(first, second) < LEVEL_WITHIN * min(first, second) else []


def _own(y: ComplexArray, x: ComplexArray) -> FloatArray:
    # Power of a record that is not coherent with others, as the variance of white noise, shape (bins,), from the transforms of
    # their segments, shapes (bins, segments) and (bins, others, segments).
    averages, count = y.shape[-1], x.shape[1]
    conjugate = np.conj(x)
    inputs = conjugate @ x.swapaxes(1, 2)
    # Inputs of one motion are nearly the same in some bins.
    ridge = 1e-12 * np.trace(inputs, axis1=1, axis2=2).real[:, None, None] * np.eye(count) + 1e-300 * np.eye(count)
    cross = conjugate @ y[..., None]
    shown = np.einsum("fi,fi->f", np.conj(cross[..., 0]), np.linalg.solve(inputs + ridge, cross)[..., 0]).real
    own = np.maximum((y.real**2 + y.imag**2).sum(axis=-1) - shown, 0.0)
    return np.asarray(own / (averages - count) / np.sum(hanning(SEGMENT) ** 2))
