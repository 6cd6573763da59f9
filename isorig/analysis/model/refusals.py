"""Sentences about an invalid description, plan or mapping: the key, the value found, and what is allowed."""

import re
from collections.abc import Mapping, Sequence
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

import msgspec

from isorig.analysis.wording import did_you_mean

#: The decoder's names of types: what to write, and the Python type.
KINDS: dict[str, tuple[str, type]] = {
    "float": ("a number", float), "int": ("a whole number", int), "str": ("a text in quotes", str),
    "bool": ("true or false", bool), "object": ("a table of keys", dict), "array": ("a list", list),
    "null": ("nothing", type(None)),
}  # fmt: skip


def explained(text: str, tree: Mapping[str, Any], kind: Any, whole: str) -> str:
    """One sentence from a decoder's message about plain dicts and lists: the key, the value found, and what is allowed.

    They were to become an object of a `kind`; `whole` names them where the message is about none of their keys.
    """
    text, _, path = text.partition(" - at `")
    steps = re.findall(r"[^.\[\]]+|(?<=\[)\.\.\.(?=\])", path.rstrip("`").removeprefix("$"))
    wrong = re.match(r"Expected `(.*?)`, got `(.*)`", text)
    way, node = _followed(tree, steps, KINDS[wrong[2]][1] if wrong and wrong[2] in KINDS else None)
    called = _called(node)
    where = ".".join(way) or (whole if called is None else f"{whole} {called!r}")
    if unknown := re.match(r"Object contains unknown field `(.*)`", text):
        name, given = unknown[1], node[unknown[1]] if isinstance(node, Mapping) and unknown[1] in node else {}
        value = "" if isinstance(given, Mapping | list) else f" = {given!r}"
        keys = [key for part in _kinds(kind, steps) for key in getattr(part, "__struct_fields__", ())]
        return f"{where} has the key {name!r}{value}, which is unknown there{did_you_mean(name, keys)}; remove it or correct it"
    if missing := re.match(r"Object missing required field `(.*)`", text):
        return f"{where} lacks the key {missing[1]!r}; add it"
    if wrong and wrong.groups() == ("array", "object") and len(way) == 1:
        return f"{where} is a single table, but there may be several: write its head as [[{where}]]"
    if wrong:
        wanted = " or ".join(KINDS[each][0] if each in KINDS else each for each in wrong[1].split(" | "))
        shown = "a table" if isinstance(node, Mapping) else repr(node)
        return f"{where} is {shown}, but must be {wanted}; correct it"
    if text.startswith("Invalid ") and (allowed := [word for each in _kinds(kind, steps) for word in _words(each)]):
        return f"{where} is {node!r}{did_you_mean(str(node), allowed)}; allowed are {', '.join(allowed)}"
    return text if text.startswith(where) or not (way or called) else f"{where}: {text}"


def _called(part: Any) -> str | None:
    # The name of a part, as in the paths of parameters.
    names = [part.get(key) for key in ("name", "channel", "id")] if isinstance(part, Mapping) else []
    return next((name for name in names if isinstance(name, str)), None)


def _followed(tree: Any, steps: Sequence[str], kind: type | None) -> tuple[list[str], Any]:
    # The decoder gives the index in a list, but for a table with arbitrary keys only that it is one of them: use the first of
    # that type.
    if not steps:
        return [], tree
    step, rest = steps[0], steps[1:]
    if isinstance(tree, Mapping) and step in tree:
        choice = [(step, tree[step])]
    elif isinstance(tree, list) and step.isdigit() and int(step) < len(tree):
        part = tree[int(step)]
        choice = [(_called(part) or step, part)]
    elif isinstance(tree, Mapping) and step == "...":
        choice = [(str(key), value) for key, value in tree.items()]
    else:
        return [], tree
    found = [([key, *way], node) for key, value in choice for way, node in [_followed(value, rest, kind)]]
    return next((item for item in found if kind is None or isinstance(item[1], kind)), found[0])


def _kinds(kind: Any, steps: Sequence[str]) -> list[Any]:
    # The types that are allowed at a place of a type; of a key that names the type of its table, these names.
    if get_origin(kind) in (Union, UnionType):
        return [found for part in get_args(kind) for found in _kinds(part, steps)]
    if not steps:
        return [kind]
    if not hasattr(kind, "__struct_fields__"):
        return [found for part in get_args(kind) for found in _kinds(part, steps[1:])]
    about = kind.__struct_config__
    if about.tag is not None and list(steps) == [about.tag_field]:
        return [about.tag]
    fields = (field for field in msgspec.structs.fields(kind) if field.name == steps[0])
    return [found for field in fields for found in _kinds(field.type, steps[1:])]


def _words(kind: Any) -> list[str]:
    return [word for word in (get_args(kind) if get_origin(kind) is Literal else [kind]) if isinstance(word, str)]
