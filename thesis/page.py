"""The page in its order."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from isorig.rig.files.parameter_table import characterize_campaign
from thesis.campaign import CALIBRATION, LOW, SECONDS
from thesis.early import early
from thesis.figure_readings import half_power_explained, read, tables
from thesis.isolation import moved, offsets, ratio
from thesis.moves import moves
from thesis.questions import questions
from thesis.rivals import base, compared, rivals
from thesis.step import Step
from thesis.strokes import strokes
from thesis.table import joint, simulated_over_measured, surface

PREFACE = (
    "`make thesis` recomputes this page: virtual rigs are measured as in the thesis, at gain 70 from 0.5 to 20 Hz and at gain 7 "
    "up to 400 Hz, locked and unlocked, and every figure is computed from these campaigns by the functions behind the commands. "
    "The page describes the rig that agrees best with all figures of the thesis, and compares it with other candidates.",
    "**Verdicts** are computed from the numbers. A figure agrees if it is within the range stated by the thesis, widened by the "
    "tolerance in brackets; it has the same size if the difference is less than a factor of two, and differs otherwise. The "
    "tolerance covers what the thesis does not give: window, frequency resolution, level, rounding.",
    "**Assumed**, because the thesis does not give it: a head of 6.5 kg; 3.8 m/s² rms of the head at gain 70, proportional at "
    f"other gains; sensor noise of 1 mm/s² rms; sensors calibrated to {CALIBRATION:.0%}; ten moves in the worst case. Head mass "
    "and drive level determine the driving force; only the ratio of friction to this force matters.",
    "The commands give the same results for any recording, including those of `rig virtual campaign` "
    "([offline reanalysis](offline.md)).",
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
