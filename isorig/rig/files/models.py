"""Models on disk: fitted rigs as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from isorig.analysis.errors import ModelError
from isorig.analysis.model.rig_model import RigModel, from_tree, to_tree
from isorig.rig.errors import PlanError
from isorig.rig.files.inputs import content_of
from isorig.rig.files.output import write_json

if TYPE_CHECKING:
    from isorig.analysis.fitting.solve import Free


def write_model(path: str | Path, model: RigModel, *, origin: datetime | None = None, fitted: Sequence[Free] = ()) -> Path:
    """Write a model atomically.

    `origin` is the time of the campaign's first sample, the zero of a drifting model; `fitted` are the parameters that were
    fitted, if they are more than those that the model marks as free.
    """
    content = {"format": "rig-model", "format_version": 1, "model": to_tree(model)}
    content |= {"fitted": [free_tree(each) for each in fitted]} if fitted else {}
    return write_json(path, content | ({"origin": origin.isoformat()} if origin is not None else {}))


def free_tree(free: Free) -> dict[str, Any]:
    """A fitted parameter as stored in JSON, which has no infinity: an infinite bound is omitted."""
    tree: dict[str, Any] = msgspec.to_builtins(free)
    return {key: value for key, value in tree.items() if value not in (np.inf, -np.inf)} | (
        {"unbounded_below": True} if free.low == -np.inf else {}
    )


def free_of(tree: Mapping[str, Any]) -> Free:
    """The fitted parameter that `free_tree` stored."""
    from isorig.analysis.fitting.solve import Free

    return msgspec.convert({**tree, "low": -np.inf} if tree.get("unbounded_below") else tree, Free)


def read_model(path: str | Path) -> tuple[RigModel, datetime | None, tuple[Free, ...]]:
    """The model in a JSON file, the time of its zero, and its fitted parameters; none if the file does not list them. Raises
    PlanError if the file is not a model."""
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
        model, fitted = from_tree(content.get("model", {})), tuple(free_of(each) for each in content.get("fitted", ()))
        for free in fitted:
            model.get(free.path)
        return model, origin, fitted
    except (ModelError, msgspec.ValidationError, AttributeError, TypeError, ValueError) as error:
        raise PlanError(f"{path}: {error}") from None
