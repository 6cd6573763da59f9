"""Interface of a cause in the catalogue: how it extends the model, and its starting values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Protocol

import msgspec

from isorig.analysis.diagnose.link_force import LinkForce
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.model.rig_model import Link, RigModel

#: Friction if unknown, as a share of the largest force of the drive: a starting value for fits.
SHARE_OF_PUSH = 0.2


Kind = Literal["spring_shape", "damping_shape", "friction_shape", "memory", "drift", "added_motion", "known_value", "sensor"]


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Data and baseline before any candidate is fitted.

    Parameters
    ----------
    deflection, speed
        Largest relative displacement (m) and velocity (m/s) of each link in the simulated runs, by link name.
    sample_rate
        Hz.
    end_time
        Seconds from the campaign's first sample to its end, including the pause after the last run.
    peak
        Largest recorded magnitude of each channel.
    flat_tops
        Channels whose record remains at its largest magnitude, with that magnitude.
    mains
        Channels with hum, with its frequency in Hz.
    misfit_frequencies
        Frequencies in Hz with the largest misfit of the baseline, largest first.
    forces
        For links whose force follows from a record: that force.
    push
        Largest force in N of the drive on a body.
    configurations
        The configurations that were measured.
    guess
        The rig before any fit on simulation error.
    """

    deflection: Mapping[str, float]
    speed: Mapping[str, float]
    sample_rate: float
    end_time: float
    peak: Mapping[str, float]
    flat_tops: Mapping[str, float]
    mains: Mapping[str, float]
    misfit_frequencies: tuple[float, ...]
    forces: Mapping[str, LinkForce]
    push: float
    configurations: frozenset[str]
    guess: RigModel

    def before(self, link: Link) -> Link:
        """A link before any fit; the link itself if a step has added it."""
        return next((known for known in self.guess.links if known.name == link.name), link)


class Mechanism(Protocol):
    """A cause of the catalogue.

    Parameters
    ----------
    cause
        Its name in the findings.
    kind
        Its kind: the free shape of that kind bounds what it can explain.
    """

    cause: ClassVar[str]
    kind: ClassVar[Kind]

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        """Every place where the cause could act on this rig; empty if it cannot act."""
        ...


def exchange(parts: tuple[Any, ...], name: str, **changes: Any) -> tuple[Any, ...]:
    """The parts with one of them (by name or channel) replaced."""
    return tuple(
        msgspec.structs.replace(part, **changes) if getattr(part, "name", getattr(part, "channel", None)) == name else part
        for part in parts
    )
