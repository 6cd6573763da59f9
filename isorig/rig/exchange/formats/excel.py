"""Excel workbooks, with an extra of this package: each sheet as a table of text."""

import re
import zipfile
from collections.abc import Iterable
from contextlib import closing
from datetime import datetime, time
from pathlib import Path
from typing import Any

from isorig.rig.errors import PlanError, RecordingError
from isorig.rig.exchange.formats.text import table_of_text
from isorig.rig.exchange.table import Column, ForeignTable, Format, check_declared
from isorig.rig.exchange.tree import SHORT


def read_excel(path: Path) -> ForeignTable:
    """The columns of all sheets by name, with sheet/ before it if several have columns; the numbers of the others by name. Raises
    RecordingError, with what is wrong in each sheet, if none has columns of numbers."""
    try:
        from openpyxl import load_workbook
    except ImportError:
        raise PlanError("reading Excel workbooks needs the package openpyxl; install isorig[excel], or save it as CSV") from None
    with zipfile.ZipFile(path) as archive:
        check_declared(path, sum(item.file_size for item in archive.infolist()), path.stat().st_size, "save it as CSV")
    tables: dict[str, ForeignTable] = {}
    remarks: list[str] = []
    numbers: dict[str, float] = {}
    with closing(load_workbook(path, read_only=True, data_only=True)) as book:
        for sheet in book.worksheets:
            rows = [list(row) for row in sheet.iter_rows(values_only=True)]
            try:
                table = table_of_text("".join(map(_line, rows)), path)
                if len(rows) < SHORT:
                    raise RecordingError(f"it has {len(rows)} rows")
                tables[sheet.title] = table
            except RecordingError as why:
                remarks.append(f"sheet {sheet.title!r} is left out ({why})")
                numbers |= {f"{sheet.title}/{row[0]}": float(row[1]) for row in rows if _is_setting(row)}
    columns: dict[str, Column] = {}
    for title, table in tables.items():
        columns |= {f"{title}/{name}" if len(tables) > 1 else name: column for name, column in table.columns.items()}
        remarks += [f"sheet {title!r}: {remark}" for remark in table.remarks]
    spectra = tuple(spectrum for table in tables.values() for spectrum in table.spectra)
    return ForeignTable(path=path, columns=columns, numbers=numbers, spectra=spectra, remarks=tuple(remarks))


def _line(row: Iterable[Any]) -> str:
    return "\t".join(map(_cell, row)).rstrip("\t") + "\n"


def _cell(value: Any) -> str:
    if isinstance(value, datetime):
        return value.isoformat(" ", "microseconds")
    if isinstance(value, time):
        return value.isoformat("microseconds")
    return "" if value is None else " ".join(str(value).split())


def _is_setting(row: list[Any]) -> bool:
    # A name and its number.
    return len(row) > 1 and isinstance(row[0], str) and isinstance(row[1], int | float)


EXCEL = Format(
    extensions=(".xlsx", ".xlsm"), name="an Excel workbook", read=read_excel, advice="save its numbers as CSV",
    begins=re.compile(rb"PK\x03\x04.{26}(?:\[Content_Types\]|_rels/|docProps/|customXml/|xl/)", re.DOTALL),
)  # fmt: skip
