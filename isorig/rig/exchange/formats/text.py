"""Text files with columns: separated by comma, semicolon, tab or blanks, decimal point or comma, with or without a header."""

from __future__ import annotations

import codecs
import csv
import io
import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isorig.analysis.campaign import FloatArray
from isorig.rig.errors import RecordingError
from isorig.rig.exchange.clock import BESIDE, CLOCK, completed, names_time, rises_evenly, sample_counter, seconds_of, seconds_per
from isorig.rig.exchange.table import Column, ForeignTable, Format
from isorig.rig.exchange.tree import by_channel, over_frequency, rate_of
from isorig.rig.exchange.units import COUNTS, OTHER_UNITS, UNITS, known_unit, name_and_unit, sensitivity_in
from isorig.rig.files.inputs import content_of
from isorig.rig.files.output import reason

if TYPE_CHECKING:
    import pandas as pd

#: Separator and decimal mark, in order of preference.
STYLES = (
    (";", ","), (";", "."), ("\t", ","), ("\t", "."), (",", "."), (",", ","), ("|", "."), ("|", ","),
    (r"\s+", "."), (r"\s+", ","),
)  # fmt: skip
#: Separators that a line of names may have instead of the data's.
HEAD_SEPARATORS = (",", ";", "\t", r"\s{2,}", r"\s+")
#: Marks at the start of a text, and the encodings that they mean; that of UTF-16 is also the start of that of UTF-32.
MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32"), (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"),
)  # fmt: skip
#: Maximum bytes of a text file: as numbers in memory it takes about as many.
FILE_MOST = 1 << 30
#: Maximum number of header lines, and of their characters.
HEAD_LINES, HEAD_LONGEST = 1000, 1 << 20
#: Fewest successive lines with a single value that are a column, unless the file ends before.
ROWS_LEAST = 3
#: Number of lines at the end whose digits are compared.
LAST_LINES = 50
#: Each row continues the one before it if the step between them is smaller than this share of the steps from row to row. Chosen.
CONTINUED = 0.8
#: The end of a number in a column of fixed width, if the sign of the next one touches it.
_TOUCHING = re.compile(r"(\d(?P<mark>[.,])\d+[eEdD][+-]\d{2,3})(?=[+-]?\d(?P=mark)\d+[eEdD])")
#: A number with separators of thousands: in its groups of three digits, or of two as in India.
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:(?P<mark>[.,'’ \u00a0\u202f])(?:\d\d(?P=mark))*\d{3}(?:(?P=mark)\d{3})*)(?:[.,]\d*)?")
#: A cell with a number or nothing, by its decimal mark.
_VALUE = {
    mark: re.compile(
        rf"|[+\-−]?(\d+({re.escape(mark)}\d*)?|{re.escape(mark)}\d+)([ed][+-]?\d+)?|[+-]?(nan|inf|infinity)|n/?a|null",
        re.IGNORECASE,
    )
    for mark in ".,"
}
#: A line with several cells in one quotation.
_QUOTED = re.compile(r'"[^"]*(?:[;\t]|,[^"]*,)[^"]*"')
#: A cell that programs write for a missing value.
_MISSING = re.compile(
    r"(?m)(?:^|(?<=[;,\t|]))[ ]*(?:#(?:N/?A|NV|DIV/0!|NUM!|VALUE!|WERT!|ZAHL!|REF!|BEZUG!)|-{1,3})[ ]*(?=[;,\t|\r\n]|\Z)"
)
_NUMBER = r"(?P<gap>[^0-9+\-]{0,20})(?P<number>\d+(?:[.,'\u2019]\d+)*(?:e[+-]?\d+)?)\s*(?P<unit>[a-zµμ1/]*)"
_RATE = re.compile(
    r"(?:sampl\w*[ _-]*(?:rate|freq\w*|per[ _]s(?:econd)?)|(?:scan|acquisition)[ _-]*rate|sampling(?=\s*[:=])"
    r"|(?:abtast|mess)(?:rate|frequenz)|fr[eé]quence d.[eé]chantillonnage|frequenza di campionamento|frecuencia de muestreo"
    rf"|\bf_?s(?:ampl\w*)?\b|\bodr\b){_NUMBER}",
    re.IGNORECASE,
)
_STEP = re.compile(
    r"(?:sampl\w*[ _-]*(?:interval|period|time)|x[ _-]axis[ _-]delta|(?:delta|δ)[ _-]?[tx]|\bdx\b|\bdt\b"
    rf"|\btinc\b|(?:^|\bx[ _-]|time[ _-]*)increment|time[ _-]*step|abtast(?:zeit|intervall)){_NUMBER}",
    re.IGNORECASE,
)
_UNIT = re.compile(r"(?:amplitude|vertical|\by)[ _-]*(?:axis[ _-]*)?units?\W+(?P<unit>[^\s,;:\"]+)", re.IGNORECASE)
_PREFIX = re.compile(r"(?P<prefix>[km]?)(?:hz|s/s|sa/s|sps)(?:$|\W)", re.IGNORECASE)


@dataclass(frozen=True)
class _Style:
    # Format of a file's columns, and the index of the line with the first values. The columns `empty` have no value in the first
    # two lines; `wordy` ones have words.
    separator: str
    decimal: str
    first: int
    count: int
    clocks: tuple[int, ...]
    empty: tuple[int, ...] = ()
    wordy: tuple[int, ...] = ()

    @property
    def filled(self) -> int:
        return max(set(range(self.count)) - {*self.empty, *self.wordy}, default=-1) + 1


def read_text(path: Path) -> ForeignTable:
    """The columns of a text file; names, units and the sample rate are taken from its header if present. Raises RecordingError,
    with the line and the cell, if there are no columns of numbers, or a line is truncated or contains a cell that is not a
    number."""
    return table_of_text(decoded(content_of(path, FILE_MOST)), path)


def table_of_text(text: str, path: Path) -> ForeignTable:
    """The columns of a text, like those of a text file; messages name `path`. Raises RecordingError like `read_text`."""
    text = _with_whole_lines(_with_whole_cells(text))
    if _TOUCHING.search(text[:HEAD_LONGEST]):
        text = _TOUCHING.sub(r"\1 ", text)
    lines = [line.rstrip("\r\n") for line in io.StringIO(text[:HEAD_LONGEST]).readlines()[:HEAD_LINES]]
    style = _with_decimal_of(text, _style(lines, path))
    _blame_thousands(lines, style, path)
    begin = sum(len(line) for line in itertools.islice(io.StringIO(text), style.first))
    body = _without_repeated_head(whole := text[begin:], lines[: style.first])
    text = text if body is whole else text[:begin] + body
    frame = _frame(text, body, style, path)
    names, units = _head(lines[: style.first], style)
    rate = _rate(lines if style.wordy else lines[: style.first], style)
    sensors, stated = _sensitivities(lines[: style.first], style)
    columns: dict[str, Column] = {}
    remarks = [*_notes(lines, style), *stated, *_cut(text, style, path)]
    words: dict[str, NDArray[Any]] = {}
    for k, (name, unit) in enumerate(zip(names, units, strict=True)):
        if frame[k].dtype.kind != "f" and k not in style.clocks:
            _blame_numbers(frame[k].dropna(), text, style, k, path)
            words[name] = frame[k].to_numpy(str)
            continue
        values = seconds_of(frame[k]) if k in style.clocks else frame[k].to_numpy()
        single = np.unique(values[np.isfinite(values)])
        if len(single) == 1 and (found := rate_of(name, float(single[0]))) is not None:
            rate = found
            continue
        key = name if name not in columns else f"{name}[{k}]"
        columns[key] = _sensed(Column(values=values, unit="s" if k in style.clocks else unit), sensors.get(k))
        if k in sensors and not unit:
            number, signal, per = sensors[k]
            remarks.append(
                f"column {name!r} has no unit, so its sensitivity of {number:g} {signal}/({per}) is not applied: if its values "
                f"are in V, write it as sensitivity, in V per {per}"
            )
    stored, columns = columns, by_channel(columns, words, path)
    unused = [name for name in words if stored.keys() <= columns.keys() and name not in columns]
    remarks += [f"column {name!r} contains words ({str(words[name][0])!r}) and is left out" for name in unused]
    if only := _single_unit(lines[: style.first]):
        named = (key for key, column in columns.items() if not (names_time(key) or column.unit or rises_evenly(column)))
        records = [key for key in named if sample_counter(columns[key]) is None]
        columns |= {key: replace(columns[key], unit=only) for key in records if len(records) == 1}
    columns = {key: replace(column, sample_rate=rate) for key, column in columns.items()}
    # A table over frequency: real and imaginary parts, or magnitude and phase, become complex values.
    if (over := over_frequency(path, columns, words)) is not None:
        return over
    found_columns, said = completed(columns)
    heads = (_named(line, style.separator, style) or [] for line in lines[: style.first])
    if not any(re.search(r"[^\W\d_]", cell) for head in heads for cell in head):
        remarks += _continued([column.values for column in found_columns.values()])
    return ForeignTable(path=path, columns=found_columns, remarks=(*remarks, *said, *_empty_lines(body)))


def _single_unit(head: Sequence[str]) -> str:
    # The unit of a file with one record: Amplitude unit: N.
    found = (_UNIT.search(line) for line in head)
    return next((each["unit"] for each in found if each and known_unit(each["unit"])), "")


def decoded(raw: bytes) -> str:
    """The text of a file: UTF-8, UTF-16, UTF-32 or Latin-1; without zeros that fill it at its end."""
    marked = next((name for mark, name in MARKS if raw.startswith(mark)), "utf-8-sig")
    try:
        # Without its mark UTF-16 has a zero in each of the first characters, which are a name or a number.
        zeros = raw[0:8:2].count(0), raw[1:8:2].count(0)
        text = raw.decode({(0, 4): "utf-16-le", (4, 0): "utf-16-be"}.get(zeros, marked))
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    text = text.rstrip("\0\x1a")
    return text if "\n" in text else text.replace("\r", "\n")


def _with_whole_cells(text: str) -> str:
    # A quoted cell of the header may have several lines; empty lines at the start instead keep the numbers of the others.
    head = re.sub(r'(?<![^,;\t\n])"[^"]*"(?=[,;\t\r\n])', lambda cell: " ".join(cell[0].split()), text[:HEAD_LONGEST])
    missing = text.count("\n", 0, HEAD_LONGEST) - head.count("\n")
    return "\n" * missing + head + text[HEAD_LONGEST:]


def _with_whole_lines(text: str) -> str:
    # Some programs quote each line, with its separators, as if it were one cell.
    lines = text[:HEAD_LONGEST].splitlines()[:LAST_LINES]
    return text.replace('"', "") if len(lines) > 2 and all(_QUOTED.fullmatch(line) for line in lines) else text


def _empty_lines(body: str) -> list[str]:
    # Empty lines after many rows may separate runs.
    at = max(body.find("\n\n"), body.find("\n\r\n"))
    rows = body.count("\n", 0, at + 1) if re.compile(r"\s*[\d+.-]").match(body, max(at, 0)) else 0
    hint = f"an empty line follows {rows} rows: if it separates runs, give each its samples = [first, last + 1], e.g. [0, {rows}]"
    return [hint] if rows >= BESIDE else []


def _frame(text: str, body: str, style: _Style, path: Path) -> pd.DataFrame:
    import pandas as pd

    whole = (*style.clocks, *style.empty, *style.wordy)

    def parsed(body: str) -> pd.DataFrame:
        return pd.read_csv(
            io.StringIO(body), sep=style.separator, decimal=style.decimal, header=None, names=range(style.count),
            dtype={k: "str" if k in whole else "float64" for k in range(style.count)}, comment="#", skip_blank_lines=True,
            skipinitialspace=True, index_col=False,
        )  # fmt: skip

    try:
        try:
            frame = parsed(body)
        except ValueError:
            # An exponent of Fortran, a minus of Unicode, a mark for a missing value.
            frame = parsed(_MISSING.sub("", re.sub(r"(?<=[\d.,])[dD](?=[+-]?\d)", "e", body.replace("−", "-"))))
    except (ValueError, pd.errors.ParserError) as error:
        _blame(text, style, path)
        raise RecordingError(f"{path} has a cell that is not a number ({reason(error)}); correct or cut it") from None
    unclear = not all(frame[k].dropna().str.fullmatch(CLOCK).all() for k in style.clocks)
    for k in (*style.empty, *style.wordy):
        values = pd.to_numeric(frame[k].str.replace(style.decimal, "."), errors="coerce")
        if frame[k].isna().all() or (values.notna().any() and k in style.empty):
            unclear |= bool((frame[k].notna() & values.isna()).any())
            frame[k] = values.astype("float64")
    style = replace(style, wordy=(*style.wordy, *(k for k in style.empty if frame[k].dtype.kind != "f")))
    last = max((k for k in range(style.count) if k not in style.wordy and frame[k].notna().any()), default=0)
    if unclear or frame[last].isna().any():
        _blame(text, style, path)
    return frame


def _without_repeated_head(body: str, head: Sequence[str]) -> str:
    # Lines of the header that are repeated below become empty lines, so that the others keep their numbers. A spreadsheet's mark
    # for a missing value would begin a comment.
    for line in {line.strip() for line in head if re.search(r"[^\W\d_]", line)}:
        if line in body:
            body = re.sub(rf"(?m)^[ ]*{re.escape(line)}[ ]*$", "", body)
    return _MISSING.sub("", body) if "#" in body else body


def _blame(text: str, style: _Style, path: Path) -> None:
    # The first line that does not belong to the table, by its number in the file.
    short: list[tuple[int, int]] = []
    last, heads = 0, {cells[0] for line in text.splitlines()[: style.first] if (cells := _fields(line, style.separator))}
    for number, raw in enumerate(io.StringIO(text), 1):
        line = raw.split("#", 1)[0]
        if number <= style.first or not line.strip():
            continue
        last, fields = number, _fields(line, style.separator)
        here = f"{path}, line {number}"
        if len(fields) > style.count and any(fields[style.count :]):
            raise RecordingError(f"{here} has {len(fields)} cells but the lines before it have {style.count}; correct that line")
        wrong = next((k for k, field in enumerate(fields) if not (_is_value(field, style.decimal) or k in style.wordy)), None)
        again = fields[0] in heads and not _is_value(fields[0], style.decimal)
        if again or (len(fields) > 1 and not any(_is_value(field, style.decimal) for field in fields)):
            raise RecordingError(
                f"{here} has words below the numbers: if a second table begins there, save each as its own file, otherwise "
                "delete that line"
            )
        if wrong is not None:
            raise RecordingError(_no_number(here, wrong, fields[wrong]))
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


def _no_number(here: str, column: int, cell: str) -> str:
    begin = f"{here}, column {column + 1} contains {cell[:40]!r}, which "
    if _THOUSANDS.fullmatch(cell):
        return f"{begin}seems to have separators of thousands; export the numbers without them"
    return f"{begin}is not a number; correct it, leave the cell empty if the sample is lost, or cut that line"


def _cut(text: str, style: _Style, path: Path) -> list[str]:
    # A last line without an end of line, whose last number has fewer decimals than all lines before it, was truncated within it;
    # with an end of line, or fewer digits of a whole number, this is only likely.
    lines = text[-(1 << 14) :].splitlines()[-LAST_LINES:]
    ended = text.endswith("\n")
    cells = [(_fields(line, style.separator) or [""])[-1] for line in lines[1:]]
    decimals = [len(cell.rpartition(style.decimal)[2]) for cell in cells if style.decimal in cell]
    fewer = len(decimals) > 3 and len(set(decimals[:-1])) == 1 and decimals[-1] < decimals[0]
    whole = [len(cell.strip("+-")) for cell in cells if not decimals and not ended]
    if not fewer and not (len(whole) > 3 and whole[-1] < min(whole[:-1])):
        return []
    last = lines[-1].strip()[-20:]
    if fewer and not ended:
        raise RecordingError(
            f"{path}, line {text.count(chr(10)) + 1}, the last, ends within a number ({last!r}): it was cut "
            "while it was written; delete that line or copy the file again from its source"
        )
    return [f"the last number has fewer digits than all before it ({last!r}): if the line was cut, delete it"]


def _style(lines: Sequence[str], path: Path) -> _Style:
    # The style in which successive lines are values throughout: preferably one that fits a header line, then the most
    # columns.
    best: tuple[tuple[bool, int, int], _Style] | None = None
    for separator, decimal in STYLES:
        for k, line in enumerate(lines):
            fields = _fields(line, separator)
            if not _are_values(fields, decimal):
                continue
            # Single values may be a date and a setting.
            least = ROWS_LEAST if len(fields) == 1 else 2
            below = itertools.islice((other for other in lines[k + 1 :] if other.strip()), least - 1)
            after = [_fields(other, separator) for other in below] or [fields]
            alike = all(_are_values(row, decimal) and _are_alike(row, fields) for row in after)
            if alike and not _are_numbered(fields, after[0]):
                count = len(fields)
                if best is not None and separator.startswith(r"\s") and count == best[1].count:
                    break
                heads = (_fields(head.lstrip("#% "), separator) for head in lines[:k] if head.strip())
                named = any(len(head) == count and not any(_are_values(head, mark) for mark in ".,") for head in heads)
                # Whole numbers below others fit any decimal mark.
                if best is None or (named and count > 1, count, -k) > best[0]:
                    clocks = tuple(j for j, field in enumerate(fields) if CLOCK.fullmatch(field))
                    empty = tuple(j for j in range(count) if not fields[j] and not after[0][j])
                    best = ((named and count > 1, count, -k), _Style(separator, decimal, k, count, clocks, empty))
                break
    if best is None and (style := _with_words(lines)) is not None:
        return style
    if best is None:
        said = [line.strip() for line in lines if line.strip()]
        where = f", only the line {said[0][:60]!r}" if len(said) == 1 else f" in its first {len(lines)} lines"
        last = f" (the last of them is {said[-1][:60]!r})" if len(said) > 1 else ""
        raise RecordingError(f"{path} has no columns of numbers{where}{last}; export it as plain text columns")
    style = best[1]
    if style.separator == "," and _are_halves(lines, style):
        if style.count == 2:
            return _Style("\t", ",", style.first, 1, ())
        raise RecordingError(
            f"{path} seems to have decimal commas in columns that commas separate, too ({lines[style.first][:40]!r}); "
            "export it with decimal points, or separated by semicolons or tabs"
        )
    return _with_first_rows(lines, style, path)


def _are_alike(one: Sequence[str], other: Sequence[str]) -> bool:
    # Whether two lines have as many cells, and times in the same ones.
    cells = zip(one, other, strict=False)
    times = ((CLOCK.fullmatch(a), CLOCK.fullmatch(b)) for a, b in cells if a and b)
    return len(one) == len(other) and all((a is None) == (b is None) for a, b in times)


def _are_numbered(fields: Sequence[str], after: Sequence[str]) -> bool:
    # Whether a line numbers the columns, as pandas names those of an array: the line after it is not of whole numbers.
    numbers = [field for field in fields if field]
    counted = any(numbers == [str(k + begin) for k in range(len(numbers))] for begin in (0, 1))
    return len(numbers) > 1 and counted and any(re.search(r"[.,e]", cell) for cell in after)


def _with_words(lines: Sequence[str]) -> _Style | None:
    # Two columns or more of numbers next to columns of words, in all lines down to the last one.
    at = [k for k, line in enumerate(lines) if line.strip()]
    best: _Style | None = None
    for separator, decimal in STYLES if len(at) > 2 else ():
        rows = [_fields(lines[k], separator) for k in at]
        numbers = [j for j, cell in enumerate(rows[-1]) if cell and _is_value(cell, decimal)]
        alike = [len(row) == len(rows[-1]) and all(row[j] and _is_value(row[j], decimal) for j in numbers) for row in rows]
        first = len(rows) - (alike[::-1].index(False) if False in alike else len(rows))
        if len(numbers) > 1 and len(rows) - first > 2 and not separator.startswith(r"\s"):
            wordy = tuple(j for j in range(len(rows[-1])) if j not in numbers)
            clocks = tuple(j for j in numbers if CLOCK.fullmatch(rows[-1][j]))
            if best is None or len(numbers) > best.count - len(best.wordy):
                best = _Style(separator, decimal, at[first], len(rows[-1]), clocks, wordy=wordy)
    return best


def _with_first_rows(lines: Sequence[str], style: _Style, path: Path) -> _Style:
    # A line directly above the first values may be a row, too: with a word in an otherwise empty column, or in place of a number.
    for k in range(style.first - 1, -1, -1):
        fields = _fields(lines[k], style.separator)
        words = [j for j, field in enumerate(fields) if not _is_value(field, style.decimal)]
        surplus = 2 * (sum(map(bool, fields)) - len(words)) - style.count
        if len(fields) != style.count or not words or 0 in words or surplus < style.separator.startswith(r"\s"):
            break
        if not set(words) <= set(style.empty):
            raise RecordingError(_no_number(f"{path}, line {k + 1}", words[0], fields[words[0]]))
        style = replace(style, first=k)
    return style


def _with_decimal_of(text: str, style: _Style) -> _Style:
    # The first rows may be whole numbers, as before a drive begins: then the first mark in the rows below tells.
    if style.clocks or style.separator == "," or style.wordy:
        return style
    marks = (line for line in itertools.islice(io.StringIO(text), style.first, None) if "." in line or "," in line)
    line = next(marks, "").split("#", 1)[0]
    other = "." if style.decimal == "," else ","
    return replace(style, decimal=other) if other in line and style.decimal not in line else style


def _blame_thousands(lines: Sequence[str], style: _Style, path: Path) -> None:
    # A column with whole numbers of up to three digits, and larger ones with three decimals: the mark separates thousands.
    rows = [fields for line in lines[style.first :] if len(fields := _fields(line, style.separator)) == style.count]
    for k, cells in enumerate(zip(*rows, strict=True)):
        marked, plain = ([cell for cell in cells if cell and (style.decimal in cell) == has] for has in (True, False))
        large = rf"[+-]?[1-9]\d{{0,2}}{re.escape(style.decimal)}\d{{3}}"
        small = all(len(cell.strip("+-")) <= 3 for cell in plain)
        if len(marked) > 2 and plain and small and all(re.fullmatch(large, cell) for cell in marked):
            raise RecordingError(
                f"{path}, column {k + 1} contains {plain[0]!r} and {marked[0]!r}, so {style.decimal!r} seems to separate "
                "thousands; export it without separators of thousands, or with three decimals in every row"
            )


def _blame_numbers(cells: pd.Series[str], text: str, style: _Style, column: int, path: Path) -> None:
    # A column is not one of words if its words are numbers with separators of thousands.
    words = cells[~cells.map(lambda cell: _is_value(cell, style.decimal))]
    if len(words) and words.str.fullmatch(_THOUSANDS).all():
        rows = enumerate(io.StringIO(text), 1)
        line = next(n for n, raw in rows if n > style.first and words.iloc[0] in _fields(raw, style.separator))
        raise RecordingError(_no_number(f"{path}, line {line}", column, words.iloc[0]))


def _notes(lines: Sequence[str], style: _Style) -> list[str]:
    # What to check in the first lines: numbers of the head that are not applied, and rows of the data that may be none.
    found = []
    for number, line in enumerate(lines[: style.first], 1):
        fields = _fields(line, style.separator)
        numbers = sum(bool(cell) and _is_value(cell, style.decimal) for cell in fields)
        if len(fields) == style.count and numbers >= max(len(fields) - 1, 2):
            found.append(
                f"line {number} ({line.strip()[:60]!r}) has numbers for the columns, perhaps scales, which are not applied"
            )
        elif number == style.first and fields and numbers == len(fields) < style.count:
            found.append(f"line {number} ({line.strip()[:60]!r}) has {numbers} of {style.count} cells, so it is left out")
    rows = [fields for line in lines[style.first :] if len(fields := _fields(line, style.separator)) == style.count]
    digits = [[len(cell.rpartition(style.decimal)[2]) if style.decimal in cell else 0 for cell in row] for row in rows]
    below = {tuple(row) for row in digits[1:-1]}
    if len(rows) > LAST_LINES and len(below) == 1 and all(a != b for a, b in zip(digits[0], *below, strict=True)):
        found.append(
            f"line {style.first + 1} ({lines[style.first].strip()[:60]!r}) has other numbers of decimals than all rows below it: "
            "if it numbers the channels or has their sensitivities, delete it"
        )
    marked = [cell for row in rows for cell in row if style.decimal in cell]
    large = re.compile(rf"[+-]?[1-9]\d{{0,2}}{re.escape(style.decimal)}\d{{3}}")
    if style.separator != "," and len(marked) > 2 and all(map(large.fullmatch, marked)):
        found.append(
            f"each number with {style.decimal!r} has three digits after it ({marked[0]!r}) and none before it is 0: if it "
            "separates thousands, write sensitivity = 0.001"
        )
    return found


def _continued(columns: Sequence[FloatArray]) -> list[str]:
    # Whether each row seems to continue the one before it: a record that changes little from sample to sample changes less from
    # the end of a row to the start of the next one than from row to row.
    if len(columns) < 3 or len({len(values) for values in columns}) > 1 or len(columns[0]) < BESIDE:
        return []
    table = np.stack(columns, axis=1)
    if not np.isfinite(table).all():
        return []
    across = float(np.std(table[1:, 0] - table[:-1, -1]))
    if not across < CONTINUED * float(np.min(np.std(np.diff(table, axis=0), axis=0))):
        return []
    return [
        f"the {len(columns)} columns have no names, and each row seems to continue the one before it: if the file has one "
        "channel, row after row, write it as one column"
    ]


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
    filled = max((k for k, field in enumerate(fields, 1) if field), default=0)
    return 2 * len(there) >= filled > 0 and all(_is_value(field, decimal) for field in there)


def _is_value(field: str, decimal: str) -> bool:
    return _VALUE[decimal].fullmatch(field.strip('"')) is not None or CLOCK.fullmatch(field) is not None


def _head(head: Sequence[str], style: _Style) -> tuple[list[str], list[str]]:
    # Names and units: from the last header line with a name for each column, or a line of units and the names above it.
    rows: list[list[str]] = []
    longer: list[list[str]] = []
    lines = [line for line in reversed(head) if line.strip()]
    above = True
    for line in lines:
        fields = _named(line, style.separator, style) or []
        there = [field for field in fields if field]
        # Settings may have the same cell for several columns, or numbers: directly above the values, or their units, are names.
        units_here = _are_units(fields[: style.filled])
        different = _are_different(there) and not any(_is_value(cell, style.decimal) for cell in there)
        if fields and (above or different or units_here):
            (rows if len(fields) == style.count else longer).append(fields[: style.count])
        above = units_here
    blank = [""] * style.count
    rows = rows or [names for line in lines[:1] if (names := _other_names(line, style))] or longer
    wordy = [row for row in rows if any(map(names_time, row)) or not any(cell and _is_value(cell, style.decimal) for cell in row)]
    rows = wordy or rows
    at = next((k for k, row in enumerate(rows) if len(rows) > 1 and _are_units(row[: style.filled])), None)
    units = blank if at is None else rows.pop(at)
    rows = [row for row in rows if not _are_units(row[: style.filled])] if at is not None else rows
    # Below the units there may be places or types of sensors.
    below = at is None or at == len(rows) or any(map(names_time, rows[0]))
    names_at = 0 if below else next((k for k, row in enumerate(rows) if k >= (at or 0) and _are_different(row)), at or 0)
    named = [name_and_unit((sensitivity_in(name) or (name,))[0]) for name in (rows[names_at] if rows else blank)]
    names = [name or f"column{k}" for k, (name, _) in enumerate(named)]
    # A row of units may have its name in the first column.
    units = ["" if re.search(r"unit|einheit", unit, re.IGNORECASE) else unit.strip("[]()").strip(" -") for unit in units]
    return names, [unit or own for unit, (_, own) in zip(units, named, strict=True)]


def _sensitivities(head: Sequence[str], style: _Style) -> tuple[dict[int, tuple[float, str, str]], list[str]]:
    # By column: number, unit of the signal, and unit of the quantity, from a line with 100 mV/g in its cells, or with numbers in
    # them and mV/g in the first one; and sentences about other lines, which state the sensitivity of one channel.
    found: dict[int, tuple[float, str, str]] = {}
    single: dict[int, str] = {}
    for number, line in enumerate(head, 1):
        fields = _fields(line.lstrip("#% "), style.separator)
        per = re.split(r"[(\[]", fields[0], maxsplit=1)[-1] if fields else ""
        cells = (f"{cell} {per}" if k and re.fullmatch(r"[\d.,]+", cell) else cell for k, cell in enumerate(fields))
        here = {k: said for k, cell in enumerate(cells) if (said := sensitivity_in(cell))}
        named = all(rest and not re.match("sens", rest, re.IGNORECASE) for rest, *_ in here.values())
        if len(fields) == style.count and (named or len(here) > (style.count > 2)):
            found |= {k: said[1:] for k, said in here.items()}
        elif here:
            single[number] = line.strip()[:60]
    return found, [
        f"line {n} ({text!r}) states a sensitivity, which is not applied: give it to its channel" for n, text in single.items()
    ]


def _is_sensitivity(cell: str) -> bool:
    said = sensitivity_in(cell)
    return said is not None and not said[0]


def _sensed(column: Column, sensor: tuple[float, str, str] | None) -> Column:
    # A column in the unit of a sensor's signal has the sensor's quantity.
    known = known_unit(column.unit)
    if sensor is None or known is None or UNITS[known].quantity != UNITS[sensor[1]].quantity:
        return column
    number, signal, per = sensor
    return replace(column, unit=per, sensitivity=number * UNITS[signal].factor / UNITS[known].factor)


def _named(line: str, separator: str, style: _Style) -> list[str] | None:
    # The cells of a line that may have the names: one for each column with values, and perhaps settings after them.
    fields = [field.strip('"') for field in _fields(line.lstrip("#% "), separator)]
    while len(fields) > style.count and not fields[-1]:
        fields.pop()
    fields += [""] * (style.count - len(fields) if len(fields) >= style.filled else 0)
    cells = fields[: style.count]
    setting = any(re.match(r"\w+ ?=|.*:$", cell) or CLOCK.fullmatch(cell) or _is_sensitivity(cell) for cell in cells)
    few = len(fields) < style.count or 2 * sum(map(bool, fields[: style.filled])) < style.filled
    return None if few or setting else fields


def _other_names(line: str, style: _Style) -> list[str] | None:
    # Names with another separator than the data's, as written by numpy.savetxt.
    for separator in HEAD_SEPARATORS:
        fields = _named(line, separator, style)
        if fields and len(fields) == style.count > 1 and all(fields):
            return fields
    return None


def _are_different(row: Sequence[str]) -> bool:
    there = [cell for cell in row if cell]
    return len(there) == len({*there})


def _is_ratio(text: str) -> bool:
    # A unit of a transfer function or a sensitivity.
    over, *per = re.split(r"/(?=\()|/(?=[^/]*$)", text, maxsplit=1)
    return bool(per and known_unit(over) and known_unit(per[0]))


def _are_units(fields: Sequence[str]) -> bool:
    plain = [field.strip().strip("[]()").strip() for field in fields]
    known = [known_unit(field) is not None or seconds_per(field) is not None or _is_ratio(field) for field in plain]
    others = sum(field in ("", "-", "mV/V", *COUNTS, *OTHER_UNITS) for field in plain)
    return any(known) and (sum(known) + others == len(plain) or 3 * sum(known) >= 2 * len(plain))


def _rate(head: Sequence[str], style: _Style) -> float | None:
    # From a line of the header, or from a word and the number below it.
    rows = [_fields(line, style.separator) for line in head]
    pairs = (pair for one, below in itertools.pairwise(rows) for pair in zip(one, below, strict=False))
    for line in (*head, *(f"{name} {value}" for name, value in pairs if name and value and value[0] in "0123456789")):
        if found := _RATE.search(line):
            unit = _PREFIX.match(found["unit"]) or _PREFIX.search(found["gap"])
            prefix = unit["prefix"].lower() if unit else ""
            # 2.048 kHz are no 2048 kHz.
            rate = (_plain if prefix else partial(_number, style=style))(found["number"]) * {"": 1.0, "k": 1e3, "m": 1e6}[prefix]
        elif found := _STEP.search(line):
            # A time of a second or more is rather that of the measurement.
            written = found["unit"] or next((word for word in re.findall(r"[a-zµμ]+", found["gap"]) if seconds_per(word)), "s")
            step = _number(found["number"], style) * (seconds_per(written) or 1.0)
            rate = 1.0 / step if 0.0 < step < 1.0 else 0.0
        else:
            continue
        if 0.0 < rate < np.inf:
            return rate
    return None


def _number(text: str, style: _Style) -> float:
    # A number of the header, with the file's decimal mark: another mark separates thousands if it can.
    marks = ".,'’".replace(style.decimal, "")
    if re.fullmatch(rf"[1-9]\d{{0,2}}([{marks}]\d{{3}})+({re.escape(style.decimal)}\d+)?", text):
        text = re.sub(rf"[{marks}]", "", text)
    return _plain(text)


def _plain(text: str) -> float:
    # A number with a point or a comma for its decimals.
    return float(text.replace(",", ".")) if text.count(".") + text.count(",") < 2 else 0.0


TEXT = Format(extensions=(".csv", ".txt", ".tsv", ".dat", ".asc", ".prn"), name="text", read=read_text)
