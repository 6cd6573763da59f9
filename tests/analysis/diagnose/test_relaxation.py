"""Relaxation is proposed at every spring once, and its fit finds the hidden stiffness and time."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from small_rigs import Take, chain, played, with_law

from isorig.analysis import laws
from isorig.analysis.diagnose.causes.relaxation import Relaxation, natural
from isorig.analysis.diagnose.kinds import kind_of
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.residuals import Problem
from isorig.analysis.fitting.solve import fit
from isorig.rig.wire_bonder.description import wire_bonder


@dataclass
class Sampled:
    sample_rate: float = 1024.0
    deflection: dict[str, float] = field(default_factory=dict)


def test_it_is_proposed_at_every_spring_once() -> None:
    found = Relaxation().candidates(wire_bonder(), Sampled())
    assert [c.location for c in found] == ["table", "heatblock", "isolation"]
    for candidate in found:
        for start in candidate.starts:
            for free in candidate.free:
                assert free.low < start.get(free.path) < free.high
    again = Relaxation().candidates(found[0].starts[0], Sampled())
    assert [c.location for c in again] == ["heatblock", "isolation"]
    assert kind_of("relaxation") == "memory"


def test_its_time_is_that_of_the_lighter_body_on_its_link() -> None:
    model = wire_bonder()
    assert natural(model, model.link("heatblock")) == pytest.approx(2 * np.pi * 164.5)
    assert natural(model, model.link("isolation")) == pytest.approx(2 * np.pi * 5.06)


def test_a_fit_finds_the_hidden_stiffness_and_time() -> None:
    hidden = laws.Maxwell(relaxation_stiffness=1500.0, relaxation_time=0.015)
    problem = Problem(prepare(played(with_law(chain(), "l1", hidden), seed=1, takes=(Take(3.0, 1),)), chain()))
    candidate = next(c for c in Relaxation().candidates(chain(), Sampled(sample_rate=400.0)) if c.location == "l1")
    costs = np.nansum(problem.residuals(candidate.starts) ** 2, axis=1)
    found = fit(candidate.starts[int(np.argmin(costs))], candidate.parameters(chain()), problem).model
    assert found.get(candidate.free[0].path) == pytest.approx(1500.0, rel=0.02)
    assert found.get(candidate.free[1].path) == pytest.approx(0.015, rel=0.02)
    assert found.get("links.l1.stiffness") == pytest.approx(chain().get("links.l1.stiffness"), rel=0.01)
