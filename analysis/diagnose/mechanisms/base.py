"""What every cause in the catalogue has to say: how it extends the model, and where its fit starts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import msgspec

from analysis.fit import Free
from analysis.model import RigModel


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What the baseline and the data say before any candidate is fitted.

    Parameters
    ----------
    deflection, speed
        Largest relative displacement (m) and velocity (m/s) of each link in the simulated runs, by link name.
    sample_rate
        Hz.
    end_time
        Seconds from the campaign's first sample to its end, the last run's pause included.
    peak
        Largest recorded magnitude of each channel.
    flat_tops
        Channels whose record stays at its largest magnitude, with that magnitude.
    mains
        Channels with hum, with its frequency in Hz.
    misfit_frequencies
        Frequencies in Hz where the baseline misfits most, strongest first.
    configurations
        The configurations that were measured.
    guess
        The rig as it was before any fit on simulation error.
    """

    deflection: Mapping[str, float]
    speed: Mapping[str, float]
    sample_rate: float
    end_time: float
    peak: Mapping[str, float]
    flat_tops: Mapping[str, float]
    mains: Mapping[str, float]
    misfit_frequencies: tuple[float, ...]
    configurations: frozenset[str]
    guess: RigModel


@dataclass(frozen=True, kw_only=True)
class Reported:
    """A parameter of the answer: its name in the findings, the model's path, its unit."""

    name: str
    path: str
    unit: str
    value: Callable[[RigModel], float] | None = None

    def of(self, model: RigModel) -> float:
        """The value in a model: at the path, or worked out from several parameters."""
        return model.get(self.path) if self.value is None else self.value(model)


def always(model: RigModel) -> bool:
    """Every fit of most causes is plausible."""
    return True


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A cause at a place, as extended models from which fits start.

    Parameters
    ----------
    cause, location
        Names of the findings' catalogue.
    family
        Causes of one family are alike in kind: friction, spring, mass, delay.
    starts
        The extended model at one or more starting values.
    free
        Its new parameters.
    dropped
        Paths of the baseline that the extension replaces.
    reported
        What is said of it in the findings.
    rank
        Simplicity: of two that fit alike the lower is kept.
    plausible
        Whether a fitted model still is what the cause's name says.
    twin
        Cause and location that lead to the same equations, so that no data of this rig can tell them apart.
    """

    cause: str
    location: str
    family: str
    starts: tuple[RigModel, ...]
    free: tuple[Free, ...]
    reported: tuple[Reported, ...]
    dropped: tuple[str, ...] = ()
    rank: int = 1
    plausible: Callable[[RigModel], bool] = always
    twin: tuple[str, str] | None = None

    @property
    def key(self) -> tuple[str, str]:
        """Cause and location."""
        return self.cause, self.location


class Mechanism(Protocol):
    """A family member of the catalogue."""

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        """Every place where the cause could act on this rig; empty where it must keep silent."""
        ...


def exchange(parts: tuple[Any, ...], name: str, **changes: Any) -> tuple[Any, ...]:
    """The parts with one of them (by name or channel) changed."""
    return tuple(
        msgspec.structs.replace(part, **changes) if getattr(part, "name", getattr(part, "channel", None)) == name else part
        for part in parts
    )
