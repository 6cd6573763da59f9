"""Hysteresis is proposed at every sliding link once, replaces dry friction there, and its fit finds the hidden loop."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from msgspec.structs import replace
from small_rigs import Take, chain, played

from isorig.analysis import laws
from isorig.analysis.diagnose.causes.base import WeakestSizes
from isorig.analysis.diagnose.causes.hysteresis import Hysteresis
from isorig.analysis.diagnose.kinds import kind_of
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.residuals import Problem
from isorig.analysis.fitting.solve import fit
from isorig.analysis.model.rig_model import Contact
from isorig.rig.wire_bonder.description import wire_bonder


@dataclass
class Swings:
    deflection: dict[str, float] = field(default_factory=lambda: {"isolation": 2e-3, "l0": 1e-3, "l1": 1e-3, "l2": 1e-3})
    speed: dict[str, float] = field(default_factory=lambda: {"isolation": 0.1, "l0": 0.1, "l1": 0.1, "l2": 0.1})


def test_it_replaces_dry_friction_and_is_proposed_once() -> None:
    [found] = Hysteresis().candidates(wire_bonder(), Swings())
    assert found.location == "isolation"
    for start in found.starts:
        assert isinstance(start.contact("isolation").law, laws.BoucWen)
        for free in found.free:
            assert free.low < start.get(free.path) < free.high
    assert not any(free.path.endswith("friction_force") for free in found.parameters(wire_bonder()) if free not in found.free)
    assert Hysteresis().candidates(found.starts[0], Swings()) == ()
    assert kind_of("hysteresis") == "memory"


def test_it_resists_the_elongation_of_a_link_with_arms() -> None:
    rig = replace(chain(), links=tuple(replace(x, arms={"m0": 0.5}) if x.name == "l1" else x for x in chain().links))
    found = next(c for c in Hysteresis().candidates(rig, Swings()) if c.location == "l1")
    assert found.starts[0].contact("l1").arms == {"m0": 0.5}


def test_its_size_keeps_the_level_of_a_dry_friction_and_is_a_share_of_the_spring_elsewhere() -> None:
    bonder = wire_bonder().replace({"contacts.isolation.law.friction_force": 9.0})
    there = Hysteresis().sized(bonder, Swings(), "isolation", 1.0, WeakestSizes())
    assert there.parameters["friction_force"] == 9.0
    elsewhere = Hysteresis().sized(chain(), Swings(), "l1", 0.5, WeakestSizes())
    link = chain().link("l1")
    assert elsewhere.parameters["friction_force"] == pytest.approx(0.5 * 0.06 * max(link.stiffness * 1e-3, link.damping * 0.1))


def test_a_fit_finds_the_hidden_loop() -> None:
    law = laws.BoucWen(friction_force=0.4, initial_stiffness=2e3, sharpness=2.0, pinching=0.6)
    link = chain().link("l1")
    hidden = replace(chain(), contacts=(*chain().contacts, Contact(name="l1", a=link.a, b=link.b, law=law)))
    problem = Problem(prepare(played(hidden, seed=1, takes=(Take(3.0, 1),)), chain()))
    candidate = next(c for c in Hysteresis().candidates(chain(), Swings()) if c.location == "l1")
    costs = np.nansum(problem.residuals(candidate.starts) ** 2, axis=1)
    found = fit(candidate.starts[int(np.argmin(costs))], candidate.parameters(chain()), problem).model.contact("l1").law
    assert found.friction_force == pytest.approx(law.friction_force, rel=0.05)
    assert found.initial_stiffness == pytest.approx(law.initial_stiffness, rel=0.05)
    assert found.sharpness == pytest.approx(law.sharpness, rel=0.2)
    assert found.pinching == pytest.approx(law.pinching, abs=0.1)


@pytest.mark.parametrize(("sharpness", "pinching"), [(1.0, 1.0), (1.5, 0.7), (3.0, 0.5), (10.0, 0.5)])
def test_the_force_along_a_motion_is_that_of_the_rates(sharpness: float, pinching: float) -> None:
    law = laws.BoucWen(friction_force=4.0, initial_stiffness=4e3, sharpness=sharpness, pinching=pinching)
    t = np.arange(1500) / 500.0
    d = 4e-3 * np.sin(2.0 * np.pi * 5.0 * t) * np.sin(2.0 * np.pi * 0.9 * t) + 3e-4 * np.sin(2.0 * np.pi * 31.0 * t)
    d[700:720] = d[700]
    v = np.diff(d, prepend=d[:1]) * 500.0
    # By Runge-Kutta steps of a constant velocity in each sample.
    want, z, h = np.zeros(len(v)), law.begun(), 1.0 / (500.0 * 20.0)
    for k, speed in enumerate(v):
        for _ in range(20):
            first = law.rates(0.0, speed, z)
            second = law.rates(0.0, speed, z + 0.5 * h * first)
            third = law.rates(0.0, speed, z + 0.5 * h * second)
            z = z + h / 6.0 * (first + 2.0 * second + 2.0 * third + law.rates(0.0, speed, z + h * third))
        want[k] = 4.0 * z[0]
    assert law.along(d, v, 500.0) == pytest.approx(want, abs=4e-4 * 4.0)
