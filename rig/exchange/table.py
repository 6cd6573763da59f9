"""What a foreign file holds, whatever its format: columns by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.measured import Spectrum


@dataclass(frozen=True, kw_only=True)
class Column:
    """A record of a file: its values as they stand there, shape (n,), its rate in Hz and its unit where the file says them."""

    values: NDArray[Any]
    sample_rate: float | None = None
    unit: str = ""


@dataclass(frozen=True, kw_only=True)
class ForeignTable:
    """The columns of a file, the single numbers beside them, and spectra that it holds."""

    path: Path
    columns: Mapping[str, Column]
    numbers: Mapping[str, float] = field(default_factory=dict)
    spectra: tuple[Spectrum, ...] = ()


def columns_of(name: str, values: NDArray[Any], sample_rate: float | None = None, unit: str = "") -> dict[str, Column]:
    """A vector as one column; a matrix as one column for each of its shorter side, called name[0], name[1] ..."""
    values = np.squeeze(np.asarray(values))
    if values.ndim == 1:
        return {name: Column(values=values, sample_rate=sample_rate, unit=unit)}
    if values.ndim != 2:
        return {}
    tall = values if values.shape[0] >= values.shape[1] else values.T
    return {f"{name}[{k}]": Column(values=tall[:, k], sample_rate=sample_rate, unit=unit) for k in range(tall.shape[1])}
