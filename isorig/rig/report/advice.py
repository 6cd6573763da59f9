"""Advice for the next measurement, from what is not identifiable from this one."""

from __future__ import annotations

import numpy as np

from isorig.analysis.campaign import Campaign, Run, broad
from isorig.analysis.isolation.ratio import stuck_share
from isorig.analysis.parameters.joint_fit import Characterization
from isorig.rig.report.sections import words

#: Text if there is no advice.
NOTHING = "The model can be used for rig predict, rig isolation and rig design."
#: Share of time stuck above which a gain does not show the isolation; rms force divided by friction at which the motor mostly
#: slides.
STUCK, SLIDES = 0.5, 1.2


def advice(campaign: Campaign, found: Characterization) -> list[str]:
    """Sentences, most important first: stronger excitation, missing second gains, unidentified parameters, held-out runs.

    None if there is no advice.
    """
    notes = [] if found.adequate else ["Run rig diagnose on this recording: it searches for the cause of the remaining error."]
    if found.head_mass is None:
        notes += [f"{name} is not determined ({entry.note})." for name, entry in found.table.items() if entry.value is None]
        return notes + _holdout(campaign)
    friction = found.table["friction_force"].value
    unlocked = {run.gain: run for run in broad(campaign.select(configuration="unlocked"))}
    if friction is not None:
        notes += [text for gain in sorted(unlocked) if (text := _stuck(found, unlocked[gain], friction))]
    notes += [
        f"The {words(name)} is not identifiable ({entry.note}): excite its frequency band more strongly or for longer."
        for name, entry in found.table.items()
        if entry.value is None
    ]
    peak = found.table["heatblock_frequency"].value
    if peak is not None and len({run.gain for run in broad(campaign.runs) if _reaches(run, peak)}) < 2:
        notes.append(
            f"Only one gain excites the heatblock's peak at {peak:.4g} Hz: measure this band at a second gain, locked and "
            "unlocked, to distinguish mass loading from friction and other nonlinearities."
        )
    return notes + _holdout(campaign)


def _holdout(campaign: Campaign) -> list[str]:
    if any(run.use == "holdout" for run in campaign.runs):
        return []
    return ['Record one more run with use = "holdout": a whole held-out run tests the model more strictly.']


def _stuck(found: Characterization, run: Run, friction: float) -> str:
    share = stuck_share(found.fit.model, run)
    if share <= STUCK:
        return ""
    force = found.fit.model.drive.factor * float(np.std(run.read(found.fit.model.drive.channel)))
    band = "" if run.band is None else f" from {run.band[0]:g} to {run.band[1]:g} Hz"
    return (
        f"At gain {run.gain:g}{band} the head's rms force is {force:.2g} N and friction is {friction:.3g} N, so that "
        f"the motor is stuck {100 * share:.0f} % of the time and the rig behaves like a locked one: use a narrower band and a "
        f"drive about {max(SLIDES * friction / force, 1.5):.2g} times stronger to measure the isolation there."
    )


def _reaches(run: Run, frequency: float) -> bool:
    return run.band is None or run.band[0] < frequency < run.band[1]
