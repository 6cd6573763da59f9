"""The fleet's page in a real browser: rigs at a glance, a page a rig, charts drawn when they are opened."""

from __future__ import annotations

import doctest
import re
from pathlib import Path

import numpy as np
import pytest
from headless_page import CHROMIUM, told_by
from made_up import FRICTION, SPRING, Shift, drawn_fleet, write_catalogue

from isorig.rig.cli import main
from isorig.rig.fleet import report
from isorig.rig.fleet.catalogue import Catalogue
from isorig.rig.fleet.change_causes import name_of
from isorig.rig.fleet.history import followed
from isorig.rig.fleet.report import fleet_page
from isorig.rig.report.page import MOST, Sparkline

PROBE = """<script>
addEventListener("load", () => setTimeout(async () => {
  const root = document.documentElement;
  const later = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
  const seen = (node) => node.offsetParent !== null;
  const all = (what) => [...document.querySelectorAll(what)];
  const size = (node) => parseFloat(getComputedStyle(node).fontSize);
  const letters = () => Math.min(...all("p, td, th, figcaption, .legendtext, .ytick text").filter(seen).map(size));
  const told = { inner: innerWidth, wide: root.scrollWidth, drawn: root.dataset.drawn, letters: letters(),
    rows: all(".sparks tbody tr").length, sparks: all(".spark").length, first: all(".sparks td a")[0].textContent };
  document.querySelector(".sparks td a").click();
  await later(1500);
  const page = document.querySelector(".page:target");
  told.page = { title: page.querySelector("h1").textContent, wide: root.scrollWidth, front: seen(all("main .front")[0]),
    drawn: root.dataset.drawn, paths: page.querySelectorAll(".main-svg path").length, letters: letters(), top: scrollY,
    shaded: page.querySelectorAll(".shapelayer path").length, dates: page.querySelector(".xtick text").textContent };
  document.getElementById("theme").click();
  await later(500);
  told.theme = root.dataset.theme;
  page.querySelector("a").click();
  await later(300);
  told.back = seen(all("main .front")[0]);
  parent.postMessage(JSON.stringify(told), "*");
}, 1500));
</script>"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Fifty rigs, one of which has lost friction; the cause was looked for."""
    folder = tmp_path_factory.mktemp("fleet")
    shifts = [Shift(rig=7, first=24, by={FRICTION: -6.0}), Shift(rig=9, first=10, by={SPRING: -0.5}, drift=True)]
    frame = drawn_fleet(2, campaigns=30, shifts=shifts)
    frame.loc[frame.rig == "rig-007", "rig"] = "</script><b>rig"
    write_catalogue(folder, frame)
    fleet = followed(frame, "coulomb")
    incident = next(i for i in fleet.incidents if i.rig.endswith("rig"))
    common = {"rig": incident.rig, "before": "a", "after": "b", "version": "1", "baseline": "coulomb", "unit": "N"}
    Catalogue(folder).put_change(
        name_of(fleet, incident),
        [
            {**common, "rank": 0, "cause": "friction_force", "location": "isolation", "parameter": FRICTION, "old": 10.0,
             "new": 8.4, "std": 0.1, "share": 1.0, "alike": True},
            {**common, "rank": 1, "cause": "sensor_gain", "location": "motor", "parameter": "factor", "old": np.nan, "new": 1.02,
             "std": 0.1, "share": 0.4, "alike": False, "unit": "1"},
        ],
    )  # fmt: skip
    assert main(["fleet", "report", "-c", str(folder), "-o", str(folder / "fleet.html")]) == 0
    return (folder / "fleet.html").read_text(encoding="utf-8")


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine: install Debian's package to run this test")
@pytest.mark.parametrize("width", [1280, 400])
def test_page_in_a_browser(page: str, width: int, tmp_path: Path) -> None:
    told = told_by(page, PROBE, width, tmp_path)
    assert told["inner"] == width
    assert told["wide"] <= width
    assert told["drawn"] == "0"  # charts wait for their page
    assert (told["rows"], told["sparks"]) == (50, 400)
    assert told["first"] == "</script><b>rig"
    rig = told["page"]
    assert rig["title"] == "</script><b>rig"
    assert rig["wide"] <= width
    assert (rig["front"], rig["drawn"], rig["top"]) == (False, "1", 0)
    assert rig["paths"] > 100
    assert rig["shaded"] >= 1
    assert "2026" in rig["dates"]
    assert min(told["letters"], rig["letters"]) >= 10.0
    assert (told["theme"], told["back"]) == ("dark", True)


def test_page_says_what_changed_when_by_how_much_and_why(page: str) -> None:
    assert "rig last (2026-06-15 to 2026-06-22)" in page
    assert "friction force of isolation from 10 N to 8.4 N" in page
    assert "sensor gain at motor, factor 1.02" in page
    assert "No coinciding event is known." in page
    assert "not searched for" in page
    assert len(re.findall(r'<article class="page"', page)) == 50
    own = re.sub(r"<script>/\*\*.*?</script>", "", page, flags=re.DOTALL)
    assert not re.findall(r'(?:src|href)="(?!#|data:)', own)
    assert "<b>rig" not in re.sub(r"&lt;.*?&gt;", "", own.split('<script id="data"')[0])


def test_sparklines_stay_small() -> None:
    many = Sparkline(values=np.arange(500.0), description="rising", marked=[3, 499])
    assert len(many.places) == MOST
    assert len(many.dots) == 1
    assert Sparkline(values=np.array([2.0]), description="one", marked=[0]).places == [(32.0, 10.0)]
    assert {y for _, y in Sparkline(values=np.full(5, 1.0), description="level").places} == {10.0}


def test_a_cause_that_the_diagnosis_names_is_the_cause_of_the_change(tmp_path: Path) -> None:
    frame = drawn_fleet(3, campaigns=12, shifts=[])
    named = (frame.rig == "rig-004") & (frame.campaign >= "week-008")
    frame.loc[named, ["verdict", "cause"]] = ["explained", "end_stop at isolation"]
    write_catalogue(tmp_path, frame)
    assert main(["fleet", "report", "-c", str(tmp_path), "-o", str(tmp_path / "fleet.html")]) == 0
    page = (tmp_path / "fleet.html").read_text(encoding="utf-8")
    row = next(row for row in re.findall(r"<tr>(.*?)</tr>", page, re.DOTALL) if "rig-004" in row and "end stop" in row)
    cells = re.findall(r"<td[^>]*>(.*?)</td>", row, re.DOTALL)
    assert (cells[2], cells[3]) == ("verdict", "end stop at isolation")
    assert page.count("The cause that the diagnosis names is the cause of this change.") == 1


@pytest.mark.parametrize(("rigs", "said"), [(50, "at most 1 a month"), (3, "at most one in 16 months")])
def test_the_rate_of_false_alarms_is_stated(rigs: int, said: str) -> None:
    assert said in fleet_page(followed(drawn_fleet(3, rigs=rigs, campaigns=12), "coulomb"), {})


def test_an_uncertainty_above_its_value_is_no_number() -> None:
    assert doctest.testmod(report).failed == 0
    frame = drawn_fleet(2, campaigns=4)
    frame.loc[frame.parameter == SPRING, "std"] = frame.value * 1e8
    assert re.search(r"not identifiable", fleet_page(followed(frame, "coulomb"), {}))
