"""Fleets of virtual rigs whose campaigns are recorded: each rig scatters from campaign to campaign, and some change."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import timedelta
from pathlib import Path

import msgspec
import numpy as np
from made_up import FIRST, PARAMETERS, SCATTER, SPRING

from isorig.analysis.diagnose.causes.at_link import added
from isorig.analysis.diagnose.causes.measurement_chain import with_chain
from isorig.analysis.laws import EndStop
from isorig.analysis.model.rig_model import Configuration, RigModel
from isorig.rig.files.recording import write
from isorig.rig.virtual.levels import BEGIN
from isorig.rig.wire_bonder.description import FRICTION, THESIS, wire_bonder
from isorig.rig.wire_bonder.session import SESSION, virtual_campaign

Draw = np.random.Generator
#: A session as short as a diagnosis can be sure of: ten seconds a run.
TAKES = tuple(replace(take, seconds=10.0) for take in SESSION if take.id in ("u70a", "u7", "l70", "l7"))


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """What happens to a rig, and how a right answer names it: cause, place, and the parameters that may be said to change."""

    change: Callable[[RigModel], RigModel]
    cause: str
    place: str


def wear(draw: Draw) -> Hidden:
    """Friction wears: it loses 12 to 25 %, four deviations of its scatter and more."""
    factor = 1.0 - draw.uniform(0.12, 0.25)
    return Hidden(change=lambda m: m.replace({FRICTION: factor * m.get(FRICTION)}), cause="friction_force", place="isolation")


def spring(draw: Draw) -> Hidden:
    """A spring loses 4 to 10 % of its stiffness, four deviations of its scatter and more."""
    factor = 1.0 - draw.uniform(0.04, 0.10)
    return Hidden(change=lambda m: m.replace({SPRING: factor * m.get(SPRING)}), cause="stiffness", place="isolation")


def gain(draw: Draw) -> Hidden:
    """A sensor's gain is off by 4 to 15 %."""
    channel = str(draw.choice(["motor", "table", "heatblock"]))
    factor = 1.0 + float(draw.choice([-1.0, 1.0])) * draw.uniform(0.04, 0.15)
    return Hidden(change=lambda m: with_chain(m, channel, gain=factor), cause="sensor_gain", place=channel)


def lock(draw: Draw) -> Hidden:
    """The clamp yields: 50 to 400 times as stiff as the isolation."""
    times, ratio = draw.uniform(50.0, 400.0), draw.uniform(0.01, 0.05)

    def yielding(m: RigModel) -> RigModel:
        stiffness = times * m.link("isolation").stiffness
        damping = 2.0 * ratio * float(np.sqrt(stiffness * m.body("motor").mass))
        locked = Configuration(rigid=("isolation",), lock_stiffness=stiffness, lock_damping=damping)
        return msgspec.structs.replace(m, configurations={**m.configurations, "locked": locked})

    return Hidden(change=yielding, cause="imperfect_lock", place="lock")


def worn(factor: float) -> Hidden:
    """Friction changes by a factor."""
    return Hidden(change=lambda m: m.replace({FRICTION: factor * m.get(FRICTION)}), cause="friction_force", place="isolation")


def stopped(stroke: float, times: float) -> Hidden:
    """The isolation meets a stop after a stroke, m, which is so many times as stiff."""

    def change(m: RigModel) -> RigModel:
        stiffness = times * m.link("isolation").stiffness
        return added(m, m.link("isolation"), EndStop(stroke=stroke, contact_stiffness=stiffness))

    return Hidden(change=change, cause="end_stop", place="isolation")


KINDS: Mapping[str, Callable[[Draw], Hidden]] = {"wear": wear, "spring": spring, "gain": gain, "lock": lock}


def drawn_rig(draw: Draw) -> RigModel:
    """A wire bonder that differs from its siblings by per cents."""
    values = {**THESIS, "friction_force": 10.0}
    for name in values:
        values[name] *= 1.0 + 0.05 * draw.uniform(-1.0, 1.0)
    return wire_bonder(values)


def today(model: RigModel, draw: Draw) -> RigModel:
    """The rig as it is on one day: its parameters scatter."""
    return model.replace(
        {path: model.get(path) * float(np.exp(s * draw.normal())) for path, s in zip(PARAMETERS, SCATTER, strict=True)}
    )


def record(file: Path, model: RigModel, week: int, seed: int) -> None:
    """Record a campaign of a rig as it is in a week."""
    campaign = virtual_campaign(model, TAKES, seed=seed)
    later = FIRST - BEGIN + timedelta(days=7 * week)
    runs = tuple(replace(run, started=run.started + later) for run in campaign.runs if run.started is not None)
    file.parent.mkdir(parents=True, exist_ok=True)
    write(file, replace(campaign, runs=runs))


def record_fleet(folder: Path, seed: int, *, rigs: int, weeks: int, hidden: Mapping[int, tuple[int, Hidden]]) -> None:
    """Record every week of every rig; `hidden` says from which week on a rig is changed, and how."""
    for k in range(rigs):
        draw = np.random.default_rng([seed, k])
        rig = drawn_rig(draw)
        for week in range(weeks):
            model = today(rig, draw)
            if k in hidden and week >= hidden[k][0]:
                model = hidden[k][1].change(model)
            record(folder / f"rig-{k:02d}" / f"week-{week:02d}.h5", model, week, int(draw.integers(2**31)))
