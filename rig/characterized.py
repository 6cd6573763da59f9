"""A parameter table as the files that other programs read."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import msgspec

from analysis.characterize import Characterization, characterize
from analysis.measured import Campaign
from rig.baseline import baseline_model
from rig.errors import PlanError, RecordingError
from rig.models import write_model
from rig.output import write_json, write_text

COLUMNS = ("value", "std", "unit", "method", "note")


def characterize_campaign(campaign: Campaign, tell: Callable[[str], None]) -> Characterization:
    """The parameter table of a recording of the wire bonder.

    Raises
    ------
    RecordingError
        Where the recording is of another rig, or lacks what the rig needs.
    """
    if campaign.description is not None:
        raise RecordingError(f"{campaign.source} is of another rig; the parameter table knows the wire bonder, use rig diagnose")
    return characterize(campaign, baseline_model(campaign), progress=tell)


def write_characterization(
    folder: Path, campaign: Campaign, found: Characterization, beside: Mapping[str, Any] | None = None
) -> Path:
    """Write parameters.json, the same table as CSV, and the fitted model; the path of the first.

    `beside` goes into parameters.json as further keys.
    """
    table = {name: msgspec.to_builtins(entry) for name, entry in found.table.items()}
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(("name", *COLUMNS))
    rows.writerows((name, *("" if row[key] is None else row[key] for key in COLUMNS)) for name, row in table.items())
    write_text(folder / "parameters.csv", text.getvalue())
    origin = min((run.started for run in campaign.runs if run.started is not None), default=None)
    write_model(folder / "model.json", found.fit.model, origin=origin)
    content = {
        "format": "rig-parameters", "format_version": 1, "campaign": Path(campaign.source).name,
        "measured": origin.isoformat() if origin is not None else None, "parameters": table,
        "faults": [fault.text for fault in found.faults], **(beside or {}),
    }  # fmt: skip
    return write_json(folder / "parameters.json", content)


@dataclass(frozen=True, kw_only=True)
class ParameterFile:
    """A parameter table on disk: of which campaign, measured when, and (value, std) by name where there is a value."""

    campaign: str
    measured: datetime | None
    values: Mapping[str, tuple[float, float]]


def read_parameters(path: Path) -> ParameterFile:
    """Read a parameters.json.

    Raises
    ------
    PlanError
        Where the file is not a parameter table.
    """
    try:
        content = msgspec.json.decode(path.read_bytes())
        rows = content["parameters"].items() if content["format"] == "rig-parameters" else ()
        values = {name: (float(row["value"]), float(row.get("std") or 0.0)) for name, row in rows if row["value"] is not None}
        if not values:
            raise ValueError
        began = content.get("measured")
        return ParameterFile(
            campaign=str(content.get("campaign", path.parent.name)), values=values,
            measured=None if began is None else datetime.fromisoformat(began),
        )  # fmt: skip
    except OSError as error:
        raise PlanError(f"{path} cannot be read ({error.strerror}); give the parameters.json of rig characterize") from None
    except (msgspec.DecodeError, AttributeError, KeyError, TypeError, ValueError):
        raise PlanError(f"{path} is not a parameter table; give the parameters.json of rig characterize") from None
