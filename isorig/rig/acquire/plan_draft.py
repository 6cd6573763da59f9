"""A first plan for an instrument that is connected: its kind's example with its port and its own settings, and one run."""

import tomllib

from isorig.drivers.kinds import Connected, StreamKind, kinds
from isorig.drivers.voltage import OutputSettings
from isorig.rig.acquire.plan import plan_of
from isorig.rig.acquire.plan_check import check_plan
from isorig.rig.errors import PlanError
from isorig.rig.files.tomlfile import table_text

#: Settings that only an instrument with an output has.
OUTPUT = ("output_full_scale", *OutputSettings.__struct_fields__)
#: The run, and what drives it where the instrument plays no drive.
RUN = {"id": "first", "configuration": "unlocked", "gain": 10.0, "seconds": 10.0}
PLAYED = {"excitation": "random", "band": [0.5, 20.0]}
OTHER = {"excitation": "other"}
HEAD = """# Proposed by rig instruments for {name}.
# Correct the channels (inputs, names, sensitivities from the calibration sheets) and the runs; docs/session.md lists all entries.
"""


def draft_plan(one: Connected, kind: str) -> str:
    """The text of a plan for what is connected, as an instrument of a kind. Raises PlanError if there is no such kind, or it is
    not connected in this way."""
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
    lines = table_text("instrument", {"kind": kind, "port": one.port, **instrument})
    for shown in shows:
        lines += table_text("instrument.shows", shown, many=True)
    for name, channel in channels.items():
        lines += table_text(f"channels.{name}", channel)
    lines += table_text("runs", RUN | (PLAYED if plays else OTHER), many=True)
    text = HEAD.format(name=one.name or one.port) + "\n" + "\n".join(lines)
    check_plan(plan_of(tomllib.loads(text)), "the proposed plan")
    return text
