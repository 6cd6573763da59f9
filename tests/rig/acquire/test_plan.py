"""Plans with anything in them: refused in a sentence, or sound enough that every drive can be made."""

from __future__ import annotations

import copy
import tomllib
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isorig.analysis.model.limits import Limits
from isorig.rig.acquire.drive import check_limits, drive_of
from isorig.rig.acquire.plan import Plan, RunPlan, plan_of
from isorig.rig.acquire.plan_check import check_plan
from isorig.rig.errors import PlanError

ROOT = Path(__file__).resolve().parents[3]
TREE = tomllib.loads((ROOT / "isorig" / "rig" / "acquire" / "demo.toml").read_text(encoding="utf-8"))
#: What TOML can hold.
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats() | st.text(max_size=8)
    | st.sampled_from(["", "a/b", "multisine", "moves", "di1100", "sr785", "locked", "gain", "[rig]", 1e308, 1e-308, 0, -1]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=4,
)  # fmt: skip


def places(tree: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The paths of everything in a tree."""
    inner = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    return [path for key, value in inner for path in ((*at, key), *places(value, (*at, key)))]


@settings(max_examples=400, deadline=None)
@given(st.data())
def test_any_plan_is_refused_or_can_be_played(data: st.DataObject) -> None:
    tree = copy.deepcopy(TREE)
    tree["runs"] = tree["runs"][:1]
    for _ in range(data.draw(st.integers(1, 2))):
        *path, last = data.draw(st.sampled_from(places(tree)))
        part = tree
        for key in path:
            part = part[key]
        if data.draw(st.booleans()):
            part[last] = data.draw(VALUES)
        elif isinstance(part, dict):
            new = data.draw(
                st.sampled_from(
                    ["period", "band", "seed", "use", "repeats", "excitation", "shows", "baud_rate", "usable_to", "x"]
                )
            )
            part[new] = data.draw(VALUES)
    with suppress(msgspec.ValidationError, PlanError):
        plan = plan_of(tree)
        check_plan(plan, "plan.toml")
        _play(plan)


def _play(plan: Plan) -> None:
    (run,) = plan.runs
    if run.ticks(plan.instrument.sample_rate) < 1_000_000:
        drive = drive_of(run, 0, plan.instrument.sample_rate)[:]
        assert len(drive) == (run.ticks(plan.instrument.sample_rate) if run.played else 1)


def test_a_negative_seed_is_refused() -> None:
    tree = copy.deepcopy(TREE)
    tree["runs"][0]["seed"] = -1
    with pytest.raises(PlanError, match=r"has seed -1; give 0 or more"):
        check_plan(plan_of(tree), "plan.toml")


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"repeat_of": "u35"}, r"has repeat_of 'u35'; give the id of a run before it \(u70\)"),
        ({"repeat_of": "u70-again"}, r"has repeat_of 'u70-again'; give the id of a run before it \(u70\)"),
        ({"gain": 35.0}, r"repeats 'u70' with gain 35.0, not 70.0; a repeat has the same gain"),
        ({"configuration": "locked"}, r"repeats 'u70' with configuration locked, not unlocked"),
        ({"seconds": 20.0}, r"repeats 'u70' with seconds 20.0, not 40.0"),
        ({"excitation": "multisine"}, r"repeats 'u70' with excitation multisine, not random"),
        ({"band": [0.5, 30.0]}, r"repeats 'u70' with band \(0.5, 30.0\), not \(0.5, 20.0\)"),
        ({"seed": 9}, r"repeats 'u70' with seed 9, not 1; remove seed"),
        ({"excitation": "free"}, r"has repeat_of but no drive that is played"),
        ({"seed": 1}, ""),
    ],
)
def test_a_repeat_is_of_an_earlier_run_alike(changed: dict[str, Any], told: str) -> None:
    tree = copy.deepcopy(TREE)
    tree["runs"][1] |= changed
    if not told:
        check_plan(plan_of(tree), "plan.toml")
        return
    with pytest.raises(PlanError, match=told):
        check_plan(plan_of(tree), "plan.toml")


@pytest.mark.parametrize(("limits", "says"), [
    ({"gains": (0.0, 69.0)}, r"has the gain 70.*limits\.gains allows 0 to 69"),
    ({"band": (1.0, 20.0)}, r"has the band \[0\.5, 20\.0\].*limits\.band allows 1 to 20"),
    ({"drive": 5.0}, r"drives the rig with up to .* m/s\^2; limits\.drive allows 5, so lower its gain"),
    ({"gains": (0.0, 70.0), "band": (0.5, 20.0), "drive": 100.0}, ""),
])  # fmt: skip
def test_a_drive_beyond_the_rigs_limits_is_refused(limits: dict[str, object], says: str) -> None:
    random = {"id": "a", "configuration": "unlocked", "gain": 70.0, "band": [0.5, 20.0], "seconds": 4.0}
    run = msgspec.convert(random, RunPlan)
    drive = drive_of(run, 0, 1024.0)
    if not says:
        check_limits(run, drive, Limits(**limits))  # type: ignore[arg-type]
        # At the boundary: the largest value itself is allowed.
        highest = run.gain * float(np.abs(drive[0 : len(drive)]).max())
        check_limits(run, drive, Limits(drive=highest))
        return
    with pytest.raises(PlanError, match=says):
        check_limits(run, drive, Limits(**limits))  # type: ignore[arg-type]


@pytest.mark.parametrize(("usable", "allowed"), [(512.0, True), (512.1, False), (0.0, False), (-1.0, False)])
def test_the_usable_band_lies_between_zero_and_half_the_sample_rate(usable: float, allowed: bool) -> None:
    tree = copy.deepcopy(TREE)
    tree["instrument"] |= {"sample_rate": 1024.0, "usable_to": usable}
    if allowed:
        check_plan(plan_of(tree), "plan.toml")
        assert plan_of(tree).instrument.usable_to == usable
    else:
        with pytest.raises(PlanError, match="usable_to is"):
            check_plan(plan_of(tree), "plan.toml")
