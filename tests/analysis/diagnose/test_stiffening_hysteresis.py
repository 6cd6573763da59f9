"""The published Bouc-Wen oscillator, whose loop has no limit, is named with its values from another integrator's records."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from small_rigs import with_law
from strange_rigs import noise

from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.deadline import Deadline
from isorig.analysis.diagnose.causes.presliding_friction import PreslidingFriction
from isorig.analysis.diagnose.causes.stiffening_hysteresis import StiffeningHysteresis
from isorig.analysis.diagnose.diagnosis import diagnose
from isorig.analysis.equations.system import equations_of
from isorig.analysis.laws import Dahl
from isorig.analysis.laws import StiffeningHysteresis as Law
from isorig.analysis.model.rig_model import RigModel, from_tree

RATE, STEPS = 750.0, 4
#: Noel and Schoukens, Hysteretic benchmark with a dynamic nonlinearity (2016): beta 1e3, gamma 0.8, delta -1.1, nu 1.
MASS, DAMPING, STIFFNESS, ALPHA, DISSIPATION, STIFFENING = 2.0, 10.0, 5e4, 5e4, 800.0, 1100.0


def recorded(drive: FloatArray) -> FloatArray:
    """Displacement of the published oscillator for a force in N at `RATE`, linear between samples, by Runge-Kutta steps."""
    x = v = z = 0.0
    found, h = np.zeros(len(drive)), 1.0 / (RATE * STEPS)

    def rates(x: float, v: float, z: float, force: float) -> tuple[float, float, float]:
        slope = ALPHA * v - DISSIPATION * abs(v) * z + STIFFENING * v * abs(z)
        return v, (force - DAMPING * v - STIFFNESS * x - z) / MASS, slope

    for k, (now, then) in enumerate(pairwise(drive.tolist())):
        for part in range(STEPS):
            begin, middle, end = (now + (then - now) * (part + share) / STEPS for share in (0.0, 0.5, 1.0))
            a = rates(x, v, z, begin)
            b = rates(x + 0.5 * h * a[0], v + 0.5 * h * a[1], z + 0.5 * h * a[2], middle)
            c = rates(x + 0.5 * h * b[0], v + 0.5 * h * b[1], z + 0.5 * h * b[2], middle)
            d = rates(x + h * c[0], v + h * c[1], z + h * c[2], end)
            x, v, z = (old + h * (p + 2.0 * q + 2.0 * r + s) / 6.0 for old, p, q, r, s in zip((x, v, z), a, b, c, d, strict=True))
        found[k + 1] = x
    return found


def oscillator(wrong: float) -> RigModel:
    """Its description without the loop, with a stiffness that is wrong by this factor."""
    return from_tree(
        {
            "name": "oscillator", "bodies": [{"name": "mass", "mass": MASS}],
            "links": [{"name": "mount", "a": "mass", "b": "ground", "stiffness": wrong * STIFFNESS, "damping": DAMPING}],
            "drive": {"channel": "force", "quantity": "force", "pushes": {"mass": 1.0}},
            "sensors": [{"channel": "x", "body": "mass", "quantity": "displacement"}],
            "free": ["links.mount.stiffness", "links.mount.damping"],
        }
    )  # fmt: skip


@cache
def measured() -> Campaign:
    """Two runs with noise of a per cent."""
    runs = []
    for seed in (1, 2):
        drive = noise(8.0, RATE, 45.0, (5.0, 150.0), seed)
        x = recorded(drive)
        x += np.random.default_rng(10 + seed).normal(0.0, 0.01 * x.std(), len(x))
        channels = {
            "force": Channel(name="force", samples=drive, quantity="force", unit="N"),
            "x": Channel(name="x", samples=x, quantity="displacement", unit="m"),
        }
        runs.append(
            Run(id=f"r{seed}", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels, excitation="random",
                band=(5.0, 150.0))
        )  # fmt: skip
    return Campaign(runs=tuple(runs), source="published oscillator")


def test_the_published_oscillator_is_named_with_its_values() -> None:
    with Deadline(120.0):
        found = diagnose(measured(), oscillator(1.1))
    [step] = found.steps
    assert (found.verdict, step.cause, step.location) == ("explained", "stiffening_hysteresis", "mount")
    values = {name: value for name, (value, _, _) in step.parameters.items()}
    assert values["initial_stiffness"] == pytest.approx(ALPHA, rel=0.05)
    assert values["stiffening"] == pytest.approx(STIFFENING, rel=0.05)
    assert values["dissipation"] == pytest.approx(DISSIPATION, rel=0.05)


def test_its_equation_holds_with_the_loop() -> None:
    given = oscillator(1.0)
    law = Law(initial_stiffness=ALPHA, stiffening=STIFFENING, dissipation=DISSIPATION)
    before, after = (equations_of(measured(), model).residuals()["mass"] for model in (given, with_law(given, "mount", law)))
    assert after < 0.05 * before


@pytest.mark.parametrize(("stiffening", "dissipation"), [(300.0, 500.0), (500.0, 300.0), (400.0, 400.0), (0.0, 0.0)])
def test_the_force_along_a_motion_is_that_of_the_rates(stiffening: float, dissipation: float) -> None:
    law = Law(initial_stiffness=4e3, stiffening=stiffening, dissipation=dissipation)
    # Sines of three frequencies, with and without their derivative, at samples and twice as often as Runge-Kutta steps.
    h = 1.0 / (500.0 * 20.0)
    t = 0.5 * h * np.arange(1500 * 40)
    parts = ((2e-3 / 2.0, 4.1, 0.5 * np.pi), (-2e-3 / 2.0, 5.9, 0.5 * np.pi), (3e-4, 31.0, 0.0))
    d = sum(size * np.sin(2.0 * np.pi * f * t + phase) for size, f, phase in parts)
    v = sum(size * 2.0 * np.pi * f * np.cos(2.0 * np.pi * f * t + phase) for size, f, phase in parts)
    want, z = [], law.begun()
    for begin, middle in zip(v[0::2], v[1::2], strict=True):
        want.append(z[0])
        z = z + h * law.rates(0.0, middle, z + 0.5 * h * law.rates(0.0, begin, z))
    assert law.along(d[::40], v[::40], 500.0) == pytest.approx(want[::20], abs=1e-3 * np.abs(want).max())


def test_without_stiffening_it_is_elastic_friction() -> None:
    d = 3e-3 * np.sin(np.arange(2000) / 50.0)
    v = np.diff(d, prepend=d[:1]) * 500.0
    one = Law(initial_stiffness=4e3, stiffening=0.0, dissipation=800.0).along(d, v, 500.0)
    assert one == pytest.approx(Dahl(friction_force=5.0, bristle_stiffness=4e3).along(d, v, 500.0), abs=1e-9)
    assert PreslidingFriction().name in StiffeningHysteresis.generalizes


@pytest.mark.parametrize(("share", "plausible"), [(0.99, True), (1.01, False)])
def test_a_force_that_nears_its_limit_is_plain_hysteresis(share: float, plausible: bool) -> None:
    swing = 2e-3
    swings = SimpleNamespace(deflection={"mount": swing}, speed={"mount": 0.1}, as_described=lambda link: link)
    [candidate] = StiffeningHysteresis().candidates(oscillator(1.0), swings)
    paths = {free.path.rpartition(".")[2]: free.path for free in candidate.free}
    values = {paths["stiffening"]: 300.0, paths["dissipation"]: 300.0 + share / swing}
    assert candidate.plausible(candidate.starts[0].replace(values)) is plausible
