"""`rig frf` on hammer tests, on several drives at once, and its views, against closed forms."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.rig.cli import main
from isorig.rig.files.recording import write

RATE, FREQUENCY, DAMPING, STEP = 1024.0, 50.1, 0.01, 6144


def accelerance(f: FloatArray | float, frequency: float = FREQUENCY) -> Any:
    s, w = 2j * np.pi * np.asarray(f), 2.0 * np.pi * frequency
    return s**2 / (s**2 + 2.0 * DAMPING * w * s + w**2)


def oscillator(force: FloatArray, frequency: float = FREQUENCY) -> FloatArray:
    """Acceleration of 1 kg; exact for band-limited forces that end long before the record does."""
    n = 2 * len(force)
    lines = np.fft.rfft(force, n) * accelerance(np.fft.rfftfreq(n, 1.0 / RATE), frequency)
    return np.asarray(np.fft.irfft(lines, n)[: len(force)])


def recording(folder: Path, channels: dict[str, FloatArray], *, forces: tuple[str, ...], full_scale: float | None = None,
    excitation: str = "other",
) -> Path:  # fmt: skip
    rows = {
        name: Channel(
            name=name, samples=values, quantity="force" if name in forces else "acceleration",
            unit="N" if name in forces else "m/s^2", full_scale=full_scale if name not in forces else None,
        )
        for name, values in channels.items()
    }  # fmt: skip
    run = Run(id="hits", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=rows, excitation=excitation)
    write(folder / "run.h5", Campaign(runs=(run,)))
    return folder / "run.h5"


def answered(path: Path, *words: str) -> dict[str, Any]:
    assert main(["frf", str(path), *words, "-o", str(path.parent / "out")]) == 0
    content: dict[str, Any] = json.loads((path.parent / "out" / "frf.json").read_text())
    return content


def hammered(*, double: bool = False, seed: int = 5) -> tuple[FloatArray, FloatArray]:
    """Eight hits a good six seconds apart, and the answer; the fourth bounces on request."""
    draw = np.random.default_rng(seed)
    force = np.zeros(10 * STEP)
    pulse = np.hanning(11)[1:-1]
    for k in range(8):
        start = STEP + k * STEP
        force[start : start + 9] += draw.uniform(80.0, 120.0) * pulse
        if double and k == 3:
            force[start + 60 : start + 69] += 40.0 * pulse
    return force + draw.normal(0.0, 0.01, len(force)), oscillator(force)


def test_hits_are_found_and_averaged_although_the_import_named_no_excitation(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    force, answer = hammered(double=True)
    draw = np.random.default_rng(1)
    path = recording(tmp_path, {"hammer": force, "block": answer + draw.normal(0.0, 0.02, len(answer))}, forces=("hammer",))
    (item,) = answered(path, "--reference", "hammer")["transfer_functions"]
    said = " ".join(capsys.readouterr().out.split())
    assert "7 of 8 hammer hits were averaged" in said
    assert "left out: 1 double hit" in said
    assert [hit["rejected"] for hit in item["hammer"]["hits"]].count("double hit") == 1
    assert item["units"] == ["m/s^2", "N"]
    table = np.genfromtxt(tmp_path / "out" / "block-over-hammer-gain1.csv", delimiter=",", names=True)
    kept = (table["frequency_hz"] > 20.0) & (table["frequency_hz"] < 90.0)
    estimated = table["real"][kept] + 1j * table["imag"][kept]
    true = accelerance(table["frequency_hz"][kept])
    assert np.median(np.abs(estimated - true) / np.abs(true)) < 0.01
    # The peak is 1 / (2 zeta) high; averaged as noise, segments cut through the decay made it several times as high or low.
    assert item["peak"]["frequency_hz"] == pytest.approx(FREQUENCY, abs=0.25)
    assert item["peak"]["magnitude"] == pytest.approx(np.abs(true).max(), rel=0.02)


def test_overloaded_hits_are_rejected_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    force, answer = hammered()
    limit = float(np.sort([np.abs(answer[STEP * k : STEP * (k + 1)]).max() for k in range(1, 9)])[-3]) * 1.01
    path = recording(
        tmp_path, {"hammer": force, "block": np.clip(answer, -limit, limit)}, forces=("hammer",), full_scale=limit
    )  # fmt: skip
    (item,) = answered(path, "--reference", "hammer")["transfer_functions"]
    assert "left out: 2 overload" in " ".join(capsys.readouterr().out.split())
    assert item["left_out"] == []


def test_noise_of_unnamed_excitation_is_averaged_and_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    force = np.random.default_rng(2).normal(0.0, 1.0, 60 * 1024)
    path = recording(tmp_path, {"force": force, "block": oscillator(force)}, forces=("force",))
    (item,) = answered(path, "--reference", "force", "--window", "blackman", "--overlap", "0.75")["transfer_functions"]
    assert "hammer" not in item
    assert (item["window"], item["overlap"]) == ("blackman", 0.75)
    said = " ".join(capsys.readouterr().out.split())
    assert "averaged as noise" in said
    # The bandwidth is 1 Hz, four bins of 0.25 Hz.
    assert "Leakage lowers and widens peaks with few frequency bins" in said
    answered(path, "--reference", "force", "--resolution", "0.05")
    assert "the error bars do not include this bias" not in " ".join(capsys.readouterr().out.split())


def test_two_drives_at_once_are_separated(tmp_path: Path) -> None:
    draw = np.random.default_rng(3)
    a, b = draw.normal(0.0, 1.0, (2, 240 * 1024))
    answer = oscillator(a) - 0.5 * oscillator(b, 80.0)
    path = recording(tmp_path, {"a": a, "b": b, "block": answer}, forces=("a", "b"))
    views = ("--view", "bode", "--view", "parts", "--view", "nyquist", "--band", "40", "60")
    rows = answered(path, "--reference", "a", "--reference", "b", "--estimator", "Hv", *views)["transfer_functions"]
    assert [(row["reference"], row["estimator"]) for row in rows] == [("a", "Hv"), ("b", "Hv")]
    for row, (factor, frequency) in zip(rows, ((1.0, FREQUENCY), (-0.5, 80.0)), strict=True):
        table = np.genfromtxt(tmp_path / "out" / f"{row['name']}.csv", delimiter=",", names=True)
        # Away from both peaks, where the window's leakage is small.
        kept = (table["frequency_hz"] > 100.0) & (table["frequency_hz"] < 300.0)
        value = table["real"][kept] + 1j * table["imag"][kept]
        true = factor * accelerance(table["frequency_hz"][kept], frequency)
        assert np.median(np.abs(value - true) / np.abs(true)) < 0.006
        assert (table["multiple_coherence"][kept] >= table["coherence"][kept] - 1e-9).all()
    pictures = {path.name for path in (tmp_path / "out").glob("*.png")}
    assert pictures == {f"block-over-{drive}{view}.png" for drive in "ab" for view in ("", "-parts", "-nyquist")}


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--reference", "a", "--reference", "b", "--estimator", "H2"), "H2 was requested for 2 simultaneous drives"),
        (("--reference", "a", "--overlap", "1"), "0 to 0.95"),
        (("--reference", "a", "--band", "60", "40"), "has no width"),
        (("--reference", "nothing"), "no channel 'nothing'"),
    ],
)
def test_what_cannot_be_estimated_is_refused(
    words: tuple[str, ...], expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a, b = np.random.default_rng(4).normal(0.0, 1.0, (2, 30 * 1024))
    path = recording(tmp_path, {"a": a, "b": b, "block": oscillator(a + b)}, forces=("a", "b"))
    assert main(["frf", str(path), *words, "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert expected in said
    assert len(said.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_hammer_test_recorded_as_random_is_evaluated_hit_by_hit(tmp_path: Path) -> None:
    force, answer = hammered()
    path = recording(tmp_path, {"force": force, "block": answer}, forces=("force",), excitation="random")
    content = answered(path, "--reference", "force", "--resolution", "0.25")
    assert "hammer" in content["transfer_functions"][0]
    assert any("recorded as 'random', but the reference consists of hammer pulses" in sentence for sentence in content["faults"])


def noise_run(tmp_path: Path, *, reference_noise: float = 0.0, near: tuple[float, ...] = ()) -> Path:
    """White noise for 120 s on one mode, or on several with alternating signs, with 2 % noise in the response."""
    draw = np.random.default_rng(8)
    force = draw.standard_normal(round(120.0 * RATE))
    block = oscillator(force) + sum((-1.0) ** k * oscillator(force, f) for k, f in enumerate(near, 1))
    block += 0.02 * block.std() * draw.standard_normal(len(block))
    return recording(
        tmp_path, {"force": force + reference_noise * draw.standard_normal(len(force)), "block": block}, forces=("force",)
    )


def test_limits_of_a_narrow_peak_are_corrected_for_leakage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """H1 is far below the peak of the true curve, 50; the limits contain it."""
    content = answered(noise_run(tmp_path), "--reference", "force", "--resolution", "0.5")
    peak = content["transfer_functions"][0]["peak"]
    true = abs(accelerance(peak["frequency_hz"]))
    assert peak["magnitude"] + 1.96 * peak["magnitude_std"] < true
    assert peak["magnitude_limits"][0] < true < peak["magnitude_limits"][1]
    assert peak["leakage"] < 0.0
    (sentence,) = content["remarks"][-1:]
    assert "Leakage lowers and widens" in sentence
    assert "finer --resolution than 0.5 Hz" in sentence
    said = capsys.readouterr().out
    assert "Leakage lowers" in said
    assert f"({peak['magnitude_limits'][0]:.3g}" in said
    # The printed peak is corrected as its limits are.
    shown = re.search(r"(\S+) \((\S+)–(\S+)\) ", said)
    assert shown is not None
    value, low, high = (float(each) for each in shown.groups())
    assert low < value < high
    assert value == pytest.approx(peak["magnitude"] - peak["leakage"], rel=2e-3)
    rows = np.genfromtxt(tmp_path / "out" / "block-over-force-gain1.csv", delimiter=",", names=True)
    near = np.abs(rows["frequency_hz"] - FREQUENCY) < 2.0
    curve = np.abs(accelerance(rows["frequency_hz"][near]))
    assert np.mean((rows["magnitude_low"][near] < curve) & (curve < rows["magnitude_high"][near])) > 0.8


def test_noise_on_the_reference_is_included_in_the_upper_limit(tmp_path: Path) -> None:
    content = answered(noise_run(tmp_path, reference_noise=0.3), "--reference", "force", "--resolution", "0.2")
    peak = content["transfer_functions"][0]["peak"]
    true = abs(accelerance(peak["frequency_hz"]))
    assert peak["magnitude"] + 1.96 * peak["magnitude_std"] < true
    assert peak["magnitude_limits"][0] < true < peak["magnitude_limits"][1]
    assert any("Noise on the reference may make H1 up to" in sentence for sentence in content["remarks"])


def test_no_limits_where_no_mode_fits(tmp_path: Path) -> None:
    """Seven modes within eight bins look like two peaks, which a few modes do not describe."""
    near = tuple(FREQUENCY + 0.7 * k for k in range(1, 7))
    content = answered(noise_run(tmp_path, near=near), "--reference", "force", "--resolution", "0.5")
    assert any("There are no limits near peaks" in sentence for sentence in content["remarks"])
    assert content["transfer_functions"][0]["peak"]["magnitude_limits"] is None


@pytest.mark.parametrize(
    ("words", "reason"), [(("--estimator", "H2"), "H2 adds up noise"), (("--resolution", "0.01"), "a single average")]
)
def test_the_reason_for_missing_limits_is_given(words: tuple[str, ...], reason: str, tmp_path: Path) -> None:
    content = answered(noise_run(tmp_path), "--reference", "force", *words)
    assert content["transfer_functions"][0]["peak"]["magnitude_limits"] is None
    assert any(reason in sentence for sentence in content["remarks"])


def test_the_table_states_the_level_of_runs_of_one_gain_and_the_unit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    draw = np.random.default_rng(3)
    forces = [level * draw.normal(0.0, 1.0, 20 * 1024) for level in (6.0, 20.0)]
    runs = tuple(
        Run(
            id=f"r{k}", configuration="unlocked", sample_rate=RATE, gain=1.0, excitation="random",
            channels={
                "force": Channel(name="force", samples=force, quantity="force", unit="N"),
                "block": Channel(name="block", samples=oscillator(force), quantity="acceleration", unit="m/s^2"),
            },
        )
        for k, force in enumerate(forces)
    )  # fmt: skip
    path = tmp_path / "levels.h5"
    write(path, Campaign(runs=runs))
    rows = answered(path, "--reference", "force")["transfer_functions"]
    said = capsys.readouterr().out
    assert {row["level"] for row in rows} == {f"{np.sqrt(np.mean(force**2)):.3g} N" for force in forces}
    assert "rms of drive" in said
    for row in rows:
        assert row["level"] in said
    assert "m/s² per N" in said
    # One level: no column for it.
    write(path, Campaign(runs=runs[:1]))
    (row,) = answered(path, "--reference", "force")["transfer_functions"]
    said = capsys.readouterr().out
    assert row["level"] == ""
    assert "rms of drive" not in said
