"""General code does not know the words of the wire bonder; nothing of the package needs the thesis's figures."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ISORIG = Path(__file__).resolve().parents[3] / "isorig"
OWN = ISORIG / "rig" / "wire_bonder"
#: Its bodies, values and purpose. Its name alone is allowed: it is the rig of a recording without a description.
WORDS = re.compile(r"heat_?block|motor|head_mass|(?<![a-z])bond(?![a-z])|(?<!wire_)(?<!wire-)(?<!wire )bonder", re.IGNORECASE)

#: What still has its words, and why.
EXCEPTIONS = {
    "analysis/fitting/uncertainty.py": "names of given masses in the recording format",
    "analysis/isolation/ratio.py": "defaults of a public function",
    "analysis/parameters/joint_fit.py": "rows of its parameter table, whose names are a file format",
    "analysis/spectra/quality.py": "two exchanged sensors of three masses in a line",
    "drivers/analyzer.py": "example plan", "drivers/kinds.py": "example plan", "drivers/mti600.py": "example plan",
    "drivers/ni.py": "example plan", "drivers/sound.py": "example plan",
    "rig/commands/characterize.py": "prints its table",
    "rig/exchange/draft.py": "recognizes its channels by the names of columns",
    "rig/files/parameter_table.py": "names of its parameters in a file format",
    "rig/files/recording.py": "required channels of a recording without a description",
    "rig/report/first.py": "first screen of its page, and the advice on it",
    "rig/report/frequency.py": "section of its page", "rig/report/measurement.py": "section of its page",
}  # fmt: skip


def words_in(source: str) -> set[str]:
    """The words in identifiers and strings of a module; docstrings and comments may name the example that they explain."""
    tree = ast.parse(source)
    described = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and node.body
        if isinstance(node.body[0], ast.Expr) and isinstance(node.body[0].value, ast.Constant)
    }
    return {found[0].lower() for node in ast.walk(tree) if id(node) not in described for found in WORDS.finditer(_text(node))}


def _text(node: ast.AST) -> str:
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else ""
    return str(getattr(node, "id", getattr(node, "attr", getattr(node, "arg", getattr(node, "name", "")))) or "")


def general() -> Iterator[Path]:
    return (path for path in sorted(ISORIG.rglob("*.py")) if OWN not in path.parents)


def test_general_code_knows_no_word_of_the_wire_bonder() -> None:
    found = {path.relative_to(ISORIG).as_posix(): words for path in general() if (words := words_in(path.read_text()))}
    assert found.keys() == EXCEPTIONS.keys(), {name: found.get(name) for name in found.keys() ^ EXCEPTIONS.keys()}


@pytest.mark.parametrize(
    "source", ["motor = 1", "def f(head_mass): ...", "x.heatblock", 'a = "the bond"', "class Bonder: ...", 'f"{a} of the motor"']
)
def test_a_word_is_found(source: str) -> None:
    assert words_in(source)


def test_other_words_are_not() -> None:
    assert not words_in(
        '"""A motor."""\nfrom isorig.rig.wire_bonder.description import wire_bonder\nbonded = "wire-bonder"  # motor'
    )


def test_nothing_of_the_package_needs_the_thesis() -> None:
    assert not [path for path in ISORIG.rglob("*.py") if re.search(r"^\s*(from|import) thesis\b", path.read_text(), re.MULTILINE)]
