"""The decisions about a fleet, right below and right above each threshold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from made_up import drawn_fleet

from isorig.analysis.trends.change import DatedChange, Followed
from isorig.analysis.trends.series import Series
from isorig.rig.fleet.history import DiagnosedCampaign, Incident, NewCause, Track, TrackedRig, _joined, _named, followed
from isorig.rig.fleet.sentences import _pause, change_words

STOP = "end_stop at isolation"
AROUND = pytest.mark.parametrize("share", [0.98, 1.02])
TRACK = Track(
    name="links.isolation.stiffness", unit="N/m", log=False, campaigns=tuple(range(12)),
    series=Series(time=7.0 * np.arange(12), value=np.zeros(12), std=np.ones(12)),
    followed=Followed(changes=(), level=0.0, std=1.0, outlying=()),
)  # fmt: skip


def campaigns(causes: Sequence[str], started: Sequence[float] | None = None) -> tuple[DiagnosedCampaign, ...]:
    days = started or [7.0 * k for k in range(len(causes))]
    return tuple(
        DiagnosedCampaign(
            name=f"c{k}", started=days[k], verdict="explained", causes=frozenset({cause} - {""}), alike=frozenset(), content="",
            path="",
        )
        for k, cause in enumerate(causes)
    )  # fmt: skip


def change(size: float) -> DatedChange:
    return DatedChange(kind="step", first=6, earliest=5, latest=7, alarm=8, before=0.0, after=size, std=1.0)


def incident(moved: DatedChange) -> Incident:
    return Incident(rig="rig", changes=((TRACK, moved),), named=(), last_before=4, first_after=7, first=6, alarm=8)


@pytest.mark.parametrize(
    ("pattern", "new"),
    [
        ("....xx", True), ("....x.x", True), ("....x..x", False), ("....x", False),  # two of three campaigns name it
        ("...xx", False),  # before these three, three did not
        ("....xx..xx", True), ("xx......xx", True), ("xx...xx", False),  # gone, and back
    ],
)  # fmt: skip
def test_a_cause_is_new_if_two_of_three_campaigns_name_it_after_three_without(pattern: str, new: bool) -> None:
    assert bool(_named(campaigns([STOP if letter == "x" else "" for letter in pattern]))) is new


@AROUND
def test_a_change_of_eight_standard_deviations_dates_better_than_a_name(share: float) -> None:
    moved, name = change(8.0 * share), NewCause(cause=STOP, begun=7, first=7, alarm=8)
    named = Incident(rig="rig", changes=(), named=(name,), last_before=6, first_after=7, first=7, alarm=8)
    assert _joined([incident(moved), named]).first == (7 if share < 1.0 else 6)


@AROUND
def test_a_change_is_confirmed_from_three_standard_deviations_on(share: float) -> None:
    moved = change(-3.0 * share)
    assert change_words(TRACK, moved).endswith("not confirmed by the campaigns since") is (share < 1.0)
    assert incident(moved).confirmed is (share > 1.0)
    assert replace(incident(moved), named=(NewCause(cause=STOP, begun=7, first=7, alarm=8),)).confirmed


@AROUND
def test_a_pause_of_three_usual_intervals_is_reported(share: float) -> None:
    started = np.cumsum([0.0, 7.0, 7.0, 21.0 * share, 7.0, 7.0]).tolist()
    rig = TrackedRig(
        name="rig", campaigns=campaigns([""] * 6, started), version="1", waiting=0, tracks={}, incidents=(),
    )  # fmt: skip
    here = Incident(rig="rig", changes=(), named=(), last_before=2, first_after=3, first=3, alarm=4)
    assert bool(_pause(rig, here)) is (share > 1.0)


@pytest.mark.parametrize(("rigs", "allowed"), [(50, 1.0), (3, 3.0 / 48.0)])
def test_false_alarms_a_month_are_one_of_the_fleet_or_one_of_each_rig_in_four_years(rigs: int, allowed: float) -> None:
    assert followed(drawn_fleet(1, rigs=rigs, campaigns=4), "coulomb").false_per_month == allowed
