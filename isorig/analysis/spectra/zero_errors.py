"""Accelerometers whose record has a mean that is no motion: a wrong zero, or gravity."""

from __future__ import annotations

import numpy as np

from isorig.analysis.campaign import Campaign

#: A mean acceleration is no motion if it changes the velocity within the run by more than this factor of the vibration's largest
#: change of velocity. Chosen: a body on springs ends a run within that change.
UNMOVED = 5.0
#: Share of the channel's largest standard deviation from which such a mean matters. Chosen: the simulation's own errors are a few
#: thousandths.
MATTERS = 0.01


def zero_errors(campaign: Campaign) -> dict[str, str]:
    """A sentence for each channel of acceleration with such a mean, by name: in the run in which it is largest compared with the
    vibration."""
    found = {}
    for name in dict.fromkeys(name for run in campaign.runs for name in run.sensors):
        means, largest = [], 0.0
        for run in campaign.runs:
            if name not in run.channels or run.channels[name].quantity != "acceleration":
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
            where = f"run {run.id!r}" + (f", and in {len(means) - 1} more," if len(means) > 1 else "")
            found[name] = (
                f"Channel {name!r} has a mean of {mean:.3g} {run.channels[name].unit} in {where} which would change the velocity "
                f"{float(f'{times:.2g}'):g} times as much as the vibration does: it is the sensor's zero error, or gravity, "
                "and no simulation contains it, so remove it by offset in the mapping."
            )
    return found
