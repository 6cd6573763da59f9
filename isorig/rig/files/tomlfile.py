"""TOML files: read with one-sentence error messages, and written for reading and editing."""

import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from isorig.analysis.model.refusals import explained
from isorig.rig.errors import PlanError
from isorig.rig.files.inputs import TOML_MOST, content_of

T = TypeVar("T")


def read_toml(path: Path, kind: type[T], what: str, *, hint: str = "", prepared: Callable[[dict[str, Any]], Any] = dict) -> T:
    """Read a file as an object of a `kind`; a leading byte order mark is skipped.

    `what` is a noun with its article, for messages; `hint` is appended to the sentence if there is no such file. The object is
    made from the file's plain dicts and lists, `prepared` before. Raises PlanError, in one sentence: which key, what was found,
    what is allowed.
    """
    text, tree = "", {}
    try:
        text = content_of(path, TOML_MOST).decode("utf-8-sig")
        tree = prepared(tomllib.loads(text))
        return msgspec.convert(tree, kind, strict=False)
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
        raise PlanError(f"{path}: {explained(str(error), tree, kind, 'the file')}") from None


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
