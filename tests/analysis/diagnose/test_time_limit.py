"""The limit of processor time ends the ranking of the equations of motion, too; it continues where it ended."""

from __future__ import annotations

import pytest
from small_rigs import chain, guessed, played, rubbing

from isorig.analysis.campaign import Campaign
from isorig.analysis.deadline import Deadline
from isorig.analysis.diagnose import diagnosis
from isorig.analysis.diagnose.diagnosis import diagnose
from isorig.analysis.equations import ranking as ranking_module
from isorig.analysis.equations.ranking import Ranking, Regressions, ranking
from isorig.analysis.equations.system import equations_of
from isorig.analysis.errors import OutOfTimeError
from isorig.analysis.model.rig_model import RigModel


@pytest.fixture(scope="module")
def rubbed() -> tuple[Campaign, RigModel]:
    """A chain with friction that its description lacks."""
    return played(rubbing(chain(), "l1", 3.0), seed=7), guessed(chain(), 7)


def listed(found: Ranking) -> list[tuple[str, str, str, float]]:
    """The explanations in their order."""
    return [(item.kind, item.place, item.what, item.score) for item in found.explanations]


def test_nothing_is_ranked_after_the_limit(rubbed: tuple[Campaign, RigModel], monkeypatch: pytest.MonkeyPatch) -> None:
    begun = []
    for name in ("_shape", "_rarer", "_body", "_rocking", "_locks", "_linear_faults", "_nonlinear_fault"):
        monkeypatch.setattr(Regressions, name, lambda self, *given, name=name, **more: begun.append(name))
    monkeypatch.setattr(diagnosis, "LEAST_RANKING", 0.0)
    with Deadline(0.0):
        found = diagnose(*rubbed)
    assert found.cut_short
    assert found.pointed is None
    assert begun == []


def test_an_interrupted_ranking_continues(rubbed: tuple[Campaign, RigModel], monkeypatch: pytest.MonkeyPatch) -> None:
    campaign, model = rubbed
    whole = listed(Regressions(equations_of(campaign, model), ranking_module._Done()).ranked())
    equations, asked, interruptions = equations_of(campaign, model), 0, 0

    def every_fifth() -> None:
        nonlocal asked
        asked += 1
        if asked % 5 == 0:
            raise OutOfTimeError("the time limit is reached")

    monkeypatch.setattr(ranking_module, "ask_time", every_fifth)
    while True:
        try:
            found = ranking(equations)
            break
        except OutOfTimeError:
            interruptions += 1
    assert interruptions > 3
    assert listed(found) == whole
    assert ranking(equations) is found
