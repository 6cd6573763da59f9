"""Benchmarks wait for other programs, and then say that they did not measure; README.md shows ratios of their page."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


SPIN = "import time\nend = time.monotonic() + 20\nwhile time.monotonic() < end: pass"
#: Starts a program, prints its number and ends, so that the program has another parent from then on.
LEAVE = f"from subprocess import *\nimport sys\nprint(Popen([sys.executable, '-c', {SPIN!r}], stdout=DEVNULL).pid, flush=True)"


@contextmanager
def other_program() -> Iterator[int]:
    """The number of a computing program that this one has not started."""
    said = subprocess.run([sys.executable, "-c", LEAVE], stdout=subprocess.PIPE, text=True, timeout=30, check=True)
    try:
        yield int(said.stdout)
    finally:
        os.kill(int(said.stdout), signal.SIGKILL)


@pytest.fixture(autouse=True)
def _bench(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "bench"))


def test_another_program_that_computes_is_told() -> None:
    import run

    with other_program():
        said = run.wait_until_quiet(look=0.5, patience=1.0)
    assert said.startswith("Not measured: for 1 s other programs used")
    assert "most of it" in said


def test_children_and_their_children_are_no_other_programs() -> None:
    from others import OtherPrograms, processes, started_by

    # The child starts another one, and both compute.
    both = f"import subprocess, sys\nsubprocess.Popen([sys.executable, '-c', {SPIN!r}], stdout=subprocess.DEVNULL)\n{SPIN}"
    with other_program() as stranger, subprocess.Popen([sys.executable, "-c", both]) as child:
        others, end = OtherPrograms(), time.monotonic() + 30.0
        below: list[int] = []
        while not below and time.monotonic() < end:
            now = processes()
            below = [key[0] for key, each in now.items() if each.parent == child.pid]
        (grandchild,) = below
        others.look()
        time.sleep(1.0)
        own = started_by(os.getpid(), now)
        assert {os.getpid(), child.pid, grandchild} <= {key[0] for key in own}
        assert stranger not in {key[0] for key in own}
        # After its parent has ended, the grandchild has another parent.
        child.kill()
        child.wait()
        assert others.look() > 0.2
        assert others.is_own(grandchild)
        assert not others.is_own(stranger)
        os.kill(grandchild, signal.SIGKILL)


def test_the_time_of_a_hypervisor_is_not_that_of_a_program(monkeypatch: pytest.MonkeyPatch) -> None:
    import others
    import run

    monkeypatch.setattr(others, "processes", dict)
    taken = iter([1.0, 1.5, 1.0, 1.5])
    monkeypatch.setattr(others, "_taken", lambda: next(taken))
    counted = others.OtherPrograms()
    assert counted.look() == 0.5
    assert counted.most == "a hypervisor"
    left_out = others.OtherPrograms(hypervisor=False)
    assert left_out.look() == 0.0
    assert set(run.PROCESSOR_TIME) < set(run.NAMES)


def test_the_time_of_a_program_that_ends_counts_once() -> None:
    from others import INIT, Process, used_between

    shell, job, init = (10, 0.0), (11, 0.0), (INIT, 0.0)
    before = {
        shell: Process(parent=1, own=1.0, children=5.0), job: Process(parent=10, own=3.0, children=1.0),
        init: Process(parent=0, own=0.0, children=0.0),
    }  # fmt: skip
    # Another second of the job until it ended, and half a second of one that came and ended meanwhile.
    now = {shell: Process(parent=1, own=1.25, children=10.5), init: Process(parent=0, own=0.0, children=7.0)}
    assert used_between(before, now) == {shell: 1.75, init: 0.0}
    # Of two that end, the upper one has waited for the lower one.
    nested = {**before, (12, 0.0): Process(parent=11, own=4.0, children=0.0)}
    ended = {shell: Process(parent=1, own=1.0, children=5.0 + 3.0 + 1.0 + 4.0 + 0.5), init: before[init]}
    assert used_between(nested, ended) == {shell: 0.5, init: 0.0}
    # A job that nobody waits for.
    alone = {shell: Process(parent=1, own=1.25, children=5.0), init: before[init]}
    assert used_between(before, alone) == {shell: 0.25, init: 0.0}
    # A program that began meanwhile.
    began = {**before, (12, 1.0): Process(parent=10, own=0.5, children=0.25)}
    assert used_between(before, began)[12, 1.0] == 0.75


def test_the_readme_shows_the_ratios_of_the_page() -> None:
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


def test_after_the_time_of_the_run_no_benchmark_begins() -> None:
    import run

    rows, why = run.undisturbed("simulate", quick=True, end=time.monotonic())
    assert rows == []
    assert why.startswith("Not begun: the 40 minutes of the run are over")


def test_the_table_shows_medians_and_spreads() -> None:
    import run
    from table import Row

    row = Row.of("time", "s", [3.0, 1.0, 2.0], "another", [8.0, 4.0, 6.0], "at most 2 s: met")
    assert run.table([row]).splitlines()[-1] == "| time | 2 s (1 to 3) | another | 6 s (4 to 8) | 3 | at most 2 s: met |"


def test_methods_take_turns_in_every_repetition() -> None:
    from table import alternated

    calls: list[str] = []
    ways = {name: lambda name=name: float(calls.append(name) or len(calls)) for name in "ab"}
    assert alternated(ways, 2) == {"a": [1.0, 3.0], "b": [2.0, 4.0]}
    assert calls == ["a", "b", "a", "b"]
