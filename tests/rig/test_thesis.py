"""The thesis's figures on short runs: what the page says must hold in numbers."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.isolation import isolation_ratio
from analysis.rigs import THESIS
from rig.thesis.campaign import HIGH, LOW, Played, played
from rig.thesis.early import early
from rig.thesis.isolation import offsets, ratio
from rig.thesis.readings import RESOLUTIONS, apparent, read, resolutions
from rig.thesis.rival import rival
from rig.thesis.step import Row, Step, markdown
from rig.thesis.strokes import lowest
from rig.thesis.table import COMPARED, sizes


@pytest.fixture(scope="module")
def data() -> Played:
    return played(0.4)


def test_gauge() -> None:
    assert float(early().rows[0].here) == pytest.approx(THESIS["friction_force"], rel=0.02)


def test_set_ups_with_and_without_friction(data: Played) -> None:
    rough, smooth = ({item.name: item for item in read(c).set_ups} for c in (data.measured, data.smooth))
    for found in (rough, smooth):
        heatblock = found["heatblock"].mode
        assert heatblock is not None
        assert heatblock.frequency == pytest.approx(164.5, abs=0.2)
        assert heatblock.damping == pytest.approx(0.009, rel=0.05)
    motors = [found["motor"].mode for found in (rough, smooth)]
    assert all(motors)
    # Friction counts as damping where the model has none.
    assert motors[0].damping > 4.0 * motors[1].damping  # type: ignore[union-attr]
    assert motors[1].damping == pytest.approx(0.067, rel=0.05)  # type: ignore[union-attr]


def test_half_power_of_the_table_is_several_times_its_damping(data: Played) -> None:
    with_friction, without = resolutions(data.measured), resolutions(data.smooth)
    assert with_friction[RESOLUTIONS.index(0.25)] == pytest.approx(0.067, rel=0.2)
    assert all(a > b > THESIS["table_damping"] for a, b in zip(with_friction, without, strict=True))
    assert without == sorted(without)


def test_eight_newtons_alone_read_as_the_motors_damping() -> None:
    got = apparent(0.4, 8.0, own=0.001)
    assert got.motor == pytest.approx(THESIS["motor_damping"], rel=0.15)
    assert got.surface[0] == pytest.approx(80.0, rel=0.1)


def test_where_a_simulation_without_friction_errs(data: Played) -> None:
    f, size = sizes(data, {"without": data.smooth_rig, "with": data.rig})
    for (low, high), said in COMPARED.items():
        kept = (f >= low) & (f <= high)
        off = np.median(size["without"][kept] / size["measured"][kept])
        assert (off > 1.1) if said == "too high" else (off < 0.95)
        assert np.median(size["with"][kept] / size["measured"][kept]) == pytest.approx(1.0, abs=0.01)


def test_isolation_promised_and_measured(data: Played) -> None:
    promised, measured = isolation_ratio(data.smooth), isolation_ratio(data.measured)
    high = (promised.frequency >= 15.0) & (promised.frequency <= 80.0)
    assert 1.0 - np.median(promised.ratio[high]) == pytest.approx(0.98, abs=0.01)
    assert np.median(measured.ratio[high]) == pytest.approx(1.0, abs=0.02)
    step, std = measured.steps[0]
    assert abs(step - 1.0) > 10.0 * std
    told = " ".join(row.here for row in ratio(data).rows)
    assert "stuck for 100%" in told


def test_friction_that_holds_part_of_the_time_halves_the_peak(data: Played) -> None:
    rows = {row.what.split(":")[0]: row.here for row in offsets(data).rows}
    shift, _, own, stuck = (part.strip() for part in rows[f"gain {HIGH:g}"].split(";"))
    assert abs(float(shift.split()[0])) < 0.02
    assert float(own) == pytest.approx(1.0, abs=0.03)
    assert stuck == "100%"
    shift, _, own, _ = (part.strip() for part in rows[f"gain {LOW:g}"].split(";"))
    assert 0.2 < float(shift.split()[0]) < 1.02
    assert float(own) == pytest.approx(0.5, abs=0.12)


def test_lowest_frequency_for_moves_that_go_on() -> None:
    going = [lowest(40, repeat=n) for n in (7, 12, 30)]
    assert going == pytest.approx([0.6] * 3, abs=0.05)
    assert lowest(40, repeat=8, after=True) > 1.4 * going[0]
    assert lowest(40, mass=6.0) < going[0] < lowest(40, mass=7.0)


def test_markdown_keeps_tables_whole() -> None:
    row = Row(what="a", thesis="1", here="2", remark="differs")
    text = markdown([Step(title="T", rows=[row], text=["words"])], ["preface"])
    assert text.startswith("# The thesis reproduced\n\npreface\n\n## T\n\n| what |")
    assert text.endswith("| a | 1 | 2 | differs |\n\nwords\n")


def test_breakaway_of_twenty_and_sliding_of_eight_newtons_fit_more_of_the_thesis(data: Played) -> None:
    found = {row.what: row.here for row in rival(data).rows}
    coulomb, stribeck = (float(part.split(": ")[1]) for part in found["damping read off the motor"].split(";"))
    assert stribeck == pytest.approx(0.073, rel=0.15)
    assert coulomb > 0.3
    for band in ("5 to 9", "13 to 15"):
        apart = [float(part.split()[-2]) for part in found[f"ratio beside that without friction, {band} Hz"].split(";")]
        assert apart[1] < 1.35 < apart[0]
