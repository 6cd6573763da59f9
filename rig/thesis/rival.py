"""A rig that fits more of the thesis's figures: the gauge's breakaway, and much less friction once it slides."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np

from analysis.classic import Classic
from analysis.isolation import IsolationRatio, isolation_ratio
from analysis.laws import Stribeck
from analysis.measured import Campaign
from analysis.model import Contact, RigModel
from analysis.rigs import THESIS, wire_bonder
from rig.thesis.campaign import BANDS, SECONDS, Played, play, take
from rig.thesis.readings import RESOLUTIONS, read, resolutions
from rig.thesis.step import Row, Step

#: Sliding friction (N), the speed at which it is reached (m/s), and hardly any damping of the motor's own.
SLIDING, SPEED, OWN = 8.0, 0.002, 0.001


def rival_rig() -> RigModel:
    """The thesis's rig with Stribeck's law from its 20 N down to `SLIDING`, its motor hardly damped by anything else."""
    law = Stribeck(friction_force=SLIDING, static_force=THESIS["friction_force"], stribeck_velocity=SPEED)
    contact = Contact(name="isolation", a="motor", b="table", law=law)
    return msgspec.structs.replace(wire_bonder({**THESIS, "motor_damping": OWN}), contacts=(contact,), free=())


@dataclass(frozen=True, kw_only=True)
class Told:
    """What a campaign says where the thesis prints a figure."""

    read: Classic
    ratio: IsolationRatio
    half_power: tuple[float, ...]

    @property
    def motor(self) -> float:
        """Damping read off the motor."""
        return next(item.mode.damping for item in self.read.set_ups if item.name == "motor" and item.mode is not None)

    def over(self, other: IsolationRatio, low: float, high: float) -> float:
        """Factor by which the ratio differs from another in a band, Hz (median over lines)."""
        kept = (self.ratio.frequency >= low) & (self.ratio.frequency <= high)
        return float(np.exp(np.median(np.abs(np.log(self.ratio.ratio[kept] / other.ratio[kept])))))

    def middle(self, low: float, high: float) -> float:
        """Median of the ratio in a band, Hz."""
        kept = (self.ratio.frequency >= low) & (self.ratio.frequency <= high)
        return float(np.median(self.ratio.ratio[kept]))


def told(campaign: Campaign) -> Told:
    """The thesis's figures of a campaign."""
    return Told(read=read(campaign), ratio=isolation_ratio(campaign), half_power=tuple(resolutions(campaign)))


def rival(played: Played) -> Step:
    """Coulomb's 20 N and Stribeck's 20 to 8 N beside the thesis."""
    takes = [
        take(c, gain, BANDS[gain], played.share * seconds) for gain, seconds in SECONDS.items() for c in ("unlocked", "locked")
    ]
    both = {"Coulomb": told(played.measured), "Stribeck": told(play(rival_rig(), takes))}
    smooth = isolation_ratio(played.smooth)
    coulomb, stribeck = both.values()

    def row(what: str, thesis: str, here: dict[str, str], remark: str) -> Row:
        return Row(what=what, thesis=thesis, here="; ".join(f"{name}: {value}" for name, value in here.items()), remark=remark)

    surfaces = {name: item.read.surface for name, item in both.items()}
    rows = [
        row("damping read off the motor", "0.073", {n: f"{t.motor:.3f}" for n, t in both.items()}, "Stribeck agrees"),
        row(
            "least of the error surface", "80 kg, 0.015",
            {n: f"{s.best[0]:.0f} kg, {s.best[1]:.3f}" for n, s in surfaces.items() if s is not None}, "Stribeck is nearer",
        ),
        *(
            row(
                f"ratio beside that without friction, {low:g} to {high:g} Hz", said,
                {n: f"a factor of {t.over(smooth, low, high):.2f} apart" for n, t in both.items()}, remark,
            )
            for low, high, said, remark in (
                (5.0, 9.0, "agrees", "Stribeck agrees"), (13.0, 15.0, "agrees", "Stribeck agrees"),
            )
        ),
        row(
            "isolated from 9 to 13 Hz (median)", "60 %", {n: f"{1.0 - t.middle(9.0, 13.0):.0%}" for n, t in both.items()},
            "the thesis does not say where",
        ),
        row(
            "ratio at gain 7, 15 to 80 Hz", "near 1", {n: f"{t.middle(15.0, 80.0):.3f}" for n, t in both.items()},
            "both: the drive does not reach breakaway",
        ),
        *(
            row(
                f"half-power of the table, lines {resolution:g} Hz apart", "0.067",
                {n: f"{t.half_power[RESOLUTIONS.index(resolution)]:.3f}" for n, t in both.items()},
                "Coulomb is nearer" if resolution < 0.5 else "with Stribeck the window's width makes it",
            )
            for resolution in (0.25, 0.5, 1.0)
        ),
    ]  # fmt: skip
    text = (
        f"A friction that breaks away at the gauge's {THESIS['friction_force']:g} N and falls to {SLIDING:g} N within some "
        f"{1e3 * SPEED:g} mm/s, the motor hardly damped otherwise, reads {stribeck.motor:.3f} where Coulomb's law reads "
        f"{coulomb.motor:.2f}, and leaves the isolation ratio where the thesis found that it agreed. Only the half-power reading "
        "of the table then needs lines half to one hertz apart. It is a guess made from printed figures: a measurement at "
        "two gains "
        "settles it, for `rig diagnose` names stribeck_friction where it is."
    )
    return Step(title="Which friction goes with the thesis's figures", rows=rows, text=[text])
