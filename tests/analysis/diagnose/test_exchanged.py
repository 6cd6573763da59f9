"""Exchanged sensors beside an effect in the rig."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from isorig.analysis.campaign import Campaign
from isorig.analysis.diagnose import exchanged as module
from isorig.analysis.diagnose.diagnosis import diagnose
from isorig.analysis.diagnose.exchanged import exchanged_sensors
from isorig.analysis.diagnose.suspects import BROKEN
from isorig.analysis.equations.system import HOLDS, equations_of
from tests.small_rigs import chain, guessed, late, played, rubbing

#: Dry friction in N beside the chain's spring to the ground, as large as the force of that spring.
FRICTION = 12.0


def exchanged(campaign: Campaign, one: str, other: str) -> Campaign:
    """The same with the records of two channels exchanged."""
    return replace(
        campaign,
        runs=tuple(
            replace(
                run,
                channels={
                    **run.channels,
                    one: replace(run.channel(other), name=one),
                    other: replace(run.channel(one), name=other),
                },
            )
            for run in campaign.runs
        ),
    )


@pytest.mark.parametrize("pair", [("a0", "a1"), pytest.param(("a1", "a2"), marks=pytest.mark.study)])
def test_an_exchange_beside_strong_friction(pair: tuple[str, str]) -> None:
    campaign, given = exchanged(played(rubbing(chain(), "l0", FRICTION), seed=1), *pair), guessed(chain(), 2)
    found = diagnose(campaign, given)
    assert [(doubt.kind, doubt.parameter) for doubt in found.doubts] == [("swapped", f"channels.{pair[0]}/{pair[1]}")]
    assert (found.verdict, found.steps) == ("unexplained", ())


@pytest.mark.parametrize(
    "model", [chain(), rubbing(chain(), "l0", FRICTION), rubbing(chain(), "l1", FRICTION), late(chain(), 0.01)]
)
def test_no_exchange_where_there_is_none(model: Any) -> None:
    campaign, given = played(model, seed=3), guessed(chain(), 4)
    assert exchanged_sensors(campaign, given, equations_of(campaign, given)) == ()


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        ([BROKEN, 99.0, 99.0, 99.0], [0.99 * HOLDS, 0.99 * HOLDS, 99.0, 99.0], True),
        ([0.99 * BROKEN, 99.0, 99.0, 99.0], [0.99 * HOLDS, 0.99 * HOLDS, 99.0, 99.0], False),
        ([BROKEN, 99.0, 99.0, 99.0], [0.99 * HOLDS, HOLDS, 99.0, 99.0], False),
        ([99.0] * 5, [1.0, 1.0, 99.0, 99.0, 99.0], False),
        ([99.0, 99.0], [1.0, 99.0], False),
        ([99.0], [1.0], False),
    ],
)
def test_at_least_two_equations_and_half_of_them_are_repaired(
    before: list[float], after: list[float], told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def equations(residuals: list[float]) -> Any:
        return SimpleNamespace(hidden=(), residuals=lambda: dict(enumerate(residuals)))

    monkeypatch.setattr(module, "equations_of", lambda campaign, model: equations(after))
    assert bool(exchanged_sensors(Campaign(runs=(), source=""), chain(), equations(before))) == told
