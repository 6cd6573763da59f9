"""A sentence formats the number that the code uses: written as text, it would be untrue after the next change of the code."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

from sources import sources

#: A number that counts or limits something: with a unit, or after a word that compares.
UNIT = r"(?:%|times|k?Hz|[mkuµ]?m|m?s|kg|N|V|percent|draws|samples|seconds|minutes|periods|standard|runs|points|averages|bins)"
NUMBER = r"\d+(?:[.,]\d+)?"
COUNTED = re.compile(
    rf"(?<![\w.^#{{:/=-]){NUMBER} {UNIT}(?!\w)"
    rf"|\b(?:give|least|most|than|between|above|below|up to) (?![01]\b(?!\.)){NUMBER}(?![\w.]*\w)"
)
#: Sentences whose number is not a value of the code: a convention of the field, or an example.
ALLOWED = (
    "95 %",  # the probability of every interval, fixed in docs/writing.md as "error bar"
    "e.g.",
    "for example",
    "tie one to 5 V",  # the supply of digital inputs
    "noise of 1 % of the rms",  # `_from_usual_runs` relates its result to this noise
)


def sentences(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """The texts of a module without its docstrings, each with its line; a formatted value is {}."""
    nodes = list(ast.walk(tree))
    inner = {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in ast.walk(node) if part is not node}
    skipped = {
        id(node.body[0].value)
        for node in nodes
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    left_out = inner | skipped
    for node in nodes:
        if isinstance(node, ast.JoinedStr) and id(node) not in inner:
            yield node.lineno, "".join(str(v.value) if isinstance(v, ast.Constant) else "{}" for v in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in left_out:
            yield node.lineno, node.value


def written_numbers(tree: ast.Module) -> list[tuple[int, str]]:
    """The sentences of a module with a number as text, each with its line."""
    return [
        (line, text)
        for line, text in sentences(tree)
        if " " in text.strip() and COUNTED.search(text) and not any(allowed in text for allowed in ALLOWED)
    ]


def test_sentences_format_their_numbers() -> None:
    found = [f"{file}:{line}: {text}" for file, (_, tree) in sources().items() for line, text in written_numbers(tree)]
    assert not found, "\n".join(found)


def test_a_number_written_as_text_is_found() -> None:
    def written(code: str) -> list[tuple[int, str]]:
        return written_numbers(ast.parse(code))

    assert written('say(f"the last 40 % of {run}")') == [(1, "the last 40 % of {}")]
    assert written('say("exceeds 1.2 times it")\nsay("after 400 draws")\nsay("give at least 16 of them")')[2][0] == 3
    assert written('"""The last 40 % of a run."""\nsay(f"the last {100 * SHARE:g} % of a run", "%d Hz", "figure 2")') == []
