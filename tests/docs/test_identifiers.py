"""Names in the code: a public class of one name is one thing, and names consist of plain words."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator

from sources import sources

#: Rooms whose class names nothing else in the package has. A cause may have the name of its law: it is that law at a place.
ROOMS = (
    "analysis/diagnose/causes", "analysis/proposals", "analysis/trends", "drivers", "rig/acquire", "rig/commands", "rig/describe",
    "rig/design", "rig/diagnose", "rig/exchange", "rig/files", "rig/fleet", "rig/frf", "rig/isolation", "rig/next",
    "rig/notebook", "rig/report", "rig/view", "rig/virtual", "rig/wire_bonder",
)  # fmt: skip
#: Words that docs/writing.md asks to avoid, as parts of names.
RIDDLES = {
    "told", "beside", "rider", "riders", "anew", "whatever", "nobody", "somebody", "loud", "louder", "loudest", "loudness",
    "errs",
}  # fmt: skip


def names_in(tree: ast.AST) -> Iterator[str]:
    """The names that a module gives: of functions, classes, parameters, variables and attributes."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr


def riddles(tree: ast.AST) -> list[str]:
    """The names with a word to be avoided."""
    return [name for name in names_in(tree) if RIDDLES & {word.lower() for word in re.findall(r"[A-Z]?[a-z]+", name)}]


def public_classes() -> dict[str, list[str]]:
    """The files of each public class's name, relative to the package."""
    found = defaultdict(list)
    for file, (_, tree) in sources().items():
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                found[node.name].append(file)
    return found


def repeated(classes: dict[str, list[str]]) -> dict[str, list[str]]:
    """Names of several classes of which one is in a listed room."""
    alike = {name: [file for file in files if not file.startswith("analysis/laws/")] for name, files in classes.items()}
    return {name: files for name, files in alike.items() if len(files) > 1 and any(file.startswith(ROOMS) for file in files)}


def test_a_class_name_means_one_thing() -> None:
    classes = public_classes()
    assert len(classes) > 400
    assert repeated(classes) == {}


def test_a_repeated_name_is_found() -> None:
    assert repeated({"Change": ["analysis/trends/change.py", "analysis/simulate/simulation.py"]})
    assert not repeated({"Backlash": ["analysis/laws/backlash.py", "analysis/diagnose/causes/backlash.py"]})


def test_names_have_no_word_to_be_avoided() -> None:
    assert len(sources()) > 300
    assert {file: found for file, (_, tree) in sources().items() if (found := riddles(tree))} == {}


def test_a_word_to_be_avoided_is_found() -> None:
    code = "class Riders:\n    def is_beside(self, told): self.loudest = told\n\nfor nobody in other: toldest = 1\n"
    assert {*riddles(ast.parse(code))} == {"Riders", "nobody", "is_beside", "told", "loudest"}
