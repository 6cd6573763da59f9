"""The plan of a session: rig, instrument, channels, runs; checked before anything moves."""

from __future__ import annotations

import math
import re
import tomllib
from pathlib import Path
from typing import Literal

import msgspec

from rig.errors import PlanError
from rig.recording import UNITS

#: What a channel tells beside what the recording's format asks for.
SENSOR = ("sensor", "place", "direction")


class Part(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Anything in a plan."""


class ShowsPlan(Part, frozen=True):
    """What a display or trace of an analyzer shows.

    `trace` is the analyzer's word for it: a display's number (SR785), a feed such as "XTIM:VOLT 1" (35670A). A "time" trace fills
    the channel of that name; a spectrum says of which channels it is, as in the recording.
    """

    trace: str
    kind: Literal["time", "transfer_function", "coherence", "auto_spectrum", "cross_spectrum"]
    channel: str
    reference: str = ""
    unit: str = "1"


class InstrumentPlan(Part, frozen=True):
    """Where the samples come from: the kind of instrument, its port, its rate in Hz.

    `full_scale` (V) is asked of a DI-1100, `shows` of analyzers, which hand out records; `bus` is python-can's word for an
    adapter.
    """

    kind: Literal["framed", "di1100", "mti600", "sr785", "35670a"]
    port: str
    sample_rate: float
    baud_rate: int = 921600
    full_scale: float | None = None
    bus: str = "slcan"
    shows: tuple[ShowsPlan, ...] = ()

    @property
    def analyzer(self) -> bool:
        """Whether it measures by itself and hands out records."""
        return self.kind in ("sr785", "35670a")


class ChannelPlan(Part, frozen=True):
    """A sensor at an input: `sensitivity` is the input's unit per unit of the channel (V per m/s^2)."""

    input: int
    sensitivity: float
    unit: str = "m/s^2"
    quantity: Literal["acceleration", "velocity", "displacement", "force", "voltage", "current"] = "acceleration"
    sensor: str = ""
    place: str = ""
    direction: str = ""

    @property
    def told(self) -> dict[str, str]:
        """What is told of the sensor for the reader of a recording."""
        return {key: getattr(self, key) for key in SENSOR}


class RunPlan(Part, frozen=True):
    """A run, or several alike: how the rig is set up, what drives it, for how many seconds; a multisine's period in seconds.

    Nothing is played in a "free" run (a hammer, a pushed table) nor in an "other" one, whose drive is not of our making.
    """

    id: str
    configuration: str
    gain: float
    seconds: float
    excitation: Literal["random", "multisine", "moves", "free", "other"] = "random"
    band: tuple[float, float] | None = None
    period: float = 4.0
    repeats: int = 1
    seed: int = 0
    use: Literal["fit", "holdout"] = "fit"

    @property
    def played(self) -> bool:
        """Whether the instrument plays a drive that is made here."""
        return self.excitation not in ("free", "other")

    def ticks(self, rate: float) -> int:
        """Samples of the run at a rate in Hz; a multisine has whole periods."""
        n = round(self.seconds * rate)
        if self.excitation != "multisine":
            return n
        period = round(self.period * rate)
        return max(n // period, 1) * period

    def ids(self) -> tuple[str, ...]:
        """The names of its repeats: the name itself where there is one, else with -1, -2 ..."""
        return (self.id,) if self.repeats == 1 else tuple(f"{self.id}-{k + 1}" for k in range(self.repeats))


class Plan(Part, frozen=True):
    """A session. `rig` holds what is known beforehand (SI) under the recording's names."""

    instrument: InstrumentPlan
    channels: dict[str, ChannelPlan]
    runs: tuple[RunPlan, ...]
    rig: dict[str, float | str] = {}


def read_plan(path: Path) -> Plan:
    """Read a plan and check it whole.

    Raises
    ------
    PlanError
        In one sentence: which key, what was found, what is allowed.
    """
    try:
        tree = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise PlanError(f"{path} does not exist; give the path of a plan") from None
    except (OSError, UnicodeDecodeError) as error:
        raise PlanError(f"{path} cannot be read ({error}); give a text file") from None
    except tomllib.TOMLDecodeError as error:
        raise PlanError(f"{path} is not TOML ({error}); correct that line") from None
    try:
        plan = msgspec.convert(tree, Plan, strict=False)
    except msgspec.ValidationError as error:
        raise PlanError(f"{path}: {str(error).replace('`', '')}; correct that key") from None
    _check(plan, str(path))
    return plan


def _check(plan: Plan, where: str) -> None:
    rate = plan.instrument.sample_rate
    if not 0.0 < rate < math.inf:
        raise PlanError(f"{where}: sample_rate is {rate:g} Hz; it must be positive and finite, so correct it")
    _check_instrument(plan, where)
    if not plan.channels:
        raise PlanError(f"{where}: there are no channels; name at least one as [channels.<name>]")
    if not plan.runs:
        raise PlanError(f"{where}: there are no runs; add at least one as [[runs]]")
    for name, channel in plan.channels.items():
        if not name.isidentifier() or name in ("gain", "gaps", "timing", "spectra"):
            raise PlanError(f"{where}: a channel cannot be called {name!r}; use letters and digits, and no name of the format")
        if not math.isfinite(channel.sensitivity) or channel.sensitivity == 0.0:
            raise PlanError(
                f"{where}: channels.{name}.sensitivity is {channel.sensitivity:g}; take it from the sensor's calibration sheet"
            )
        if channel.unit not in UNITS:
            raise PlanError(f"{where}: channels.{name}.unit is {channel.unit!r}; allowed are {', '.join(sorted(UNITS))}")
        if channel.input < 0:
            raise PlanError(f"{where}: channels.{name}.input is {channel.input}; inputs count from 0")
    inputs = [channel.input for channel in plan.channels.values()]
    if len(set(inputs)) < len(inputs):
        raise PlanError(f"{where}: two channels share an input ({inputs}); give each its own")
    ids = [name for run in plan.runs for name in run.ids()]
    twice = next((name for name in ids if ids.count(name) > 1), None)
    if twice is not None:
        raise PlanError(f"{where}: two runs are called {twice!r}; give each its own id")
    for run in plan.runs:
        _check_run(run, rate, f"{where}: run {run.id!r}")


def _check_instrument(plan: Plan, where: str) -> None:
    instrument = plan.instrument
    if instrument.kind == "di1100" and not (instrument.full_scale and 0.0 < instrument.full_scale < math.inf):
        raise PlanError(f"{where}: instrument.full_scale is {instrument.full_scale}; give the inputs' range in V, e.g. 10.0")
    if instrument.analyzer != bool(instrument.shows):
        told = "lacks instrument.shows" if instrument.analyzer else "has instrument.shows"
        raise PlanError(f"{where} {told}; an analyzer needs them, one [[instrument.shows]] for each display, others have none")
    if instrument.analyzer and not any(shown.kind == "time" for shown in instrument.shows):
        raise PlanError(f"{where}: no display shows a time record; a recording needs one, so show a channel as time on one")
    for shown in instrument.shows:
        unknown = next((name for name in (shown.channel, shown.reference) if name and name not in plan.channels), None)
        if unknown is not None:
            raise PlanError(f"{where}: instrument.shows names {unknown!r}; the plan has {', '.join(plan.channels)}")
        pattern = r"[01]" if instrument.kind == "sr785" else r"[A-Z0-9:]+( \d(,\d)?)?"
        if not re.fullmatch(pattern, shown.trace):
            raise PlanError(f"{where}: instrument.shows has trace {shown.trace!r}; give a display (0, 1) or a feed (XTIM:VOLT 1)")


def _check_run(run: RunPlan, rate: float, here: str) -> None:
    if not run.id or "/" in run.id or run.id.startswith("."):
        raise PlanError(f"{here} needs an id without a slash or a leading dot")
    if not (math.isfinite(run.gain) and run.gain > 0.0):
        raise PlanError(f"{here} has gain {run.gain:g}; it must be positive, so correct it")
    if not 0.0 < run.seconds <= 86400.0 or run.seconds * rate < 16:
        raise PlanError(f"{here} lasts {run.seconds:g} s; give at least 16 samples and at most a day")
    if not 1 <= run.repeats <= 1000:
        raise PlanError(f"{here} has repeats {run.repeats}; give 1 to 1000")
    if run.excitation == "multisine" and not 16.0 / rate <= run.period <= run.seconds:
        raise PlanError(f"{here} has a period of {run.period:g} s; give one of 16 samples at least and no longer than the run")
    if run.excitation in ("random", "multisine"):
        if run.band is None:
            raise PlanError(f"{here} has no band; give [low, high] in Hz of its {run.excitation} drive")
        if not 0.0 <= run.band[0] < run.band[1] < rate / 2.0:
            raise PlanError(f"{here} has band {list(run.band)} Hz; give low < high below half the sample rate ({rate / 2:g} Hz)")
