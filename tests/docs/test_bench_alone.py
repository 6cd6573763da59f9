"""Benchmarks are measured alone: they wait for other programs, and then say that they did not measure."""

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
