"""A cart that reaches the end of a rail without a spring: the stop is a candidate, at one end; integrated here by scipy."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.diagnose.causes.at_link import LinkInRuns
from isorig.analysis.diagnose.causes.end_stop import EndStop, _inside_its_stops, _stiffness
from isorig.analysis.diagnose.diagnosis import diagnose
from isorig.analysis.laws import EndStop as EndStopLaw
from isorig.analysis.model.rig_model import Body, Drive, Link, RigModel, Sensor

SEED, RATE = 8600, 250.0
RIG = RigModel(
    name="two carts", bodies=(Body(name="first", mass=1.4), Body(name="second", mass=1.1)),
    links=(
        Link(name="wall", a="first", stiffness=300.0, damping=2.6),
        Link(name="between", a="first", b="second", stiffness=370.0, damping=1.0),
        Link(name="rail", a="second", damping=1.3),
    ),
    drive=Drive(channel="f", factor=1.0, pushes={"first": 1.0}, quantity="force"),
    sensors=tuple(Sensor(channel=f"x{k}", body=body, quantity="displacement") for k, body in enumerate(("first", "second"))),
    free=("links.wall.stiffness", "links.wall.damping", "links.between.stiffness", "links.between.damping", "links.rail.damping"),
)  # fmt: skip


def recorded(free: float, stiffness: float) -> Campaign:
    runs = []
    for number in range(2):
        draw, n = np.random.default_rng(SEED + number), round(6.0 * RATE)
        t = np.arange(n) / RATE
        force = np.repeat(draw.uniform(-7.0, 7.0, n // 125), 125)

        def rates(time: float, y: FloatArray, force: FloatArray = force) -> list[float]:
            x1, x2, v1, v2 = y
            push = force[min(int(time * RATE), len(force) - 1)]
            between = 340.0 * (x1 - x2) + 0.9 * (v1 - v2)
            stop = stiffness * max(x2 - free, 0.0)
            return [v1, v2, (push - 330.0 * x1 - 2.4 * v1 - between) / 1.4, (between - 1.2 * v2 - stop) / 1.1]

        x = solve_ivp(rates, (0.0, t[-1]), np.zeros(4), t_eval=t, method="RK45", max_step=1e-3, rtol=1e-7, atol=1e-10).y[:2]
        channels = {"f": Channel(name="f", samples=force, quantity="force", unit="N")} | {
            f"x{k}": Channel(name=f"x{k}", samples=row + draw.normal(0.0, 2e-5, n), quantity="displacement", unit="m")
            for k, row in enumerate(x)
        }
        runs.append(Run(id=f"r{number}", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels))
    return Campaign(runs=tuple(runs), source="carts")


def test_a_stop_at_one_end_of_a_rail_is_named() -> None:
    found = diagnose(recorded(0.028, 6000.0), RIG)
    stop = next(step for step in found.steps if (step.cause, step.location) == ("end_stop", "rail"))
    assert stop.parameters["stroke"][0] == pytest.approx(0.028, rel=0.03)
    assert stop.parameters["contact_stiffness"][0] == pytest.approx(6000.0, rel=0.1)
    assert stop.parameters["end"][0] == 1.0


def test_the_size_of_a_stop_without_a_spring_is_that_of_the_motion() -> None:
    """The spring on which the mass would move as far and as fast."""
    runs = SimpleNamespace(deflection={"rail": 0.04, "wall": 0.03}, speed={"rail": 0.6, "wall": 0.5})
    assert EndStop().places(RIG) == ("wall", "between", "rail")
    assert _stiffness(LinkInRuns(RIG, runs, "rail")) == pytest.approx(1.1 * (0.6 / 0.04) ** 2)  # type: ignore[arg-type]
    assert _stiffness(LinkInRuns(RIG, runs, "wall")) == 300.0  # type: ignore[arg-type]


def test_where_no_spring_is_described_a_stop_is_no_play() -> None:
    law = EndStopLaw(stroke=0.03, contact_stiffness=5000.0)
    rig = RIG.replace({})
    stopped = LinkInRuns(rig, None, "rail").having(law)  # type: ignore[arg-type]
    path = "links.rail.laws.0"
    assert _inside_its_stops("rail", path, 0.0, stopped)
    assert not _inside_its_stops("rail", path, 5000.0, stopped)
