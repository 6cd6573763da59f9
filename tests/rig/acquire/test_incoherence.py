"""A low coherence is noise, a nonlinearity, or undecided; rigs simulated with scipy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from strange_rigs import StrangeRig, campaign, dry, noise, play

import isorig as iso
from isorig.analysis.campaign import SI_UNIT, Campaign, Channel, FloatArray, Run
from isorig.analysis.spectra.quality import faults
from isorig.rig.acquire import incoherence
from isorig.rig.acquire.policy import COHERENT
from isorig.rig.acquire.recover import Recovered
from isorig.rig.acquire.run_check import Verdict, check_run, incoherences
from isorig.rig.cli import main
from isorig.rig.files.rigfile import description_text
from isorig.rig.report.frequency import transfer_section

RIG = StrangeRig(masses=(4.0,), joints=((0, -1, 4e3, 12.0),), sensors=(("x", 0, "displacement"),))
#: Friction that holds the mass most of the time, more at a low level.
RUBBING = replace(RIG, laws={0: dry(30.0, 2e-3)})


@pytest.fixture(scope="module")
def runs() -> tuple[Run, ...]:
    """Two levels of different drives."""
    return campaign(RUBBING, (20.0, 45.0), seconds=12.0, band=(1.0, 60.0), seed=3).runs


def noisier(run: Run, share: float, seed: int) -> Run:
    values = run.read("x")
    draw = np.random.default_rng(seed).normal(0.0, share * values.std(), len(values))
    return replace(run, channels={**run.channels, "x": replace(run.channels["x"], samples=values + draw)})


def checked(run: Run, others: Sequence[Run] = ()) -> Verdict:
    found = Recovered(
        id=run.id, finished=True, begun=True, run=run, stored=len(run), lost=0, planned=len(run), overloads=0,
        planned_gain=run.gain, drift=None,
    )  # fmt: skip
    verdict = check_run(found, rig=RIG.description(), others=others)
    assert verdict.coherence["x"] < COHERENT
    return verdict


def test_a_perfect_record_of_a_nonlinear_rig_is_kept(runs: tuple[Run, ...]) -> None:
    """A repeat of the drive, or another level, shows that the rig is nonlinear; nothing asks for a repetition."""
    repeat = noisier(replace(runs[0], id="again"), 0.002, 1)
    for others, said in (([repeat], "two runs with the same drive agree"), ([runs[1]], "changes with the drive's level")):
        verdict = checked(runs[0], others)
        (text,) = verdict.advice
        assert verdict.good
        assert said in text
        assert "the rig is nonlinear there, and the record is good" in text
        assert "repeat the run" not in text


def test_one_run_decides_nothing(runs: tuple[Run, ...]) -> None:
    verdict = checked(runs[0])
    assert verdict.good
    assert "a run with the same drive (repeat_of) decides it" in verdict.advice[0]


def test_noise_is_noise(runs: tuple[Run, ...]) -> None:
    """White noise of the sensor by the run itself; another source by a repeat that differs."""
    linear = campaign(RIG, (20.0,), seconds=20.0, band=(1.0, 60.0), seed=3).runs[0]
    verdict = checked(noisier(linear, 5.0, 1))
    assert not verdict.good
    assert "because of noise; drive harder" in verdict.advice[0]
    other = campaign(RIG, (40.0,), seconds=20.0, band=(1.0, 60.0), seed=9).runs[0].read("x")
    disturbed = []
    for k in range(2):
        channel = linear.channels["x"]
        shaken = replace(channel, samples=channel.read() + np.roll(other, 1500 * k))
        disturbed.append(replace(linear, id=f"d{k}", channels={**linear.channels, "x": shaken}))
    verdict = checked(disturbed[0], disturbed[1:])
    assert not verdict.good
    assert "look for another source of vibration" in verdict.advice[0]


#: Play in a coupling: half of the far mass's motion is incoherent with the force.
RATE, BAND, PERIOD = 256.0, (0.5, 60.0), 1024
LOOSE = StrangeRig(
    masses=(2.0, 3.0), joints=((0, -1, 6e3, 15.0), (1, 0, 9e3, 14.0)),
    sensors=(("a", 0, "acceleration"), ("b", 1, "acceleration")), laws={1: play(9e3, 3e-3)},
)  # fmt: skip


@cache
def loosely_moved(force: bytes) -> dict[str, FloatArray]:
    """The records of the rig with play, once for all tests that drive it in the same way."""
    return LOOSE.recorded(np.frombuffer(force), RATE)


def driven(rig: StrangeRig, name: str, force: FloatArray, **about: object) -> Run:
    """A run without a stated band, with noise of two thousandths."""
    draw = np.random.default_rng(len(name))
    records = loosely_moved(force.tobytes()) if rig is LOOSE else rig.recorded(force, RATE)
    channels = {
        key: Channel(name=key, samples=x + draw.normal(0.0, 2e-3 * x.std(), len(x)), quantity=q, unit=SI_UNIT[q])
        for (key, x), q in zip(records.items(), rig.quantities().values(), strict=True)
    }
    return Run(id=name, configuration="unlocked", sample_rate=RATE, channels=channels, gain=1.0, excitation="random", **about)  # type: ignore[arg-type]


def repeated(rig: StrangeRig, late: int = 0) -> tuple[Run, ...]:
    """A run and its repeat: the drive differs by a third of a per cent, and starts later."""
    first, other = (noise(12.0, RATE, level, BAND, seed) for level, seed in ((25.0, 1), (0.08, 2)))
    again = np.concatenate([np.zeros(late), first + other])
    return driven(rig, "first", first), driven(rig, "again", again, repeat_of="first")


def periodic(rig: StrangeRig) -> tuple[Run, ...]:
    """One run of eight periods that drive every frequency."""
    f = np.fft.rfftfreq(PERIOD, 1.0 / RATE)
    phases = np.exp(2j * np.pi * np.random.default_rng(3).random(len(f)))
    wave = np.fft.irfft(np.where((f >= BAND[0]) & (f <= BAND[1]), phases, 0.0), PERIOD)
    return (driven(rig, "periods", np.tile(25.0 * wave / wave.std(), 8), period=PERIOD),)


def levels(rig: StrangeRig) -> tuple[Run, ...]:
    """Different drives at two levels."""
    return tuple(driven(rig, name, noise(12.0, RATE, level, BAND, len(name))) for name, level in (("loud", 25.0), ("soft", 10.0)))


def shaken(runs: Sequence[Run], share: float) -> tuple[Run, ...]:
    """The runs with another source of vibration in the far mass's record."""
    found = []
    for k, run in enumerate(runs):
        x = run.read("b")
        values = x + noise(len(x) / RATE, RATE, share * float(np.std(x)), (1.0, 100.0), 50 + k)
        found.append(replace(run, channels={**run.channels, "b": replace(run.channels["b"], samples=values)}))
    return tuple(found)


WAYS = {
    "two runs with the same drive agree": repeated,
    "two runs with the same drive agree ": lambda rig: repeated(rig, 77),
    "its periods agree": periodic,
    "its transfer function changes with the drive's level": levels,
}  # fmt: skip


@pytest.mark.parametrize("said", WAYS)
def test_every_way_leads_to_the_nonlinearity(
    said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:  # fmt: skip
    """Repeats, also those that start later, periods and levels: said by check, frf, import and the report."""
    recorded = Campaign(runs=WAYS[said](LOOSE), source="loose", description=description_text(LOOSE.description(), {}))
    (reason,) = incoherences(recorded, ["force"])
    assert (reason.response, reason.kind) == ("b", "nonlinear")
    assert said.strip() in reason.text
    assert reason.text in transfer_section(recorded, LOOSE.description()).text
    file = tmp_path / "loose.h5"
    iso.write(file, recorded)
    for words in (["check", str(file)], ["frf", str(file), "--resolution", "0.5", "-o", str(tmp_path / "frf")]):
        assert main(words) == 0
        assert f"{said.strip()}: the rig is nonlinear there" in capsys.readouterr().out.replace("\n", " ")
    assert "the rig is nonlinear there" in (tmp_path / "frf" / "frf.html").read_text()


@pytest.mark.parametrize("way", WAYS.values())
@pytest.mark.parametrize("share", [1.5, 4.0])
def test_another_source_is_no_nonlinearity(way: object, share: float) -> None:
    runs = shaken(way(replace(LOOSE, laws={})), share)  # type: ignore[operator]
    (reason,) = incoherences(Campaign(runs=runs, source="shaken"), ["force"])
    assert reason.kind != "nonlinear"


def test_imported_records_of_a_nonlinear_rig(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = ['description = "rig.toml"']
    lines += [f'[channels.{name}]\nsource = "{name}"\nunit = "{SI_UNIT[q]}"' for name, q in LOOSE.quantities().items()]
    for run in repeated(LOOSE):
        table = np.column_stack([run.read(name) for name in run.sensors])
        np.savetxt(tmp_path / f"{run.id}.csv", table, delimiter=",", header=",".join(run.sensors), comments="")
        lines.append(f'[[runs]]\nid = "{run.id}"\nfile = "{run.id}.csv"\ngain = 1.0\nsample_rate = 256.0\nexcitation = "random"')
    (tmp_path / "m.toml").write_text("\n".join(lines))
    (tmp_path / "rig.toml").write_text(description_text(LOOSE.description(), {}))
    assert main(["import", str(tmp_path / "m.toml"), "-o", str(tmp_path / "c.h5")]) == 0
    imported = capsys.readouterr().out
    assert "with the drive, but two runs with the same drive agree: the rig is nonlinear" in imported
    # Check names the same run.
    assert main(["check", str(tmp_path / "c.h5")]) == 0
    said = [line for line in capsys.readouterr().out.splitlines() if "the rig is nonlinear" in line]
    assert said
    assert said == [line for line in imported.splitlines() if "the rig is nonlinear" in line]


def test_checks_of_a_wide_recording_transform_each_record_a_few_times(monkeypatch: pytest.MonkeyPatch) -> None:
    # Checks that share their spectra and noise levels, and convolve whole records only where their start is suspicious.
    n, names, transformed = 1 << 19, ("head", "a", "b", "c"), 0
    records = np.random.default_rng(0).standard_normal((len(names), n))
    channels = {name: Channel(name=name, samples=row) for name, row in zip(names, records, strict=True)}
    run = Run(id="wide", configuration="unlocked", sample_rate=16384.0, gain=1.0, channels=channels, excitation="random")
    plain = np.fft.rfft

    def counted(values: FloatArray, *given: Any, **options: Any) -> Any:
        nonlocal transformed
        transformed += values.size
        return plain(values, *given, **options)

    monkeypatch.setattr(np.fft, "rfft", counted)
    campaign = Campaign(runs=(run,))
    assert faults(campaign, reference="head") == ()
    assert {reason.kind for reason in incoherences(campaign, ["head"])} == {"noise"}
    assert transformed <= 6 * records.size


def test_narrow_resonances_of_a_linear_rig_are_no_nonlinearity() -> None:
    """The rest of a force that an accelerometer far from it shows is small beside the leakage of its resonance."""
    rig = StrangeRig(
        masses=(4.0, 2.0), joints=((0, -1, 4e3, 5.0), (1, 0, 3e3, 3.0)), sensors=(("x", 1, "displacement"),)
    )  # fmt: skip
    (run,) = campaign(rig, (20.0,), seconds=40.0, band=(1.0, 60.0), seed=4).runs
    (found,) = incoherences(Campaign(runs=(run,)), ["force"])
    assert found.kind == "narrow"
    assert "because resonances are narrower than the resolution of 0.5 Hz; measure a longer run" in found.text


@pytest.mark.parametrize(
    ("second", "averages", "narrow"), [(0.59, 40.0, True), (0.61, 40.0, False), (0.59, 3.0, True), (0.59, 2.9, False)]
)
def test_a_ratio_that_falls_with_the_resolution_is_that_of_narrow_resonances(
    second: float, averages: float, narrow: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To six tenths, without what few averages make coherent."""
    coarse, fine = (SimpleNamespace(averages=each, resolution=0.5, density=lambda name: np.ones(4)) for each in (80.0, averages))
    ratio = second * 4.0  # of incoherent to coherent power, 4 with the coarse resolution
    left, share = 0.8 * (1.0 - 1.0 / 80.0), ratio / (1.0 + ratio) * (1.0 - 1.0 / averages)
    monkeypatch.setattr(incoherence, "estimate", lambda *given, **how: fine)
    monkeypatch.setattr(incoherence, "driven_bins", lambda *given: np.ones(4, dtype=bool))
    monkeypatch.setattr(incoherence, "_incoherent_power", lambda *given: 4.0 * share)
    assert incoherence._less_in_longer_segments(cast(Any, None), cast(Any, coarse), "x", "force", left) is narrow
