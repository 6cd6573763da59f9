"""A frame of the screen as bytes: a header in JSON, and the numbers of the plots that have changed, as float32.

::

    uint32 little-endian   length of the header in bytes, a multiple of 4
    header                 JSON, padded with spaces: {"frame": 7, "state": {...}, "plots": {"frf": {"names": [...],
                           "rows": 16, "points": 600, "at": 0}}}
    float32 little-endian  the plots' rows in sequence; "at" is the index of the first number of a plot
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np

from isorig.rig.view.snapshot import Plot


def frame(number: int, state: Mapping[str, Any], plots: Mapping[str, Plot]) -> bytes:
    """One message."""
    at, heads, numbers = 0, {}, []
    for name, plot in plots.items():
        rows, points = plot.rows.shape
        heads[name] = {"names": plot.names, "rows": rows, "points": points, "at": at}
        numbers.append(plot.rows.astype("<f4").tobytes())
        at += plot.rows.size
    head = msgspec.json.encode({"frame": number, "state": state, "plots": heads})
    head += b" " * (-len(head) % 4)
    return b"".join([struct.pack("<I", len(head)), head, *numbers])


def read_frame(message: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and plots of a message, for programs other than browsers."""
    (length,) = struct.unpack_from("<I", message)
    head = msgspec.json.decode(message[4 : 4 + length])
    numbers = np.frombuffer(message, "<f4", offset=4 + length)
    plots = {
        name: numbers[about["at"] : about["at"] + about["rows"] * about["points"]].reshape(about["rows"], about["points"])
        for name, about in head["plots"].items()
    }
    return head, plots
