"""What the next measurement should be like, from what this one could not tell."""

from __future__ import annotations

import numpy as np

from isorig.analysis.campaign import Campaign, Run, broad
from isorig.analysis.isolation.ratio import stuck_share
from isorig.analysis.parameters.joint_fit import Characterization
from isorig.rig.report.sections import words

#: What is said where nothing is missing.
NOTHING = "The model serves rig predict, rig isolation and rig design as it is."
#: Share of time stuck above which a gain tells nothing of the isolation, and rms force over friction that mostly slides.
STUCK, SLIDES = 0.5, 1.2


def advice(campaign: Campaign, found: Characterization) -> list[str]:
    """Sentences, most pressing first: what to drive harder, where a second gain is missing, what stays unknown, what to hold out.

    None where nothing is missing.
    """
    told = [] if found.adequate else ["Run rig diagnose on this recording: it looks for the cause of what is left."]
    friction = found.table["friction_force"].value
    unlocked = {run.gain: run for run in broad(campaign.select(configuration="unlocked"))}
    if friction is not None:
        told += [text for gain in sorted(unlocked) if (text := _stuck(found, unlocked[gain], friction))]
    told += [
        f"The {words(name)} stays unknown ({entry.note}): drive its band harder or longer."
        for name, entry in found.table.items()
        if entry.value is None
    ]
    peak = found.table["heatblock_frequency"].value
    if peak is not None and len({run.gain for run in broad(campaign.runs) if _reaches(run, peak)}) < 2:
        told.append(
            f"Only one gain reaches the heatblock's peak at {peak:.4g} Hz: drive its band at a second one, locked and "
            "unlocked, to "
            "tell mass loading from friction and other nonlinearities."
        )
    if not any(run.use == "holdout" for run in campaign.runs):
        told.append('Record one run more and mark it use = "holdout": a model judged on a run of its own is judged harder.')
    return told


def _stuck(found: Characterization, run: Run, friction: float) -> str:
    share = stuck_share(found.fit.model, run)
    if share <= STUCK:
        return ""
    force = found.fit.model.drive.factor * float(np.std(run.read(found.fit.model.drive.channel)))
    band = "" if run.band is None else f" from {run.band[0]:g} to {run.band[1]:g} Hz"
    return (
        f"At gain {run.gain:g}{band} the head pushes with {force:.2g} N rms against {friction:.3g} N of friction, so that "
        "the motor is "
        f"stuck {100 * share:.0f} % of the time and the rig measures like a locked one: drive narrower bands about "
        f"{max(SLIDES * friction / force, 1.5):.2g} times harder to see the isolation there."
    )


def _reaches(run: Run, frequency: float) -> bool:
    return run.band is None or run.band[0] < frequency < run.band[1]
