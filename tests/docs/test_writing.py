"""Words that docs/writing.md asks to avoid stay out of the pages and of the help of commands."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from isorig.rig.cli import COMMANDS, main

ROOT = Path(__file__).resolve().parents[2]
#: The first bullet below "Avoid" in docs/writing.md, except words that also have a plain use ("look", "stands").
AVOIDED = re.compile(
    r"\b(told|tells of|beside|a look|looked at|rider|riders|speaks? against|broken off|worked out)\b", re.IGNORECASE
)
#: writing.md quotes the words.
PAGES = sorted({*(ROOT / "docs").glob("*.md"), ROOT / "README.md"} - {ROOT / "docs" / "writing.md"})


def prose(page: str) -> str:
    """A page without code blocks and code words."""
    return re.sub(r"`[^`\n]+`", "", re.sub(r"^```.*?^```", "", page, flags=re.MULTILINE | re.DOTALL))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_pages_use_plain_words(page: Path) -> None:
    found = {match.group() for match in AVOIDED.finditer(prose(page.read_text(encoding="utf-8")))}
    assert not found, f"{page.name} uses {sorted(found)}; docs/writing.md has plain words for them"


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
