"""What the operator's screen costs: 8 channels at 51.2 kHz recorded while the screen is open.

    python bench/view.py [--seconds SECONDS]

One page answers each frame at once, another never reads what it is sent. Prints the share of one core that the recording process
used, and the screen's own process beside it; the frames that the pages took; what was stored and lost.
"""

from __future__ import annotations

import asyncio
import json
import multiprocessing
import socket
import tempfile
import threading
import time
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import psutil
from acquire import CHANNELS, RATE, instrument
from table import Row, keep, options
from tornado.httpclient import HTTPRequest
from tornado.websocket import websocket_connect

from isorig.rig.acquire.plan import Plan, plan_of
from isorig.rig.acquire.rig_operator import Operator
from isorig.rig.acquire.session import acquire
from isorig.rig.view.messages import planned_by
from isorig.rig.view.process import session_screen
from isorig.rig.view.server import read_frame
from isorig.rig.view.session_control import SessionControl

#: Rows of a frame of the instrument: the shortest of `bench/acquire.py`, and a usual one.
ROWS = (64, 256)


def plan_over(seconds: float) -> Plan:
    """One run with a band, so that coherence and transfer functions are worked out."""
    run = {"id": "a", "configuration": "unlocked", "gain": 1.0, "excitation": "random", "band": [1.0, 2000.0], "seconds": seconds}
    return plan_of(
        {
            "instrument": {"kind": "framed", "port": "", "sample_rate": RATE},
            "channels": {"head" if k == 0 else f"c{k}": {"input": k, "sensitivity": 1.0} for k in range(CHANNELS)},
            "runs": [run],
        }
    )


def upgrade(address: str) -> HTTPRequest:
    """A page's request for the socket of its screen."""
    parts = urlsplit(address)
    return HTTPRequest(f"ws://{parts.netloc}{parts.path}live", headers={"Origin": f"http://{parts.netloc}"})


def quick(address: str, drawn: list[int]) -> None:
    """A page that answers each frame at once; `drawn` gets the bytes of each."""

    async def answer() -> None:
        page = await websocket_connect(upgrade(address))
        while isinstance(message := await page.read_message(), bytes):
            head, plots = read_frame(message)
            drawn.append(len(message))
            values = sum(rows.size for rows in plots.values())
            await page.write_message(json.dumps({"say": "drawn", "frame": head["frame"], "values": int(values)}))

    asyncio.run(answer())


def stalled(address: str) -> socket.socket:
    """A page that never reads."""
    parts = urlsplit(address)
    wire = socket.create_connection((parts.hostname, parts.port))
    request = (
        f"GET {parts.path}live HTTP/1.1\r\nHost: {parts.netloc}\r\nOrigin: http://{parts.netloc}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    )
    wire.sendall(request.encode())
    return wire


def measure(seconds: float, rows: int) -> dict[str, float]:
    """Shares of a core and counts of one recording."""
    ours, theirs = multiprocessing.Pipe()
    far_end = multiprocessing.Process(target=instrument, args=(theirs, rows), daemon=True)
    far_end.start()
    plan, port = plan_over(seconds), ours.recv()
    looks: list[tuple[float, float, float, int]] = []
    taken: list[Any] = []
    drawn: list[int] = []
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "c.h5"
        control = SessionControl(planned_by(plan), output, asks=False)
        with session_screen(control) as address:
            (beside,) = (p for p in psutil.Process().children() if "isorig.rig.view" in p.cmdline())
            threading.Thread(target=quick, args=(address, drawn), daemon=True).start()
            still = stalled(address)

            def watch(live: Any) -> None:
                used = beside.cpu_times()
                looks.append((time.process_time(), used.user + used.system, time.monotonic(), len(drawn)))

            operator = control.operator(Operator(lock=lambda _: None, watch=watch, taken=taken.append))
            acquire(plan, port, output, operator, force=True)
            still.close()
    far_end.terminate()
    far_end.join()
    first, last = looks[2], looks[-2]
    length = last[2] - first[2]
    tally = taken[0].tally
    return {
        "seconds": length, "recorder": (last[0] - first[0]) / length, "screen": (last[1] - first[1]) / length,
        "frames": (last[3] - first[3]) / length, "stored": tally.stored, "lost": tally.lost,
    }  # fmt: skip


def main(seconds: float) -> list[Row]:
    """A row for each length of frame."""
    kept: list[Row] = []
    print(f"{CHANNELS} channels at {RATE:g} Hz, 32 bits, with the screen open in one page and another that stands still")
    print(f"{'rows of a frame':>15} {'seconds':>8} {'recorder %':>10} {'screen %':>9} {'frames/s':>9} {'stored':>9} {'lost':>5}")
    for rows in ROWS:
        got = measure(seconds, rows)
        shares = f"{100.0 * got['recorder']:>10.1f} {100.0 * got['screen']:>9.1f}"
        print(f"{rows:>15} {got['seconds']:>8.1f} {shares} {got['frames']:>9.1f} {got['stored']:>9.0f} {got['lost']:>5.0f}")
        lost = f"lost samples: {got['lost']:.0f}"
        for who, key in (("the recording", "recorder"), ("the screen", "screen")):
            what = f"frames of {rows} rows, {who}"
            kept.append(Row(what=what, unit="% of a processor", ours=100.0 * got[key], limit=lost))
    return kept


if __name__ == "__main__":
    parser = options(__doc__)
    parser.add_argument("--seconds", type=float, help="length of each recording: 20, or 10 with --quick")
    given = parser.parse_args()
    keep(main(given.seconds or (10.0 if given.quick else 20.0)), given.rows)
