"""Proposes a mapping from the content of files; guesses are marked."""

import itertools
import os
import re
import unicodedata
from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from isorig.analysis.campaign import MOTION, ROTARY, UNLOCKED, Quantity
from isorig.analysis.model.drafted import DAMPING, MASS, STIFFNESS
from isorig.analysis.model.rig_model import GROUND, Body, Configuration, Drive, Link, RigModel, Sensor
from isorig.analysis.wording import words
from isorig.rig.errors import RecordingError
from isorig.rig.exchange.clock import (
    RATE_AGREES,
    column_rate,
    is_clock,
    is_even,
    restarts,
    rises_evenly,
    run_numbers,
    sample_counter,
    says_time,
    seconds_per,
    time_unit,
)
from isorig.rig.exchange.table import STREAMED, UNNAMED, UNTITLED, Column, ForeignTable
from isorig.rig.exchange.tree import PLAIN, SHORT, rate_of
from isorig.rig.exchange.units import OTHER_UNITS, UNITS, known_unit
from isorig.rig.files.recording import GAIN, RESERVED, VALUE_MOST
from isorig.rig.files.rigfile import description_text
from isorig.rig.files.tomlfile import value_text

#: Words in the name of a channel that records the imposed motion of a base.
BASES = ("base", "ground", "floor", "foundation", "basis", "boden")
#: Words in a column's name, and the wire bonder's channel that they denote.
WORDS = (("heatblock", "heatblock"), ("heat", "heatblock"), ("prey", "heatblock"), ("table", "table"), ("head", "head"),
         ("drive", "head"), ("motor", "motor"))  # fmt: skip

#: Words in a column's name, and the unit guessed if the file does not give it.
QUANTITIES = (
    ("force", "N"), ("kraft", "N"), ("displacement", "m"), ("position", "m"), ("weg", "m"), ("angular_velocity", "rad/s"),
    ("velocity", "m/s"), ("current", "A"), ("strom", "A"), ("voltage", "V"), ("spannung", "V"), ("torque", "N m"),
    ("angle", "rad"), ("winkel", "rad"),
)  # fmt: skip
#: Words in a column's name or unit that denote the counts of an encoder.
COUNTED = ("count", "encoder", "pulses", "ticks", "increments")
#: Endings of names that are more often a letter than a unit: the axis of a sensor, a second channel.
AMBIGUOUS = ("A", "V", "m", "1", "in")
#: Symbols after which such an ending is a unit: u_V, i_A, x_m.
SYMBOLS = {"V": "u|v|voltage|spannung", "A": "i|current|strom", "m": "x|y|z|s|d|position|displacement|weg"}
#: What a released rig needs in its mapping.
FREE = 'write excitation = "free" in every run of the mapping'
_RUN = r"(?P<after>(?:run|trial|test|rep|experiment|measurement|versuch|lauf|messung)[ _-]?\d+)"
#: Names of records with the run or the part of a benchmark: data[1][0], run1_force, force_run1, uEst and uVal.
RUN_FORMS = tuple(
    re.compile(rf"(?P<before>){form}", re.IGNORECASE)
    for form in (
        r"(?P<after>[^./]+\[\d+\])(?P<name>\[[\d,]+\])",
        rf"{_RUN}[ _-]?(?P<name>[^./]+)",
        rf"(?P<name>[^./]+?)[ _-]?{_RUN}",
        r"(?P<name>\w+?)_?(?P<after>est|val|test|train|estimation|validation|training)",
    )
)
#: Single numbers of a file that are listed at most.
NUMBERS_MOST = 12
#: Words of a file name that denote a channel, also with a number.
CHANNEL = re.compile(
    r"(?:ch|chan|channel|kanal|voie|sensor|ai|in|input|out|output|mic|acc|accel|acceleration|beschleunigung|vib|laser|disp|pos|vel|speed)"
    r"\d*|[xyz]",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class _Part:
    # Columns of a file with a common sampling: name in the draft, and source with its column; sentences on those left out; the
    # part of the rows, if they are several runs; the files of channels that are not in the table's.
    table: ForeignTable
    group: str
    columns: dict[str, tuple[str, Column]]
    time: str | None
    counts: tuple[str, ...] = ()
    samples: tuple[int, int] | None = None
    files: Mapping[str, Path] = field(default_factory=dict)


def draft_mapping(tables: Sequence[ForeignTable], folder: Path, description_file: str) -> tuple[str, str]:
    """A mapping in TOML: one run for each commonly sampled part of a file, with the channels that it has.

    If the columns are not those of the wire bonder, a description of a rig in TOML is proposed too, otherwise "". The mapping is
    to be in `folder`, and names the description there. Raises RecordingError if no file contains a time record.
    """
    parts = [part for table in tables for group, columns in _groups(table).items() for part in _parts(table, group, columns)]
    if not parts:
        raise RecordingError(_no_records(tables))
    parts = _joined(parts)
    lines = ["# Proposed from the files. Lines marked with ? were guessed: check each.", ""]
    lines += [f"# {table.path.name}: {remark}." for table in tables for remark in (*table.remarks, *_further_numbers(table))]
    lines += dict.fromkeys(f"# {part.table.path.name}: {count}." for part in parts for count in part.counts)
    # A column is one channel in all parts that have it; if parts have different columns, each lists its own.
    places = dict.fromkeys(place for part in parts for place in part.columns)
    names: dict[str, str] = {}
    first = {place: next(part.columns[place] for part in parts if place in part.columns) for place in places}
    bonder = _is_bonder(places)
    for place in places:
        names[place] = _name(place, first[place][1], set(names.values()), WORDS if bonder else ())
    if bonder:
        known = "# What is known beforehand, SI: head_mass, motor_mass, heatblock_mass, table_mass, friction_force ..."
        lines += ["[rig]", known, ""]
    else:
        lines += [
            "# The rig's description: masses, springs, drive, sensors. See docs/describe.md; rig describe --new asks for one.",
            f"description = {value_text(description_file)}    # ?", "",
        ]  # fmt: skip
    for place in places:
        lines += _channel(names[place], *first[place])
    # What each channel measures, without the gain.
    kinds = {
        names[place]: UNITS[_unit_of(names[place], column, source)].quantity
        for place, (source, column) in first.items()
        if not bonder and names[place] != GAIN
    }
    ids: list[str] = []
    for part in parts:
        text = _run_text(part)
        ids.append(text if text not in ids else f"{text}_{len(ids)}")
    starts = _starts(dict(zip(ids, parts, strict=True)), names) if _released(kinds) else {}
    setups = ids if len(starts) > 1 else _configurations(parts)
    # A rig without locks has one configuration, which needs no name.
    named = bonder or set(setups) != {UNLOCKED}
    excitation = "free" if _released(kinds) else "other"
    for name, setup, part in zip(ids, setups, parts, strict=True):
        own = [names[place] for place in part.columns] if len(part.columns) < len(places) else []
        other = {names[p]: source for p, (source, _) in part.columns.items() if source != first[p][0]}
        lines += _run(name, part, own, other, folder, setup if named else "", excitation)
        files = {names[p]: _relative(path, folder) for p, path in part.files.items()}
        lines[-1:] = [f"files = {value_text(files)}    # ? of one run, by their names", ""] if files else [""]
    configurations = {setup: starts.get(name, Configuration()) for name, setup in zip(ids, setups, strict=True)}
    return "\n".join(lines), "" if bonder else _rig(kinds, dict(sorted(configurations.items(), reverse=not starts)))


def _relative(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()


def _joined(parts: list[_Part]) -> list[_Part]:
    # Files with different channels as runs, if their names and columns say so. Those of a run have one length, rate and clock.
    if any(part.samples for part in parts) or len({part.table.path for part in parts}) < len(parts):
        return parts
    named = [{(column.label or name, column.unit) for name, (_, column) in part.columns.items()} for part in parts]
    runs = runs_of([part.table.path for part in parts], named, [word for word, _ in QUANTITIES])
    # How many words of files have a column of this name; a name that says nothing is as if several had it.
    meant = {word: {name for name, _ in named[at]} for files in runs.values() for word, at in files.items()}
    several = Counter(itertools.chain(*meant.values())) + Counter(dict.fromkeys((*PLAIN, UNNAMED), 2))
    found: list[_Part] = []
    for run, files in runs.items():
        there = {word: parts[at] for word, at in files.items()}
        first = next(iter(there.values()))
        unlike = next((part.table.path.name for part in there.values() if not _simultaneous(first, part)), None)
        if unlike is not None:
            said = f"it seems to be of one run with {unlike}, but differs in length, rate or clock, so each is a run"
            found += [replace(first, counts=(*first.counts, said)), *list(there.values())[1:]]
            continue
        columns: dict[str, tuple[str, Column]] = {}
        others: dict[str, Path] = {}
        for word, part in there.items():
            for name, (source, column) in part.columns.items():
                called = column.label or name
                own = several[called] == 1
                place = called if own else word if len(part.columns) == 1 else f"{word}_{called}"
                columns[place] = (source, column if own else replace(column, label=""))
                others |= {} if part is first else {place: part.table.path}
        counts = dict.fromkeys(count for part in there.values() for count in part.counts)
        found.append(replace(first, group=run, counts=tuple(counts), columns=columns, files=others))
    return found or parts


def _simultaneous(one: _Part, other: _Part) -> bool:
    # Of the same length, and with the same clock or rate.
    records = [next(iter(part.columns.values()))[1] for part in (one, other)]
    clocks = [part.table.columns[part.time] for part in (one, other) if part.time is not None]
    rates = [_known_rate(part, record) for part, record in zip((one, other), records, strict=True)]
    same = abs(rates[0] / rates[1] - 1.0) <= RATE_AGREES if rates[0] and rates[1] else rates[0] == rates[1]
    alike = len(records[0].values) == len(records[1].values) and same
    return alike and all(np.array_equal(clock.values, clocks[0].values) for clock in clocks)


def _known_rate(part: _Part, record: Column) -> float | None:
    # By the clock, otherwise by the file.
    clock = None if part.time is None else part.table.columns[part.time]
    if part.time is None or clock is None or not is_even(part.time, clock):
        return record.sample_rate
    return column_rate(part.time, clock, "")


def _further_numbers(table: ForeignTable) -> list[str]:
    # Single numbers of a file may be scales or calibrations.
    rates = _stated_rates(table)
    plain = [f"{name} = {number:.6g}" for name, number in table.numbers.items() if name not in rates]
    few = ((name, column.values.tolist()) for name, column in table.columns.items() if 1 < len(column.values) < SHORT)
    plain += [f"{name} = {values}" for name, values in few]
    return [f"further numbers of the file, perhaps scales of channels: {', '.join(plain[:NUMBERS_MOST])}"] if plain else []


def _stated_rates(table: ForeignTable) -> dict[str, float]:
    # Sample rates by the names of the numbers that state them, anywhere in a file.
    found = {name: rate_of(re.split(r"[./]", name)[-1], number) for name, number in table.numbers.items()}
    return {name: rate for name, rate in found.items() if rate is not None and 1.0 / VALUE_MOST < rate < VALUE_MOST}


def _is_bonder(places: Iterable[str]) -> bool:
    # Two of its channels by name, and none that says it is something else than an acceleration.
    plain = [re.sub(r"\W+", "_", place).strip("_").lower() for place in places]
    found = {channel for name in plain for channel in [next((c for word, c in WORDS if word in name), None)] if channel}
    other = any(word in name for name in plain for word, _ in QUANTITIES if any(w in name for w, _ in WORDS))
    return len(found) >= 2 and not other


def _released(kinds: Mapping[str, Quantity]) -> bool:
    # A single motion is a response, also as the voltage of its sensor: no column is a drive.
    return len(kinds) == 1 and all(kind in MOTION or kind == "voltage" for kind in kinds.values())


def _starts(parts: Mapping[str, _Part], names: Mapping[str, str]) -> dict[str, Configuration]:
    # By run: a body that was pulled aside starts where its position, the only record, begins.
    found = {}
    for run, part in parts.items():
        ((place, (source, column)),) = part.columns.items()
        unit = UNITS[_unit_of(names[place], column, source)]
        values = np.asarray(column.values[slice(*(part.samples or (None,)))], dtype=np.float64)
        values = values[np.isfinite(values)]
        if MOTION.get(unit.quantity) == 0 and len(values):
            start = float(f"{float(values[0]) / column.sensitivity * unit.factor:.3g}")
            found[run] = Configuration(initial_position={f"body_{names[place]}": start})
    return found


def _rig(kinds: Mapping[str, Quantity], configurations: Mapping[str, Configuration]) -> str:
    # One body a motion sensor, in a row from the ground; the first channel that is no motion drives the last of them.
    released = _released(kinds)
    moved = next((name for name in kinds if any(word in name for word in BASES)), next(iter(kinds), "drive"))
    drive = next((name for name, kind in kinds.items() if kind not in MOTION), moved)
    if released:
        drive = "push" if "push" not in kinds else "push_2"
    others = [name for name in kinds if name != drive]
    # Where no unit is that of a motion, each record is proposed as one.
    moving = [name for name in others if kinds[name] in MOTION]
    sensed = moving or others or ["first"]
    quantity = kinds.get(drive, "torque" if kinds.get(sensed[-1]) in ROTARY else "force")
    # A measured motion of a base is imposed.
    based = quantity in MOTION and any(word in drive for word in BASES)
    bodies = tuple(
        Body(name=f"body_{name}", mass=MASS, motion="rotation" if kinds.get(name) in ROTARY else "straight")
        for name in ([drive, *sensed] if based else sensed)
    )
    below = [f"body_{drive}" if based else GROUND, *(f"body_{name}" for name in sensed)]
    links = tuple(
        Link(name=f"link_{name}", a=f"body_{name}", b=support, stiffness=STIFFNESS, damping=DAMPING)
        for name, support in zip(sensed, below, strict=False)
    )
    driven = f"body_{sensed[-1]}"
    pushed = Drive(channel=drive, quantity=quantity, factor=1.0, pushes={driven: 1.0})
    model = RigModel(
        name="rig", bodies=bodies, links=links,
        drive=Drive(channel=drive, quantity=quantity, imposes=f"body_{drive}") if based else pushed,
        sensors=tuple(
            Sensor(channel=name, body=f"body_{name}", quantity=kinds[name] if moving else "acceleration")
            for name in sensed if name in kinds
        ),
        configurations=dict(configurations),
        free=tuple(f"links.{link.name}.{key}" for link in links for key in ("stiffness", "damping")),
    )  # fmt: skip
    drive_note = f"? that it pushes {driven} is a guess, and so is factor, the force per unit of the channel"
    if based:
        drive_note = "? the channel is the imposed motion of the base; if it is a force instead, give pushes and factor"
    elif released:
        drive_note = (
            f"? no column is a drive: if {driven} was pulled and let go, {FREE},\n"
            "so that rig import records a drive of zero, and correct initial_position, where it starts"
        )
    elif kinds.get(drive) in MOTION:
        drive_note += (
            '; if it is\nthe motion of a base, add that body and write imposes = "BODY" in place of pushes and factor;\n'
            "if the rig was pulled and let go, make this channel a sensor, name a drive without a column, and\n" + FREE
        )
    return description_text(model, {
        "": "Proposed from the columns of the files: how many bodies there are and how they are joined is a guess,\n"
        "and so is every number. Correct it after docs/describe.md, then call rig describe with this file.",
        "bodies": "? kg, for a rotation kg m^2",
        "links": "? stiffness and damping: N/m and N s/m, for a rotation N m/rad and N m s/rad",
        "drive": drive_note,
        "configurations": "? initial_position: where the records begin, m or rad from the position of rest" if released else "",
        "sensors": "" if moving else "? no unit is that of a motion: give unit and sensitivity in the mapping, and quantity here",
    })  # fmt: skip


def _no_records(tables: Sequence[ForeignTable]) -> str:
    path = tables[0].path
    spectra = [spectrum for table in tables for spectrum in table.spectra]
    kinds = {spectrum.kind for spectrum in spectra}
    if "transfer_function" in kinds:
        count = sum(spectrum.kind == "transfer_function" for spectrum in spectra)
        return (
            f"{path} contains {count} transfer functions and no time record; a recording needs time records, so export those "
            f"too, or draw the transfer functions with rig frf {path}"
        )
    if spectra:
        text = ", ".join(sorted(map(words, kinds)))
        return (
            f"{path} contains only spectra without phase ({text}); neither modes nor parameters can be fitted to them, so export "
            "the time records or the transfer functions"
        )
    longest = max((len(column.values) for table in tables for column in table.columns.values()), default=0)
    if 0 < longest < SHORT:
        return (
            f"{path} has columns of {longest} values, but a time record has at least {SHORT}; export the time records as columns"
        )
    remarks = "; ".join(remark for table in tables for remark in table.remarks)
    return f"{path} contains no time record{f' ({remarks})' if remarks else ''}; export the time records as columns"


def _groups(table: ForeignTable) -> dict[str, dict[str, tuple[str, Column]]]:
    # Columns by the part before the last dot or slash, or after #: if groups have the same names, each group is a run.
    groups: dict[str, dict[str, tuple[str, Column]]] = {}
    # An estimation and a validation part of a benchmark are runs, too.
    records = [source for source, column in table.columns.items() if not is_clock(source, column)]
    matched = ({source: form.fullmatch(source) for source in records} for form in RUN_FORMS)
    parts = next((each for each in matched if all(each.values()) and len({m["after"] for m in each.values() if m}) > 1), {})
    for source, column in table.columns.items():
        found = parts.get(source) or re.fullmatch(r"(?:(?P<before>.*)[./])?(?P<name>[^./#]+)(?:#(?P<after>\d+))?", source)
        group, name = ("", source) if found is None else (found["before"] or found["after"] or "", found["name"])
        groups.setdefault(group, {})[name] = (source, column)
    # Runs of an array, or of numbered names, have one clock.
    inner = next((columns for group, columns in groups.items() if group.isdigit() or (group and parts)), {})
    clocks = {name: place for name, place in groups.get("", {}).items() if name not in inner and is_clock(name, place[1])}
    if parts and len(clocks) == len(groups.get("", {})):
        groups.pop("", None)
    groups = {group: {**(clocks if group.isdigit() or parts else {}), **columns} for group, columns in groups.items()}
    groups = _by_structure(groups)
    alike = Counter(frozenset(columns) for columns in groups.values()).most_common(1)
    if alike and alike[0][1] == len(groups) and not _one_each(groups):
        return groups
    return {"": {source: (source, column) for source, column in table.columns.items()}} if table.columns else {}


def _by_structure(groups: dict[str, dict[str, tuple[str, Column]]]) -> dict[str, dict[str, tuple[str, Column]]]:
    # Structures with one array each whose names are repeated (run1.force.data, run2.force.data) are channels of several runs.
    if not _one_each(groups):
        return groups
    outer: dict[str, dict[str, tuple[str, Column]]] = {}
    for group, columns in groups.items():
        before, _, channel = group.replace("/", ".").rpartition(".")
        for name, place in columns.items():
            outer.setdefault(before, {})[name if is_clock(name, place[1]) else channel] = place
    common = set.intersection(*(set(before.split(".")) for before in outer))
    named = {"_".join(part for part in before.split(".") if part not in common): columns for before, columns in outer.items()}
    return named if 1 < len(named) == len(outer) and len({frozenset(columns) for columns in outer.values()}) == 1 else groups


def _one_each(groups: Mapping[str, Mapping[str, tuple[str, Column]]]) -> bool:
    # Structures with one plain array each (a.values, b.values) are channels, not runs, also if each repeats the clock.
    # The same holds for groups that name their only channel.
    clocks: dict[int, Column] = {}
    for columns in groups.values():
        records = [
            name for name, (source, column) in columns.items() if not is_clock(name, column) and not _may_be_time(source, column)
        ]
        if len(records) > 1 or not all(name.lower() in PLAIN or columns[name][1].label for name in records):
            return False
        for clock in (column for name, (_, column) in columns.items() if name not in records):
            if not np.array_equal(clocks.setdefault(len(clock.values), clock).values, clock.values):
                return False
    return len(groups) > 1


def _parts(table: ForeignTable, group: str, columns: Mapping[str, tuple[str, Column]]) -> list[_Part]:
    # Columns of equal length and rate were sampled together; clocks belong to the records of their length.
    # One that is not even is proposed, too: the import says where rows are missing.
    clocks = {name: len(column.values) for name, (_, column) in columns.items() if is_clock(name, column)}
    sampled: dict[tuple[int, float | None], dict[str, tuple[str, Column]]] = {}
    for name, (source, column) in columns.items():
        if name not in clocks and len(column.values) > 1:
            sampled.setdefault((len(column.values), column.sample_rate), {})[name] = (source, column)
    runs: list[_Part] = []
    for (size, _), there in sampled.items():
        if size >= SHORT:
            time = next((columns[name][0] for name, n in clocks.items() if n == size), None)
            runs += _runs_of(_part(table, group, there, time))
    return runs


def _runs_of(part: _Part) -> list[_Part]:
    # The runs in the rows of a part: where its clock starts again, or a column that numbers the runs changes.
    size = len(next(iter(part.columns.values()))[1].values)
    numbering = {name: at for name, (_, column) in part.columns.items() if len(at := run_numbers(name, column))}
    again = () if part.time is None else restarts(part.table.columns[part.time]).tolist()
    edges = np.unique([0, *again, *(row for at in numbering.values() for row in at), size]).tolist()
    records = {name: place for name, place in part.columns.items() if name not in numbering}
    if len(edges) == 2 or not records:
        return [part]
    counts = tuple(f"column {name!r} numbers the runs, so it is no channel and left out" for name in numbering)
    return [
        replace(part, columns=records, counts=(*part.counts, *counts), samples=samples) for samples in itertools.pairwise(edges)
    ]


def _part(table: ForeignTable, group: str, there: dict[str, tuple[str, Column]], time: str | None) -> _Part:
    # Without the columns that are no records; a clock may have any name, if no other column is one.
    said: dict[str, str] = {}
    for name, (source, column) in there.items():
        if (found := sample_counter(column)) is not None:
            said[name] = f"column {source!r} {found[0]}, so it is no channel and left out" + (f"; {found[1]}" if found[1] else "")
        elif says_time(name, column) and not is_clock(name, column):
            said[name] = f"column {source!r} does not ascend evenly, so it is no clock and left out"
        elif column.unit in OTHER_UNITS or says_time(name, column):
            said[name] = f"column {source!r} is in {column.unit or 's'}, which is no unit of a channel, so it is left out"
    rising = (name for name, (source, column) in there.items() if name not in said and _may_be_time(source, column))
    clock = time or next((there[name][0] for name in rising), None)
    if clock is None and next(iter(there.values()))[1].sample_rate is None:
        even = [source for name, (source, column) in there.items() if name not in said and column.whole and is_even("", column)]
        asked = "rises evenly from row to row: if it is a clock, write time = {!r} and its time_unit, and delete its channel"
        counted = tuple(f"column {source!r} {asked.format(source)}" for source in even)
    else:
        counted = ()
    # Programs write the same clock once for each channel.
    same = {name for name, (_, c) in there.items() if clock and np.array_equal(c.values, table.columns[clock].values)}
    records = {name: place for name, place in there.items() if name not in {*said, *same}}
    return _Part(table, group, records, clock, (*said.values(), *counted)) if records else _Part(table, group, there, time)


def _may_be_time(source: str, column: Column) -> bool:
    # A column without a unit, and without the name of a quantity, that rises evenly.
    named = column.unit or _unit_in(column.label, source) or any(word in source.lower() for word, _ in QUANTITIES)
    return not named and rises_evenly(column)


def _channel(name: str, source: str, column: Column) -> list[str]:
    found = known_unit(column.unit)
    values = np.asarray(column.values, dtype=np.float64)
    finite = values[np.isfinite(values)]
    extent = f" from {finite.min():.4g} to {finite.max():.4g}" if len(finite) else ""
    absent = "by the column's name" if _unit_in(column.label, source) and not column.unit else "not given by the file"
    note = "" if found else f"    # ? {f'the file gives {column.unit!r}' if column.unit else absent}"
    sensitivity = "1.0    # ? column's unit per unit, e.g. V per m/s^2"
    if _counted(name, column, source):
        note = "    # ? counts of an encoder: rad, or m if it is straight"
        sensitivity = "1.0    # ? counts in one unit, for rad counts per turn / (2 pi)"
    if column.sensitivity != 1.0:
        sensitivity = f"{column.sensitivity!r}    # ? by the file, which has {column.sensitivity:g} of its units in one of these"
    return [
        f"[channels.{name if name.isascii() else value_text(name)}]    # {len(values)} values{extent}",
        f"source = {value_text(source)}",
        f"unit = {value_text(_unit_of(name, column, source))}{note}",
        f"sensitivity = {sensitivity}",
        'place = ""',
        "",
    ]


def _counted(name: str, column: Column, source: str) -> bool:
    # Whether a column without a known unit has the counts of an encoder: whole numbers.
    if known_unit(column.unit) or _unit_in(column.label, source):
        return False
    said = " ".join((name, source, column.label, column.unit)).lower()
    return any(word in said for word in COUNTED) and column.whole


def _unit_of(name: str, column: Column, source: str) -> str:
    usual = "rad" if _counted(name, column, source) else "m/s^2"
    guess = next((unit for word, unit in QUANTITIES if word in name.lower()), usual)
    return known_unit(column.unit) or ("1" if name == GAIN else _unit_in(column.label, source) or guess)


def _unit_in(*names: str) -> str | None:
    # The unit at the end of a column's label or name.
    return next((unit for name in names if (unit := _parted(name)[1])), None)


def _parted(name: str) -> tuple[str, str | None]:
    # A label or name without the unit at its end, and that unit: encoder_angle_deg, force_kN, Kraft (N), gyro [deg/s].
    if (words := re.search(r"[\s_]([mµμun]?m|rad|deg)_(s2?)$", name)) and (unit := known_unit(f"{words[1]}/{words[2]}")):
        return name[: words.start()], unit
    bracketed = re.search(r"[\[(]([^\[\]()]+)[)\]]$", name)
    found = bracketed or re.search(r"[\s_.\-(\[]([^\s_.\-()\[\]]+)[)\]]?$", name)
    if not found or not (unit := known_unit(found[1])):
        return name, None
    rest = name[: found.start()]
    symbol = re.fullmatch(SYMBOLS.get(unit, "(?!)"), rest, re.IGNORECASE)
    return (name, None) if found[1] in (("1",) if bracketed or symbol else AMBIGUOUS) else (rest, unit)


def _name(source: str, column: Column, taken: set[str], words: Sequence[tuple[str, str]]) -> str:
    text = column.label or source
    text = _parted(text)[0] or text
    # An identifier has no superscripts.
    plain = re.sub(r"\W+", "_", unicodedata.normalize("NFKC", text)).strip("_").lower() or "channel"
    if plain in (GAIN, STREAMED) and GAIN not in taken and UNITS[known_unit(column.unit) or "1"].quantity == GAIN:
        return GAIN
    name = next((channel for word, channel in words if word in plain and channel not in taken), plain)
    if name in (*RESERVED, GAIN) or not name.isidentifier():
        name = f"channel_{name}"
    while name in taken:
        name += "_2"
    return name


def _run_text(part: _Part) -> str:
    # A program's default name of a group says nothing.
    group = re.split(r"[./]", part.group)[-1]
    stem = part.table.path.stem
    return f"{stem}_{group}" if group.isdigit() else stem if not group or UNTITLED.fullmatch(group) else group


def _configurations(parts: Sequence[_Part]) -> list[str]:
    # By the word, or, where other runs are called u70 or the like, by names like l70: alone these may be levels.
    texts = [_run_text(part) for part in parts]
    short = any(re.search(r"(?<![a-z])u\d", text, re.IGNORECASE) for text in texts)
    locked = re.compile(r"(?<!un)lock" + (r"|(?<![a-z])l\d" if short else ""), re.IGNORECASE)
    return ["locked" if locked.search(text) else UNLOCKED for text in texts]


def _run(
    name: str, part: _Part, own: Sequence[str], other: Mapping[str, str], folder: Path, configuration: str, excitation: str
) -> list[str]:
    table, group, text = part.table, part.group, _run_text(part)
    guess = re.search(r"(?:gain|(?<![a-z])[ul])[ _-]?(\d+(?:\.\d+)?)", text, re.IGNORECASE)
    gain = table.numbers.get(f"{group}.gain", table.numbers.get("gain")) or (float(guess[1]) if guess else 0.0) or 1.0
    rate = next(column.sample_rate for _, column in part.columns.values())
    lines = [
        "[[runs]]",
        f"id = {value_text(name)}",
        f"file = {value_text(_relative(table.path, folder))}",
        *([f'configuration = "{configuration}"    # ?'] if configuration else []),
        f"gain = {gain}    # ?",
        f'excitation = "{excitation}"    # ? random, multisine, sweep, moves, free or other',
    ]
    if part.time is not None:
        known = says_time(part.time, table.columns[part.time])
        lines.append(f"time = {value_text(part.time)}" + ("" if known else "    # ? its values rise evenly"))
        clock = table.columns[part.time]
        unit = time_unit(part.time, clock)
        if not clock.unit or seconds_per(unit) != 1.0:
            piece = replace(clock, values=clock.values[slice(*(part.samples or (None,)))])
            # The rate to which a guessed unit leads shows whether it is right.
            leads = f" then the sample rate is {column_rate(part.time, piece, ''):.6g} Hz" if is_even(part.time, piece) else ""
            lines.append(f"time_unit = {value_text(unit)}" + ("" if seconds_per(clock.unit) else f"    # ?{leads}"))
    elif rate is not None:
        lines.append(f"sample_rate = {rate!r}")
    else:
        rates = _stated_rates(table)
        said = [f"sample_rate = {rate!r}    # ? the file states it as {name!r}" for name, rate in rates.items()]
        # A frequency in the name of a file may be that of its drive.
        named = re.search(r"(?<![\d.,])(\d+(?:[.,]\d+)?)[ _-]?(k?)(?:hz|sps)", table.path.stem, re.IGNORECASE)
        hertz = float(named[1].replace(",", ".")) * (1e3 if named[2] else 1.0) if named else 1024.0
        only = f" except perhaps in its name, {named[0]!r}" if named else ""
        absent = f"# sample_rate = {hertz!r}    # ? not given by the file{only}; required for the import"
        lines.append(said[0] if len(set(rates.values())) == 1 else absent)
    if part.samples is not None:
        lines.append(f"samples = {value_text(list(part.samples))}")
    if own:
        lines.append(f"channels = {value_text(own)}")
    if other:
        lines.append(f"sources = {value_text(other)}")
    return [*lines, ""]


def runs_of(
    paths: Sequence[Path], records: Sequence[Set[Hashable]], quantities: Sequence[str]
) -> Mapping[str, Mapping[str, int]]:
    """The runs of files with different channels: by run, the index of each file by its word. Empty if they are no such files.

    The names, with their folders, have as many words. One of these denotes the channels: it is a word for a channel, or contains
    one of those for `quantities`; or, if no word does, files with another word have none of the same `records`, the name and
    unit of each column.
    """
    if len(paths) < 2:
        return {}
    whole = [path.absolute().with_suffix("").parts for path in paths]
    common = next((k for k, parts in enumerate(zip(*whole, strict=False)) if len({*parts}) > 1), 0)
    names = [tuple(re.split(r"[\s_./-]+", "/".join(parts[common:]))) for parts in whole]
    if len({*map(len, names)}) > 1:
        return {}
    varied = [place for place, words in enumerate(zip(*names, strict=True)) if len({*words}) > 1]
    said = [place for place in varied if all(_denotes_channel(name[place], quantities) for name in names)]
    for place in said or varied:
        runs: dict[tuple[str, ...], dict[str, int]] = {}
        meant: dict[str, set[frozenset[Hashable]]] = {}
        for at, (name, record) in enumerate(zip(names, records, strict=True)):
            runs.setdefault((*name[:place], *name[place + 1 :]), {})[name[place]] = at
            meant.setdefault(name[place], set()).add(frozenset(record))
        one_each = sum(map(len, runs.values())) == len(paths) and all(len(each) == 1 for each in meant.values())
        sets = [record for (record, *_) in meant.values()]
        if one_each and (said or len(frozenset().union(*sets)) == sum(map(len, sets))):
            return {"_".join(rest) or "run": files for rest, files in runs.items()}
    return {}


def _denotes_channel(word: str, quantities: Sequence[str]) -> bool:
    return CHANNEL.fullmatch(word) is not None or any(each in word.lower() for each in quantities)
