"""A measurement in memory: channels, runs and their campaign."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import wraps
from inspect import signature
from pathlib import Path
from typing import Any, Concatenate, Literal, ParamSpec, Protocol, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from isorig.analysis.errors import ArgumentError, DataError
from isorig.analysis.given import (
    all_of_type,
    finite,
    given_mapping,
    index,
    interval,
    number,
    numbers,
    of_type,
    one_of,
    positive,
    text,
    whole,
)
from isorig.analysis.views import Viewed, call

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
ComplexArray = NDArray[np.complex128]

Quantity = Literal[
    "acceleration", "velocity", "displacement", "force", "voltage", "current", "gain", "angle", "angular_velocity",
    "angular_acceleration", "torque",
]  # fmt: skip
#: The SI unit of each quantity, as written in recordings.
SI_UNIT: Mapping[Quantity, str] = {
    "acceleration": "m/s^2", "velocity": "m/s", "displacement": "m", "force": "N", "voltage": "V", "current": "A", "gain": "1",
    "angle": "rad", "angular_velocity": "rad/s", "angular_acceleration": "rad/s^2", "torque": "N m",
}  # fmt: skip
#: Number of time derivatives of a motion; other quantities are not motions.
MOTION: Mapping[Quantity, int] = {
    "displacement": 0, "angle": 0, "velocity": 1, "angular_velocity": 1, "acceleration": 2, "angular_acceleration": 2,
}  # fmt: skip
#: For rotations, including torque.
ROTARY: tuple[Quantity, ...] = ("angle", "angular_velocity", "angular_acceleration", "torque")
Use = Literal["fit", "holdout"]

#: Share of the sample rate that a converter's filter leaves unchanged if the recording does not state it: signal analyzers sample
#: at 2.56 times the highest frequency that they show (Hewlett-Packard, The Fundamentals of Signal Analysis, AN 243, 1994).
USABLE = 1.0 / 2.56

#: Samples converted at a time: what has been read of them remains in the processor's cache.
PIECE = 1 << 15

#: The configuration without locks, and the only one of a rig whose description has none.
UNLOCKED = "unlocked"
#: Broad-band excitations: they determine transfer functions in every frequency bin.
BROAD = ("random", "multisine", "sweep", "other")


class Samples(Protocol):
    """A sequence of raw samples, read by slice: an array in memory or a dataset on disk."""

    @property
    def shape(self) -> tuple[int, ...]: ...

    def __getitem__(self, key: slice, /) -> NDArray[Any]: ...


@dataclass(frozen=True, kw_only=True)
class Channel:
    """One sensor's record: raw samples and their conversion to physical values.

    Parameters
    ----------
    name
        Name of the channel: head, motor, table, heatblock, or as in the rig's description.
    samples
        Raw values, shape (n,).
    quantity, unit
        The measured quantity and its SI unit.
    scale, offset
        Physical value = raw * scale + offset.
    full_scale
        Largest magnitude of the input in `unit`; larger values are clipped. None if unknown.
    about
        Description of the sensor, by "sensor", "place" and "direction"; empty if there is none.

    Examples
    --------
    >>> import isorig as iso
    >>> iso.Channel(name="table", samples=[0, 100, -50], scale=1e-3).read()
    array([ 0.  ,  0.1 , -0.05])
    """

    name: str
    samples: Samples
    quantity: Quantity = "acceleration"
    unit: str = "m/s^2"
    scale: float = 1.0
    offset: float = 0.0
    full_scale: float | None = None
    about: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        here = f"channel {of_type(self.name, str, 'the name of a channel', 'a text; give it in quotes')!r}"
        given: object = self.samples
        if isinstance(given, list | tuple) or hasattr(given, "to_numpy"):
            # A list, or a column of a data frame.
            object.__setattr__(self, "samples", numbers(given, f"the record of {here}"))
        _check_samples(self.samples, here)
        one_of(self.quantity, get_args(Quantity), f"the quantity of {here}")
        of_type(self.unit, str, f"the unit of {here}", 'a text; give it in quotes, for example "m/s^2"')
        for key in ("scale", "offset"):
            finite(getattr(self, key), f"the {key} of {here}")
        if self.full_scale is not None:
            number(self.full_scale, f"the full scale of {here}")
        given_mapping(self.about, f"the argument about of {here}", 'a mapping; give one, for example {"place": "table"}')

    def __len__(self) -> int:
        return int(self.samples.shape[0])

    def __repr__(self) -> str:
        return f"Channel({self.name!r}, {self.quantity} in {self.unit}, {len(self)} samples)"

    def read(self, start: int = 0, stop: int | None = None) -> FloatArray:
        """Physical values from `start` to `stop` (the end if None), shape (stop - start,).

        Raises
        ------
        ArgumentError
            One of them is no whole number.
        """
        begin = index(start, "the first sample")
        end = None if stop is None else index(stop, "the end of the samples")
        values: FloatArray = np.multiply(self.samples[begin:end], self.scale, dtype=np.float64)
        if self.offset:
            values += self.offset
        return values

    def read_into(self, values: FloatArray, start: int) -> None:
        """Write the physical values from sample `start` on into `values`, shape (n,): memory that is new takes longer."""
        for first in range(0, len(values), PIECE):
            part = values[first : first + PIECE]
            np.multiply(self.samples[start + first : start + first + len(part)], self.scale, out=part, dtype=np.float64)
        if self.offset:
            values += self.offset


def _check_samples(samples: Samples, here: str) -> None:
    # Those on disk are checked when they are read.
    shape = getattr(samples, "shape", None)
    if not isinstance(shape, tuple) or not hasattr(samples, "__getitem__"):
        raise ArgumentError(f"{here} has samples of type {type(samples).__name__}, but they must be an array; give a numpy array")
    if len(shape) != 1:
        raise DataError(f"{here} has samples of shape {shape}, but a channel has one number for each sample; give one row")
    if type(samples) is not np.ndarray:
        return
    if samples.dtype.kind not in "iufb":
        raise ArgumentError(f"{here} has samples of type {samples.dtype}, but they must be numbers; convert them")
    if samples.dtype.kind == "f" and not np.isfinite(samples).all():
        at = int(np.flatnonzero(~np.isfinite(samples))[0])
        raise DataError(f"{here} holds {samples[at]} at sample {at}, but samples are finite; cut the run or measure it again")


@dataclass(frozen=True, kw_only=True)
class Gap:
    """Ticks that the instrument counted but that were lost: `count` of them before tick `first_tick` + `count`."""

    first_tick: int
    count: int


@dataclass(frozen=True, kw_only=True)
class Spectrum:
    """A spectrum computed by an instrument."""

    name: str  #: Its name in the run.
    kind: str  #: "transfer_function", "coherence", "auto_spectrum" or "cross_spectrum".
    #: Its channels; `reference` is empty for an auto spectrum.
    response: str
    reference: str
    frequency: FloatArray  #: Hz, ascending, shape (n,).
    values: FloatArray | ComplexArray  #: Real or complex, shape (n,), in `unit`.
    unit: str = "1"
    averages: int = 1  #: Number of averages.
    window: str = ""  #: Name of the instrument's window.


@dataclass(frozen=True, kw_only=True)
class Run(Viewed):
    """One continuous measurement.

    Parameters
    ----------
    id
        Name of the run in its campaign.
    configuration
        "locked", "unlocked", or as in the rig's description.
    sample_rate
        Samples per second, Hz.
    gain
        Drive gain of the excitation.
    channels
        The records by channel name, of equal length.
    excitation, started, band, period, use, repeat_of, gaps
        As in the recording format; `band` in Hz, `period` in samples.
    usable_to
        Highest frequency in Hz that the converter's filter leaves unchanged; None if unknown.
    spectra
        Spectra returned by the instrument.

    Examples
    --------
    >>> import numpy as np
    >>> import isorig as iso
    >>> head = iso.Channel(name="head", samples=np.zeros(2048))
    >>> run = iso.Run(id="a", configuration="unlocked", sample_rate=1024.0, gain=70.0, channels={"head": head})
    >>> run.duration, run.read("head").shape
    (2.0, (2048,))
    """

    id: str
    configuration: str
    sample_rate: float
    gain: float
    channels: Mapping[str, Channel]
    excitation: str = "other"
    started: datetime | None = None
    band: tuple[float, float] | None = None
    period: int | None = None
    use: Use = "fit"
    repeat_of: str | None = None
    gaps: tuple[Gap, ...] = ()
    usable_to: float | None = None
    spectra: tuple[Spectrum, ...] = ()

    def __post_init__(self) -> None:
        here = f"run {of_type(self.id, str, 'the id of a run', 'a text; give it in quotes')!r}"
        of_type(self.configuration, str, f"the configuration of {here}", 'a text; give it in quotes, for example "unlocked"')
        positive(self.sample_rate, f"the sample rate of {here}", " Hz")
        finite(self.gain, f"the gain of {here}")
        if self.band is not None:
            interval(self.band, f"the band of {here}")
        if self.period is not None:
            whole(self.period, f"the period of {here}", 2)
        if self.usable_to is not None:
            positive(self.usable_to, f"the highest usable frequency of {here}", " Hz")
        one_of(self.use, get_args(Use), f"the use of {here}")
        all_of_type(self.gaps, Gap, f"the argument gaps of {here}", "a sequence of gaps; take them from another run")
        all_of_type(
            self.spectra, Spectrum, f"the argument spectra of {here}", "a sequence of spectra; take them from another run"
        )
        by_name = "a mapping of names to iso.Channel; give {channel.name: channel}"
        given_mapping(self.channels, f"the argument channels of {here}", by_name)
        for name, channel in self.channels.items():
            of_type(name, str, f"the name of a channel of {here}", "a text; give it in quotes")
            of_type(channel, Channel, f"channel {name!r} of {here}", "an iso.Channel; give iso.Channel(name=..., samples=...)")
        lengths = {name: len(channel) for name, channel in self.channels.items()}
        if len(set(lengths.values())) > 1:
            text = ", ".join(f"{name} {n}" for name, n in lengths.items())
            raise DataError(f"{here} has channels of unequal length ({text}), but a run has one; cut them to one length")

    def __len__(self) -> int:
        return len(next(iter(self.channels.values()), ()))

    def __repr__(self) -> str:
        size = f"{self.duration:g} s at {self.sample_rate:g} Hz"
        return f"Run({self.id!r}, {self.set_up}, {size}, {', '.join(self.channels)})"

    @property
    def set_up(self) -> str:
        """Configuration and gain; the usual configuration, which is the only one of a rig without locks, is not named."""
        gain = f"gain {self.gain:g}"
        return gain if self.configuration == UNLOCKED else f"{self.configuration}, {gain}"

    @property
    def duration(self) -> float:
        """Length of the record in seconds."""
        return len(self) / self.sample_rate

    @property
    def usable(self) -> float:
        """Highest frequency in Hz up to which records are compared: as stated, otherwise `USABLE` of the sample rate."""
        return USABLE * self.sample_rate if self.usable_to is None else self.usable_to

    @property
    def sensors(self) -> dict[str, Channel]:
        """The channels recorded by sensors: all except the streamed gain."""
        return {name: channel for name, channel in self.channels.items() if channel.quantity != "gain"}

    def channel(self, name: str) -> Channel:
        """The channel with that name; a DataError lists the available ones."""
        text(name, "the name of a channel", "table")
        if name not in self.channels:
            raise DataError(
                f"run {self.id!r} has no channel {name!r}, only {', '.join(sorted(self.channels))}; "
                "measure it or rename the channel when importing"
            )
        return self.channels[name]

    def read(self, name: str) -> FloatArray:
        """All physical values of one channel, shape (n,)."""
        return self.channel(name).read()


def usable_stop(run: Run) -> int:
    """Number of samples before a run's first gap: the motion across a gap is unknown."""
    return min((gap.first_tick for gap in run.gaps), default=len(run))


@dataclass(frozen=True, kw_only=True)
class Campaign(Viewed):
    """All runs measured on one rig, and known values of the rig.

    Parameters
    ----------
    runs
        The runs, in order of measurement if `started` is given.
    known
        The values of the recording's `rig` group by name (SI), e.g. head_mass in kg.
    description
        Text of the rig's own description, if it is not the wire bonder.
    source
        Its source, for messages and reports.

    Examples
    --------
    >>> import isorig as iso
    >>> campaign = iso.read("campaign.h5")
    >>> campaign.known["motor_mass"]
    16.4
    >>> [run.id for run in campaign.select(gain=7.0)]
    ['u7', 'l7']
    """

    runs: tuple[Run, ...]
    known: Mapping[str, float] = field(default_factory=dict)
    description: str | None = None
    source: str = ""

    def __post_init__(self) -> None:
        runs = all_of_type(self.runs, Run, "the argument runs", "a sequence of iso.Run; give for example [run]")
        object.__setattr__(self, "runs", runs)
        given_mapping(self.known, "the argument known", "a mapping; give one, for example {NAME: 6.5}")
        for name, value in self.known.items():
            of_type(name, str, "a name in the argument known", "a text; give it in quotes")
            finite(value, f"the known value {name!r}")
        if self.description is not None:
            of_type(self.description, str, "the description of a campaign", "the text of a rig's description; give the text")

    def __repr__(self) -> str:
        seconds = sum(run.duration for run in self.runs)
        return f"Campaign({self.source!r}, {len(self.runs)} runs, {seconds:.0f} s: {', '.join(run.id for run in self.runs)})"

    @property
    def started(self) -> datetime | None:
        """Time of the first run's first sample; None if no run gives it."""
        return min((run.started for run in self.runs if run.started is not None), default=None)

    @property
    def alone(self) -> bool:
        """Whether all runs have one configuration, which then needs no name."""
        return len({run.configuration for run in self.runs}) == 1

    @property
    def rig(self) -> Any:
        """The rig that was measured, an `isorig.Rig`: of its description, or the wire bonder with the known values.

        Raises
        ------
        RigError
            The description cannot be used, or a run lacks a channel that the rig needs.
        """
        return call(self, "rig")

    def select(self, *, configuration: str | None = None, gain: float | None = None) -> tuple[Run, ...]:
        """The runs with that configuration and gain (any if None).

        Raises
        ------
        ArgumentError
            The configuration is no text, or the gain no number.
        """
        if configuration is not None:
            text(configuration, "the configuration", UNLOCKED)
        gain = None if gain is None else number(gain, "the gain")
        return tuple(
            run
            for run in self.runs
            if (configuration is None or run.configuration == configuration)
            and (gain is None or abs(run.gain - gain) <= 1e-6 * max(abs(gain), 1.0))
        )

    def seconds_since_start(self, run: Run) -> float:
        """Seconds from the campaign's first `started` to this run's; 0 if unknown.

        Raises
        ------
        ArgumentError
            It is no run.
        """
        of_type(run, Run, "the run", "an iso.Run; give one of campaign.runs")
        if run.started is None or self.started is None:
            return 0.0
        return (run.started - self.started).total_seconds()


#: What functions of the interface take for a campaign: it, or the path of its recording.
Measured = Campaign | str | Path


def given_campaign(given: Measured) -> Campaign:
    """A campaign, or that of a recording. Raises ArgumentError if it is of another type, RecordingError if the file at that path
    is not a recording."""
    if isinstance(given, str | Path):
        campaign: Campaign = call(given, "campaign")
        return campaign
    return of_type(
        given, Campaign, "the campaign",
        "an iso.Campaign or the path of its recording; give iso.read(FILE), or iso.import_campaign(...) for other files",
    )  # fmt: skip


def given_runs(given: Sequence[Run]) -> tuple[Run, ...]:
    """A sequence of runs. Raises ArgumentError if it is of another type."""
    return all_of_type(given, Run, "the argument runs", "a sequence of iso.Run; give campaign.runs or campaign.select(...)")


def broad(runs: Sequence[Run]) -> list[Run]:
    """The runs with a broad-band drive: noise, multisines, sweeps."""
    return [run for run in runs if run.excitation in BROAD]


P = ParamSpec("P")
R = TypeVar("R")


Recorded = TypeVar("Recorded", bound=Campaign | Run | Channel)


def once(function: Callable[Concatenate[Recorded, P], R]) -> Callable[Concatenate[Recorded, P], R]:
    """A function of records that is computed once for each and its hashable arguments: records do not change."""

    form = signature(function)

    @wraps(function)
    def found(records: Recorded, /, *args: P.args, **kwargs: P.kwargs) -> R:
        results: dict[Hashable, R] = records.__dict__.setdefault("_results", {})
        given = form.bind(records, *args, **kwargs)
        given.apply_defaults()
        key = function.__qualname__, *list(given.arguments.values())[1:]
        if key not in results:
            results[key] = function(records, *args, **kwargs)
        return results[key]

    return found
