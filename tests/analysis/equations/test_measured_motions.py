"""Equations of measured motions in a partly measured rig, and deflections that integrate an accelerometer's errors."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from small_rigs import chain, guessed, played, with_law

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign
from isorig.analysis.equations.ranking import ranking
from isorig.analysis.equations.system import CUT, HOLDS, WANDERING_CUT, equations_of
from isorig.analysis.model.rig_model import RigModel


def without_sensor(model: RigModel, channel: str) -> RigModel:
    """The rig with one sensor less."""
    return msgspec.structs.replace(model, sensors=tuple(sensor for sensor in model.sensors if sensor.channel != channel))


def test_where_a_measured_equation_does_not_hold_only_measured_ones_count() -> None:
    truth = without_sensor(with_law(chain(), "l2", laws.Cubic(cubic_stiffness=4e8)), "a0")
    equations = equations_of(played(truth, seed=31), guessed(without_sensor(chain(), "a0"), 31))
    assert "m2" not in equations.with_estimates
    assert "m1 + m2" in equations.with_estimates
    ranked = ranking(equations)
    assert equations.residuals()["m2"] > HOLDS
    assert list(ranked.residuals) == ["m2"]
    assert (ranked.explanations[0].kind, ranked.explanations[0].place) == ("spring_shape", "l2")


def test_where_the_measured_equations_hold_all_count() -> None:
    truth = without_sensor(with_law(chain(), "l0", laws.Cubic(cubic_stiffness=4e8)), "a0")
    equations = equations_of(played(truth, seed=31), guessed(without_sensor(chain(), "a0"), 31))
    assert equations.residuals()["m2"] < HOLDS
    assert set(ranking(equations).residuals) == set(equations.residuals())


def test_a_link_between_measured_bodies_has_a_measured_equation() -> None:
    """Beyond the last link there is a body without a sensor, so its shortest equation contains an estimate."""
    model = without_sensor(chain(), "a2")
    equations = equations_of(played(model, seed=32), model)
    measured = [one for one in equations.balances if one.name not in equations.with_estimates]
    assert any("l0" in element.names for one in measured for element, _ in one.crossing)


@pytest.mark.parametrize("wander", [0.0, 0.2])
def test_a_deflection_is_cut_where_its_integrated_error_ends(wander: float) -> None:
    campaign = wandering(played(chain(), seed=33), "a0", wander)
    equations = equations_of(campaign, chain())
    element = next(one for one in equations.elements() if one.name == "l0")
    balance = next(one for one in equations.balances if one.contains(element))
    own = equations.own_frequency(element, balance)
    assert equations.grows_below(element, CUT * equations.lowest) is (wander > 0.0)
    equations.wandering = frozenset()  # its zero counts as sound
    found = equations.cut(balance, element)
    assert found == pytest.approx(WANDERING_CUT * equations.lowest) if wander else found <= CUT * own


def wandering(campaign: Campaign, channel: str, share: float) -> Campaign:
    """The campaign with a random walk in a channel, with this share of its rms in each run."""
    draw = np.random.default_rng(34)
    runs = []
    for run in campaign.runs:
        values = run.read(channel)
        walk = np.cumsum(draw.normal(0.0, 1.0, len(values)))
        walk *= share * values.std() / walk.std()
        record = replace(run.channels[channel], samples=(values + walk) / run.channels[channel].scale)
        runs.append(replace(run, channels={**run.channels, channel: record}))
    return replace(campaign, runs=tuple(runs))
