"""Candidates for the thesis's rig, and virtual campaigns on them, measured as in the thesis."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import msgspec

from isorig.analysis.campaign import Campaign
from isorig.analysis.isolation.ratio import IsolationRatio, isolation_ratio
from isorig.analysis.laws import Stribeck
from isorig.analysis.model.rig_model import Contact, RigModel
from isorig.rig.virtual.levels import HEAD_PER_GAIN
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.session import VirtualRun, virtual_campaign
from isorig.rig.wire_bonder.stroke import frictionless

#: Gain up to 15 Hz and gain from there to 400 Hz, with the drive's band and the length of a run, s.
LOW, HIGH = 70.0, 7.0
BANDS = {LOW: (0.5, 20.0), HIGH: (0.5, 400.0)}
SECONDS = {LOW: 200.0, HIGH: 120.0}
SEED = 1
#: Relative standard deviation of the sensors' calibration, as a lab would state it.
CALIBRATION = 0.01
#: Hardly any damping of the motor's own; sliding friction (N) and the speed at which it is reached (m/s) of Stribeck's law.
NONE, SLIDING, SPEED = 0.001, 8.0, 0.002
#: How much harder than the page's 3.8 m/s^2 at gain 70 a drive would have to be for 20 N to read as .073.
HARDER = 2.5


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A candidate for the thesis's rig, and its drive level (rms of the head per unit of gain, m/s^2)."""

    name: str
    rig: RigModel
    per_gain: float = HEAD_PER_GAIN


def stribeck_rig() -> RigModel:
    """The thesis's rig with Stribeck's law from its 20 N down to `SLIDING`, its motor hardly damped by anything else."""
    law = Stribeck(friction_force=SLIDING, static_force=THESIS["friction_force"], stribeck_velocity=SPEED)
    contact = Contact(name="isolation", a="motor", b="table", law=law)
    return msgspec.structs.replace(wire_bonder({**THESIS, "motor_damping": NONE}), contacts=(contact,), free=())


def candidates() -> tuple[Candidate, ...]:
    """All of them, the thesis's own table with its 20 N first."""
    return (
        Candidate(name="Table 4 and 20 N of Coulomb friction", rig=wire_bonder()),
        Candidate(
            name=f"20 N of Coulomb friction, drive {HARDER:g} times as strong", per_gain=HARDER * HEAD_PER_GAIN,
            rig=wire_bonder({**THESIS, "motor_damping": NONE}),
        ),
        Candidate(name=f"Stribeck friction, 20 N falling to {SLIDING:g} N", rig=stribeck_rig()),
        Candidate(name="no friction", rig=frictionless(wire_bonder())),
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Played:
    """A candidate, what was measured on it, and the thesis's table without friction measured in the same way.

    `share` is the length of the runs as a share of `SECONDS`.
    """

    candidate: Candidate
    measured: Campaign
    smooth: Campaign
    share: float

    @property
    def rig(self) -> RigModel:
        """The rig that was measured."""
        return self.candidate.rig

    @property
    def smooth_rig(self) -> RigModel:
        """The thesis's table without friction."""
        return frictionless(wire_bonder())

    @cached_property
    def ratio(self) -> IsolationRatio:
        """The isolation ratio as measured."""
        return isolation_ratio(self.measured)

    @cached_property
    def smooth_ratio(self) -> IsolationRatio:
        """The isolation ratio as simulated without friction."""
        return isolation_ratio(self.smooth)


def played(candidate: Candidate | None = None, share: float = 1.0) -> Played:
    """Both campaigns of a candidate (the thesis's own table where None), with runs of `share` times their usual length."""
    candidate = candidate or candidates()[0]
    both = [play(rig, campaign_takes(candidate.per_gain, share)) for rig in (candidate.rig, frictionless(wire_bonder()))]
    return Played(candidate=candidate, measured=both[0], smooth=both[1], share=share)


def campaign_takes(per_gain: float, share: float) -> list[VirtualRun]:
    """The thesis's runs: both gains, unlocked and locked."""
    return [
        take(c, gain, BANDS[gain], share * seconds, per_gain) for gain, seconds in SECONDS.items() for c in ("unlocked", "locked")
    ]


def take(
    configuration: str, gain: float, band: tuple[float, float], seconds: float, per_gain: float = HEAD_PER_GAIN
) -> VirtualRun:  # fmt: skip
    """A broad-band run."""
    return VirtualRun(
        id=f"{configuration[0]}{gain:g}", configuration=configuration, gain=gain, seconds=seconds, start=0.0, band=band,
        per_gain=per_gain,
    )  # fmt: skip


def play(rig: RigModel, takes: list[VirtualRun]) -> Campaign:
    """A virtual campaign with the page's seed."""
    return virtual_campaign(rig, takes, seed=SEED)
