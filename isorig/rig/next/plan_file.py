"""Writes plans as TOML, each run with the sentences that give its reason, and reads limits."""

from collections.abc import Mapping, Sequence
from itertools import count, islice
from pathlib import Path
from typing import Any

import msgspec

from isorig.analysis.campaign import SI_UNIT
from isorig.analysis.errors import ModelError
from isorig.analysis.model.limits import Limits
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.wording import words
from isorig.rig.acquire.plan import ChannelPlan, InstrumentPlan, Plan, RunPlan
from isorig.rig.acquire.plan_check import check_plan
from isorig.rig.errors import PlanError
from isorig.rig.files.output import write_text
from isorig.rig.files.rivals import Rivals
from isorig.rig.files.tomlfile import comments, plain, read_toml, table_text
from isorig.rig.next.policy import POLICY


def virtual_instrument_of(rivals: Rivals) -> Plan:
    """A plan without runs for the simulated instrument: its channels are those of the rig, in the order of its inputs."""
    channels = {
        name: ChannelPlan(
            input=k, sensitivity=POLICY.sensitivity, place=name, quantity=quantity, unit=SI_UNIT[quantity],
            sensor=f"virtual sensor of {words(quantity)}",
        )
        for k, (name, quantity) in enumerate(rivals.explains.model.quantities.items())
    }  # fmt: skip
    # Plans are read by people: a rate from a clock has rounding errors.
    instrument = InstrumentPlan(kind="framed", port="virtual", sample_rate=float(f"{rivals.sample_rate:.9g}"))
    return Plan(instrument=instrument, channels=channels, rig=rivals.known)


def write_plan(path: Path, plan: Plan, why: Mapping[str, Sequence[str]], head: Sequence[str] = ()) -> Path:
    """Write a plan for `rig acquire`, atomically, with the sentences of `head` at its top and those of `why` above runs, by their
    ids. Raises PlanError if the plan itself is not valid."""
    check_plan(plan, str(path))
    return write_text(path, plan_text(plan, why, head))


def plan_text(plan: Plan, why: Mapping[str, Sequence[str]], head: Sequence[str] = ()) -> str:
    """A plan as TOML, without values that have their default."""
    instrument = plain(plan.instrument)
    shows = instrument.pop("shows", ())
    lines = [*_comments(head), *table_text("rig", plan.rig), *table_text("instrument", _with_settings(instrument))]
    for each in shows:
        lines += table_text("instrument.shows", each, many=True)
    for name, channel in plan.channels.items():
        lines += table_text(f"channels.{name}", plain(channel))
    for name, logger in plan.loggers.items():
        stated = plain(logger)
        logged = stated.pop("channels")
        lines += table_text(f"loggers.{name}", _with_settings(stated))
        for key, about in logged.items():
            lines += table_text(f"loggers.{name}.channels.{key}", about)
    limits = plain(plan.limits)
    nested = {key: limits.pop(key) for key in ("stroke", "channels") if key in limits}
    lines += table_text("limits", limits) if limits else []
    for key, values in nested.items():
        lines += table_text(f"limits.{key}", values)
    for run in plan.runs:
        lines += [*_comments(why.get(run.id, ())), *table_text("runs", plain(run), many=True)]
    return "\n".join(lines)


def _with_settings(stated: dict[str, Any]) -> dict[str, Any]:
    # The settings of a kind stand between its other keys.
    settings = stated.pop("settings", {})
    return {**stated, **settings}


def _comments(sentences: Sequence[str]) -> list[str]:
    return comments("\n".join(sentences))


def run_names(number: int, taken: Sequence[str]) -> list[str]:
    """Unique names for further runs."""
    return list(islice((name for k in count(1) if (name := f"next-{k}") not in taken), number))


def with_runs(plan: Plan, runs: Sequence[RunPlan]) -> Plan:
    """The plan with other runs."""
    return msgspec.structs.replace(plan, runs=tuple(runs))


def limits_of(model: RigModel, plan: Plan | None, file: Path | None) -> Limits:
    """All given limits of a rig, of its description, a plan and a file: the tightest of each.

    A file has them at its top or in a table [limits]. Raises PlanError if it is invalid, two limits exclude each other, or one is
    for a link or channel that the rig does not have.
    """
    others = [] if plan is None else [plan.limits]
    if file is not None:
        others.append(read_toml(file, Limits, "a file of limits", prepared=lambda tree: tree.get("limits", tree)))
    try:
        return model.limits_within(*others)
    except ModelError as error:
        raise PlanError(str(error)) from None
