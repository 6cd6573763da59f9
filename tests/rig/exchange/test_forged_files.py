"""Files of other programs whose headers or members are not what they seem: one sentence that names the fault."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat, wavfile

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


def refused(call: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The one line in which a command refuses its input."""
    assert main(call) == 2
    said = capsys.readouterr().err
    assert said.startswith("rig: ")
    assert said.count("\n") == 1
    return said


def mapping(folder: Path, file: str, time: str = "") -> list[str]:
    """The command that imports the column h of a file."""
    (folder / "m.toml").write_text(
        f'[channels.head]\nsource = "h"\nunit = "g"\n[[runs]]\nid = "a"\nfile = "{file}"\nconfiguration = "unlocked"\n'
        f"gain = 7.0\n{time}"
    )
    return ["import", str(folder / "m.toml"), "-o", str(folder / "o.h5")]


@pytest.mark.parametrize("kind", ["npy", "npz"])
@pytest.mark.parametrize(
    ("sound", "damaged"),
    [
        (b"(100,), }", b"(100,  } "),
        (b"(100,), }", b"(100,), ("),
        (b"(100,), }", b"(9" + b"9" * 40 + b",), }"),
        (b"(100,), }", b"(" * 3000),
    ],
)
def test_a_damaged_header_of_an_array_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str, sound: bytes, damaged: bytes
) -> None:
    np.save(tmp_path / "a.npy", np.arange(100.0))
    content = (tmp_path / "a.npy").read_bytes()
    size, begin = struct.unpack_from("<H", content, 8)[0], 10
    header = content[begin : begin + size].rstrip().replace(sound, damaged) + b"\n"
    content = content[:8] + struct.pack("<H", len(header)) + header + content[begin + size :]
    (tmp_path / "a.npy").write_bytes(content)
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("h.npy", content)
    path = tmp_path / f"a.{kind}"
    said = refused(["import", "--draft", str(path), "-o", str(tmp_path / "m.toml")], capsys)
    assert f"cannot be read as a .{kind} file" in said


@pytest.mark.parametrize("extent", [1e308, -1e308, 1e200, 1e-320])
def test_a_clock_beyond_all_clocks_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], extent: float) -> None:
    """Its slope has no finite rate; it is named, not divided by."""
    t = np.arange(100) / 512.0
    if abs(extent) > 1.0:
        t[50] = extent
    else:
        t = extent * np.arange(100.0)
    np.savez(tmp_path / "a.npz", h=np.arange(100.0), t=t)
    assert "column 't' goes" in refused(mapping(tmp_path, "a.npz", 'time = "t"\n'), capsys)


@pytest.mark.parametrize("numbers", [{"fs": 0.0}, {"fs": np.inf}, {"dt": np.inf}, {"dt": 1e-320}, {"buflen": 100.0, "freq": 0.0}])
def test_a_rate_that_is_no_rate_is_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], numbers: dict[str, float]
) -> None:
    savemat(tmp_path / "a.mat", {"h": np.arange(100.0), **numbers})
    assert "give sample_rate" in refused(mapping(tmp_path, "a.mat"), capsys)


def test_a_wav_file_without_a_rate(tmp_path: Path) -> None:
    wavfile.write(tmp_path / "a.wav", 512, np.arange(400, dtype=np.int16))
    content = bytearray((tmp_path / "a.wav").read_bytes())
    struct.pack_into("<II", content, content.index(b"fmt ") + 12, 0, 0)
    (tmp_path / "a.wav").write_bytes(content)
    table = read_foreign(tmp_path / "a.wav")
    assert table.columns["channel"].sample_rate is None
    assert table.remarks == ("column 'channel' states 0 Hz, which is no sample rate, so it is not used",)


@pytest.mark.parametrize("step", ["0", "1e-320", "1e400"])
def test_an_interval_that_is_no_interval(tmp_path: Path, step: str) -> None:
    head = "LabVIEW Measurement\nSeparator\tTab\nX_Columns\tNo\n***End_of_Header***\n\nChannels\t1\nSamples\t9\n"
    rows = "".join(f"\t{k}\n" for k in range(9))
    (tmp_path / "a.lvm").write_text(f"{head}Delta_X\t{step}\n***End_of_Header***\nX_Value\th\tComment\n{rows}")
    assert read_foreign(tmp_path / "a.lvm").columns["h"].sample_rate is None


@pytest.mark.parametrize("name", [b"more", b"t"])
def test_a_name_in_hdf5_that_is_no_text_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: bytes) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["more/h"], file["t"] = np.arange(100.0), np.arange(100) / 512.0
        file.move(name.decode(), "@@" + name.decode())
    content = (tmp_path / "a.h5").read_bytes()
    assert content.count(b"@@" + name) == 1
    (tmp_path / "a.h5").write_bytes(content.replace(b"@@" + name, b"S\xfc" + name))
    said = refused(["import", "--draft", str(tmp_path / "a.h5"), "-o", str(tmp_path / "m.toml")], capsys)
    assert "is not UTF-8; write the file again" in said
