"""A mapping proposed from what the files hold; what was guessed says so."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from rig.errors import RecordingError
from rig.exchange.importing import JITTER
from rig.exchange.mapping import RESERVED
from rig.exchange.table import Column, ForeignTable
from rig.exchange.units import known_unit

#: Words in a column's name, and the wire bonder's channel that they stand for.
WORDS = (("heatblock", "heatblock"), ("heat", "heatblock"), ("prey", "heatblock"), ("table", "table"), ("head", "head"),
         ("drive", "head"), ("motor", "motor"))  # fmt: skip


def draft_mapping(tables: Sequence[ForeignTable], folder: Path) -> str:
    """A mapping in TOML: one run a file, one channel a column that all files have.

    Raises
    ------
    RecordingError
        Where the files have no column in common.
    """
    shared = [name for name in tables[0].columns if all(name in table.columns for table in tables)]
    time = next((name for name in shared if all(is_time(name, t.columns[name]) for t in tables)), None)
    # Columns that were sampled together have one length: the most common one.
    lengths = Counter(len(tables[0].columns[name].values) for name in shared)
    usual = lengths.most_common(1)[0][0] if lengths else 0
    sources = [name for name in shared if name != time and len(tables[0].columns[name].values) == usual]
    if not sources:
        raise RecordingError(
            f"{', '.join(str(t.path) for t in tables)} have no column in common; propose a mapping for each alone"
        )
    lines = ["# Proposed from the files. Lines marked with ? were guessed: check each.", "", "[rig]"]
    lines += ["# What is known beforehand, SI: head_mass, motor_mass, heatblock_mass, table_mass, friction_force ...", ""]
    taken: set[str] = set()
    for source in sources:
        lines += _channel(source, tables[0].columns[source], taken)
    ids: set[str] = set()
    for table in tables:
        lines += _run(table, time, sources, folder, ids)
    return "\n".join(lines)


def is_time(name: str, column: Column) -> bool:
    """Whether a column holds evenly spaced seconds: by its name and its values."""
    if not re.fullmatch(r"(.*[./])?(t|time|zeit|seconds|x_?value)([ _]?s)?", name, re.IGNORECASE):
        return False
    values = np.asarray(column.values, dtype=np.float64)
    if len(values) < 2 or not np.isfinite(values).all() or values[-1] <= values[0]:
        return False
    grid = np.linspace(values[0], values[-1], len(values))
    return bool(np.abs(values - grid).max() <= JITTER * (grid[1] - grid[0]))


def _channel(source: str, column: Column, taken: set[str]) -> list[str]:
    name = _name(source, taken)
    found = known_unit(column.unit)
    values = np.asarray(column.values, dtype=np.float64)
    note = "" if found else f"    # ? {f'the file says {column.unit!r}' if column.unit else 'the file does not say'}"
    return [
        f"[channels.{name}]    # {len(values)} values from {values.min():.4g} to {values.max():.4g}, rms {values.std():.4g}",
        f"source = {_quoted(source)}",
        f"unit = {_quoted(found or 'm/s^2')}{note}",
        "sensitivity = 1.0    # ? column's unit per unit, e.g. V per m/s^2",
        'place = ""',
        "",
    ]


def _name(source: str, taken: set[str]) -> str:
    plain = re.sub(r"\W+", "_", source).strip("_").lower() or "channel"
    name = next((channel for word, channel in WORDS if word in plain and channel not in taken), plain)
    if name in RESERVED or not name.isidentifier():
        name = f"channel_{name}"
    while name in taken:
        name += "_2"
    taken.add(name)
    return name


def _run(table: ForeignTable, time: str | None, sources: Sequence[str], folder: Path, ids: set[str]) -> list[str]:
    stem = table.path.stem
    name = stem if stem not in ids else f"{stem}_{len(ids)}"
    ids.add(name)
    locked = re.search(r"(?<!un)lock|(?<![a-z])l\d", stem, re.IGNORECASE) is not None
    gain = re.search(r"(?:gain|(?<![a-z])[ul])[ _-]?(\d+(?:\.\d+)?)", stem, re.IGNORECASE)
    rates = {table.columns[source].sample_rate for source in sources}
    rate = rates.pop() if len(rates) == 1 else None
    lines = [
        "[[runs]]",
        f"id = {_quoted(name)}",
        f"file = {_quoted(Path(os.path.relpath(table.path.resolve(), folder.resolve())).as_posix())}",
        f'configuration = "{"locked" if locked else "unlocked"}"    # ?',
        f"gain = {float(gain[1]) if gain else 1.0}    # ?",
        'excitation = "other"    # ? random, multisine, sweep, moves, free or other',
    ]
    if time is not None:
        lines.append(f"time = {_quoted(time)}")
    elif rate is not None:
        lines.append(f"sample_rate = {rate!r}")
    else:
        lines.append("# sample_rate = 1024.0    # ? the file does not say; without it nothing can be imported")
    return [*lines, ""]


def _quoted(text: str) -> str:
    # A JSON string is a TOML basic string.
    return msgspec.json.encode(text).decode()
