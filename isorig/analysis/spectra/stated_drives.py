"""Runs whose stated band or excitation is not that of their drive: noise and sweeps exchanged, driven runs stated as free."""

import numpy as np

from isorig.analysis.campaign import Campaign, FloatArray, Run
from isorig.analysis.excitations import PLAYED_BROAD
from isorig.analysis.spectra.noise import noise_level, rests
from isorig.analysis.spectra.windows import hanning

#: Share of the drive's power within the stated band below which the band is wrong. Chosen: a band may be narrower than the drive.
WITHIN = 0.1
#: Shares of the drive's power below the two frequencies that are named as its band.
ENDS = (0.01, 0.99)
#: Parts of a drive, and frequency bins of a part within one standard deviation of the drive's frequencies: with fewer, a part
#: does not show which of them it has.
PARTS, BINS = 10, 4.0
#: Share of the variance of a drive's frequencies that is within its parts: at most the first of a sweep, which has one frequency
#: at a time, at least the second of noise. Chosen: sweeps have 0.01 to 0.08, noise and multisines 0.8 and more.
SWEPT, BROAD = 0.1, 0.7
#: Coefficient of variation of a drive's envelope above which it is no fast sweep: 0 of a sweep, 0.52 of noise (Rayleigh).
UNEVEN = 0.35
#: A record is as large to its end if its smallest part has at least this share of the rms of the middle one. Chosen: noise has
#: 0.8, a decay less than 0.1.
STEADY = 0.5


def wrong_bands(campaign: Campaign, drive: str) -> list[str]:
    """A sentence for each run whose stated band is beyond its sample rate, or has hardly any power of its drive, recorded in the
    channel `drive`."""
    found = []
    for run in campaign.runs:
        # A run without a period of the band has no spectrum in it.
        if run.band is None or drive not in run.channels or run.duration * run.band[1] < 1.0:
            continue
        if run.band[1] > run.sample_rate / 2.0:
            found.append(
                f"Run {run.id!r} states a band up to {run.band[1]:g} Hz, but {run.sample_rate:g} samples/s contain "
                f"only frequencies up to {run.sample_rate / 2.0:g} Hz: correct the band, or the sample rate in the mapping."
            )
            continue
        values = run.read(drive)
        power = np.abs(np.fft.rfft((values - values.mean()) * hanning(len(values)))) ** 2
        total, frequency = float(power.sum()), np.fft.rfftfreq(len(values), 1.0 / run.sample_rate)
        # A bin on each side belongs to the band, because the window widens a line.
        margin = 2.0 / run.duration
        inside = (frequency >= run.band[0] - margin) & (frequency <= run.band[1] + margin)
        share = float(power[inside].sum()) / total if total > 0.0 else 1.0
        if share < WITHIN:
            low, high = frequency[np.searchsorted(np.cumsum(power) / total, ENDS)]
            left = f"{100.0 * (1.0 - share):.3g} %"
            found.append(
                f"Run {run.id!r} states a band of {run.band[0]:g} to {run.band[1]:g} Hz, but {left} of the "
                f"power of its drive {drive!r} is outside, from {low:.3g} to {high:.3g} Hz: correct the band, the sample rate or "
                "the drive's channel in the mapping."
            )
    return found


def wrong_excitations(campaign: Campaign, drive: str) -> list[str]:
    """A sentence for each run whose stated excitation is not that of its drive, recorded in the channel `drive`."""
    found = []
    for run in campaign.runs:
        if drive not in run.channels or len(run) < 2 * PARTS:
            continue
        if run.excitation == "free" and _is_driven(run, drive):
            found.append(
                f"Run {run.id!r} states the excitation free, but its drive {drive!r} and all responses are as large to the end: "
                "correct the excitation, or the drive's channel in the mapping."
            )
        elif run.excitation in PLAYED_BROAD and run.period is None:
            values = run.read(drive)
            within = _within_parts(values - values.mean())
            if within is None:
                continue
            if run.excitation != "sweep" and within < SWEPT:
                found.append(
                    f"Run {run.id!r} states the excitation {run.excitation}, but its drive {drive!r} has one frequency at a "
                    "time, which changes over the run: write sweep, or other for steps of a sine."
                )
            elif run.excitation == "sweep" and within > BROAD and _unevenness(values - values.mean()) > UNEVEN:
                found.append(
                    f"Run {run.id!r} states the excitation sweep, but its drive {drive!r} has all of its frequencies at any "
                    "time: write random, multisine, moves or other."
                )
    return found


def _within_parts(values: FloatArray) -> float | None:
    # Share of the variance of the frequencies, weighted with power, within the parts; None if parts are too short to show it.
    _, _, variance = _frequencies(values)
    length = len(values) // PARTS
    if BINS / length > np.sqrt(variance):
        return None
    parts = [_frequencies(part) for part in values[: PARTS * length].reshape(PARTS, length)]
    powers, means, variances = np.array(parts).T
    middle = powers @ means / powers.sum()
    within, between = powers @ variances, powers @ (means - middle) ** 2
    return float(within / (within + between))


def _frequencies(values: FloatArray) -> tuple[float, float, float]:
    # Power, and mean and variance of its frequencies in cycles per sample.
    power = np.abs(np.fft.rfft(values * hanning(len(values)))) ** 2
    total, frequency = max(float(power.sum()), 1e-300), np.fft.rfftfreq(len(values))
    mean = float(power @ frequency) / total
    return total, mean, float(power @ (frequency - mean) ** 2) / total


def _unevenness(values: FloatArray) -> float:
    # Coefficient of variation of the envelope (of the analytic signal).
    lines = np.fft.fft(values)
    lines[len(values) // 2 + 1 :] = 0.0
    envelope = np.abs(np.fft.ifft(lines))
    return float(envelope.std() / max(float(envelope.mean()), 1e-300))


def _is_driven(run: Run, drive: str) -> bool:
    # A rig that is released comes to rest, and the noise of a drive's channel does not move it.
    if rests(run.read(drive), noise_level(run, drive) or 0.0):
        return False
    return all(_is_steady(channel.read()) for channel in run.channels.values())


def _is_steady(values: FloatArray) -> bool:
    length = len(values) // PARTS
    sizes = values[: PARTS * length].reshape(PARTS, length).std(axis=1)
    return bool(sizes.min() >= STEADY * np.median(sizes) > 0.0)
