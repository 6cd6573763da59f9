"""A parameter table as files for other programs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from isorig.analysis.campaign import Campaign
from isorig.rig.errors import PlanError
from isorig.rig.files.inputs import content_of
from isorig.rig.files.output import csv_text, write_json, write_text
from isorig.rig.files.rigfile import GivenRig, write_model

if TYPE_CHECKING:
    from isorig.analysis.parameters.joint_fit import Characterization

#: Bodies with a separate evaluation of their peak.
READ_OFF = ("table", "heatblock", "motor")
COLUMNS = ("value", "std", "unit", "method", "note")


def characterize_campaign(campaign: Campaign, tell: Callable[[str], None], given: GivenRig | None = None) -> Characterization:
    """The parameter table of a recording: of its own rig, or of a given model whose fitted parameters are fitted again. Raises
    RecordingError if the recording lacks what the rig needs."""
    # Imported here: whoever reads a table needs no fit.
    from isorig.analysis.parameters.joint_fit import characterize
    from isorig.rig.model.baseline import baseline_model, recorded_in
    from isorig.rig.model.prediction import seconds_from

    if given is None:
        return characterize(campaign, baseline_model(campaign), progress=tell)
    first = campaign.runs[0]
    later = seconds_from(campaign, first, given.origin) - campaign.seconds_since_start(first)
    return characterize(campaign, recorded_in(given.model, campaign), fitted=given.fitted, later=later, progress=tell)


def write_characterization(
    folder: Path, campaign: Campaign, found: Characterization, further: Mapping[str, Any] | None = None
) -> Path:
    """Write parameters.json, the same table as CSV, and the fitted model; returns the path of the first.

    `further` is added to parameters.json as further keys.
    """
    table = {name: msgspec.to_builtins(entry) for name, entry in found.table.items()}
    rows = ((name, *(row[key] for key in COLUMNS)) for name, row in table.items())
    write_text(folder / "parameters.csv", csv_text(("name", *COLUMNS), rows))
    drive: dict[str, Any] = {"levels": drive_levels(campaign, found.fit.model.drive.channel)}
    if found.head_mass is not None:
        drive["head_mass"] = found.head_mass
    origin = campaign.started
    write_model(folder / "model.json", found.fit.model, origin=origin, fitted=found.fit.free)
    content = {
        "format": "rig-parameters", "format_version": 1, "campaign": Path(campaign.source).name,
        "measured": origin.isoformat() if origin is not None else None, "parameters": table,
        "rig": found.fit.model.name, "drive": drive, "calibration_stated": found.calibrated, "noise": found.noise,
        "faults": [fault.text for fault in found.faults], "doubts": [doubt.text for doubt in found.doubts], **(further or {}),
    }  # fmt: skip
    return write_json(folder / "parameters.json", content)


#: Number of segments of a record used to estimate the variation of its drive level.
SEGMENTS = 16
Pair = tuple[float, float]


class Level(msgspec.Struct, frozen=True, kw_only=True):
    """The measured drive: rms of noise and similar signals, peak of moves, with its standard deviation between segments."""

    gain: float
    excitation: str
    value: float
    std: float
    unit: str = "m/s^2"
    measure: str = "rms"


@dataclass(frozen=True, kw_only=True)
class ReadOff:
    """Natural frequency and damping ratio of a body from one peak, (value, std) each; half-power, or why not."""

    frequency: Pair
    damping: Pair
    half_power: bool
    refused: str = ""


@dataclass(frozen=True, kw_only=True)
class ParameterFile:
    """A parameter table on disk."""

    #: The campaign, and its date.
    campaign: str
    measured: datetime | None
    values: Mapping[str, Pair]  #: (value, std) by name for available values; includes the head's mass if the table has it.
    read_off: Mapping[str, ReadOff] = field(default_factory=dict)  #: The values from single peaks, by body.
    #: (value, std) of the table's mass and damping at the minimum of the error surface; None if there is none.
    surface: tuple[Pair, Pair] | None = None
    levels: tuple[Level, ...] = ()  #: The drive levels by gain and excitation.


def drive_levels(campaign: Campaign, channel: str) -> tuple[Level, ...]:
    """The recorded drive level by gain and excitation; its uncertainty from segments of each run."""
    found: dict[tuple[float, str], list[tuple[float, float]]] = {}
    for run in campaign.runs:
        values = run.read(channel) - float(np.mean(run.read(channel)))
        peaks = run.excitation == "moves"
        parts = [float(np.abs(p).max() if peaks else p.std()) for p in np.array_split(values, SEGMENTS) if len(p)]
        size = float(np.median(parts) if peaks else values.std())
        found.setdefault((run.gain, run.excitation), []).append((size, float(np.std(parts)) / np.sqrt(len(parts))))
    unit = next((run.channels[channel].unit for run in campaign.runs), "m/s^2")
    return tuple(
        Level(
            gain=gain, excitation=kind, value=float(np.mean([v for v, _ in sizes])), unit=unit,
            std=float(np.sqrt(np.mean([d**2 for _, d in sizes]) / len(sizes))), measure="peak" if kind == "moves" else "rms",
        )
        for (gain, kind), sizes in sorted(found.items())
    )  # fmt: skip


def read_parameters(path: Path) -> ParameterFile:
    """Read a parameters.json. Raises PlanError if the file is not a parameter table."""
    try:
        content = msgspec.json.decode(content_of(path))
        rows = dict(content["parameters"]) if content["format"] == "rig-parameters" else {}
        drive = content.get("drive") or {}
        if "head_mass" in drive:
            rows["head_mass"] = drive["head_mass"]
        values = {name: pair for name, row in rows.items() if (pair := _pair(row)) is not None}
        if not values:
            raise ValueError
        began, read = content.get("measured"), content.get("set_ups") or {}
        surface = read.get("error_surface")
        return ParameterFile(
            campaign=str(content.get("campaign", path.parent.name)), values=values,
            measured=None if began is None else datetime.fromisoformat(began),
            read_off={name: found for name in READ_OFF if (found := _read_off(read.get(name))) is not None},
            surface=None if surface is None else _surface(surface),
            levels=msgspec.convert(drive.get("levels", ()), tuple[Level, ...]),
        )  # fmt: skip
    except OSError as error:
        raise PlanError(f"{path} cannot be read ({error.strerror}); give the parameters.json of rig characterize") from None
    except (msgspec.MsgspecError, AttributeError, KeyError, TypeError, ValueError, RecursionError):
        raise PlanError(f"{path} is not a parameter table; give the parameters.json of rig characterize") from None


def _pair(row: Mapping[str, Any]) -> Pair | None:
    return None if row["value"] is None else (float(row["value"]), float(row.get("std") or 0.0))


def _read_off(row: Mapping[str, Any] | None) -> ReadOff | None:
    if row is None:
        return None
    half = row["half_power"]
    for source, refused in ((half, ""), (row, str(half.get("refused", "")))):
        frequency, damping = _pair(source["frequency_hz"]), _pair(source["damping"])
        if frequency is not None and damping is not None:
            return ReadOff(frequency=frequency, damping=damping, half_power=source is half, refused=refused)
    return None


def _surface(row: Mapping[str, Any]) -> tuple[Pair, Pair] | None:
    mass, damping = _pair(row["table_mass"]), _pair(row["table_damping"])
    return None if mass is None or damping is None else (mass, damping)
