"""The chain as commands on recordings, as they are called."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy import signal
from shortened import shortened

from isorig.rig.cli import main
from isorig.rig.files.recording import read, write
from isorig.rig.wire_bonder.description import wire_bonder
from isorig.rig.wire_bonder.session import VirtualRun, virtual_campaign

SHORT = (
    VirtualRun(id="u70", configuration="unlocked", gain=70.0, seconds=24.0, start=0.0),
    VirtualRun(id="u7", configuration="unlocked", gain=7.0, seconds=16.0, start=40.0, band=(0.5, 400.0)),
    VirtualRun(id="l70", configuration="locked", gain=70.0, seconds=16.0, start=80.0),
    VirtualRun(id="l7", configuration="locked", gain=7.0, seconds=16.0, start=120.0, band=(0.5, 400.0)),
)
SHARED = Path(__file__).parents[2].parent / "shared" / "campaigns"


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("chain") / "short.h5"
    write(path, virtual_campaign(wire_bonder(), SHORT, seed=4))
    return path


def test_frf_is_what_scipy_says(recording: Path, tmp_path: Path) -> None:
    assert (
        main(
            ["frf", str(recording), "--reference", "table", "--response", "heatblock", "--resolution", "0.5", "-o", str(tmp_path)]
        )
        == 0
    )
    with (tmp_path / "heatblock-over-table-locked-gain7.csv").open() as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    run = next(run for run in read(recording).runs if run.id == "l7")
    x, y = run.read("table"), run.read("heatblock")
    f, sxy = signal.csd(x, y, run.sample_rate, nperseg=2048)
    _, sxx = signal.welch(x, run.sample_rate, nperseg=2048)
    h = np.array([row["real"] + 1j * row["imag"] for row in rows])
    np.testing.assert_allclose([row["frequency_hz"] for row in rows], f)
    np.testing.assert_allclose(h, sxy / sxx, rtol=2e-8, atol=1e-8 * np.abs(h).max())
    told = json.loads((tmp_path / "frf.json").read_text())["transfer_functions"]
    assert {(t["configuration"], t["gain"]) for t in told} == {("unlocked", 70), ("unlocked", 7), ("locked", 70), ("locked", 7)}
    assert (tmp_path / "heatblock-over-table.png").stat().st_size > 10_000


def test_the_chain_on_one_recording(recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(recording), "-o", str(tmp_path / "report")]) == 0
    assert (
        main(["isolation", str(recording), "--model", str(tmp_path / "report" / "model.json"), "-o", str(tmp_path / "iso")]) == 0
    )
    told = json.loads((tmp_path / "iso" / "isolation.json").read_text())
    assert told["stitches_hz"] == [15.0]
    assert told["stuck_share"]["7"] > 0.9
    assert told["stuck_share"]["70"] < 0.6
    with (tmp_path / "iso" / "isolation.csv").open() as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    stuck = [row["ratio_measured"] for row in rows if row["gain"] == 7.0 and 20.0 < row["frequency_hz"] < 100.0]
    assert np.median(stuck) == pytest.approx(1.0, abs=0.02)
    off = [abs(np.log(row["ratio_simulated"] / row["ratio_measured"])) for row in rows if 5.0 < row["frequency_hz"] < 15.0]
    assert np.median(off) < 0.01
    assert "while stuck, the rig behaves like a locked one" in capsys.readouterr().out
    page = (tmp_path / "report" / "report.html").read_text()
    assert len(page) < 3_000_000
    for title in (
        "Rig and runs",
        "Transfer functions",
        "Parameters",
        "Simulation compared with measurement",
        "Isolation ratio",
        "Source of the numbers",
    ):
        assert title in page


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (["frf", "{file}", "--response", "nose", "-o", "{out}"], "nose"),
        (["frf", "{file}", "--resolution", "1000", "-o", "{out}"], "1000"),
        (["frf", "{file}", "--resolution", "0.001", "-o", "{out}"], "0.001"),
        (["isolation", "{file}", "--model", "{file}", "-o", "{out}"], "model.json"),
        (["predict", "{out}/none.json", "{file}", "-o", "{out}/x.h5"], "none.json"),
        (["acquire", "{out}/plan.toml", "-o", "{out}/x.h5"], "plan.toml"),
    ],
)
def test_refusals(recording: Path, tmp_path: Path, call: list[str], named: str, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert main([word.format(file=recording, out=out) for word in call]) == 2
    told = capsys.readouterr().err.strip()
    assert named in told
    assert len(told.splitlines()) == 1
    assert not out.exists() or not list(out.iterdir())


@pytest.mark.skipif(not SHARED.is_dir(), reason="the shared campaigns are not on this machine")
@pytest.mark.timeout(300)
# The parameters of the first are also those of tests/analysis/test_characterize.py, with every test.
@pytest.mark.study
@pytest.mark.parametrize("letter", "abcdefg")
def test_report_on_recordings_of_another_program(letter: str, tmp_path: Path) -> None:
    write(tmp_path / "campaign.h5", shortened(read(SHARED / f"campaign-{letter}.h5"), 100.0))
    assert main(["report", str(tmp_path / "campaign.h5"), "-o", str(tmp_path)]) == 0
    table = json.loads((tmp_path / "parameters.json").read_text())["parameters"]
    truth = json.loads((SHARED / "answers.json").read_text())[f"campaign-{letter}"]["rig"]
    for name, row in table.items():
        if row["value"] is None:
            assert row["note"]
        elif row["method"] not in ("given", "held"):
            assert abs(row["value"] - truth[name]) <= 3.0 * row["std"] + 0.002 * truth[name], name
            if letter == "a":
                share = 0.02 if name.endswith("damping") or name == "friction_force" else 0.005
                assert row["value"] == pytest.approx(truth[name], rel=share)
    page = (tmp_path / "report.html").read_text()
    assert "thesis" in page
    assert len(page) < 3_000_000
