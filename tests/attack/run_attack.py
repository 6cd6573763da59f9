"""Attacks by chance on the acquisition and on every command, over all cores; writes what was tried and what became of it.

    python tests/attack/run_attack.py [--images 2000] [--faults 500] [--inputs 2000] [--seed 1] [--page docs/attack.md]
    python tests/attack/run_attack.py --soak 3600 --fleet-hours 24 --images 0 --faults 0 --inputs 0

A portion of attacks is a process of its own. The exit status is 1 if anything was wrong in silence, ended with a traceback or
hung.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
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


def portions(images: int, faults: int, inputs: int, seed: int, folder: Path) -> Iterator[Portion]:
    """All attacks in portions; each has a seed of its own."""
    for k, count in enumerate(_split(images, IMAGES)):
        yield Portion("image", "power-loss images", (str(HERE / "portion.py"), "images", str(count), str(seed + k)))
    for driver in DRIVERS:
        for k, count in enumerate(_split(faults, FAULTS)):
            yield Portion("fault", driver, (str(HERE / "portion.py"), driver, str(count), str(seed + k)))
    fuzzing = str(ROOT / "tests" / "rig" / "fuzzing.py")
    for what, kind in COMMANDS.items():
        for k, count in enumerate(_split(inputs, INPUTS)):
            yield Portion("input", what, (fuzzing, f"{kind}={count}", str(seed + k), str(folder / f"{kind}-{k}")))


def _split(count: int, most: int) -> list[int]:
    return [min(most, count - start) for start in range(0, count, most)]


def attacked(portion: Portion) -> tuple[Portion, list[dict[str, Any]], str]:
    """Run a portion: its lines of JSON, and what was wrong with the process itself."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            [sys.executable, *portion.call],
            capture_output=True,
            text=True,
            check=False,
            cwd=ROOT,
            env=environment,
            timeout=LONGEST,
        )
    except subprocess.TimeoutExpired:
        return portion, [], f"hang: {' '.join(portion.call)}"
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    return portion, lines, "" if done.returncode == 0 else f"{' '.join(portion.call)}: {done.stderr[-2000:]}"


def attack(asked: Sequence[Portion], workers: int) -> list[Row]:
    """Run all portions side by side; the rows in their order."""
    rows = {(portion.kind, portion.what): Row(portion.kind, portion.what) for portion in asked}
    with ThreadPoolExecutor(workers) as pool:
        for number, future in enumerate(as_completed([pool.submit(attacked, portion) for portion in asked]), 1):
            portion, lines, failure = future.result()
            row = rows[portion.kind, portion.what]
            for line in lines:
                if "wrong" in line and "case" in line:
                    row.bad.append(json.dumps(line))
                else:
                    row.ended.update({key: n for key, n in line.items() if isinstance(n, int)})
            row.bad += [failure] if failure else []
            print(f"{number} of {len(asked)}: {row.what}, {dict(row.ended)}", *row.bad, sep="\n", flush=True)
    return list(rows.values())


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
        f"Last run: {sum(row.count for row in rows)} attacks, seeds from {seed} on, {seconds / 3600.0:.2f} hours in {workers}",
        f"processes ({machine}); **{wrong} wrong**. The number of attacks is set by `IMAGES`, `FAULTS` and `INPUTS`, for example",
        "`make attack IMAGES=2000 FAULTS=500 INPUTS=2000 SEED=1`, which are the default values.", "",
    ]  # fmt: skip
    for title, what, found in (
        ("Power loss: what the disk may hold of a session's log", "images", [row for row in rows if row.kind == "image"]),
        ("Faults on the wire, for each driver", "driver", drivers), ("Damaged inputs, for each command", "command", inputs),
    ):  # fmt: skip
        if found:
            names = list(dict.fromkeys(name for row in found for name in sorted(row.ended)))
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
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--soak", type=float, default=0.0, help="seconds of 8 inputs at 51.2 kHz with the page open")
    parser.add_argument("--fleet-hours", type=float, default=0.0, help="simulated hours of a watched folder")
    parser.add_argument("--page", type=Path, help="write the page there")
    asked = parser.parse_args()
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="attack-") as folder:
        rows = attack(list(portions(asked.images, asked.faults, asked.inputs, asked.seed, Path(folder))), asked.workers)
    seconds = time.monotonic() - began
    more, failed = [], False
    for script, value in (("soak.py", asked.soak), ("fleet_day.py", asked.fleet_hours)):
        if value > 0.0:
            # Alone on the machine: they state memory and losses.
            done = subprocess.run(
                [sys.executable, str(HERE / script), str(value), str(asked.seed)], stdout=subprocess.PIPE, text=True, check=False
            )
            more += [f"- {line}" for line in done.stdout.splitlines()]
            failed |= done.returncode != 0
            print(done.stdout, flush=True)
    text = page(rows, seed=asked.seed, seconds=seconds, workers=asked.workers, machine=f"{os.cpu_count()} cores", more=more)
    if asked.page is not None:
        asked.page.write_text(text, encoding="utf-8")
    print(text)
    return int(failed or any(row.bad for row in rows))


if __name__ == "__main__":
    sys.exit(main())
