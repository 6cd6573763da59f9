"""Files of other programs whose headers or members are not what they seem: one sentence that names the fault."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
from scipy.io import wavfile

from isorig.rig.cli import main
from isorig.rig.exchange.reading import read_foreign


@pytest.mark.parametrize("channels", [0, 257, 65535])
def test_a_wav_file_with_too_many_channels_names_them(tmp_path: Path, channels: int, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.wav"
    wavfile.write(path, 512, np.arange(400, dtype=np.int16).reshape(-1, 2))
    content = bytearray(path.read_bytes())
    at = content.index(b"fmt ") + 10
    assert struct.unpack_from("<H", content, at) == (2,)
    struct.pack_into("<H", content, at, channels)
    path.write_bytes(content)
    assert main(["import", "--draft", str(path), "-o", str(tmp_path / "m.toml")]) == 2
    assert f"its header states {channels} channels; 1 to " in capsys.readouterr().err


def test_a_member_of_an_npz_file_that_is_no_array_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, head=np.arange(100.0), fs=512.0)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("readme.txt", "recorded on a Monday")
    table = read_foreign(path)
    assert list(table.columns) == ["head"]
    assert any("'readme.txt' is not an array" in remark for remark in table.remarks)
