"""The look at a run right after it was taken, while it can still be repeated: coherence, clipping, dead channels, loss."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.errors import DataError
from analysis.isolation import broad
from analysis.measured import Run
from analysis.spectra import estimate
from rig.acquire.recover import Recovered

#: Below this median coherence inside the drive's band a run shows more than its drive.
COHERENT = 0.5
#: A channel quieter than this share of the loudest of its kind is dead or not plugged in.
DEAD = 1e-4
#: Below this share of motion against the table the motor is stuck.
STUCK = 0.2


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Whether a run is worth keeping, in sentences of what to do.

    Parameters
    ----------
    good
        Whether nothing speaks against keeping it.
    coherence
        Median coherence of each response with the drive inside its band.
    sliding
        rms of the motor's motion relative to the table over that of its own: near 0 where friction holds it; None where not seen.
    advice
        What to do, also what is no fault.
    """

    good: bool
    coherence: dict[str, float]
    sliding: float | None
    advice: tuple[str, ...]


def check_run(found: Recovered, *, drive: str = "head") -> Verdict:
    """Look at a run that was just taken."""
    run = found.run
    if run is None:
        return Verdict(
            good=False, coherence={}, sliding=None, advice=("No sample arrived; check the instrument and take the run again.",)
        )
    advice: list[str] = []
    if found.lost:
        advice.append(f"{found.lost} samples were lost on the way; take the run again if it is to be simulated whole.")
    if found.overloads:
        advice.append(
            f"The instrument reported {found.overloads} overloads; choose a larger range or a lower gain and take the run again."
        )
    sizes = {name: float(run.read(name).std()) for name in run.channels if name != "gain"}
    loudest = max(sizes.values())
    for name, channel in run.channels.items():
        if channel.quantity == "gain":
            continue
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
    if "gain" in run.channels:
        gains = run.read("gain")
        advice.append(
            f"The gain moved from {gains.min():.4g} to {gains.max():.4g} in the run; leave the dial alone and take it again."
        )
    good = not advice
    sliding = _sliding(run)
    if sliding is not None and sliding < STUCK:
        advice.append("The motor moved with the table: friction was not overcome. Take a run at a larger gain as well.")
    return Verdict(good=good, coherence=coherence, sliding=sliding, advice=tuple(advice))


def _sliding(run: Run) -> float | None:
    if run.configuration != "unlocked" or not {"motor", "table"} <= set(run.channels):
        return None
    motor = run.read("motor")
    return float((motor - run.read("table")).std() / max(float(motor.std()), 1e-30))


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
        if name not in (drive, "gain") and inside.any()
    }
