"""The reason for a low coherence: the sensors' noise, narrow resonances, a nonlinear rig, or undecided from the runs so far.

A response that is not coherent with the drive is either not caused by it (noise, another source) or caused by it nonlinearly. The
second one is repeatable: it is equal in two runs with one drive, lies between the driven frequencies of a periodic drive, or
changes the transfer function with the drive's level. What resonances narrower than the resolution make incoherent becomes less in
longer segments.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from isorig.analysis.campaign import BoolArray, FloatArray, Run
from isorig.analysis.errors import DataError
from isorig.analysis.rounding import rounding
from isorig.analysis.spectra.noise import ENOUGH, noise_level
from isorig.analysis.spectra.overload import LONGEST
from isorig.analysis.spectra.periodic import SETTLING, Detection
from isorig.analysis.spectra.welch import WELL_DRIVEN, Spectra, estimate
from isorig.rig.acquire.policy import (
    DIFFERENT,
    LEAST_AVERAGES,
    LEVEL_RATIO,
    NARROW,
    NOISE_RATIO,
    NOT_REPEATABLE,
    REPEATABLE,
)

IncoherenceKind = Literal["nonlinear", "undecided", "narrow", "noise"]
KINDS: tuple[IncoherenceKind, ...] = get_args(IncoherenceKind)


@dataclass(frozen=True, kw_only=True)
class Incoherence:
    """Why a response is incoherent, and the sentence for the operator."""

    response: str
    kind: IncoherenceKind
    text: str


def incoherence(
    run: Run, spectra: Spectra, name: str, drive: str, *, others: Sequence[Run], detections: Sequence[Detection] = ()
) -> Incoherence:
    """The reason for a low coherence of the response `name`, from its run and from others of the session.

    The `detections` are noise and distortion of the responses, if the drive is periodic.
    """
    level = max(noise_level(run, name, longest=ENOUGH) or 0.0, rounding(run.channel(name).read(0, ENOUGH)))
    run, others = _begun(run, name, drive), [_begun(other, name, drive) for other in others if _alike(run, other, name, drive)]
    driven = driven_bins(run, spectra, drive)
    coherence = spectra.frf(name, drive).coherence[driven]
    begin = f"{name} has a coherence of {float(np.median(coherence)):.2f} with the drive"
    density = spectra.density(name)[driven]
    left = _incoherent_share(spectra, name, drive, driven)

    def because(kind: IncoherenceKind, text: str) -> Incoherence:
        return Incoherence(response=name, kind=kind, text=begin + text)

    if left * float(np.mean(density)) <= NOISE_RATIO * 2.0 * level**2 / run.sample_rate:
        return because("noise", " because of noise; drive harder, or use a more sensitive range or sensor, and repeat the run.")
    share, what = _not_repeated(run, spectra, name, drive, others)
    found = next((item for item in detections if item.response == name), None)
    reason = f"{what} agree" if share <= REPEATABLE * left else ""
    if found is not None and max(found.odd, found.even) > found.noise:
        reason = reason or "its distortion exceeds its noise"
    if reason or _by_level(run, spectra, name, drive, others):
        reason = reason or "its transfer function changes with the drive's level"
        return because(
            "nonlinear", f", but {reason}: the rig is nonlinear there, and the record is good; rig diagnose tells why."
        )
    if what and share >= NOT_REPEATABLE * left:
        return because(
            "noise",
            f", and {what} differ; look for another source of vibration, drive harder, and repeat the run. Impacts differ, too: "
            "they change the transfer function with the drive's level.",
        )
    if _less_in_longer_segments(run, spectra, name, drive, left):
        return because(
            "narrow",
            f", because resonances are narrower than the resolution of {spectra.resolution:.2g} Hz; measure a longer run for its "
            "transfer functions. rig diagnose needs none.",
        )
    return because(
        "undecided",
        ", although its record is above the sensor's noise: the rig is nonlinear, or something else moves it; a run with the "
        "same drive (repeat_of) decides it.",
    )


def driven_bins(run: Run, spectra: Spectra, drive: str) -> BoolArray:
    """The frequency bins within the band of a run in which its drive has power, shape (bins,)."""
    low, high = run.band or (spectra.resolution, 0.5 * run.sample_rate)
    density = np.where((spectra.frequency >= low) & (spectra.frequency <= high), spectra.density(drive), 0.0)
    return np.asarray((density >= WELL_DRIVEN * density.max()) & (density > 0.0))


def _begun(run: Run, name: str, drive: str) -> Run:
    # The two channels, not longer than memory allows.
    kept = {key: channel for key, channel in run.channels.items() if key in (name, drive)}
    return replace(run, channels={key: replace(channel, samples=channel.samples[:LONGEST]) for key, channel in kept.items()})


def _alike(run: Run, other: Run, name: str, drive: str) -> bool:
    # Whether another run can be compared with this one.
    same = other.configuration == run.configuration and other.sample_rate == run.sample_rate
    return same and other.id != run.id and {name, drive} <= set(other.channels)


def _incoherent_power(spectra: Spectra, name: str, drive: str, driven: BoolArray) -> float:
    return float(np.sum(((1.0 - spectra.frf(name, drive).coherence) * spectra.density(name))[driven]))


def _incoherent_share(spectra: Spectra, name: str, drive: str, driven: BoolArray) -> float:
    # The incoherent power of a response relative to its power, in the driven bins.
    return _incoherent_power(spectra, name, drive, driven) / max(float(np.sum(spectra.density(name)[driven])), 1e-300)


def _less_in_longer_segments(run: Run, spectra: Spectra, name: str, drive: str, left: float) -> bool:
    # Whether the ratio of incoherent to coherent power falls with the resolution, as that of a narrow resonance does: noise and
    # nonlinear parts keep theirs. An estimate from few averages is too small. `left` is the incoherent share of these spectra.
    try:
        finer = estimate([run], references=[drive], resolution=0.5 * spectra.resolution)
    except DataError:
        return False
    if finer.averages < LEAST_AVERAGES:
        return False

    def ratio(share: float, averages: float) -> float:
        unbiased = share / (1.0 - 1.0 / averages)
        return unbiased / max(1.0 - unbiased, 1e-9)

    share = _incoherent_share(finer, name, drive, driven_bins(run, finer, drive))
    return ratio(share, finer.averages) <= NARROW * ratio(left, spectra.averages)


def _not_repeated(run: Run, spectra: Spectra, name: str, drive: str, others: Sequence[Run]) -> tuple[float, str]:
    # Half the incoherent power of the difference of two records with one drive, relative to the response, and what was compared;
    # infinite if there are none. The difference obeys the same equations, so it removes what differs between the drives.
    driven = driven_bins(run, spectra, drive)
    whole = max(float(np.sum(spectra.density(name)[driven])), 1e-300)
    for one, other, what in _repeats(run, name, drive, others):
        n = min(len(each) for each in (*one, *other))
        channels = {
            key: replace(run.channels[key], samples=a[:n] - b[:n], scale=1.0, offset=0.0)
            for key, a, b in zip((drive, name), one, other, strict=True)
        }
        with suppress(DataError):
            apart = estimate([replace(run, channels=channels, gaps=())], references=[drive], resolution=spectra.resolution)
            return 0.5 * _incoherent_power(apart, name, drive, driven) / whole, what
    return np.inf, ""


def _repeats(
    run: Run, name: str, drive: str, others: Sequence[Run]
) -> Iterator[tuple[Sequence[FloatArray], Sequence[FloatArray], str]]:
    # Drive and response of a record and of another one with the same drive, and both in words.
    from isorig.analysis.fitting.repeats import same_drive

    x, y = run.read(drive), run.read(name)
    if run.period is not None and len(run) > (SETTLING + 1) * run.period and not run.gaps:
        settled, later = slice(SETTLING * run.period, -run.period), slice((SETTLING + 1) * run.period, None)
        yield (x[settled], y[settled]), (x[later], y[later]), "its periods"
    for other in others:
        if run.gaps or other.gaps:
            continue
        again = other.read(drive)
        if other.repeat_of == run.id or run.repeat_of == other.id or same_drive(x, again):
            late = _lag(x, again)
            mine, theirs = slice(max(-late, 0), None), slice(max(late, 0), None)
            yield (x[mine], y[mine]), (again[theirs], other.read(name)[theirs]), "two runs with the same drive"


def _lag(one: FloatArray, other: FloatArray) -> int:
    # By how many samples the second record of a drive is later than the first.
    from scipy.signal import correlate, correlation_lags

    across = correlate(other - other.mean(), one - one.mean(), method="fft")
    return int(correlation_lags(len(other), len(one))[int(np.argmax(across))])


def _by_level(run: Run, spectra: Spectra, name: str, drive: str, others: Sequence[Run]) -> bool:
    # Whether a run with another level has another transfer function.
    size = float(np.std(run.read(drive)))
    for other in others:
        ratio = float(np.std(other.read(drive))) / max(size, 1e-300)
        if max(ratio, 1.0 / max(ratio, 1e-300)) < LEVEL_RATIO:
            continue
        try:
            compared = estimate([other], references=[drive], resolution=spectra.resolution)
        except DataError:
            continue
        driven = driven_bins(run, spectra, drive) & driven_bins(other, compared, drive)
        one, two = spectra.frf(name, drive), compared.frf(name, drive)
        variance = 2.0 * (one.magnitude_std**2 + two.magnitude_std**2)
        apart = np.abs(one.value - two.value) ** 2 / np.maximum(variance, np.finfo(float).tiny)
        if driven.any() and float(np.mean(apart[driven])) >= DIFFERENT:
            return True
    return False
