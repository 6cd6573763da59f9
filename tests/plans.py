"""Plans of the instruments in tests, as texts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from isorig.rig.files.tomlfile import table_text

#: Channels of the wire bonder and their inputs.
INPUTS = {"head": 0, "motor": 1, "table": 2, "heatblock": 3}


def plan_text(
    *runs: Mapping[str, Any], channels: Mapping[str, int] = INPUTS, rate: float = 1024.0, sensitivity: float = 1.0,
    **instrument: Any,
) -> str:  # fmt: skip
    """A plan of moves measured by a framed stream, unless the runs and the instrument say otherwise."""
    tables = [
        table_text("instrument", {"kind": "framed", "port": "by hand", "sample_rate": rate, **instrument}),
        table_text("channels", {name: {"input": k, "sensitivity": sensitivity} for name, k in channels.items()}),
        *(
            table_text("runs", {"configuration": "unlocked", "gain": 70.0, "excitation": "moves", **run}, many=True)
            for run in runs
        ),
    ]
    return "\n".join(line for table in tables for line in table)
