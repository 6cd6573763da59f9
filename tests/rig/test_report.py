"""The report page in a real browser: every chart drawn, nothing in the console, nothing wider than the window."""

import doctest
import json
import re
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import msgspec
import numpy as np
import pytest
from headless_page import CHROMIUM, told_by

from isorig.analysis.diagnose.misfit import Discrepancy
from isorig.analysis.model.rig_model import Configuration
from isorig.analysis.parameters.joint_fit import Characterization
from isorig.analysis.spectra.quality import Fault, fault_sentences
from isorig.rig.files.parameter_table import ParameterFile, characterize_campaign
from isorig.rig.report import sections
from isorig.rig.report.charts import MOST_POINTS, SERIES, Chart, ChartTrace, Panel, spread_over
from isorig.rig.report.first import _model
from isorig.rig.report.frequency import frequency_sections
from isorig.rig.report.measurement import measurement_page
from isorig.rig.report.page import Report, Section, Table, build_report, wrapping
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.session import SESSION, virtual_campaign

#: Put after the page's own script: zooms the first chart, changes the theme, and tells the page around it what came of it.
PROBE = """<script>
for (const folded of document.querySelectorAll("details")) folded.open = true;
addEventListener("load", () => setTimeout(async () => {
  const root = document.documentElement;
  const later = () => new Promise((resolve) => setTimeout(resolve, 500));
  const zoom = (name) => document.getElementById(name).layout.xaxis.range;
  const drawn = [...document.querySelectorAll(".chart")].map((chart) => chart.querySelectorAll(".main-svg path").length > 0);
  const sizes = [...document.querySelectorAll("p, td, figcaption, .legendtext, .ytick text")].map(
    (node) => parseFloat(getComputedStyle(node).fontSize));
  const told = { inner: innerWidth, wide: root.scrollWidth, counted: root.dataset.drawn, drawn, letters: Math.min(...sizes),
    offered: document.querySelectorAll("figcaption button").length,
    bars: [...document.querySelectorAll(".chart.bars")].map((chart) => [chart.querySelectorAll(".ytick").length,
      chart.data[0].y.length * 1]),
    cut: [...document.querySelectorAll(".chart text")].filter((text) => {
      const own = text.getBoundingClientRect(), chart = text.closest(".chart").getBoundingClientRect();
      return own.width && (own.left < chart.left - 1 || own.right > chart.right + 1 || own.bottom > chart.bottom + 1);
    }).map((text) => text.textContent) };
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


def example() -> Report:
    f = np.geomspace(0.5, 400.0, 800)
    size = np.abs(1.0 / (1.0 - (f / 11.0) ** 2 + 0.05j * f / 11.0))
    traces = [
        *(ChartTrace(name=f"run {role}", x=f, y=size * (k + 1), spread=0.1 * size, role=role) for k, role in enumerate(SERIES)),
        ChartTrace(name="coherence", x=f, y=np.clip(1.0 - 0.1 / size, 0.0, 1.0), panel=1, style="dash"),
    ]
    panels = [Panel(label="|H|", log=True, height=2.0), Panel(label="coherence", ends=(0.0, 1.0))]
    charts = [Chart(name=name, caption="A resonance.", panels=panels, traces=traces, link="frequency") for name in ("one", "two")]
    bars = ChartTrace(name="error", x=["u70 motor", "u70 table"], y=np.array([0.1, 0.2]), style="bars", role="simulated")
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
    charts = page.count('class="chart')
    assert charts >= 3
    told = told_by(page, PROBE, width, tmp_path)
    assert told["inner"] == width
    assert told["wide"] <= width
    assert told["counted"] == str(charts)
    assert told["drawn"] == [True] * charts
    # No word of a chart is cut at its edge, and every bar has its label.
    assert told["cut"] == []
    assert all(shown == wanted for shown, wanted in told["bars"])
    assert told["bars"]
    assert told["followed"] == told["kept"] == [0, 1]
    assert told["theme"] == "dark"
    assert told["letters"] >= 10.0
    assert told["offered"] == 3 * charts
    assert min(told["pictures"]) > 5000


def test_measurement_says_all_that_a_reader_needs(measured: str) -> None:
    assert len(measured.encode()) < 3_000_000
    heads = re.findall(r"<h2>(.*?)</h2>", measured)
    assert heads == [
        "Does the isolation work?", "What is wrong with the model?", "What next?", "What was measured",
        "Rig and runs", "Transfer functions", "Parameters", "Parameters compared with earlier campaigns",
        "Simulation compared with measurement",
        "Isolation ratio", "What the simulation gets wrong", "Further advice for the next measurement",
        "Source of the numbers",
    ]  # fmt: skip
    assert "Motor frequency has changed by" in measured
    columns = re.findall(r"<th scope=\"col\">((?:first|later).*?)</th>", measured)
    assert columns == ["first, 2011-05-01", "later, 2011-06-01"]
    assert "sha256" in measured
    assert "stuck 100 % of the time and the rig behaves like a locked one" in measured
    assert "Only one gain excites the heatblock" in measured


def test_first_screen_answers_with_a_number_against_the_wish(measured: str) -> None:
    first = measured[: measured.index("<main>")]
    short = re.findall(r'short-answer">(.*?)</p>', first)
    assert re.fullmatch(r"No: \d+ % isolated, 98 % required", short[0])
    assert short[1] == "Only single bands differ", "the list below has some"
    isolated = int(re.findall(r"\d+", short[0])[0])
    low, high = (int(value) for value in re.findall(r"interval (-?\d+) % to (\d+) %", first)[0])
    assert low <= isolated <= high
    assert "gives no requirement" in first
    # The sketch has every body and sensor, the table every channel with what it is and how far it reaches.
    drawing = re.findall(r"<svg.*?</svg>", first, flags=re.DOTALL)[0]
    assert all(name in drawing for name in ("table, 80 kg", "heatblock, 6 kg", "motor, 16.4 kg", "friction", "drive: head"))
    assert first.count("virtual accelerometer") == 4
    assert first.count("±50\u00a0m/s²") == 4
    assert "A virtual rig without real sensors." in first
    assert first.count('class="chart') == 1


def test_a_wish_and_a_calibration_that_are_stated_are_used() -> None:
    takes = [replace(take, seconds=10.0) for take in SESSION if take.id in ("u70a", "l70")]
    campaign = virtual_campaign(wire_bonder(), takes, seed=4)
    stated = replace(campaign, known={**campaign.known, "wished_isolation": 0.3, "calibration_std": 0.01})
    page = measurement_page(stated, characterize_campaign(stated, lambda text: None))
    assert re.search(r"Yes: \d+ % isolated, 30 % required", page)
    assert "The recording gives the requirement." in page
    assert "noise alone)" not in page
    bare = measurement_page(campaign, characterize_campaign(campaign, lambda text: None))
    assert "gives no uncertainty of its sensors" in bare
    assert "std (noise alone)" in bare


def test_known_and_found_do_not_contradict_without_a_word(measured: str) -> None:
    assert "The table mass was given as 250 kg and the fit gives 80 kg: only part of the mass" in measured


def test_no_sentence_is_repeated(measured: str) -> None:
    text = re.sub(r"<(script|style).*?</\1>", "", measured, flags=re.DOTALL)
    found = re.findall(r"<(?:p|figcaption)[^>]*>(.*?)</(?:p|figcaption)>", text, flags=re.DOTALL)
    sentences = [s.strip() for paragraph in found for s in re.split(r"(?<=[.;])\s", paragraph) if len(s.strip()) > 25]
    assert len(sentences) > 20
    assert [s for s in set(sentences) if sentences.count(s) > 1] == []


def test_axes_have_units_and_phase_is_shown_with_magnitude(measured: str) -> None:
    charts = json.loads(re.findall(r'<script id="data" type="application/json">(.*?)</script>', measured, flags=re.DOTALL)[0])
    for chart in charts:
        labels = [panel["label"] for panel in chart["panels"]]
        if chart["name"].startswith("frf-"):
            assert ["per" in label or "phase, °" in label or label == "coherence" for label in labels] == [True] * 3
            # Locked curves are drawn last and dashed, so that none lies hidden under an unlocked one.
            last = [t for t in chart["traces"] if t["panel"] == 0 and t["name"].startswith("locked")]
            assert all(t["style"] == "dash" for t in last)
            order = [t["name"].split(",")[0] for t in chart["traces"] if t["panel"] == 0 and t["name"] != "simulated"]
            assert order == sorted(order, reverse=True)
        if chart["name"].startswith(("time-", "misfit-")):
            assert all("m/s²" in label for label in labels)


def test_another_rig_gets_its_transfer_functions_and_no_isolation_ratio() -> None:
    rig = msgspec.structs.replace(wire_bonder(), configurations={"unlocked": Configuration()})
    campaign = virtual_campaign(wire_bonder(), [replace(SESSION[0], seconds=8.0)], seed=4)
    assert [section.title for section in frequency_sections(campaign, rig)] == ["Transfer functions"]


def test_page_needs_no_other_file() -> None:
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


def test_a_fault_of_several_runs_is_stated_once() -> None:
    def fault(run: str, name: str) -> Fault:
        return Fault(run=run, channel=name, kind="dead", text=f"run {run!r}: {name} is dead; check it.")

    assert fault_sentences([fault("a", "x"), fault("b", "x"), fault("a", "y"), fault("c", "x")]) == [
        "Run 'a': x is dead; check it. The same applies to runs 'b' and 'c'.",
        "Run 'a': y is dead; check it.",
    ]
    assert fault_sentences([fault("a", "x"), fault("b", "x")]) == ["Run 'a': x is dead; check it. The same applies to run 'b'."]


@pytest.mark.parametrize(
    ("text", "html"),
    [
        ("links.flexure.laws.0.stroke", "links.<wbr>flexure.<wbr>laws.<wbr>0.<wbr>stroke"),
        ("2.99994 ± 0.00017 kN/m", '<span class="whole">2.99994 ± 0.00017</span> kN/m'),
        ("2026-06-15 to 2026-06-22", '<span class="whole">2026-06-15</span> to <span class="whole">2026-06-22</span>'),
        ("isolation -16 ± 1 %, <b>", 'isolation <span class="whole">-16 ± 1 %</span>, &lt;b&gt;'),
        ("0.5", "0.5"),
        ("a.<b>", "a.&lt;b&gt;"),
    ],
)
def test_cells_wrap_within_paths_but_not_within_values(text: str, html: str) -> None:
    assert wrapping(text) == html


def test_bands_that_differ_are_not_called_no_discrepancy() -> None:
    """The first screen and the list below it agree."""
    found = cast(Characterization, SimpleNamespace(adequate=True, error=0.01, noise_alone="0.9 %"))
    band = Discrepancy(
        channel="table",
        configuration="unlocked",
        gain=70.0,
        run="a",
        band_hz=(4.0, 5.0),
        what="band",
        size=0.02,
        noise=0.01,
        text="",
    )
    none, one = _model(found, None, []), _model(found, None, [band])
    assert (none.short, one.short) == ("No discrepancy found", "Only single bands differ")
    assert "(1) are listed below" in one.text[0]


def test_numbers_of_tables() -> None:
    assert doctest.testmod(sections).failed == 0
