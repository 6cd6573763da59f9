"""The page in its order."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from isorig.rig.files.parameter_table import characterize_campaign
from isorig.rig.thesis.campaign import CALIBRATION, LOW, SECONDS
from isorig.rig.thesis.early import early
from isorig.rig.thesis.figure_readings import half_power_explained, read, tables
from isorig.rig.thesis.isolation import moved, offsets, ratio
from isorig.rig.thesis.moves import moves
from isorig.rig.thesis.questions import questions
from isorig.rig.thesis.rivals import base, compared, rivals
from isorig.rig.thesis.step import Step
from isorig.rig.thesis.strokes import strokes
from isorig.rig.thesis.table import joint, simulated_over_measured, surface

PREFACE = (
    "`make thesis` works this page out anew: virtual rigs are measured as the thesis measured, at gain 70 from 0.5 to 20 Hz "
    "and at "
    "gain 7 to 400 Hz, locked and unlocked, and every figure comes from those campaigns through the functions behind the "
    "commands. "
    "The page is about the rig that looks most like the thesis over all its figures; the others stand beside it.",
    "**Verdicts** follow from the numbers. A figure agrees where it lies inside what the thesis states, widened by the "
    "tolerance in "
    "brackets; it is of the same size where it is off by less than a factor of two, and differs where it is further off. The "
    "tolerance covers what the thesis does not say: window, lines, level, rounding.",
    "**Assumed**, because the thesis does not give it: a head of 6.5 kg; 3.8 m/s² rms of the head at gain 70 and in "
    "proportion at "
    f"other gains; sensor noise of 1 mm/s² rms; sensors calibrated to {CALIBRATION:.0%}; ten moves in the worst case. The "
    "head's mass "
    "scales the force, so with the drive's level it decides how friction compares with it: only friction over drive matters.",
    "The commands say the same of any recording, one of `rig virtual campaign` too ([offline reanalysis](offline.md)).",
)


def steps(share: float = 1.0, *, tell: Callable[[str], None] = lambda text: None) -> list[Step]:
    """All steps, from runs of `share` times their usual length."""
    tell(f"playing the campaigns, {share * SECONDS[LOW]:g} s a run")
    found = compared(share)
    chosen = base(found)
    data = chosen.played
    tell(f"nearest to the thesis: {data.candidate.name}")
    smooth = read(data.smooth)
    tell("fitting all runs")
    fits = [
        characterize_campaign(replace(item.played.measured, known=_calibrated(item.played.measured.known)), lambda text: None)
        for item in (chosen, next(iter(found.values()))[0])
    ]
    tell("all else")
    return [
        questions(found), rivals(found), early(data.candidate), tables(chosen.read, smooth), half_power_explained(data),
        surface(chosen.read, smooth), joint(*fits), simulated_over_measured(chosen, fits[0]), moves(data), ratio(data),
        moved(data), offsets(data), strokes(),
    ]  # fmt: skip


def _calibrated(known: Mapping[str, float]) -> dict[str, float]:
    return {**known, "calibration_std": CALIBRATION}
