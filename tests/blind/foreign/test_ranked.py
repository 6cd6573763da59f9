"""The equations of motion alone show place and kind on rigs of another simulator; `ranked.py` counts more of them."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from foreign_campaign import Setting
from ranked import Outcome, answers, outcomes, table

#: A cause of each family of rigs, among them forms outside the catalogue.
CLEAR = {
    "wire_bonder": "moment_coupling", "chain": "coulomb_friction", "cart": "hardening_stiffness", "stage": "slow sensor",
    "torsion": "hardening_stiffness", "base": "mains_hum", "partial": "mains_hum",
}  # fmt: skip


@pytest.mark.parametrize(("family", "effect"), CLEAR.items())
def test_a_clear_cause_ranks_first(family: str, effect: str) -> None:
    (found,) = outcomes([family], [5], Setting(severity=1.0, soiled=False, effects=(effect,)))
    assert found.outcome == "first", found.suspected


@pytest.mark.parametrize("family", ["wire_bonder", "stage"])
def test_nothing_is_shown_of_a_sound_rig(family: str) -> None:
    (found,) = outcomes([family], [4], Setting(soiled=False, effects=("none",)))
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
    found = list(outcomes(list(CLEAR), range(70), Setting(soiled=False)))
    assert sum(one.outcome == "wrong" for one in found) <= 2, table(found)
