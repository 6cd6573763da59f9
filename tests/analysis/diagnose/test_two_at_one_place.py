"""Play and dry friction at one place are found by forms that are fitted to the recorded force together."""

from __future__ import annotations

import pytest
from small_rigs import chain, guessed, played, rubbing, with_law

from isorig.analysis import laws
from isorig.analysis.deadline import Deadline
from isorig.analysis.diagnose.diagnosis import diagnose

CLEARANCE, FRICTION = 2e-4, 0.3


@pytest.mark.study
def test_play_with_friction_beside_it_is_named_without_a_simulated_curve() -> None:
    truth = rubbing(with_law(chain(), "l1", laws.Backlash(clearance=CLEARANCE, residual=0.0)), "l1", FRICTION)
    said: list[str] = []
    with Deadline(120.0):
        found = diagnose(played(truth, seed=5), guessed(chain(), 5), progress=said.append)
    values = {step.cause: step.parameters for step in found.steps}
    assert (found.verdict, set(values)) == ("explained", {"backlash", "coulomb_friction"})
    assert values["backlash"]["clearance"][0] == pytest.approx(CLEARANCE, rel=0.01)
    assert values["coulomb_friction"]["friction_force"][0] == pytest.approx(FRICTION, rel=0.01)
    assert not any("_shape" in line for line in said if line.startswith("fitting"))
