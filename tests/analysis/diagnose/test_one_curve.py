"""Two forms of one kind at one place are an attempt at one curve; friction's laws refine each other instead."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from isorig.analysis.diagnose import diagnosis
from isorig.analysis.diagnose.diagnosis import _with_one_curve


def stage(kind: str, place: str, *, curve: bool = True) -> Any:
    step = SimpleNamespace(kind=kind, place=(kind, place))
    return SimpleNamespace(step=step, curve=f"curve at {place}" if curve else None, score=f"score of {place}")


@pytest.fixture
def stages(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    monkeypatch.setattr(diagnosis, "_stage", lambda before, found: (before, found))
    baseline = SimpleNamespace(step=None, curve=None, score="score of baseline")
    return [baseline, stage("spring_shape", "wall"), stage("sensor", "x")]


def test_a_second_spring_at_one_place_makes_both_a_curve(stages: list[Any]) -> None:
    kept, merged = _with_one_curve(stages, stage("spring_shape", "wall").step)
    assert merged
    assert kept == [stages[0], ("score of baseline", "curve at wall")]


@pytest.mark.parametrize(("kind", "place"), [("spring_shape", "rail"), ("damping_shape", "wall"), ("sensor", "x")])
def test_other_kinds_and_places_stand_as_they_are(stages: list[Any], kind: str, place: str) -> None:
    assert _with_one_curve(stages, stage(kind, place).step) == (stages, False)


def test_without_a_free_shape_nothing_replaces_the_form(stages: list[Any]) -> None:
    stages[1] = stage("spring_shape", "wall", curve=False)
    assert _with_one_curve(stages, stage("spring_shape", "wall").step) == (stages, False)


def test_friction_laws_refine_each_other(stages: list[Any]) -> None:
    stages[1] = stage("friction_shape", "wall")
    assert _with_one_curve(stages, stage("friction_shape", "wall").step) == (stages, False)
