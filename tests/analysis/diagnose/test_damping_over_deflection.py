"""A damping that depends on the deflection has no catalogued form: it is named with its curve."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.diagnose import search
from isorig.analysis.diagnose.diagnosis import diagnose
from isorig.analysis.diagnose.search import Job, Source, sources
from isorig.analysis.errors import ModelError, OutOfTimeError
from isorig.analysis.fitting.ladder import Running
from isorig.analysis.model.rig_model import Body, Drive, Link, RigModel, Sensor

RATE, SAMPLES, SEED = 200.0, 2000, 6100
MASS, STIFFNESS, DAMPING, RISE = 2.0, 3000.0, 4.0, 8e5  #: kg, N/m, N s/m, N s/m^3


def mount() -> RigModel:
    return RigModel(
        name="mount",
        bodies=(Body(name="mass", mass=MASS),),
        links=(Link(name="mount", a="mass", stiffness=STIFFNESS, damping=DAMPING),),
        drive=Drive(channel="force", factor=1.0, pushes={"mass": 1.0}),
        sensors=(Sensor(channel="x", body="mass", quantity="displacement"),),
        free=("links.mount.stiffness", "links.mount.damping"),
    )


def played(gain: float, draw: np.random.Generator) -> dict[str, FloatArray]:
    """A random force on a mass whose damping is c + r d^2, integrated by an explicit method of order 8."""
    time = np.arange(SAMPLES) / RATE
    tones = np.arange(10, 200)
    phases = draw.uniform(0.0, 2.0 * np.pi, len(tones))

    def force(t: float) -> float:
        size = gain * np.sqrt(2.0 / len(tones)) * min(t, 1.0)
        return float(size * np.cos(2.0 * np.pi * tones * RATE / SAMPLES * t + phases).sum())

    def motion(t: float, state: FloatArray) -> list[float]:
        d, v = state
        return [v, (force(t) - STIFFNESS * d - (DAMPING + RISE * d**2) * v) / MASS]

    solved = solve_ivp(motion, (0.0, time[-1]), [0.0, 0.0], "DOP853", t_eval=time, rtol=1e-9, atol=1e-12)
    records = {"force": np.array([force(t) for t in time]), "x": solved.y[0]}
    return {name: record + 1e-3 * record.std() * draw.normal(size=SAMPLES) for name, record in records.items()}


@pytest.fixture(scope="module")
def recorded() -> Campaign:
    """Two levels, and what sensors with 0.1 % of noise record."""
    draw, units, runs = np.random.default_rng(SEED), {"force": ("force", "N"), "x": ("displacement", "m")}, []
    for k, gain in enumerate((4.0, 12.0)):
        channels = {
            name: Channel(name=name, samples=samples, quantity=units[name][0], unit=units[name][1])
            for name, samples in played(gain, draw).items()
        }
        runs.append(Run(id=f"r{k}", configuration="unlocked", sample_rate=RATE, gain=gain, channels=channels))
    return Campaign(runs=tuple(runs), source="mount")


class Late:
    """A source of candidates that is asked after the time has ended."""

    @property
    def forms(self) -> Running:
        raise OutOfTimeError("the time limit was reached")


@pytest.mark.parametrize("explains", [True, False])
def test_it_is_named_with_its_curve_whether_or_not_the_time_ends_before_other_places_are_asked(
    explains: bool, recorded: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A curve that explains most at the place that the equations show ends the search for others; else the time does."""
    asked: list[Job] = []

    def first_and_late(job: Job) -> Iterator[Source]:
        yield next(iter(sources(job)))
        asked.append(job)
        yield cast("Source", Late())

    monkeypatch.setattr(search, "sources", first_and_late)
    if not explains:
        monkeypatch.setattr(Job, "removes_most", lambda job, entry: False)
    found = diagnose(recorded, mount())
    assert [(step.kind, step.location, step.form) for step in found.steps] == [("damping_shape", "mount", None)]
    assert bool(asked) != explains
    assert found.extended_error < 0.1 * found.baseline_error
    curve = found.steps[0].curve
    assert curve is not None
    assert (curve.over, curve.unit, curve.value_unit) == ("deflection", "m", "N s/m")
    d, damping, _ = np.array(curve.points).T
    used = np.abs(d) < 0.7 * curve.reached[1]
    np.testing.assert_allclose(damping[used], (DAMPING + RISE * d**2)[used], atol=0.06 * RISE * d[used].max() ** 2)


def test_a_damping_over_speed_is_a_curve_of_the_force() -> None:
    with pytest.raises(ModelError, match="give one over deflection or time"):
        laws.Curve(over="speed", at=(0.0, 1.0), values=(0.0, 1.0), of="damping")
