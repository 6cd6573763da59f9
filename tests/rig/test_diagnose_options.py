"""The time limit and the tolerance of a diagnosis, through the command line."""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from isorig.analysis import deadline
from isorig.analysis.campaign import FloatArray
from isorig.analysis.diagnose import diagnosis
from isorig.analysis.diagnose.diagnosis import AFTER_FITS, AFTER_SEARCH, KEPT, diagnose
from isorig.analysis.fitting.residuals import Problem
from isorig.analysis.model.rig_model import RigModel
from isorig.rig.cli import main
from isorig.rig.diagnose.many import diagnose_file
from isorig.rig.files.findings import KindAt, read_findings
from isorig.rig.files.recording import write
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.session import SESSION, virtual_campaign

#: With a low drive friction holds the motor, and the linear baseline would be adequate: a stiff link holds it too.
TAKES = [replace(take, seconds=6.0) for take in SESSION if take.id in ("u70a", "l7")]
#: On a clock that goes on by a second with each stage, of which preparing is one, and with a share of what is left then kept:
#: over before the baseline is fitted, before the first cause is looked for, and after a look at all causes.
AT_ONCE, BASELINE_ONLY, ONE_LOOK = (1.0 + (end - 1.0) / (1.0 - KEPT) for end in (0.95, 2.5, 3.5))

#: Simulations after which the fits of causes have begun, and are not over.
WITHIN_FITS = 42.0


@pytest.fixture(scope="module")
def rubbing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of a rig with friction, alone in a folder."""
    file = tmp_path_factory.mktemp("rubbing") / "rubbing.h5"
    write(file, virtual_campaign(wire_bonder({**THESIS, "friction_force": 10.0}), TAKES, seed=3))
    return file


@contextmanager
def ticking() -> Iterator[list[float]]:
    """A clock that goes on by a second with each stage of a diagnosis; gives the times that its search keeps."""
    stages: list[str] = []
    kept: list[float] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(deadline, "time", SimpleNamespace(process_time=lambda: float(len(stages))))
        patch.setattr(
            diagnosis, "diagnose", lambda *given, progress, **options: diagnose(*given, progress=stages.append, **options)
        )
        patch.setattr(diagnosis, "keep_time", lambda seconds: (kept.append(seconds), deadline.keep_time(seconds)))
        yield kept


@pytest.fixture
def clock() -> Iterator[None]:
    with ticking():
        yield


def diagnosed(given: Path, output: Path, *more: object) -> int:
    return main(["diagnose", str(given), "--baseline", "linear", "-o", str(output), *map(str, more)])


@dataclass(frozen=True)
class Cut:
    """What a folder's diagnosis within a time limit said and wrote, when, and the times that its search kept."""

    said: str
    findings: dict[str, Any]
    page: str
    written: int
    kept: list[float]


@pytest.fixture(scope="module")
def cut(rubbing: Path) -> tuple[Path, dict[float, Cut]]:
    """The folder of answers, and each of them, within a shorter limit and then within a longer one."""
    output = rubbing.parent / "out"
    place, found = output / "rubbing", {}
    for seconds in (BASELINE_ONLY, ONE_LOOK):
        with ticking() as kept, redirect_stdout(StringIO()) as said:
            assert diagnosed(rubbing.parent, output, "--seconds", seconds) == 0
        text, page = (place / "findings.json").read_text(), (place / "report.html").read_text()
        written = (place / "findings.json").stat().st_mtime_ns
        found[seconds] = Cut(said.getvalue(), json.loads(text), page, written, kept)
    return output, found


@pytest.mark.parametrize("seconds", [BASELINE_ONLY, ONE_LOOK])
def test_a_search_cut_short_leaves_a_partial_answer(seconds: float, cut: tuple[Path, dict[float, Cut]]) -> None:
    answer = cut[1][seconds]
    assert "the time limit ended the search for causes before all were tried" in answer.said
    assert answer.findings["cut_short"] is True
    assert answer.findings["verdict"] == "unexplained"
    assert answer.findings["baseline"]["parameters"]
    assert "the time limit ended the search for causes before all were tried" in answer.page
    assert "no cause in the catalogue earns its name" not in answer.page


def test_a_search_that_takes_all_its_time_leaves_that_of_the_evidence(cut: tuple[Path, dict[float, Cut]]) -> None:
    of_search, of_evidence = cut[1][BASELINE_ONLY].kept
    assert of_evidence == pytest.approx(AFTER_FITS / AFTER_SEARCH * of_search)
    assert of_search == pytest.approx(KEPT * (BASELINE_ONLY - 1.0))


@pytest.mark.usefixtures("clock")
def test_the_equations_answer_before_the_baseline_is_fitted(
    rubbing: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert diagnosed(rubbing, tmp_path / "out", "--seconds", AT_ONCE) == 0
    said = capsys.readouterr().out
    assert "the equations of motion of the records point to a dry friction level at the isolation, which no fit" in said
    assert "those given are of a coarser fit" in said
    found = read_findings(tmp_path / "out")
    assert found.pointed == KindAt(kind="friction_shape", location="isolation")
    assert {value.std for value in found.baseline.parameters.values()} == {None}
    assert "the force in the isolation" in (tmp_path / "out" / "report.html").read_text().lower()


def test_a_limit_holds_within_the_fits(rubbing: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a clock that goes on with each simulation of a fit, none follows the limit, and there is an answer."""
    simulated: list[int] = []
    residuals = Problem.residuals

    def counted(problem: Problem, models: Sequence[RigModel]) -> FloatArray:
        found = residuals(problem, models)
        simulated.append(len(models))
        return found

    monkeypatch.setattr(Problem, "residuals", counted)
    monkeypatch.setattr(deadline, "time", SimpleNamespace(process_time=lambda: float(len(simulated))))
    diagnose_file(rubbing, tmp_path / "cut", "linear", limit=WITHIN_FITS, page=False)
    assert WITHIN_FITS < len(simulated) <= WITHIN_FITS + 1.0


@pytest.mark.usefixtures("clock")
def test_what_counts_as_answered(rubbing: Path, cut: tuple[Path, dict[float, Cut]]) -> None:
    """An answer counts for its tolerance; one cut short, for no more time than it had."""
    output, answers = cut
    findings = output / "rubbing" / "findings.json"

    def stamp(*more: object) -> int:
        assert diagnosed(rubbing.parent, output, *more) == 0
        return findings.stat().st_mtime_ns

    longer = answers[ONE_LOOK].written
    assert longer != answers[BASELINE_ONLY].written
    assert stamp("--seconds", ONE_LOOK) == longer
    assert stamp("--seconds", BASELINE_ONLY) == longer
    tolerant = stamp("--seconds", ONE_LOOK, "--tolerance", 10.0)
    assert tolerant != longer
    found = json.loads(findings.read_text())
    assert (found["tolerance"], found["verdict"], found["cut_short"], found["steps"]) == (10.0, "adequate", False, [])
    assert found["holdout"]["baseline"] < 10.0
    assert stamp("--tolerance", 10.0) == tolerant  # a whole answer needs no more time


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--tolerance", "-0.1"), "--tolerance is -0.1; give a share of the signal that is not negative"),
        (("--tolerance", "nan"), "--tolerance is nan"),
        (("--seconds", "-1"), "--seconds is -1; give a positive time"),
        (("--seconds", "nan"), "--seconds is nan"),
    ],
)
def test_negative_options_are_refused(
    words: tuple[str, str], says: str, rubbing: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert diagnosed(rubbing, tmp_path / "out", *words) == 2
    said = capsys.readouterr().err
    assert says in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()
