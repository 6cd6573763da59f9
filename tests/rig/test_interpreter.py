"""No command executes what a data folder contains."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from isorig.rig.view.process import session_screen
from isorig.rig.view.session_control import SessionControl
from isorig.rig.virtual.demo import virtual_instrument

ROOT = Path(__file__).resolve().parents[2]
#: Modules that a started interpreter imports early: of this program, of others, of the standard library.
PLANTED = (
    "isorig/__init__.py",
    "msgspec/__init__.py",
    "numpy/__init__.py",
    "tornado/__init__.py",
    "runpy.py",
    "json.py",
    "signal.py",
)


def test_a_module_in_the_working_folder_is_not_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in PLANTED:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(f"open({str(tmp_path / 'executed')!r}, 'a').write({name!r})\n")
    monkeypatch.chdir(tmp_path)
    with virtual_instrument(1) as port:
        assert port
    with session_screen(SessionControl((), tmp_path / "c.h5", asks=False)) as address:
        assert address.startswith("http://127.0.0.1:")
    assert not (tmp_path / "executed").exists()


def test_every_interpreter_is_started_without_the_working_folder() -> None:
    calls = []
    for path in sorted((ROOT / "isorig").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        assert not re.search(r"multiprocessing|ProcessPoolExecutor|os\.system|shell=True|os\.exec", text), path
        calls += [line.strip() for line in text.splitlines() if "sys.executable" in line and 'f"' not in line]
    assert calls == [
        '[sys.executable, "-I", str(Path(__file__).with_name("hdf_walk.py"))],',
        'return [sys.executable, "-P", *arguments]',
    ]
