"""Less common formats: TDMS of LabVIEW (an extra of this package) and WAV."""

from __future__ import annotations

import logging
import re
import struct
import warnings
from pathlib import Path

import numpy as np

from isorig.rig.errors import PlanError, RecordingError
from isorig.rig.exchange.table import COLUMNS_MOST, Column, ForeignTable, vectors_of


class _Warnings:
    """Collects the warnings of a package instead of printing them."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def keep(self, record: logging.LogRecord) -> bool:
        """Collect a warning, and stop its propagation."""
        self.lines.append(record.getMessage())
        return False


def read_tdms(path: Path) -> ForeignTable:
    """Channels as group/name, with rate and unit from their properties; channels without samples are left out."""
    try:
        from nptdms import TdmsFile, log
    except ImportError:
        raise PlanError("reading TDMS needs the package npTDMS; install isorig[tdms]") from None
    columns: dict[str, Column] = {}
    empty: list[str] = []
    said = _Warnings()
    # The package's loggers print directly.
    console = log.log_manager.console_handler
    console.addFilter(said.keep)
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
                    columns[name] = Column(
                        values=values, sample_rate=1.0 / step if step > 0.0 else None,
                        unit=str(channel.properties.get("unit_string", "")), label=_tdms_label(group.name, channel.name),
                    )  # fmt: skip
        if said.lines:
            # It reads the available part of a truncated file; the missing amount is unknown.
            raise ValueError(said.lines[0])
    finally:
        console.removeFilter(said.keep)
    if not columns:
        text = f"its channels {', '.join(empty)} are empty" if empty else "it has no channel of numbers"
        raise RecordingError(f"{path} has no samples ({text}); record it again, or export the file that the logger wrote them to")
    return ForeignTable(path=path, columns=columns, remarks=tuple(f"channel {name!r} has no samples" for name in empty))


def _tdms_label(group: str, channel: str) -> str:
    # LabVIEW names channels Untitled unless they are given a name; then the group has one.
    return group if re.fullmatch(r"Untitled( \d+)?", channel) and not re.fullmatch(r"Untitled( \d+)?", group) else ""


def read_wav(path: Path) -> ForeignTable:
    """Channels as channel[0], channel[1] ...; integers are converter counts of any width."""
    from scipy.io import wavfile

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", wavfile.WavFileWarning)
        # A file that ends before its samples do is truncated; the package only warns.
        warnings.filterwarnings("error", message="Reached EOF prematurely", category=wavfile.WavFileWarning)
        channels, bits = _header(path)
        if not 1 <= channels <= COLUMNS_MOST:
            raise ValueError(f"its header states {channels} channels; 1 to {COLUMNS_MOST} are read")
        rate, values = wavfile.read(path)
    if values.dtype.kind == "i" and 0 < bits < 8 * values.dtype.itemsize:
        # 24-bit samples are in the upper three of four bytes.
        values = values >> (8 * values.dtype.itemsize - bits)
    columns = {name: Column(values=v, sample_rate=float(rate)) for name, v in vectors_of("channel", values).items()}
    return ForeignTable(path=path, columns=columns)


def _header(path: Path) -> tuple[int, int]:
    # Channels and bits of a sample, from the chunk "fmt " (Microsoft, "Multimedia Programming Interface", RIFF WAVE): scipy does
    # not return the bits, and divides by the size of a sample in which the channels do not fit.
    with path.open("rb") as file:
        order = ">" if file.read(12)[:4] == b"RIFX" else "<"
        while len(head := file.read(8)) == 8:
            name, size = head[:4], struct.unpack(f"{order}I", head[4:])[0]
            if name == b"fmt ":
                _, channels, _, _, _, bits = struct.unpack(f"{order}HHIIHH", file.read(16))
                return int(channels), int(bits)
            file.seek(size + size % 2, 1)
    raise ValueError("it has no chunk with its format")
