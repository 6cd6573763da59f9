"""A measurement in memory: channels, runs and their campaign."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import wraps
from inspect import signature
from typing import Any, Concatenate, Literal, ParamSpec, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from isorig.analysis.errors import DataError
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

    def __len__(self) -> int:
        return int(self.samples.shape[0])

    def __repr__(self) -> str:
        return f"Channel({self.name!r}, {self.quantity} in {self.unit}, {len(self)} samples)"

    def read(self, start: int = 0, stop: int | None = None) -> FloatArray:
        """Physical values from `start` to `stop` (the end if None), shape (stop - start,)."""
        values: FloatArray = np.multiply(self.samples[start:stop], self.scale, dtype=np.float64)
        if self.offset:
            values += self.offset
        return values


@dataclass(frozen=True, kw_only=True)
class Gap:
    """Ticks that the instrument counted but that were lost: `count` of them before tick `first_tick` + `count`."""

    first_tick: int
    count: int


@dataclass(frozen=True, kw_only=True)
class Spectrum:
    """A spectrum computed by an instrument.

    Parameters
    ----------
    name
        Its name in the run.
    kind
        "transfer_function", "coherence", "auto_spectrum" or "cross_spectrum".
    response, reference
        Its channels; `reference` is empty for an auto spectrum.
    frequency
        Hz, ascending, shape (n,).
    values
        Real or complex, shape (n,), in `unit`.
    averages
        Number of averages.
    window
        Name of the instrument's window.
    """

    name: str
    kind: str
    response: str
    reference: str
    frequency: FloatArray
    values: FloatArray | ComplexArray
    unit: str = "1"
    averages: int = 1
    window: str = ""


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

    def __len__(self) -> int:
        return len(next(iter(self.channels.values())))

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
        if name not in self.channels:
            raise DataError(
                f"run {self.id!r} has no channel {name!r}, only {', '.join(sorted(self.channels))}; "
                "measure it or rename the channel when importing"
            )
        return self.channels[name]

    def read(self, name: str) -> FloatArray:
        """All physical values of one channel, shape (n,)."""
        return self.channel(name).read()


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

    def __repr__(self) -> str:
        seconds = sum(run.duration for run in self.runs)
        return f"Campaign({self.source!r}, {len(self.runs)} runs, {seconds:.0f} s: {', '.join(run.id for run in self.runs)})"

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
        """The runs with that configuration and gain (any if None)."""
        return tuple(
            run
            for run in self.runs
            if (configuration is None or run.configuration == configuration)
            and (gain is None or abs(run.gain - gain) <= 1e-6 * max(abs(gain), 1.0))
        )

    def seconds_since_start(self, run: Run) -> float:
        """Seconds from the campaign's first `started` to this run's; 0 if unknown."""
        times = [r.started for r in self.runs if r.started is not None]
        if run.started is None or not times:
            return 0.0
        return (run.started - min(times)).total_seconds()


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
