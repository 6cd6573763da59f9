"""Converts named arrays, numbers and texts of a file to a table; searches for rates, units and frequency axes near them."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from isorig.analysis.campaign import FloatArray, Spectrum
from isorig.rig.errors import RecordingError
from isorig.rig.exchange.clock import clock_of, is_time, run_numbers, says_time
from isorig.rig.exchange.table import COLUMNS_MOST, Column, ForeignTable, vectors_of
from isorig.rig.exchange.units import known_unit

#: Names of a sample rate (Hz) and of a sample interval (s), in lower case without separators.
RATES = frozenset((
    "fs", "samplerate", "samplingrate", "samplefrequency", "samplingfrequency", "srate", "fsamp", "fsample", "abtastrate",
    "samplespersecond", "fshz", "sampleratehz",
))  # fmt: skip
STEPS = frozenset((
    "dt", "ts", "deltat", "tsample", "sampletime", "sampleinterval", "samplinginterval", "samplingperiod", "samplingtime",
    "increment", "xincrement", "xincr", "wfincrement", "delta", "dts",
))  # fmt: skip
FREQUENCIES = frozenset(("f", "freq", "freqs", "frequency", "frequencies", "frequenz", "hz", "fhz", "freqhz", "frequencyhz"))
#: Parts of a structure with its abscissa, and generic names that add nothing to their structure's name.
#: Units that may follow such a name: Hz in one of a rate, s in one of an interval.
RATE_UNITS, STEP_UNITS = {"": 1.0, "hz": 1.0, "khz": 1e3, "mhz": 1e6}, {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
#: Names of lists with a text for each channel of an array next to them: its name, or its unit.
NAME_LISTS = frozenset((
    "names", "channels", "channelnames", "channellabels", "labels", "columns", "columnnames", "variables", "variablenames",
    "signals", "signalnames", "sensors", "sensornames",
))  # fmt: skip
UNIT_LISTS = frozenset(("unit", "units", "channelunits", "columnunits", "variableunits", "signalunits", "sensorunits"))
ABSCISSAE = ("x_values", "x", "abscissa", "time", "quantity")
UNIT_WORDS = ("unit", "units")
#: Separator after an array's name for its own attributes (attributes of a dataset).
OWN = "#"
PLAIN = frozenset(("values", "value", "data", "y", "samples", "signal", "h"))
#: Keys of a structure that name it, in order of preference, and structures that only contain the array (Simulink's `signals`).
NAMES = ("name", "channel", "label", "id", "title")
WRAPPERS = ("signals", "y_values")
#: Names of a column of words that names the channel of each row.
LONG = frozenset(("channel", "kanal", "signal", "sensor", "variable", "measurement", "series", "tag", "name", "field"))
#: Words of two columns with the parts of complex values.
PARTS = (
    ("real", "imag"), ("real", "imaginary"), ("re", "im"), ("magnitude", "phase"), ("mag", "phase"), ("amplitude", "phase"),
    ("db", "deg"), ("db", "phase"),
)  # fmt: skip
#: Columns with fewer values next to longer ones are settings, not records.
SHORT = 16
#: A real column of transfer functions with values between 0 and this is a coherence.
COHERENT = 1.0 + 1e-9


T = TypeVar("T")


@dataclass(frozen=True)
class _Content:
    # Content of a file, by name: the names of the structures around it and its own, joined by `dot`.
    dot: str
    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)
    numbers: dict[str, float] = field(default_factory=dict)
    words: dict[str, str] = field(default_factory=dict)
    texts: dict[str, NDArray[Any]] = field(default_factory=dict)

    def around(self, name: str) -> list[str]:
        # The structures around a name, innermost first, each with its separator; the last one is the file.
        parts = name.split(self.dot)[:-1]
        return [self.dot.join(parts[:k]) + self.dot for k in range(len(parts), 0, -1)] + [""]

    def within(self, structure: str, found: Mapping[str, T]) -> dict[str, T]:
        # What is directly in a structure, by its own name.
        inner = {name[len(structure) :]: value for name, value in found.items() if name.startswith(structure)}
        return {name: value for name, value in inner.items() if self.dot not in name}

    def plain(self, name: str) -> str:
        # The own name of an item, without separators of words.
        return _plain(name.rsplit(self.dot, 1)[-1])


def _plain(name: str) -> str:
    return re.sub(r"[\W_]", "", name.lower())


def rate_of(name: str, number: float) -> float | None:
    """The sample rate in Hz that a number of a file states by its name ("fs", "dt", "rate_kHz" ...); None if it states none."""
    plain = _plain(name)
    for names, units in ((RATES, RATE_UNITS), (STEPS, STEP_UNITS)) if number > 0.0 else ():
        for unit, factor in units.items():
            if plain.endswith(unit) and plain.removesuffix(unit) in names:
                return number * factor if names is RATES else 1.0 / (number * factor)
    return None


def table_of(path: Path, items: Iterable[tuple[str, Any]], remarks: Sequence[str] = (), dot: str = ".") -> ForeignTable:
    """A table of a file's items: name, and array, number or text; names are preceded by their structures, joined by `dot`."""
    content = _Content(dot)
    for name, value in items:
        _add(name, value, content)
    columns: dict[str, Column] = {}
    spectra: list[Spectrum] = []
    said = list(remarks)
    elements = Counter(name.rpartition("[")[0] for name in content.arrays)
    for name, number, values in _by_run(content):
        shape = tuple(n for n in values.shape if n > 1)
        axes = _sample_axes(name, shape, content)
        vectors = {f"{one}{number}": v for one, v in vectors_of(name, values, axes[0] if len(axes) == 1 else None).items()}
        if vectors and len(shape) > 1 and len(axes) != 1 and sorted(shape)[-2] >= SHORT and max(shape) <= COLUMNS_MOST:
            said.append(
                f"{name!r} has the shape {values.shape}, and nothing says which axis has the samples: "
                f"{max(shape)} along axis {shape.index(max(shape))} are assumed, otherwise save its transpose with the times"
            )
        if not vectors:
            said.append(f"{name!r} has the shape {values.shape}, more than {COLUMNS_MOST} records, and is left out")
            continue
        axis = _frequencies(name, len(next(iter(vectors.values()))), content)
        if values.dtype.kind == "c" and axis is None:
            said.append(f"{name!r} is complex but has no frequency axis of its length; it is left out")
        elif axis is not None:
            if content.plain(name) not in FREQUENCIES:
                spectra += _spectra(vectors, axis, content, len(spectra))
        else:
            rate, unit, label = _rate(name, content), _unit(name, content), _label(name, content) if len(vectors) == 1 else ""
            # The channels are those of an array, or the elements of a list.
            several, place = (name, 0) if len(vectors) > 1 else _element(name)
            size = len(vectors) if len(vectors) > 1 else max(elements[several], place + 1)
            labels, units = (_listed(several, size, content, lists) for lists in (NAME_LISTS, UNIT_LISTS))
            for k, (one, vector) in enumerate(vectors.items(), place):
                columns[one] = Column(values=vector, sample_rate=rate, unit=unit or units[k], label=label or labels[k])
    columns = by_channel(columns, content.texts, path)
    return ForeignTable(path=path, columns=columns, numbers=content.numbers, spectra=tuple(spectra), remarks=tuple(said))


def by_channel(columns: dict[str, Column], words: Mapping[str, NDArray[Any]], path: Path) -> dict[str, Column]:
    """The columns of a table, with one for each channel if it has the channels below each other, named by a column of words; or
    with the numbers of runs that such a column names.

    `words` are its columns of words, shape (n,). Raises RecordingError if the channels have different times.
    """
    for name, texts in words.items():
        rows = {key: column for key, column in columns.items() if len(column.values) == len(texts)}
        values = [key for key, column in rows.items() if not says_time(key, column)]
        channels, first, place = np.unique(texts, return_index=True, return_inverse=True)
        repeated = 1 < len(channels) <= min(COLUMNS_MOST, len(texts) // 2)
        if _plain(re.split(r"[./]", name)[-1]) not in LONG or len(values) != 1 or not repeated:
            continue
        at = {str(channels[k]): np.flatnonzero(place == k) for k in np.argsort(first)}
        begin = next(iter(at.values()))
        times = {key: replace(column, values=column.values[begin]) for key, column in rows.items() if key not in values}
        if not all(np.array_equal(times[key].values, rows[key].values[own]) for key in times for own in at.values()):
            raise RecordingError(
                f"{path} has the channels {', '.join([*at][:8])} below each other, as its column {name!r} says, but not with the "
                "same times; export one column for each channel, or one file"
            )
        record = rows[values[0]]
        return {**times, **{channel: replace(record, values=record.values[own]) for channel, own in at.items()}}
    numbers = {name: Column(values=np.unique(texts, return_inverse=True)[1]) for name, texts in words.items()}
    return columns | {name: column for name, column in numbers.items() if len(run_numbers(name, column))}


def over_frequency(path: Path, columns: dict[str, Column], words: Mapping[str, NDArray[Any]]) -> ForeignTable | None:
    """The spectra of a table of numbers and words by column, shape (n,), if it is one over frequency; None otherwise.

    Functions are below each other where the frequency starts again; the words `response` and `reference` name their channels.
    """
    axis = next((column.values for name, column in columns.items() if _plain(name) in FREQUENCIES), None)
    if axis is None or any(is_time(name, column) for name, column in columns.items()):
        return None
    again = (np.flatnonzero(np.diff(axis) < 0.0) + 1).tolist()
    edges = [0, *(again if len(again) < COLUMNS_MOST else []), len(axis)]
    items: list[tuple[str, Any]] = []
    for k, (begin, end) in enumerate(pairwise(edges)):
        here = f"{k}." if words or len(edges) > 2 else ""
        for name, column in _joined(columns).items():
            items.append((f"{here}{name.replace('.', '_')}", column.values[begin:end]))
        items += [(f"{here}{name}", str(texts[begin])) for name, texts in words.items() if len(texts) == len(axis)]
    found = table_of(path, items)
    return found if found.spectra and not found.columns else None


def _joined(columns: dict[str, Column]) -> dict[str, Column]:
    rest = dict(columns)
    joined: dict[str, Column] = {}
    for name in columns:
        for one, other in PARTS:
            partner = next((n for n in rest if n.lower() == re.sub(rf"(?i)\b{one}\b|(?<=_){one}$", other, name).lower()), None)
            if name in rest and partner is not None and partner != name:
                a, b = rest.pop(name), rest.pop(partner)
                turn = np.pi / 180.0 if known_unit(b.unit or other) == "deg" else 1.0
                size = 10.0 ** (a.values / 20.0) if "db" in (one, a.unit.lower()) else a.values
                values = a.values + 1j * b.values if other.startswith("im") else size * np.exp(1j * turn * b.values)
                joined[re.sub(rf"(?i)[ _]*{one}$", "", name) or "response"] = Column(values=values, unit=a.unit)
                break
    return {**rest, **joined}


def _element(name: str) -> tuple[str, int]:
    # The list that an array is an element of, and its place: data[2] is the third one of data.
    found = re.fullmatch(r"(.+)\[(\d+)\]", name)
    return (found[1], int(found[2])) if found else (name, 0)


def _by_run(content: _Content) -> Iterator[tuple[str, str, NDArray[Any]]]:
    # The arrays by name; those with samples, channels and runs along three axes by run, the second one with the mark #2.
    for name, values in content.arrays.items():
        axis = _run_axis(name, values, content)
        if axis is None:
            yield name, "", values
        else:
            yield from ((name, f"#{k}" if k > 1 else "", run) for k, run in enumerate(np.moveaxis(values, axis, 0), 1))


def _run_axis(name: str, values: NDArray[Any], content: _Content) -> int | None:
    # The axis of the runs, if an array has three axes, and a list has the names of its channels, or another array has as many
    # samples and runs. Samples, channels and runs follow each other, or are in the reverse order.
    if values.ndim != 3 or values.dtype.kind == "c" or _frequencies(name, max(values.shape), content) is not None:
        return None
    samples = int(np.argmax(values.shape))
    rest = [axis for axis in range(3) if axis != samples]
    named = [axis for axis in rest if any(_listed(name, values.shape[axis], content, NAME_LISTS | UNIT_LISTS))]
    channels = named[0] if len(named) == 1 else 1 if samples != 1 else 2
    (runs,) = (axis for axis in rest if axis != channels)
    near = content.within(content.around(name)[0], content.arrays).values()
    alike = sum(other.ndim == 3 and all(other.shape[k] == values.shape[k] for k in (samples, runs)) for other in near)
    return runs if values.shape[runs] > 1 and (len(named) == 1 or alike > 1) else None


def _add(name: str, value: Any, content: _Content) -> None:
    # An item of a file, by its kind.
    values = np.asarray(value)
    if isinstance(value, str):
        content.words[name] = value
        stated = re.fullmatch(r"\s*([\d.]+(?:e[+-]?\d+)?)\s*([a-z]*)\s*", value, re.IGNORECASE)
        if stated and rate_of(f"{content.plain(name)}{stated[2]}", 1.0) is not None:
            with suppress(ValueError):
                content.numbers[f"{name}{stated[2]}"] = float(stated[1])
    elif values.dtype.kind in "US" and (clock := clock_of(values)) is not None:
        content.arrays[name] = clock
        content.words[f"{name}_unit"] = "s"
    elif values.dtype.kind in "US":
        content.texts[name] = values.ravel()
        few = values.ravel()[: COLUMNS_MOST * (values.size <= COLUMNS_MOST)]
        content.words.update((f"{name}[{k}]", str(text).strip()) for k, text in enumerate(few))
    elif values.dtype.kind in "mM" and values.size > 1:
        content.arrays[name] = (values - values.ravel()[0]) / np.timedelta64(1, "s")
        content.words[f"{name}_unit"] = "s"
    elif values.dtype.kind in "biufc" and values.size > 1:
        content.arrays[name] = values
    elif values.dtype.kind in "biuf" and values.size == 1:
        content.numbers[name] = float(values.ravel()[0])


def _rate(name: str, content: _Content) -> float | None:
    # From a rate or an interval in the same structure as a name or in one around it, or in their abscissae, nearest first.
    dot = content.dot
    structures = [f"{outer}{part}" for outer in content.around(name) for part in ("", *(f"{each}{dot}" for each in ABSCISSAE))]
    for structure in (f"{name}{OWN}{dot}", *structures):
        for key, number in content.within(structure, content.numbers).items():
            if (rate := rate_of(key, number)) is not None:
                return rate
    # The logger of the Cambridge laboratory (peer package pydvma): indata with buflen samples at freq.
    return content.numbers["freq"] if {"buflen", "freq"} <= content.numbers.keys() else None


def _listed(name: str, size: int, content: _Content, lists: frozenset[str]) -> list[str]:
    # The texts of the nearest list with such a name that has one for each of an array's channels.
    for structure in (f"{name}{OWN}{content.dot}", *content.around(name)) if size > 1 else ():
        words = content.within(structure, content.words)
        for key in (key.removesuffix("[0]") for key in words if key.endswith("[0]")):
            texts = [words[f"{key}[{k}]"] for k in range(size) if f"{key}[{k}]" in words]
            if _plain(key) in lists and len(texts) == size and f"{key}[{size}]" not in words:
                return texts
    return [""] * size


def _sample_axes(name: str, shape: tuple[int, ...], content: _Content) -> list[int]:
    # The axes of an array that may have the samples: as many as its clock has, or those without a name for each channel.
    if len(shape) < 2:
        return []
    for structure in content.around(name):
        near = ((key, np.squeeze(values)) for key, values in content.within(structure, content.arrays).items())
        clocks = (v for key, v in near if v.ndim == 1 and is_time(key, Column(values=v)))
        sizes = {len(v) for v in clocks if len(v) in shape and len(v) >= SHORT}
        if len(sizes) == 1:
            return [axis for axis, size in enumerate(shape) if size in sizes]
    lists = NAME_LISTS | UNIT_LISTS
    named = [axis for axis, size in enumerate(shape) if any(_listed(name, size, content, lists))]
    return [axis for axis in range(len(shape)) if axis not in named] if named else []


def _label(name: str, content: _Content) -> str:
    # The name that a structure gives its array: a text next to it, or the structure's own name if it is not an element of a list.
    before, dot = content.around(name)[0], content.dot
    if not before or content.plain(name) not in PLAIN:
        return ""
    words = {key.lower(): text for key, text in content.within(before, content.words).items()}
    parts = [part for part in before.removesuffix(dot).split(dot) if part.lower() not in WRAPPERS]
    # Siemens Testlab names a record in a structure next to its values.
    record = content.words.get(dot.join((*parts, "function_record", "name")), "")
    said = next((words[key] for key in NAMES if words.get(key)), record)
    return said or (parts[-1] if parts and not parts[-1].endswith("]") else "")


def _unit(name: str, content: _Content) -> str:
    # The unit of an array: name_unit, units.name in a structure around it, or its own structure's unit if its name is generic.
    before, dot = content.around(name), content.dot
    places = [f"{name}_{word}" for word in UNIT_WORDS] + [f"{each}units{dot}{name.rsplit(dot, 1)[-1]}" for each in before]
    if content.plain(name) in PLAIN:
        places += [f"{before[0]}{part}{word}" for part in ("", f"quantity{dot}") for word in (*UNIT_WORDS, "label")]
    return next((content.words[place] for place in places if place in content.words), "")


def _frequencies(name: str, size: int, content: _Content) -> FloatArray | None:
    # The frequency axis of an array, Hz; None if it is not a function of frequency.
    dot, numbers = content.dot, content.numbers
    for before in content.around(name):
        inside = ((key, np.squeeze(values)) for key, values in content.within(before, content.arrays).items())
        near = {key: values for key, values in inside if values.shape == (size,)}
        named = (v for key, v in near.items() if _plain(key) in FREQUENCIES and v.dtype.kind in "iuf")
        axis = next((v for v in named if np.isfinite(v).all() and v[0] >= 0.0 and (np.diff(v) > 0.0).all()), None)
        if axis is not None:
            timed = any(is_time(key, Column(values=values)) for key, values in near.items())
            return None if timed else np.asarray(axis, dtype=np.float64)
        step = numbers.get(f"{before}x_values{dot}increment")
        if step and content.words.get(f"{before}x_values{dot}quantity{dot}label", "").lower() == "hz":
            return np.asarray(numbers.get(f"{before}x_values{dot}start_value", 0.0) + step * np.arange(size))
    if {"npts", "freq"} <= numbers.keys() and size == int(numbers["npts"]) // 2 + 1:
        return np.asarray(np.fft.rfftfreq(int(numbers["npts"]), 1.0 / numbers["freq"]))
    return None


def _spectra(vectors: Mapping[str, NDArray[Any]], axis: FloatArray, content: _Content, before: int) -> list[Spectrum]:
    found: list[Spectrum] = []
    for name, values in vectors.items():
        array = re.sub(r"\[[\d,]*\]$", "", name)
        structure, leaf = content.around(array)[0], content.plain(array)
        words = content.within(structure, content.words) if structure else {}
        response, reference = words.get("response", words.get("output")) or name, words.get("reference", words.get("input", ""))
        is_complex = values.dtype.kind == "c"
        coherent = is_complex and not values.imag.any() and bool((values.real >= 0.0).all() and (values.real <= COHERENT).all())
        kind = "coherence" if coherent or leaf.startswith("coh") else "transfer_function" if is_complex else "spectrum"
        if kind == "spectrum" and ("psd" in leaf or "pxx" in leaf):
            kind = "power_spectral_density"
        if kind == "coherence" and found and found[-1].kind == "transfer_function":
            # A coherence follows the function to which it belongs.
            response, reference = found[-1].response, found[-1].reference
        found.append(
            Spectrum(
                name=f"{before + len(found):03d}", kind=kind, response=response, reference=reference, frequency=axis,
                values=values.real.astype(np.float64) if kind == "coherence" or not is_complex else values.astype(np.complex128),
                unit=_unit(array, content) or "1",
            )
        )  # fmt: skip
    return found
