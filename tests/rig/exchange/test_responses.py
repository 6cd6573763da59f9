"""Transfer functions of other programs as they are fitted here."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from isorig.rig.cli import main
from isorig.rig.errors import RecordingError
from isorig.rig.exchange.responses import read_responses
from isorig.rig.files.recording import open_recording
from isorig.rig.frf.transfer import transfer_functions

F = np.arange(1, 66) * 4.0
H = 1.0 / (100.0**2 - F**2 + 2j * 0.02 * 100.0 * F)


def test_what_this_program_exports_comes_back(recording: Path, tmp_path: Path) -> None:
    with open_recording(recording) as campaign:
        wanted = {item.name: item.frf for item in transfer_functions(campaign, resolution=4.0)}
    for ending in ("uff", "mat", "csv", "parquet"):
        words = ["export", str(recording), "-o", str(tmp_path / f"f.{ending}"), "--what", "frf", "--resolution", "4"]
        assert main(words) == 0
        found = read_responses(tmp_path / f"f.{ending}")
        assert len(found) == len(wanted)
        found, ours = (sorted(each, key=lambda f: abs(f.value[5])) for each in (found, wanted.values()))
        for one, other in zip(found, ours, strict=True):
            assert (one.response, one.reference) == (other.response, other.reference)
            np.testing.assert_allclose(one.value, other.value, rtol=1e-9, atol=1e-12)
            np.testing.assert_allclose(one.frequency, other.frequency)
            assert one.resolution == pytest.approx(4.0)


def test_rig_frf_reads_them(recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["export", str(recording), "-o", str(tmp_path / "f.uff"), "--what", "frf", "--resolution", "4"]
    assert main(words) == 0
    out = tmp_path / "out"
    assert main(["frf", str(tmp_path / "f.uff"), "-o", str(out)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "transfer functions of another program, written as they are" in said
    assert "No 95 % limits of the magnitude: a single average, or an unknown number" in said
    content = json.loads((out / "frf.json").read_text())
    assert {item["averages"] for item in content["transfer_functions"]} == {None}
    with open_recording(recording) as campaign:
        wanted = transfer_functions(campaign, resolution=4.0)
    assert len(content["transfer_functions"]) == len(wanted) == len(list(out.glob("*.csv")))
    peak = max(float(np.abs(item.frf.value).max()) for item in wanted)
    assert max(item["peak"]["magnitude"] for item in content["transfer_functions"]) == pytest.approx(peak, rel=1e-6)


def test_rig_frf_refuses_channels_that_the_file_lacks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    savemat(tmp_path / "h.mat", {"f": F, "H": H})
    assert main(["frf", str(tmp_path / "h.mat"), "--response", "nobody", "-o", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert "has no transfer function of these channels but" in error
    assert len(error.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_coherence_comes_along(shared: Path) -> None:
    folder = shared / "peers" / "pydvma"
    (one,) = read_responses(folder / "jw_tf_coh.mat")
    assert one.coherence.max() <= 1.0
    assert np.ptp(one.coherence) > 0.0
    ruler = read_responses(folder / "ruler_grid_acc_3.mat")
    assert len(ruler) == 10
    assert ruler[0].resolution == pytest.approx(20000 / 32768)
    assert {float(f.coherence.min()) for f in ruler} == {1.0}


def test_uneven_lines_and_files_without_any(tmp_path: Path) -> None:
    savemat(tmp_path / "log.mat", {"f": np.geomspace(1.0, 100.0, 65), "H": H})
    savemat(tmp_path / "psd.mat", {"f": F, "Pxx": np.abs(H)})
    savemat(tmp_path / "time.mat", {"fs": 100.0, "x": np.abs(H)})
    for name, said in (
        ("log", "uneven frequency steps"),
        ("psd", "without a phase"),
        ("time", "import it first: rig import --draft"),
    ):
        with pytest.raises(RecordingError, match=said):
            read_responses(tmp_path / f"{name}.mat")
