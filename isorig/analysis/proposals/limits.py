"""Limits of a rig, and the peaks of a candidate run by simulation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf

import msgspec
import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import ModelError, SimulationError
from isorig.analysis.model.limits import Limits
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.parallel import side_by_side
from isorig.analysis.proposals.policy import POLICY
from isorig.analysis.simulate import Excitation, simulate, true_drives
from isorig.analysis.simulate.gauges import DEFLECTION, gauged


@dataclass(frozen=True, kw_only=True)
class LargestMotions:
    """Largest magnitudes in a run."""

    #: Deflection (m) and velocity (m/s) by link, for the links that are free in the configuration.
    stroke: Mapping[str, float]
    speed: Mapping[str, float]
    #: The drive channel in its unit, and its force, N.
    drive: float
    force: float
    channels: Mapping[str, float]  #: Records of every sensor and of the drive by channel, in its unit.

    def beyond(self, limits: Limits, usable: float = POLICY.usable_share) -> str:
        """What exceeds the usable share of its limit, in words; empty if nothing does."""
        pairs = [
            (f"the deflection of the {name}", self.stroke.get(name, 0.0), most, " m") for name, most in limits.stroke.items()
        ]
        pairs += [(f"the record of {name}", self.channels.get(name, 0.0), most, "") for name, most in limits.channels.items()]
        if limits.drive is not None:
            pairs.append(("the drive", self.drive, limits.drive, ""))
        if limits.force is not None:
            pairs.append(("the drive's force", self.force, limits.force, " N"))
        for what, size, most, unit in pairs:
            if not size <= usable * most:
                return f"{what} would reach {size:.3g}{unit} of the {most:.3g}{unit} allowed"
        return ""


def largest_of(peaks: Sequence[LargestMotions]) -> LargestMotions:
    """The largest peaks of several models, one by one."""
    return LargestMotions(
        stroke=_most([p.stroke for p in peaks]), speed=_most([p.speed for p in peaks]), drive=max(p.drive for p in peaks),
        force=max(p.force for p in peaks), channels=_most([p.channels for p in peaks]),
    )  # fmt: skip


def _most(found: Sequence[Mapping[str, float]]) -> dict[str, float]:
    names = {name for each in found for name in each}
    return {name: max(each.get(name, 0.0) for each in found) for name in sorted(names)}


def peaks_of(model: RigModel, motion: Mapping[str, FloatArray], drive: FloatArray, sample_rate: float) -> LargestMotions:
    """Peaks of a simulated run of a `gauged` rig; `motion` has recorded values by channel, `drive` is the true drive."""
    reached = _size(drive)
    weight = max((abs(w) for w in model.drive.pushes.values()), default=0.0)
    gauges = {name.removeprefix(DEFLECTION): values for name, values in motion.items() if name.startswith(DEFLECTION)}
    sensors = {name: _size(values) for name, values in motion.items() if not name.startswith(DEFLECTION)}
    return LargestMotions(
        stroke={name: _size(values) for name, values in gauges.items()},
        speed={name: _size(np.diff(values)) * sample_rate for name, values in gauges.items()},
        drive=reached, force=reached * abs(model.drive.factor) * weight,
        channels={**sensors, model.drive.channel: reached},
    )  # fmt: skip


def _size(values: FloatArray) -> float:
    return float(np.abs(values).max(initial=0.0))


def simulated_peaks(models: Sequence[RigModel], excitation: Excitation, configuration: str, start_time: float) -> LargestMotions:
    """Largest peaks of any of the models in a run, simulated from rest in full length.

    A model whose motion grows without bound counts as exceeding every limit.
    """

    def one(model: RigModel) -> LargestMotions:
        rig = gauged(model, configuration)
        drive = true_drives(model, excitation)[model.drive.channel]
        try:
            motion = simulate(rig, excitation, configuration=configuration, start_time=start_time, as_recorded=True).channels
        except (SimulationError, ModelError):
            motion = {sensor.channel: np.array([inf]) for sensor in rig.sensors}
        return peaks_of(rig, motion, drive, excitation.sample_rate)

    return largest_of(side_by_side(one, models))


def reached_so_far(limits: Limits, model: RigModel, peaks: LargestMotions) -> Limits:
    """The limits, with the peaks of the runs so far for limits that are not given.

    These are the stroke of every link that some configuration blocks (of all if there is none), because those links have stops;
    and the drive, if neither it nor a gain is limited.
    """
    blocked = {name for setup in model.configurations.values() for name in setup.rigid}
    moving = [link.name for link in model.links if link.name in blocked or not blocked]
    reached = {name: peaks.stroke[name] / POLICY.usable_share for name in moving if 0.0 < peaks.stroke.get(name, 0.0) < inf}
    free = limits.drive is None and limits.gains is None and peaks.drive > 0.0
    drive = peaks.drive / POLICY.usable_share if free else limits.drive
    return msgspec.structs.replace(limits, stroke={**reached, **limits.stroke}, drive=drive)
