"""TOML files: read with one-sentence error messages, and written for reading and editing."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args, get_origin

import msgspec

from isorig.analysis.model.refusals import KINDS
from isorig.analysis.wording import did_you_mean
from isorig.rig.errors import PlanError
from isorig.rig.files.inputs import TOML_MOST, content_of

T = TypeVar("T")


def read_toml(
    path: Path,
    convert: Callable[[Mapping[str, Any]], T],
    what: str,
    *,
    hint: str = "",
    parts: Collection[type[msgspec.Struct]] = (),
) -> T:
    """Read a file, and convert its plain dicts and lists by `msgspec.convert`; a leading byte order mark is skipped.

    `what` is a noun with its article, for messages; `hint` is appended to the sentence if there is no such file, and `parts` are
    the types of its tables, to propose the key or the word that was meant. Raises PlanError, in one sentence: which key, what was
    found, what is allowed.
    """
    text = ""
    try:
        text = content_of(path, TOML_MOST).decode("utf-8-sig")
        return convert(tomllib.loads(text))
    except FileNotFoundError:
        raise PlanError(f"{path} does not exist; give the path of {what}{hint}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise PlanError(
            f"{path} cannot be read as text ({getattr(error, 'strerror', None) or error}); give {what} in TOML"
        ) from None
    except tomllib.TOMLDecodeError as error:
        raise PlanError(f"{path} is not TOML ({error}); {_line_advice(text, str(error))}") from None
    except RecursionError:
        raise PlanError(f"{path} is nested too deeply; write {what} with flat tables") from None
    except msgspec.ValidationError as error:
        raise PlanError(f"{path}: {_explained(str(error), parts)}; correct that key") from None


def _line_advice(text: str, error: str) -> str:
    # What is probably wrong in the line that the parser could not read.
    at, lines = re.search(r"at line (\d+)", error), text.splitlines()
    line = lines[int(at[1]) - 1] if at and int(at[1]) <= len(lines) else ""
    if re.search(r"=\s*[+-]?\d+,\d", line):
        return "write numbers with a decimal point"
    if "\\" in line:
        return "write / in place of \\ in paths"
    if re.search(r"=\s*[A-Za-z_]", line) and "Invalid value" in error:
        return "write texts in quotes"
    return "correct that line"


def _explained(text: str, parts: Collection[type[msgspec.Struct]]) -> str:
    text = text.replace("`", "")
    fields = {field.name: field.type for part in parts for field in msgspec.structs.fields(part)}
    place = re.search(r" - at \$\.(\S+)", text)
    where = place[1] if place else "the file"
    if unknown := re.match(r"Object contains unknown field (\S+)", text):
        return f"{where} has the key {unknown[1]!r}, which is unknown there{did_you_mean(unknown[1], fields)}"
    if missing := re.match(r"Object missing required field (\S+)", text):
        return f"{where} lacks the key {missing[1]!r}"
    if wrong := re.match(r"Expected (.+), got (\w+)(?: - at|$)", text):
        if wrong.groups() == ("array", "object"):
            return f"{where} is a single table, but there may be several: write its head as [[{where}]]"
        wanted, found = ([KINDS[kind][0] if kind in KINDS else kind for kind in kinds.split(" | ")] for kinds in wrong.groups())
        return f"{where} is {found[0]}, but must be {' or '.join(wanted)}"
    words = _words(fields.get(where.rpartition(".")[2]))
    if words and (wrong := re.match(r"Invalid enum value '(.*)'", text)):
        return f"{where} is {wrong[1]!r}{did_you_mean(wrong[1], words)}; allowed are {', '.join(words)}"
    return text


def _words(kind: Any) -> list[str]:
    # The words that a type allows: those of a Literal, also within a union.
    if get_origin(kind) is Literal:
        return [word for word in get_args(kind) if isinstance(word, str)]
    return [word for part in get_args(kind) for word in _words(part)]


def plain(value: Any) -> Any:
    """Plain values of a part, without keys that have their default; the first key of a law is its name."""
    if isinstance(value, msgspec.Struct):
        kind = value.__struct_config__
        found: dict[str, Any] = {} if kind.tag is None else {str(kind.tag_field): kind.tag}
        for field in msgspec.structs.fields(value):
            item = getattr(value, field.name)
            default = field.default_factory() if field.default_factory is not msgspec.NODEFAULT else field.default
            if item != default:
                found[field.name] = plain(item)
        return found
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, tuple | list) else value


def table_text(name: str, values: Mapping[str, Any], *, many: bool = False) -> list[str]:
    """The lines of a table, one of `many` with that name, with an empty line at the end; a list of tables has a line for each."""
    lines = [f"[[{name}]]" if many else f"[{name}]"]
    for key, value in values.items():
        if isinstance(value, list) and value and isinstance(value[0], Mapping):
            lines += [f"{key_text(key)} = [", *(f"    {value_text(each)}," for each in value), "]"]
        else:
            lines.append(f"{key_text(key)} = {value_text(value)}")
    return [*lines, ""]


def comments(text: str) -> list[str]:
    """The lines of a text as comments."""
    return [f"# {line}".rstrip() for line in text.splitlines()]


def key_text(name: str) -> str:
    """A key, in quotes where it needs them."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else value_text(name)


def value_text(value: Any) -> str:
    """A value in one line."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key_text(key)} = {value_text(item)}" for key, item in value.items()) + " }" if value else "{}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(map(value_text, value)) + "]"
    if isinstance(value, float):
        return repr(value)
    # Strings, integers and booleans are written alike in JSON and TOML, but for one character.
    return msgspec.json.encode(value).decode().replace("\x7f", "\\u007f")
