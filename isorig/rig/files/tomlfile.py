"""TOML files written by people, read with one-sentence error messages."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from isorig.analysis.wording import did_you_mean
from isorig.rig.errors import PlanError
from isorig.rig.files.inputs import TOML_MOST, content_of

T = TypeVar("T")


def read_toml(
    path: Path, convert: Callable[[Mapping[str, Any]], T], what: str, *, hint: str = "", keys: Iterable[str] = ()
) -> T:  # fmt: skip
    """Read a file and convert its keys.

    Parameters
    ----------
    path
        The file; a leading byte order mark is skipped.
    convert
        Converts plain dicts and lists, by `msgspec.convert`.
    what
        Noun with its article, for messages.
    hint
        Additional advice if there is no such file, appended to the sentence.
    keys
        All keys that such a file may have, to propose the one that was meant.

    Raises
    ------
    PlanError
        In one sentence: which key, what was found, what is allowed.
    """
    try:
        return convert(tomllib.loads(content_of(path, TOML_MOST).decode("utf-8-sig")))
    except FileNotFoundError:
        raise PlanError(f"{path} does not exist; give the path of {what}{hint}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise PlanError(
            f"{path} cannot be read as text ({getattr(error, 'strerror', None) or error}); give {what} in TOML"
        ) from None
    except tomllib.TOMLDecodeError as error:
        raise PlanError(f"{path} is not TOML ({error}); correct that line") from None
    except RecursionError:
        raise PlanError(f"{path} is nested too deeply; write {what} with flat tables") from None
    except msgspec.ValidationError as error:
        raise PlanError(f"{path}: {_explained(str(error), keys)}; correct that key") from None


def _explained(text: str, keys: Iterable[str]) -> str:
    text = text.replace("`", "")
    unknown = re.match(r"Object contains unknown field (\S+)", text)
    if unknown is None:
        return text
    place = re.search(r" - at (\S+)", text)
    where = place[1].removeprefix("$.") if place else "the file"
    return f"{where} has the key {unknown[1]!r}, which is unknown there{did_you_mean(unknown[1], keys)}"
