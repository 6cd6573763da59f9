"""A rig as a file: a description in TOML or a fitted model in JSON, read and written; and a rig as given by a user."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from isorig.analysis.campaign import Campaign
from isorig.analysis.errors import ModelError
from isorig.analysis.given import given_path
from isorig.analysis.model.rig_model import RigModel, from_tree, to_tree
from isorig.analysis.wording import did_you_mean
from isorig.rig.errors import PlanError
from isorig.rig.files.inputs import TOML_MOST, content_of
from isorig.rig.files.output import write_json
from isorig.rig.files.tomlfile import comments, key_text, plain, table_text, value_text
from isorig.rig.model.baseline import with_sensors
from isorig.rig.wire_bonder.description import BUILT_IN, wire_bonder

if TYPE_CHECKING:
    from isorig.analysis.fitting.solve import Free

#: The worked descriptions that come with the package, by the names that commands take.
SHIPPED = {path.stem: path for path in sorted((Path(__file__).resolve().parents[1] / "descriptions").glob("*.toml"))}

#: Lists with one entry per line.
LISTS = ("bodies", "links", "contacts", "more_drives", "sensors")
#: Tables after the configurations, at the end of the file.
HEADED = ("limits", "usual")


@dataclass(frozen=True, kw_only=True)
class GivenRig:
    """A rig and its source."""

    model: RigModel
    origin: datetime | None = None  #: The time of a drifting model's zero; None if it is not given.
    description: str | None = None  #: The text in TOML, if it was given in this form.
    fitted: tuple[Free, ...] = ()  #: The fitted parameters of a model.json that lists them.


def read_rig(given: str | Path) -> GivenRig:
    """The rig with that name or in that file.

    Parameters
    ----------
    given
        One of `isorig.rig.wire_bonder.description.BUILT_IN` or of `SHIPPED`, or the path of a .toml description or of a
        model.json.

    Raises
    ------
    PlanError
        In one sentence: the key, the value found, the allowed values.

    Examples
    --------
    >>> import isorig as iso
    >>> [body.name for body in iso.read_rig("wire-bonder").model.bodies]
    ['table', 'heatblock', 'motor']
    """
    if str(given) in BUILT_IN:
        return GivenRig(model=BUILT_IN[str(given)]())
    path = SHIPPED.get(str(given)) or given_path(given, "the rig")
    if path.suffix.lower() != ".toml":
        if path.suffix.lower() != ".json":
            names = tuple(dict.fromkeys((*BUILT_IN, *SHIPPED)))
            raise PlanError(
                f"{path} is not a rig{did_you_mean(str(given), names)}; give a description in .toml, a model.json that rig "
                f"diagnose wrote, or one of {', '.join(names)}"
            )
        model, origin, fitted = read_model(path)
        return GivenRig(model=with_sensors(model, str(path)), origin=origin, fitted=fitted)
    model, text = read_description(path)
    return GivenRig(model=model, description=text)


def rig_of(campaign: Campaign) -> RigModel:
    """The rig of a campaign: the one described in it, or the wire bonder. Raises PlanError if the description cannot be used."""
    if campaign.description is None:
        return wire_bonder()
    return _described(campaign.description, "it")


def references_of(campaign: Campaign) -> tuple[str, ...]:
    """The channels that drive: those of the rig's description, or the wire bonder's head. Raises PlanError if the description
    cannot be used."""
    return tuple(drive.channel for drive in rig_of(campaign).drives)


def read_description(path: Path) -> tuple[RigModel, str]:
    """A rig and its description from a TOML file. Raises PlanError, a sentence with the key and what is allowed, if it is
    invalid."""
    try:
        text = content_of(path, TOML_MOST).decode()
    except FileNotFoundError:
        raise PlanError(
            f"{path} does not exist; give the file of a rig's description, or let rig describe --new ask for one"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or error
        raise PlanError(f"{path} cannot be read ({why}); give the file of a rig's description") from None
    return with_sensors(_described(text, str(path)), str(path)), text


def _described(text: str, what: str) -> RigModel:
    try:
        return from_tree(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise PlanError(f"{what} is not TOML ({error}); correct that line") from None
    except ModelError as error:
        raise PlanError(f"{what}: {error}") from None
    except RecursionError:
        raise PlanError(f"{what} is nested too deeply; write the rig's parts as flat tables") from None


def description_text(model: RigModel, notes: Mapping[str, str] | None = None) -> str:
    """The description of a rig, formatted for reading and editing; fields with their default value are omitted.

    `notes` are comments above keys of the top level, by key; the comment under "" is at the start of the file.
    """
    tree, said = plain(model), notes or {}
    lines = comments(said.get("", ""))
    for key in ("name", "note", "free_free"):
        if key in tree:
            lines.append(f"{key} = {value_text(tree[key])}")
    for key in ("free", *LISTS):
        if tree.get(key):
            lines += ["", *comments(said.get(key, "")), f"{key} = ["]
            lines += [*(f"  {value_text(part)}," for part in tree[key]), "]"]
        if key == "contacts":
            lines += ["", *comments(said.get("drive", "")), f"drive = {value_text(tree['drive'])}"]
    for k, (name, setup) in enumerate(tree.get("configurations", {}).items()):
        above = comments(said.get("configurations", "")) if k == 0 else []
        lines += ["", *above, *table_text(f"configurations.{key_text(name)}", setup)[:-1]]
    for key in HEADED:
        if key in tree:
            lines += ["", *comments(said.get(key, "")), *table_text(key, tree[key])[:-1]]
    return "\n".join(lines) + "\n"


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
