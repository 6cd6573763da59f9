"""Attacks by chance on the acquisition and on every command, over all cores; writes what was tried and what became of it.

    python tests/attack/run_attack.py [--images 2000] [--faults 500] [--inputs 2000] [--seed 1] [--page docs/attack.md]
    python tests/attack/run_attack.py --soak 3600 --fleet-hours 24 --images 0 --faults 0 --inputs 0

A portion of attacks is a process of its own. With `--results` an interrupted run goes on where it ended, and the page says what
all runs with this file have done. With `--minutes` it ends after that time; of the portions that are cut short, those of inputs
count what they have tried. The exit status is 1 if anything was wrong in silence, ended with a traceback or hung.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
#: Each command, and the kinds of `tests/rig/fuzzing.py` whose inputs it reads.
COMMANDS: Mapping[str, str] = {
    "check": "check", "frf": "frf", "diagnose": "diagnose", "recover": "working", "acquire (plans)": "plan",
    "describe": "describe", "fleet": "fleet", "predict (models)": "model", "simulate (descriptions)": "description",
    "export (parameters)": "parameters", "check, frf, export, report, isolation": "recording", "import (mappings)": "mapping",
    "import of MATLAB 5, compressed": "mat5", "import of MATLAB 5": "mat5_plain", "import of MATLAB 7.3": "mat73",
    "import of universal files, text": "universal", "import of universal files, binary": "universal_binary",
    "import of TDMS": "tdms", "import of text": "csv", "import of LVM": "lvm", "import of WAV": "wav", "import of NPZ": "npz",
    "import of NPY": "npy", "import of JSON": "as_json", "import of HDF5": "hdf5",
}  # fmt: skip
DRIVERS = ("framed", "di1100", "mti600", "lines", "nidaqmx", "sound", "sr785", "35670a")
#: Attacks of one process, so that both cores end at the same time.
IMAGES, FAULTS, INPUTS = 250, 50, 250
#: Portions at a time for each core: a driver waits for its far end, a command for the process that checks a file.
WAITING = 3
#: Seconds after which a portion counts as a hang.
LONGEST = 3600.0


@dataclass
class Row:
    """What became of the attacks of a kind."""

    kind: str
    what: str
    ended: Counter[str] = field(default_factory=Counter)
    bad: list[str] = field(default_factory=list)

    @property
    def count(self) -> int:
        """Number of attacks."""
        return sum(self.ended.values())


@dataclass(frozen=True)
class Portion:
    """Some attacks of a kind: the row of the table to which they count, and the command line of their process."""

    kind: str
    what: str
    call: Sequence[str]

    @property
    def name(self) -> str:
        """The same in all runs."""
        return " ".join(str(Path(word).name) for word in self.call)


@dataclass(frozen=True, kw_only=True)
class Result:
    """What a portion printed in JSON, the other lines, what was wrong with its process, its seconds, whether it was cut short."""

    portion: str
    lines: Sequence[Mapping[str, Any]]
    said: Sequence[str]
    failure: str
    seconds: float
    cut: bool = False


def portions(images: int, faults: int, inputs: int, seed: int) -> list[Portion]:
    """All attacks in portions, each with its seed; the first of each kind come first, then the second ones."""
    found = []
    for k, count in enumerate(_split(images, IMAGES)):
        found.append((k, Portion("image", "power-loss images", (str(HERE / "portion.py"), "images", str(count), str(seed + k)))))
    for driver in DRIVERS:
        for k, count in enumerate(_split(faults, FAULTS)):
            found.append((k, Portion("fault", driver, (str(HERE / "portion.py"), driver, str(count), str(seed + k)))))
    fuzzing = str(ROOT / "tests" / "rig" / "fuzzing.py")
    for what, kind in COMMANDS.items():
        for k, count in enumerate(_split(inputs, INPUTS)):
            found.append((k, Portion("input", what, (fuzzing, f"{kind}={count}", str(seed + k)))))
    return [portion for _, portion in sorted(found, key=lambda item: item[0])]


def _split(count: int, most: int) -> list[int]:
    return [min(most, count - start) for start in range(0, count, most)]


class Running:
    """The processes of portions, until the time is over."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._processes: set[subprocess.Popen[str]] = set()
        self.over = False

    def end(self) -> None:
        """Begin no other portion, and end those that run."""
        with self._lock:
            self.over = True
            for process in self._processes:
                process.terminate()

    def attacked(self, portion: Portion) -> Result | None:
        """Run a portion; None if the time was over before it had a result."""
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
        began = time.monotonic()
        with tempfile.TemporaryDirectory(prefix="attack-") as folder:
            call = [sys.executable, *portion.call, *([folder] if portion.kind == "input" else [])]
            with self._lock:
                if self.over:
                    return None
                process = subprocess.Popen(
                    call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT, env=environment
                )
                self._processes.add(process)
            try:
                out, error = process.communicate(timeout=None if portion.kind == "long" else LONGEST)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()
                return Result(portion=portion.name, lines=(), said=(), failure=f"hang: {portion.name}", seconds=LONGEST)
            finally:
                with self._lock:
                    self._processes.discard(process)
        if self.over and process.returncode == -signal.SIGTERM:
            return None
        lines = out.splitlines()
        return Result(
            portion=portion.name, lines=[json.loads(line) for line in lines if line.startswith("{")],
            said=[line for line in lines if line and not line.startswith("{")],
            failure="" if process.returncode == 0 else f"{portion.name}: {out[-500:]} {error[-2000:]}",
            seconds=time.monotonic() - began, cut=self.over,
        )  # fmt: skip


class Kept:
    """The results of all runs with a file, so that an interrupted run goes on.

    Parameters
    ----------
    path
        A line of JSON for each portion; None to keep nothing.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self.results: dict[str, Result] = {}
        if path is not None:
            with suppress(FileNotFoundError):
                for line in path.read_text(encoding="utf-8").splitlines():
                    self._take(Result(**json.loads(line)))

    def add(self, result: Result) -> None:
        """Keep a result."""
        self._take(result)
        if self._path is not None:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(result)) + "\n")

    def _take(self, result: Result) -> None:
        self.results[result.portion] = result


def attack(asked: Sequence[Portion], workers: int, kept: Kept, seconds: float = math.inf) -> None:
    """Run the portions without a whole result, side by side, for so long at most."""
    left = [portion for portion in asked if portion.name not in kept.results or kept.results[portion.name].cut]
    running = Running()
    timer = threading.Timer(min(seconds, threading.TIMEOUT_MAX), running.end)
    timer.daemon = True
    timer.start()
    with ThreadPoolExecutor(workers) as pool:
        for number, future in enumerate(as_completed([pool.submit(running.attacked, portion) for portion in left]), 1):
            result = future.result()
            if result is not None:
                kept.add(result)
                print(f"{number} of {len(left)}: {result.portion}, {result.seconds:.0f} s", *_wrong(result), sep="\n", flush=True)
    timer.cancel()


def rows_of(asked: Sequence[Portion], kept: Kept) -> list[Row]:
    """The rows of the tables: all portions with a result."""
    rows = {(portion.kind, portion.what): Row(portion.kind, portion.what) for portion in asked}
    for portion in asked:
        if portion.name in kept.results:
            result, row = kept.results[portion.name], rows[portion.kind, portion.what]
            row.bad += _wrong(result)
            for line in result.lines:
                if not _is_wrong(line):
                    row.ended.update({key: n for key, n in line.items() if isinstance(n, int)})
    return [row for row in rows.values() if row.count or row.bad]


def _wrong(result: Result) -> list[str]:
    return [json.dumps(line) for line in result.lines if _is_wrong(line)] + [result.failure] * bool(result.failure)


def _is_wrong(line: Mapping[str, Any]) -> bool:
    return "wrong" in line and "case" in line


def page(rows: Sequence[Row], *, seed: int, seconds: float, workers: int, machine: str, more: Sequence[str] = ()) -> str:
    """The page with counts, seeds and hours."""
    wrong = sum(len(row.bad) for row in rows)
    drivers = [row for row in rows if row.kind == "fault"]
    inputs = [row for row in rows if row.kind == "input"]
    lines = [
        "# Attacks by chance", "",
        "`make attack` damages what the acquisition and the commands read, at random with a fixed seed, and writes this page. An",
        "attack ends right (the values are those that were sent), reported (a driver says what it could not place), accepted,",
        "refused in one sentence, or wrong: a wrong value without a report, a traceback, a crash, a hang, half a result.",
        "",
        f"Last run: {sum(row.count for row in rows)} attacks, seeds from {seed} on, {seconds / 3600.0:.2f} hours in total in",
        f"processes of which {workers} ran at a time ({machine}); **{wrong} wrong**. The number of attacks is set by `IMAGES`,",
        "`FAULTS` and `INPUTS`, for example `make attack IMAGES=2000 FAULTS=500 INPUTS=2000 SEED=1`, which are the default",
        "values. An interrupted run goes on where it ended; remove `build/attack.jsonl` to begin again.", "",
    ]  # fmt: skip
    for title, what, found in (
        ("Power loss: what the disk may hold of a session's log", "images", [row for row in rows if row.kind == "image"]),
        ("Faults on the wire, for each driver", "driver", drivers), ("Damaged inputs, for each command", "command", inputs),
    ):  # fmt: skip
        if found:
            names = list(dict.fromkeys(name for row in found for name in sorted(row.ended) if name != "wrong"))
            lines += [f"## {title}", "", f"| {what} | number | {' | '.join(names)} | wrong |", "| --- " * (len(names) + 3) + "|"]
            for row in found:
                numbers = " | ".join(str(row.ended[name]) for name in names)
                lines.append(f"| {row.what} | {row.count} | {numbers} | {len(row.bad)} |")
            lines.append("")
    if more:
        lines += ["## Long runs", "", *more, ""]
    return "\n".join(lines).rstrip() + "\n"


def main() -> int:
    """Parse the options and run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--images", type=int, default=2000, help="power-loss images")
    parser.add_argument("--faults", type=int, default=500, help="faults for each driver")
    parser.add_argument("--inputs", type=int, default=2000, help="damaged inputs for each command")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=WAITING * len(os.sched_getaffinity(0)), help="portions at a time")
    parser.add_argument("--soak", type=float, default=0.0, help="seconds of 8 inputs at 51.2 kHz with the page open")
    parser.add_argument("--fleet-hours", type=float, default=0.0, help="simulated hours of a watched folder")
    parser.add_argument("--minutes", type=float, default=math.inf, help="end after that time")
    parser.add_argument("--results", type=Path, help="keep the results there, and go on from those that it has")
    parser.add_argument("--page", type=Path, help="write the page there")
    asked = parser.parse_args()
    kept = Kept(asked.results)
    random = portions(asked.images, asked.faults, asked.inputs, asked.seed)
    attack(random, asked.workers, kept, 60.0 * asked.minutes)
    # Alone on the machine: they state memory and losses.
    scripts = (("soak.py", asked.soak), ("fleet_day.py", asked.fleet_hours))
    long = [Portion("long", name, (str(HERE / name), f"{value:g}", str(asked.seed))) for name, value in scripts if value > 0.0]
    attack(long, 1, kept)
    rows = rows_of(random, kept)
    ran = [kept.results[portion.name] for portion in long]
    seconds = sum(kept.results[portion.name].seconds for portion in random if portion.name in kept.results)
    text = page(
        rows, seed=asked.seed, seconds=seconds, workers=asked.workers,
        machine=f"{os.cpu_count()} cores", more=[f"- {line}" for result in ran for line in result.said],
    )  # fmt: skip
    if asked.page is not None:
        asked.page.write_text(text, encoding="utf-8")
    print(text)
    return int(any(row.bad for row in rows) or any(result.failure for result in ran))


if __name__ == "__main__":
    sys.exit(main())
