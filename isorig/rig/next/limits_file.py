"""Limits of a rig: from its description, the plan and a separate file; if several give the same limit, the tightest applies."""

from __future__ import annotations

from pathlib import Path

import msgspec

from isorig.analysis.errors import ModelError
from isorig.analysis.model.limits import Limits
from isorig.analysis.model.rig_model import RigModel
from isorig.rig.acquire.plan import Plan
from isorig.rig.errors import PlanError
from isorig.rig.files.tomlfile import read_toml


def read_limits(path: Path) -> Limits:
    """Read a file of limits, at its top or in a table [limits]. Raises PlanError, a sentence with the key and what is allowed, if
    it is invalid."""
    return read_toml(path, lambda tree: msgspec.convert(tree.get("limits", tree), Limits, strict=False), "a file of limits")


def limits_of(model: RigModel, plan: Plan | None, file: Path | None) -> Limits:
    """All given limits of a rig. Raises PlanError if two limits exclude each other, or one is for a link or channel that the rig
    does not have."""
    try:
        return model.limits_within(*([] if plan is None else [plan.limits]), *([] if file is None else [read_limits(file)]))
    except ModelError as error:
        raise PlanError(str(error)) from None
