"""The design study of a file: moves and limit in, strokes, recommended frequency, histories and ratios out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import ModelError
from isorig.analysis.isolation import design
from isorig.analysis.isolation.moves import MoveIsolation, MoveResponse, isolation_by_level, move_within, on_move
from isorig.analysis.isolation.ratio import IsolationRatio, isolation_ratio
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.simulate.move_profile import Move, head_acceleration
from isorig.rig.errors import PlanError
from isorig.rig.files.parameter_seed import Seed
from isorig.rig.files.tomlfile import read_toml
from isorig.rig.virtual.campaign import Take, virtual_campaign

#: Samples per second: fifteen at least in a move of a hundredth of a second.
RATE = 2048.0
#: The motor swings out for this share of the slowest period after the last move.
TAIL = 0.6
#: Levels of moves by which isolation is shown, m/s^2: a bench's to the machine's.
LEVELS = np.geomspace(8.0, 208.0, 16)
#: Lines on which a drive's offset is looked at, Hz.
LINES = np.geomspace(0.5, 100.0, 1500)
TAKES = tuple(
    Take(id=f"{c[0]}{g:g}", configuration=c, gain=g, seconds=40.0, start=0.0, band=(0.5, top))
    for c in ("unlocked", "locked")
    for g, top in ((70.0, 20.0), (7.0, 400.0))
)


class MovePlan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Moves alike: distance in m, largest acceleration in m/s^2, pause in s, how many."""

    distance: float
    acceleration: float
    pause: float
    shape: Literal["sine", "constant"] = "sine"
    repeat: int = 1


class HeadPlan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The head's mass in kg and its standard deviation."""

    mass: float
    std: float = 0.0


class BondPlan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the bond asks for: a move's distance in m and time in s, and how still the heatblock must stand after it, m."""

    distance: float = 4e-3
    seconds: float = 11e-3
    tolerance: float = 2e-6


#: The wire bonder's own: 4 mm in 11 ms, then within 2 um of the table.
BOND = BondPlan()


class DesignPlan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the study is about.

    Parameters
    ----------
    moves
        The moves in their order.
    limit
        Largest stroke either way, m.
    safety
        The stroke must stay inside limit / safety.
    frequencies
        Lowest and highest isolation frequency to try, Hz.
    head
        The head, where it is not the model's.
    after
        Whether the swing after the last move counts too; without it the study is of moves that go on.
    bond
        The move that the bond waits for, and how still the heatblock must stand then.
    shown
        The isolation frequency whose curves are shown, Hz; the recommended one where absent.
    """

    moves: tuple[MovePlan, ...]
    limit: float
    safety: float = 1.0
    frequencies: tuple[float, float] = (0.3, 6.0)
    head: HeadPlan | None = None
    after: bool = True
    bond: BondPlan = BOND
    shown: float | None = None

    def drive(self) -> FloatArray:
        """The head's acceleration at `RATE`."""
        moves = [
            Move(distance=m.distance, acceleration=m.acceleration, pause=m.pause, shape=m.shape)
            for m in self.moves
            for _ in range(m.repeat)
        ]
        return head_acceleration(moves, RATE, tail=TAIL / self.frequencies[0] if self.after else 0.0)


@dataclass(frozen=True, kw_only=True)
class DriveOffset:
    """What a drive off the motor's centre of gravity does.

    Parameters
    ----------
    rocking, stroke
        Largest angle of the motor, rad, and stroke on the table, m.
    frequency, ratio
        Isolation ratio of the rig without friction, shape (lines,), Hz and 1.
    worst
        The ratio from 5 to 50 Hz over that without offset, where that is largest.
    """

    rocking: float
    stroke: float
    frequency: FloatArray
    ratio: FloatArray
    worst: float


@dataclass(frozen=True, kw_only=True)
class Designed:
    """The study's results.

    Parameters
    ----------
    studies
        Stroke against frequency "without friction" and "with friction".
    head
        The drive, m/s^2 at `RATE`, and `histories` of all bodies by case, m.
    ratios
        Isolation ratio by case, estimated from simulated runs as a lab would.
    offsets
        What the drive's offset from the centre of gravity does, by offset in m.
    rigs
        The rig of each case.
    bonds
        The heatblock on the table in the bond's move, by case.
    levels
        Isolation on moves of the bond's distance by their level, by case.
    present
        Isolation frequency of the present design, Hz.
    """

    studies: Mapping[str, design.StrokeStudy]
    head: FloatArray
    histories: Mapping[str, Mapping[str, FloatArray]]
    ratios: Mapping[str, IsolationRatio]
    offsets: Mapping[float, DriveOffset]
    rigs: Mapping[str, RigModel]
    bonds: Mapping[str, MoveResponse]
    levels: Mapping[str, MoveIsolation]
    present: float

    def stroke(self, case: str) -> float:
        """Largest displacement of the motor on the table under the moves in a case, m."""
        bodies = self.histories[case]
        return float(np.abs(bodies["motor"] - bodies["table"]).max())


def read_design(path: Path) -> DesignPlan:
    """Read a move profile and check it.

    Raises
    ------
    PlanError
        In one sentence: which key, what was found, what is allowed.
    """
    plan = read_toml(path, lambda tree: msgspec.convert(tree, DesignPlan, strict=False), "a move profile")
    low, high = plan.frequencies
    if not 0.05 <= low < high <= 100.0:
        raise PlanError(f"{path}: frequencies are {low:g} to {high:g} Hz; give low < high between 0.05 and 100 Hz")
    repeats = [move.repeat for move in plan.moves]
    if not plan.moves or min(repeats) < 1 or sum(repeats) > 1000:
        raise PlanError(f"{path}: there are {sum(repeats)} moves; give 1 to 1000, each repeated once at least")
    if plan.shown is not None and not low <= plan.shown <= high:
        raise PlanError(f"{path}: shown is {plan.shown:g} Hz; give a frequency from {low:g} to {high:g} Hz, those that are tried")
    bond = plan.bond
    for name, value in {"distance": bond.distance, "seconds": bond.seconds, "tolerance": bond.tolerance}.items():
        if not 0.0 < value < math.inf:
            raise PlanError(f"{path}: bond.{name} is {value:g}; give a finite value above zero")
    if plan.head is not None and not (0.0 < plan.head.mass < math.inf and 0.0 <= plan.head.std < plan.head.mass):
        found = f"{plan.head.mass:g} kg with std {plan.head.std:g}"
        raise PlanError(f"{path}: the head has {found}; give a mass above zero and a smaller std")
    return plan


def with_head(seed: Seed, plan: DesignPlan) -> Seed:
    """The seed with the head that the plan tells of, where it tells of one."""
    return seed if plan.head is None else seed.with_value("head_mass", plan.head.mass, plan.head.std)


def rigs_of(seed: Seed, plan: DesignPlan, *, draws: int, randomness: int) -> list[RigModel]:
    """The rig of a seed with the plan's head, and behind it `draws` of the same with parameters drawn from their deviations."""
    seed = with_head(seed, plan)
    return [seed.model, *seed.drawn(draws, randomness)]


def designed(
    plan: DesignPlan, rigs: list[RigModel], *, points: int = 100, offsets: tuple[float, ...] = (), rocking_frequency: float = 30.0
) -> Designed:
    """Run the whole study.

    Parameters
    ----------
    plan
        Moves, limit, frequencies.
    rigs
        The present rig, then its draws.
    points
        Isolation frequencies on the grid; the grid has points * rigs designs each with and without friction.
    offsets
        Distances of the drive from the motor's centre of gravity, m.
    rocking_frequency
        Frequency at which the motor rocks on its bearings, Hz.
    """
    rig = rigs[0]
    grid = np.geomspace(*plan.frequencies, points)
    head = plan.drive()
    free = [design.frictionless(model) for model in rigs]
    studies = {
        name: design.stroke_study(models, grid, head, RATE, limit=plan.limit, safety=plan.safety)
        for name, models in (("without friction", free), ("with friction", rigs))
    }
    isolation = rig.link("isolation")
    present = math.sqrt(isolation.stiffness / rig.body("motor").mass) / (2.0 * math.pi)
    cases = {f"present, {present:.2f} Hz with friction": rig}
    chosen = plan.shown or studies["without friction"].recommended
    if math.isfinite(chosen):
        cases[f"{chosen:.2f} Hz with friction"] = design.isolated(rig, chosen)
        cases[f"{chosen:.2f} Hz without friction"] = design.isolated(free[0], chosen)
    ratios = {name: isolation_ratio(virtual_campaign(model, TAKES, noise=0.0, oversample=8)) for name, model in cases.items()}
    last = list(cases.values())[-1]
    bond = plan.bond
    move = move_within(bond.distance, bond.seconds)
    return Designed(
        studies=studies, head=head, histories={name: design.histories(model, head, RATE) for name, model in cases.items()},
        ratios=ratios, offsets={o: _offset(last, o, head, rocking_frequency) for o in offsets}, rigs=cases,
        bonds={name: on_move(model, move, tolerance=bond.tolerance) for name, model in cases.items()},
        levels={
            name: isolation_by_level(model, bond.distance, LEVELS, tolerance=bond.tolerance) for name, model in cases.items()
        },
        present=present,
    )  # fmt: skip


def _offset(model: RigModel, offset: float, head: FloatArray, frequency: float) -> DriveOffset:
    try:
        rocked = design.rocking(model, offset, frequency=frequency)
    except ModelError as error:
        raise PlanError(f"a drive offset of {offset:g} m cannot be studied: {error}") from None
    seen = design.histories(rocked, head, RATE)
    ratio = design.linear_ratio(rocked, LINES)
    kept = (LINES >= 5.0) & (LINES <= 50.0)
    return DriveOffset(
        rocking=float(np.abs(seen["rocking"]).max()), stroke=float(np.abs(seen["motor"] - seen["table"]).max()),
        frequency=LINES, ratio=ratio, worst=float(np.max((ratio / design.linear_ratio(model, LINES))[kept])),
    )  # fmt: skip
