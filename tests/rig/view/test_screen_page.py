"""The page in a real browser: what it draws, what its buttons do, and that it stands alone, light, dark and narrow."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from plans import plan_text
from screen_browser import Page, browser, needs_browser

from isorig.rig.acquire.notes import notes_in
from isorig.rig.files.recording import read, write
from isorig.rig.wire_bonder.description import wire_bonder
from isorig.rig.wire_bonder.session import SESSION, virtual_campaign

pytestmark = needs_browser
RIG = (sys.executable, "-m", "isorig")
RUN = {"excitation": "random", "band": [0.5, 20.0]}
PLAN = plan_text(
    {"id": "u70", **RUN, "seconds": 90.0}, {"id": "l70", **RUN, "configuration": "locked", "seconds": 8.0}, sensitivity=0.2
)
#: Pixels of a plot's own colour, so that a canvas that only holds axes counts nothing.
INKED = """(() => [...document.querySelectorAll("canvas")].map((canvas) => {
  const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  let count = 0;
  for (let k = 0; k < data.length; k += 4) {
    const spread = Math.max(data[k], data[k + 1], data[k + 2]) - Math.min(data[k], data[k + 1], data[k + 2]);
    if (data[k + 3] > 200 && spread > 40) count += 1;
  }
  return count;
}))()"""
PHASE = "document.querySelector('#phase').textContent"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """One browser for all tests of this file."""
    with browser(tmp_path_factory.mktemp("browser")) as opened:
        yield opened


@pytest.fixture(autouse=True)
def clean(page: Page) -> Iterator[None]:
    """No errors, and nothing asked of anybody but the screen."""
    page.errors.clear()
    page.asked.clear()
    yield
    assert page.errors == []
    assert {urlsplit(address).hostname for address in page.asked} <= {"127.0.0.1"}


@contextmanager
def begun(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A process of `rig`, killed at the end."""
    pipe = subprocess.PIPE
    with subprocess.Popen([*RIG, *arguments], stdin=pipe, stdout=pipe, stderr=pipe, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def line(process: subprocess.Popen[str]) -> str:
    """The next line of its standard output."""
    assert process.stdout is not None
    return process.stdout.readline().strip()


def recording(folder: Path) -> str:
    takes = [replace(take, seconds=8.0) for take in SESSION if take.id in ("u70a", "u7", "l70", "l7")]
    write(folder / "lab.h5", virtual_campaign(wire_bonder(), takes, seed=4))
    return str(folder / "lab.h5")


@pytest.mark.parametrize(("width", "dark"), [(1280, False), (1280, True), (400, False), (400, True)])
def test_a_finished_recording_is_drawn(tmp_path: Path, page: Page, width: int, dark: bool) -> None:
    with begun("view", recording(tmp_path)) as process:
        address = line(process)
        page.open(address, width=width, dark=dark)
        page.until("document.querySelectorAll('canvas').length === 8 && document.querySelectorAll('#runs tr').length === 4")
        page.until(f"Math.min(...{INKED}) > 100")
        assert page.tell("document.documentElement.scrollWidth") == width
        nodes = "[...document.querySelectorAll('p, li, td, th, span, button')]"
        assert page.tell(f"Math.min(...{nodes}.map((node) => parseFloat(getComputedStyle(node).fontSize)))") >= 11.0
        ground = [int(part) for part in re.findall(r"\d+", page.tell("getComputedStyle(document.body).backgroundColor"))]
        assert (max(ground) < 60) == dark
        assert "Provisional, 4 runs checked" in page.tell("document.querySelector('#verdict').textContent")
        assert page.tell("document.querySelector('#actions').hidden") is True
        # The other theme draws the same plots anew.
        page.click("#theme")
        page.until(f"document.querySelectorAll('canvas').length === 8 && Math.min(...{INKED}) > 100")
        turned = [int(part) for part in re.findall(r"\d+", page.tell("getComputedStyle(document.body).backgroundColor"))]
        assert (max(turned) < 60) != dark


def test_a_replay_that_no_browser_shows_says_so(tmp_path: Path) -> None:
    with begun("view", recording(tmp_path), "--replay", "--speed", "8", "--seconds", "1") as process:
        _, said = process.communicate(timeout=60.0)
        assert said == "no browser had the page open\n"


def test_a_replay_counts_what_it_draws(tmp_path: Path, page: Page) -> None:
    with begun("view", recording(tmp_path), "--replay", "--speed", "8", "--seconds", "8") as process:
        address = line(process)
        page.open(address)
        page.until(f"{PHASE} === 'replay, measuring'")
        early = page.tell("document.querySelector('#run').textContent")
        assert early.startswith("Run 1 of 4: u70a, unlocked, gain 70")
        page.until(f"{PHASE} === 'replay, ended'")
        frames, values = (int(page.tell(f"document.documentElement.dataset.{name}")) for name in ("frames", "values"))
        _, said = process.communicate(timeout=30.0)
        told = re.fullmatch(r"(\d+) frames with (\d+) values were drawn\n", said)
        assert told is not None, said
        # Five frames a second at most, most of them with the traces of four channels of up to 500 points.
        assert 10 <= frames <= int(told[1]) <= 50
        assert 5000 <= values <= int(told[2])
        page.until(f"{PHASE} === 'ended'")


def stopped(page: Page) -> None:
    page.click("#stop")
    page.until(f"{PHASE} === 'waiting for you' && document.querySelector('#runs').textContent.includes('stopped')")
    assert page.tell("document.querySelector('#again').textContent") == "Repeat u70"


def test_a_session_is_seen_and_acted_on(tmp_path: Path, page: Page) -> None:
    (tmp_path / "plan.toml").write_text(PLAN)
    plan, output = str(tmp_path / "plan.toml"), tmp_path / "lab.h5"
    with (
        begun("virtual", "instrument", "--speed", "3", "--seconds", "100") as far_end,
        begun("acquire", plan, "--port", line(far_end), "-o", str(output), "--view", "--json") as session,
    ):
        told = json.loads(line(session))
        assert told["event"] == "view"
        page.open(told["address"])
        page.until(f"{PHASE} === 'waiting for you'")
        assert page.tell("document.querySelector('#next').textContent") == "Start u70"
        page.click("#next")
        page.until(f"{PHASE} === 'measuring' && Number(document.documentElement.dataset.values) > 5000")
        page.until("document.querySelector('#averaged').textContent.includes(' at the end')")
        page.tell("document.querySelector('#words').value = 'a lorry went by <b>'")
        page.click("#note button")
        page.until("document.querySelector('#notes').textContent.includes('u70: a lorry went by <b>')")
        stopped(page)
        page.click("#again")
        page.until(f"{PHASE} === 'measuring' && document.querySelector('#part').value > 0.05")
        stopped(page)
        assert page.tell("document.querySelector('#next').textContent") == "Start l70"
        page.click("#next")
        page.until("document.querySelector('#next').textContent === 'Finish the session'", 60.0)
        page.until(f"document.querySelectorAll('canvas').length === 8 && Math.min(...{INKED}) > 100")
        assert "gain 70" in page.tell("document.querySelector('#isolated').textContent")
        page.click("#next")
        page.until(f"{PHASE} === 'ended'")
        lines, said = session.communicate(timeout=60.0)
    assert session.returncode == 0, said
    assert [json.loads(text)["id"] for text in lines.splitlines() if '"taken"' in text] == ["u70", "u70", "l70"]
    lengths = {run.id: len(run) for run in read(output).runs}
    assert lengths["l70"] == 8 * 1024
    assert 0 < lengths["u70"] < 90 * 1024
    assert [note.text for note in notes_in(output)] == ["a lorry went by <b>"]
    assert sorted(path.name for path in tmp_path.glob("lab*")) == ["lab.h5"]
