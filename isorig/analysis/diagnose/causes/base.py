"""What a cause declares: how it is found, tried, assumed and hidden."""

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, Protocol, TypeVar

import msgspec
import numpy as np

from isorig.analysis.diagnose.link_force import LinkForce
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.model.rig_model import Link, RigModel

T = TypeVar("T")
Kind = Literal["spring_shape", "damping_shape", "friction_shape", "memory", "drift", "added_motion", "known_value", "sensor"]
#: What the records of a rig with a cause show before any fit (`evidence`).
SignKind = Literal[
    "amplitude", "independent of amplitude", "blocked by the lock", "time", "stiffens", "softens", "uneven directions",
    "more at low and high velocity", "less at low and high velocity", "mode", "lock", "ratio of rigid bodies", "constant ratio",
    "delay", "flat tops", "hum",
]  # fmt: skip
#: Size of the smallest relevant cause, relative to the virtual rig's sizes. Chosen: a third of the smallest in the study.
SMALLEST = 1.0 / 3.0
#: Relative difference from its given value below which a fitted mass or gain is no fault. Chosen: calibrations of sensors agree
#: to half a per cent, scales are as accurate, and small parts that move with a body change its mass as much.
CALIBRATION = 0.01


def beyond_calibration(path: str, given: float) -> Callable[[RigModel], bool]:
    """Whether the value at a path differs from the given one by more than calibrations allow: for `Candidate.plausible`."""
    return lambda fitted: abs(fitted.get(path) / given - 1.0) >= CALIBRATION


@dataclass(frozen=True, kw_only=True)
class Amplitudes:
    """The largest motions of a rig in its runs: sizes of causes are relative to them."""

    #: Largest relative displacement (m) and velocity (m/s) of each link, by link name.
    deflection: Mapping[str, float]
    speed: Mapping[str, float]
    peak: Mapping[str, float]  #: Largest magnitude of each channel, in its unit.
    sample_rate: float  #: Hz.
    #: Seconds from the campaign's first sample to its end, including the pause after the last run; 0 if the runs do not tell
    #: (`session_end`).
    end_time: float


@dataclass(frozen=True, kw_only=True)
class Evidence(Amplitudes):
    """Data and baseline before any candidate is fitted: the amplitudes of the simulated runs, and what else the records show.

    Parameters
    ----------
    flat_tops
        Channels whose record remains at its largest magnitude, with that magnitude.
    mains
        Channels with hum, with its frequency in Hz.
    misfit_frequencies
        Frequencies in Hz with the largest misfit of the baseline, largest first.
    pitches
        The pitch in m with which the force of a link repeats over its deflection, by link, where the equations show one.
    forces
        For links whose force follows from a record: that force.
    push
        Largest force in N of the drive on a body.
    configurations
        The configurations that were measured.
    described, guess
        The rig as it is described, and before any fit on simulation error.
    """

    flat_tops: Mapping[str, float]
    mains: Mapping[str, float]
    misfit_frequencies: tuple[float, ...]
    forces: Mapping[str, LinkForce]
    push: float
    configurations: frozenset[str]
    described: RigModel
    guess: RigModel
    pitches: Mapping[str, float] = field(default_factory=dict)

    def is_silent(self, channel: str) -> bool:
        """Whether a channel records nothing but zeros."""
        return self.peak.get(channel) == 0.0

    def before(self, link: Link) -> Link:
        """A link before any fit; the link itself if a step has added it."""
        return _known(link, self.guess)

    def as_described(self, link: Link) -> Link:
        """A link as it is described; the link itself if a step has added it."""
        return _known(link, self.described)


def _known(link: Link, rig: RigModel) -> Link:
    return next((known for known in rig.links if known.name == link.name), link)


@dataclass(frozen=True, kw_only=True)
class RecordedRuns:
    """What decides whether a cause is identifiable from the runs at all."""

    deflection: Mapping[str, float]  #: Largest relative displacement of each link, m.
    configurations: frozenset[str]  #: The measured configurations.
    start_times: Sequence[float]  #: Of the runs, s.


class Sizes(Protocol):
    """Chooses the numbers of a cause: at random for a virtual rig, the weakest ones for a proposal."""

    def weak_to_strong(self, weak: float, strong: float) -> float:
        """A number that determines the size of the effect."""
        ...

    def between(self, low: float, high: float) -> float:
        """A number that does not."""
        ...

    def one_of(self, options: Sequence[T]) -> T:
        """One of several."""
        ...


class WeakestSizes:
    """The weakest effect; the middle of what does not determine its size, and the first option."""

    def weak_to_strong(self, weak: float, strong: float) -> float:
        return weak

    def between(self, low: float, high: float) -> float:
        return 0.5 * (low + high)

    def one_of(self, options: Sequence[T]) -> T:
        return options[0]


@dataclass(frozen=True)
class RandomSizes:
    """Uniformly distributed numbers."""

    draw: np.random.Generator

    def weak_to_strong(self, weak: float, strong: float) -> float:
        return self.between(min(weak, strong), max(weak, strong))

    def between(self, low: float, high: float) -> float:
        return float(self.draw.uniform(low, high))

    def one_of(self, options: Sequence[T]) -> T:
        return options[int(self.draw.integers(len(options)))]


@dataclass(frozen=True, kw_only=True)
class RigWithCause:
    """A rig with a cause of known size."""

    model: RigModel  #: The rig.
    #: The values of the cause, by their names in the findings, in SI units.
    parameters: Mapping[str, float] = field(default_factory=dict)
    #: Hum on a channel: (channel, amplitude in its unit, frequency in Hz); None for no hum.
    hum: tuple[str, float, float] | None = None


class Cause(ABC):
    """A cause of the catalogue: a subclass in a file of this package. Its docstring begins with its row in the documentation."""

    #: In the findings: the class's name in lower case with underscores.
    name: ClassVar[str]
    #: The free shape of its kind bounds what it can explain.
    kind: ClassVar[Kind]
    #: Causes of one family have similar effects: the elimination keeps the best of each.
    family: ClassVar[str]
    #: Simplicity: of two causes that fit equally well, the one with the lower rank is kept.
    rank: ClassVar[int] = 1
    #: The conclusion of a report: {place}, and the reported parameters by name, as value with uncertainty.
    phrase: ClassVar[str]
    #: The same without parameters that are zero within their uncertainty, or missing, by their names; the first of which all are
    #: counts.
    phrases_without: ClassVar[Mapping[tuple[str, ...], str]] = {}
    #: Signs in the records that support it.
    signs: ClassVar[frozenset[SignKind]] = frozenset()
    #: What the equations of motion of the records call it where its kind has several unlike forms (`Explanation.what`).
    found_as: ClassVar[frozenset[str]] = frozenset()
    #: Simpler causes whose law is a special case of its own: it is not reported next to them where they explain the data as well.
    generalizes: ClassVar[frozenset[str]] = frozenset()
    #: Whether its places are bodies, on which it acts by their inertia alone.
    at_bodies: ClassVar[bool] = False
    #: Whether it is tried wherever it is proposed: its evidence locates it, or the equations do not show it.
    always_tried: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        cls.name = re.sub("(?<=.)(?=[A-Z])", "_", cls.__name__).lower()

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        """Every place where it could act on this rig; empty if it cannot act."""
        return tuple(c for place in self.places(model) for c in self.proposed(model, evidence, place) if c.starts)

    @abstractmethod
    def places(self, model: RigModel) -> tuple[str, ...]:
        """The names of the places where this rig can have it and does not have it yet."""

    @abstractmethod
    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        """Its candidates at a place; without starting values if the evidence excludes it there."""

    @abstractmethod
    def sized(self, model: RigModel, runs: Amplitudes, place: str, size: float, sizes: Sizes) -> RigWithCause:
        """A rig with the cause at a place, for the virtual rig and for proposals of runs.

        Parameters
        ----------
        model
            The rig without it.
        runs
            The amplitudes of its runs.
        place
            One of `supposed_places`.
        size
            Relative size, 1 is full size.
        sizes
            Chooses the numbers.
        """

    def supposed_places(self, model: RigModel) -> tuple[str, ...]:
        """Places at which a virtual rig can hide it and a proposal assumes it."""
        return self.places(model)

    def smallest(self, model: RigModel, runs: Amplitudes, place: str) -> Iterable[RigWithCause]:
        """The rig with the cause at its smallest relevant size: what a proposed run must reveal."""
        return (self.sized(model, runs, place, SMALLEST, WeakestSizes()),)

    def not_identifiable(self, model: RigModel, runs: RecordedRuns) -> Iterable[tuple[str, str]]:
        """Places at which these runs cannot reveal it, each with a sentence why."""
        return ()


def exchange(parts: tuple[Any, ...], name: str, **changes: Any) -> tuple[Any, ...]:
    """The parts with one of them (by name or channel) replaced."""
    return tuple(
        msgspec.structs.replace(part, **changes) if getattr(part, "name", getattr(part, "channel", None)) == name else part
        for part in parts
    )


def blocked_links(model: RigModel) -> frozenset[str]:
    """Names of the links that some configuration blocks."""
    return frozenset(name for configuration in model.configurations.values() for name in configuration.rigid)


def sliding_links(model: RigModel) -> tuple[Link, ...]:
    """The links with sliding ends: those that some configuration blocks, or all if there is none."""
    blocked = blocked_links(model)
    return tuple(link for link in model.links if link.name in blocked or not blocked)
