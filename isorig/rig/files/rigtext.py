"""Text of a rig's description in TOML."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from isorig.analysis.model.rig_model import RigModel

#: Lists with one entry per line.
LISTS = ("bodies", "links", "contacts", "more_drives", "sensors")
#: Tables with their own heading, at the end of the file.
HEADED = ("configurations", "limits", "usual")


def description_text(model: RigModel, notes: Mapping[str, str] | None = None) -> str:
    """The description of a rig, formatted for reading and editing; fields with their default value are omitted.

    Parameters
    ----------
    model
        The rig.
    notes
        Comments above keys of the top level, by key; the comment under "" is at the start of the file.
    """
    tree, said = plain(model), notes or {}
    lines = _comment(said.get("", ""))
    for key in ("name", "note", "free_free"):
        if key in tree:
            lines.append(f"{key} = {_value(tree[key])}")
    for key in ("free", *LISTS):
        if tree.get(key):
            lines += ["", *_comment(said.get(key, "")), f"{key} = ["]
            lines += [*(f"  {_value(part)}," for part in tree[key]), "]"]
        if key == "contacts":
            lines += ["", *_comment(said.get("drive", "")), f"drive = {_value(tree['drive'])}"]
    for name, setup in tree.get("configurations", {}).items():
        lines += ["", f"[configurations.{_key(name)}]", *(f"{_key(key)} = {_value(value)}" for key, value in setup.items())]
    for key in HEADED[1:]:
        if key in tree:
            lines += ["", *_comment(said.get(key, "")), f"[{key}]"]
            lines += [f"{_key(name)} = {_value(value)}" for name, value in tree[key].items()]
    return "\n".join(lines) + "\n"


def plain(part: msgspec.Struct) -> dict[str, Any]:
    """A part as plain values, without keys that have their default; the first key of a law is its name."""
    kind = part.__struct_config__
    found: dict[str, Any] = {} if kind.tag is None else {str(kind.tag_field): kind.tag}
    for field in msgspec.structs.fields(type(part)):
        value = getattr(part, field.name)
        default = field.default_factory() if field.default_factory is not msgspec.NODEFAULT else field.default
        if default is msgspec.NODEFAULT or value != default:
            found[field.name] = _plain(value)
    return found


def _plain(value: Any) -> Any:
    if isinstance(value, msgspec.Struct):
        return plain(value)
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return value


def _comment(text: str) -> list[str]:
    return [f"# {line}".rstrip() for line in text.splitlines()]


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _value(name)


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(key)} = {_value(item)}" for key, item in value.items()) + " }" if value else "{}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(map(_value, value)) + "]"
    # Strings, integers and booleans are written alike in JSON and TOML.
    return msgspec.json.encode(value).decode() if not isinstance(value, float) else repr(value)
