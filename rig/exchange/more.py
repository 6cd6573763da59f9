"""Formats that fewer labs have: TDMS of LabVIEW (an extra of this package) and WAV."""

from __future__ import annotations

import warnings
from pathlib import Path

from rig.errors import PlanError, RecordingError
from rig.exchange.table import Column, ForeignTable, columns_of


def read_tdms(path: Path) -> ForeignTable:
    """Channels as group/name, with the rate and unit that their properties say."""
    try:
        from nptdms import TdmsFile
    except ImportError:
        raise PlanError("reading TDMS needs the package npTDMS; install isorig[tdms]") from None
    columns = {}
    try:
        file = TdmsFile.read(path)
        for group in file.groups():
            for channel in group.channels():
                step = float(channel.properties.get("wf_increment", 0.0))
                columns[f"{group.name}/{channel.name}"] = Column(
                    values=channel[:], sample_rate=1.0 / step if step > 0.0 else None,
                    unit=str(channel.properties.get("unit_string", "")),
                )  # fmt: skip
    except Exception as error:
        # The package raises bare exceptions, KeyError and struct.error on damaged files.
        told = (str(error).splitlines() or [type(error).__name__])[0]
        raise RecordingError(f"{path} cannot be read as TDMS ({told}); copy it again from its source") from None
    return ForeignTable(path=path, columns={name: c for name, c in columns.items() if c.values.dtype.kind in "biuf"})


def read_wav(path: Path) -> ForeignTable:
    """Channels as channel[0], channel[1] ...; values as stored, so the sensitivity is per converter step."""
    from scipy.io import wavfile

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", wavfile.WavFileWarning)
            rate, values = wavfile.read(path)
    except Exception as error:
        # scipy raises ValueError, struct.error or UnboundLocalError on damaged files.
        told = (str(error).splitlines() or [type(error).__name__])[0]
        raise RecordingError(f"{path} cannot be read as WAV ({told}); copy it again from its source") from None
    return ForeignTable(path=path, columns=columns_of("channel", values, float(rate)))
