"""A first plan for an instrument that is connected: its kind's example with its port and its own settings, and one run."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from typing import Any

from isorig.drivers.connected import Connected
from isorig.drivers.kinds import StreamKind, kinds
from isorig.drivers.voltage import OutputSettings
from isorig.rig.acquire.plan import plan_of
from isorig.rig.acquire.plan_check import check_plan
from isorig.rig.errors import PlanError

#: Settings that only an instrument with an output has.
OUTPUT = ("output", "output_full_scale", *OutputSettings.__struct_fields__)
#: The run, and what drives it where the instrument plays no drive.
RUN = {"id": "first", "configuration": "unlocked", "gain": 10.0, "seconds": 10.0}
PLAYED = {"excitation": "random", "band": [0.5, 20.0]}
OTHER = {"excitation": "other"}
HEAD = """# Proposed by rig instruments for {name}.
# Correct the channels (inputs, names, sensitivities from the calibration sheets) and the runs; docs/session.md lists all entries.
"""


def draft_plan(one: Connected, kind: str) -> str:
    """The text of a plan.

    Parameters
    ----------
    one
        What is connected.
    kind
        The kind of instrument that it is.

    Raises
    ------
    PlanError
        There is no such kind, or it is not connected in this way.
    """
    if kind not in kinds():
        raise PlanError(f"there is no kind of instrument {kind!r}; there are {', '.join(kinds())}")
    about = kinds()[kind]
    example = tomllib.loads(f"[instrument]\n{about.example}")
    instrument, channels = example["instrument"], example["channels"]
    instrument.update(one.settings)
    plays = isinstance(about, StreamKind) and about.plays
    if one.settings.get("inputs") and "output" not in one.settings:
        instrument = {key: value for key, value in instrument.items() if key not in OUTPUT}
        plays = False
    if "inputs" in one.settings:
        last = len(one.settings["inputs"]) - 1
        channels = dict(list(channels.items())[: last + 1])
        channels = {name: channel | {"input": min(channel["input"], last)} for name, channel in channels.items()}
    shows = instrument.pop("shows", [])
    tables = [_table("instrument", {"kind": kind, "port": one.port, **instrument})]
    tables += [_table("instrument.shows", shown, many=True) for shown in shows]
    tables += [_table(f"channels.{name}", channel) for name, channel in channels.items()]
    tables.append(_table("runs", {**RUN, **(PLAYED if plays else OTHER)}, many=True))
    text = HEAD.format(name=one.name or one.port) + "\n" + "\n".join(tables)
    check_plan(plan_of(tomllib.loads(text)), "the proposed plan")
    return text


def _table(name: str, values: Mapping[str, Any], *, many: bool = False) -> str:
    head = f"[[{name}]]" if many else f"[{name}]"
    return "\n".join([head, *(f"{key} = {_value(value)}" for key, value in values.items())]) + "\n"


def _value(value: Any) -> str:
    # TOML writes text, numbers and lists as JSON does; only tables differ.
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {_value(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list) and value and isinstance(value[0], Mapping):
        return "[\n" + "".join(f"    {_value(each)},\n" for each in value) + "]"
    return json.dumps(value, ensure_ascii=False)
