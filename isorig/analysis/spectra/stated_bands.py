"""Runs whose stated frequency band is not that of their drive."""

from __future__ import annotations

import numpy as np

from isorig.analysis.campaign import Campaign
from isorig.analysis.spectra.windows import hanning

#: Share of the drive's power within the stated band below which the band is wrong. Chosen: a band may be narrower than the drive.
WITHIN = 0.1
#: Shares of the drive's power below the two frequencies that are named as its band.
ENDS = (0.01, 0.99)


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
