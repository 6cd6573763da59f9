"""TDMS of LabVIEW, with an extra of this package."""

from __future__ import annotations

import logging
import re
from pathlib import Path

import numpy as np

from isorig.rig.errors import PlanError, RecordingError
from isorig.rig.exchange.table import UNTITLED, Column, ForeignTable, Format


def read_tdms(path: Path) -> ForeignTable:
    """Channels as group/name, with rate and unit from their properties; channels without samples are left out."""
    try:
        from nptdms import TdmsFile, log
    except ImportError:
        raise PlanError("reading TDMS needs the package npTDMS; install isorig[tdms]") from None
    columns: dict[str, Column] = {}
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
        for group in file.groups():
            for channel in group.channels():
                values = np.asarray(channel[:])
                name = f"{group.name}/{channel.name}"
                if not len(values):
                    empty.append(name)
                elif values.dtype.kind in "biuf":
                    step = float(channel.properties.get("wf_increment", 0.0))
                    # LabVIEW names channels Untitled unless they are given a name; then the group has one.
                    unnamed = UNTITLED.fullmatch(channel.name) and not UNTITLED.fullmatch(group.name)
                    columns[name] = Column(
                        values=values, sample_rate=1.0 / step if step > 0.0 else None,
                        unit=str(channel.properties.get("unit_string", "")), label=group.name if unnamed else "",
                    )  # fmt: skip
        if warnings:
            # It reads the available part of a truncated file; the missing amount is unknown.
            raise ValueError(warnings[0])
    finally:
        console.removeFilter(kept)
    if not columns:
        text = f"its channels {', '.join(empty)} are empty" if empty else "it has no channel of numbers"
        raise RecordingError(f"{path} has no samples ({text}); record it again, or export the file that the logger wrote them to")
    return ForeignTable(path=path, columns=columns, remarks=tuple(f"channel {name!r} has no samples" for name in empty))


TDMS = Format(extensions=(".tdms",), name="TDMS", read=read_tdms, begins=re.compile(b"TDSm"))
