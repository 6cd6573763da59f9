"""Damaged and forged inputs end in a result or a refusal of one line: no traceback, crash or hang, nothing beside the output."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(HERE.parents[1])}
#: Kinds of inputs; the costly ones are read by a process more each.
CHEAP = (
    "working",
    "plan",
    "mapping",
    "model",
    "description",
    "parameters",
    "universal",
    "universal_binary",
    "tdms",
    "csv",
    "wav",
)
COSTLY = ("recording", "foreign_recording", "mat73", "mat5", "mat5_plain")
#: How many of a kind a study tries at once.
PORTION = 500


def fuzzed(asked: str, seed: int, folder: Path) -> None:
    call = [sys.executable, str(HERE / "fuzzing.py"), asked, str(seed), str(folder)]
    ended = subprocess.run(call, capture_output=True, text=True, check=False, cwd=HERE.parents[1], env=ENVIRONMENT)
    lines = [json.loads(line) for line in ended.stdout.splitlines()]
    print(*[line for line in lines if "case" not in line], sep="\n")
    assert ended.returncode == 0, ended.stderr
    assert len(lines) == len(asked.split(",")), [line for line in lines if "case" in line]


def test_damaged_inputs_are_refused_in_a_line(tmp_path: Path) -> None:
    fuzzed(",".join([f"{kind}=3" for kind in CHEAP] + [f"{kind}=2" for kind in COSTLY]), 1, tmp_path)


@pytest.mark.study
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("seed", range(10, 14))
@pytest.mark.parametrize("kind", [*CHEAP, *COSTLY])
def test_many_damaged_inputs(tmp_path: Path, kind: str, seed: int) -> None:
    fuzzed(f"{kind}={PORTION}", seed, tmp_path)


@pytest.mark.study
@pytest.mark.timeout(3600)
def test_damaged_profiles_of_moves(tmp_path: Path) -> None:
    # A sound one takes ten seconds: fewer of them.
    fuzzed("moves=100", 10, tmp_path)
