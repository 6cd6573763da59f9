"""The look at a run right after it was taken, while it can still be repeated: coherence, clipping, dead channels, loss."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from analysis.detection import Detection, detect
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
#: Distortion above this share of the response, and above the noise, is told; a gain further off the plan's than this, too.
DISTORTED = 0.1
OFF_PLAN = 1e-3


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Whether a run is worth keeping, in sentences of what to do.

    Parameters
    ----------
    good
        Whether nothing speaks against keeping it.
    coherence
        Median coherence of each response with the drive inside its band.
    detections
        Noise and distortion of each response, where the drive repeats and leaves lines out.
    sliding
        rms of the motor's motion relative to the table over that of its own: near 0 where friction holds it; None where not seen.
    advice
        What to do, also what is no fault.
    """

    good: bool
    coherence: dict[str, float]
    detections: tuple[Detection, ...]
    sliding: float | None
    advice: tuple[str, ...]


def check_run(found: Recovered, *, drive: str) -> Verdict:
    """Look at a run that was just taken."""
    run = found.run
    if run is None:
        return Verdict(
            good=False, coherence={}, detections=(), sliding=None,
            advice=("No sample arrived; check the instrument and take the run again.",),
        )  # fmt: skip
    coherence, detections, sliding = _coherence(found, drive), _detections(run, drive), _sliding(run)
    against = [*_on_the_way(found), *_channels(run), *_gain(run, found.planned_gain)]
    for name, value in coherence.items():
        if value < COHERENT:
            against.append(
                f"{name} follows the drive with a coherence of {value:.2f} only; "
                "more gain would help against noise, less against friction that hardly slides."
            )
    told = [sentence for item in detections if (sentence := _distortion(item)) is not None]
    if sliding is not None and sliding < STUCK:
        told.append("The motor moved with the table: friction was not overcome. Take a run at a larger gain as well.")
    return Verdict(
        good=not against, coherence=coherence, detections=detections, sliding=sliding, advice=(*against, *told)
    )  # fmt: skip


def _on_the_way(found: Recovered) -> Iterator[str]:
    if found.lost:
        yield f"{found.lost} samples were lost on the way; take the run again if it is to be simulated whole."
    if not found.finished:
        yield f"It ended at {found.stored + found.lost} of {found.planned} samples; check the instrument and take the run again."
    if found.overloads:
        yield f"The instrument told of {found.overloads} overloads; choose a larger range or a lower gain and take the run again."


def _channels(run: Run) -> Iterator[str]:
    sensors = {name: channel for name, channel in run.channels.items() if channel.quantity != "gain"}
    sizes = {name: float(run.read(name).std()) for name in sensors}
    loudest = max(sizes.values())
    for name, channel in sensors.items():
        if channel.full_scale is not None:
            clipped = int((np.abs(run.read(name)) >= 0.999 * channel.full_scale).sum())
            if clipped:
                yield f"{name} clipped {clipped} times; choose a larger range or a lower gain and take the run again."
        if sizes[name] <= DEAD * loudest:
            yield f"{name} hardly moves ({sizes[name]:.2g} {channel.unit} rms); check its cable and its power."


def _gain(run: Run, planned: float) -> Iterator[str]:
    if "gain" in run.channels:
        gains = run.read("gain")
        yield f"The gain moved from {gains.min():.4g} to {gains.max():.4g} in the run; leave the dial alone and take it again."
    elif abs(run.gain - planned) > OFF_PLAN * planned:
        yield f"The gain stood at {run.gain:.4g} and the plan says {planned:.4g}; set it and take the run again."


def _distortion(item: Detection) -> str | None:
    size = max(item.odd, item.even)
    if size <= max(DISTORTED, item.noise):
        return None
    return (
        f"{item.response} has lines that nothing drives, at {100 * size:.0f} % of those that are driven (noise "
        f"{100 * item.noise:.1g} %): that is distortion, which no averaging removes."
    )


def _sliding(run: Run) -> float | None:
    if run.configuration != "unlocked" or not {"motor", "table"} <= set(run.channels):
        return None
    motor = run.read("motor")
    return float((motor - run.read("table")).std() / max(float(motor.std()), 1e-30))


def _detections(run: Run, drive: str) -> tuple[Detection, ...]:
    if run.period is None or drive not in run.channels:
        return ()
    try:
        return tuple(detect(run, response=name, reference=drive) for name in run.channels if name not in (drive, "gain"))
    except DataError:
        return ()


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
