"""`rig modes` and several recordings in `rig frf`: numbers of the true rig, pages in a real browser."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from headless_page import CHROMIUM, told_by

from isorig.analysis.simulate.natural import natural_modes
from isorig.rig.cli import main
from isorig.rig.files.recording import write
from isorig.rig.files.rigfile import read_rig
from isorig.rig.virtual.simulated_recording import described_campaign

#: What the page shows: charts, dots of the shapes from a moment on, readouts of the peaks, width, legends.
PROBE = """<script>
// Frames follow the timers: those of a headless browser hardly come while it runs ahead of the clock.
let frame = 0;
window.requestAnimationFrame = (drawn) => setTimeout(() => drawn(frame += 16), 16);
addEventListener("load", () => setTimeout(async () => {
  const root = document.documentElement, charts = [...document.querySelectorAll(".chart")];
  const swings = () => [...document.querySelectorAll("svg.shape circle")]
    .map((dot) => [60 - Number(dot.getAttribute("cy")), Number(dot.dataset.re)]);
  const moments = [swings()];
  for (let k = 0; k < 10; k++) {
    await new Promise((resolve) => setTimeout(resolve, 100));
    moments.push(swings());
  }
  const plane = document.querySelector(".chart .nsewdrag"), box = plane.getBoundingClientRect();
  const at = { bubbles: true, clientX: box.left + box.width / 2, clientY: box.top + box.height / 2 };
  plane.dispatchEvent(new MouseEvent("mouseover", at));
  for (let k = 0; k < 5; k++) {
    plane.dispatchEvent(new MouseEvent("mousemove", at));
    await new Promise((resolve) => setTimeout(resolve, 150));
  }
  const told = { drawn: charts.map((c) => c.querySelectorAll(".main-svg path").length > 0),
    cursor: [...document.querySelectorAll(".hoverlayer text")].map((text) => text.textContent),
    inner: innerWidth, wide: root.scrollWidth,
    moments,
    peaks: [...document.querySelectorAll(".peaks")].map((p) => p.textContent),
    minor: charts.map((c) => c.querySelectorAll(".xminor, path.ytick, path.xtick").length),
    heights: charts.map((c) => c._fullLayout.yaxis._length),
    cut: [...document.querySelectorAll(".chart text")].filter((text) => {
      const own = text.getBoundingClientRect(), chart = text.closest(".chart").getBoundingClientRect();
      return own.width && (own.left < chart.left - 1 || own.right > chart.right + 1);
    }).map((text) => text.textContent),
    jumps: charts.flatMap((c) => c.data.filter((t) => t.yaxis === "y2" && t.mode === "lines" && t.y.length > 9))
      .map((t) => Math.max(...t.y.slice(1).map((v, i) => Math.abs(v - t.y[i])).filter(Number.isFinite))) };
  parent.postMessage(JSON.stringify(told), "*");
}, 1500));
</script>"""


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The tuned absorber, and the same with a softer absorber."""
    folder = tmp_path_factory.mktemp("absorbers")
    given = read_rig("absorber")
    softer = given.model.replace({"links.absorber.stiffness": 5000.0})
    for name, truth in (("before", given.model), ("after", softer)):
        write(folder / f"{name}.h5", described_campaign(given, seed=4, seconds=60.0, truth=truth))
    return folder / "before.h5", folder / "after.h5"


def test_modes_are_those_of_the_rig(recordings: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    call = ["modes", str(recordings[0]), "--band", "3", "20", "--configuration", "unlocked", "-o", str(tmp_path)]
    assert main(call) == 0
    said = capsys.readouterr().out
    found = json.loads((tmp_path / "modes.json").read_text())
    truth = natural_modes(read_rig("absorber").model, "unlocked")
    assert [mode["frequency_hz"] for mode in found["modes"]] == pytest.approx([mode.frequency for mode in truth], rel=0.005)
    assert [mode["damping"] for mode in found["modes"]] == pytest.approx([mode.damping for mode in truth], rel=0.1)
    for mode, true in zip(found["modes"], truth, strict=True):
        shape = np.array([complex(*mode["shape"][name]) for name in ("platform", "absorber")])
        expected = true.shape / true.shape[np.argmax(np.abs(true.shape))]
        assert np.abs(shape.real / shape[np.argmax(np.abs(shape))].real - expected) == pytest.approx([0.0, 0.0], abs=0.03)
    assert "modes.html" in said
    rows = (tmp_path / "modes.csv").read_text().splitlines()
    assert rows[0] == "frequency_hz,frequency_std,damping,damping_std,collinearity"
    assert len(rows) == 1 + len(truth)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--band", "20", "3"], "has no width"),
        (["--band", "3", "200"], "covers 3 to 200 Hz"),
        (["--band", "3", "20", "--configuration", "none"], "give another band or set-up"),
    ],
)
def test_refused_in_one_sentence(
    more: list[str], words: str, recordings: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["modes", str(recordings[0]), *more, "-o", str(tmp_path / "out")]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine: install Debian's package to run this test")
@pytest.mark.parametrize("width", [1280, 420])
def test_the_shapes_swing_and_the_poles_are_drawn(recordings: tuple[Path, Path], tmp_path: Path, width: int) -> None:
    assert main(["modes", str(recordings[0]), "--band", "3", "20", "-o", str(tmp_path / "out")]) == 0
    told = told_by((tmp_path / "out" / "modes.html").read_text(), PROBE, width, tmp_path)
    # Two modes of two points at some moments: each swings by its shape, from the phase that the animation has reached.
    moments = np.array(told["moments"]).reshape(-1, 2, 2, 2)
    for moved, shape in moments.transpose(0, 1, 3, 2).reshape(-1, 2, 2):
        phase = moved[0] / (42.0 * shape[0])
        assert abs(phase) < 1.01  # positions are rounded to a tenth of a pixel
        assert moved == pytest.approx(42.0 * phase * shape, abs=6.0)
    assert np.ptp(moments[..., 0], axis=0).min() > 1.0
    assert told["drawn"] == [True, True]
    assert told["wide"] <= told["inner"] == width
    assert told["cut"] == []


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine: install Debian's package to run this test")
@pytest.mark.parametrize("width", [1280, 420])
def test_two_recordings_are_overlaid(recordings: tuple[Path, Path], tmp_path: Path, width: int) -> None:
    assert main(["frf", *map(str, recordings), "--response", "platform", "-o", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "before" / "frf.json").is_file()
    assert (tmp_path / "out" / "after" / "frf.json").is_file()
    page = (tmp_path / "out" / "frf.html").read_text()
    assert "before: unlocked" in page
    assert "after: unlocked" in page
    told = told_by(page, PROBE, width, tmp_path)
    assert told["drawn"] == [True]
    assert told["wide"] <= told["inner"] == width
    assert told["cut"] == []
    # The legend of many curves takes nothing from the panels.
    assert min(told["heights"]) > 120
    # No line joins the ends of a wrapped phase.
    assert max(told["jumps"]) <= 180.0
    # Magnitude and frequency have minor ticks.
    assert min(told["minor"]) > 20
    # The cursor shows the values of all curves in all panels.
    curves = 4  # two recordings at two levels
    assert sum("before: " in text or "after: " in text for text in told["cursor"]) >= curves, told["cursor"]
    (peaks,) = told["peaks"]
    table = json.loads((tmp_path / "out" / "before" / "frf.json").read_text())["transfer_functions"]
    for row in table:
        assert f"{row['peak']['frequency_hz']:.4g} Hz" in peaks


def test_two_recordings_of_one_name_are_refused(
    recordings: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["frf", str(recordings[0]), str(recordings[0]), "-o", str(tmp_path / "out")]) == 2
    assert "two recordings have the same name" in capsys.readouterr().err
    assert main(["frf", *map(str, recordings), "--follow", "-o", str(tmp_path / "out")]) == 2
    assert "--follow reads one recording" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
