"""The interface `import isorig as iso`: names, examples, types, documentation, and scripts next to files of the same names."""

from __future__ import annotations

import doctest
import errno
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import is_dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from msgspec import structs

import isorig as iso
from isorig.names import __all__ as names

ROOT = Path(__file__).resolve().parents[1]
TAKES = [
    iso.VirtualRun(id="u70", configuration="unlocked", gain=70.0, seconds=10.0, start=0.0, band=(0.5, 60.0)),
    iso.VirtualRun(id="u7", configuration="unlocked", gain=7.0, seconds=10.0, start=60.0, band=(0.5, 400.0)),
    iso.VirtualRun(id="l70", configuration="locked", gain=70.0, seconds=10.0, start=120.0, band=(0.5, 60.0)),
    iso.VirtualRun(id="l7", configuration="locked", gain=7.0, seconds=10.0, start=180.0, band=(0.5, 400.0)),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the recording that the examples read."""
    place = tmp_path_factory.mktemp("examples")
    iso.write(place / "campaign.h5", iso.virtual_campaign(iso.wire_bonder(), TAKES, seed=1))
    return place


#: Their examples take seconds; the tour makes the same calls.
LONG = ("characterize", "diagnose")


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.study) if name in LONG else name for name in names])
def test_every_name_has_an_example_that_runs(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    value = getattr(iso, name)
    example = doctest.DocTestParser().get_doctest(value.__doc__ or "", {}, name, None, None)
    assert example.examples, f"{name} has no example in its docstring"
    assert doctest.DocTestRunner().run(example).failed == 0


def test_import_is_light() -> None:
    code = "import sys, isorig; print(sorted(set(sys.modules) & {'numpy', 'numba', 'scipy', 'h5py', 'isorig.names'}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == "[]"
    # Of a function, not what results show in notebooks.
    code = "import sys, isorig; isorig.read; print(sorted(set(sys.modules) & {'matplotlib', 'numba', 'pandas', 'pyarrow'}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == "[]"


def test_completion_in_a_shell_lists_the_names_and_a_wrong_one_is_refused() -> None:
    assert set(names) <= set(dir(iso))
    assert len(names) < 30
    with pytest.raises(AttributeError, match=r"has no 'spectrum'; it has .*characterize"):
        _ = iso.spectrum  # type: ignore[attr-defined]
    assert re.fullmatch(r"\d+\.\d+\.\d+", iso.__version__)


def test_the_page_shows_these_names_and_no_others() -> None:
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    interface, results = page.split("## Results")
    assert sorted(re.findall(r"^::: isorig\.(\S+)$", interface, re.MULTILINE)) == sorted(names)
    for place in re.findall(r"^::: (\S+)$", results, re.MULTILINE):
        module, name = place.rsplit(".", 1)
        assert hasattr(getattr(import_module(module), name), "_fields") or is_dataclass(getattr(import_module(module), name))


def test_files_next_to_a_script_may_have_the_names_of_the_folders(folder: Path, tmp_path: Path) -> None:
    for name in ("analysis", "rig", "drivers", "laws", "isolation"):
        (tmp_path / f"{name}.py").write_text("raise RuntimeError('this is the user\\'s own file')\n", encoding="utf-8")
    (tmp_path / "mine.py").write_text("ANSWER = 42\n", encoding="utf-8")
    script = tmp_path / "script.py"
    script.write_text(
        "import sys\nimport mine\nimport isorig as iso\n"
        "print(mine.ANSWER, len(iso.read(sys.argv[1]).runs), iso.wire_bonder().name)\n"
        "from isorig.rig.cli import main\nsys.exit(main(['check', sys.argv[1]]))\n",
        encoding="utf-8",
    )
    call = [sys.executable, str(script), str(folder / "campaign.h5")]
    done = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("42 4 wire bonder")


@pytest.mark.study
def test_type_checkers_see_the_names(tmp_path: Path) -> None:
    script = tmp_path / "typed.py"
    lines = [f"reveal_type(iso.{name})" for name in ("read", "frf", "Rig", "diagnose")]
    script.write_text("\n".join(["import isorig as iso", *lines, "iso.read(3)\niso.spectrum\n"]), encoding="utf-8")
    call = [sys.executable, "-m", "mypy", "--strict", str(script)]
    environment = {**os.environ, "MYPYPATH": str(ROOT)}
    done = subprocess.run(call, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=280, check=False)
    told = [line for line in done.stdout.splitlines() if "typed.py" in line]
    expected = ("Campaign", "Transfer", "RigModel", "Answer", "incompatible type", "has no attribute")
    assert all(word in line for word, line in zip(expected, told, strict=True)), done.stdout


def test_the_tour_runs(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cells = json.loads((ROOT / "docs" / "tour.ipynb").read_text(encoding="utf-8"))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert len(code) >= 8
    monkeypatch.chdir(folder)
    exec("\n\n".join(code), {"__name__": "tour"})
    used = {name for name in names if re.search(rf"\biso\.{name}\b", "\n".join(code))}
    assert len(used) >= 15


def test_the_tour_is_stored_with_its_outputs_on_a_rig_of_its_own() -> None:
    cells = json.loads((ROOT / "docs" / "tour.ipynb").read_text(encoding="utf-8"))["cells"]
    outputs = [output for cell in cells for output in cell.get("outputs", ())]
    assert not [output for output in outputs if output["output_type"] == "error"]
    shown = [kind for output in outputs for kind in output.get("data", ())]
    assert shown.count("image/png") >= 4
    assert shown.count("text/html") >= 5
    assert "hardening" in "".join(str(output.get("data", {}).get("text/html", "")) for output in outputs)
    first = next(cell for cell in cells if "read_rig" in "".join(cell["source"]))
    assert "two carts" in "".join(first["outputs"][0]["data"]["text/plain"])


@pytest.mark.parametrize("given", ["rig.toml", {}, iso.read_rig("two-carts")])
def test_another_type_than_a_rig_is_refused_in_one_sentence(given: object) -> None:
    campaign = iso.virtual_campaign(iso.wire_bonder(), TAKES[:1], seed=1)
    drive = iso.Excitation.prepare(campaign.runs[0].read("head"), 1024.0)
    calls = [
        lambda rig: iso.diagnose(campaign, rig), lambda rig: iso.predict(rig, campaign), lambda rig: iso.simulate(rig, drive),
        lambda rig: iso.trace(rig, drive), iso.virtual_campaign,
    ]  # fmt: skip
    if isinstance(given, str | dict):
        calls.append(lambda rig: iso.characterize(campaign, rig))
    for call in calls:
        with pytest.raises(iso.AnalysisError, match=rf"the rig is of type {type(given).__name__}, but must be an iso\.Rig; give"):
            call(given)


def test_a_rig_without_sensors_is_not_diagnosed() -> None:
    campaign = iso.virtual_campaign(iso.wire_bonder(), TAKES[:1], seed=1)
    blind = structs.replace(iso.wire_bonder(), sensors=())
    for call in (iso.diagnose, iso.characterize):
        with pytest.raises(iso.RigError, match="without a sensor"):
            call(campaign, blind)


#: A campaign of the wire bonder, its path, and what a notebook may have instead.
MEASURED = iso.virtual_campaign(iso.wire_bonder(), TAKES[::2], seed=1)
RUN = MEASURED.runs[0]
HEAD = RUN.channels["head"]
RIG = iso.wire_bonder()
FRAME = pd.DataFrame({"head": [1.0, 2.0, 3.0], "table": [0.0, 1.0, 0.0]})
SHORT = iso.Channel(name="a", samples=np.zeros(3))
FRF = iso.frf(MEASURED, resolution=0.5)[0]
DRIVE = iso.Excitation.prepare(np.sin(np.arange(300.0)), 1024.0)
OF_CAMPAIGNS: dict[str, Callable[[Any], object]] = {
    "frf": lambda given: iso.frf(given, resolution=0.5), "faults": lambda given: iso.faults(given, reference="head"),
    "isolation_ratio": lambda given: iso.isolation_ratio(given, resolution=0.5),
    "predict": lambda given: iso.predict(iso.wire_bonder(), given),
    "write": lambda given: iso.write("copy.h5", given), "diagnose": iso.diagnose, "characterize": iso.characterize,
}  # fmt: skip


@pytest.mark.parametrize("name", OF_CAMPAIGNS)
def test_another_type_than_a_campaign_is_refused_in_one_sentence(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for given in (FRAME, RUN, [RUN], HEAD, np.zeros((3, 2)), None, 3, {"head": HEAD}):
        with pytest.raises(
            iso.AnalysisError, match=r"^the campaign is of type \w+, but must be an iso\.Campaign or the path"
        ) as told:
            OF_CAMPAIGNS[name](given)
        assert isinstance(told.value, TypeError)
        assert type(given).__name__ in str(told.value)
    with pytest.raises(iso.RigError, match=r"nothing\.h5"):
        OF_CAMPAIGNS[name]("nothing.h5")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("kind", [str, Path])
def test_the_path_of_a_recording_is_as_good_as_its_campaign(
    kind: Callable[[Path], Any], folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    path, campaign = kind(folder / "campaign.h5"), iso.read(folder / "campaign.h5")
    for name in ("frf", "faults", "isolation_ratio", "predict", "write"):
        found, expected = OF_CAMPAIGNS[name](path), OF_CAMPAIGNS[name](campaign)
        assert repr(found) == repr(expected)
    assert [run.id for run in iso.read("copy.h5").runs] == [run.id for run in campaign.runs]
    assert iso.diagnose(path, seconds=0.0).campaign.runs[0].id == campaign.runs[0].id


#: What a notebook may give, and what the sentence says: found, allowed.
WRONG_TYPES: list[tuple[Callable[[], object], str]] = [
    (lambda: iso.read(3), "recording is of type int, but must be a path"),
    (lambda: iso.read(FRAME), "recording is of type DataFrame, but must be a path"),
    (lambda: iso.write(MEASURED, "x.h5"), "recording is of type Campaign, but must be a path"),
    (lambda: iso.import_campaign(FRAME, "x.h5"), "mapping is of type DataFrame, but must be a path"),
    (lambda: iso.read_rig(RIG), "rig is of type RigModel, but must be a path"),
    (lambda: iso.Channel(name="a", samples="abc"), "samples of type str, but they must be an array"),
    (lambda: iso.Channel(name="a", samples=None), "samples of type NoneType, but they must be an array"),
    (lambda: iso.Channel(name="a", samples=3.0), "samples of type float, but they must be an array"),
    (lambda: iso.Channel(name="a", samples=["1", "2"]), "of type list, but must be an array of numbers"),
    (lambda: iso.Channel(name="a", samples=np.array(["1"])), "samples of type <U1, but they must be numbers"),
    (lambda: iso.Channel(name="a", samples=np.array([1j])), "samples of type complex128, but they must be numbers"),
    (lambda: iso.Channel(name=3, samples=np.zeros(3)), "name of a channel is of type int"),
    (lambda: iso.Channel(name="a", samples=np.zeros(3), scale="1"), "scale of channel 'a' is of type str"),
    (lambda: replace(RUN, channels=[HEAD]), "channels of run 'u70' is of type list, but must be a mapping"),
    (lambda: replace(RUN, channels=FRAME), "channels of run 'u70' is of type DataFrame, but must be a mapping"),
    (lambda: replace(RUN, channels={"head": np.zeros(3)}), "channel 'head' of run 'u70' is of type ndarray"),
    (lambda: replace(RUN, channels={"head": [1.0, 2.0]}), "channel 'head' of run 'u70' is of type list"),
    (lambda: replace(RUN, sample_rate="1024"), "sample rate of run 'u70' is of type str, but must be a number"),
    (lambda: replace(RUN, sample_rate=None), "sample rate of run 'u70' is of type NoneType"),
    (lambda: replace(RUN, gain="70"), "gain of run 'u70' is of type str, but must be a number"),
    (lambda: replace(RUN, id=3), "id of a run is of type int"),
    (lambda: replace(RUN, band=("5", "60")), "band of run 'u70' is of type str, but must be a number"),
    (lambda: iso.Campaign(runs=RUN), "runs is of type Run, but must be a sequence of iso.Run"),
    (lambda: iso.Campaign(runs={"a": RUN}), "runs is of type dict, but must be a sequence of iso.Run"),
    (lambda: iso.Campaign(runs=[HEAD]), "runs has a Channel at place 1, but must be a sequence"),
    (lambda: iso.Campaign(runs=(RUN,), known={"head_mass": "6"}), "value 'head_mass' is of type str"),
    (lambda: MEASURED.select(gain="70"), "gain is of type str, but must be a number"),
    (lambda: RUN.read(3), "name of a channel is of type int"),
    (lambda: iso.faults(MEASURED, reference=3), "reference is of type int"),
    (lambda: iso.frf(MEASURED, reference=3), "reference is of type int, but must be a sequence"),
    (lambda: iso.frf(MEASURED, responses="table"), "responses is of type str, but must be a sequence of channel names"),
    (lambda: iso.frf(MEASURED, resolution="0.5"), "resolution is of type str"),
    (lambda: iso.estimate(MEASURED, references=["head"]), "runs is of type Campaign, but must be a sequence"),
    (lambda: iso.estimate(RUN, references=["head"]), "runs is of type Run, but must be a sequence"),
    (lambda: iso.estimate("campaign.h5", references=["head"]), "runs is of type str, but must be a sequence"),
    (lambda: iso.estimate([RUN], references="head"), "references is of type str, but must be a sequence of channel names"),
    (lambda: iso.fit_modes(MEASURED, (5.0, 60.0)), "transfer function is of type Campaign"),
    (lambda: iso.fit_modes(FRF, 5.0), "band is of type float, but must be two numbers"),
    (lambda: iso.fit_modes(FRF, ("5", "60")), "band is of type str, but must be a number"),
    (lambda: iso.fit_modes(FRF, (5.0, 60.0), guesses=[5.0]), "guesses is of type float, but must be pairs"),
    (lambda: iso.modes(FRF, (5.0, 60.0)), "frfs is of type Transfer, but must be a sequence"),
    (lambda: iso.modes([MEASURED], (5.0, 60.0)), "frfs has a Campaign at place 1"),
    (lambda: iso.isolation_ratio(MEASURED, stitch="15"), "stitching frequency is of type str"),
    (lambda: iso.isolated_share(MEASURED, above=5.0), "isolation ratio is of type Campaign"),
    (lambda: iso.diagnose(MEASURED, tolerance="1"), "tolerance is of type str"),
    (lambda: iso.diagnose(MEASURED, seconds="1"), "time limit is of type str"),
    (lambda: iso.predict(RIG, MEASURED, origin="now"), "origin is of type str"),
    (lambda: iso.simulate(RIG, np.zeros(300)), "drive is of type ndarray, but must be an iso.Excitation"),
    (lambda: iso.simulate(RIG, DRIVE, start_time="1"), "start time is of type str"),
    (lambda: iso.simulate(RIG, DRIVE, start=3), "start is of type int"),
    (lambda: iso.trace(RIG, HEAD), "drive is of type Channel, but must be an iso.Excitation"),
    (lambda: iso.Excitation.prepare(HEAD, 1024.0), "drive is of type Channel, but must be an array"),
    (lambda: iso.Excitation.prepare(np.zeros(30), "1024"), "sample rate is of type str"),
    (lambda: iso.virtual_campaign(RIG, TAKES[0]), "takes is of type VirtualRun, but must be a sequence"),
    (lambda: iso.virtual_campaign(RIG, [RUN]), "takes has a Run at place 1"),
    (lambda: replace(TAKES[0], seconds="10"), "length of run 'u70' is of type str"),
    (lambda: iso.wire_bonder(3), "values is of type int, but must be a mapping"),
    (lambda: iso.Rig(name="x", bodies=3, drive=RIG.drive), "bodies of the rig is of type int"),
    (lambda: iso.Rig(name="x", bodies=["a"], drive=RIG.drive), "bodies of the rig has a str at place 1"),
    (lambda: iso.Rig(name="x", bodies=RIG.bodies, drive="head"), "drive of the rig is of type str"),
    (lambda: structs.replace(RIG, bodies=(structs.replace(RIG.bodies[0], mass="3"),)), "mass of 'table' is of type str"),
    (lambda: RIG.replace({"bodies.motor.mass": "20"}), "value of 'bodies.motor.mass' is of type str"),
    (lambda: RIG.get(3), "path of a parameter is of type int"),
    (lambda: iso.laws.Coulomb(friction_force="3"), "friction_force is of type str"),
    (lambda: MEASURED.plot(3), "overlay has a int at place 1"),
]  # fmt: skip


def refusal(call: Callable[[], object], said: str) -> iso.AnalysisError:
    """What a call raises: one sentence that says this and what to do."""
    with pytest.raises(iso.AnalysisError) as told:
        call()
    assert said in str(told.value)
    assert ";" in str(told.value)
    assert "\n" not in str(told.value)
    return told.value


@pytest.mark.parametrize(("call", "said"), WRONG_TYPES, ids=[said for _, said in WRONG_TYPES])
def test_an_argument_of_another_type_is_refused_in_one_sentence(call: Callable[[], object], said: str) -> None:
    refused = refusal(call, said)
    assert isinstance(refused, TypeError)
    assert "but" in str(refused)


#: Values of the right type that cannot be right.
WRONG_VALUES: list[tuple[Callable[[], object], str]] = [
    (lambda: iso.read("a\0.h5"), "character zero"),
    (lambda: iso.Channel(name="a", samples=np.array([0.0, np.nan])), "channel 'a' holds nan at sample 1"),
    (lambda: iso.Channel(name="a", samples=[0.0, np.inf]), "channel 'a' holds inf at sample 1"),
    (lambda: iso.Channel(name="a", samples=np.zeros((3, 2))), "samples of shape (3, 2)"),
    (lambda: iso.Channel(name="a", samples=FRAME), "samples of shape (3, 2)"),
    (lambda: iso.Channel(name="a", samples=np.zeros(3), quantity="speed"), "quantity of channel 'a' is 'speed'"),
    (lambda: replace(RUN, sample_rate=-1.0), "sample rate of run 'u70' is -1 Hz"),
    (lambda: replace(RUN, sample_rate=float("nan")), "sample rate of run 'u70' is nan"),
    (lambda: replace(RUN, channels={"head": HEAD, "a": SHORT}), "unequal length (head 10240, a 3)"),
    (lambda: replace(RUN, band=(60.0, 5.0)), "band of run 'u70' is [60.0, 5.0]"),
    (lambda: replace(RUN, period=1), "period of run 'u70' is 1"),
    (lambda: iso.frf(MEASURED, estimator="H9"), "estimator is 'H9'"),
    (lambda: iso.fit_modes(FRF, (5.0, 60.0), guesses=[(-5.0, 0.1)]), "guesses is -5, but must be positive"),
    (lambda: iso.fit_modes(FRF, (5.0, 60.0), guesses=[(5.0, 0.1, 1.0)]), "guesses has [5.0, 0.1, 1.0]"),
    (lambda: iso.fit_modes(FRF, (5.0, 60.0), kind="any"), "kind is 'any'"),
    (lambda: iso.simulate(RIG, DRIVE, start={"nothing": (0.0, 0.0)}), "no body 'nothing'"),
    (lambda: iso.simulate(RIG, DRIVE, start={"table": (0.0,)}), "'table' has 1 numbers"),
    (lambda: iso.Excitation.prepare(np.zeros(30), 1024.0, oversample=0), "steps per sample is 0"),
    (lambda: iso.wire_bonder({"head_mass": 6.5}), "lack 'table_mass'"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "said"), WRONG_VALUES, ids=[said for _, said in WRONG_VALUES])
def test_an_impossible_value_is_refused_in_one_sentence(call: Callable[[], object], said: str) -> None:
    assert isinstance(refusal(call, said), ValueError)


def test_samples_may_be_a_list_or_a_column_but_those_on_disk_are_not_read() -> None:
    class OnDisk:
        shape = (4,)

        def __getitem__(self, key: slice, /) -> np.ndarray:
            raise AssertionError("the samples were read")

    for given in ([0, 100, -50], (0, 100, -50), FRAME["head"]):
        channel = iso.Channel(name="a", samples=given)
        assert len(channel) == 3
        assert type(channel.read()) is np.ndarray
    run = replace(RUN, channels={"a": iso.Channel(name="a", samples=OnDisk())})
    assert len(iso.Campaign(runs=(run,)).runs[0]) == 4


def test_places_where_nothing_can_be_written_are_refused_and_no_half_file_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    for place in ("folder", "file/campaign.h5", "", "/proc/campaign.h5"):
        with pytest.raises(OSError, match="cannot be written") as told:
            iso.write(place, MEASURED)
        assert isinstance(told.value, iso.RigError)
        assert ";" in str(told.value)
    monkeypatch.setattr(tempfile, "mkstemp", read_only)
    with pytest.raises(iso.RigError, match=r"campaign\.h5 cannot be written \(Read-only file system\)"):
        iso.write("campaign.h5", MEASURED)
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["file", "folder"]
    assert (tmp_path / "file").read_text(encoding="utf-8") == "mine"


def read_only(**place: object) -> tuple[int, str]:
    """What a system says of a place that cannot be written."""
    raise OSError(errno.EROFS, os.strerror(errno.EROFS))


def test_a_folder_that_does_not_exist_is_made(tmp_path: Path) -> None:
    iso.write(tmp_path / "new" / "folder" / "campaign.h5", MEASURED)
    assert [path.name for path in tmp_path.rglob("*.h5")] == ["campaign.h5"]
