"""The report page in a real browser: every chart drawn, nothing in the console, nothing wider than the window."""

import html
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from rig.report.charts import MOST_POINTS, SERIES, Chart, Panel, Trace, spread_over
from rig.report.page import Report, Section, Table, build_report

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
  const told = { inner: innerWidth, wide: root.scrollWidth, counted: root.dataset.drawn, drawn };
  await Plotly.relayout("chart0", { "xaxis.range": [0, 1] });
  await later();
  told.followed = zoom("chart1");
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


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine: install Debian's package to run this test")
@pytest.mark.parametrize("width", [1280, 400])
def test_page_in_a_browser(tmp_path: Path, width: int) -> None:
    page = build_report(example()).replace("</body>", PROBE + "</body>")
    (tmp_path / "report.html").write_text(page, encoding="utf-8")
    (tmp_path / "frame.html").write_text(FRAME.format(width=width), encoding="utf-8")
    done = subprocess.run(
        [str(CHROMIUM), *FLAGS, f"--user-data-dir={tmp_path / 'profile'}", (tmp_path / "frame.html").as_uri()],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert [line for line in done.stderr.splitlines() if "CONSOLE" in line] == []
    told = json.loads(html.unescape(re.findall(r"<pre>(.*?)</pre>", done.stdout)[0]))
    assert told["inner"] == width
    assert told["wide"] <= width
    assert told["counted"] == "3"
    assert told["drawn"] == [True] * 3
    assert told["followed"] == told["kept"] == [0, 1]
    assert told["theme"] == "dark"


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
