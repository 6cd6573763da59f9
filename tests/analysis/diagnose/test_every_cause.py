"""Every cause of the catalogue: unique, documented, assumed by proposals, and part of the virtual rig's campaigns."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import get_args

import pytest

from isorig.analysis.diagnose.mechanisms import CATALOGUE
from isorig.analysis.diagnose.mechanisms.base import Kind, Mechanism
from isorig.analysis.proposals.hypotheses import SIZED
from isorig.rig.virtual.effects import CAUSES, KINDS

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "diagnosing.md").read_text(encoding="utf-8")
#: Causes for which proposals of further runs assume no size, and why.
NOT_SIZED = {"play_and_friction": "the smallest one is a small clearance, which is assumed as `backlash`"}
#: Causes that no campaign of the virtual wire bonder hides, and why.
NOT_VIRTUAL = {
    "coulomb_friction": "the baseline of the wire bonder has it; campaigns of other rigs hide it",
    "play_and_friction": "`tests/blind/test_other_rigs.py` finds it in the measured record of a friction damper",
}


def name_of(mechanism: Mechanism) -> str:
    return mechanism.cause


def test_names_are_unique_and_differ_from_the_kinds() -> None:
    names = Counter(map(name_of, CATALOGUE))
    assert [name for name, times in names.items() if times > 1] == []
    assert set(names) & set(get_args(Kind)) == set()
    assert all(re.fullmatch("[a-z]+(_[a-z]+)*", name) for name in names), "findings and reports show it in words"


@pytest.mark.parametrize("mechanism", CATALOGUE, ids=name_of)
def test_a_cause_is_complete(mechanism: Mechanism) -> None:
    cause = mechanism.cause
    assert mechanism.kind in get_args(Kind)
    assert type(mechanism).__doc__
    assert f"| `{cause}` | `{mechanism.kind}` | " in PAGE, "docs/diagnosing.md has a row for it"
    assert (cause in SIZED) != (cause in NOT_SIZED), "a size in analysis/proposals/hypotheses.py, or the reason here"
    assert (cause in CAUSES) != (cause in NOT_VIRTUAL), "an effect in rig/virtual/effects.py, or the reason here"


def test_the_tables_have_no_other_names() -> None:
    names = set(map(name_of, CATALOGUE))
    assert set(SIZED) | set(CAUSES) | set(NOT_SIZED) | set(NOT_VIRTUAL) <= names
    assert set(re.findall(r"^\| `(\w+)` \| `\w+` \|", PAGE, re.MULTILINE)) == names


def test_the_order_of_effects_gives_every_campaign_its_seed() -> None:
    assert KINDS[:20] == (
        "none", "stribeck_friction", "presliding_friction", "asymmetric_friction", "hardening_stiffness", "softening_stiffness",
        "backlash", "end_stop", "quadratic_damping", "extra_mode", "moment_coupling", "wrong_mass", "imperfect_lock",
        "stiffness_drift", "channel_delay", "sensor_gain", "clipping", "crosstalk", "mains_hum", "relaxation",
    )  # fmt: skip


def test_the_page_on_causes_lists_every_family() -> None:
    sources = (ROOT / "isorig" / "analysis" / "diagnose" / "mechanisms").glob("*.py")
    families = {name for file in sources for name in re.findall(r'family="(\w+)"', file.read_text(encoding="utf-8"))}
    page = (ROOT / "docs" / "add-cause.md").read_text(encoding="utf-8")
    listed = page.split("*Which family?*")[1].split("\n-")[0]
    assert set(re.findall("`([a-z]+)`", listed)) == families
