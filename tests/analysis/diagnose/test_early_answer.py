"""What the equations of motion tell of a run that is still being measured."""

from __future__ import annotations

import msgspec
import pytest

from isorig.analysis.diagnose import early_answer as early_answer_module
from isorig.analysis.diagnose.early_answer import CLEAR, CONFIRMED, LEAST_SECONDS, STILL_HOLD, Decision, EarlyAnswer, early_answer
from isorig.analysis.equations.ranking import Explanation, Ranking
from isorig.analysis.equations.system import HOLDS
from isorig.rig.model.baseline import baseline_model
from isorig.rig.wire_bonder.description import wire_bonder
from isorig.rig.wire_bonder.effects import campaign_with, hidden_in
from isorig.rig.wire_bonder.session import VirtualRun

RUN = (VirtualRun(id="u70", configuration="unlocked", gain=70.0, seconds=25.0, start=0.0),)
BROKEN = {"motor": 2.0 * HOLDS}
CAUSE = EarlyAnswer(residuals=BROKEN, kind="spring_shape", place="isolation")
OTHER = EarlyAnswer(residuals=BROKEN, kind="sensor", place="table")
UNCLEAR = EarlyAnswer(residuals=BROKEN)
HOLD = EarlyAnswer(residuals={"motor": 0.9 * HOLDS})


def test_a_cause_is_certain_once_a_longer_record_names_it_again() -> None:
    decision = Decision()
    assert not decision.add(4.0, CAUSE)
    assert not decision.add(4.0 * CONFIRMED - 0.01, CAUSE)
    assert decision.add(4.0 * CONFIRMED, CAUSE)


@pytest.mark.parametrize("between", [OTHER, UNCLEAR, HOLD])
def test_another_answer_in_between_begins_anew(between: EarlyAnswer) -> None:
    decision = Decision()
    decision.add(4.0, CAUSE)
    decision.add(6.0, between)
    assert not decision.add(8.0, CAUSE)
    assert decision.add(8.0 * CONFIRMED, CAUSE)


def test_equations_that_hold_are_certain_later() -> None:
    decision = Decision()
    assert not decision.add(5.0, HOLD)
    assert not decision.add(LEAST_SECONDS - 0.1, HOLD)
    assert decision.add(LEAST_SECONDS, HOLD)
    late = Decision()
    late.add(LEAST_SECONDS, HOLD)
    assert not late.add(STILL_HOLD * LEAST_SECONDS - 0.1, HOLD)
    assert late.add(STILL_HOLD * LEAST_SECONDS, HOLD)


def test_no_answer_is_never_certain() -> None:
    decision = Decision()
    assert not any(decision.add(seconds, UNCLEAR) for seconds in (5.0, 50.0, 500.0))


def test_an_equation_holds_below_the_limit() -> None:
    assert EarlyAnswer(residuals={"motor": HOLDS - 0.01}).hold
    assert not EarlyAnswer(residuals={"motor": HOLDS}).hold
    assert not EarlyAnswer(residuals={"table": 0.5}, complete=False).hold


@pytest.mark.parametrize(("kind", "expected"), [("hardening_stiffness", ("spring_shape", "isolation")), (None, ("", ""))])
def test_seconds_of_a_run_show_place_and_kind(kind: str | None, expected: tuple[str, str]) -> None:
    """A hardening isolation in 25 seconds of one run; the sound rig's equations hold there."""
    campaign = campaign_with(hidden_in(wire_bonder(), kind, 1.0, seed=3), RUN, seed=3)
    answer = early_answer(campaign, baseline_model(campaign))
    assert answer is not None
    assert (answer.kind, answer.place) == expected
    assert answer.hold == (kind is None)


@pytest.mark.parametrize(("score", "named"), [(CLEAR, True), (CLEAR - 0.01, False)])
def test_a_cause_needs_a_clear_score(score: float, named: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A resonator on the heatblock of a rig that mostly sticks once looked like its friction, with a score of 0.38."""
    campaign = campaign_with(hidden_in(wire_bonder(), None, 1.0, seed=3), RUN, seed=3)
    best = Explanation(kind="sensor", place="table", what="gain", score=score, residuals={}, values={})
    monkeypatch.setattr(early_answer_module, "ranking", lambda _: Ranking(residuals=BROKEN, explanations=(best,)))
    answer = early_answer(campaign, baseline_model(campaign))
    assert answer is not None
    assert bool(answer.kind) == named


def test_a_rig_whose_sensors_support_no_equation_has_no_answer() -> None:
    campaign = campaign_with(hidden_in(wire_bonder(), None, 1.0, seed=3), RUN, seed=3)
    blind = msgspec.structs.replace(baseline_model(campaign), sensors=baseline_model(campaign).sensors[:1])
    assert early_answer(campaign, blind) is None
