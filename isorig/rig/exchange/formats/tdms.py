"""TDMS of LabVIEW, with an extra of this package."""

import logging
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from isorig.rig.errors import PlanError, RecordingError
from isorig.rig.exchange.table import UNTITLED, ForeignTable, Format
from isorig.rig.exchange.tree import OWN, table_of

#: Words in the name of a property that may scale a channel; the others describe the file.
SCALES = re.compile(r"sensitiv|calib|scale[ _]?factor", re.IGNORECASE)
#: Properties of a channel with its unit.
UNITS = ("NI_UnitDescription", "unit_string")


def read_tdms(path: Path) -> ForeignTable:
    """Channels as group/name, with rate and unit from their properties; channels without samples are left out."""
    try:
        from nptdms import TdmsFile, log
    except ImportError:
        raise PlanError("reading TDMS needs the package npTDMS; install isorig[tdms]") from None
    items: list[tuple[str, Any]] = []
    labels: dict[str, str] = {}
    empty: list[str] = []
    warnings: list[str] = []

    def kept(record: logging.LogRecord) -> bool:
        warnings.append(record.getMessage())
        return False

    # The package's loggers print directly.
    console = log.log_manager.console_handler
    console.addFilter(kept)
    try:
        file = TdmsFile.read(path)
        items += file.properties.items()
        for group in file.groups():
            items += ((f"{group.name}/{key}", value) for key, value in group.properties.items())
            for channel in group.channels():
                values = np.asarray(channel[:])
                name = f"{group.name}/{channel.name}"
                if not len(values):
                    empty.append(name)
                    continue
                items.append((name, values))
                items += (
                    (f"{name}_unit" if key in UNITS else f"{name}{OWN}/{key}", v) for key, v in channel.properties.items() if v
                )
                # LabVIEW names channels Untitled unless they are given a name; then the group has one.
                if UNTITLED.fullmatch(channel.name) and not UNTITLED.fullmatch(group.name):
                    labels[name] = group.name
        if warnings:
            # It reads the available part of a truncated file; the missing amount is unknown.
            raise ValueError(warnings[0])
    finally:
        console.removeFilter(kept)
    table = table_of(path, items, [f"channel {name!r} has no samples" for name in empty], dot="/")
    if not table.columns:
        text = f"its channels {', '.join(empty)} are empty" if empty else "it has no channel of numbers"
        raise RecordingError(f"{path} has no samples ({text}); record it again, or export the file that the logger wrote them to")
    named = {name: replace(column, label=labels.get(name, "")) for name, column in table.columns.items()}
    scales = {name: number for name, number in table.numbers.items() if SCALES.search(name)}
    return replace(table, columns=named, numbers=scales)


TDMS = Format(extensions=(".tdms",), name="TDMS", read=read_tdms, begins=re.compile(b"TDSm"))
