"""Benchmarks wait for other programs, and then say that they did not measure; README.md shows ratios of their page."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def test_another_program_that_computes_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "bench"))
    import run

    # A program of another parent: its time is not that of the benchmark.
    spin = "import time; end = time.monotonic() + 20\nwhile time.monotonic() < end: pass"
    other = subprocess.Popen([sys.executable, "-c", spin])
    try:
        said = run.wait_until_quiet(look=0.5, patience=1.0)
    finally:
        other.kill()
        other.wait()
    assert said.startswith("Not measured: other programs used")
    assert "for 1 s" in said


def test_the_readme_shows_the_ratios_of_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "bench"))
    import run

    page = (ROOT / "docs" / "bench.md").read_text(encoding="utf-8")
    shown = run.ratios(page)
    assert run.MARKS[0] + shown + run.MARKS[1] in (ROOT / "README.md").read_text(encoding="utf-8")
    rows = [line for line in shown.splitlines() if "python bench/" in line]
    assert len(rows) == sum(f"## {run.NAMES[name]}" in page for name, *_ in run.SHOWN)
    row = "| time of one simulated second | 0.197 ms | diffrax Tsit5, arctan 1e-4 | 7.11 ms | 36.1 |  |"
    assert "| time of a simulation | diffrax Tsit5, arctan 1e-4 | 36.1 |" in run.ratios(
        f"## The simulator: time and error\n\n{row}\n"
    )
