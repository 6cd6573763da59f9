"""Writes plans as TOML, each run with the sentences that give its reason."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from isorig.analysis.campaign import SI_UNIT
from isorig.rig.acquire.plan import ChannelPlan, InstrumentPlan, Plan, RunPlan
from isorig.rig.acquire.plan_check import check_plan
from isorig.rig.files.output import write_text
from isorig.rig.files.rivals import Rivals

#: Sensitivity of a channel of the virtual rig, V per SI unit, for a plan without its own instrument.
SENSITIVITY = 0.2


def virtual_instrument_of(found: Rivals) -> Plan:
    """A plan without runs for the simulated instrument: its channels are those of the rig, in the order of its inputs."""
    model = found.explains.variant().model
    quantities = {drive.channel: drive.quantity for drive in model.drives}
    quantities |= {sensor.channel: sensor.quantity for sensor in model.sensors}
    channels = {
        name: ChannelPlan(
            input=k,
            sensitivity=SENSITIVITY,
            place=name,
            quantity=quantity,
            unit=SI_UNIT[quantity],
            sensor=f"virtual sensor of {quantity.replace('_', ' ')}",
        )
        for k, (name, quantity) in enumerate(quantities.items())
    }
    # Plans are read by people: a rate from a clock has rounding errors.
    instrument = InstrumentPlan(kind="framed", port="virtual", sample_rate=float(f"{found.sample_rate:.9g}"))
    return Plan(instrument=instrument, channels=channels, rig=found.known)


def write_plan(path: Path, plan: Plan, why: Mapping[str, Sequence[str]], head: Sequence[str] = ()) -> Path:
    """Write a plan for `rig acquire`, atomically.

    Parameters
    ----------
    path
        The file.
    plan
        The plan.
    why
        Sentences above a run, by its id.
    head
        Sentences at the top.

    Raises
    ------
    PlanError
        The plan itself is not valid.
    """
    check_plan(plan, str(path))
    return write_text(path, plan_text(plan, why, head))


def plan_text(plan: Plan, why: Mapping[str, Sequence[str]], head: Sequence[str] = ()) -> str:
    """A plan as TOML, without values that have their default."""
    instrument = _stated(plan.instrument)
    settings = instrument.pop("settings", None) or {}
    shows = instrument.pop("shows", ())
    lines = [*_comments(head), *_table("rig", plan.rig), *_table("instrument", {**instrument, **settings})]
    for each in shows:
        lines += _table("instrument.shows", each, many=True)
    for name, channel in plan.channels.items():
        lines += _table(f"channels.{name}", _stated(channel))
    for name, logger in plan.loggers.items():
        stated = _stated(logger)
        settings, logged = stated.pop("settings", None) or {}, stated.pop("channels")
        lines += _table(f"loggers.{name}", {**stated, **settings})
        for key, about in logged.items():
            lines += _table(f"loggers.{name}.channels.{key}", about)
    limits = _stated(plan.limits)
    nested = {key: limits.pop(key) for key in ("stroke", "channels") if key in limits}
    lines += _table("limits", limits) if limits else []
    for key, values in nested.items():
        lines += _table(f"limits.{key}", values)
    for run in plan.runs:
        lines += [*_comments(why.get(run.id, ())), *_table("runs", _stated(run), many=True)]
    return "\n".join(lines)


def _stated(part: msgspec.Struct) -> dict[str, Any]:
    fields = msgspec.structs.fields(part)
    required = {field.name for field in fields if field.required}
    defaults = {field.name: field.default for field in fields}
    kept = {name: getattr(part, name) for name in part.__struct_fields__}
    return {
        name: msgspec.to_builtins(value)
        for name, value in kept.items()
        if value is not None and (name in required or value != defaults[name]) and value not in ({}, ())
    }


def _comments(sentences: Sequence[str]) -> list[str]:
    return [f"# {line}" for sentence in sentences for line in sentence.splitlines()]


def _table(name: str, values: Mapping[str, Any], *, many: bool = False) -> list[str]:
    head = f"[[{name}]]" if many else f"[{name}]"
    return [head, *(f"{key} = {_value(value)}" for key, value in values.items() if value is not None), ""]


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{key} = {_value(item)}' for key, item in value.items() if item is not None)}}}"
    if isinstance(value, Sequence):
        return f"[{', '.join(_value(item) for item in value)}]"
    return repr(value)


def run_names(count: int, taken: Sequence[str]) -> list[str]:
    """Unique names for further runs."""
    found: list[str] = []
    number = 1
    while len(found) < count:
        if (name := f"next-{number}") not in taken:
            found.append(name)
        number += 1
    return found


def with_runs(plan: Plan, runs: Sequence[RunPlan]) -> Plan:
    """The plan with other runs."""
    return msgspec.structs.replace(plan, runs=tuple(runs))
