"""WAV."""

import re
import struct
import warnings
from pathlib import Path

from isorig.rig.exchange.table import COLUMNS_MOST, UNNAMED, Column, ForeignTable, Format, vectors_of


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
    columns = {name: Column(values=v, sample_rate=float(rate)) for name, v in vectors_of(UNNAMED, values, samples=0).items()}
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


WAV = Format(extensions=(".wav",), name="WAV", read=read_wav, begins=re.compile(b"RIFF|RIFX"))
