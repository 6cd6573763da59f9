"""Options of every benchmark, alternating repetitions, and the rows that it adds to the table of `bench/run.py`."""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Self


@dataclass(frozen=True, kw_only=True)
class Row:
    """A result of isorig, and that of another package or method if there is one.

    Parameters
    ----------
    what, unit
        The measured quantity and its unit.
    ours
        The value of isorig; the median if it was measured repeatedly.
    peer, theirs
        The other package or method and its value; empty and None if there is none.
    limit
        The limit of our value, and whether it is met.
    ours_spread, theirs_spread
        The smallest and the largest value of the repetitions; None if there was one only.
    """

    what: str
    unit: str
    ours: float
    peer: str = ""
    theirs: float | None = None
    limit: str = ""
    ours_spread: tuple[float, float] | None = None
    theirs_spread: tuple[float, float] | None = None

    @classmethod
    def of(
        cls, what: str, unit: str, ours: Sequence[float], peer: str = "", theirs: Sequence[float] = (), limit: str = ""
    ) -> Self:  # fmt: skip
        """The row of values from repetitions."""
        return cls(
            what=what, unit=unit, ours=statistics.median(ours), peer=peer, theirs=statistics.median(theirs) if theirs else None,
            limit=limit, ours_spread=_spread(ours), theirs_spread=_spread(theirs),
        )  # fmt: skip

    @property
    def ratio(self) -> float | None:
        """The other value over ours."""
        return None if self.theirs is None or self.ours == 0.0 else abs(self.theirs / self.ours)


def _spread(values: Sequence[float]) -> tuple[float, float] | None:
    return (min(values), max(values)) if len(values) > 1 else None


def alternated(ways: Mapping[str, Callable[[], float]], repeats: int) -> dict[str, list[float]]:
    """What each way measures in every repetition.

    The ways take turns within each repetition, so that a computer that becomes slower changes all of them, and hardly their
    ratios.
    """
    found: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(repeats):
        for name, way in ways.items():
            found[name].append(way())
    return found


def of_this_thread(work: Callable[[], object], calls: int = 1) -> float:
    """Processor time of a call in this thread, s: the mean of several, of which the first one finds other data in the caches."""
    began = time.thread_time()
    for _ in range(calls):
        work()
    return (time.thread_time() - began) / calls


@dataclass(frozen=True, kw_only=True)
class Cost:
    """What another process took: seconds on the clock and of the processor (with processes that it waited for), peak MB."""

    clock: float
    processor: float
    memory: float


def cost_of(call: Sequence[str]) -> Cost:
    """Run a program until its end. Raises CalledProcessError if it fails."""
    began = time.perf_counter()
    process = subprocess.Popen(call, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode, clock = os.waitstatus_to_exitcode(status), time.perf_counter() - began
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, call)
    return Cost(clock=clock, processor=used.ru_utime + used.ru_stime, memory=used.ru_maxrss / 1024.0)


def within(figure: float, limit: float, unit: str) -> str:
    """An upper limit, and whether a value meets it, as text."""
    return f"at most {limit:g} {unit}: {'met' if figure <= limit else 'not met'}"


def options(description: str | None) -> argparse.ArgumentParser:
    """The options of every benchmark."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer repetitions, less precise results")
    parser.add_argument("--rows", type=Path, help="file for the rows of the common table, as JSON")
    return parser


def keep(rows: Sequence[Row], path: Path | None) -> None:
    """Write the rows for `bench/run.py`, if it requested them."""
    if path is not None:
        path.write_text(json.dumps([asdict(row) for row in rows]), encoding="utf-8")
