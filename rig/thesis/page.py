"""The page in its order."""

from __future__ import annotations

from collections.abc import Callable

from rig.characterized import characterize_campaign
from rig.thesis.campaign import LOW, SECONDS, played
from rig.thesis.early import early
from rig.thesis.isolation import motion, offsets, ratio
from rig.thesis.readings import half_power_explained, read, tables
from rig.thesis.rival import rival
from rig.thesis.step import Step
from rig.thesis.strokes import strokes
from rig.thesis.table import joint, simulated_over_measured, surface

PREFACE = (
    "`make thesis` works this page out anew: a virtual rig gets the thesis's parameters (Table 4, 20 N of Coulomb friction on "
    "the relative velocity, the locked motor riding on the table) and is measured as the thesis measured, at gain 70 from 0.5 to "
    "20 Hz and at gain 7 to 400 Hz, locked and unlocked; every figure comes from that campaign through the functions behind the "
    "commands. Where the thesis's figure stands beside ours, it is of the real rig.",
    "**Assumed**, because the thesis does not give it: a head of 6.5 kg; 3.8 m/s² rms of the head at gain 70 and in proportion "
    "at other gains; sensor noise of 1 mm/s² rms; ten moves in the worst case. What hangs on them is said at each place: the "
    "head's mass scales the force, so with the drive's level it decides how friction compares with it (only friction over drive "
    "matters), and the lowest frequency of the design.",
    "The commands say the same of any recording, one of `rig virtual campaign` too ([offline reanalysis](offline.md)): "
    "`rig characterize` writes fits.html, the joint fit beside the set-ups read one by one and the error surface, with the "
    "reason "
    "wherever half-power is refused; `rig isolation` tells the step between the gains, the share of time that friction holds the "
    "motor, and what the offset of the heatblock's peaks supports.",
)


def steps(share: float = 1.0, *, tell: Callable[[str], None] = lambda text: None) -> list[Step]:
    """All steps, from runs of `share` times their usual length."""
    tell(f"playing the campaign, {share * SECONDS[LOW]:g} s a run")
    data = played(share)
    tell("reading the set-ups")
    rough, smooth = read(data.measured), read(data.smooth)
    tell("fitting all runs")
    found = characterize_campaign(data.measured, lambda text: None)
    tell("all else")
    return [
        early(), tables(rough, smooth), half_power_explained(data), surface(rough, smooth), joint(found),
        simulated_over_measured(data, found), ratio(data), motion(data), offsets(data), rival(data), strokes(),
    ]  # fmt: skip
