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
    """A mapping in TOML: one run a file or a group of columns inside it, one channel a name that all of them have.

    Raises
    ------
    RecordingError
        Where they have no column in common.
    """
    groups = [(table, group, columns) for table in tables for group, columns in _groups(table).items()]
    if not groups:
        raise RecordingError(f"{tables[0].path} holds spectra alone; a recording needs time records, so export those too")
    first = groups[0][2]
    shared = [name for name in first if all(name in columns for _, _, columns in groups)]
    time = next((name for name in shared if all(is_time(name, c[name][1]) for _, _, c in groups)), None)
    # Columns that were sampled together have one length: the most common one.
    usual = Counter(len(first[name][1].values) for name in shared).most_common(1)
    channels = [name for name in shared if name != time and len(first[name][1].values) == usual[0][0]]
    if not channels:
        named = ", ".join(str(table.path) for table in tables)
        raise RecordingError(f"{named} have no column in common; propose a mapping for each alone")
    lines = ["# Proposed from the files. Lines marked with ? were guessed: check each.", "", "[rig]"]
    lines += ["# What is known beforehand, SI: head_mass, motor_mass, heatblock_mass, table_mass, friction_force ...", ""]
    names: dict[str, str] = {}
    for place in channels:
        names[place] = _name(place, set(names.values()))
        lines += _channel(names[place], *first[place])
    ids: set[str] = set()
    for table, group, columns in groups:
        sources = {names[place]: columns[place] for place in channels}
        plain = {names[place]: first[place][0] for place in channels}
        other = {name: source for name, (source, _) in sources.items() if source != plain[name]}
        lines += _run(table, group, None if time is None else columns[time][0], sources, other, folder, ids)
    return "\n".join(lines)


def _groups(table: ForeignTable) -> dict[str, dict[str, tuple[str, Column]]]:
    """Columns by what stands before the last dot or slash, or after #: where groups hold the same names, each is a run."""
    groups: dict[str, dict[str, tuple[str, Column]]] = {}
    for source, column in table.columns.items():
        found = re.fullmatch(r"(?:(?P<before>.*)[./])?(?P<name>[^./#]+)(?:#(?P<after>\d+))?", source)
        group, name = ("", source) if found is None else (found["before"] or found["after"] or "", found["name"])
        groups.setdefault(group, {})[name] = (source, column)
    alike = Counter(frozenset(columns) for columns in groups.values()).most_common(1)
    if alike and alike[0][1] == len(groups):
        return groups
    return {"": {source: (source, column) for source, column in table.columns.items()}} if table.columns else {}


def is_time(name: str, column: Column) -> bool:
    """Whether a column holds evenly spaced seconds: by its name and its values."""
    if not re.fullmatch(r"(.*[./])?(t|time|zeit|seconds|x_?value)([ _]?s)?", name, re.IGNORECASE):
        return False
    values = np.asarray(column.values, dtype=np.float64)
    if len(values) < 2 or not np.isfinite(values).all() or values[-1] <= values[0]:
        return False
    grid = np.linspace(values[0], values[-1], len(values))
    return bool(np.abs(values - grid).max() <= JITTER * (grid[1] - grid[0]))


def _channel(name: str, source: str, column: Column) -> list[str]:
    found = known_unit(column.unit)
    values = np.asarray(column.values, dtype=np.float64)
    note = "" if found else f"    # ? {f'the file says {column.unit!r}' if column.unit else 'the file does not say'}"
    return [
        f"[channels.{name}]    # {len(values)} values from {values.min():.4g} to {values.max():.4g}",
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
    return name


def _run(
    table: ForeignTable, group: str, time: str | None, sources: dict[str, tuple[str, Column]], other: dict[str, str],
    folder: Path, ids: set[str],
) -> list[str]:  # fmt: skip
    told = re.split(r"[./]", group)[-1] or table.path.stem
    name = told if told not in ids else f"{told}_{len(ids)}"
    ids.add(name)
    locked = re.search(r"(?<!un)lock|(?<![a-z])l\d", told, re.IGNORECASE) is not None
    guess = re.search(r"(?:gain|(?<![a-z])[ul])[ _-]?(\d+(?:\.\d+)?)", told, re.IGNORECASE)
    gain = _number(table, group, ("gain",)) or (float(guess[1]) if guess else 1.0)
    rates = {column.sample_rate for _, column in sources.values()}
    rate = (rates.pop() if len(rates) == 1 else None) or _number(table, group, ("sample_rate", "fs", "Fs"))
    lines = [
        "[[runs]]",
        f"id = {_quoted(name)}",
        f"file = {_quoted(Path(os.path.relpath(table.path.resolve(), folder.resolve())).as_posix())}",
        f'configuration = "{"locked" if locked else "unlocked"}"    # ?',
        f"gain = {gain}    # ?",
        'excitation = "other"    # ? random, multisine, sweep, moves, free or other',
    ]
    if time is not None:
        lines.append(f"time = {_quoted(time)}")
    elif rate is not None:
        lines.append(f"sample_rate = {rate!r}")
    else:
        lines.append("# sample_rate = 1024.0    # ? the file does not say; without it nothing can be imported")
    if other:
        lines.append(f"sources = {{ {', '.join(f'{name} = {_quoted(source)}' for name, source in other.items())} }}")
    return [*lines, ""]


def _number(table: ForeignTable, group: str, names: Sequence[str]) -> float | None:
    # A single number that stands in the file, beside the columns or at its top.
    places = [f"{group}.{name}" if group else name for name in names] + list(names)
    return next((table.numbers[place] for place in places if place in table.numbers), None)


def _quoted(text: str) -> str:
    # A JSON string is a TOML basic string.
    return msgspec.json.encode(text).decode()
