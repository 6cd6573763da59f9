"""The tables of mutants agree with the code: named mutants can be made, listed survivors exist."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import run_mutants


def test_every_named_mutant_changes_the_present_code() -> None:
    assert len(run_mutants.named()) == len(run_mutants.NAMED)


def test_listed_survivors_are_mutants_of_the_present_code() -> None:
    listed = run_mutants.listed_survivors()
    made = {f"{mutant.file} {mutant.name}" for file in run_mutants.MODULES for mutant in run_mutants.mutants_of(file)}
    assert listed
    assert [line for line in listed if line not in made] == []


def test_every_test_of_a_module_exists() -> None:
    tests = {test for covered in run_mutants.MODULES.values() for test in covered.tests}
    tests |= {test for others in run_mutants.OTHERS.values() for test in others}
    assert [test for test in tests if not (run_mutants.ROOT / test.partition("::")[0]).is_file()] == []


def test_every_mutant_of_a_module_has_a_name_that_no_other_has() -> None:
    for file in run_mutants.MODULES:
        names = [mutant.name for mutant in run_mutants.mutants_of(file)]
        assert len(set(names)) == len(names)
