"""Models on disk: fitted rigs as JSON."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import msgspec

from isorig.analysis.errors import ModelError
from isorig.analysis.model.rig_model import RigModel, from_tree, to_tree
from isorig.rig.errors import PlanError
from isorig.rig.files.inputs import content_of
from isorig.rig.files.output import write_json


def write_model(path: str | Path, model: RigModel, *, origin: datetime | None = None) -> Path:
    """Write a model atomically; `origin` is the time of the campaign's first sample, the zero of a drifting model."""
    content = {"format": "rig-model", "format_version": 1, "model": to_tree(model)}
    return write_json(path, content | ({"origin": origin.isoformat()} if origin is not None else {}))


def read_model(path: str | Path) -> tuple[RigModel, datetime | None]:
    """The model in a JSON file, and the time of its zero.

    Raises
    ------
    PlanError
        The file is not a model.
    """
    path = Path(path)
    try:
        content = msgspec.json.decode(content_of(path))
    except OSError as error:
        raise PlanError(f"{path} cannot be read ({error.strerror}); give the path of a model.json") from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise PlanError(f"{path} is not JSON ({error}); give a model.json that rig diagnose wrote") from None
    if not isinstance(content, dict) or content.get("format") != "rig-model":
        raise PlanError(f"{path} is not a rig-model; give a model.json that rig diagnose wrote")
    try:
        origin = datetime.fromisoformat(content["origin"]) if "origin" in content else None
        return from_tree(content.get("model", {})), origin
    except (ModelError, TypeError, ValueError) as error:
        raise PlanError(f"{path}: {error}") from None
