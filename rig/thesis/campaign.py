"""The virtual campaign behind the page: the thesis's table put into a rig, measured as the thesis measured."""

from __future__ import annotations

from dataclasses import dataclass

from analysis.design import frictionless
from analysis.measured import Campaign
from analysis.model import RigModel
from analysis.rigs import wire_bonder
from rig.virtual import Take, virtual_campaign

#: Gain up to 15 Hz and gain from there to 400 Hz, with the drive's band and the length of a run, s.
LOW, HIGH = 70.0, 7.0
BANDS = {LOW: (0.5, 20.0), HIGH: (0.5, 400.0)}
SECONDS = {LOW: 200.0, HIGH: 120.0}
SEED = 1


@dataclass(frozen=True, kw_only=True)
class Played:
    """The rig, what was measured on it, and the same rig without friction measured in the same way.

    `share` is the length of the runs as a share of `SECONDS`.
    """

    rig: RigModel
    measured: Campaign
    smooth: Campaign
    share: float

    @property
    def smooth_rig(self) -> RigModel:
        """The rig without friction."""
        return frictionless(self.rig)


def played(share: float = 1.0) -> Played:
    """Both campaigns, with runs of `share` times their usual length."""
    rig = wire_bonder()
    takes = [take(c, gain, BANDS[gain], share * seconds) for gain, seconds in SECONDS.items() for c in ("unlocked", "locked")]
    return Played(rig=rig, measured=play(rig, takes), smooth=play(frictionless(rig), takes), share=share)


def take(configuration: str, gain: float, band: tuple[float, float], seconds: float) -> Take:
    """A broad-band run."""
    return Take(
        id=f"{configuration[0]}{gain:g}", configuration=configuration, gain=gain, seconds=seconds, start=0.0, band=band
    )  # fmt: skip


def play(rig: RigModel, takes: list[Take]) -> Campaign:
    """A virtual campaign with the page's seed."""
    return virtual_campaign(rig, takes, seed=SEED)
