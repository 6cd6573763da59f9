"""What a recording lacks for a diagnosis: several runs, long runs, a repeated drive, stated levels."""

from __future__ import annotations

from isorig.analysis.campaign import Campaign
from isorig.analysis.errors import AnalysisError
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.simulate.natural import natural_modes
from isorig.rig.frf.transfer import levels_in_words

#: Shortest run, in periods of the slowest mode. Chosen: of the 40 % of it that is held out, twenty periods remain.
PERIODS = 50.0


def missing(campaign: Campaign, model: RigModel) -> list[str]:
    """A sentence for each thing that a recording of this rig lacks."""
    said = []
    runs = campaign.runs
    if len(runs) == 1:
        said.append(
            "There is only one run: whether an error depends on the level of the drive is not known; record a second level."
        )
    # A released run ends when the rig stands still, and has no drive to repeat.
    driven = [run for run in runs if run.excitation != "free"]
    slowest = _slowest(model)
    short = [run for run in driven if slowest and run.duration * slowest < PERIODS]
    if short:
        which = f"run {short[0].id!r}" + (f" and {len(short) - 1} more" if len(short) > 1 else "")
        said.append(
            f"Shorter than {PERIODS:.0f} periods of the slowest mode ({slowest:.3g} Hz): {which}; "
            f"record at least {PERIODS / slowest:.0f} s."
        )
    if driven and not any(run.repeat_of or run.period for run in driven):
        said.append("No drive was played twice (repeat_of), so the disturbance is not measured and counts as error.")
    return said + levels_in_words(campaign, model.drive.channel)


def _slowest(model: RigModel) -> float:
    try:
        modes = [mode.frequency for name in model.configurations for mode in natural_modes(model, name)]
    except AnalysisError:
        return 0.0
    return min((f for f in modes if f > 0.0), default=0.0)
