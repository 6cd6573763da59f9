"""The report page in a real browser: every chart drawn, nothing in the console, nothing wider than the window."""

import html
import json
import re
import shutil
import subprocess
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import msgspec
import numpy as np
import pytest

from analysis.model import Configuration
from analysis.rigs import THESIS, wire_bonder
from rig.characterized import ParameterFile, characterize_campaign
from rig.report.charts import MOST_POINTS, SERIES, Chart, Panel, Trace, spread_over
from rig.report.frequency import frequency_sections
from rig.report.measurement import measurement_page
from rig.report.page import Report, Section, Table, build_report
from rig.virtual import SESSION, virtual_campaign

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--virtual-time-budget=20000", "--enable-logging=stderr", "--dump-dom",
)  # fmt: skip
#: Put after the page's own script: zooms the first chart, changes the theme, and tells the page around it what came of it.
PROBE = """<script>
addEventListener("load", () => setTimeout(async () => {
  const root = document.documentElement;
  const later = () => new Promise((resolve) => setTimeout(resolve, 500));
  const zoom = (name) => document.getElementById(name).layout.xaxis.range;
  const drawn = [...document.querySelectorAll(".chart")].map((chart) => chart.querySelectorAll(".main-svg path").length > 0);
  const sizes = [...document.querySelectorAll("p, td, figcaption, .legendtext, .ytick text")].map(
    (node) => parseFloat(getComputedStyle(node).fontSize));
  const told = { inner: innerWidth, wide: root.scrollWidth, counted: root.dataset.drawn, drawn, letters: Math.min(...sizes),
    offered: document.querySelectorAll("figcaption button").length };
  await Plotly.relayout("chart0", { "xaxis.range": [0, 1] });
  await later();
  told.followed = zoom("chart1");
  told.pictures = (await Promise.all(["svg", "png"].map((format) => Plotly.toImage("chart0", { format })))).map((p) => p.length);
  document.getElementById("theme").click();
  await later();
  told.kept = zoom("chart0");
  told.theme = root.dataset.theme;
  parent.postMessage(JSON.stringify(told), "*");
}, 1500));
</script>"""
#: A browser's window has a least width; a frame has none.
FRAME = """<!doctype html><link rel="icon" href="data:,"><iframe src="report.html" style="width:{width}px;height:2000px;border:0">
</iframe><pre></pre><script>onmessage = (event) => {{ document.querySelector("pre").textContent = event.data; }};</script>"""


def example() -> Report:
    f = np.geomspace(0.5, 400.0, 800)
    size = np.abs(1.0 / (1.0 - (f / 11.0) ** 2 + 0.05j * f / 11.0))
    traces = [
        *(Trace(name=f"run {role}", x=f, y=size * (k + 1), spread=0.1 * size, role=role) for k, role in enumerate(SERIES)),
        Trace(name="coherence", x=f, y=np.clip(1.0 - 0.1 / size, 0.0, 1.0), panel=1, style="dash"),
    ]
    panels = [Panel(label="|H|", log=True, height=2.0), Panel(label="coherence", ends=(0.0, 1.0))]
    charts = [Chart(name=name, caption="A resonance.", panels=panels, traces=traces, link="frequency") for name in ("one", "two")]
    bars = Trace(name="error", x=["u70 motor", "u70 table"], y=np.array([0.1, 0.2]), style="bars", role="simulated")
    charts.append(Chart(name="bars", caption="Errors.", panels=[Panel(label="")], traces=[bars], x_label="error", x_log=False))
    table = Table(columns=[f"a rather long column {k}" for k in range(9)], rows=[["1.2345678"] * 9] * 3)
    return Report(
        title="campaign-with-a-very-long-name-that-does-not-fit.h5 </script><script>alert(1)</script>",
        verdict="Adequate.", summary=["One sentence."],
        sections=[Section(title="Charts </script>", charts=charts), Section(title="Tables", tables=[table])],
    )  # fmt: skip


@pytest.fixture(scope="module")
def measured() -> str:
    """The page of a short virtual campaign, its parameters beside two earlier ones."""
    takes = [replace(take, seconds=12.0) for take in SESSION if take.id in ("u70a", "u7", "l70", "l7")]
    campaign = virtual_campaign(wire_bonder(), takes, seed=4)
    found = characterize_campaign(campaign, lambda text: None)
    moved = {**THESIS, "motor_frequency": 5.3}
    history = [
        ParameterFile(
            campaign="later", measured=datetime(2011, 6, 1, tzinfo=UTC), values={k: (v, 0.01) for k, v in moved.items()}
        ),
        ParameterFile(campaign="first", measured=datetime(2011, 5, 1, tzinfo=UTC), values={"motor_frequency": (5.4, 0.01)}),
    ]
    return measurement_page(campaign, found, history)


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine: install Debian's package to run this test")
@pytest.mark.parametrize("width", [1280, 400])
@pytest.mark.parametrize("kind", ["example", "measured"])
def test_page_in_a_browser(tmp_path: Path, width: int, kind: str, request: pytest.FixtureRequest) -> None:
    page = build_report(example()) if kind == "example" else request.getfixturevalue("measured")
    charts = page.count('class="chart"')
    assert charts >= 3
    (tmp_path / "report.html").write_text(page.replace("</body>", PROBE + "</body>"), encoding="utf-8")
    (tmp_path / "frame.html").write_text(FRAME.format(width=width), encoding="utf-8")
    done = subprocess.run(
        [str(CHROMIUM), *FLAGS, f"--user-data-dir={tmp_path / 'profile'}", (tmp_path / "frame.html").as_uri()],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert [line for line in done.stderr.splitlines() if "CONSOLE" in line] == []
    told = json.loads(html.unescape(re.findall(r"<pre>(.*?)</pre>", done.stdout)[0]))
    assert told["inner"] == width
    assert told["wide"] <= width
    assert told["counted"] == str(charts)
    assert told["drawn"] == [True] * charts
    assert told["followed"] == told["kept"] == [0, 1]
    assert told["theme"] == "dark"
    assert told["letters"] >= 10.0
    assert told["offered"] == 3 * charts
    assert min(told["pictures"]) > 5000


def test_measurement_says_all_that_a_reader_needs(measured: str) -> None:
    assert len(measured.encode()) < 3_000_000
    heads = re.findall(r"<h2>(.*?)</h2>", measured)
    assert heads == [
        "Rig and runs", "Transfer functions", "Parameters", "Parameters beside their history", "Simulated over measured",
        "Isolation ratio", "What the simulation gets wrong", "Advice for the next measurement", "Where the numbers came from",
    ]  # fmt: skip
    assert "Motor frequency has changed by" in measured
    columns = re.findall(r"<th scope=\"col\">((?:first|later).*?)</th>", measured)
    assert columns == ["first, 2011-05-01", "later, 2011-06-01"]
    assert "sha256" in measured
    assert "stuck 100 % of the time and the rig measures like a locked one" in measured
    assert "Only one gain reaches the heatblock" in measured


def test_another_rig_gets_its_transfer_functions_and_no_isolation_ratio() -> None:
    rig = msgspec.structs.replace(wire_bonder(), configurations={"unlocked": Configuration()})
    campaign = virtual_campaign(wire_bonder(), [replace(SESSION[0], seconds=8.0)], seed=4)
    assert [section.title for section in frequency_sections(campaign, rig)] == ["Transfer functions"]


def test_page_stands_alone() -> None:
    page = build_report(example())
    assert len(page.encode()) < 3_000_000
    assert "<script>alert(1)" not in page
    own = re.sub(r"<script>/\*\*.*?</script>", "", page, flags=re.DOTALL)
    assert not re.findall(r'(?:src|href)="(?!#|data:)', own)


def test_spread_over_keeps_ends_and_order() -> None:
    f = np.arange(1, 20001) * 0.05
    kept = f[spread_over(f)]
    assert len(kept) <= MOST_POINTS
    assert kept[0] == f[0]
    assert kept[-1] == f[-1]
    assert np.all(np.diff(kept) > 0)
