"""The transfer functions of a campaign: one of each response, configuration and gain, with the band that was driven."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.errors import DataError
from analysis.isolation import broad
from analysis.measured import Campaign
from analysis.spectra import Estimator, Frf, estimate


@dataclass(frozen=True, kw_only=True)
class Transfer:
    """A transfer function and the runs that it was averaged over; `band` is the drive's, Hz."""

    frf: Frf
    configuration: str
    gain: float
    runs: tuple[str, ...]
    band: tuple[float, float]

    @property
    def name(self) -> str:
        """For a file."""
        return f"{self.frf.response}-over-{self.frf.reference}-{self.configuration}-gain{self.gain:g}"

    @property
    def label(self) -> str:
        """For a legend."""
        return f"{self.configuration}, gain {self.gain:g}"

    def within_band(self) -> Frf:
        """The lines that the drive reached."""
        f = self.frf.frequency
        kept = (f >= self.band[0]) & (f <= self.band[1])
        arrays = ("frequency", "value", "coherence", "magnitude_std", "phase_std")
        return replace(self.frf, **{name: getattr(self.frf, name)[kept] for name in arrays})


def transfer_functions(
    campaign: Campaign,
    *,
    reference: str = "head",
    responses: Sequence[str] = (),
    resolution: float = 0.25,
    estimator: Estimator = "H1",
) -> list[Transfer]:
    """Transfer functions by response, configuration and gain (highest first), averaged over the broad-band runs.

    Raises
    ------
    DataError
        Where no run has a broad-band drive, or a channel is missing.
    """
    runs = broad(campaign.runs)
    if not runs:
        raise DataError(f"{campaign.source} has no run with a broad-band drive; measure one with noise, a multisine or a sweep")
    found = []
    for configuration, gain in sorted({(run.configuration, run.gain) for run in runs}, key=lambda k: (k[0] != "unlocked", -k[1])):
        same = broad(campaign.select(configuration=configuration, gain=gain))
        names = responses or [
            name for name, channel in same[0].channels.items() if name != reference and channel.quantity != "gain"
        ]
        spectra = estimate(same, references=[reference], channels=names, resolution=resolution)
        bands = [run.band for run in same if run.band is not None]
        band = (max(b[0] for b in bands), min(b[1] for b in bands)) if bands else (resolution, same[0].sample_rate / 2.56)
        found += [
            Transfer(
                frf=spectra.frf(name, reference, estimator), configuration=configuration, gain=gain,
                runs=tuple(run.id for run in same), band=(max(band[0], spectra.resolution), band[1]),
            )
            for name in names
        ]  # fmt: skip
    return sorted(found, key=lambda item: item.frf.response)


def about(item: Transfer) -> dict[str, Any]:
    """What a transfer function amounts to, as plain values."""
    seen = item.within_band()
    size = np.abs(seen.value)
    top = int(np.argmax(size))
    return {
        "name": item.name, "response": seen.response, "reference": seen.reference, "configuration": item.configuration,
        "gain": item.gain, "runs": list(item.runs), "estimator": seen.estimator, "averages": seen.averages,
        "resolution_hz": seen.resolution, "band_hz": list(item.band),
        "peak": {
            "frequency_hz": float(seen.frequency[top]), "magnitude": float(size[top]),
            "magnitude_std": float(seen.magnitude_std[top]),
        },
        "median_coherence": float(np.median(seen.coherence)),
    }  # fmt: skip
