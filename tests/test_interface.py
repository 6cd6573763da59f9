"""The interface `import isorig as iso`: names, examples, types, documentation, and scripts next to files of the same names."""

from __future__ import annotations

import doctest
import json
import os
import re
import subprocess
import sys
from dataclasses import is_dataclass
from importlib import import_module
from pathlib import Path

import pytest
from msgspec.structs import replace

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


def test_the_tour_runs(folder: Path) -> None:
    cells = json.loads((ROOT / "docs" / "tour.ipynb").read_text(encoding="utf-8"))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert len(code) >= 8
    environment = {**os.environ, "MPLBACKEND": "agg"}
    call = [sys.executable, "-c", "\n\n".join(code)]
    done = subprocess.run(call, cwd=folder, env=environment, capture_output=True, text=True, timeout=200, check=False)
    assert done.returncode == 0, done.stderr
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
    blind = replace(iso.wire_bonder(), sensors=())
    for call in (iso.diagnose, iso.characterize):
        with pytest.raises(iso.RigError, match="without a sensor"):
            call(campaign, blind)
