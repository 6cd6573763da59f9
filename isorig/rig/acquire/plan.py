"""The plan of a session: rig, instrument, channels, runs."""

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import msgspec

from isorig.analysis.campaign import Quantity
from isorig.analysis.excitations import PlannedExcitation
from isorig.analysis.model.limits import Limits
from isorig.analysis.model.refusals import explained
from isorig.analysis.model.rig_model import RigModel, from_tree
from isorig.drivers.kinds import RecordsKind, StreamKind, kinds
from isorig.rig.files.recording import SENSOR
from isorig.rig.files.tomlfile import read_toml
from isorig.rig.wire_bonder.description import THESIS, wire_bonder


class PlanPart(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Any part of a plan."""


class ShowsPlan(PlanPart, frozen=True):
    """The content of a display or trace of an analyzer.

    `trace` is the analyzer's name for it: a display's number (SR785), a feed like "XTIM:VOLT 1" (35670A). A "time" trace becomes
    the channel of that name; a spectrum names its channels, as in the recording.
    """

    trace: str
    kind: Literal["time", "transfer_function", "coherence", "auto_spectrum", "cross_spectrum"]
    channel: str
    reference: str = ""
    unit: str = "1"


class InstrumentPlan(PlanPart, frozen=True):
    """The source of the samples: kind of instrument, port, rate in Hz.

    `usable_to` is the highest frequency in Hz that the instrument's filter leaves unchanged, from its data sheet. `shows` is
    required for analyzers, which return records. The other keys are the settings of the kind.
    """

    kind: str
    port: str
    sample_rate: float
    usable_to: float | None = None
    shows: tuple[ShowsPlan, ...] = ()
    settings: Any = None

    @property
    def about(self) -> StreamKind | RecordsKind:
        """The kind itself."""
        return kinds()[self.kind]

    @property
    def analyzer(self) -> bool:
        """Whether it measures on its own and returns records."""
        return isinstance(self.about, RecordsKind)


class ChannelPlan(PlanPart, frozen=True):
    """A sensor at an input: `sensitivity` is the input's unit per unit of the channel (V per m/s^2), `calibrated` a date."""

    input: int
    sensitivity: float
    unit: str = "m/s^2"
    quantity: Quantity = "acceleration"
    sensor: str = ""
    place: str = ""
    direction: str = ""
    serial_number: str = ""
    calibrated: str = ""

    @property
    def description(self) -> dict[str, str]:
        """Description of the sensor for readers of the recording."""
        return {key: getattr(self, key) for key in SENSOR}


class LogPlan(PlanPart, frozen=True):
    """A channel of a logger: any unit; `sensitivity` is the input's unit per unit of the channel."""

    input: int
    unit: str
    sensitivity: float = 1.0


class LoggerPlan(PlanPart, frozen=True):
    """A slow instrument that runs along and is stored next to the channels with its own rate in Hz; `settings` are the other
    keys, those of its kind."""

    kind: str
    port: str
    sample_rate: float
    channels: dict[str, LogPlan]
    settings: Any = None


class RunPlan(PlanPart, frozen=True):
    """A run, or several repeats: configuration, excitation, duration in seconds; a multisine's period in seconds, a sine's
    frequency in Hz.

    There is no drive in a "free" run (a hammer, a pushed table) and in an "other" one, which is driven by other means. `source`
    is the peak level of an analyzer's source, V; without it, the level set on the panel is used. `repeat_of` names an earlier run
    whose drive is repeated sample for sample: the difference of the responses is not caused by the drive.
    """

    id: str
    configuration: str
    gain: float
    seconds: float
    excitation: PlannedExcitation = "random"
    band: tuple[float, float] | None = None
    period: float = 4.0
    frequency: float | None = None
    repeats: int = 1
    seed: int = 0
    use: Literal["fit", "holdout"] = "fit"
    source: float | None = None
    repeat_of: str | None = None

    @property
    def played(self) -> bool:
        """Whether the instrument plays a computed drive."""
        return self.excitation not in ("free", "other")

    @property
    def recorded_as(self) -> str:
        """The excitation as named in the recording's format."""
        return "other" if self.excitation in ("sine", "steps") else self.excitation

    def ticks(self, rate: float) -> int:
        """Samples of the run at a rate in Hz; a multisine has whole periods."""
        n = round(self.seconds * rate)
        if self.excitation != "multisine":
            return n
        period = round(self.period * rate)
        return max(n // period, 1) * period

    def ids(self) -> tuple[str, ...]:
        """The names of its repeats: the id itself for one, otherwise with -1, -2 ..."""
        return (self.id,) if self.repeats == 1 else tuple(f"{self.id}-{k + 1}" for k in range(self.repeats))


class Plan(PlanPart, frozen=True):
    """A session. `rig` contains known values (SI) under the recording's names, `limits` the limits of runs; `sensors` is the path
    of the laboratory's list of sensors. `loggers` run along.
    """

    instrument: InstrumentPlan
    channels: dict[str, ChannelPlan]
    runs: tuple[RunPlan, ...] = ()
    rig: dict[str, float | str] = {}
    limits: Limits = Limits()
    sensors: str = ""
    loggers: dict[str, LoggerPlan] = {}

    def original(self, run: RunPlan, repeat: int) -> tuple[RunPlan, int]:
        """The run whose drive a run plays, and the index of the repeat: the run itself if it does not repeat another."""
        while run.repeat_of is not None:
            run, repeat = next(
                (earlier, k) for earlier in self.runs for k, name in enumerate(earlier.ids()) if name == run.repeat_of
            )
        return run, repeat

    def described(self) -> RigModel:
        """The rig described by the plan, or the wire bonder."""
        return self.model() or wire_bonder()

    def nominal(self, *, friction: bool = False) -> RigModel:
        """The rig with the values of its description; the wire bonder with those of the plan, and with dry friction if asked."""
        known = {name: value for name, value in self.rig.items() if not isinstance(value, str)}
        return self.model() or wire_bonder({**THESIS, **known}, friction=friction)

    def model(self) -> RigModel | None:
        """The rig described by the plan; None for the wire bonder."""
        description = self.rig.get("description")
        return None if description is None else from_tree(tomllib.loads(str(description)))

    @property
    def drive(self) -> str:
        """The drive channel."""
        return self.described().drive.channel


def as_virtual(plan: Plan) -> Plan:
    """The plan for a virtual rig: the sensors are marked as virtual."""
    channels = {
        name: msgspec.structs.replace(channel, sensor=f"virtual {channel.sensor or 'sensor'}")
        for name, channel in plan.channels.items()
    }
    return msgspec.structs.replace(plan, channels=channels)


def load_plan(path: Path) -> Plan:
    """Read a plan; `isorig.rig.acquire.plan_check` validates its values. Raises PlanError, a sentence with the key and what is
    allowed, if it is invalid."""
    plan = read_toml(path, Plan, "a plan", prepared=_prepared)
    return msgspec.structs.replace(plan, sensors=str(path.parent / plan.sensors)) if plan.sensors else plan


def plan_of(tree: Mapping[str, Any]) -> Plan:
    """A plan from plain dicts and lists, before validation of its values. Raises msgspec.ValidationError, with the key and what
    is allowed, if they are no plan."""
    return msgspec.convert(_prepared(tree), Plan, strict=False)


def _prepared(tree: Mapping[str, Any]) -> Mapping[str, Any]:
    # With the settings of instrument and loggers as their kinds have them.
    instrument, loggers = tree.get("instrument"), tree.get("loggers")
    if isinstance(instrument, Mapping):
        keys = ("kind", "port", "sample_rate", "usable_to", "shows")
        tree = {**tree, "instrument": _with_settings(instrument, keys, "instrument")}
    if isinstance(loggers, Mapping):
        own = ("kind", "port", "sample_rate", "channels")
        converted = {
            name: _with_settings(one, own, f"loggers.{name}") if isinstance(one, Mapping) else one
            for name, one in loggers.items()
        }
        tree = {**tree, "loggers": converted}
    return tree


def _with_settings(table: Mapping[str, Any], keys: Sequence[str], where: str) -> dict[str, Any]:
    # The other keys are the settings of the kind.
    own = {key: value for key, value in table.items() if key in keys}
    kind = kinds().get(str(own.get("kind")))
    if "kind" in own and kind is None:
        raise msgspec.ValidationError(f"{where}.kind is {own['kind']!r}, allowed are {', '.join(kinds())}")
    if kind is not None:
        rest = {key: value for key, value in table.items() if key not in own}
        try:
            own["settings"] = msgspec.convert(rest, kind.settings, strict=False)
        except msgspec.ValidationError as error:
            said = explained(str(error), rest, kind.settings, "this table")
            raise msgspec.ValidationError(f"{where} of kind {kind.name}: {said}") from None
    return own
