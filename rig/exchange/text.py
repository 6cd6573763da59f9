"""Text files of columns: comma, semicolon, tab or blanks between them, decimal point or comma, a head or none."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from rig.errors import RecordingError
from rig.exchange.table import Column, ForeignTable

#: Separator and decimal mark, in the order in which they are tried.
STYLES = ((";", ","), (";", "."), ("\t", ","), ("\t", "."), (",", "."), (r"\s+", "."), (r"\s+", ","))
#: The head ends within so many lines.
HEAD_LINES = 200


def read_text(path: Path) -> ForeignTable:
    """The columns of a text file; a unit in brackets after a column's name is kept."""
    raw = path.read_bytes()
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    lines = [line.rstrip("\r\n") for line in io.StringIO(text[: 1 << 20]).readlines()[:HEAD_LINES]]
    separator, decimal, first = _style(lines, path)
    count = len(_fields(lines[first], separator))
    names = _names(lines[:first], separator, count)
    try:
        frame = pd.read_csv(
            io.StringIO(text), sep=separator, decimal=decimal, skiprows=first, header=None, names=range(count),
            dtype="float64", comment="#", skip_blank_lines=True, skipinitialspace=True,
        )  # fmt: skip
    except (ValueError, pd.errors.ParserError) as error:
        raise RecordingError(
            f"{path} has a cell that is not a number ({str(error).splitlines()[0]}); correct or cut it"
        ) from None
    columns = {}
    for k, head in enumerate(names):
        name, unit = _unit(head)
        columns[name if name not in columns else f"{name}[{k}]"] = Column(values=frame[k].to_numpy(), unit=unit)
    return ForeignTable(path=path, columns=columns)


def _style(lines: Sequence[str], path: Path) -> tuple[str, str, int]:
    # The style in which two lines in a row are numbers throughout, with the most columns.
    best: tuple[int, str, str, int] | None = None
    for separator, decimal in STYLES:
        for k, line in enumerate(lines):
            fields = _fields(line, separator)
            after = next((_fields(other, separator) for other in lines[k + 1 :] if other.strip()), fields)
            if _numeric(fields, decimal) and _numeric(after, decimal) and len(after) == len(fields):
                if best is None or len(fields) > best[0]:
                    best = (len(fields), separator, decimal, k)
                break
    if best is None:
        raise RecordingError(f"{path} has no columns of numbers in its first {len(lines)} lines; export it as plain text columns")
    return best[1], best[2], best[3]


def _fields(line: str, separator: str) -> list[str]:
    line = line.strip()
    return line.split() if separator == r"\s+" else [field.strip() for field in line.split(separator)]


def _numeric(fields: Sequence[str], decimal: str) -> bool:
    pattern = rf"[+-]?(\d+({re.escape(decimal)}\d*)?|{re.escape(decimal)}\d+)([eE][+-]?\d+)?|[+-]?(nan|inf)"
    return bool(fields) and all(re.fullmatch(pattern, field, re.IGNORECASE) for field in fields)


def _names(head: Sequence[str], separator: str, count: int) -> list[str]:
    # The last line of the head with a name for each column.
    for line in reversed(head):
        fields = [field.strip('"') for field in _fields(line.lstrip("#% "), separator)]
        if len(fields) == count and all(fields):
            return fields
    return [f"column{k}" for k in range(count)]


def _unit(head: str) -> tuple[str, str]:
    found = re.fullmatch(r"(.+?)\s*[\[(]([^\])]+)[\])]", head)
    return (found[1], found[2]) if found else (head, "")
