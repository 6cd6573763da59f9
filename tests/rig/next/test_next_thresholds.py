"""The settings of proposals and investigations on the rig, right below and right above each threshold."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np
import pytest
from open_questions import hardening, rivals

from isorig.analysis.model.limits import Limits
from isorig.analysis.proposals.choice import PredictedPair
from isorig.rig.acquire.plan import InstrumentPlan, Plan
from isorig.rig.files.rivals import OpenSet
from isorig.rig.next import proposal as proposal_module
from isorig.rig.next.investigation import _reason_to_end, nothing_known
from isorig.rig.next.page import picture_of
from isorig.rig.next.plan_file import virtual_instrument_of
from isorig.rig.next.proposal import _rest_first, situation
from isorig.rig.next.sentences import _errors, unfitted
from isorig.rig.next.stages import Investigation, InvestigationStage

LIMITS = Limits(gains=(0.0, 50.0), band=(0.5, 300.0))


def test_a_run_begins_after_a_pause_and_lasts_a_minute_if_no_limit_is_given() -> None:
    """The last of the runs ends after 70 s."""
    now = situation([rivals()], LIMITS)
    assert now.start_time == 70.0 + 30.0
    assert now.limits.seconds == 60.0
    assert situation([rivals()], msgspec.structs.replace(LIMITS, seconds=12.0)).limits.seconds == 12.0


@pytest.mark.parametrize(("share", "rests"), [(0.49, 0), (0.51, 1)])
def test_a_run_at_rest_comes_first_where_the_rig_masks_the_noise(
    share: float, rests: int, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    found = rivals()

    def levels(*_: object) -> Mapping[str, float]:
        return {name: share * level for name, level in found.noise.items()}

    monkeypatch.setattr(proposal_module, "noise_levels", levels)
    assert len(_rest_first(situation([found], LIMITS))) == rests


def test_what_is_not_known_before_the_first_run() -> None:
    """A parameter known to 30 %, and noise of 3e-4 of the signal with the strongest drive, 1/70 V of which is 3.8 m/s^2."""
    instrument = InstrumentPlan(kind="framed", port="virtual", sample_rate=1024.0)
    masses = {"head_mass": 6.5, "motor_mass": 16.4, "heatblock_mass": 6.0, "table_mass": 250.0}
    found = nothing_known(Plan(instrument=instrument, channels={}, rig=masses, limits=LIMITS), LIMITS, "coulomb")
    variant = found.explains.variant()
    stiffness = next(k for k, one in enumerate(variant.free) if one.path == "links.isolation.stiffness")
    deviation = np.sqrt(variant.covariance[stiffness, stiffness])
    assert deviation == pytest.approx(0.3 * variant.model.get("links.isolation.stiffness"))
    assert found.noise["motor"] == pytest.approx(3e-4 * 3.8 / 70.0 * 50.0)


@pytest.mark.parametrize(("verdicts", "ends"), [(["a"], False), (["a", "b", "b"], False), (["a", "a"], True)])
def test_an_unexplained_remainder_is_left_after_two_stages_without_a_change(verdicts: list[str], ends: bool) -> None:
    stages = [
        InvestigationStage(number=k, kind="undecided", asked=[], runs=[], step="diagnosed", verdict=verdict)
        for k, verdict in enumerate(verdicts)
    ]
    so_far = Investigation(plan="plan.toml", baseline="coulomb", tolerance=0.0, stages=stages)

    class Plenty:
        """Runs and seconds enough."""

        most_runs, seconds = 99, 1e4

    assert bool(_reason_to_end(so_far, Plenty())) == ends  # type: ignore[arg-type]


@pytest.mark.parametrize(("count", "more"), [(4, ""), (5, ", and 1 more")])
def test_four_causes_are_listed(count: int, more: str) -> None:
    left = OpenSet(why="indistinguishable", models=[], unfitted=[(f"cause_{k}", "isolation") for k in range(count)])
    assert f"cause 3 at isolation{more}, but did not fit" in " ".join(unfitted(rivals(left)))


@pytest.mark.parametrize(("distance", "text"), [(98.0, "98 standard errors"), (100.0, "more than 100 standard errors")])
def test_very_large_distances_are_not_stated(distance: float, text: str) -> None:
    assert _errors(distance) == text


@pytest.mark.parametrize(("samples", "shown"), [(999, 999), (1025, 1024)])
def test_a_second_of_a_prediction_is_shown(samples: int, shown: int) -> None:
    cause, record = hardening().variant(), np.linspace(0.0, 1.0, samples)
    pair = PredictedPair(
        truth=cause, rival=cause, channel="motor", sample_rate=1024.0, of_truth=record, of_rival=0.0 * record, allowed=1.0,
        distance=3.0,
    )  # fmt: skip
    assert len(picture_of(pair).of_truth) == shown


def test_channels_of_the_virtual_instrument_have_one_sensitivity() -> None:
    assert {channel.sensitivity for channel in virtual_instrument_of(rivals()).channels.values()} == {0.2}
