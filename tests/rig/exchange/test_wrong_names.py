"""Files whose content is of another format than their name says, and text that is no table."""

from __future__ import annotations

import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat, wavfile

from isorig.rig.cli import main
from isorig.rig.exchange.formats import FORMATS

X = np.random.default_rng(1).normal(size=600)
#: A function at nodal DOF, as far as it is needed to recognize it.
UNIVERSAL = "    -1\n    58\nforce\n"


def written(path: Path, kind: str) -> None:
    if kind in ("Excel", "OpenDocument", "archive", ".npz file"):
        with zipfile.ZipFile(path, "w") as archive:
            names = {"Excel": ["[Content_Types].xml", "xl/workbook.xml"], "OpenDocument": ["mimetype", "content.xml"]}
            for name in names.get(kind, ["a.npy" if kind == ".npz file" else "a.csv"]):
                archive.writestr(name, "1,2\n")
    elif kind.startswith("HDF5"):
        with h5py.File(path, "w", userblock_size=512 if kind.endswith("7.3") else 0) as file:
            file["force"] = X
    elif kind == "MATLAB":
        with path.open("wb") as file:
            savemat(file, {"force": X})
    elif kind == "TDMS":
        with TdmsWriter(path) as writer:
            writer.write_segment([ChannelObject("g", "force", X)])
    elif kind == "WAV":
        wavfile.write(path, 1024, X)
    elif kind == ".npy file":
        with path.open("wb") as file:
            np.save(file, X)
    else:
        starts = {
            "document": b"\xd0\xcf\x11\xe0",
            "Parquet": b"PAR1",
            "compressed": b"\x1f\x8b",
            "PDF": b"%PDF",
            "cut archive": b"PK\x03\x04",
        }
        path.write_bytes(starts.get(kind, UNIVERSAL.encode()) + bytes(100))


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("Excel", "contains an Excel workbook, not {}; rename it to run.xlsx"),
        ("OpenDocument", "is an OpenDocument file; save it as CSV"),
        ("archive", "is an archive; unpack it"),
        ("cut archive", "is a damaged archive; save or copy it again"),
        (".npz file", "contains a .npz file, not {}; rename it to run.npz"),
        ("HDF5", "contains HDF5, not {}; rename it to run.h5"),
        ("HDF5 of MATLAB 7.3", "contains HDF5, not {}; rename it to run.h5"),
        ("MATLAB", "contains a MATLAB file, not {}; rename it to run.mat"),
        ("TDMS", "contains TDMS, not {}; rename it to run.tdms"),
        ("WAV", "contains WAV, not {}; rename it to run.wav"),
        (".npy file", "contains a .npy file, not {}; rename it to run.npy"),
        ("universal", "contains a universal file, not {}; rename it to run.uff"),
        ("document", "is an Excel workbook or another document; save its numbers as CSV"),
        ("Parquet", "contains a Parquet file, not {}; rename it to run.parquet"),
        ("compressed", "is compressed; unpack it"),
        ("PDF", "is a PDF document; export its numbers as CSV"),
    ],
)
@pytest.mark.parametrize("extension", [".csv", ".json", ".lvm", ".xls"])
def test_content_of_another_format(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str, said: str, extension: str
) -> None:
    path = tmp_path / f"run{extension}"
    written(path, kind)
    assert main(["import", "--draft", str(path), "-o", str(tmp_path / "m.toml")]) == 2
    named = f", not {FORMATS[extension].name}" if extension in FORMATS else ""
    assert capsys.readouterr().err == f"rig: {path} {said.replace(', not {}', named)}\n"


@pytest.mark.parametrize("extension", [".h5", ".mat"])
@pytest.mark.parametrize("kind", ["HDF5", "HDF5 of MATLAB 7.3"])
def test_hdf5_may_be_named_as_of_matlab(tmp_path: Path, kind: str, extension: str) -> None:
    written(tmp_path / f"run{extension}", kind)
    assert main(["import", "--draft", str(tmp_path / f"run{extension}"), "-o", str(tmp_path / "m.toml")]) == 0


def commas(count: int, digits: int) -> list[str]:
    return [",".join(f"{value:.{digits}f}".replace(".", ",") for value in (k / 100, *X[k : k + 2])) for k in range(count)]


COUNTS = [f"{k},{1000 + k * k % 8000},{k % 7},{2000 + k}" for k in range(50)]


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["t,force,block"], "has no columns of numbers, only the line 't,force,block'; export"),
        (["Logger 7", "no data"], "has no columns of numbers in its first 2 lines"),
        (["t,force,block", *commas(50, 4)], "seems to have decimal commas in columns that commas separate, too ('0,0000,"),
        (["t,force,block", *commas(50, 1)], "seems to have decimal commas"),
        (commas(50, 3), "seems to have decimal commas"),
        (COUNTS, ""),
        (["Logger,7", *COUNTS], ""),
        (["a,b,c,d", *COUNTS], ""),
        (["a;b;c", *(line.replace(",", ";") for line in COUNTS)], ""),
    ],
)
def test_text_that_is_no_table(tmp_path: Path, capsys: pytest.CaptureFixture[str], lines: list[str], said: str) -> None:
    (tmp_path / "run.csv").write_text("\n".join(lines) + "\n")
    assert main(["import", "--draft", str(tmp_path / "run.csv"), "-o", str(tmp_path / "m.toml")]) == (2 if said else 0)
    text = capsys.readouterr().err
    assert said in text
    assert text.count("\n") == bool(said)
