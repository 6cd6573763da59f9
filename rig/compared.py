"""The isolation ratio measured beside the one simulated, and what is to be said of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

import numpy as np

from analysis.classic import as_read, classic
from analysis.errors import AnalysisError
from analysis.isolation import STITCH, IsolationRatio, Peaks, broad, isolation_ratio, stuck_share
from analysis.measured import Campaign
from analysis.model import RigModel
from analysis.offset import PeakOffset, peak_offset
from analysis.quality import Fault, faults, without
from rig.baseline import baseline_model
from rig.errors import RecordingError
from rig.prediction import predicted


@dataclass(frozen=True, kw_only=True)
class Compared:
    """Ratios by name ("measured", and "simulated" where there is a model), and the share of time stuck by gain.

    `offsets` are of the heatblock's peaks by the same names; `offset_refused` says why there are none. `faults` are of the
    records; what they spoil is left out where other runs remain.
    """

    ratios: dict[str, IsolationRatio]
    stuck: dict[float, float]
    offsets: dict[str, PeakOffset] = field(default_factory=dict)
    offset_refused: str = ""
    faults: tuple[Fault, ...] = ()

    @property
    def measured(self) -> IsolationRatio:
        """What the sensors say."""
        return self.ratios["measured"]


def compared_isolation(
    campaign: Campaign,
    model: RigModel | None,
    *,
    origin: datetime | None = None,
    stitch: float = STITCH,
    resolution: float = 0.25,
) -> Compared:
    """The ratio of a campaign, and of the same runs simulated where there is a model; one estimate for both."""
    wrong = faults(campaign)
    campaign = without(campaign, wrong, ("head", "heatblock"))
    ratios = {"measured": isolation_ratio(campaign, stitch=stitch, resolution=resolution)}
    campaigns = {"measured": campaign}
    stuck: dict[float, float] = {}
    if model is not None:
        campaigns["simulated"] = predicted(model, campaign, origin=origin, as_recorded=True)
        ratios["simulated"] = isolation_ratio(campaigns["simulated"], stitch=stitch, resolution=resolution)
        for piece in ratios["measured"].pieces:
            runs = broad(campaign.select(configuration="unlocked", gain=piece.gain))
            stuck[piece.gain] = float(np.mean([stuck_share(model, run) for run in runs]))
    try:
        guess = baseline_model(campaign)
        rig = model or as_read(classic(campaign, guess), guess)
        offsets, refused = {name: peak_offset(each, rig) for name, each in campaigns.items()}, ""
    except (AnalysisError, RecordingError) as error:
        offsets, refused = {}, str(error)
    return Compared(ratios=ratios, stuck=stuck, offsets=offsets, offset_refused=refused, faults=wrong)


def told(found: Compared) -> list[str]:
    """The ratio in sentences."""
    ratio = found.measured
    sentences = [fault.text for fault in found.faults]
    for at, (step, std), above, below in zip(ratio.stitches, ratio.steps, ratio.pieces, ratio.pieces[1:], strict=False):
        if np.isfinite(step):
            sentences.append(
                f"At {at:g} Hz gain {above.gain:g} hands over to gain {below.gain:g} with a step: around it the ratio at gain "
                f"{above.gain:g} is {step:.3f} ± {std:.1g} of that at gain {below.gain:g}."
            )
    for gain, share in found.stuck.items():
        sentences.append(
            f"At gain {gain:g} the simulated motor is stuck {100 * share:.0f} % of the time"
            + (
                "; the rig measures like a locked one there, so the ratio is near 1 for that reason alone."
                if share > 0.5
                else "."
            )
        )
    for name, peaks in ((name, r.peaks) for name, r in found.ratios.items()):
        if np.isfinite(peaks.ratio):
            sentences.append(
                f"{name.capitalize()}, the heatblock's highest line lies at {peaks.unlocked:.2f} Hz unlocked and "
                f"{peaks.locked:.2f} Hz locked; each peak taken at its own place, the ratio is {peaks.ratio:.3f} ± "
                f"{peaks.std:.1g}, line by line it is {peaks.by_line:.3f} at the unlocked peak."
            )
    sentences += [f"{name.capitalize()}. {offset.verdict}" for name, offset in found.offsets.items()]
    if found.offset_refused:
        sentences.append(f"The offset of the heatblock's peaks is not known: {found.offset_refused}.")
    if "simulated" in found.ratios:
        other = found.ratios["simulated"]
        for low, high in ((0.0, 5.0), (5.0, 9.0), (9.0, 15.0), (15.0, np.inf)):
            kept = (ratio.frequency >= low) & (ratio.frequency < high)
            if kept.any():
                off = np.abs(np.log(other.ratio[kept] / ratio.ratio[kept]))
                top = f"{high:g}" if np.isfinite(high) else f"{ratio.frequency[-1]:g}"
                sentences.append(
                    f"From {max(low, ratio.frequency[0]):g} to {top} Hz the simulated ratio differs from the measured one by "
                    f"{100 * (np.exp(np.median(off)) - 1):.2g} % (median over lines)."
                )
    return sentences


def about_peaks(peaks: Peaks) -> dict[str, float | None]:
    """The heatblock's peaks in the ratio as plain values; None where the drive does not reach them."""
    named = {
        "unlocked_hz": peaks.unlocked, "locked_hz": peaks.locked, "ratio": peaks.ratio, "ratio_std": peaks.std,
        "ratio_by_line": peaks.by_line,
    }  # fmt: skip
    return {name: value if np.isfinite(value) else None for name, value in named.items()}


def about_offset(offset: PeakOffset) -> dict[str, Any]:
    """The heatblock's peaks as plain values."""
    finite = np.isfinite(offset.slope)
    return {
        "gains": [
            {
                "gain": pair.gain, "unlocked_hz": pair.unlocked.frequency, "unlocked_std_hz": pair.unlocked.frequency_std,
                "locked_hz": pair.locked.frequency, "locked_std_hz": pair.locked.frequency_std, "offset_hz": pair.offset,
                "offset_std_hz": pair.std,
            }
            for pair in offset.pairs
        ],
        "mass_loading_hz": offset.mass_loading, "slope_hz_per_gain": offset.slope if finite else None,
        "slope_std_hz_per_gain": offset.slope_std if finite else None, "verdict": offset.verdict,
    }  # fmt: skip
