"""Modes of a machine in operation: against the eigenvalues of the matrices that made the records."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import machine_in_operation
import numpy as np
import pytest
from headless_page import CHROMIUM, EXTENT, told_by
from machine_in_operation import BAND, MASS, RATE, STIFFNESS, truth

import isorig as iso
from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.spectra.operating import HARMONIC, OperatingMode, _warnings, envelope_variation, operating_modes
from isorig.rig.cli import main


@cache
def records(seed: int) -> FloatArray:
    """Those of a machine in operation; several tests use the same."""
    return machine_in_operation.records(seed)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("operating") / "m.h5"
    channels = {
        name: Channel(name=name, samples=values, quantity="acceleration", unit="m/s^2")
        for name, values in zip(("low", "top"), records(1), strict=True)
    }
    run = Run(id="day", configuration="running", sample_rate=RATE, gain=1.0, channels=channels, excitation="other")
    iso.write(path, Campaign(runs=(run,), source="machine"))
    return path


def test_frequencies_damping_and_shapes_are_those_of_the_matrices() -> None:
    found = operating_modes(records(1), RATE, BAND, responses=("low", "top"))
    frequency, damping = truth()
    assert len(found.modes) == 2
    _, shapes = np.linalg.eigh(np.linalg.inv(np.sqrt(MASS)) @ STIFFNESS @ np.linalg.inv(np.sqrt(MASS)))
    shapes = np.linalg.inv(np.sqrt(MASS)) @ shapes
    for k, mode in enumerate(found.modes):
        assert abs(mode.frequency - frequency[k]) < 3.0 * mode.frequency_std < 0.02 * frequency[k]
        assert abs(mode.damping - damping[k]) < 3.0 * mode.damping_std < damping[k]
        true = shapes[:, k] / shapes[np.argmax(np.abs(shapes[:, k])), k]
        assert mode.shape.real / mode.shape.real[np.argmax(np.abs(mode.shape))] == pytest.approx(true, abs=0.04)


@pytest.mark.study
def test_the_uncertainties_cover_the_scatter() -> None:
    frequency, damping = truth()
    inside, wide = [], []
    for seed in range(60):
        modes = operating_modes(records(100 + seed), RATE, BAND, responses=("low", "top")).modes
        assert len(modes) == 2, seed
        for k, mode in enumerate(modes):
            inside.append(abs(mode.frequency - frequency[k]) < 1.96 * mode.frequency_std)
            inside.append(abs(mode.damping - damping[k]) < 1.96 * mode.damping_std)
            wide.append((mode.damping_std, mode.damping - damping[k]))
    assert 0.92 <= np.mean(inside) <= 0.99
    stated, errors = np.array(wide).reshape(60, 2, 2).transpose(2, 0, 1)
    assert np.all(np.sqrt(np.mean(stated**2, axis=0)) < 1.5 * errors.std(axis=0))


@pytest.mark.parametrize("seed", [7, 26])
def test_orders_that_fit_noise_do_not_widen_the_uncertainty(seed: int) -> None:
    # The scatter of the second damping ratio is 0.003; poles of the highest orders state three to eight times as much.
    _, second = operating_modes(records(seed), RATE, BAND, responses=("low", "top")).modes
    assert second.damping_std < 0.006


def test_a_constant_sine_is_no_mode() -> None:
    time = np.arange(30_000) / RATE
    modes = operating_modes(records(2) + 0.5 * np.sin(2.0 * np.pi * 6.0 * time), RATE, BAND, responses=("low", "top")).modes
    assert [mode.frequency for mode in modes if abs(mode.frequency - 6.0) < 0.5 and mode.variation > HARMONIC] == []


def test_the_envelope_of_noise_varies_and_that_of_a_sine_does_not() -> None:
    draw = np.random.default_rng(0)
    sine = np.sin(2.0 * np.pi * 6.0 * np.arange(100_000) / RATE)
    assert envelope_variation(draw.normal(size=100_000), RATE, 6.0, 0.05) == pytest.approx(1.0, abs=0.15)
    assert envelope_variation(sine, RATE, 6.0, 0.05) == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize(("variation", "said"), [(HARMONIC - 0.01, True), (HARMONIC + 0.01, False)])
def test_a_harmonic_is_told_below_half_the_variation(variation: float, said: bool) -> None:
    mode = OperatingMode(frequency=6.0, frequency_std=0.01, damping=0.001, damping_std=0.001, shape=np.ones(2, complex),
                         collinearity=1.0, variation=variation)  # fmt: skip
    assert bool(_warnings([mode])) is said


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--band", "0.5", "15"], "150 periods of 0.5 Hz, and 200 are needed; measure for 400 s"),
        (["--band", "1.5", "80"], "is not within 0 to 50 Hz"),
        (["--band", "1.5", "15", "--response", "low"], "two responses of one quantity or more"),
        (["--band", "1.5", "15", "--configuration", "idle"], "day: running, gain 1"),
    ],
)
def test_refused_in_one_sentence(
    more: list[str], said: str, recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["modes", str(recording), "--operating", *more, "-o", str(tmp_path / "out")]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_command_writes_modes_and_page(recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["modes", str(recording), "--operating", "--band", "1.5", "15", "-o", str(tmp_path / "out")]) == 0
    said = capsys.readouterr()
    assert "in operation" in said.out
    assert said.err == ""
    found = json.loads((tmp_path / "out" / "modes.json").read_text())
    assert [mode["frequency_hz"] for mode in found["modes"]] == pytest.approx(truth()[0], rel=0.01)
    assert len((tmp_path / "out" / "modes.csv").read_text().splitlines()) == 3
    page = (tmp_path / "out" / "modes.html").read_text()
    assert "Operating modes of m.h5" in page
    if CHROMIUM is not None:
        told = told_by(page, EXTENT, 420, tmp_path)
        assert told["drawn"] == [True, True]
        assert told["wide"] <= told["inner"] == 420
