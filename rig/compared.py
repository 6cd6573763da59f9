"""The isolation ratio measured beside the one simulated, and what is to be said of it."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

import numpy as np

from analysis.isolation import STITCH, IsolationRatio, broad, isolation_ratio, stuck_share
from analysis.measured import Campaign
from analysis.model import RigModel
from rig.prediction import predicted


@dataclass(frozen=True, kw_only=True)
class Compared:
    """Ratios by name ("measured", and "simulated" where there is a model), and the share of time stuck by gain."""

    ratios: dict[str, IsolationRatio]
    stuck: dict[float, float]

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
    ratios = {"measured": isolation_ratio(campaign, stitch=stitch, resolution=resolution)}
    stuck: dict[float, float] = {}
    if model is not None:
        simulated = predicted(model, campaign, origin=origin, as_recorded=True)
        ratios["simulated"] = isolation_ratio(simulated, stitch=stitch, resolution=resolution)
        for piece in ratios["measured"].pieces:
            runs = broad(campaign.select(configuration="unlocked", gain=piece.gain))
            stuck[piece.gain] = float(np.mean([stuck_share(model, run) for run in runs]))
    return Compared(ratios=ratios, stuck=stuck)


def told(found: Compared) -> list[str]:
    """The ratio in sentences."""
    ratio = found.measured
    sentences = []
    for at, (step, std), above, below in zip(ratio.stitches, ratio.steps, ratio.pieces, ratio.pieces[1:], strict=False):
        if np.isfinite(step):
            sentences.append(
                f"At {at:g} Hz gain {above.gain:g} hands over to gain {below.gain:g} with a step: around it the ratio at gain "
                f"{above.gain:g} is {step:.2f} ± {std:.2f} of that at gain {below.gain:g}."
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
        if np.isfinite(peaks[2]):
            sentences.append(
                f"{name.capitalize()}, the heatblock's peak lies at {peaks[0]:.2f} Hz unlocked and {peaks[1]:.2f} Hz locked; "
                f"each peak taken at its own place, the ratio is {peaks[2]:.2f}."
            )
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
