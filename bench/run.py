"""Run all benchmarks and write docs/bench.md, their results with ratios to other packages, of which README.md shows six.

    python bench/run.py [--quick] [NAME ...]

With names, only these benchmarks run, and only their sections of the page are replaced. Each one waits until no other program
uses the processors, and is not written if one did meanwhile. After 40 minutes the run ends, with whatever has been measured. The
exit status is 1 if a benchmark failed, was disturbed or not begun.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import psutil
from others import OtherPrograms
from table import Row

HERE = Path(__file__).parent
PAGE, README = HERE.parent / "docs" / "bench.md", HERE.parent / "README.md"
#: Title of each benchmark's section.
NAMES = {
    "simulate": "The simulator: time and error",
    "spectra": "Transfer functions: time and memory",
    "damping": "Damping ratios: bias",
    "accuracy": "Damping ratios: coverage and width of intervals",
    "acquire": "Recording: share of a processor",
    "view": "The operator's screen: share of a processor",
    "design": "The design study: time",
    "diagnose": "Diagnoses: time",
    "fleet": "A fleet: time",
    "commands": "Commands: time from call to end",
}
#: Benchmarks that measure processor time, which does not contain what a hypervisor takes: 5 to 15 % of a processor while
#: recordings wake a virtual computer a thousand times a second.
PROCESSOR_TIME = ("acquire", "view")
#: What README.md shows: benchmark, quantity and other package or method as in its table, and the quantity in words.
SHOWN = (
    ("simulate", "time of one simulated second", "scipy RK45, thesis's law, force straight", "time of a simulation"),
    ("simulate", "error of the slip speed, rms over rms", "scipy RK45, thesis's law, force straight", "error of a simulation"),
    ("simulate", "time of one simulated second", "diffrax Tsit5, arctan 1e-4", "time of a simulation"),
    ("spectra", "time", "pyFRF, no copy", "time of transfer functions"),
    ("spectra", "time", "scipy welch, csd, coherence", "time of transfer functions"),
    ("damping", "164.5 Hz, accelerance, 4.7 frequency bins in the bandwidth", "pyEMA", "bias of a damping ratio"),
)
#: Marks around these ratios in README.md.
MARKS = "<!-- ratios of docs/bench.md -->\n", "<!-- end -->"
#: Share of one processor that other programs may use before and during a benchmark; seconds of each look, and longest wait in s.
#: Chosen: the services of a computer at rest take less than 2 %; a program that takes 5 % shifts medians by as much.
QUIET, LOOK, PATIENCE = 0.05, 5.0, 600.0
#: Seconds between two looks at other programs while a benchmark runs: a look takes a hundredth of a second.
EVERY = 2.0
#: Runs of a benchmark that is disturbed.
ATTEMPTS = 2
#: Time limit of the whole run in s, of which the benchmarks take a bit more than half on two processors.
WHOLE = 2400.0
PEERS = (
    "numpy", "scipy", "numba", "pyFRF", "pyEMA", "pyOMA-2", "diffrax", "jax", "mujoco", "scikit-sundae", "pydvma", "sdynpy",
)  # fmt: skip
HEAD = """# Benchmarks

`make bench` runs all benchmarks and writes this page; `make bench QUICK=--quick` uses fewer repetitions. Each benchmark is one
file in `bench/`, which prints further figures. Values are medians, with the smallest and the largest value of the repetitions, in
which isorig and the others take turns. The ratio is the other value divided by that of isorig: a ratio above 1 means that the
other package or method takes longer or has the larger error. Times depend on the computer, ratios only slightly.
"""


def wait_until_quiet(look: float = LOOK, patience: float = PATIENCE, *, hypervisor: bool = True) -> str:
    """Wait until no other program uses the processors; why it was in vain, or nothing.

    Parameters
    ----------
    look, patience
        Seconds of each look, and the longest wait.
    hypervisor
        Whether the time that a hypervisor takes counts.
    """
    began = time.monotonic()
    while True:
        others = OtherPrograms(hypervisor=hypervisor)
        time.sleep(look)
        share = others.look() / look
        if share <= QUIET:
            return ""
        used = f"{100.0 * share:.0f} % of a processor, most of it {others.most}"
        if time.monotonic() - began > patience:
            return f"Not measured: for {patience:.0f} s other programs used {used}."
        print(f"waiting: other programs use {used}", flush=True)


def undisturbed(name: str, quick: bool, end: float) -> tuple[list[Row], str]:
    """Run a benchmark alone on the computer, again if it was disturbed; its rows, and why it failed or was disturbed.

    At the time `end` on the monotonic clock it is stopped.
    """
    wrong, hypervisor = "", name not in PROCESSOR_TIME
    for _ in range(ATTEMPTS):
        left = end - time.monotonic()
        if left <= 0.0:
            return [], wrong or f"Not begun: the {WHOLE / 60.0:g} minutes of the run are over; run it alone."
        waited = wait_until_quiet(patience=min(PATIENCE, left), hypervisor=hypervisor)
        if waited:
            return [], waited
        began, others = time.monotonic(), OtherPrograms(hypervisor=hypervisor)
        rows, failed = measure(name, quick, others, end)
        share = others.look() / (time.monotonic() - began)
        if failed or share <= QUIET:
            return rows, failed
        used = f"{100.0 * share:.0f} % of a processor meanwhile, most of it {others.most}"
        wrong = f"Not measured: other programs used {used}; end them and run it again."
        print(wrong, flush=True)
    return [], wrong


def measure(name: str, quick: bool, others: OtherPrograms, end: float) -> tuple[list[Row], str]:
    """Run a benchmark until the time `end` while looking at other programs; return its rows, and the reason if it failed."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rows.json"
        call = [sys.executable, str(HERE / f"{name}.py"), "--rows", str(path), *(["--quick"] if quick else [])]
        with subprocess.Popen(call) as process:
            while process.poll() is None:
                if time.monotonic() > end:
                    # With its own children, which would go on computing.
                    for child in psutil.Process(process.pid).children(recursive=True):
                        child.kill()
                    process.kill()
                    return [], f"`bench/{name}.py` was stopped: the {WHOLE / 60.0:g} minutes of the run are over; run it alone."
                with suppress(subprocess.TimeoutExpired):
                    process.wait(EVERY)
                others.look()
        if process.returncode or not path.exists():
            return [], f"`bench/{name}.py` ended with status {process.returncode}."
        return [Row(**row) for row in json.loads(path.read_text(encoding="utf-8"))], ""


def table(rows: Sequence[Row]) -> str:
    """Rows as a table in Markdown."""
    lines = ["| quantity | isorig | other package or method | its value | ratio | limit |", "|---|---|---|---|---|---|"]
    for row in rows:
        theirs = "" if row.theirs is None else _shown(row.theirs, row.unit, row.theirs_spread)
        ratio = "" if row.ratio is None else f"{row.ratio:.3g}"
        ours = _shown(row.ours, row.unit, row.ours_spread)
        lines.append(f"| {row.what} | {ours} | {row.peer} | {theirs} | {ratio} | {row.limit} |")
    return "\n".join(lines)


def _shown(value: float, unit: str, spread: Sequence[float] | None) -> str:
    # JSON has the spread as a list.
    return f"{value:.3g} {unit}".rstrip() + (f" ({spread[0]:.3g} to {spread[1]:.3g})" if spread else "")


def machine(quick: bool) -> str:
    """The computer, its load, and the versions of the packages."""
    versions = []
    for name in PEERS:
        try:
            versions.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            versions.append(f"{name} not installed")
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    repeats = "with few repetitions (`--quick`)" if quick else "with all repetitions"
    return (
        f"Measured on {cores} processors ({platform.machine()}, load {os.getloadavg()[0]:.1f} at the start), {repeats}; "
        f"Python {platform.python_version()}, {', '.join(versions)}."
    )


def sections_of(page: str) -> dict[str, str]:
    """The page's sections by title."""
    parts = re.split(r"^## (.*)\n\n", page, flags=re.MULTILINE)
    return dict(zip(parts[1::2], (part.strip() for part in parts[2::2]), strict=True))


def ratios(page: str) -> str:
    """The ratios that README.md shows, as a table with the command of each; without those that the page lacks."""
    sections = sections_of(page)
    lines = ["| quantity | other package or method | its value / isorig's | command |", "|---|---|---|---|"]
    for name, what, peer, words in SHOWN:
        for row in sections.get(NAMES[name], "").splitlines():
            cells = [cell.strip() for cell in row.split("|")[1:-1]]
            if len(cells) == 6 and (cells[0], cells[2]) == (what, peer):
                lines.append(f"| {words} | {peer} | {float(cells[4]):,.3g} | `python bench/{name}.py` |")
    return "\n".join(lines) + "\n"


def write_readme() -> None:
    """Write the page's ratios into README.md."""
    text = README.read_text(encoding="utf-8")
    before, rest = text.split(MARKS[0])
    after = rest.split(MARKS[1], 1)[1]
    README.write_text(before + MARKS[0] + ratios(PAGE.read_text(encoding="utf-8")) + MARKS[1] + after, encoding="utf-8")


def write_section(name: str, text: str) -> None:
    """Write a benchmark's section into the page, replacing the previous one."""
    page = PAGE.read_text(encoding="utf-8") if PAGE.exists() else ""
    sections = sections_of(page) | {NAMES[name]: text.strip()}
    ordered = [f"## {title}\n\n{sections[title]}\n" for title in NAMES.values() if title in sections]
    PAGE.write_text("\n".join([HEAD, *ordered]), encoding="utf-8")


def main() -> int:
    """Run the benchmarks and write the page, section by section."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[[], *NAMES], help="the benchmarks to run; by default all")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions")
    given = parser.parse_args()
    failures, end = [], time.monotonic() + WHOLE
    for name in given.names or NAMES:
        print(f"\n== {name}", flush=True)
        began, where = time.perf_counter(), machine(given.quick)
        rows, wrong = undisturbed(name, given.quick, end)
        took = f"`python bench/{name}.py` took {time.perf_counter() - began:.0f} s. {where}"
        if wrong:
            failures.append(f"{name}: {wrong}")
        else:
            write_section(name, f"{table(rows)}\n\n{took}\n")
            print(f"\n{table(rows)}\n", flush=True)
    write_readme()
    print("\n".join(failures) or f"written to {PAGE.relative_to(HERE.parent)}")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
