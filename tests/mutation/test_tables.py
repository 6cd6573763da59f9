"""The tables of mutants agree with the code: named mutants can be made, listed survivors exist."""

from __future__ import annotations

import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import run_mutants


def test_every_named_mutant_changes_the_present_code() -> None:
    assert len(run_mutants.named()) == len(run_mutants.NAMED)


def test_listed_survivors_are_mutants_of_the_present_code() -> None:
    listed = re.findall(r"^\| (isorig/analysis/.*`) \| ", run_mutants.LISTED.read_text(encoding="utf-8"), re.MULTILINE)
    made = {f"{mutant.file} {mutant.name}" for file in run_mutants.MODULES for mutant in run_mutants.mutants_of(file)}
    assert listed
    assert [line for line in listed if line not in made] == []
