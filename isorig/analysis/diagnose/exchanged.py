"""Exchanged sensors from the equations of motion: strong friction or play hides them from the shapes of the spectra."""

from itertools import combinations

import msgspec

from isorig.analysis.campaign import Campaign
from isorig.analysis.diagnose.suspects import BROKEN
from isorig.analysis.equations.system import HOLDS, Equations, equations_of
from isorig.analysis.fitting.plausible import Doubt
from isorig.analysis.model.rig_model import RigModel

#: Fewest equations that must hold with two sensors exchanged, and the least share of all. Chosen: a single equation with free
#: values may hold by chance; a cause at one place breaks at most half of them.
FEWEST, SHARE = 2, 0.5


def exchanged_sensors(campaign: Campaign, model: RigModel, equations: Equations) -> tuple[Doubt, ...]:
    """Two sensors that seem exchanged: as recorded no equation holds, and with them exchanged most do.

    A cause in the rig leaves the equations that it is not in as they are. Raises OutOfTimeError at the end of the time limit.
    """
    before = equations.residuals()
    if equations.hidden or len(before) < FEWEST or min(before.values()) < BROKEN:
        return ()
    for one, other in combinations([sensor for sensor in model.sensors if sensor.force_in is None], 2):
        if one.quantity != other.quantity:
            continue
        channels = {one.channel: other.channel, other.channel: one.channel}
        sensors = tuple(
            msgspec.structs.replace(sensor, channel=channels.get(sensor.channel, sensor.channel)) for sensor in model.sensors
        )
        after = equations_of(campaign, msgspec.structs.replace(model, sensors=sensors)).residuals()
        hold = sum(residual < HOLDS for residual in after.values())
        if hold >= max(FEWEST, SHARE * len(after)):
            text = (
                f"{one.channel} and {other.channel} seem exchanged: {hold} of {len(after)} equations of motion hold only with "
                "their records exchanged; check the cables or rename the channels."
            )
            return (Doubt(parameter=f"channels.{one.channel}/{other.channel}", kind="swapped", ratio=1.0, text=text),)
    return ()
