"""The page of a real diagnosis: the answer first, the place marked, its force as the hidden law says, the rest folded."""

from __future__ import annotations

import base64
import json
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from headless_page import CHROMIUM, told_by
from small_rigs import HARDENING

from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.diagnose.step import Curve
from isorig.analysis.equations.system import equations_of
from isorig.analysis.laws import Coulomb
from isorig.analysis.model.rig_model import Body, Contact, Drive, Link, RigModel, Sensor
from isorig.rig.files.rigfile import read_rig
from isorig.rig.report.diagnosis import curve_chart
from isorig.rig.report.misfit import BASELINE, EXTENDED, HeldOutRecord, residual_chart, second_chart, worst_of
from isorig.rig.report.page import First, Report, Section, build_report
from isorig.rig.report.place import Force, PlaceForce, equation_force, force_chart, mean_over

#: Opens every folded section, then tells what is drawn and how wide it is.
PROBE = """<script>
addEventListener("load", () => setTimeout(async () => {
  const later = () => new Promise((resolve) => setTimeout(resolve, 900));
  const drawn = () => [...document.querySelectorAll(".chart")].filter((c) => c.querySelector(".main-svg path")).length;
  const told = { first: drawn(), high: document.querySelector("main").getBoundingClientRect().top };
  for (const folded of document.querySelectorAll("details")) folded.open = true;
  await later();
  Object.assign(told, { all: drawn(), charts: document.querySelectorAll(".chart").length,
    cut: [...document.querySelectorAll(".bartext")].filter((t) => {
      const inside = t.closest(".chart").getBoundingClientRect().right;
      return t.getBoundingClientRect().right > inside + 1; }).map((t) => t.textContent),
    plots: [...document.querySelectorAll(".chart")].map((c) => c._fullLayout?._size.w / c.clientWidth),
    names: [...document.querySelectorAll(".chart .ytick text")].map((t) => {
      const own = t.getBoundingClientRect(), chart = t.closest(".chart").getBoundingClientRect();
      return { begin: own.left - chart.left, top: own.top, bottom: own.bottom, text: t.textContent }; }),
    bars: document.querySelectorAll(".bartext").length, inner: innerWidth, wide: document.documentElement.scrollWidth,
    peaks: [...document.querySelectorAll(".peaks")].map((p) => p.textContent) });
  parent.postMessage(JSON.stringify(told), "*");
}, 1500));
</script>"""

#: Friction of a rail, N.
LEVEL = 0.6


@pytest.fixture
def answered(hardened: Path) -> Path:
    """The folder of a diagnosis of two carts with a hidden hardening spring."""
    return hardened / "d"


def test_what_the_uncertainties_take_as_exact_is_said_once(answered: Path) -> None:
    remarks = json.loads((answered / "findings.json").read_text())["remarks"]
    (said,) = (remark for remark in remarks if remark.startswith("Uncertainties are given the described masses (the first): "))
    assert (answered / "report.html").read_text().count(said) == 1


def charts_of(page: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(
        re.findall(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)[0]
    )
    return found


def values(packed: dict[str, str]) -> FloatArray:
    return np.frombuffer(base64.b64decode(packed["bdata"]), dtype="<f4").astype(float)


def test_the_page_begins_with_the_answer_and_the_marked_place(answered: Path) -> None:
    page = (answered / "report.html").read_text()
    first = page[: page.index("<main>")]
    assert re.search(r'class="verdict">Explained: a hardening spring in the between, cubic stiffness \d', first)
    assert first.index('class="verdict"') < first.index("<svg") < first.index('class="chart')
    assert 'data-joint="links.between"' in first
    assert re.findall(r'data-joint="([^"]+)"[^>]*class="faulty"', first) == ["links.between"]
    assert [chart["name"].split("-")[0] for chart in charts_of(page)[:4]] == ["force", "equations", "second", "errors"]
    # The rest is folded behind headings.
    assert page.count("<details>") == page[page.index("<main>") :].count("<h2>")
    assert "<details open" not in page


def test_a_disturbance_counts_as_measured_if_a_drive_was_repeated(answered: Path) -> None:
    page = (answered / "report.html").read_text()
    (row,) = re.findall(r"disturbance</td><td[^>]*>([^<]*)", page)
    assert (row == "not measured") == ("not measured, because no drive was repeated" in page)


def test_the_force_of_the_place_is_the_hidden_law(answered: Path) -> None:
    force = charts_of((answered / "report.html").read_text())[0]
    assert force["x_label"] == "deflection, mm"
    assert force["panels"][0]["label"] == "force, N"
    curves = {trace["name"]: (values(trace["x"]), values(trace["y"])) for trace in force["traces"]}
    stiffness = read_rig("two-carts").model.link("between").stiffness

    def off(name: str) -> float:
        d, mean = curves[name]
        # The mean over a bin of a cubic differs from its value in the middle: the inner bins only.
        inner = slice(5, -5)
        law = stiffness * 1e-3 * d + HARDENING * (1e-3 * d) ** 3
        return float(np.sqrt(np.mean((mean - law)[inner] ** 2) / np.mean(law[inner] ** 2)))

    assert off("measured, mean") < 0.05
    assert off("extended model") < 0.05
    assert off("baseline") > 0.15


def test_the_second_shown_is_held_out_and_its_residual_is_the_difference(answered: Path) -> None:
    second = charts_of((answered / "report.html").read_text())[2]
    by = {(trace["name"], trace["panel"]): trace for trace in second["traces"]}
    assert all(panel["label"].endswith(", mm") for panel in second["panels"])
    measured, seconds = values(by["measured", 0]["y"]), values(by["measured", 0]["x"])
    assert seconds[0] >= 0.6 * 10.0 - 1e-3
    assert seconds[-1] - seconds[0] == pytest.approx(1.0, abs=0.01)
    for name in ("baseline", "extended model"):
        residual = values(by[name, 0]["y"]) - measured
        assert values(by[name, 1]["y"]) == pytest.approx(residual, abs=1e-5)
    assert np.std(values(by["extended model", 1]["y"])) < 0.05 * np.std(values(by["baseline", 1]["y"]))


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine: install Debian's package to run this test")
@pytest.mark.parametrize("width", [1280, 420])
def test_the_page_in_a_browser(answered: Path, tmp_path: Path, width: int) -> None:
    told = told_by((answered / "report.html").read_text(), PROBE, width, tmp_path)
    assert told["wide"] <= told["inner"] == width
    # Folded charts are drawn when they are opened.
    assert told["first"] == 4
    assert told["all"] == told["charts"] > 6
    assert told["peaks"]
    assert all(re.match(r"Largest in view: .*: \S+ \S+ per \S+ at \d+(\.\d+)? Hz", text) for text in told["peaks"])


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine: install Debian's package to run this test")
@pytest.mark.parametrize("width", [1280, 420])
def test_the_number_of_the_longest_bar_is_readable(tmp_path: Path, width: int) -> None:
    chart = residual_chart({"table": 0.18, "motor": 11234.0}, {"table": 0.44, "motor": 1.1})
    assert chart is not None
    first = First(sketch="", measured=Section(title="Runs"), pictures=(chart, chart))
    told = told_by(build_report(Report(title="t", verdict="v", summary=(), sections=(), first=first)), PROBE, width, tmp_path)
    assert (told["bars"], told["cut"]) == (8, [])


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine: install Debian's package to run this test")
@pytest.mark.parametrize("width", [1280, 420])
def test_long_names_of_bodies_leave_half_of_the_chart_to_its_bars(tmp_path: Path, width: int) -> None:
    plate, holder = "granite_base_plate_of_the_interferometer", "aluminium_sample_holder_with_cryostat"
    chart = residual_chart({plate: 0.18, f"{plate} + {holder}": 0.3, holder: 11.0, "Messtischfundamentplattendaempfer": 1.0})
    assert chart is not None
    first = First(sketch="", measured=Section(title="Runs"), pictures=(chart,))
    told = told_by(build_report(Report(title="t", verdict="v", summary=(), sections=(), first=first)), PROBE, width, tmp_path)
    assert min(told["plots"]) > 0.5
    names = told["names"]
    assert len(names) == 4
    assert all(name["begin"] >= 0.0 for name in names)
    assert all(one["bottom"] <= other["top"] for one, other in pairwise(sorted(names, key=lambda name: name["top"])))


def test_the_second_of_the_largest_error_is_found_across_runs_and_channels() -> None:
    rate, n = 100.0, 1000
    quiet = np.zeros(n)

    def record(run: str, size: float, at: int, error: float) -> HeldOutRecord:
        off = quiet.copy()
        off[at : at + 100] = error
        return HeldOutRecord(
            run=run,
            channel="x",
            unit="m",
            time=6.0 + np.arange(n) / rate,
            measured=quiet,
            models={BASELINE: off, EXTENDED: quiet},
            size=size,
        )

    # Relative to the channel's size, the second record errs more.
    chart = second_chart(worst_of([record("a", 1.0, 300, 0.2), record("b", 0.1, 640, 0.1)]))
    assert chart is not None
    assert chart.name == "second-b-x"
    assert chart.traces[0].x[0] == pytest.approx(6.0 + 6.4)
    assert worst_of([]) is None
    assert worst_of([record("a", 0.0, 300, 0.2)]) is None


def test_a_force_is_averaged_over_what_it_depends_on() -> None:
    rng = np.random.default_rng(1)
    d, v = rng.normal(size=(2, 20000)) * [[1e-3], [0.02]]
    law = 2000.0 * d + 4.0 * np.sign(v)
    measured = Force(deflection=d, velocity=v, force=law)
    smooth = Force(deflection=d, velocity=v, force=2000.0 * d)
    models = {BASELINE: smooth}
    at = PlaceForce(place="slide", origin="run a", measured=measured, models=models, spring=2000.0)
    over_speed = {trace.name: trace for trace in force_chart(at, "velocity").traces}
    assert force_chart(at, "velocity").x_label == "velocity, mm/s"
    mean = over_speed["measured, mean"].y
    away = np.abs(over_speed["measured, mean"].x) > 1.0  # mm/s; the bin around zero has both signs
    assert mean[away] == pytest.approx(4.0 * np.sign(over_speed["measured, mean"].x[away]), abs=0.3)
    assert over_speed["baseline"].y == pytest.approx(np.zeros(len(mean)), abs=1e-9)
    x, y = mean_over(d, law)
    assert y == pytest.approx(2000.0 * x, abs=1.0)


def test_bars_of_equations_show_the_place() -> None:
    chart = residual_chart({"table + motor": 1.1, "motor": 40.0, "stuck isolation": 1.0}, {"motor": 1.05, "table + motor": 1.0})
    assert chart is not None
    assert [trace.name for trace in chart.traces] == ["baseline", "extended model"]
    assert list(chart.traces[0].x) == ["forces on table + motor", "forces on motor", "isolation, stuck"]
    assert chart.traces[1].y[:2] == pytest.approx([1.0, 1.05])
    assert np.isnan(chart.traces[1].y[2])
    assert chart.x_log
    alone = residual_chart({"table": 1.1})
    assert alone is not None
    assert len(alone.traces) == 1
    assert residual_chart({}) is None
    # No equation is left for a force at a body without a sensor.
    without = residual_chart({"motor": 40.0, "motor + load": 20.0}, {})
    assert without is not None
    assert [trace.name for trace in without.traces] == ["baseline"]
    assert "The extended model has no bars" in without.caption
    assert "The extended model has no bars" not in chart.caption
    assert "is its place" not in chart.caption


def test_the_tall_bar_is_the_place_and_the_extension_brings_it_down(answered: Path) -> None:
    """The equation of the second cart alone contains the force between the carts."""
    bars = charts_of((answered / "report.html").read_text())[1]
    before, after = (dict(zip(trace["x"], values(trace["y"]), strict=True)) for trace in bars["traces"])
    assert set(before) == {"forces on first + second", "forces on second"}
    assert before["forces on second"] > 50.0
    assert before["forces on first + second"] < 3.0
    assert max(after.values()) < 3.0


def test_points_of_a_curve_that_the_runs_do_not_determine_are_left_out() -> None:
    """Their error bars would hide all others; a range of 10 N is the limit."""
    points = ((-2.0, -6.0, 7e4), (-1.0, -2.0, 10.0), (0.0, 0.0, 0.0), (1.0, 2.0, 0.1), (2.0, 4.0, 10.01))
    chart = curve_chart("foot", Curve(over="deflection", unit="m", value_unit="N", points=points, reached=(-1.5, 1.5)))
    np.testing.assert_array_equal(chart.traces[0].x, [-1.0, 0.0, 1.0])
    np.testing.assert_array_equal(chart.traces[0].spread, [10.0, 0.0, 0.1])
    assert "2 points that the runs do not determine are left out" in chart.caption
    assert (
        "left out"
        not in curve_chart(
            "foot", Curve(over="speed", unit="m/s", value_unit="N", points=points[2:4], reached=(0.0, 1.0))
        ).caption
    )


def test_a_force_over_position_has_a_curve_for_each_direction_or_samples_where_it_has_a_memory() -> None:
    rng = np.random.default_rng(2)
    d, v = rng.normal(size=(2, 20000)) * [[1e-3], [0.02]]
    level = 2.0 + 800.0 * d
    one = Force(deflection=d, velocity=v, force=level * np.sign(v))
    at = PlaceForce(place="rail", origin="run a", measured=one, models={BASELINE: one})
    measured, curve, baseline = force_chart(at, "deflection", "by direction").traces
    (gap,) = np.flatnonzero(np.isnan(curve.y))
    for side, way in ((slice(0, gap), 1.0), (slice(gap + 1, None), -1.0)):  # mm and N
        assert curve.y[side] == pytest.approx(way * (2.0 + 0.8 * curve.x[side]), abs=0.05)
    assert len(measured.x) >= 900
    measured, baseline = force_chart(at, "deflection", "samples").traces
    assert (measured.style, baseline.style) == ("dots", "dots")
    assert len(measured.x) >= 2 * len(baseline.x) >= 600


def two_carts() -> tuple[Campaign, RigModel]:
    """Two carts in a row, the second also on a rail with friction, moved at random; its description has half of the friction."""
    rate, steps, masses, springs, dampings, drag = 500.0, 20, (1.1, 0.8), (420.0, 610.0), (3.0, 1.5), 1.2
    draw = np.random.default_rng(77)
    count = round(16.0 * rate)
    push = np.interp(np.arange(count), np.arange(0, count + 40, 40), draw.normal(0.0, 4.0, count // 40 + 1))
    x, v, rows = np.zeros(2), np.zeros(2), []
    for force in push:
        rows.append(x.copy())
        for _ in range(steps):
            first = springs[0] * x[0] + dampings[0] * v[0]
            second = springs[1] * (x[1] - x[0]) + dampings[1] * (v[1] - v[0])
            rail = drag * v[1] + LEVEL * np.tanh(v[1] / 2e-3)
            v += np.array([force - first + second, -second - rail]) / masses / (rate * steps)
            x += v / (rate * steps)
    records = np.array(rows).T + draw.normal(0.0, 1e-6, (2, count))
    channels = {f"x{k + 1}": Channel(name=f"x{k + 1}", samples=records[k], quantity="displacement", unit="m") for k in range(2)}
    channels["force"] = Channel(name="force", samples=push, quantity="force", unit="N")
    model = RigModel(
        name="carts", bodies=tuple(Body(name=name, mass=mass) for name, mass in zip("ab", masses, strict=True)),
        links=(
            Link(name="first", a="a", stiffness=springs[0], damping=dampings[0]),
            Link(name="second", a="b", b="a", stiffness=springs[1], damping=dampings[1]),
            Link(name="rail", a="b", damping=drag),
        ),
        contacts=(Contact(name="rail", a="b", law=Coulomb(friction_force=LEVEL / 2.0)),),
        drive=Drive(channel="force", factor=1.0, pushes={"a": 1.0}, quantity="force"),
        sensors=tuple(Sensor(channel=f"x{k + 1}", body="ab"[k], quantity="displacement") for k in range(2)),
    )  # fmt: skip
    run = Run(id="a", configuration="unlocked", sample_rate=rate, gain=1.0, channels=channels, excitation="other")
    return Campaign(runs=(run,), source="carts"), model


def test_the_force_of_a_place_that_other_links_join_is_that_of_its_equation_of_motion() -> None:
    """The second cart moves on a rail and hangs on a spring: no free body ends at the rail."""
    campaign, model = two_carts()
    equations = equations_of(campaign, model)
    true = model.replace({"contacts.rail.law.friction_force": LEVEL})
    at = equation_force("rail", equations, {BASELINE: model, EXTENDED: true})
    assert at is not None
    baseline, extended = at.errors
    assert baseline == pytest.approx(LEVEL - model.contact("rail").law.friction_force, rel=0.2)
    assert extended < 0.1 * LEVEL
    assert equation_force("nowhere", equations, {BASELINE: model}) is None
