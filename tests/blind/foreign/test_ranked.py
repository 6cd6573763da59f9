"""The equations of motion alone show place and kind on rigs of another simulator; `ranked.py` counts more of them."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from foreign_campaign import Setting
from ranked import Outcome, answers, outcomes, table
from ranked import outcome as outcome_of
from rigs import FAMILIES


def test_a_clear_cause_ranks_first(clear: tuple[Path, Path]) -> None:
    found = outcome_of(*clear)
    assert found.outcome == "first", found.suspected


@pytest.mark.parametrize(("family", "seed"), [pytest.param("wire_bonder", 5, marks=pytest.mark.study), ("stage", 4)])
def test_nothing_is_shown_of_a_sound_rig(
    family: str, seed: int, campaign_of: Callable[[str, str, int], tuple[Path, Path]]
) -> None:
    found = outcome_of(*campaign_of(family, "none", seed))
    assert found.outcome == "silent", found.suspected


def outcome(result: str, *, soiled: bool, effects: list[dict[str, object]]) -> Outcome:
    truth: dict[str, object] = {"severity": 1.0, "soiled": soiled, "effects": effects, "disturbances": []}
    return Outcome(truth=truth, outcome=result, residuals={}, suspected=[], seconds=0.0)


def test_the_table_counts_by_group() -> None:
    one = {"effect": "iwan", "cause": None, "kinds": ["memory"], "place": "l0"}
    lines = table([outcome("first", soiled=False, effects=[one]), outcome("wrong", soiled=False, effects=[one])]).splitlines()
    assert lines[1].split() == ["foreign", "form,", "full", "size,", "clean", "1", "0", "1", "0", "0"]


def test_a_wrong_mass_of_the_head_is_a_gain_of_its_channel_too() -> None:
    one = {"effect": "wrong_mass", "cause": "wrong_mass", "kinds": ["known_value"], "place": "head"}
    right, _ = answers({"effects": [one], "disturbances": []})
    assert right == {("known_value", "head"), ("sensor", "head")}


@pytest.mark.study
@pytest.mark.timeout(3600)
def test_hardly_any_place_or_kind_is_wrong() -> None:
    found = list(outcomes(list(FAMILIES), range(70), Setting(soiled=False)))
    assert sum(one.outcome == "wrong" for one in found) <= 2, table(found)
