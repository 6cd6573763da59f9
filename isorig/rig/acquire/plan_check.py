"""Validates a whole plan before a session starts: each error is one sentence with its location."""

import math
import re
import tomllib
from collections.abc import Iterator, Sequence
from datetime import date
from pathlib import Path

from isorig.analysis.campaign import SI_UNIT
from isorig.analysis.errors import ModelError
from isorig.drivers.kinds import RecordsKind, kinds
from isorig.rig.acquire.plan import ChannelPlan, LoggerPlan, Plan, RunPlan, load_plan
from isorig.rig.errors import PlanError

#: Largest sensitivity, and reciprocal of the smallest: values in SI remain within a recording's limits.
SENSITIVITY_MOST = 1e30
#: Names used otherwise by the recording's format.
TAKEN = ("gain", "gaps", "timing", "spectra", "progress", "logs")
#: Highest rate of a logger, Hz: its rows are stored by the host's clock, which is right to about a millisecond.
LOGGER_MOST = 1000.0
#: Minimum number of samples of a run, and of a period; largest number of its repeats.
SAMPLES, REPEATS_MOST = 16, 1000
#: Keys that a repeated run must share with its original.
REPEATED = ("configuration", "gain", "seconds", "excitation", "band", "period", "frequency")


def read_plan(path: Path, *, runs: bool = True) -> Plan:
    """Read and validate a plan; with `runs` False it may have no runs. Raises PlanError, a sentence with the key and what is
    allowed, if it is invalid."""
    plan = load_plan(path)
    check_plan(plan, str(path), runs=runs)
    return plan


def check_plan(plan: Plan, where: str, *, runs: bool = True) -> None:
    """Validate every value; with `runs` False there may be no runs. Raises PlanError, in one sentence, if one is not allowed."""
    fault = next(_faults(plan, where, runs=runs), None)
    if fault is not None:
        raise PlanError(fault)


def _faults(plan: Plan, where: str, *, runs: bool) -> Iterator[str]:
    # Only the first counts: each check may assume that those before it passed.
    rate = plan.instrument.sample_rate
    if not 0.0 < rate < math.inf:
        yield f"{where}: sample_rate is {rate:g} Hz; it must be positive and finite, so correct it"
    usable = plan.instrument.usable_to
    if usable is not None and not 0.0 < usable <= rate / 2.0:
        yield f"{where}: usable_to is {usable:g} Hz; it is above zero and at most half the sample rate, so correct it"
    yield from _of_rig(plan, where)
    yield from _of_instrument(plan, where)
    yield from _of_limits(plan, where)
    for name, logger in plan.loggers.items():
        yield from _of_logger(name, logger, plan, f"{where}: loggers.{name}")
    if not plan.channels:
        yield f"{where}: there are no channels; name at least one as [channels.<name>]"
    if runs and not plan.runs:
        yield f"{where}: there are no runs; add at least one as [[runs]]"
    for name, channel in plan.channels.items():
        yield from _of_channel(name, channel, where)
    inputs = [channel.input for channel in plan.channels.values()]
    if len(set(inputs)) < len(inputs):
        yield f"{where}: two channels share an input ({inputs}); give each channel its own input"
    configurations = plan.described().configurations
    ids = [name for run in plan.runs for name in run.ids()]
    twice = next((name for name in ids if ids.count(name) > 1), None)
    if twice is not None:
        yield f"{where}: two runs have the id {twice!r}; give each run its own id"
    for place, run in enumerate(plan.runs):
        here = f"{where}: run {run.id!r}"
        if run.configuration not in configurations:
            yield f"{here} has configuration {run.configuration!r}; the rig has {', '.join(configurations)}"
        yield from _of_run(run, rate, here)
        if run.source is not None and not (plan.instrument.analyzer and 0.0 < run.source < math.inf):
            yield f"{here} has source {run.source:g}; only an analyzer has one, and its level in V is above zero"
        yield from _of_repeat(run, plan.runs[:place], here)


def _of_logger(name: str, logger: LoggerPlan, plan: Plan, here: str) -> Iterator[str]:
    for each in (name, *logger.channels):
        if not each.isidentifier() or each in (*TAKEN, "time"):
            yield f"{here}: {each!r} cannot be a name here; use letters and digits, and no name of the format"
    if not logger.channels:
        yield f"{here} has no channels; name at least one as [loggers.{name}.channels.<name>]"
    if isinstance(kinds()[logger.kind], RecordsKind) or plan.instrument.analyzer:
        yield f"{here}: an analyzer neither runs along nor has loggers; use instruments that stream"
    if not 0.0 < logger.sample_rate <= LOGGER_MOST:
        yield (
            f"{here}.sample_rate is {logger.sample_rate:g} Hz; a logger has up to {LOGGER_MOST:g} Hz, so connect a faster sensor "
            "to the instrument"
        )
    ports = [plan.instrument.port, *(other.port for key, other in plan.loggers.items() if key != name)]
    if logger.port != "virtual" and logger.port in ports:
        yield f"{here}.port is {logger.port!r}, which is another instrument's; give its own"
    for each, channel in logger.channels.items():
        if channel.input < 0:
            yield f"{here}.channels.{each}.input is {channel.input}; inputs start at 0"
        if not channel.unit.isprintable() or not 1.0 / SENSITIVITY_MOST <= abs(channel.sensitivity) <= SENSITIVITY_MOST:
            yield (
                f"{here}.channels.{each} has the unit {channel.unit!r} and the sensitivity {channel.sensitivity:g}; give the "
                "unit as text, and a finite sensitivity other than 0"
            )


def _of_limits(plan: Plan, where: str) -> Iterator[str]:
    links = tuple(link.name for link in plan.described().links)
    for name in plan.limits.stroke:
        if name not in links:
            yield f"{where}: limits.stroke names {name!r}; the rig has the links {', '.join(links)}"
    for name in plan.limits.channels:
        if name not in plan.channels:
            yield f"{where}: limits.channels names {name!r}; the plan has {', '.join(plan.channels)}"


def _of_repeat(run: RunPlan, before: Sequence[RunPlan], here: str) -> Iterator[str]:
    if run.repeat_of is None:
        return
    earlier = {name: one for one in before for name in one.ids()}
    first = earlier.get(run.repeat_of)
    if first is None:
        known = ", ".join(earlier) or "none"
        yield f"{here} has repeat_of {run.repeat_of!r}; give the id of a run before it ({known})"
        return
    if not run.played:
        yield f"{here} has repeat_of but no drive that is played; remove repeat_of, or choose another excitation"
    for key in REPEATED:
        was, now = getattr(first, key), getattr(run, key)
        if was != now:
            yield f"{here} repeats {run.repeat_of!r} with {key} {now}, not {was}; a repeat has the same {key}"
    if run.seed not in (0, first.seed):
        yield f"{here} repeats {run.repeat_of!r} with seed {run.seed}, not {first.seed}; remove seed"


def _of_rig(plan: Plan, where: str) -> Iterator[str]:
    for key, value in plan.rig.items():
        if isinstance(value, str):
            if key != "description":
                yield f"{where}: rig.{key} is the text {value!r}; known values of the rig are numbers in SI"
        elif not math.isfinite(value) or (key.endswith("_mass") and value <= 0.0):
            yield f"{where}: rig.{key} is {value:g}; give a finite value, a mass above zero"
    try:
        plan.model()
    except tomllib.TOMLDecodeError as error:
        yield f"{where}: rig.description is not TOML ({error}); give the text of the rig's description"
    except ModelError as error:
        yield f"{where}: rig.description: {error}"


def _of_channel(name: str, channel: ChannelPlan, where: str) -> Iterator[str]:
    if not name.isidentifier() or name in TAKEN:
        yield f"{where}: a channel cannot be named {name!r}; use letters and digits, and no name of the format"
    if not 1.0 / SENSITIVITY_MOST <= abs(channel.sensitivity) <= SENSITIVITY_MOST:
        yield f"{where}: channels.{name}.sensitivity is {channel.sensitivity:g}; take it from the sensor's calibration sheet"
    if channel.unit != SI_UNIT[channel.quantity]:
        asked = f"for {channel.quantity} give {SI_UNIT[channel.quantity]!r}, or correct quantity"
        yield f"{where}: channels.{name}.unit is {channel.unit!r}; {asked}"
    if channel.calibrated:
        try:
            date.fromisoformat(channel.calibrated)
        except ValueError:
            yield f"{where}: channels.{name}.calibrated is {channel.calibrated!r}; write the date as 2026-01-31"
    if channel.input < 0:
        yield f"{where}: channels.{name}.input is {channel.input}; inputs start at 0"


def _of_instrument(plan: Plan, where: str) -> Iterator[str]:
    instrument, kind = plan.instrument, plan.instrument.about
    if instrument.analyzer != bool(instrument.shows):
        text = "lacks instrument.shows" if instrument.analyzer else "has instrument.shows"
        yield f"{where} {text}; an analyzer needs one [[instrument.shows]] for each display, other kinds have none"
    if not isinstance(kind, RecordsKind):
        return
    if not any(shown.kind == "time" for shown in instrument.shows):
        yield f"{where}: no display shows a time record; a recording needs one, so show a channel as time on one"
    pattern, example = kind.trace
    for shown in instrument.shows:
        unknown = next((name for name in (shown.channel, shown.reference) if name and name not in plan.channels), None)
        if unknown is not None:
            yield f"{where}: instrument.shows names {unknown!r}; the plan has {', '.join(plan.channels)}"
        if not re.fullmatch(pattern, shown.trace):
            yield f"{where}: instrument.shows has trace {shown.trace!r}; give {example}"


def _of_run(run: RunPlan, rate: float, here: str) -> Iterator[str]:
    if not run.id.isprintable() or not run.id or "/" in run.id or run.id.startswith("."):
        yield f"{here} needs an id of printable characters, without a slash or a leading dot"
    if not (math.isfinite(run.gain) and run.gain > 0.0):
        yield f"{here} has gain {run.gain:g}; it must be positive, so correct it"
    if not 0.0 < run.seconds <= 86400.0 or run.seconds * rate < SAMPLES:
        yield f"{here} lasts {run.seconds:g} s; give at least {SAMPLES} samples and at most a day"
    if not 1 <= run.repeats <= REPEATS_MOST:
        yield f"{here} has repeats {run.repeats}; give 1 to {REPEATS_MOST}"
    if run.seed < 0:
        yield f"{here} has seed {run.seed}; give 0 or more"
    if run.excitation == "multisine" and not SAMPLES / rate <= run.period <= run.seconds:
        yield f"{here} has a period of {run.period:g} s; give at least {SAMPLES} samples and at most the length of the run"
    if run.band is not None and not 0.0 <= run.band[0] < run.band[1] < rate / 2.0:
        yield f"{here} has band {list(run.band)} Hz; give low < high below half the sample rate ({rate / 2:g} Hz)"
    yield from _of_frequency(run, rate, here)
    if run.excitation not in ("random", "multisine"):
        return
    if run.band is None:
        yield f"{here} has no band; give [low, high] in Hz for its {run.excitation} drive"
    elif not _lines(run, rate, run.band):
        yield f"{here} has band {list(run.band)} Hz, which contains no frequency of its drive; widen it or extend the run"


def _of_frequency(run: RunPlan, rate: float, here: str) -> Iterator[str]:
    if (run.frequency is None) == (run.excitation == "sine"):
        wanted = "lacks frequency; give that of its sine" if run.frequency is None else "has frequency; remove it, or use a sine"
        yield f"{here} {wanted}, in Hz below {rate / 2:g}"
    if run.frequency is not None and not 0.0 < run.frequency < rate / 2.0:
        yield f"{here} has frequency {run.frequency:g} Hz; give one above 0 and below {rate / 2:g}, half the sample rate"
    if run.excitation == "sweep" and (run.band is None or run.band[0] <= 0.0):
        yield f"{here} is a sweep without a band; give [low, high] in Hz, low above 0"


def _lines(run: RunPlan, rate: float, band: tuple[float, float]) -> bool:
    # The frequencies are multiples of one over the length of the signal; a multisine has the odd ones.
    length = (round(run.period * rate) if run.excitation == "multisine" else run.ticks(rate)) / rate
    first, last = max(math.ceil(band[0] * length), 1), math.floor(band[1] * length)
    return last >= first + (run.excitation == "multisine" and first % 2 == 0)
