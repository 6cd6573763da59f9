"""Sentences about an invalid description of a rig: the key, the value found, and what is allowed."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, get_args

from isorig.analysis.campaign import Quantity
from isorig.analysis.excitations import SyntheticExcitation
from isorig.analysis.laws import FrictionLaw, LinkLaw
from isorig.analysis.wording import did_you_mean

#: The decoder's names of types: what to write, and the Python type.
KINDS: dict[str, tuple[str, type]] = {
    "float": ("a number", float), "int": ("a whole number", int), "str": ("a text in quotes", str),
    "bool": ("true or false", bool), "object": ("a table of keys", dict), "array": ("a list", list),
    "null": ("nothing", type(None)),
}  # fmt: skip


def explained(text: str, tree: Mapping[str, Any], keys: Iterable[str] = ()) -> str:
    """One sentence from a decoder's message: the key, the value found, and what is allowed; `keys` are all keys there are."""
    text, _, path = text.partition(" - at `")
    steps = re.findall(r"[^.\[\]]+|(?<=\[)\.\.\.(?=\])", path.rstrip("`").removeprefix("$"))
    wrong = re.match(r"Expected `(.*?)`, got `(.*)`", text)
    way, node = _followed(tree, steps, KINDS[wrong[2]][1] if wrong and wrong[2] in KINDS else None)
    called = node.get("name", node.get("channel")) if isinstance(node, Mapping) else None
    where = ".".join(way) or (f"the rig {called!r}" if isinstance(called, str) else "the rig")
    if unknown := re.match(r"Object contains unknown field `(.*)`", text):
        name = unknown[1]
        value = f" = {node[name]!r}" if isinstance(node, Mapping) and name in node else ""
        meant = did_you_mean(name, keys)
        return f"{where} has the key {name!r}{value}, which is unknown there{meant}; remove it or correct its spelling"
    if missing := re.match(r"Object missing required field `(.*)`", text):
        return f"{where} lacks the key {missing[1]!r}; add it"
    if wrong:
        wanted = " or ".join(KINDS[kind][0] if kind in KINDS else kind for kind in wrong[1].split(" | "))
        shown = "a table" if isinstance(node, Mapping) else repr(node)
        return f"{where} is {shown}, but must be {wanted}; correct it"
    if text.startswith("Invalid "):
        allowed = _allowed(way)
        return f"{where} is {node!r}, which is none of {', '.join(allowed)}; name one of these"
    return f"{where}: {text}"


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
        # As in the paths of parameters: by name if there is one.
        called = part.get("name", part.get("channel")) if isinstance(part, Mapping) else None
        choice = [(called if isinstance(called, str) else step, part)]
    elif isinstance(tree, Mapping) and step == "...":
        choice = [(str(key), value) for key, value in tree.items()]
    else:
        return [], tree
    found = [([key, *way], node) for key, value in choice for way, node in [_followed(value, rest, kind)]]
    return next((item for item in found if kind is None or isinstance(item[1], kind)), found[0])


def _allowed(way: Sequence[str]) -> list[str]:
    kinds = {
        "quantity": list(get_args(Quantity)),
        "shape": ["exponential", "rational"],
        "motion": ["straight", "rotation"],
        "excitation": list(get_args(SyntheticExcitation)),
        "law": [str(kind.__struct_config__.tag) for kind in get_args(FrictionLaw if "contacts" in way else LinkLaw)],
    }
    return kinds.get(way[-1] if way else "", ["the values that are known there"])
