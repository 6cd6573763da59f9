"""What a display or a trace of an analyzer shows; the analyzer itself does not tell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class Shows:
    """A trace by the instrument's name for it (a display's number, a feed), and what its values are."""

    trace: str
    kind: Literal["time", "spectrum"]
    unit: str
