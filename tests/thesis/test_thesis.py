"""The thesis's page on short runs: verdicts follow from numbers, and what the page says holds in numbers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import thesis.campaign as campaigns
from isorig.analysis.isolation.ratio import isolation_ratio
from isorig.analysis.parameters.joint_fit import characterize
from isorig.rig.acquire.plan_check import read_plan
from isorig.rig.model.baseline import baseline_model
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.move_isolation import isolation_by_level
from isorig.rig.wire_bonder.session import VirtualRun
from thesis.campaign import HIGH, LOW, Candidate, Played, candidates, play, played, stribeck_rig
from thesis.early import FOUR, LEVELS, early, stays, too_small
from thesis.figure_readings import RESOLUTIONS, apparent, read, resolutions
from thesis.figures import COMPARED, breakaway, distance, figures, heavy_peak, over_measured, seen
from thesis.isolation import PLACE, offsets, place, ratio
from thesis.moves import level_for, moves
from thesis.published_values import MOST, Stated, above, below, printed
from thesis.questions import questions
from thesis.rivals import Compared, base, compared, rivals
from thesis.step import Row, Step, judged, markdown
from thesis.strokes import lowest

SHARE = 0.4
PLAN = Path(__file__).parents[2] / "docs" / "plans" / "two-gains.toml"


@pytest.fixture(scope="module")
def found() -> Compared:
    return compared(SHARE)


@pytest.fixture(scope="module")
def data(found: Compared) -> Played:
    """Table 4 and 20 N."""
    return found[candidates()[0].name][0].played


# ---------------------------------------------------------------------------------------------- verdicts


def test_verdicts_follow_from_the_number_and_the_tolerance() -> None:
    stated = printed(0.073, 0.15)
    assert stated.verdict(0.073) == stated.verdict(0.073 * 1.149) == "agrees"
    assert stated.verdict(0.073 * 1.16) == "same size"
    assert stated.verdict(0.597) == "differs"
    assert stated.in_words(0.597) == "differs: too high by a factor of 8.2"
    assert printed(164.5, 0.005).in_words(169.6) == "same size: 3.1 % too high"
    assert stated.in_words(float("nan")) == "differs: not available"
    low = below("too low", 0.95)
    assert [low.verdict(value) for value in (0.5, 0.95, 1.0, 1.9)] == ["agrees", "agrees", "differs", "differs"]
    assert above("a step", 1.2).verdict(1.19) == "agrees"
    assert stated.shown == "0.073 (±15 %)"


@given(st.floats(1e-3, 1e3), st.floats(0.01, 0.9), st.floats(1e-6, 1e6))
def test_a_wider_tolerance_never_turns_agreement_into_difference(number: float, tolerance: float, value: float) -> None:
    narrow, wide = (Stated(words="", low=number, high=number, tolerance=t) for t in (tolerance, 2.0 * tolerance))
    assert wide.tolerances(value) <= narrow.tolerances(value) <= MOST
    assert (narrow.verdict(value) == "agrees") == (narrow.tolerances(value) <= 1.0)
    assert not (narrow.verdict(value) == "agrees" and wide.verdict(value) != "agrees")


def test_another_friction_changes_the_verdict(found: Compared, monkeypatch: pytest.MonkeyPatch) -> None:
    (figure,) = [f for f in figures() if f.what == "damping from the motor's peak"]
    name = next(n for n in found if n.startswith("Stribeck"))
    assert figure.stated.verdict(figure.of(found[name][0])) == "agrees"
    monkeypatch.setattr(campaigns, "SLIDING", 19.9)
    changed = seen(played(Candidate(name="Stribeck", rig=stribeck_rig()), SHARE))
    assert figure.of(changed) > 0.3
    assert judged(figure.what, figure.stated, figure.of(changed)).remark.startswith("differs")


def test_table_of_candidates_has_every_figure_for_and_against(found: Compared) -> None:
    step = rivals(found)
    ((heads, rows),) = step.tables
    assert [row[1] for row in rows[:-2]] == [figure.what for figure in figures()]
    assert list(heads[3:]) == [candidate.name for candidate in candidates()]
    far = {name: distance(values_) for name, (_, values_) in found.items()}
    chosen = base(found).played.candidate.name
    assert far[chosen] == min(far.values())
    # The peaks near 5 and 11 Hz and the motor's damping rule out the rig that the thesis itself simulates.
    assert far[candidates()[0].name] > 1.2 * far[chosen]
    assert chosen in step.text[0]
    against = [row for row in rows[:-2] if row[3 + list(found).index(chosen)].split(": ")[1].split(",")[0] != "agrees"]
    assert against, "no candidate has everything for it"


def test_distance_counts_tolerances(found: Compared) -> None:
    values_ = dict(next(iter(found.values()))[1])
    for figure in figures():
        stated = figure.stated
        inside = stated.low if stated.low > 0.0 else 0.5 * stated.high
        values_[f"{figure.where}: {figure.what}"] = inside
    assert distance(values_) == 0.0
    first = figures()[0]
    values_[f"{first.where}: {first.what}"] = 1e9
    assert distance(values_) == pytest.approx(MOST / np.sqrt(len(figures())))


# ---------------------------------------------------------------------------------------------- figures


def test_gauge() -> None:
    assert breakaway(candidates()[0].rig) == pytest.approx(THESIS["friction_force"], rel=0.02)
    # Stribeck's breakaway is the gauge's too: that is what makes it a candidate.
    assert breakaway(stribeck_rig()) == pytest.approx(THESIS["friction_force"], rel=0.02)


def test_too_small_by_four_is_the_heatblock_of_the_early_rig() -> None:
    shares = [too_small(candidates()[0].rig, level) for level in LEVELS]
    assert all(FOUR.verdict(share) == "agrees" for share in shares)
    # With the heavy table it would not be.
    heavy = candidates()[0].rig.replace({"bodies.table.mass": 300.0, "links.table.stiffness": 300.0 * (2 * np.pi * 10.8) ** 2})
    assert FOUR.verdict(too_small(heavy, LEVELS[1])) != "agrees"


def test_fig_7_stays_at_its_largest_for_short_pulses() -> None:
    assert min(stays(length) for length in (0.03, 0.05, 0.06)) > 0.999
    assert stays(0.1) == pytest.approx(11.1 / 19.0, abs=0.01)


def test_the_force_that_holds_makes_the_chatter_not_the_relative_velocity() -> None:
    rows = {row.what: row for row in early(candidates()[0]).rows if "reversals" in row.what}
    chatters = {what for what, row in rows.items() if float(row.here) > 100}
    two, three = (
        f"Fig. {where} masses: reversals of the friction force, relative velocity" for where in ("9-10, two", "12, three")
    )
    assert chatters == {two, three}
    assert len(rows) == 6
    assert all(float(row.here) < 10 for what, row in rows.items() if what not in chatters)
    assert rows[two].remark.startswith("differs")
    assert rows[three].remark == "agrees"


def test_set_ups_with_and_without_friction(data: Played) -> None:
    rough, smooth = ({item.name: item for item in read(c).set_ups} for c in (data.measured, data.smooth))
    for item in (rough, smooth):
        heatblock = item["heatblock"].mode
        assert heatblock is not None
        assert heatblock.frequency == pytest.approx(164.5, abs=0.2)
        assert heatblock.damping == pytest.approx(0.009, rel=0.05)
    motors = [item["motor"].mode for item in (rough, smooth)]
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
    got = apparent(SHARE, 8.0, own=0.001)
    assert got.motor == pytest.approx(THESIS["motor_damping"], rel=0.15)
    assert got.surface[0] == pytest.approx(80.0, rel=0.1)


def test_where_a_simulation_without_friction_errs(found: Compared, data: Played) -> None:
    one = found[data.candidate.name][0]
    f, over = over_measured(one, data.smooth)
    off = {band: float(np.median(over[(f >= band[0]) & (f <= band[1])])) for band in COMPARED}
    # Too high below 7 Hz, where the thesis says too low: a median from 5 to 10 Hz hides it.
    assert off[5.0, 7.0] > 1.5
    assert off[7.0, 10.0] < 0.8
    assert off[10.6, 11.4] > 1.1
    assert off[11.5, 20.0] < 0.6
    assert float(over[np.argmin(np.abs(f - 5.0))]) > 4.0
    assert heavy_peak(one) == pytest.approx(0.13, abs=0.03)


def test_isolation_promised_and_measured(data: Played) -> None:
    promised, measured = isolation_ratio(data.smooth), isolation_ratio(data.measured)
    high = (promised.frequency >= 15.0) & (promised.frequency <= 80.0)
    assert 1.0 - np.median(promised.ratio[high]) == pytest.approx(0.98, abs=0.01)
    assert np.median(measured.ratio[high]) == pytest.approx(1.0, abs=0.02)
    step, std = measured.steps[0]
    assert abs(step - 1.0) > 10.0 * std
    told = " ".join(row.remark for row in ratio(data).rows)
    assert "stuck for 100%" in told


def test_sixty_per_cent_belong_to_moves_of_a_bench(data: Played) -> None:
    rows = {row.what: row for row in moves(data).rows}
    (level,) = [row for what, row in rows.items() if "Table 4 and 20 N of" in what]
    assert 15.0 < float(level.here) < 30.0
    assert rows["unlocked: heatblock relative to table in a move of 4 mm in 11 ms, largest, µm"].remark == "agrees"
    locked = rows["locked: heatblock relative to table in a move of 4 mm in 11 ms, largest, µm"]
    assert locked.remark.startswith("differs")


def test_friction_that_holds_part_of_the_time_halves_the_peak(data: Played) -> None:
    (heads, cells), _ = offsets(data).tables
    assert heads[0] == "gain"
    rows = {float(row[0]): row for row in cells}
    assert abs(float(rows[HIGH][1].split()[0])) < 0.02
    assert float(rows[HIGH][3].split(":")[0]) == pytest.approx(1.0, abs=0.03)
    assert rows[HIGH][4] == "100%"
    assert 0.2 < float(rows[LOW][1].split()[0]) < 1.02
    assert float(rows[LOW][3].split(":")[0]) == pytest.approx(0.5, abs=0.12)


def test_no_mass_of_the_table_explains_place_and_ratios() -> None:
    # Two bodies against one another: f sqrt(1 + m2 / m1), the locked motor riding on the table.
    for mass, wanted in ((250.0, 166.4), (80.0, 169.6), (45.0, 172.4)):
        locked, rise = place(mass)
        riding = mass + THESIS["motor_mass"]
        assert locked == pytest.approx(THESIS["heatblock_frequency"] * np.sqrt(1.0 + 6.0 / riding), abs=0.1)
        assert locked == pytest.approx(wanted, abs=0.15)
        assert rise > 0.0
    assert PLACE.verdict(place(250.0)[0]) == "agrees"
    assert PLACE.verdict(place(80.0)[0]) == PLACE.verdict(place(45.0)[0]) == "same size"


def test_lowest_frequency_for_moves_that_go_on() -> None:
    going = [lowest(40, repeat=n) for n in (7, 12, 30)]
    assert going == pytest.approx([0.6] * 3, abs=0.05)
    assert lowest(40, repeat=8, after=True) > 1.4 * going[0]
    assert lowest(40, mass=6.0) < going[0] < lowest(40, mass=7.0)


# ---------------------------------------------------------------------------------------------- the page


def test_markdown_keeps_tables_whole() -> None:
    row = Row(what="|a / b|", thesis="1", here="2", remark="differs")
    text = markdown([Step(title="T", rows=[row], text=["words"], tables=[(("x", "y"), [("1", "2")])])], ["preface"])
    assert text.startswith("# The thesis reproduced\n\npreface\n\n## T\n\n| what |")
    assert "| \\|a / b\\| | 1 | 2 | differs |\n\n| x | y |\n| --- | --- |\n| 1 | 2 |\n\nwords\n" in text


def test_every_question_has_an_answer_and_what_would_settle_it(found: Compared) -> None:
    step = questions(found, points=40)
    ((heads, rows),) = step.tables
    assert heads == ("question", "answer", "certainty", "the measurement that would decide it")
    assert len(rows) >= 8
    assert all(len(row) == 4 and all(row) for row in rows)
    assert "plans/two-gains.toml" in step.text[0]


def test_the_plan_distinguishes_coulomb_from_stribeck() -> None:
    """A fit with Coulomb's law explains both gains where friction is Coulomb's, and misses where it is Stribeck's."""
    plan = read_plan(PLAN)
    assert {run.gain for run in plan.runs if run.configuration == "unlocked" and run.excitation == "random"} == {70.0, 35.0}
    explained = {}
    for candidate in (candidates()[1], next(c for c in candidates() if c.name.startswith("Stribeck"))):
        takes = [
            VirtualRun(
                id=run.id, configuration=run.configuration, gain=run.gain, seconds=0.15 * run.seconds, start=100.0 * k,
                excitation=run.excitation, band=run.band or (0.5, 20.0), use=run.use, per_gain=candidate.per_gain,
            )
            for k, run in enumerate(plan.runs)
        ]  # fmt: skip
        campaign = play(candidate.rig, takes)
        known = {name: float(value) for name, value in plan.rig.items()}
        campaign = replace(campaign, known=known)
        got = characterize(campaign, baseline_model(campaign))
        assert got.calibrated
        explained[candidate.name] = (got.adequate, got.error / got.floor)
    (coulomb, near), (stribeck, far) = explained.values()
    assert coulomb
    assert not stribeck
    assert far > 5.0 * near


def test_the_rivals_sliding_force_is_data() -> None:
    law = stribeck_rig().contact("isolation").law
    assert msgspec.to_builtins(law)["friction_force"] == campaigns.SLIDING


def test_level_for() -> None:
    found = isolation_by_level(wire_bonder(), 3e-3, np.array([12.5, 30.0, 166.7]), tolerance=2e-6)
    at = level_for(found, 0.6)
    assert 12.5 < at < 30.0
    assert np.interp(at, found.acceleration, found.isolation) == pytest.approx(0.6)
    assert np.isnan(level_for(found, 0.999))
    assert level_for(found, 0.0) == 12.5
