"""What recording costs: 8 channels at 51.2 kHz from a framed instrument in another process, over a pseudo-terminal.

    python bench/acquire.py [--seconds SECONDS]

Prints the share of one core that the recording process used, and what was lost, for frames of several lengths and for several
times between two syncs of the working file (`rig acquire --sync`).
"""

from __future__ import annotations

import multiprocessing
import tempfile
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from table import Row, keep, options

from isorig.drivers.simulated.commanded import Simulation
from isorig.drivers.simulated.framed import SimulatedFramed
from isorig.drivers.simulated.served import PtyWire, exchange
from isorig.rig.acquire.plan import plan_of
from isorig.rig.acquire.rig_operator import Operator
from isorig.rig.acquire.session import acquire

RATE, CHANNELS = 51200.0, 8
#: Rows of a frame and seconds between syncs; without end there is none while the run lasts, with 0 one after every block.
CASES = ((64, 1.0), (256, 1.0), (1024, 1.0), (256, 1e9), (256, 0.1), (256, 0.0))


class Noise:
    """Random counts on eight inputs."""

    identity = "noise"
    inputs = (CHANNELS, "V", 1e-6, 4000.0)

    def play(self, drive: Any, *, sample_rate: float, gain: float, configuration: str) -> Any:
        """Counts, shape (n, 8)."""
        return np.random.default_rng(0).integers(-(2**23), 2**23, (len(drive), CHANNELS), dtype=np.int32)


def instrument(pipe: Connection, rows: int) -> None:
    """The far end, in real time."""
    wire = PtyWire()
    pipe.send(wire.port)
    exchange(wire, SimulatedFramed(Noise(), Simulation(), rows=rows), lambda: False)


def measure(seconds: float, rows: int, sync: float) -> tuple[float, float, int, int]:
    """Seconds looked at, CPU share in them, samples stored and lost."""
    ours, theirs = multiprocessing.Pipe()
    process = multiprocessing.Process(target=instrument, args=(theirs, rows), daemon=True)
    process.start()
    plan = plan_of(
        {
            "instrument": {"kind": "framed", "port": "", "sample_rate": RATE},
            "channels": {"head" if k == 0 else f"c{k}": {"input": k, "sensitivity": 1.0} for k in range(CHANNELS)},
            # With a band the coherence so far is worked out as well.
            "runs": [
                {
                    "id": "a", "configuration": "unlocked", "gain": 1.0, "excitation": "random", "band": [1.0, 2000.0],
                    "seconds": seconds,
                }
            ],
        }
    )  # fmt: skip
    looks: list[tuple[float, float]] = []
    taken: list[Any] = []
    operator = Operator(
        lock=lambda _: None, watch=lambda live: looks.append((time.process_time(), time.monotonic())), taken=taken.append
    )
    with tempfile.TemporaryDirectory() as folder:
        acquire(plan, ours.recv(), Path(folder) / "c.h5", operator, force=True, sync=sync)
    process.terminate()
    (cpu0, wall0), (cpu1, wall1) = looks[2], looks[-2]
    return wall1 - wall0, (cpu1 - cpu0) / (wall1 - wall0), taken[0].tally.stored, taken[0].tally.lost


def main(seconds: float) -> list[Row]:
    """A row for each length of frame."""
    rows_kept: list[Row] = []
    print(f"{CHANNELS} channels at {RATE:g} Hz, 32 bits")
    print(f"{'rows of a frame':>15} {'sync, s':>8} {'seconds':>8} {'% of a core':>12} {'stored':>9} {'lost':>5}")
    for rows, sync in CASES:
        length, share, stored, lost = measure(seconds, rows, sync)
        shown = "none" if sync > seconds else f"{sync:g}"
        print(f"{rows:>15} {shown:>8} {length:>8.1f} {100.0 * share:>12.1f} {stored:>9} {lost:>5}")
        what = f"frames of {rows} rows, " + ("no sync" if sync > seconds else f"sync every {sync:g} s")
        rows_kept.append(Row(what=what, unit="% of a processor", ours=100.0 * share, limit=f"lost samples: {lost}"))
    return rows_kept


if __name__ == "__main__":
    parser = options(__doc__)
    parser.add_argument("--seconds", type=float, help="length of each recording: 20, or 6 with --quick")
    given = parser.parse_args()
    keep(main(given.seconds or (6.0 if given.quick else 20.0)), given.rows)
