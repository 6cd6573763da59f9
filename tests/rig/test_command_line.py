"""The command line as a whole: version, help, completion."""

from __future__ import annotations

import inspect
import os
import re
import subprocess
import sys
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

import pytest
from cyclopts import App
from test_recording import example

from isorig.rig import cli
from isorig.rig.cli import READER_GONE, main
from isorig.rig.files.recording import write
from isorig.rig.help import COMMANDS, purpose


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.strip() == version("isorig")


def test_help_has_one_line_for_each_command(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["--help"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for name in COMMANDS:
        assert len([line for line in lines if line.split()[1:2] == [name] and purpose(name) in line]) == 1, name


@pytest.mark.parametrize("columns", ["60", "80", "132"])
def test_the_list_of_commands_looks_as_the_pages_of_the_commands(
    columns: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    assert main(["--help"]) == 0
    shown = capsys.readouterr().out.splitlines()
    cli._app([]).help_print([])
    assert shown == [line.rstrip() for line in capsys.readouterr().out.splitlines()]


@pytest.mark.parametrize("arguments", ["[]", "['--help']", "['-h']"])
def test_the_list_of_commands_imports_no_library_of_pages(arguments: str) -> None:
    call = f"import sys\nfrom isorig.rig.cli import main\nmain({arguments})"
    code = f"{call}\nsys.exit(str({{'cyclopts', 'rich'}} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert "Usage: rig COMMAND" in done.stdout
    assert done.stderr.strip() == "set()"


def test_the_check_of_a_recording_imports_no_simulation(tmp_path: Path) -> None:
    write(tmp_path / "a.h5", example())
    call = f"import sys\nfrom isorig.rig.cli import main\nmain(['check', {str(tmp_path / 'a.h5')!r}])"
    code = f"{call}\nsys.exit(str({{'isorig.analysis.simulate', 'numba', 'scipy', 'matplotlib'}} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert "set-up" in done.stdout
    assert done.stderr.strip() == "set()"


def test_the_list_of_commands_is_written_in_the_characters_of_the_output() -> None:
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(
        [sys.executable, "-m", "isorig", "--help"], capture_output=True, env=environment, timeout=60, check=True
    )
    assert b"+- Commands ---" in done.stdout


def test_a_page_joins_the_lines_of_a_paragraph(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    assert main(["simulate", "--help"]) == 0
    said = capsys.readouterr().out
    lines = inspect.cleandoc(import_module("isorig.rig.commands.simulate").simulate.__doc__).split("\n\n")[1].splitlines()
    assert len(lines) > 1
    assert " ".join(lines)[:150] in said
    # A name between angle brackets is no HTML.
    assert "<contact>_friction" in said


@pytest.mark.parametrize("name", COMMANDS)
def test_each_parameter_of_a_command_has_a_text(name: str) -> None:
    file = import_module(f"isorig.rig.commands.{COMMANDS[name]}")
    found = getattr(file, COMMANDS[name])
    functions = [found[each].default_command for each in found if not each.startswith("-")] if isinstance(found, App) else [found]
    for function in functions:
        documented = re.findall(r"^(\w+)\n    \S", inspect.cleandoc(function.__doc__ or ""), re.MULTILINE)
        assert set(inspect.signature(function).parameters) <= set(documented), function.__name__


@pytest.mark.skipif(sys.platform == "win32", reason="bash")
def test_bash_completes_commands_and_options(tmp_path: Path) -> None:
    assert main(["--install-completion", "--shell", "bash", "--output", str(tmp_path / "rig.bash")]) == 0
    ask = (
        "source $1; shift; f=$(complete -p rig | sed 's/.*-F \\([^ ]*\\).*/\\1/'); COMP_WORDS=(\"$@\"); COMP_CWORD=$(($#-1)); "
        '$f rig "${@: -1}" "${@: -2:1}"; echo "${COMPREPLY[@]}"'
    )

    def offered(*words: str) -> set[str]:
        call = ["bash", "-c", ask, "bash", str(tmp_path / "rig.bash"), "rig", *words]
        done = subprocess.run(call, env=dict(os.environ), capture_output=True, text=True, timeout=30, check=True)
        return set(done.stdout.split())

    assert offered("ch") == {"check", "characterize"}
    assert {"--reference", "--resolution"} <= offered("frf", "--re")
    assert offered("frf", "--estimator", "") == {"H1", "H2", "Hv"}


def test_a_reader_that_ends_early_causes_no_traceback() -> None:
    call = [sys.executable, "-m", "isorig", "describe", "wire-bonder"]
    with subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == READER_GONE
