"""Text files with columns: separated by comma, semicolon, tab or blanks, decimal point or comma, with or without a header."""

from __future__ import annotations

import csv
import io
import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.rig.errors import RecordingError
from isorig.rig.exchange.clock import completed, seconds_per
from isorig.rig.exchange.table import Column, ForeignTable, Format
from isorig.rig.exchange.tree import table_of
from isorig.rig.exchange.units import known_unit
from isorig.rig.files.inputs import content_of
from isorig.rig.files.output import reason

if TYPE_CHECKING:
    import pandas as pd

#: Separator and decimal mark, in order of preference.
STYLES = ((";", ","), (";", "."), ("\t", ","), ("\t", "."), (",", "."), (r"\s+", "."), (r"\s+", ","))
#: Separators that a line of names may have instead of the data's.
HEAD_SEPARATORS = (",", ";", "\t", r"\s{2,}", r"\s+")
#: Maximum bytes of a text file: as numbers in memory it takes about as many.
FILE_MOST = 1 << 30
#: Maximum number of header lines.
HEAD_LINES = 200
#: Number of lines at the end whose digits are compared.
LAST_LINES = 50
#: A time of day, with or without its date.
_CLOCK = re.compile(
    r"(?:(?P<date>\d{4}[-/]\d\d?[-/]\d\d?|\d\d?[./]\d\d?[./]\d{4})[ T])?(?P<h>\d\d?):(?P<m>\d\d)(?::(?P<s>\d\d(?:[.,]\d+)?))?Z?"
)
_RATE = re.compile(
    r"(?:sampl\w*[ _-]*(?:rate|freq\w*)|scan[ _-]*rate|abtast(?:rate|frequenz)|\bfs\b|\bf_s\b)[^0-9+\-]{0,20}"
    r"(?P<number>\d+(?:[.,]\d+)?(?:e[+-]?\d+)?)\s*(?P<unit>k?hz|k?s/s|1/s)?",
    re.IGNORECASE,
)
_STEP = re.compile(
    r"(?:sampl\w*[ _-]*(?:interval|period|time)|delta[ _-]?[tx]|\bdt\b|time[ _-]*(?:step|increment)|abtast(?:zeit|intervall))"
    r"[^0-9+\-]{0,20}(?P<number>\d+(?:[.,]\d+)?(?:e[+-]?\d+)?)\s*(?P<unit>s|ms|us|µs|ns)?\b",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class _Style:
    # Format of a file's columns, and the index of the line with the first values.
    separator: str
    decimal: str
    first: int
    count: int
    clocks: tuple[int, ...]


def read_text(path: Path) -> ForeignTable:
    """The columns of a text file; names, units and the sample rate are taken from its header if present. Raises RecordingError,
    with the line and the cell, if there are no columns of numbers, or a line is truncated or contains a cell that is not a
    number."""
    text = decoded(content_of(path, FILE_MOST))
    lines = [line.rstrip("\r\n") for line in io.StringIO(text[: 1 << 20]).readlines()[:HEAD_LINES]]
    style = _with_decimal_of(text, _style(lines, path))
    frame = _frame(text, style, path)
    names, units = _head(lines[: style.first], style)
    rate = _rate(lines[: style.first])
    columns: dict[str, Column] = {}
    for k, (name, unit) in enumerate(zip(names, units, strict=True)):
        is_clock = k in style.clocks
        values = _seconds(frame[k]) if is_clock else frame[k].to_numpy()
        key = name if name not in columns else f"{name}[{k}]"
        columns[key] = Column(values=values, unit="s" if is_clock else unit, sample_rate=rate)
    # A table over frequency: real and imaginary parts, or magnitude and phase, become complex values.
    over = table_of(path, [(name.replace(".", "_"), column.values) for name, column in _joined(columns).items()])
    if over.spectra and not over.columns:
        return over
    found, remarks = completed(columns)
    return ForeignTable(path=path, columns=found, remarks=tuple(remarks))


def decoded(raw: bytes) -> str:
    """The text of a file: UTF-8, UTF-16 with a byte order mark, or Latin-1."""
    try:
        return raw.decode("utf-16" if raw[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def _frame(text: str, style: _Style, path: Path) -> pd.DataFrame:
    import pandas as pd

    try:
        frame = pd.read_csv(
            io.StringIO(text), sep=style.separator, decimal=style.decimal, skiprows=style.first, header=None,
            names=range(style.count), dtype={k: "str" if k in style.clocks else "float64" for k in range(style.count)},
            comment="#", skip_blank_lines=True, skipinitialspace=True, index_col=False,
        )  # fmt: skip
    except (ValueError, pd.errors.ParserError) as error:
        _blame(text, style, path)
        raise RecordingError(f"{path} has a cell that is not a number ({reason(error)}); correct or cut it") from None
    if frame[style.count - 1].isna().any():
        _blame(text, style, path)
    _cut(text, style, path)
    return frame


def _blame(text: str, style: _Style, path: Path) -> None:
    # The first line that does not belong to the table, by its number in the file.
    short: list[tuple[int, int]] = []
    last = 0
    for number, raw in enumerate(io.StringIO(text), 1):
        line = raw.split("#", 1)[0]
        if number <= style.first or not line.strip():
            continue
        last, fields = number, _fields(line, style.separator)
        here = f"{path}, line {number}"
        if len(fields) > style.count and any(fields[style.count :]):
            raise RecordingError(f"{here} has {len(fields)} cells but the lines before it have {style.count}; correct that line")
        wrong = next((k for k, field in enumerate(fields) if not _is_value(field, style.decimal)), None)
        if wrong is not None:
            raise RecordingError(
                f"{here}, column {wrong + 1} contains {fields[wrong]!r}, which is not a number; correct or cut that line"
            )
        if len(fields) < style.count:
            short.append((number, len(fields)))
    if short:
        number, count = short[0]
        if len(short) == 1 and number == last:
            raise RecordingError(
                f"{path}, line {number}, the last, has {count} of {style.count} cells: it was truncated during writing; delete "
                "that line or copy the file again from its source"
            )
        if [n for n, _ in short] != list(range(number, last + 1)):
            raise RecordingError(f"{path}, line {number} has {count} of {style.count} cells; correct or delete that line")


def _cut(text: str, style: _Style, path: Path) -> None:
    # A last line without an end of line, whose last number has fewer digits than all lines before it, was truncated within it.
    if text.endswith("\n"):
        return
    lines = text[-(1 << 14) :].splitlines()[-LAST_LINES:]
    cells = [(_fields(line, style.separator) or [""])[-1] for line in lines[1:]]
    digits = [len(cell.rpartition(style.decimal)[2]) for cell in cells if style.decimal in cell]
    if len(digits) > 3 and len(set(digits[:-1])) == 1 and digits[-1] < digits[0]:
        raise RecordingError(
            f"{path}, line {text.count(chr(10)) + 1}, the last, ends within a number ({lines[-1].strip()[-20:]!r}): it was cut "
            "while it was written; delete that line or copy the file again from its source"
        )


def _style(lines: Sequence[str], path: Path) -> _Style:
    # The style in which two successive lines are values throughout: preferably one that fits a header line, then the most
    # columns.
    best: tuple[tuple[bool, int], _Style] | None = None
    for separator, decimal in STYLES:
        for k, line in enumerate(lines):
            fields = _fields(line, separator)
            after = next((_fields(other, separator) for other in lines[k + 1 :] if other.strip()), fields)
            if _are_values(fields, decimal) and _are_values(after, decimal) and len(after) == len(fields):
                count = len(fields)
                named = any(len(_fields(head.lstrip("#% "), separator)) == count for head in lines[:k] if head.strip())
                if best is None or (named and count > 1, count) > best[0]:
                    clocks = tuple(j for j, field in enumerate(fields) if _CLOCK.fullmatch(field))
                    best = ((named and count > 1, count), _Style(separator, decimal, k, count, clocks))
                break
    if best is None:
        said = [line.strip() for line in lines if line.strip()]
        where = f", only the line {said[0][:60]!r}" if len(said) == 1 else f" in its first {len(lines)} lines"
        raise RecordingError(f"{path} has no columns of numbers{where}; export it as plain text columns")
    if best[1].separator == "," and _are_halves(lines, best[1]):
        raise RecordingError(
            f"{path} seems to have decimal commas in columns that commas separate, too ({lines[best[1].first][:40]!r}); "
            "export it with decimal points, or separated by semicolons or tabs"
        )
    return best[1]


def _with_decimal_of(text: str, style: _Style) -> _Style:
    # The first rows may be whole numbers, as before a drive begins: then the first mark in the rows below tells.
    if style.clocks or style.separator == ",":
        return style
    marks = (line for line in itertools.islice(io.StringIO(text), style.first, None) if "." in line or "," in line)
    line = next(marks, "").split("#", 1)[0]
    other = "." if style.decimal == "," else ","
    return replace(style, decimal=other) if other in line and style.decimal not in line else style


def _are_halves(lines: Sequence[str], style: _Style) -> bool:
    # Whether every second cell is the decimals of the number before it: digits alone, with zeros that begin no number, or as many
    # in all lines below half as many names.
    rows = [_fields(line, ",") for line in lines[style.first :] if line.strip()]
    whole, decimals = ([cell for row in rows for cell in row[k::2]] for k in (0, 1))
    if style.count % 2 or not all(re.fullmatch(r"[+-]?\d+", cell) for cell in whole) or not all(map(str.isdecimal, decimals)):
        return False
    heads = (_fields(line, ",") for line in lines[: style.first])
    named = any(2 * len(names) == style.count and not any(_is_value(name, ".") for name in names) for names in heads)
    begin = any(re.match(r"[+-]?0\d", cell) for cell in whole)
    return not begin and (any(re.match(r"0\d", cell) for cell in decimals) or (named and len({*map(len, decimals)}) == 1))


def _fields(line: str, separator: str) -> list[str]:
    line = line.strip(" \r\n" if separator == "\t" else None)
    if separator.startswith(r"\s"):
        return re.split(separator, line) if line else []
    if '"' in line:
        try:
            return [field.strip() for field in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])]
        except csv.Error:  # a lone carriage return or an endless quotation: one cell, which is no number
            return [line]
    return [field.strip() for field in line.split(separator)]


def _are_values(fields: Sequence[str], decimal: str) -> bool:
    there = [field for field in fields if field]
    return 2 * len(there) >= len(fields) > 0 and all(_is_value(field, decimal) for field in there)


def _is_value(field: str, decimal: str) -> bool:
    pattern = rf"|[+-]?(\d+({re.escape(decimal)}\d*)?|{re.escape(decimal)}\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)|n/?a|null"
    return re.fullmatch(pattern, field.strip('"'), re.IGNORECASE) is not None or _CLOCK.fullmatch(field) is not None


def _head(head: Sequence[str], style: _Style) -> tuple[list[str], list[str]]:
    # Names and units: from the last header line with a name for each column, or a line of units and the names above it.
    rows = [fields for line in reversed(head) if (fields := _named(line, style.separator, style.count))]
    blank = [""] * style.count
    if not rows:
        rows = [*(fields for line in reversed(head) if (fields := _other_names(line, style.count))), blank][:1]
    units = rows.pop(0) if len(rows) > 1 and _are_units(rows[0]) else blank
    named = [_name_and_unit(name) for name in rows[0]]
    names = [name or f"column{k}" for k, (name, _) in enumerate(named)]
    return names, [unit.strip("[]()").strip(" -") or own for unit, (_, own) in zip(units, named, strict=True)]


def _named(line: str, separator: str, count: int) -> list[str] | None:
    fields = [field.strip('"') for field in _fields(line.lstrip("#% "), separator)]
    return fields if len(fields) == count and 2 * sum(map(bool, fields)) >= count else None


def _other_names(line: str, count: int) -> list[str] | None:
    # Names with another separator than the data's, as written by numpy.savetxt.
    for separator in HEAD_SEPARATORS:
        fields = _named(line, separator, count)
        if fields and all(fields) and count > 1:
            return fields
    return None


def _are_units(fields: Sequence[str]) -> bool:
    plain = [field.strip().strip("[]()").strip() for field in fields]
    known = [known_unit(field) is not None or seconds_per(field) is not None for field in plain]
    return any(known) and all(one or field in ("", "-") for one, field in zip(known, plain, strict=True))


def _name_and_unit(head: str) -> tuple[str, str]:
    found = re.fullmatch(r"(.+?)\s*[\[(]([^\])]+)[\])]", head)
    if found:
        return found[1], found[2]
    found = re.fullmatch(r"(.+?)\s*/\s*([^/].*)", head)
    if found and (known_unit(found[2]) or seconds_per(found[2])):
        return found[1], found[2]
    return head, ""


def _rate(head: Sequence[str]) -> float | None:
    for line in head:
        if found := _RATE.search(line):
            rate = float(found["number"].replace(",", ".")) * (1e3 if (found["unit"] or "").lower().startswith("k") else 1.0)
        elif found := _STEP.search(line):
            step = float(found["number"].replace(",", ".")) * (seconds_per(found["unit"] or "s") or 1.0)
            rate = 1.0 / step if step > 0.0 else 0.0
        else:
            continue
        if 0.0 < rate < np.inf:
            return rate
    return None


def _seconds(column: pd.Series[str]) -> FloatArray:
    import pandas as pd

    # Seconds since the first reading of a clock; it may pass midnight if it has no date.
    parts = column.str.extract(_CLOCK)
    seconds = np.zeros(len(column))
    for part, size in (("h", 3600.0), ("m", 60.0), ("s", 1.0)):
        seconds += pd.to_numeric(parts[part].str.replace(",", "."), errors="coerce").fillna(0.0).to_numpy(np.float64) * size
    if parts["date"].notna().any():
        first = str(parts["date"].dropna().iloc[0])
        days = pd.to_datetime(parts["date"], dayfirst="." in first, errors="coerce", format="mixed").ffill()
        seconds = seconds + (days - days.iloc[0]).dt.days.to_numpy(np.float64) * 86400.0
    else:
        seconds = seconds + 86400.0 * np.concatenate([[0.0], np.cumsum(np.diff(seconds) < -43200.0)])
    return np.asarray(seconds - seconds[0])


def _joined(columns: dict[str, Column]) -> dict[str, Column]:
    rest = dict(columns)
    joined: dict[str, Column] = {}
    for name in columns:
        for one, other in (("real", "imag"), ("re", "im"), ("magnitude", "phase"), ("mag", "phase"), ("amplitude", "phase")):
            partner = next((n for n in rest if n.lower() == re.sub(rf"(?i)\b{one}\b|(?<=_){one}$", other, name).lower()), None)
            if name in rest and partner is not None and partner != name:
                a, b = rest.pop(name), rest.pop(partner)
                turn = np.pi / 180.0 if known_unit(b.unit) == "deg" else 1.0
                values = a.values + 1j * b.values if other.startswith("im") else a.values * np.exp(1j * turn * b.values)
                joined[re.sub(rf"(?i)[ _]*{one}$", "", name) or "response"] = Column(values=values, unit=a.unit)
                break
    return {**rest, **joined}


TEXT = Format(extensions=(".csv", ".txt", ".tsv", ".dat", ".asc", ".prn"), name="text", read=read_text)
