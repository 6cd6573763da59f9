"""The reason for a low coherence: the sensors' noise, a nonlinear rig, or undecided from the runs so far.

A response that is not coherent with the drive is either not caused by it (noise, another source) or caused by it nonlinearly. The
second one is repeatable: it is equal in two runs with one drive, lies between the driven frequencies of a periodic drive, or
changes the transfer function with the drive's level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from isorig.analysis.campaign import Campaign, Run
from isorig.analysis.errors import DataError
from isorig.analysis.fitting.repeats import same_drive
from isorig.analysis.spectra.detection import Detection
from isorig.analysis.spectra.noise import noise_levels
from isorig.analysis.spectra.overload import LONGEST
from isorig.analysis.spectra.welch import Spectra, estimate
from isorig.rig.acquire.policy import DIFFERENT, DIFFERENT_BINS, LEVEL_RATIO, NOISE_RATIO, NOT_REPEATABLE, REPEATABLE


@dataclass(frozen=True, kw_only=True)
class Incoherence:
    """Why a response is incoherent, and the sentence for the operator."""

    kind: Literal["noise", "nonlinear", "undecided"]
    text: str


def incoherence(
    run: Run, spectra: Spectra, name: str, drive: str, *, others: Sequence[Run] = (), detections: Sequence[Detection] = ()
) -> Incoherence:  # fmt: skip
    """The reason for a low coherence of a response.

    Parameters
    ----------
    run, spectra
        The run, and its spectra.
    name, drive
        The response and the drive's channel.
    others
        Other runs of the session.
    detections
        Noise and distortion of the responses, if the drive is periodic.
    """
    run, others = _begun(run, name, drive), [_begun(other, name, drive) for other in others]
    low, high = run.band or (0.0, 0.5 * run.sample_rate)
    inside = (spectra.frequency >= low) & (spectra.frequency <= high)
    frf = spectra.frf(name, drive)
    begin = f"{name} has a coherence of {float(np.median(frf.coherence[inside])):.2f} with the drive"
    density = spectra.density(name)[inside]
    left = float(np.sum((1.0 - frf.coherence[inside]) * density) / max(float(np.sum(density)), 1e-300))
    noisy = Incoherence(
        kind="noise", text=f"{begin} because of noise; drive harder, or use a more sensitive range or sensor, and repeat the run."
    )
    level = noise_levels(Campaign(runs=(run,))).get(name, 0.0)
    if left * float(np.mean(density)) <= NOISE_RATIO * 2.0 * level**2 / run.sample_rate:
        return noisy
    share = _not_repeated(run, name, drive, others)
    if share is not None and share >= NOT_REPEATABLE * left:
        return Incoherence(
            kind="noise",
            text=f"{begin}, and differs between runs with the same drive; look for another source of vibration, drive harder, "
            "and repeat the run.",
        )  # fmt: skip
    found = next((item for item in detections if item.response == name), None)
    distorted = found is not None and max(found.odd, found.even) > found.noise
    reason = "two runs with the same drive agree" if share is not None and share <= REPEATABLE * left else ""
    reason = reason or ("its distortion exceeds its noise" if distorted else "")
    reason = reason or (
        "its transfer function changes with the drive's level" if _by_level(run, spectra, name, drive, others) else ""
    )
    if reason:
        return Incoherence(
            kind="nonlinear",
            text=f"{begin}, but {reason}: the rig is nonlinear there, and the record is good; rig diagnose finds the cause.",
        )  # fmt: skip
    return Incoherence(
        kind="undecided",
        text=f"{begin}, which is more than the sensor's noise: the rig is nonlinear, or something else moves it; a run with the "
        "same drive (repeat_of) decides it.",
    )  # fmt: skip


def _begun(run: Run, name: str, drive: str) -> Run:
    # The two channels, not longer than memory allows.
    kept = {key: channel for key, channel in run.channels.items() if key in (name, drive)}
    return replace(run, channels={key: replace(channel, samples=channel.samples[:LONGEST]) for key, channel in kept.items()})


def _not_repeated(run: Run, name: str, drive: str, others: Sequence[Run]) -> float | None:
    # Half the power of the difference of two runs with one drive, relative to the response; None if there is no such run.
    for other in others:
        known = {name, drive} <= set(other.channels) and other.id != run.id and other.configuration == run.configuration
        if not known or other.sample_rate != run.sample_rate:
            continue
        n = min(len(run), len(other))
        one, two = (each.channels[name].read(0, n) for each in (run, other))
        if other.repeat_of == run.id or run.repeat_of == other.id or same_drive(run.read(drive), other.read(drive)):
            return float(0.5 * np.var(one - two) / max(float(np.var(one)), 1e-300))
    return None


def _by_level(run: Run, spectra: Spectra, name: str, drive: str, others: Sequence[Run]) -> bool:
    # Whether a run with another level has another transfer function.
    size = float(np.std(run.read(drive)))
    for other in others:
        if not {name, drive} <= set(other.channels) or other.configuration != run.configuration or other.id == run.id:
            continue
        ratio = float(np.std(other.read(drive))) / max(size, 1e-300)
        if other.sample_rate != run.sample_rate or max(ratio, 1.0 / max(ratio, 1e-300)) < LEVEL_RATIO:
            continue
        try:
            compared = estimate([other], references=[drive], resolution=spectra.resolution)
        except DataError:
            continue
        low, high = run.band or (0.0, 0.5 * run.sample_rate)
        one, two = spectra.frf(name, drive), compared.frf(name, drive)
        n = min(len(one.value), len(two.value))
        inside = (one.frequency[:n] >= low) & (one.frequency[:n] <= high)
        apart = np.abs(one.value[:n] - two.value[:n]) > DIFFERENT * np.hypot(one.magnitude_std[:n], two.magnitude_std[:n])
        if inside.any() and float(np.mean(apart[inside])) >= DIFFERENT_BINS:
            return True
    return False
