"""A plan is looked at whole before anything moves: what is wrong is said in a sentence with its place."""

from __future__ import annotations

import math
import re
import tomllib
from pathlib import Path

from analysis.errors import ModelError
from drivers.kinds import RecordsKind
from rig.acquire.plan import ChannelPlan, Plan, RunPlan, load_plan
from rig.errors import PlanError

#: The SI unit of each quantity.
UNITS = {
    "acceleration": "m/s^2", "velocity": "m/s", "displacement": "m", "force": "N", "voltage": "V", "current": "A",
}  # fmt: skip
#: Names that the recording's format uses for something else.
TAKEN = ("gain", "gaps", "timing", "spectra", "progress")


def read_plan(path: Path) -> Plan:
    """Read a plan and look at it whole.

    Raises
    ------
    PlanError
        In one sentence: which key, what was found, what is allowed.
    """
    plan = load_plan(path)
    check_plan(plan, str(path))
    return plan


def check_plan(plan: Plan, where: str) -> None:
    """Look at every value.

    Raises
    ------
    PlanError
        In one sentence.
    """
    rate = plan.instrument.sample_rate
    if not 0.0 < rate < math.inf:
        raise PlanError(f"{where}: sample_rate is {rate:g} Hz; it must be positive and finite, so correct it")
    configurations = _configurations(plan, where)
    _check_instrument(plan, where)
    if not plan.channels:
        raise PlanError(f"{where}: there are no channels; name at least one as [channels.<name>]")
    if not plan.runs:
        raise PlanError(f"{where}: there are no runs; add at least one as [[runs]]")
    for name, channel in plan.channels.items():
        _check_channel(name, channel, where)
    inputs = [channel.input for channel in plan.channels.values()]
    if len(set(inputs)) < len(inputs):
        raise PlanError(f"{where}: two channels share an input ({inputs}); give each its own")
    ids = [name for run in plan.runs for name in run.ids()]
    twice = next((name for name in ids if ids.count(name) > 1), None)
    if twice is not None:
        raise PlanError(f"{where}: two runs are called {twice!r}; give each its own id")
    for run in plan.runs:
        here = f"{where}: run {run.id!r}"
        if run.configuration not in configurations:
            raise PlanError(f"{here} has configuration {run.configuration!r}; the rig knows {', '.join(configurations)}")
        _check_run(run, rate, here)


def _configurations(plan: Plan, where: str) -> tuple[str, ...]:
    for key, value in plan.rig.items():
        if isinstance(value, str):
            if key != "description":
                raise PlanError(f"{where}: rig.{key} is the text {value!r}; what is known of the rig are numbers in SI")
        elif not math.isfinite(value) or (key.endswith("_mass") and value <= 0.0):
            raise PlanError(f"{where}: rig.{key} is {value:g}; give a finite value, a mass above zero")
    try:
        model = plan.model()
    except tomllib.TOMLDecodeError as error:
        raise PlanError(f"{where}: rig.description is not TOML ({error}); give the text of the rig's description") from None
    except ModelError as error:
        raise PlanError(f"{where}: rig.description: {error}") from None
    return ("unlocked", "locked") if model is None else tuple(model.configurations)


def _check_channel(name: str, channel: ChannelPlan, where: str) -> None:
    if not name.isidentifier() or name in TAKEN:
        raise PlanError(f"{where}: a channel cannot be called {name!r}; use letters and digits, and no name of the format")
    if not math.isfinite(channel.sensitivity) or channel.sensitivity == 0.0:
        raise PlanError(
            f"{where}: channels.{name}.sensitivity is {channel.sensitivity:g}; take it from the sensor's calibration sheet"
        )
    if channel.unit != UNITS[channel.quantity]:
        asked = f"for {channel.quantity} give {UNITS[channel.quantity]!r}, or correct quantity"
        raise PlanError(f"{where}: channels.{name}.unit is {channel.unit!r}; {asked}")
    if channel.input < 0:
        raise PlanError(f"{where}: channels.{name}.input is {channel.input}; inputs count from 0")


def _check_instrument(plan: Plan, where: str) -> None:
    instrument, kind = plan.instrument, plan.instrument.about
    if instrument.analyzer != bool(instrument.shows):
        told = "lacks instrument.shows" if instrument.analyzer else "has instrument.shows"
        raise PlanError(f"{where} {told}; an analyzer needs them, one [[instrument.shows]] for each display, others have none")
    if not isinstance(kind, RecordsKind):
        return
    if not any(shown.kind == "time" for shown in instrument.shows):
        raise PlanError(f"{where}: no display shows a time record; a recording needs one, so show a channel as time on one")
    pattern, example = kind.trace
    for shown in instrument.shows:
        unknown = next((name for name in (shown.channel, shown.reference) if name and name not in plan.channels), None)
        if unknown is not None:
            raise PlanError(f"{where}: instrument.shows names {unknown!r}; the plan has {', '.join(plan.channels)}")
        if not re.fullmatch(pattern, shown.trace):
            raise PlanError(f"{where}: instrument.shows has trace {shown.trace!r}; give {example}")


def _check_run(run: RunPlan, rate: float, here: str) -> None:
    if not run.id.isprintable() or not run.id or "/" in run.id or run.id.startswith("."):
        raise PlanError(f"{here} needs an id of printable characters, without a slash or a leading dot")
    if not (math.isfinite(run.gain) and run.gain > 0.0):
        raise PlanError(f"{here} has gain {run.gain:g}; it must be positive, so correct it")
    if not 0.0 < run.seconds <= 86400.0 or run.seconds * rate < 16:
        raise PlanError(f"{here} lasts {run.seconds:g} s; give at least 16 samples and at most a day")
    if not 1 <= run.repeats <= 1000:
        raise PlanError(f"{here} has repeats {run.repeats}; give 1 to 1000")
    if run.seed < 0:
        raise PlanError(f"{here} has seed {run.seed}; give 0 or more")
    if run.excitation == "multisine" and not 16.0 / rate <= run.period <= run.seconds:
        raise PlanError(f"{here} has a period of {run.period:g} s; give one of 16 samples at least and no longer than the run")
    if run.band is not None and not 0.0 <= run.band[0] < run.band[1] < rate / 2.0:
        raise PlanError(f"{here} has band {list(run.band)} Hz; give low < high below half the sample rate ({rate / 2:g} Hz)")
    if run.excitation not in ("random", "multisine"):
        return
    if run.band is None:
        raise PlanError(f"{here} has no band; give [low, high] in Hz of its {run.excitation} drive")
    if not _lines(run, rate, run.band):
        raise PlanError(f"{here} has band {list(run.band)} Hz, which holds no line of its drive; widen it or make the run longer")


def _lines(run: RunPlan, rate: float, band: tuple[float, float]) -> bool:
    # Lines lie at multiples of one over the length of what is played; a multisine has the odd ones.
    length = (round(run.period * rate) if run.excitation == "multisine" else run.ticks(rate)) / rate
    first, last = max(math.ceil(band[0] * length), 1), math.floor(band[1] * length)
    return last >= first + (run.excitation == "multisine" and first % 2 == 0)
