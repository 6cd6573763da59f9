"""Values that hardly any rig has are said: at the end of a range, a decade off, off by a unit's factor."""

from __future__ import annotations

from dataclasses import replace
from math import inf, pi

import numpy as np
import pytest
from msgspec.structs import replace as replace_struct

from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.analysis.fitting.plausible import DECADE, EXPLAINS, NEAR, doubts, explains_as_given, unit_factor
from isorig.analysis.fitting.solve import Fit, Free
from isorig.analysis.laws import Cubic
from isorig.analysis.model.rig_model import Body, Configuration, Link, RigModel, Sensor, from_tree
from isorig.rig.wire_bonder.description import FREE, FRICTION, THESIS, wire_bonder
from isorig.rig.wire_bonder.session import VirtualRun, virtual_campaign

TAKES = (VirtualRun(id="u70", configuration="unlocked", gain=70.0, seconds=10.0, start=0.0),)


def chain() -> RigModel:
    return from_tree(
        {
            "name": "chain",
            "free": ["bodies.block.mass", "links.foot.stiffness", "links.foot.damping"],
            "bodies": [{"name": "block", "mass": 10.0}],
            "links": [{"name": "foot", "a": "block", "b": "ground", "stiffness": 4e4, "damping": 40.0}],
            "drive": {"channel": "force", "quantity": "force", "factor": 1.0, "pushes": {"block": 1.0}},
            "sensors": [{"channel": "block", "body": "block"}],
        }
    )


def fitted(model: RigModel, values: dict[str, float], **ends: tuple[float, float]) -> Fit:
    free = tuple(
        Free(path=path, low=ends.get(path.split(".")[-1], (0.0, inf))[0], high=ends.get(path.split(".")[-1], (0.0, inf))[1])
        for path in model.free
    )
    return Fit(model=model.replace(values), free=free, covariance=np.zeros((len(free),) * 2), cost=1.0, evaluations=1)


@pytest.mark.parametrize("factor", [9.80665, 1000.0, 25.4, 180.0 / pi, 1e6])
def test_factors_of_units(factor: float) -> None:
    """The ratio or its inverse, up to the share by which what was given may be off."""
    for ratio in (factor, 1.0 / factor, factor * (1.0 + 0.99 * NEAR), factor / (1.0 + 0.99 * NEAR)):
        found = unit_factor(ratio)
        assert found is not None
        assert found[0] == factor
    for ratio in (factor * (1.0 + 1.01 * NEAR), 1.0, 2.0, 100.0):
        found = unit_factor(ratio)
        assert found is None or found[0] != factor


@pytest.mark.parametrize(
    ("scale", "kind", "said"),
    [
        (1000.0, "unit", "N and kN"), (1.0 / 9.80665, "unit", "g and m/s^2"), (100.0, "decade", "100 times"),
        (DECADE * 1.3, "decade", "13 times"), (0.7 * DECADE, None, ""), (2.0, None, ""),
    ],
)  # fmt: skip
def test_everything_a_factor_off(scale: float, kind: str | None, said: str) -> None:
    values = {"bodies.block.mass": 10.0 * scale, "links.foot.stiffness": 4e4 * scale, "links.foot.damping": 1e6}
    found = doubts(chain(), (fitted(chain(), values),))
    assert [doubt.kind for doubt in found] == ([] if kind is None else [kind])
    if kind:
        assert "All fitted masses and stiffnesses" in found[0].text
        assert said in found[0].text
        assert "check the unit of the drive channel force" in found[0].text


def test_one_known_mass_sets_the_scale_of_all_records() -> None:
    other, foot = Body(name="other", mass=1.0), Link(name="other foot", a="other", stiffness=1e4)
    known = replace_struct(chain(), bodies=(*chain().bodies, other), links=(*chain().links, foot))
    assert explains_as_given(known, fitted(known, {}))
    free = replace_struct(known, free=(*known.free, "bodies.other.mass"))
    assert not explains_as_given(free, fitted(free, {}))


def test_one_known_value_a_decade_off() -> None:
    (doubt,) = doubts(chain(), (fitted(chain(), {"bodies.block.mass": 150.0, "links.foot.stiffness": 5e4}),))
    assert (doubt.kind, doubt.parameter) == ("decade", "bodies.block.mass")
    assert "150, 15 times the given 10" in doubt.text


def test_an_end_of_a_range() -> None:
    """At the end within a thousandth; a damping that vanishes is no doubt."""
    ends = {"damping": (0.04, 4e4)}
    for value, said in ((4e4, 1), (4e4 * 0.9995, 1), (4e4 * 0.99, 0), (0.04, 0)):
        found = doubts(chain(), (fitted(chain(), {"links.foot.damping": value}, **ends),))
        assert [doubt.kind for doubt in found] == ["limit"] * said
    (limit,) = doubts(chain(), (fitted(chain(), {"links.foot.damping": 0.5}, damping=(0.0, 0.5)),))
    assert (limit.kind, limit.parameter) == ("limit", "links.foot.damping")
    found = doubts(chain(), (fitted(chain(), {"bodies.block.mass": 5.0}, mass=(5.0, 5e3)),))
    assert [doubt.kind for doubt in found] == ["limit"]


def test_an_end_of_the_range_of_a_cause_is_no_doubt_about_the_description() -> None:
    """A hysteresis without a limit of its sharpness is an elastic slip."""
    own = Free(path="links.foot.laws.0.cubic_stiffness", low=0.0, high=7.0)
    hard = fitted(chain(), {"links.foot.stiffness": 4e4})
    link = replace_struct(hard.model.link("foot"), laws=(Cubic(cubic_stiffness=7.0),))
    with_cause = replace(
        hard, model=replace_struct(hard.model, links=(link,)), free=(*hard.free, own), covariance=np.zeros((4, 4))
    )
    assert doubts(chain(), (with_cause,)) == ()


def test_friction_a_unit_off() -> None:
    """A wire bonder whose channels are all read in g as m/s^2 differs in its friction alone."""
    rig = wire_bonder()
    assert rig.free == (*FREE, FRICTION)
    (doubt,) = doubts(rig, (fitted(rig, {FRICTION: THESIS["friction_force"] / 9.81}),))
    assert doubt.kind == "unit"
    assert not doubts(rig, (fitted(rig, {FRICTION: THESIS["friction_force"] / 4.0}),))


@pytest.mark.parametrize(("scale", "doubted"), [(1.0, False), (1e3, True)])
def test_levels_of_a_released_body(scale: float, doubted: bool) -> None:
    """A position in millimetres that is read as metres: the free decay in closed form from 10 mm."""
    position = (Sensor(channel="block", body="block", quantity="displacement"),)
    setup = {"normal": Configuration(initial_position={"block": 0.01})}
    rig = replace_struct(chain(), sensors=position, configurations=setup)
    time, rate, own = np.arange(2048) / 512.0, 40.0 / (2.0 * 10.0), np.sqrt(4e4 / 10.0)
    turn = np.sqrt(own**2 - rate**2)
    x = 0.01 * np.exp(-rate * time) * (np.cos(turn * time) + rate / turn * np.sin(turn * time))
    channels = {
        "force": Channel(name="force", samples=np.zeros(len(time)), quantity="force", unit="N"),
        "block": Channel(name="block", samples=scale * x, quantity="displacement", unit="m"),
    }
    run = Run(id="r", configuration="normal", sample_rate=512.0, gain=1.0, channels=channels, excitation="free")
    found = doubts(rig, (), Campaign(runs=(run,)))
    assert [doubt.parameter for doubt in found] == ["sensors.block"] * doubted


def test_levels_of_records() -> None:
    """A sound session has none, not even if a fit misfits; a head in g, or one sensor in g, is named."""
    rig, campaign = wire_bonder(), virtual_campaign(wire_bonder(), TAKES, seed=1)
    assert not doubts(rig, (), campaign)
    odd = fitted(rig, {"links.heatblock.stiffness": 10.0 * rig.get("links.heatblock.stiffness")})
    assert [doubt.parameter for doubt in doubts(rig, (replace(odd, cost=EXPLAINS),), campaign)] == ["links.heatblock.stiffness"]
    assert not doubts(rig, (replace(odd, cost=1.01 * EXPLAINS),), campaign)
    (doubt,) = doubts(wire_bonder({**THESIS, "head_mass": 6.5 / 9.81, "friction_force": 20.0 / 9.81}), (), campaign)
    assert doubt.parameter == "drive.head"
    assert "check the unit of the drive channel head" in doubt.text
    (run,) = campaign.runs
    table = replace(run.channels["table"], scale=run.channels["table"].scale / 9.81)
    read_wrong = replace(campaign, runs=(replace(run, channels={**run.channels, "table": table}),))
    (doubt,) = doubts(rig, (), read_wrong)
    assert "check the unit of table" in doubt.text
