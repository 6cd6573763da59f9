"""Every command block of the documentation runs as it stands there, page by page, in one folder as a reader would."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import psutil
import pytest
from forked_rig import forked_rig

from isorig.rig.files.recording import write
from isorig.rig.wire_bonder.description import wire_bonder
from isorig.rig.wire_bonder.session import SESSION, virtual_campaign

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
#: Pages that need files of others come behind them.
ORDER = ("index.md", "session.md", "offline.md", "diagnosing.md", "designing.md", "formats.md")
BLOCK = re.compile(r"^```(\S*)([^\n]*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
#: Languages of blocks that are not run: what is shown, not called.
SHOWN = {"", "text", "toml", "json"}
#: Seconds that the helpers of a process may outlive it.
GRACE = 5.0


def pages() -> list[Path]:
    """All pages, those of a session first."""
    first = [DOCS / name for name in ORDER]
    return [*first, *sorted(set(DOCS.glob("*.md")) - set(first))]


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the pages' commands run: with a short recording that stands for a session."""
    place = tmp_path_factory.mktemp("docs")
    takes = [replace(take, seconds=10.0) for take in SESSION if take.id in ("u70a", "u7", "l70", "l7")]
    write(place / "campaign.h5", virtual_campaign(wire_bonder(), takes, seed=1))
    return place


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """The environment of a reader's shell."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    with forked_rig(tmp_path_factory.mktemp("rig"), {**os.environ, "PATH": path, "COLUMNS": "80"}) as own:
        yield own


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_commands_run(page: Path, folder: Path, environment: dict[str, str]) -> None:
    for language, more, code in BLOCK.findall(page.read_text(encoding="utf-8")):
        if "title=" in more:  # a file, see test_extending.py
            continue
        assert language in {"bash", "python", *SHOWN}, f"a block of {page.name} says {language!r}; name bash, python or {SHOWN}"
        if language in SHOWN:
            assert not re.search(r"^\s*(rig|make|\$) ", code, re.MULTILINE), (
                f"{page.name} shows a command that no test runs:\n{code}"
            )
            continue
        call = ["bash", "-euo", "pipefail", "-c", code] if language == "bash" else ["rig", "-c", code]
        status, said, left = called(call, folder, environment)
        assert status == 0, f"{page.name} ended with {status}:\n{code}\n{said}"
        assert not left, f"{page.name} leaves processes running:\n{code}\n{said}"


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_a_page_says_where_the_recording_of_its_commands_comes_from(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    run = (block for block in BLOCK.finditer(text) if block[1] not in SHOWN and "title=" not in block[2])
    first = next((block.start() for block in run if "campaign.h5" in block[3]), None)
    assert first is None or "`campaign.h5`" in text[:first] or "rig virtual campaign" in text[:first]


def called(
    call: list[str], folder: Path, environment: dict[str, str], limit: float = 200.0, grace: float = GRACE
) -> tuple[int | str, str, bool]:
    """How a call ended, what it said, and whether it left processes behind; none of them outlives this.

    The output goes to a file, because a pipe ends only with the last process that holds it.
    """
    with tempfile.TemporaryFile() as output:
        process = subprocess.Popen(call, cwd=folder, env=environment, stdout=output, stderr=output, process_group=0)
        try:
            status: int | str = process.wait(limit)
        except subprocess.TimeoutExpired:
            status = f"no end in {limit:g} s"
        end = time.monotonic() + grace
        while (left := alive(process.pid)) and isinstance(status, int) and time.monotonic() < end:
            time.sleep(0.1)
        for child in left:
            child.kill()
        process.wait()
        output.seek(0)
        return status, output.read().decode(errors="replace"), bool(left)


def alive(group: int) -> list[psutil.Process]:
    """The processes of a group that have not ended."""
    found = []
    for process in psutil.process_iter():
        with suppress(OSError, psutil.NoSuchProcess):
            if os.getpgid(process.pid) == group and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
    return found


def test_a_block_that_leaves_a_process_running_is_found(folder: Path) -> None:
    status, said, left = called(["bash", "-c", "sleep 60 & echo begun"], folder, dict(os.environ), grace=0.2)
    assert (status, said, left) == (0, "begun\n", True)
    status, said, left = called(["bash", "-c", "echo begun; sleep 60"], folder, dict(os.environ), limit=1.0)
    assert (status, said, left) == ("no end in 1 s", "begun\n", True)


def test_every_place_that_a_page_names_exists() -> None:
    # The rooms of the package also have links at the top level, which a clone may lack.
    named = re.compile(r"`((?:analysis|drivers|rig|tests|bench|docs|fixtures_data)/[\w./-]*)`")
    missing = {
        f"{page.name}: {place}"
        for page in [*DOCS.glob("*.md"), ROOT / "README.md"]
        for place in named.findall(page.read_text(encoding="utf-8"))
        if not any((start / place).exists() for start in (ROOT, ROOT / "isorig"))
    }
    assert not missing


def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    call = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(call, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=200, check=False)
    assert done.returncode == 0, done.stderr
    assert 'id="isorig.diagnose"' in (tmp_path / "site" / "api.html").read_text(encoding="utf-8")
