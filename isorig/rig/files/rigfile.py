"""A rig as given by a user: a built-in one, a description in TOML, or a fitted model in JSON."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from isorig.analysis.campaign import Campaign
from isorig.analysis.errors import ModelError
from isorig.analysis.given import given_path
from isorig.analysis.model.rig_model import RigModel, from_tree
from isorig.rig.errors import PlanError
from isorig.rig.files.inputs import TOML_MOST, content_of
from isorig.rig.files.models import read_model
from isorig.rig.model.baseline import with_sensors
from isorig.rig.wire_bonder.description import BUILT_IN, wire_bonder

if TYPE_CHECKING:
    from isorig.analysis.fitting.solve import Free

#: The worked descriptions that come with the package, by the names that commands take.
SHIPPED = {path.stem: path for path in sorted((Path(__file__).resolve().parents[1] / "descriptions").glob("*.toml"))}


@dataclass(frozen=True, kw_only=True)
class GivenRig:
    """A rig and its source.

    Parameters
    ----------
    model
        The rig.
    origin
        The time of a drifting model's zero; None if it is not given.
    description
        The text in TOML, if it was given in this form.
    fitted
        The fitted parameters of a model.json that lists them.
    """

    model: RigModel
    origin: datetime | None = None
    description: str | None = None
    fitted: tuple[Free, ...] = ()


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
        if path.suffix.lower() != ".json" and not path.exists():
            raise PlanError(
                f"{path} is not a rig; give {', '.join(dict.fromkeys((*BUILT_IN, *SHIPPED)))}, a .toml "
                "description or a model.json"
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
