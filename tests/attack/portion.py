"""Some power-loss images, or some faults of a driver, in a process of its own: a line of JSON tells what became of them.

python tests/attack/portion.py images|DRIVER COUNT SEED
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
import tempfile
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS / "drivers"), str(TESTS / "rig" / "acquire")]


def images(count: int, seed: int) -> dict[str, int]:
    """Number of images of each kind; an assertion fails at the first wrong one."""
    from power import look_at

    # What `rig recover` prints is not the answer.
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        seen = look_at(count, Path(folder), 2 * seed)
    # Those without an answer held nothing that was synced; they are of a kind, too.
    seen.pop("without an answer", None)
    return dict(seen)


def faults(driver: str, count: int, seed: int) -> dict[str, int]:
    """Number of faults by their outcome; those that must not be are printed one by one."""
    from campaign import run

    outcome = run(driver, count, seed)
    for told in outcome.bad:
        print(json.dumps({"case": driver, "wrong": told}))
    return dict(outcome.counts)


if __name__ == "__main__":
    WHAT, COUNT, SEED = sys.argv[1:]
    print(json.dumps(images(int(COUNT), int(SEED)) if WHAT == "images" else faults(WHAT, int(COUNT), int(SEED))))
