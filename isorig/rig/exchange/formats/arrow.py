"""Parquet, and Feather or Arrow files: their columns by name, by the package pyarrow."""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from isorig.rig.exchange.clock import clock_of, completed
from isorig.rig.exchange.table import Column, ForeignTable, Format, check_declared
from isorig.rig.exchange.tree import over_frequency, table_of
from isorig.rig.exchange.units import name_and_unit

#: Bytes of a value in memory, at most.
VALUE_BYTES = 8


def _reader(opened: Callable[[Path], Any]) -> Callable[[Path], ForeignTable]:
    # A reader of tables that are opened in this way.
    def read(path: Path) -> ForeignTable:
        remarks: list[str] = []
        items = list(_items(opened(path), remarks))
        words = {name: values for name, values in items if not isinstance(values, str) and values.dtype.kind in "US"}
        numbers = {name: Column(values=values) for name, values in items if not isinstance(values, str) and name not in words}
        if (over := over_frequency(path, numbers, words)) is not None:
            return over
        table = table_of(path, items, remarks)
        columns, said = completed(table.columns)
        return replace(table, columns=columns, remarks=(*table.remarks, *said))

    return read


def _items(table: Any, remarks: list[str]) -> Iterator[tuple[str, Any]]:
    # The index of pandas is a column, too, but for one that numbers the rows. Null is a lost sample.
    import pyarrow as pa

    for name, column in zip(table.column_names, table.columns, strict=True):
        values = column.to_numpy()
        if values.dtype.kind == "O" and (clock := clock_of(values)) is not None:
            values = clock
        if values.dtype.kind == "O" and len(values) and isinstance(values[0], str):
            yield name, values.astype(str)
        if values.dtype.kind not in "biufmM":
            remarks.append(f"column {name!r} has values of type {column.type}, which are no numbers, and is left out")
            continue
        if column.null_count and pa.types.is_temporal(column.type):
            remarks.append(f"column {name!r} has {column.null_count} rows without a time, and is left out")
            continue
        plain, unit = name_and_unit(name)
        # A point in a name does not separate it from a structure.
        key = plain.replace(".", "_")
        yield key, values
        if unit:
            yield f"{key}_unit", unit


def _parquet(path: Path) -> Any:
    from pyarrow import parquet

    file = parquet.ParquetFile(path, page_checksum_verification=True)
    check_declared(path, file.metadata.num_rows * file.metadata.num_columns * VALUE_BYTES, path.stat().st_size, "save it as CSV")
    return file.read()


def _arrow(path: Path) -> Any:
    from pyarrow import ipc, memory_map

    with memory_map(str(path)) as file:
        return ipc.open_file(file).read_all()


PARQUET = Format(extensions=(".parquet",), name="a Parquet file", read=_reader(_parquet), begins=re.compile(b"PAR1"))
ARROW = Format(
    extensions=(".feather", ".arrow"), name="an Arrow or Feather file", read=_reader(_arrow), advice="save it as Parquet or CSV",
    begins=re.compile(b"ARROW1"),
)  # fmt: skip
