"""A damper that a machine moves by sweeps of three amplitudes, while its force is measured: every force by its formula."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from msgspec.structs import replace

import isorig as iso
from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.equations.system import equations_of
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.trials import ENDS, expected
from isorig.analysis.laws import Cubic
from isorig.analysis.model.rig_model import Body, Drive, Link, RigModel, Sensor
from isorig.analysis.simulate.sampling import TAPS

#: kg, N s/m, N/m, N/m^3; m, Hz, Hz and seconds of the sweeps; noise as a share of each record's rms.
MASS, DAMPING, STIFFNESS, CUBIC = 0.694, 2383.0, 2247.0, 4.2e6
AMPLITUDES, SWEEP, RATE, SECONDS, NOISE, QUIET = (0.0048, 0.0096, 0.016), (0.67, 3.4), 500.0, 20.0, 0.005, 0.001
RIG = RigModel(
    name="damper", bodies=(Body(name="rod", mass=MASS),), free=("links.damper.damping", "links.damper.stiffness"),
    links=(Link(name="damper", a="rod", b="ground", damping=1.07 * DAMPING, stiffness=0.96 * STIFFNESS),),
    drive=Drive(channel="stroke", factor=1.0, pushes={}, quantity="displacement", imposes="rod"),
    sensors=(Sensor(channel="load", quantity="force", force_in="drive.stroke"),),
)  # fmt: skip


def swept(amplitude: float) -> tuple[FloatArray, FloatArray]:
    """Stroke in m and force in N."""
    time = np.arange(round(SECONDS * RATE)) / RATE
    rise = (SWEEP[1] - SWEEP[0]) / SECONDS
    angle, omega = 2.0 * np.pi * (SWEEP[0] * time + 0.5 * rise * time**2), 2.0 * np.pi * (SWEEP[0] + rise * time)
    x, v = amplitude * np.sin(angle), amplitude * omega * np.cos(angle)
    a = amplitude * (2.0 * np.pi * rise * np.cos(angle) - omega**2 * np.sin(angle))
    return x, MASS * a + DAMPING * v + STIFFNESS * x + CUBIC * x**3


@pytest.mark.study
def test_a_spring_is_named_where_the_equations_show_a_drift_as_well() -> None:
    """In sweeps a damping that drifts removes more of the residual; no simulation confirms it, so the next suspects are tried."""
    draw = np.random.default_rng(1)
    runs = []
    for k, amplitude in enumerate(AMPLITUDES):
        stroke, load = (values + draw.normal(0.0, NOISE * values.std(), len(values)) for values in swept(amplitude))
        channels = {
            "stroke": Channel(name="stroke", samples=stroke, quantity="displacement", unit="m"),
            "load": Channel(name="load", samples=load, quantity="force", unit="N"),
        }
        runs.append(
            Run(
                id=f"r{k}", configuration="unlocked", sample_rate=RATE, gain=amplitude / AMPLITUDES[0], channels=channels,
                excitation="sweep",
            )
        )  # fmt: skip
    found = iso.diagnose(Campaign(runs=tuple(runs), source="damper"), RIG)
    assert found.verdict == "explained"
    (step,) = found.steps
    assert (step.cause, step.location) == ("hardening_stiffness", "damper")
    value, std, _ = step.parameters["cubic_stiffness"]
    assert abs(value - CUBIC) <= 3.0 * std


def test_the_end_of_an_imposed_motion_has_no_error() -> None:
    """The record ends in motion: how it goes on is unknown, and a low-pass and derivatives depend on that."""
    stroke, load = swept(AMPLITUDES[1])
    stroke = stroke + np.random.default_rng(2).normal(0.0, NOISE * stroke.std(), len(stroke))
    channels = {
        "stroke": Channel(name="stroke", samples=stroke, quantity="displacement", unit="m"),
        "load": Channel(name="load", samples=load, quantity="force", unit="N"),
    }
    run = Run(id="r", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels, excitation="sweep")
    true = RIG.replace({"links.damper.damping": DAMPING, "links.damper.stiffness": STIFFNESS})
    spring = replace(true.links[0], laws=(Cubic(cubic_stiffness=CUBIC),))
    (trial,) = prepare(Campaign(runs=(run,), source="damper"), true)
    error = expected(replace(true, links=(spring,)), trial)[0] - trial.measured[0]
    before = error[: -trial.uncertain_end]
    assert np.abs(error).max() <= np.abs(before).max() < 0.02 * np.abs(load).max()
    assert trial.uncertain_end == TAPS + round(ENDS * RATE / trial.excitation.corner)
    exact = dataclasses.replace(trial.excitation, corner=np.inf)
    assert dataclasses.replace(trial, excitation=exact).uncertain_end == TAPS


@pytest.mark.study
def test_damping_that_grows_with_the_velocity_in_short_fast_runs() -> None:
    """Oil beside a gas spring; a slow run shows only the spring, and the fast one is shorter than twenty periods of the slow one.

    The force over the velocity is that of both links between the two ends, and is named at one of them.
    """
    oil, gas, quadratic, draw = 520.0, 3000.0, 3200.0, np.random.default_rng(3)
    runs = []
    for k, (frequency, seconds) in enumerate(((0.2, 48.0), (0.8, 14.0), (2.5, 8.0))):
        angle = 2.0 * np.pi * frequency * np.arange(round(seconds * RATE)) / RATE
        x, v = 0.011 * np.sin(angle), 0.011 * 2.0 * np.pi * frequency * np.cos(angle)
        force = -MASS * (2.0 * np.pi * frequency) ** 2 * x + oil * v + quadratic * v * np.abs(v) + gas * x
        stroke, load = (values + draw.normal(0.0, NOISE * values.std(), len(values)) for values in (x, force))
        channels = {
            "stroke": Channel(name="stroke", samples=stroke, quantity="displacement", unit="m"),
            "load": Channel(name="load", samples=load, quantity="force", unit="N"),
        }
        runs.append(Run(id=f"r{k}", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels, excitation="other"))
    links = (Link(name="oil", a="rod", damping=1.1 * oil), Link(name="gas", a="rod", stiffness=0.93 * gas))
    rig = replace(RIG, links=links, free=("links.oil.damping", "links.gas.stiffness"))
    found = iso.diagnose(Campaign(runs=tuple(runs), source="damper"), rig)
    (step,) = found.steps
    assert (found.verdict, step.cause, step.location) == ("explained", "quadratic_damping", "oil")
    value, std, _ = step.parameters["quadratic_damping"]
    assert abs(value - quadratic) <= 3.0 * std <= 0.05 * quadratic


@pytest.mark.parametrize(("friction", "wider"), [(0.0, False), (60.0, True)])
def test_equations_keep_the_band_of_the_measured_force(friction: float, wider: bool) -> None:
    """A force that changes at once has content above the band of the stroke, which equations without it would not show."""
    draw = np.random.default_rng(4)
    stroke, load = swept(AMPLITUDES[2])
    load = load + friction * np.sign(np.gradient(stroke))
    channels = {
        name: Channel(
            name=name, samples=values + draw.normal(0.0, QUIET * values.std(), len(values)), quantity=quantity, unit=unit
        )
        for name, values, quantity, unit in [("stroke", stroke, "displacement", "m"), ("load", load, "force", "N")]
    }
    run = Run(id="r", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels, excitation="sweep")
    assert (equations_of(Campaign(runs=(run,), source="damper"), RIG).edge > 6.0 * SWEEP[1]) is wider


@pytest.mark.study
def test_a_relaxation_beside_hysteresis_is_named_too() -> None:
    """A rubber hose: both forces have a memory, and the equations show them as one.

    The force has content above the band of the sweeps: cut at that, the equations have no samples between two reversals.
    """
    relaxation, within, friction, built_up = 2.0e4, 0.04, 80.0, 3.0e4
    draw = np.random.default_rng(5)
    runs = []
    for k, amplitude in enumerate(AMPLITUDES):
        fine = 20  # steps per sample of the explicit midpoint rule
        time = np.arange(round(SECONDS * RATE) * fine) / (RATE * fine)
        rise = (SWEEP[1] - SWEEP[0]) / SECONDS
        angle, omega = 2.0 * np.pi * (SWEEP[0] * time + 0.5 * rise * time**2), 2.0 * np.pi * (SWEEP[0] + rise * time)
        x, v = amplitude * np.sin(angle), amplitude * omega * np.cos(angle)
        a = amplitude * (2.0 * np.pi * rise * np.cos(angle) - omega**2 * np.sin(angle))
        step, z, f, memories = 1.0 / (RATE * fine), 0.0, 0.0, [(0.0, 0.0)]
        for speed in (0.5 * (v[1:] + v[:-1])).tolist():  # plain numbers: many times as fast as elements of arrays
            rate = built_up / friction * speed * (1.0 - abs(z) ** 1.5 * (speed * z > 0.0))
            there = z + 0.5 * step * rate
            z += step * built_up / friction * speed * (1.0 - abs(there) ** 1.5 * (speed * there > 0.0))
            half = f + 0.5 * step * (relaxation * speed - f / within)
            f += step * (relaxation * speed - half / within)
            memories.append((z, f))
        built, relaxed = np.array(memories).T
        force = MASS * a + DAMPING * v + STIFFNESS * x + friction * built + relaxed
        stroke, load = (values[::fine] + draw.normal(0.0, QUIET * values.std(), len(values) // fine) for values in (x, force))
        channels = {
            "stroke": Channel(name="stroke", samples=stroke, quantity="displacement", unit="m"),
            "load": Channel(name="load", samples=load, quantity="force", unit="N"),
        }
        runs.append(Run(id=f"r{k}", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels, excitation="sweep"))
    found = iso.diagnose(Campaign(runs=tuple(runs), source="hose"), RIG)
    named = {step.cause: step.parameters for step in found.steps}
    assert set(named) == {"hysteresis", "relaxation"}
    assert named["relaxation"]["relaxation_stiffness"][0] == pytest.approx(relaxation, rel=0.05)
    assert named["hysteresis"]["friction_force"][0] == pytest.approx(friction, rel=0.05)


def test_where_an_imposed_speed_began_is_no_error() -> None:
    """Only the speed is recorded, and the stroke begins at its largest value: the spring holds a force that no record tells."""
    time = np.arange(round(SECONDS * RATE)) / RATE
    omega = 2.0 * np.pi * SWEEP[0]
    x, v = AMPLITUDES[2] * np.cos(omega * time), -AMPLITUDES[2] * omega * np.sin(omega * time)
    load = -MASS * omega**2 * x + 100.0 * v + STIFFNESS * x
    channels = {
        "stroke": Channel(name="stroke", samples=v, quantity="velocity", unit="m/s"),
        "load": Channel(name="load", samples=load, quantity="force", unit="N"),
    }
    run = Run(id="r", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels, excitation="other")
    true = RIG.replace({"links.damper.damping": 100.0, "links.damper.stiffness": STIFFNESS})
    true = replace(true, drive=replace(true.drive, quantity="velocity"))
    (trial,) = prepare(Campaign(runs=(run,), source="damper"), true)
    error = (expected(true, trial)[0] - trial.measured[0])[50:-200]
    assert np.abs(error).max() < 0.01 * np.abs(load).max()


def test_a_damper_that_is_unlike_in_its_directions() -> None:
    """A shock absorber: its damping in extension is twice that in compression, and the load cell has an unknown zero."""
    extension, compression, draw = 2.0 * DAMPING, DAMPING, np.random.default_rng(5)
    runs = []
    for k, amplitude in enumerate(AMPLITUDES):
        x, linear = swept(amplitude)
        v = np.gradient(x, 1.0 / RATE)
        force = linear - CUBIC * x**3 - DAMPING * v + np.where(v > 0.0, extension, compression) * v + 3.0
        stroke, load = (values + draw.normal(0.0, NOISE * values.std(), len(values)) for values in (x, force))
        channels = {
            "stroke": Channel(name="stroke", samples=stroke, quantity="displacement", unit="m"),
            "load": Channel(name="load", samples=load, quantity="force", unit="N"),
        }
        runs.append(Run(id=f"r{k}", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels, excitation="sweep"))
    found = iso.diagnose(Campaign(runs=tuple(runs), source="damper"), RIG)
    (step,) = found.steps
    assert (found.verdict, step.cause, step.location) == ("explained", "asymmetric_damping", "damper")
    value, std, _ = step.parameters["damping_difference"]
    assert abs(value - (extension - compression) / 2.0) <= 3.0 * std <= 0.05 * DAMPING
