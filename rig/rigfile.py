"""A rig as a user names it: a built-in one, a description in TOML, or a fitted model in JSON."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from analysis.errors import ModelError
from analysis.model import RigModel, from_tree
from analysis.rigs import BUILT_IN
from rig.errors import PlanError
from rig.models import read_model


@dataclass(frozen=True, kw_only=True)
class GivenRig:
    """A rig with where it came from.

    Parameters
    ----------
    model
        The rig.
    origin
        The time that a drifting model counts from; None where it does not say.
    description
        The text in TOML, where it was given so.
    """

    model: RigModel
    origin: datetime | None = None
    description: str | None = None


def read_rig(given: str | Path) -> GivenRig:
    """The rig of that name or in that file.

    Parameters
    ----------
    given
        One of `analysis.rigs.BUILT_IN`, or the path of a .toml description or of a model.json.

    Raises
    ------
    PlanError
        In one sentence: the key, what stands there, what may.
    """
    if str(given) in BUILT_IN:
        return GivenRig(model=BUILT_IN[str(given)]())
    path = Path(given)
    if path.suffix.lower() != ".toml":
        if path.suffix.lower() != ".json" and not path.exists():
            raise PlanError(
                f"{path} is no rig: built in are {', '.join(BUILT_IN)}; name one of these, a .toml description or a model.json"
            )
        model, origin = read_model(path)
        return GivenRig(model=model, origin=origin)
    model, text = read_description(path)
    return GivenRig(model=model, description=text)


def read_description(path: Path) -> tuple[RigModel, str]:
    """A rig and its text from the TOML file that describes it.

    Raises
    ------
    PlanError
        In one sentence: which key, what was found, what is allowed.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise PlanError(f"{path} cannot be read ({error}); give the file of a rig's description") from None
    try:
        return from_tree(tomllib.loads(text)), text
    except tomllib.TOMLDecodeError as error:
        raise PlanError(f"{path} is not TOML ({error}); correct that line") from None
    except ModelError as error:
        raise PlanError(f"{path}: {error}") from None
    except RecursionError:
        raise PlanError(f"{path} is nested too deep; write the rig's parts as flat tables") from None
