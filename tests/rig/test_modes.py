"""`rig modes`: close modes, several drives, hammer tests, other programs' files; pictures, page and refusals."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.spectra.modal import mac
from isorig.rig.cli import main
from isorig.rig.files.recording import write

RATE = 512.0
#: Frequency (Hz), damping ratio, shape at three sensors, and how much each of two drives excites it.
MODES = (
    (50.0, 0.008, (1.0, 0.8, 0.3), (1.0, 0.3)),
    (52.0, 0.006, (0.7, -0.9, 1.0), (0.4, -1.0)),
    (90.0, 0.010, (0.5, 0.6, -1.0), (-0.6, 0.8)),
)


def accelerances(f: FloatArray) -> Any:
    """Shape (sensors, drives, bins)."""
    s = 2j * np.pi * f
    return sum(
        np.multiply.outer(np.outer(shape, push), s**2 / (s**2 + 2.0 * zeta * 2.0 * np.pi * f0 * s + (2.0 * np.pi * f0) ** 2))
        for f0, zeta, shape, push in MODES
    )


def answered(path: Path, *words: str) -> dict[str, Any]:
    assert main(["modes", str(path), *words, "-o", str(path.parent / "out")]) == 0
    content: dict[str, Any] = json.loads((path.parent / "out" / "modes.json").read_text())
    return content


def shapes(content: dict[str, Any]) -> Any:
    """Shape (sensors, modes)."""
    return np.array([[complex(*part) for part in mode["shape"]] for mode in content["modes"]]).T


def recording(folder: Path, drives: int, seconds: float = 200.0) -> Path:
    draw = np.random.default_rng(7)
    n = round(seconds * RATE)
    forces = draw.normal(0.0, 1.0, (drives, n))
    lines = accelerances(np.fft.rfftfreq(n, 1.0 / RATE))[:, :drives]
    answers = np.fft.irfft(np.einsum("ijf,jf->if", lines, np.fft.rfft(forces)), n)
    answers += draw.normal(0.0, 0.01, answers.shape) * answers.std(axis=1, keepdims=True)
    channels = {f"f{k}": Channel(name=f"f{k}", samples=row, quantity="force", unit="N") for k, row in enumerate(forces)}
    channels |= {f"s{k}": Channel(name=f"s{k}", samples=row) for k, row in enumerate(answers)}
    run = Run(id="a", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels, excitation="random")
    write(folder / "run.h5", Campaign(runs=(run,)))
    return folder / "run.h5"


@pytest.mark.parametrize("drives", [1, 2])
def test_close_modes_are_found_on_all_sensors_without_guesses(drives: int, tmp_path: Path) -> None:
    path = recording(tmp_path, drives)
    references = [word for k in range(drives) for word in ("--reference", f"f{k}")]
    sensors = [word for k in range(3) for word in ("--response", f"s{k}")]
    found = answered(path, *references, *sensors, "--band", "35", "110")
    assert found["references"] == [f"f{k}" for k in range(drives)]
    for mode, (f0, zeta, _, _) in zip(found["modes"], MODES, strict=True):
        assert mode["frequency_hz"] == pytest.approx(f0, rel=5e-4)
        assert mode["damping"] == pytest.approx(zeta, rel=0.08)
        assert abs(mode["frequency_hz"] - f0) < 5.0 * mode["frequency_std_hz"]
    true = np.array([shape for _, _, shape, _ in MODES]).T
    np.testing.assert_array_less(0.99, np.diag(mac(shapes(found), true.astype(complex))))
    np.testing.assert_allclose(np.diag(found["mac"]), 1.0)


def test_a_page_is_written_that_opens_offline(tmp_path: Path) -> None:
    path = recording(tmp_path, 1, 60.0)
    points = tmp_path / "points.csv"
    points.write_text("channel,x,y,z,direction\ns0,0,0,0,z\ns1,1,0,0,-z\ns2,1,1,0,x\n")
    answered(path, "--reference", "f0", "--band", "35", "110", "--points", str(points))
    page = (tmp_path / "out" / "modes.html").read_text()
    assert not re.search(r"(src|href)=\"(?!data:)", page)
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL).group(1))  # type: ignore[union-attr]
    assert [point["channel"] for point in data["geometry"]["points"]] == ["s0", "s1", "s2"]
    assert data["geometry"]["points"][1]["move_y"] > 0.0 > data["geometry"]["points"][0]["move_y"]
    assert len(data["modes"]) == 3
    names = {file.name for file in (tmp_path / "out").iterdir()}
    assert names == {
        "modes.html", "modes.json", "modes.csv", "shapes.csv", "mac.csv", "stabilisation.png", "fit.png", "shapes.png", "mac.png",
    }  # fmt: skip


def test_the_bodies_of_a_description_are_drawn(tmp_path: Path) -> None:
    words = ["simulate", "--model", "hammer-chain", "--excitation", "random", "--band", "2", "100", "--seconds", "120"]
    assert main([*words, "-o", str(tmp_path / "c.h5")]) == 0
    found = answered(tmp_path / "c.h5", "--reference", "hammer")
    # As `rig describe hammer-chain` computes them from the springs and dampers; force sensors take no part.
    assert [mode["frequency_hz"] for mode in found["modes"]] == pytest.approx([11.09, 34.35, 47.92], rel=3e-3)
    assert found["responses"] == ["a1", "a2", "a3"]
    page = (tmp_path / "out" / "modes.html").read_text()
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL).group(1))  # type: ignore[union-attr]
    assert [point["label"] for point in data["geometry"]["points"]] == ["first", "second", "third"]
    assert all(point["width"] > 0.0 for point in data["geometry"]["points"])


#: Frequency (Hz), damping ratio and real parts of the shape by pydvma 2.8.1, `modal.modal_fit_all_channels([tf], freq_range=BAND,
#: measurement_type="acc")` with one mode in each of the bands 30-50, 95-125, 195-230, 330-375 and 490-560 Hz.
RULER = (
    (39.379, 0.00671, (0.713, 0.440, 0.023, -0.301, -0.537, -0.510, -0.335, -0.053, 0.389, 1.0)),
    (108.464, 0.00695, (-0.747, -0.153, 0.388, 0.595, 0.352, -0.177, -0.494, -0.495, 0.002, 1.0)),
    (212.193, 0.01308, (1.0, -0.102, -0.613, -0.265, 0.558, 0.689, -0.057, -0.652, -0.357, 0.924)),
    (352.518, 0.00661, (-0.919, 0.383, 0.502, -0.429, -0.728, 0.421, 0.593, -0.404, -0.610, 1.0)),
    (551.473, 0.00140, (0.679, -0.415, -0.055, 0.552, -0.081, -0.325, 0.552, -0.063, -0.368, 1.0)),
)


def test_a_measured_ruler_has_the_modes_that_its_own_package_finds(shared: Path, tmp_path: Path) -> None:
    source = shared / "peers" / "pydvma" / "ruler_grid_acc_3.mat"
    assert main(["modes", str(source), "--band", "20", "1000", "-o", str(tmp_path / "out")]) == 0
    found = json.loads((tmp_path / "out" / "modes.json").read_text())
    assert len(found["modes"]) == 8
    for f0, zeta, shape in RULER:
        k = int(np.argmin([abs(mode["frequency_hz"] - f0) for mode in found["modes"]]))
        mode = found["modes"][k]
        assert mode["frequency_hz"] == pytest.approx(f0, rel=1e-3)
        assert mode["damping"] == pytest.approx(zeta, rel=0.1)
        assert mac(shapes(found)[:, k : k + 1], np.array(shape)[:, None].astype(complex))[0, 0] > 0.98


def test_what_cannot_be_analysed_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = recording(tmp_path, 1, 30.0)
    points = tmp_path / "points.csv"
    points.write_text("channel,x,y,z,direction\ns0,0,0,0,up\n")
    savemat(tmp_path / "time.mat", {"t": np.arange(200) / 100.0, "a": np.random.default_rng(1).normal(size=200)})
    for words, expected in (
        ((str(path), "--reference", "f0", "--band", "60", "40"), "has no width"),
        ((str(path), "--reference", "f0", "--band", "60", "60.5"), "too few"),
        ((str(path), "--reference", "f0", "--gain", "3"), "no such set-up (unlocked, gain 1)"),
        ((str(path), "--reference", "nothing"), "no channel 'nothing'"),
        ((str(path), "--reference", "f0", "--points", str(points)), "the direction is 'up'"),
        ((str(tmp_path / "time.mat"),), "contains no transfer function"),
    ):
        assert main(["modes", *words, "-o", str(tmp_path / "out")]) == 2
        said = capsys.readouterr().err
        assert expected in said
        assert len(said.strip().splitlines()) == 1
        assert not (tmp_path / "out").exists()
