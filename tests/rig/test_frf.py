"""`rig frf` on what a lab brings: drives that repeat, and records that are spoilt."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.simulate import Excitation, simulate
from isorig.analysis.simulate.excitation import multisine, random
from isorig.analysis.spectra.welch import Frf
from isorig.rig.cli import main
from isorig.rig.errors import OutputError
from isorig.rig.files.recording import write
from isorig.rig.files.rivals import _existing_run
from isorig.rig.frf.drawing import FigureProcess, FrfPicture, drawn_elsewhere
from isorig.rig.frf.figures import frf_figure, gridded
from isorig.rig.frf.transfer import transfer_functions
from isorig.rig.wire_bonder.description import THESIS, wire_bonder

RATE, PERIOD, NOISE = 1024.0, 4096, 1e-3


def taken(seed: int, friction: float) -> Run:
    """A locked or unlocked run of eight periods, after half a minute in which the motion settles."""
    drive, _ = multisine(period=PERIOD, periods=16, sample_rate=RATE, rms=3.8, band=(1.0, 60.0), seed=seed)
    generator = np.random.default_rng(seed)
    model = wire_bonder({**THESIS, "friction_force": max(friction, 1.0)}, friction=friction > 0.0)
    motion: dict[str, FloatArray] = {"head": drive, **simulate(model, Excitation.prepare(drive, RATE)).channels}
    channels = {
        name: Channel(name=name, samples=(values + generator.normal(0.0, NOISE, len(values)))[8 * PERIOD :])
        for name, values in motion.items()
    }
    return Run(
        id=f"m{seed}", configuration="unlocked", sample_rate=RATE, gain=70.0, channels=channels, excitation="multisine",
        period=PERIOD, band=(1.0, 60.0),
    )  # fmt: skip


@pytest.fixture(scope="module")
def rubbing() -> Campaign:
    return Campaign(runs=tuple(taken(seed, 10.0) for seed in range(4)), source="multisine.h5")


def told(campaign: Campaign, folder: Path) -> dict[str, object]:
    write(folder / "m.h5", campaign)
    assert main(["frf", str(folder / "m.h5"), "--response", "table", "-o", str(folder / "out")]) == 0
    answer: dict[str, object] = json.loads((folder / "out" / "frf.json").read_text())
    return answer


def test_periods_distinguish_friction_from_noise(rubbing: Campaign, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (item,) = told(rubbing, tmp_path)["transfer_functions"]
    said = item["periods"]
    assert (said["periods"], said["realizations"]) == (7, 4)
    assert said["relative_distortion"] > 5.0 * said["relative_noise"]
    assert "Over 7 periods of 4 runs the noise" in " ".join(capsys.readouterr().out.split())
    with (tmp_path / "out" / "table-over-head-gain70-periods.csv").open() as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    assert all(1.0 <= row["frequency_hz"] <= 60.0 for row in rows)
    assert (tmp_path / "out" / "table-over-head-periods.png").stat().st_size > 10_000


def test_without_friction_only_noise_is_left(tmp_path: Path) -> None:
    smooth = Campaign(runs=tuple(taken(seed, 0.0) for seed in range(4)), source="multisine.h5")
    (item,) = told(smooth, tmp_path)["transfer_functions"]
    assert item["periods"]["relative_distortion"] < 2.0 * item["periods"]["relative_noise"]
    assert item["periods"]["relative_noise"] < 0.01


def test_a_spoilt_run_is_named_and_left_out(rubbing: Campaign, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = rubbing.runs[0]
    flat = Channel(name="table", samples=np.zeros(len(first)))
    hurt = replace(rubbing, runs=(replace(first, channels={**first.channels, "table": flat}), *rubbing.runs[1:]))
    answer = told(hurt, tmp_path)
    (item,) = answer["transfer_functions"]
    assert item["left_out"] == ["m0"]
    assert item["runs"] == ["m1", "m2", "m3"]
    assert any("table is dead" in text for text in answer["faults"])
    assert "table is dead" in capsys.readouterr().out


def test_a_response_as_reference_is_no_drive_with_holes(rubbing: Campaign, tmp_path: Path) -> None:
    write(tmp_path / "m.h5", rubbing)
    call = ["frf", str(tmp_path / "m.h5"), "--reference", "table", "--response", "heatblock", "-o", str(tmp_path / "out")]
    assert main(call) == 0
    assert not [text for text in json.loads((tmp_path / "out" / "frf.json").read_text())["faults"] if "no power" in text]


def test_without_a_stated_band_it_is_where_the_drive_has_power() -> None:
    """In transfer functions, and for the next run; a run at rest and one with moves have none."""
    drive = random(samples=20_000, sample_rate=RATE, rms=1.0, band=(5.0, 60.0), seed=1)
    channels = {name: Channel(name=name, samples=drive + 1e-4 * np.random.default_rng(2).normal(size=20_000)) for name in "fx"}
    run = Run(id="a", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels, excitation="random")
    (found,) = transfer_functions(Campaign(runs=(run,), source="x"), reference="f")
    assert found.band == pytest.approx((5.0, 60.0), abs=0.26)  # a bin, without those into which the window leaks
    band = _existing_run(Campaign(runs=(run,), source="x"), run, "f").band
    assert band == pytest.approx((5.0, 60.0), abs=1.0)  # two of its wider bins
    rest = replace(run, channels={name: Channel(name=name, samples=np.zeros(20_000)) for name in "fx"})
    for other in (rest, replace(run, excitation="moves")):
        assert _existing_run(Campaign(runs=(other,), source="x"), other, "f").band is None


@pytest.mark.parametrize(("decades", "labelled"), [(0.2, True), (3.9, True), (4.1, False)])
def test_logarithmic_axes_have_plain_values(decades: float, labelled: bool) -> None:
    """Values without powers of ten, and those of the minor ticks up to four decades."""
    f = np.geomspace(2.0, 200.0, 100)
    size = np.geomspace(1.0, 10.0**decades, 100) + 0j
    ones = np.ones(100)
    frf = Frf(
        response="a", reference="b", frequency=f, value=size, coherence=ones, magnitude_std=1e-6 * ones, phase_std=1e-6 * ones,
        averages=30.0, resolution=2.0, estimator="H1",
    )  # fmt: skip
    figure = frf_figure({"a": frf}, (2.0, 200.0))
    magnitude = figure.axes[0]
    magnitude.set_ylim(1.0, 10.0**decades)
    gridded(figure)
    minor = {text.get_text() for text in magnitude.yaxis.get_minorticklabels()}
    every = minor | {text.get_text() for text in magnitude.yaxis.get_majorticklabels()}
    assert "1" in every
    assert not any("$" in text for text in every)
    assert ("1.2" if decades < 1.0 else "20") in minor or not labelled
    assert (minor == {""}) is not labelled


def test_a_figure_that_cannot_be_written_is_one_sentence(rubbing: Campaign, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    curves = {item.label: item.within_band() for item in transfer_functions(rubbing, reference="head", responses=["table"])}
    with drawn_elsewhere() as drawing:
        drawing.draw(FrfPicture(path=tmp_path / "file" / "a.png", curves=curves, band=(1.0, 60.0)))
        with pytest.raises(OutputError, match="choose another place with -o"):
            drawing.wait()


def test_a_process_that_ends_while_it_draws_is_one_sentence(tmp_path: Path) -> None:
    with drawn_elsewhere() as drawing:
        drawing._process.kill()
        drawing.draw(FrfPicture(path=tmp_path / "a.png"))
        with pytest.raises(OutputError, match=r"a\.png was not drawn because its process ended"):
            drawing.wait()


def test_the_process_that_draws_ends_with_the_command(tmp_path: Path) -> None:
    with drawn_elsewhere() as drawing:
        pass
    assert drawing._process.poll() is not None
    # Also if the command is killed: then its standard input ends.
    alone = FigureProcess()
    alone._input.close()
    assert alone._process.wait(60) == 0
