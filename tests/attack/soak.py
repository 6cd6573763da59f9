"""A long session at the full rate, with its page open: every value compared, memory of every process watched.

    python tests/attack/soak.py SECONDS SEED

Each sample says which tick and input it is. The page is loaded anew all the time. Prints one line; exit status 1 if a value is
lost or wrong, or if a process grows.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import psutil

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "rig" / "acquire"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "rig" / "view"))

from pages import Socket
from ramps import ramp_instrument

from isorig.rig.files.recording import open_recording

RATE, INPUTS = 51200, 8
#: Seconds of a run, of a connection of the page, and between two looks at the memory.
RUN, CONNECTION, LOOK = 120.0, 15.0, 2.0
#: Growth of a process between the first and the second half of the session that counts as growing, MiB.
GROWTH = 32.0
#: Samples compared at once.
PART = 1 << 20


def plan(seconds: float) -> str:
    """The session: equal runs of all inputs without a band, so that the page averages all frequencies."""
    run = min(RUN, seconds / 4.0)
    channels = "\n".join(f"c{k} = {{input = {k}, sensitivity = 1.0}}" for k in range(1, INPUTS))
    return (
        f'[instrument]\nkind = "framed"\nport = "by hand"\nsample_rate = {RATE}.0\n[channels]\n'
        f"head = {{input = 0, sensitivity = 1.0}}\n{channels}\n"
        f'[[runs]]\nid = "a"\nconfiguration = "unlocked"\ngain = 1.0\nexcitation = "moves"\nseconds = {run}\n'
        f"repeats = {max(round(seconds / run), 1)}\n"
    )


def anonymous(pid: int) -> float:
    """Memory of a process without that of files, MiB: pages of libraries belong to all processes that have loaded them."""
    lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) / 1024.0 for line in lines if line.startswith("RssAnon:"))


class Memory:
    """Memory of a process over time, MiB."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self.seen: list[float] = []

    def look(self) -> None:
        """Measure once; a process that has ended is not measured."""
        with suppress(OSError, StopIteration):
            self.seen.append(anonymous(self._pid))

    @property
    def halves(self) -> tuple[float, float]:
        """The highest value in each half; the first quarter is the start."""
        kept = self.seen[len(self.seen) // 4 :]
        return max(kept[: len(kept) // 2], default=0.0), max(kept[len(kept) // 2 :], default=0.0)


def watch_page(address: str, over: threading.Event, counts: dict[str, int]) -> None:
    """Draw the page's frames, and load it anew again and again."""
    while not over.is_set():
        end = time.monotonic() + CONNECTION
        try:
            page = Socket(address)
            counts["connections"] += 1
            while time.monotonic() < end and not over.is_set():
                page.frame()
                counts["frames"] += 1
            del page
        except (EOFError, OSError, AssertionError):
            time.sleep(0.2)


def compared(recording: Path) -> tuple[int, int, int]:
    """Values stored, ticks lost, and values that are not those that were sent."""
    stored = lost = wrong = 0
    with open_recording(recording) as campaign:
        for run in campaign.runs:
            lost += sum(gap.count for gap in run.gaps)
            for k, channel in enumerate(run.channels[name] for name in ["head", *(f"c{k}" for k in range(1, INPUTS))]):
                for start in range(0, len(run), PART):
                    values = np.asarray(channel.samples[start : start + PART])
                    ticks = np.arange(start, start + len(values))
                    for gap in run.gaps:
                        ticks[ticks >= gap.first_tick] += gap.count
                    stored += len(values)
                    wrong += int((values != ticks * 4 + k).sum())
    return stored, lost, wrong


def main(seconds: float, seed: int) -> int:
    """Run the session; 1 if anything is wrong."""
    counts = {"connections": 0, "frames": 0}
    over = threading.Event()
    with tempfile.TemporaryDirectory(prefix="soak-") as folder, ramp_instrument(speed=1.0, rows=64, inputs=INPUTS) as (port, _):
        place = Path(folder)
        (place / "plan.toml").write_text(plan(seconds), encoding="utf-8")
        call = [
            sys.executable,
            "-P",
            "-m",
            "isorig",
            "acquire",
            str(place / "plan.toml"),
            "--port",
            port,
            "-o",
            str(place / "c.h5"),
        ]
        with subprocess.Popen([*call, "--force", "--yes", "--view", "--json"], stdout=subprocess.PIPE, text=True) as session:
            assert session.stdout is not None
            address = json.loads(session.stdout.readline())["address"]
            memories = [Memory(session.pid), *(Memory(child.pid) for child in psutil.Process(session.pid).children())]
            threading.Thread(target=watch_page, args=(address, over, counts), daemon=True).start()
            threading.Thread(target=session.stdout.read, daemon=True).start()
            while session.poll() is None:
                for memory in memories:
                    memory.look()
                time.sleep(LOOK)
        over.set()
        stored, lost, wrong = compared(place / "c.h5")
    (recorder, after), (screen, later) = memories[0].halves, memories[1].halves
    grown = after > recorder + GROWTH or later > screen + GROWTH
    print(
        f"{seconds / 3600.0:.3g} hours of {INPUTS} inputs at {RATE / 1000:g} kHz through the framed stream with the page open: "
        f"{stored} values stored, {lost} ticks lost, {wrong} values wrong. Memory of the recording process {recorder:.0f} MiB in "
        f"the first half and {after:.0f} MiB in the second, of the page's process {screen:.0f} and {later:.0f} MiB. "
        f"{counts['frames']} frames over {counts['connections']} connections of the page."
    )
    return int(bool(lost or wrong or grown or session.returncode))


if __name__ == "__main__":
    sys.exit(main(float(sys.argv[1]), int(sys.argv[2])))
