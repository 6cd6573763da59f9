"""What would distinguish causes that no allowed run distinguishes: more stroke and a higher gain, or another sensor."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

import msgspec

from isorig.analysis.deadline import ask_time
from isorig.analysis.errors import OutOfTimeError
from isorig.analysis.fitting.screen import Progress
from isorig.analysis.model.limits import Limits
from isorig.analysis.model.rig_model import RigModel, Sensor
from isorig.analysis.proposals.choice import ComparedRuns, Comparison, PairDistance
from isorig.analysis.proposals.limits import LargestMotions
from isorig.analysis.proposals.policy import POLICY
from isorig.analysis.proposals.prediction import Key, Prospect
from isorig.analysis.simulate.gauges import gauged

#: Prefix of the channel of a second accelerometer.
SECOND = "second "


@dataclass(frozen=True, kw_only=True)
class Remedy:
    """A change that would distinguish two causes: the run with the required distance, in standard errors.

    `peaks` are those of a run that exceeds a limit; `channel` is the additional sensor, if one is needed: "deflection <link>" or
    "second <channel>".
    """

    prospect: Prospect
    distance: float
    peaks: LargestMotions | None = None
    channel: str = ""


def beyond_limits(
    comparison: Comparison, pair: tuple[Key, Key], beyond: Callable[[float], Sequence[Prospect]],
    peaks: Callable[[Prospect], LargestMotions], progress: Progress,
) -> Remedy | None:  # fmt: skip
    """The run with the smallest stroke beyond the limits that would distinguish a pair of causes; None if no raised gain does.

    `beyond` gives the candidates with gains raised by a factor, `peaks` the peaks of the remaining models in a candidate.
    `progress` is called before every candidate; when the deadline in force is over there is no answer.
    """
    with suppress(OutOfTimeError):
        for factor in POLICY.raised_gains:
            seen = comparison.seen(beyond(factor), Limits(), progress)
            found = [(pair_distance(comparison.distances([pairs]), pair), prospect) for prospect, pairs in seen.pairs]
            enough = [(peaks(prospect), size, prospect) for size, prospect in found if size >= POLICY.distinguishable]
            if enough:
                reached, size, best = min(enough, key=lambda item: max(item[0].stroke.values(), default=0.0))
                return Remedy(prospect=best, distance=size, peaks=reached)
            ask_time()
            progress("searching beyond the limits")
    return None


def another_sensor(comparison: Comparison, seen: ComparedRuns, pair: tuple[Key, Key], progress: Progress) -> Remedy | None:
    """The sensor that would distinguish a pair of causes in an allowed run; None if there is none."""
    ranked = sorted(seen.pairs, key=lambda item: -pair_distance(comparison.distances([item[1]]), pair))
    found: list[Remedy] = []
    with suppress(OutOfTimeError):
        for prospect, _ in ranked[: POLICY.tried_with_sensor]:
            ask_time()
            progress("searching for another sensor")
            sensors = partial(with_more_sensors, configuration=prospect.run.configuration)
            for channel, size in comparison.with_sensors(prospect, sensors, pair).items():
                if size >= POLICY.distinguishable:
                    found.append(Remedy(prospect=prospect, distance=size, channel=channel))
    return max(found, key=lambda remedy: remedy.distance, default=None)


def pair_distance(apart: Sequence[PairDistance], pair: tuple[Key, Key]) -> float:
    """The larger of a pair's two distances: the more general of two causes may fit everything that the other does."""
    return max((a.distance for a in apart if {a.truth.key, a.rival.key} == set(pair)), default=0.0)


def with_more_sensors(model: RigModel, configuration: str) -> RigModel:
    """The rig with a displacement sensor on every free link, and an accelerometer above every existing one.

    The latter differ from the existing ones only if a body rocks.
    """
    rotating = {name for sensor in model.sensors for name in sensor.arms}
    above = tuple(
        Sensor(
            channel=f"{SECOND}{s.channel}", body=s.body, relative_to=s.relative_to,
            arms={name: s.arms.get(name, 0.0) + POLICY.second_sensor_height * (name in s.arms) for name in rotating},
        )
        for s in model.sensors
        if s.quantity == "acceleration"
    )  # fmt: skip
    rig = gauged(model, configuration)
    return msgspec.structs.replace(rig, sensors=(*rig.sensors, *above))
