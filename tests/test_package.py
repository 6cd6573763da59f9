"""What is built and installed: an sdist from the tree, a wheel from the sdist, the command in an environment of its own."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
BUILD = "import sys; from setuptools import build_meta; getattr(build_meta, sys.argv[1])(sys.argv[2])"


def called(call: list[str | Path], folder: Path) -> str:
    """What a command prints; it must succeed."""
    done = subprocess.run(call, cwd=folder, capture_output=True, text=True, timeout=280, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """An sdist of a clean copy of the tree, and a wheel of the unpacked sdist."""
    place = tmp_path_factory.mktemp("package")
    needed = ("isorig", "pyproject.toml", "README.md", "LICENSE")
    tracked = called(["git", "ls-files", "-z", *needed], ROOT)
    for name in tracked.split("\0")[:-1]:
        (place / "tree" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, place / "tree" / name)
    called([sys.executable, "-c", BUILD, "build_sdist", place], place / "tree")
    (sdist,) = place.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        archive.extractall(place / "unpacked", filter="data")
    (source,) = (place / "unpacked").iterdir()
    called([sys.executable, "-c", BUILD, "build_wheel", place], source)
    (wheel,) = place.glob("*.whl")
    return sdist, wheel


@pytest.mark.study
def test_the_wheel_holds_every_file_of_the_packages(built: tuple[Path, Path]) -> None:
    _, wheel = built
    held = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    assert held == set(called(["git", "ls-files", "isorig"], ROOT).split())
    assert "isorig/py.typed" in held
    assert any(name.endswith("page.js") for name in held)


@pytest.mark.study
def test_the_wheel_installs_in_an_empty_environment(built: tuple[Path, Path], tmp_path: Path) -> None:
    _, wheel = built
    called([sys.executable, "-m", "venv", tmp_path / "env"], tmp_path)
    python = tmp_path / "env" / "bin" / "python"
    done = subprocess.run(
        [python, "-m", "pip", "install", "--quiet", wheel], cwd=tmp_path, capture_output=True, text=True, timeout=280, check=False
    )
    if done.returncode != 0 and "No matching distribution" in done.stderr:
        pytest.skip("the package index cannot be reached, so the dependencies cannot be installed")
    assert done.returncode == 0, done.stderr
    for name in ("analysis", "rig", "drivers"):
        (tmp_path / f"{name}.py").write_text("raise RuntimeError('this is the user\\'s own file')\n", encoding="utf-8")
    command = tmp_path / "env" / "bin" / "rig"
    assert called([command, "--version"], tmp_path).strip() == "0.1.0"
    called([command, "virtual", "campaign", "-o", "v.h5", "--session", "later"], tmp_path)
    assert "xlock" in called([command, "check", "v.h5"], tmp_path)
    assert called([python, "-c", "import isorig as iso; print(len(iso.read('v.h5').runs))"], tmp_path).strip() == "5"
