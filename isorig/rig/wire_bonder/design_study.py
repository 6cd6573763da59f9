"""The design study: from moves and a limit to strokes, recommended frequency, time histories and isolation ratios."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import ModelError
from isorig.analysis.isolation.ratio import IsolationRatio, isolation_ratio
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.model.spring import uncoupled_frequency, with_frequency
from isorig.analysis.simulate.move_profile import Move, head_acceleration
from isorig.rig.errors import PlanError
from isorig.rig.files.tomlfile import read_toml
from isorig.rig.virtual.levels import MOVE_RATE
from isorig.rig.wire_bonder.move_isolation import MoveIsolation, MoveResponse, isolation_by_level, move_within, response_to_move
from isorig.rig.wire_bonder.parameters import RigValues
from isorig.rig.wire_bonder.session import VirtualRun, virtual_campaign
from isorig.rig.wire_bonder.stroke import StrokeStudy, frictionless, histories, linear_ratio, rocking, stroke_study

#: Duration of the oscillation after the last move, in slowest periods.
TAIL = 0.6
#: Accelerations of the moves for which isolation is shown, m/s^2: from a bench's to the machine's.
LEVELS = np.geomspace(8.0, 208.0, 16)
#: Frequency bins for the drive offset, Hz.
FREQUENCIES = np.geomspace(0.5, 100.0, 1500)
#: Allowed isolation frequencies, and the band in which a drive offset is judged, Hz.
TRIED, ISOLATED = (0.05, 100.0), (5.0, 50.0)
TAKES = tuple(
    VirtualRun(id=f"{c[0]}{g:g}", configuration=c, gain=g, seconds=40.0, start=0.0, band=(0.5, top))
    for c in ("unlocked", "locked")
    for g, top in ((70.0, 20.0), (7.0, 400.0))
)


class HeadPlan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The head's mass in kg and its standard uncertainty."""

    mass: float
    std: float = 0.0


class BondPlan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Specification of the bond: a move's distance in m and duration in s, and the heatblock's tolerance after it, m."""

    distance: float = 4e-3
    seconds: float = 11e-3
    tolerance: float = 2e-6


#: The wire bonder's specification: 4 mm in 11 ms, then within 2 um of the table.
BOND = BondPlan()


class DesignPlan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Input of the study."""

    moves: tuple[Move, ...]  #: The moves in order.
    limit: float  #: Largest stroke in either direction, m.
    safety: float = 1.0  #: The stroke must stay within limit / safety.
    frequencies: tuple[float, float] = (0.3, 6.0)  #: Lowest and highest isolation frequency to try, Hz.
    head: HeadPlan | None = None  #: The head, if it differs from the model's.
    after: bool = True  #: Whether the oscillation after the last move is included; otherwise the moves continue without end.
    bond: BondPlan = BOND  #: The move before the bond, and the heatblock's tolerance after it.
    shown: float | None = None  #: The isolation frequency whose curves are shown, Hz; by default the recommended one.

    def drive(self) -> FloatArray:
        """The head's acceleration at `MOVE_RATE`."""
        return head_acceleration(self.moves, MOVE_RATE, tail=TAIL / self.frequencies[0] if self.after else 0.0)


@dataclass(frozen=True, kw_only=True)
class DriveOffset:
    """Effect of a drive offset from the motor's centre of gravity: its largest angle, rad, and stroke relative to the table, m.

    The isolation ratio of the rig without friction, shape (bins,), at frequencies in Hz; `worst` is the largest one from 5 to 50
    Hz, divided by that without offset.
    """

    rocking: float
    stroke: float
    frequency: FloatArray
    ratio: FloatArray
    worst: float


@dataclass(frozen=True, kw_only=True)
class DesignCase:
    """One of the compared rigs: the displacement of each body during the moves, m, shape (n,), and the isolation ratio, estimated
    from simulated runs as in a lab.

    `bond` is the heatblock relative to the table during the bond's move, by configuration; `levels` is the isolation during moves
    of the bond's distance over their acceleration.
    """

    rig: RigModel
    histories: Mapping[str, FloatArray]
    ratio: IsolationRatio
    bond: Mapping[str, MoveResponse]
    levels: MoveIsolation

    @property
    def stroke(self) -> float:
        """Largest displacement of the motor relative to the table during the moves, m."""
        return stroke_of(self.histories)

    @property
    def median_ratio(self) -> float:
        """Median of the isolation ratio from 5 to 15 Hz."""
        return float(np.median(self.ratio.ratio[(self.ratio.frequency >= 5.0) & (self.ratio.frequency <= 15.0)]))


@dataclass(frozen=True, kw_only=True)
class Designed:
    """The study's results: stroke over frequency "without friction" and "with friction", and the compared rigs by name.

    `head` is the drive, m/s^2 at `MOVE_RATE`, shape (n,); `offsets` are the effects of its offset from the centre of gravity, by
    offset in m; `present` is the isolation frequency of the present design, Hz.
    """

    studies: Mapping[str, StrokeStudy]
    head: FloatArray
    cases: Mapping[str, DesignCase]
    offsets: Mapping[float, DriveOffset]
    present: float


def read_design(path: Path) -> DesignPlan:
    """Read and validate a move profile. Raises PlanError, a sentence with the key and what is allowed, if it is invalid."""
    plan = read_toml(path, DesignPlan, "a move profile")
    low, high = plan.frequencies
    if not TRIED[0] <= low < high <= TRIED[1]:
        raise PlanError(
            f"{path}: frequencies are {low:g} to {high:g} Hz; give low < high between {TRIED[0]:g} and {TRIED[1]:g} Hz"
        )
    if plan.shown is not None and not low <= plan.shown <= high:
        raise PlanError(f"{path}: shown is {plan.shown:g} Hz; give a frequency within the tried range, {low:g} to {high:g} Hz")
    for name, value in msgspec.structs.asdict(plan.bond).items():
        if not 0.0 < value < math.inf:
            raise PlanError(f"{path}: bond.{name} is {value:g}; give a finite value above zero")
    if plan.head is not None and not (0.0 < plan.head.mass < math.inf and 0.0 <= plan.head.std < plan.head.mass):
        found = f"{plan.head.mass:g} kg with std {plan.head.std:g}"
        raise PlanError(f"{path}: the head has {found}; give a mass above zero and a smaller std")
    return plan


def with_head(values: RigValues, plan: DesignPlan) -> RigValues:
    """The parameters with the head of the plan, if it gives one; its mass then does not count as assumed."""
    if plan.head is None:
        return values
    return replace(
        values, values={**values.values, "head_mass": plan.head.mass}, stds={**values.stds, "head_mass": plan.head.std},
        assumed=tuple(name for name in values.assumed if name != "head_mass"),
    )  # fmt: skip


def designed(
    plan: DesignPlan, values: RigValues, *, draws: int = 0, seed: int = 0, points: int = 100, offsets: tuple[float, ...] = (),
    rocking_frequency: float = 30.0,
) -> Designed:  # fmt: skip
    """Run the whole study of a plan, with the values of the present rig and the plan's head.

    `draws` further rigs have values drawn from their uncertainties, and each is studied at so many isolation frequencies
    (`points`), with and without friction. `offsets` are distances of the drive from the motor's centre of gravity, m;
    `rocking_frequency` is that at which the motor rocks on its bearings, Hz.
    """
    rig = values.model
    rigs = [rig, *values.drawn(draws, seed)]
    grid = np.geomspace(*plan.frequencies, points)
    head = plan.drive()
    free = [frictionless(model) for model in rigs]
    studies = {
        name: stroke_study(models, grid, head, MOVE_RATE, limit=plan.limit, safety=plan.safety)
        for name, models in (("without friction", free), ("with friction", rigs))
    }
    present = uncoupled_frequency(rig, "isolation")
    compared = {f"present, {present:.2f} Hz with friction": rig}
    chosen = plan.shown or studies["without friction"].recommended
    if math.isfinite(chosen):
        compared[f"{chosen:.2f} Hz with friction"] = with_frequency(rig, "isolation", chosen)
        compared[f"{chosen:.2f} Hz without friction"] = with_frequency(free[0], "isolation", chosen)
    last = list(compared.values())[-1]
    return Designed(
        studies=studies, head=head, cases={name: _case(model, plan.bond, head) for name, model in compared.items()},
        offsets={o: _offset(last, o, head, rocking_frequency) for o in offsets}, present=present,
    )  # fmt: skip


def _case(model: RigModel, bond: BondPlan, head: FloatArray) -> DesignCase:
    return DesignCase(
        rig=model, histories=histories(model, head, MOVE_RATE),
        ratio=isolation_ratio(virtual_campaign(model, TAKES, noise=0.0, oversample=8)), bond=bonding(model, bond),
        levels=isolation_by_level(model, bond.distance, LEVELS, tolerance=bond.tolerance),
    )  # fmt: skip


def bonding(model: RigModel, bond: BondPlan) -> dict[str, MoveResponse]:
    """The heatblock relative to the table during the bond's move, locked and unlocked."""
    move = move_within(bond.distance, bond.seconds)
    return {c: response_to_move(model, move, tolerance=bond.tolerance, configuration=c) for c in ("locked", "unlocked")}


def stroke_of(bodies: Mapping[str, FloatArray]) -> float:
    """Largest displacement of the motor relative to the table, m, from those of all bodies, each of shape (n,)."""
    return float(np.abs(bodies["motor"] - bodies["table"]).max())


def _offset(model: RigModel, offset: float, head: FloatArray, frequency: float) -> DriveOffset:
    try:
        rocked = rocking(model, offset, frequency=frequency)
    except ModelError as error:
        raise PlanError(f"a drive offset of {offset:g} m cannot be studied: {error}") from None
    seen = histories(rocked, head, MOVE_RATE)
    ratio = linear_ratio(rocked, FREQUENCIES)
    kept = (ISOLATED[0] <= FREQUENCIES) & (ISOLATED[1] >= FREQUENCIES)
    return DriveOffset(
        rocking=float(np.abs(seen["rocking"]).max()), stroke=stroke_of(seen),
        frequency=FREQUENCIES, ratio=ratio, worst=float(np.max((ratio / linear_ratio(model, FREQUENCIES))[kept])),
    )  # fmt: skip
