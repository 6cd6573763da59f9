"""The look at a run right after it was taken, while it can still be repeated: coherence, clipping, dead channels, loss."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.errors import DataError
from analysis.isolation import broad
from analysis.spectra import estimate
from rig.acquire.recover import Recovered

#: Below this median coherence inside the drive's band a run shows more than its drive.
COHERENT = 0.5
#: A channel quieter than this share of the loudest of its kind is dead or not plugged in.
DEAD = 1e-4


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Whether a run is worth keeping, in sentences of what to do; median coherence of each response inside the band."""

    good: bool
    coherence: dict[str, float]
    advice: tuple[str, ...]


def check_run(found: Recovered, *, drive: str = "head") -> Verdict:
    """Look at a run that was just taken."""
    run = found.run
    if run is None:
        return Verdict(good=False, coherence={}, advice=("No sample arrived; check the instrument and take the run again.",))
    advice: list[str] = []
    if found.lost:
        advice.append(f"{found.lost} samples were lost on the way; take the run again if it is to be simulated whole.")
    sizes = {name: float(run.read(name).std()) for name in run.channels}
    loudest = max(sizes.values())
    for name, channel in run.channels.items():
        values = np.abs(run.read(name))
        if channel.full_scale is not None:
            clipped = int((values >= 0.999 * channel.full_scale).sum())
            if clipped:
                advice.append(f"{name} clipped {clipped} times; choose a larger range or a lower gain and take the run again.")
        if sizes[name] <= DEAD * loudest:
            advice.append(f"{name} hardly moves ({sizes[name]:.2g} {channel.unit} rms); check its cable and its power.")
    coherence = _coherence(found, drive)
    for name, value in coherence.items():
        if value < COHERENT:
            advice.append(
                f"{name} follows the drive with a coherence of {value:.2f} only; "
                "more gain would help against noise, less against friction that hardly slides."
            )
    return Verdict(good=not advice, coherence=coherence, advice=tuple(advice))


def _coherence(found: Recovered, drive: str) -> dict[str, float]:
    run = found.run
    if run is None or drive not in run.channels or not broad([run]) or run.band is None:
        return {}
    try:
        spectra = estimate([run], references=[drive], resolution=max(0.5, 8.0 / run.duration))
    except DataError:
        return {}
    inside = (spectra.frequency >= run.band[0]) & (spectra.frequency <= run.band[1])
    return {
        name: float(np.median(spectra.frf(name, drive).coherence[inside]))
        for name in run.channels
        if name != drive and inside.any()
    }
