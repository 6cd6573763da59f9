"""The transfer functions of a campaign: one of each response, configuration and gain, with the band that was driven."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from isorig.analysis.campaign import Campaign, Run, broad
from isorig.analysis.errors import DataError
from isorig.analysis.spectra.gain_levels import by_level
from isorig.analysis.spectra.inputs import Estimator
from isorig.analysis.spectra.periodic import PeriodicFrf, periodic
from isorig.analysis.spectra.quality import Fault, faults, sound
from isorig.analysis.spectra.welch import Frf, estimate


@dataclass(frozen=True, kw_only=True)
class Transfer:
    """A transfer function and the runs that it was averaged over; `band` is the drive's, Hz.

    `left_out` are runs whose records are spoilt; `periods` is the same period by period, where the drive repeats.
    """

    frf: Frf
    configuration: str
    gain: float
    runs: tuple[str, ...]
    band: tuple[float, float]
    left_out: tuple[str, ...] = ()
    periods: PeriodicFrf | None = None

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
    found: Sequence[Fault] | None = None,
) -> list[Transfer]:
    """Transfer functions by response, configuration and gain (highest first), averaged over the broad-band runs.

    A run in which the gain changed counts as one for every level.

    Parameters
    ----------
    campaign
        Measured or simulated.
    reference, responses, resolution, estimator
        As in `isorig.analysis.spectra.welch`; all other channels where no response is named.
    found
        What is wrong with the campaign's records; worked out where None. Spoilt runs are left out where others remain.

    Raises
    ------
    DataError
        Where no run has a broad-band drive, or a channel is missing.

    Examples
    --------
    >>> import isorig as iso
    >>> found = iso.frf(iso.read("campaign.h5"), reference="table", responses=["heatblock"], resolution=0.5)
    >>> [item.label for item in found]
    ['unlocked, gain 70', 'unlocked, gain 7', 'locked, gain 70', 'locked, gain 7']
    >>> peak = abs(found[3].frf.value).argmax()
    >>> bool(abs(found[3].frf.frequency[peak] - 164.5) <= 1.0)
    True
    """
    campaign = by_level(campaign)
    runs = broad(campaign.runs)
    if not runs:
        raise DataError(f"{campaign.source} has no run with a broad-band drive; measure one with noise, a multisine or a sweep")
    wrong = faults_in(campaign, reference) if found is None else found
    transfers = []
    for configuration, gain in sorted({(run.configuration, run.gain) for run in runs}, key=lambda k: (k[0] != "unlocked", -k[1])):
        same = broad(campaign.select(configuration=configuration, gain=gain))
        names = responses or [name for name in same[0].sensors if name != reference]
        # Responses that share their sound runs share one pass.
        alike: dict[tuple[str, ...], list[str]] = {}
        for name in names:
            alike.setdefault(tuple(run.id for run in sound(same, wrong, [reference, name])), []).append(name)
        for kept, group in alike.items():
            averaged = [run for run in same if run.id in kept]
            left_out = tuple(run.id for run in same if run.id not in kept)
            transfers += _averaged(averaged, reference, group, resolution, estimator, left_out)
    return sorted(transfers, key=lambda item: item.frf.response)


def faults_in(campaign: Campaign, reference: str) -> tuple[Fault, ...]:
    """What is wrong with a campaign's records: driven by the head where it was measured, else by the reference."""
    head = any("head" in run.channels for run in campaign.runs)
    return faults(campaign, reference="head" if head else reference)


def _averaged(
    runs: list[Run], reference: str, names: Sequence[str], resolution: float, estimator: Estimator, left_out: tuple[str, ...]
) -> list[Transfer]:
    spectra = estimate(runs, references=[reference], channels=names, resolution=resolution)
    bands = [run.band for run in runs if run.band is not None]
    band = (max(b[0] for b in bands), min(b[1] for b in bands)) if bands else (resolution, runs[0].sample_rate / 2.56)
    return [
        Transfer(
            frf=spectra.frf(name, reference, estimator), configuration=runs[0].configuration, gain=runs[0].gain,
            runs=tuple(run.id for run in runs), band=(max(band[0], spectra.resolution), band[1]), left_out=left_out,
            periods=_by_period(runs, name, reference),
        )
        for name in names
    ]  # fmt: skip


def _by_period(runs: Sequence[Run], response: str, reference: str) -> PeriodicFrf | None:
    if any(run.period is None for run in runs):
        return None
    try:
        return periodic(runs, response=response, reference=reference)
    except DataError:  # too few periods: the average over segments remains
        return None


def about(item: Transfer) -> dict[str, Any]:
    """What a transfer function amounts to, as plain values."""
    seen = item.within_band()
    size = np.abs(seen.value)
    top = int(np.argmax(size))
    beside = {} if item.periods is None else {"periods": _about_periods(item.periods)}
    return {
        "name": item.name, "response": seen.response, "reference": seen.reference, "configuration": item.configuration,
        "gain": item.gain, "runs": list(item.runs), "left_out": list(item.left_out),
        "estimator": seen.estimator, "averages": seen.averages,
        "resolution_hz": seen.resolution, "band_hz": list(item.band),
        "peak": {
            "frequency_hz": float(seen.frequency[top]), "magnitude": float(size[top]),
            "magnitude_std": float(seen.magnitude_std[top]),
        },
        "median_coherence": float(np.median(seen.coherence)), **beside,
    }  # fmt: skip


def _about_periods(found: PeriodicFrf) -> dict[str, Any]:
    size = np.abs(found.value)
    noise, distortion = float(np.median(found.noise / size)), float(np.median(found.distortion / size))
    told = (
        f"its distortion {100 * distortion:.2g} %"
        if np.isfinite(distortion)
        else "its distortion is not told by one realization of the drive; repeat with other phases"
    )
    return {
        "periods": found.periods, "realizations": found.realizations, "lines": len(found.frequency), "relative_noise": noise,
        "relative_distortion": distortion if np.isfinite(distortion) else None,
        "text": f"Over {found.periods} periods of {found.realizations} runs the noise of {found.response} over "
        f"{found.reference} is {100 * noise:.2g} % (median over lines), {told}.",
    }  # fmt: skip
