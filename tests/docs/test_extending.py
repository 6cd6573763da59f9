"""The pages about adding a law, a cause, an instrument, a format and a command, followed literally in a copy of the project."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from plans import plan_text

ROOT = Path(__file__).resolve().parents[2]
PAGES = ("add-law.md", "add-cause.md", "add-instrument.md", "add-format.md", "add-command.md")
#: Files that the pages show: a fence with a title.
FILE = re.compile(r'^```python title="([^"]+)"\n(.*?)^```$', re.MULTILINE | re.DOTALL)
PLAN = plan_text(
    {"id": "a", "excitation": "other", "seconds": 3.0},
    channels={"motor": 3},
    rate=100.0,
    sensitivity=0.2,
    kind="millivolts",
    port="/dev/none",
)


def shown(page: str) -> list[tuple[str, str]]:
    """Names and contents of the files that a page shows."""
    return FILE.findall((ROOT / "docs" / page).read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def extended(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the project with the files of these pages."""
    place = tmp_path_factory.mktemp("extended")
    shutil.copytree(ROOT / "isorig", place / "isorig")
    shutil.copytree(ROOT / "tests" / "drivers", place / "tests" / "drivers")
    for page in PAGES:
        files = shown(page)
        assert len(files) == 2, f"{page} shows a file and its test"
        for name, content in files:
            path = place / name
            path.parent.mkdir(parents=True, exist_ok=True)
            assert not path.exists(), name
            path.write_text(content, encoding="utf-8")
    return place


def called(folder: Path, *call: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    return subprocess.run(
        [sys.executable, *call], cwd=folder, env=environment, capture_output=True, text=True, timeout=280, check=False
    )


def test_the_pages_files_pass_their_tests_and_the_instrument_keeps_to_the_contract(extended: Path) -> None:
    tests = [name for page in PAGES for name, _ in shown(page) if name.startswith("tests/")]
    contract = "tests/drivers/test_contract.py"
    chosen = [*tests, contract, "-k", "not test_contract or millivolts"]
    done = called(extended, "-m", "pytest", "-v", "-p", "no:cacheprovider", *chosen)
    assert done.returncode == 0, done.stdout + done.stderr
    passed = re.findall(r"^(\S+?)::\S.* PASSED", done.stdout, re.MULTILINE)
    assert sum(name != contract for name in passed) == 10, done.stdout
    assert contract in passed


@pytest.mark.study
def test_the_pages_instrument_is_measured_at_the_virtual_port(extended: Path, tmp_path: Path) -> None:
    (tmp_path / "plan.toml").write_text(PLAN, encoding="utf-8")
    plan, output = str(tmp_path / "plan.toml"), str(tmp_path / "c.h5")
    done = called(extended, "-m", "isorig", "acquire", plan, "--port", "virtual", "--yes", "--json", "-o", output)
    assert done.returncode == 0, done.stderr
    assert "motor" in called(extended, "-m", "isorig", "check", output).stdout
