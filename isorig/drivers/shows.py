"""Contents of an analyzer's displays or traces, which the analyzer does not report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class Shows:
    """A trace by the instrument's name for it (a display's number, a feed), and the meaning of its values."""

    trace: str
    kind: Literal["time", "spectrum"]
    unit: str
