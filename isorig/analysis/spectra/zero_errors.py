"""Accelerometers whose zero is wrong or wanders: a mean, or a slow part of the record, that is no motion."""

from collections.abc import Mapping

import numpy as np

from isorig.analysis.campaign import MOTION, ROTARY, Campaign, FloatArray, once
from isorig.analysis.wording import of_signal

#: A mean acceleration is no motion if it changes the velocity within the run by more than this factor of the vibration's largest
#: change of velocity. Chosen: a body on springs ends a run within that change.
UNMOVED = 5.0
#: Share of the channel's largest standard deviation from which such a mean matters. Chosen: the simulation's own errors are a few
#: thousandths.
MATTERS = 0.01
#: Share of the lowest natural frequency below which accelerations of a rig on springs are slow. Those due to a force are there
#: (f / f1)^2 times those of free bodies; a zero error exceeds what that leaves of the drive's slow part by `EXCEEDS`.
SLOW, EXCEEDS = 0.1, 10.0
#: Share of the rest of a record from which a slow part matters. Chosen: it disturbs a simulation's error of a few per cent.
WANDERS = 0.02


def zero_errors(campaign: Campaign) -> dict[str, str]:
    """A sentence for each channel of straight or angular acceleration with such a mean, by name: in the run in which it is
    largest compared with the vibration."""
    found = {}
    for name in dict.fromkeys(name for run in campaign.runs for name in run.sensors):
        means, largest = [], 0.0
        for run in campaign.runs:
            if name not in run.channels or MOTION.get(run.channels[name].quantity) != 2:
                continue
            values = run.read(name)
            mean = float(values.mean())
            largest = max(largest, float(values.std()))
            swing = float(np.ptp(np.cumsum(values - mean))) / run.sample_rate
            if abs(mean) * run.duration > UNMOVED * swing > 0.0:
                means.append((abs(mean) * run.duration / swing, mean, run))
        means = [one for one in means if abs(one[1]) > MATTERS * largest]
        if means:
            times, mean, run = max(means, key=lambda one: one[0])
            cause = "zero error," if run.channels[name].quantity in ROTARY else "zero error, or gravity,"
            where = f"run {run.id!r}" + (f", and in {len(means) - 1} more" if len(means) > 1 else "")
            found[name] = (
                f"Channel {name!r} has a mean of {mean:.3g} {run.channels[name].unit} in {where}, which would change the "
                f"velocity {float(f'{times:.2g}'):g} times as much as the vibration does: it is the sensor's {cause} "
                "and no simulation contains it, so remove it by offset in the mapping."
            )
    return found


@once
def wandering(campaign: Campaign, drive: str, lowest: float) -> dict[str, tuple[float, str]]:
    """Accelerometers whose zero wanders or is wrong: for each channel the largest share of its signal, and the run.

    Below `SLOW` of the lowest natural frequency (Hz) of a rig on springs a record of acceleration is no motion if its double
    integral is larger than that of the vibration, and if no force could cause it.
    """
    found: dict[str, tuple[float, str]] = {}
    for run in campaign.runs:
        of_drive, _ = _slow(run.read(drive), run.sample_rate, SLOW * lowest)
        for name in run.sensors:
            if name == drive or MOTION.get(run.channels[name].quantity) != 2 or len(run) < 2:
                continue
            share, travel = _slow(run.read(name), run.sample_rate, SLOW * lowest)
            if share > max(WANDERS, EXCEEDS * SLOW**2 * of_drive) and travel > UNMOVED:
                found[name] = max(found.get(name, (0.0, "")), (share, run.id))
    return found


def wandering_in_words(found: Mapping[str, tuple[float, str]], lowest: float) -> str:
    """The result of `wandering` for a lowest natural frequency in Hz as one sentence; empty if there is none."""
    if not found:
        return ""
    listed = ", ".join(f"{name!r} ({of_signal(share)} in run {run!r})" for name, (share, run) in found.items())
    zeros, wrong, count = (
        ("that of channel", "is wrong or wanders", "it does")
        if len(found) == 1
        else ("those of channels", "are wrong or wander", "they do")
    )
    return (
        f"Zero: {zeros} {listed} {wrong} below {SLOW * lowest:.2g} Hz: no motion of a rig on springs is so slow, so {count} not "
        "count."
    )


def _slow(values: FloatArray, rate: float, highest: float) -> tuple[float, float]:
    # rms of the slow part of a record as a share of the rest's, and the same of their double integrals.
    frequency = np.fft.rfftfreq(len(values), 1.0 / rate)
    power = np.abs(np.fft.rfft(values)) ** 2
    frequency[0] = 0.5 * rate / len(values)
    low = frequency < highest
    share, travel = (
        float(np.sqrt(np.sum(each[low]) / max(float(np.sum(each[~low])), 1e-300))) for each in (power, power / frequency**4)
    )
    return share, travel
