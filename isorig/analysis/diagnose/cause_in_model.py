"""A model without one of its causes, or with another one in place of it."""

from collections.abc import Collection, Sequence
from contextlib import suppress
from typing import Any

from isorig.analysis.diagnose.causes import same_form
from isorig.analysis.diagnose.causes.base import Evidence
from isorig.analysis.errors import ModelError
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.ladder import Start
from isorig.analysis.fitting.solve import Fit, Free
from isorig.analysis.model.rig_model import RigModel, from_tree, to_tree


class _BuiltOnError(Exception):
    # A later cause builds on the one that is to be removed.
    pass


def without_cause(before: Fit, after: Fit, last: Fit) -> tuple[RigModel, tuple[Free, ...]] | None:
    """The last model without the cause of the step between two fits, and its fitted parameters.

    None if later causes build on that one. The values that the last model shares with the fit before the step are its own.
    """
    of_step, of_last = ({free.path for free in fit.free} for fit in (after, last))
    base = [free for free in before.free if free.path in of_last or free.path not in of_step]
    free = (*base, *(free for free in last.free if free.path not in of_step))
    kept = {item.path for item in free} & of_last
    try:
        one, other, now = (_by_name(to_tree(fit.model) | {"free": []}) for fit in (before, after, last))
        tree = _merged(one, other, now, kept, "")
        model = from_tree(_listed(tree) | {"free": [item.path for item in free]})
        for path in model.free:
            model.get(path)
    except (_BuiltOnError, ModelError):
        return None
    return model, free


def with_cause(
    model: RigModel, free: Sequence[Free], candidate: Candidate, fitted: Fit, evidence: Evidence
) -> list[Start]:  # fmt: skip
    """Starting points of a model with the cause of a candidate that was fitted to another one; none if it cannot have it.

    The cause has the values of that fit. Its law may have another place in the list of a link's laws.
    """
    found: list[Start] = []
    seen: set[bytes] = set()
    for form in same_form(candidate, model, evidence):
        values = {own.path: fitted.model.get(old.path) for own, old in zip(form.free, candidate.free, strict=True)}
        for start in form.starts:
            with suppress(ModelError):
                begun = start.replace(values)
                if begun.encoded not in seen:
                    seen.add(begun.encoded)
                    found.append((form, form.parameters(model, free), begun))
    return found


def _by_name(item: Any) -> Any:
    # The tree with parts by their names in place of lists of parts.
    if isinstance(item, dict):
        return {key: _by_name(value) for key, value in item.items()}
    names = [_name(part) for part in item] if isinstance(item, list) else []
    return {name: _by_name(part) for name, part in zip(names, item, strict=True)} if names and all(names) else item


def _name(part: Any) -> str:
    return str(part.get("name", part.get("channel", ""))) if isinstance(part, dict) else ""


def _law(part: dict[str, Any]) -> str:
    # The name of a law; empty for a part that has one.
    name = part.get("law", "")
    return name if isinstance(name, str) else ""


def _listed(tree: dict[str, Any]) -> dict[str, Any]:
    parts = ("bodies", "links", "contacts", "sensors", "more_drives")
    return tree | {key: list(tree[key].values()) for key in parts if isinstance(tree.get(key), dict)}


def _merged(before: Any, after: Any, last: Any, kept: Collection[str], path: str) -> Any:
    # What the step changed as it was before, everything else as it is at last.
    if before == after:
        return last
    if isinstance(before, dict) and isinstance(after, dict) and isinstance(last, dict):
        if _law(before) != _law(after):
            return before if _law(last) == _law(after) else last
        found = {
            key: _merged(before[key], after[key], value, kept, f"{path}{key}.") if key in before else value
            for key, value in last.items()
            if key not in after or key in before
        }
        return found | {key: value for key, value in before.items() if key not in after and key not in last}
    if isinstance(before, list) and isinstance(after, list) and isinstance(last, list):
        if len(last) != len(after):
            raise _BuiltOnError  # the places of the laws after it would change
        both = zip(before, after, last, strict=False)
        return [*(_merged(*parts, kept, f"{path}{k}.") for k, parts in enumerate(both)), *before[len(after) :]]
    return last if path[:-1] in kept else before
