"""rig next on the command line: plans that rig acquire takes, limits that hold, and what no run parts."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
from headless_page import CHROMIUM, EXTENT, told_by
from open_questions import end_stop, hardening, rivals, two_springs, written

from isorig.analysis.proposals.limits import simulated_peaks
from isorig.analysis.proposals.policy import POLICY
from isorig.analysis.simulate import Excitation
from isorig.rig.acquire.drive import drive_of
from isorig.rig.acquire.plan_check import read_plan
from isorig.rig.cli import main
from isorig.rig.files.recording import read
from isorig.rig.files.rivals import OpenSet

LIMITS = """
gains = [0.0, 70.0]
band = [0.5, 30.0]
seconds = 20.0
[stroke]
isolation = {stroke}
"""


def limited(folder: Path, stroke: float) -> Path:
    path = folder / f"limits-{stroke:g}.toml"
    path.write_text(LIMITS.format(stroke=stroke))
    return path


def reached(plan: Path) -> float:
    """Largest deflection of the isolation in any run of a plan, with either of the two causes."""
    strokes, rate = [], read_plan(plan).instrument.sample_rate
    for run in read_plan(plan).runs:
        if not run.played:
            continue
        drive = drive_of(run, 0, rate)
        excitation = Excitation.prepare(run.gain * drive[0 : len(drive)], rate, oversample=4)
        models = [each.variant().model for each in (hardening(), end_stop())]
        strokes.append(simulated_peaks(models, excitation, run.configuration, 100.0).stroke["isolation"])
    return max(strokes, default=0.0)


def test_a_plan_that_distinguishes_two_springs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, plan = written(tmp_path / "diagnosis", rivals(two_springs(), sample_rate=512.0)), tmp_path / "next.toml"
    assert main(["next", str(folder), "-o", str(plan), "--limits", str(limited(tmp_path, 0.008))]) == 0
    said = capsys.readouterr().out
    assert "Which of the indistinguishable causes is the true one?" in said
    assert "hardening stiffness at isolation" in said
    assert "this distinguishes them" in said
    runs = read_plan(plan).runs
    assert 1 <= len(runs) <= 3
    assert sum(run.seconds for run in runs) <= 60.0
    assert all(run.gain <= 70.0 and run.seconds <= 20.0 for run in runs)
    assert reached(plan) <= POLICY.usable_share * 0.008
    page = (tmp_path / "next.html").read_text()
    assert "standard errors" in page
    assert "after a refit" in page
    for width in (1280, 420) if CHROMIUM is not None else ():
        told = told_by(page, EXTENT, width, tmp_path)
        assert all(told["drawn"])
        assert told["wide"] <= told["inner"] == width

    # rig acquire takes it as it is.
    assert main(["acquire", str(plan), "--port", "virtual", "--yes", "-o", str(tmp_path / "next.h5")]) == 0
    assert {run.id for run in read(tmp_path / "next.h5").runs} == {run.id for run in runs}


def test_no_allowed_run_distinguishes_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Where the stop is out of reach, that is the answer, with the stroke that would part them; nothing exceeds the limit."""
    folder, plan = written(tmp_path / "diagnosis", rivals(two_springs(), sample_rate=512.0)), tmp_path / "next.toml"
    assert main(["next", str(folder), "-o", str(plan), "--limits", str(limited(tmp_path, 0.001))]) == 0
    said = capsys.readouterr().out
    assert "No allowed run distinguishes end stop at isolation from hardening stiffness at isolation" in said
    assert "Beyond the limits, their distance would be" in said
    assert "deflects the isolation by up to" in said
    assert not plan.exists() or reached(plan) <= POLICY.usable_share * 0.001


def test_same_equations_are_said_to_be_inseparable(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    twins = OpenSet(why="indistinguishable", models=[hardening()], twins=[("wrong_mass", "head")])
    folder = written(tmp_path / "diagnosis", rivals(twins, sample_rate=512.0))
    limits = tmp_path / "limits.toml"
    limits.write_text("gains = [0.0, 35.0]\nband = [2.0, 8.0]\n")
    assert main(["next", str(folder), "-o", str(tmp_path / "next.toml"), "--limits", str(limits), "--seconds", "5"]) == 0
    said = capsys.readouterr().out
    assert "have the same equations of motion: no run of this rig distinguishes them" in said


def test_a_parameter_known_better(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, plan = written(tmp_path / "diagnosis", rivals()), tmp_path / "precise.toml"
    call = ["next", str(folder), "-o", str(plan), "--limits", str(limited(tmp_path, 0.008))]
    assert main([*call, "--for", "motor_damping=0.0009%"]) == 0
    said = capsys.readouterr().out
    assert "motor_damping is 0.073 now, with a standard uncertainty of 0.0011 %; 0.0009 % is required." in said
    assert "It reduces the standard uncertainty of motor_damping to 0.000" in said
    assert len(read_plan(plan).runs) == 1
    assert main([*call, "--for", "motor_damping=5%"]) == 0
    assert "The required uncertainty is reached already." in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["{empty}", "-o", "{out}.toml"], "contains no diagnosis"),
        (["{old}", "-o", "{out}.toml"], "diagnose the recording again"),
        (["{damaged}", "-o", "{out}.toml"], "is damaged or of another version"),
        (["-o", "{out}.toml"], "no diagnosis was given"),
        (["{good}", "-o", "{out}.html"], "ends in .toml"),
        (["{good}", "-o", "{out}"], "ends in .toml"),
        (["{good}", "-o", "{out}.toml", "--seconds", "-1"], "--seconds is -1"),
        (["{good}", "-o", "{out}.toml", "--for", "motor_damping"], "e.g. links.spring.damping=2%"),
        (["{good}", "-o", "{out}.toml", "--for", "nonsense=2%"], "it has table_mass"),
        (["{good}", "-o", "{out}.toml", "--for", "motor_mass=2%"], "does not depend on any fitted value"),
        (["{good}", "-o", "{out}.toml", "--limits", "{limits}"], "limits.stroke names 'nothing'"),
        (["{good}", "-o", "{out}.toml", "--limits", "{none}"], "does not exist"),
    ],
)
def test_refusals(words: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good = written(tmp_path / "good", rivals())
    for name in ("empty", "old", "damaged"):
        (tmp_path / name).mkdir()
    (tmp_path / "old" / "findings.json").write_text("{}")
    (tmp_path / "damaged" / "rivals.json").write_text('{"format": "rig-rivals"}')
    (tmp_path / "limits.toml").write_text("[stroke]\nnothing = 0.01\n")
    places = {
        "empty": tmp_path / "empty", "old": tmp_path / "old", "damaged": tmp_path / "damaged", "good": good,
        "out": tmp_path / "out", "limits": tmp_path / "limits.toml", "none": tmp_path / "none.toml",
    }  # fmt: skip
    assert main(["next", *(word.format(**places) for word in words)]) == 2
    said = capsys.readouterr().err
    assert told in said
    assert said.count("\n") == 1
    assert not list(tmp_path.glob("out.*"))


def test_hidden_effects_of_the_virtual_rig(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A gain of a channel is hidden: its record is that many times another's, and the same seed hides the same."""
    from isorig.rig.wire_bonder.description import wire_bonder
    from isorig.rig.wire_bonder.effects import Hidden, campaign_with, hidden_in
    from isorig.rig.wire_bonder.session import VirtualRun

    takes = [VirtualRun(id="a", configuration="unlocked", gain=35.0, seconds=3.0, start=0.0)]
    hidden = hidden_in(wire_bonder(), "sensor_gain", 1.0, 3)
    ((cause, channel),) = hidden.truth
    assert cause == "sensor_gain"
    with_it, without = (campaign_with(each, takes, 1).runs[0] for each in (hidden, Hidden(model=wire_bonder())))
    other = next(name for name in ("motor", "table") if name != channel)
    assert np.std(with_it.read(channel)) / np.std(without.read(channel)) == pytest.approx(hidden.parameters["factor"], rel=0.01)
    assert np.std(with_it.read(other)) == pytest.approx(np.std(without.read(other)), rel=0.01)
    assert hidden_in(wire_bonder(), "sensor_gain", 1.0, 3).truth == hidden.truth
    assert main(["virtual", "campaign", "-o", str(tmp_path / "x.h5"), "--hide", "nonsense"]) == 2
    assert "there is no effect 'nonsense'" in capsys.readouterr().err
    assert main(["virtual", "instrument", "--kind", "sr785", "--hide", "end_stop"]) == 2
    assert "--hide needs an instrument that plays a drive" in capsys.readouterr().err


@pytest.mark.parametrize("limits", [[], ["--limits"]])
def test_a_rig_that_was_only_released(tmp_path: Path, capsys: pytest.CaptureFixture[str], limits: list[str]) -> None:
    released = [msgspec.structs.replace(run, excitation="free", drive_rms=0.0, drive_peak=0.0) for run in rivals().runs]
    folder = written(tmp_path / "diagnosis", rivals(verdict="unexplained", runs=released))
    more = [*limits, str(limited(tmp_path, 0.008))] if limits else []
    assert main(["next", str(folder), "-o", str(tmp_path / "next.toml"), *more]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == (
        "rig: no run of lab.h5 was driven, so no drive can be proposed; release the rig from another position, and repeat one "
        "release"
    )


def test_runs_whose_drives_cannot_be_generated_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing is known of what they reached, so no stronger run is sought; another question is answered instead."""
    other = [msgspec.structs.replace(run, excitation="other") for run in rivals().runs]
    folder = written(tmp_path / "diagnosis", rivals(verdict="unexplained", runs=other))
    call = ["next", str(folder), "-o", str(tmp_path / "next.toml"), "--limits", str(limited(tmp_path, 0.008))]
    assert main(call) == 0
    assert capsys.readouterr().out
