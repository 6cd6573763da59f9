"""LVM, the text format of LabVIEW's measurement files: read by the package lvm_read, without its pickled copies."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.rig.errors import RecordingError
from isorig.rig.exchange.clock import column_rate, completed
from isorig.rig.exchange.formats.text import FILE_MOST, decoded
from isorig.rig.exchange.table import COLUMNS_MOST, Column, ForeignTable, Format
from isorig.rig.files.inputs import content_of
from isorig.rig.files.recording import VALUE_MOST

#: Names of the time column, and of the comment column.
X, COMMENT = "X_Value", "Comment"


def read_lvm(path: Path) -> ForeignTable:
    """Channels of each segment by name, with 1/, 2/ ... before it if there are several; rates and units from the header."""
    import lvm_read

    text = decoded(content_of(path, FILE_MOST))
    _whole(text, path)
    # It reads as many columns as the line of channels has cells, which some writers do not fill up.
    text = re.sub(r"(?m)^(Channels([\t,;]).*)$", lambda line: line[1].rstrip() + line[2] * COLUMNS_MOST, text)
    # Its other function looks for a pickled copy next to the file.
    content = lvm_read.read_str(text)
    segments = [content[k] for k in range(content["Segments"])]
    columns: dict[str, Column] = {}
    remarks: list[str] = []
    for k, segment in enumerate(segments, 1):
        found, said = completed(dict(_channels(segment, f"{path}, segment {k}", remarks)))
        columns |= {(f"{k}/{name}" if len(segments) > 1 else name): column for name, column in found.items()}
        remarks += said
    return ForeignTable(path=path, columns=columns, remarks=tuple(remarks))


def _whole(text: str, path: Path) -> None:
    # A line truncated during writing has fewer cells than the one before it.
    lines = text.rstrip().splitlines()
    if len(lines) > 1 and lines[-2].strip():
        separator = "\t" if "\t" in lines[-2] else ","
        wanted, found = (line.rstrip().count(separator) + 1 for line in lines[-2:])
        if found < wanted and lines[-2].lstrip()[:1] in "+-.0123456789":
            raise RecordingError(
                f"{path}, line {len(lines)}, the last, has {found} of {wanted} cells: it was truncated during writing; delete "
                "that line or copy the file again from its source"
            )


def _channels(segment: Mapping[str, Any], here: str, remarks: list[str]) -> Iterator[tuple[str, Column]]:
    data = np.asarray(segment["data"], dtype=np.float64)
    names = [str(name).strip() for name in segment["Channel names"]]
    if data.ndim != 2 or not len(data):
        raise RecordingError(f"{here} has no samples; record it again")
    places = [k for k, name in enumerate(names) if name not in (X, COMMENT, "") and k < data.shape[1]]
    clocks = [k for k, name in enumerate(names) if name == X]
    # Headers have a cell for each data column; if there is a time column before each channel, its cell is empty.
    shift = 1 if names and names[0] == X else 0

    # Some writers leave these cells out.
    def said(key: str, place: int) -> str:
        cells = [str(cell).strip() for cell in segment.get(key, [])]
        filled = [cell for cell in cells if cell]
        at, cells = (places.index(place), filled) if len(filled) == len(places) else (place - shift, cells)
        return dict(enumerate(cells)).get(at, "")

    for place in places:
        clock = max((k for k in clocks if k < place), default=None)
        step, unit = float(said("Delta_X", place) or "nan"), said("Y_Unit_Label", place)
        rate = _rate(None if clock is None else data[:, clock], step, f"{here}, {names[place]!r}")
        if rate is None and step > 0.0:
            remarks.append(f"the interval of {names[place]!r}, {step:g} s, is rounded, so its sample rate is unknown: give it")
        yield names[place], Column(values=data[:, place], sample_rate=rate, unit=unit)


def _rate(clock: FloatArray | None, step: float, here: str) -> float | None:
    # The header's interval has six digits; the clock's last reading is more accurate.
    if clock is not None and np.isfinite(clock).sum() > 2:
        return column_rate(X, Column(values=clock), f"{here}: its clock")
    if not 1.0 / VALUE_MOST < step < VALUE_MOST:
        return None
    half = 10.0 ** (np.floor(np.log10(step)) - 6) / 2.0 if step < 1e-4 else 5e-7
    low, high = 1.0 / (step + half), 1.0 / (step - half) if step > half else np.inf
    whole = np.arange(np.ceil(low), min(np.floor(high), np.ceil(low) + 2) + 1)
    if len(whole) == 1:
        return float(whole[0])
    # Several integer rates agree with a rounded interval: the one with exactly this interval is used, otherwise none.
    exact = round(1.0 / step)
    return float(exact) if abs(1.0 / exact - step) <= 1e-12 * step else (1.0 / step if not len(whole) else None)


LVM = Format(extensions=(".lvm",), name="LVM", read=read_lvm, advice="save it again from LabVIEW, or as CSV")
