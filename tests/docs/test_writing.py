"""Words that docs/writing.md asks to avoid stay out of pages, the help of commands, messages, docstrings and comments."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest
from sources import sources

from isorig.rig.cli import main
from isorig.rig.help import COMMANDS

ROOT = Path(__file__).resolve().parents[2]
#: The first bullet below "Avoid" in docs/writing.md, except words that also have a plain use ("look", "stands"), and pictures
#: and phrases of the table of terms there.
AVOIDED = re.compile(
    r"\b(told|tells of|beside|a look|looks? at|looked at|rider|riders|speaks? (against|for)|broken off|worked out|anew|such as"
    r"|leaves no trace|lines apart|lines? that stands? out|taken again|takes? it again|errs|errs? by|whatever|as far as it"
    r"|nobody|somebody|loud|louder|loudness|no fewer|not unlike|comes? along|finds its way|this machine)\b",
    re.IGNORECASE,
)
#: writing.md quotes the words.
PAGES = sorted({*(ROOT / "docs").rglob("*.md"), ROOT / "README.md"} - {ROOT / "docs" / "writing.md"})


def prose(page: str) -> str:
    """A page without code blocks and code words."""
    return re.sub(r"`[^`\n]+`", "", re.sub(r"^```.*?^```", "", page, flags=re.MULTILINE | re.DOTALL))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_pages_use_plain_words(page: Path) -> None:
    found = {match.group() for match in AVOIDED.finditer(prose(page.read_text(encoding="utf-8")))}
    assert not found, f"{page.name} uses {sorted(found)}; docs/writing.md has plain words for them"


def messages(tree: ast.Module) -> Iterator[str]:
    """Texts of a module with three words or more, without docstrings."""
    statements = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        text = node.value if isinstance(node, ast.Constant) and id(node) not in statements else None
        if isinstance(text, str) and len(text.split()) >= 3:
            yield text


def test_messages_use_plain_words() -> None:
    found = {
        f"{file}: {match.group()!r} in {text.strip()!r}"
        for file, (_, tree) in sources().items()
        for text in messages(tree)
        for match in AVOIDED.finditer(text)
    }
    assert sources()
    assert not found, "docs/writing.md has plain words for them"


def notes(code: str, tree: ast.Module) -> Iterator[str]:
    """Docstrings and comments of a module, each on one line."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield " ".join((ast.get_docstring(node) or "").split())
    comments = (token for token in tokenize.generate_tokens(io.StringIO(code).readline) if token.type == tokenize.COMMENT)
    before, text = -1, ""
    for token in comments:
        if token.start[0] != before + 1:
            yield text
            text = ""
        before, text = token.start[0], f"{text} {token.string.strip('#: ')}".strip()
    yield text


def test_docstrings_and_comments_use_plain_words() -> None:
    assert len(sources()) > 300
    found = {
        f"{file}: {match.group()!r} in {note!r}"
        for file, parsed in sources().items()
        for note in notes(*parsed)
        for match in AVOIDED.finditer(note)
    }
    assert not found, "docs/writing.md has plain words for them"


def test_a_word_in_a_docstring_or_a_comment_is_found() -> None:
    code = 'class A:\n    """It is\n    told apart."""\n\n    # It finds\n    # its way.\n    x = 1  # loud\n\n\n# Plain.\n'
    assert [match.group() for note in notes(code, ast.parse(code)) for match in AVOIDED.finditer(note)] == [
        "told",
        "finds its way",
        "loud",
    ]


def help_of(name: str, capsys: pytest.CaptureFixture[str]) -> str:
    main([*name.split(), "--help"])
    shown = capsys.readouterr().out
    below = re.findall(r"^[│ ]*([a-z]+)  ", shown, re.MULTILINE) if name in ("fleet", "virtual") else []
    return shown + "".join(help_of(f"{name} {command}", capsys) for command in below)


@pytest.mark.parametrize("name", ["", *COMMANDS])
def test_help_uses_plain_words(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    shown = help_of(name, capsys)
    assert "Usage" in shown
    found = {match.group() for match in AVOIDED.finditer(shown)}
    assert not found, f"rig {name} --help uses {sorted(found)}; docs/writing.md has plain words for them"
