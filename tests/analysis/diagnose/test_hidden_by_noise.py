"""A cause that noise hides from the simulation, but not from the equations of motion: friction behind a shaft with play."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.analysis.diagnose import diagnosis, required_force
from isorig.analysis.diagnose.required_force import ShownByForce, hidden_by_noise
from isorig.analysis.diagnose.search import Job
from isorig.analysis.model.rig_model import Body, Contact, Drive, Link, RigModel, Sensor
from isorig.analysis.simulate.sampling import Excitation
from isorig.analysis.simulate.simulation import simulate

RATE, SAMPLES, SEED = 500.0, 10000, 5100
COUNT = 2.0 * np.pi / 200000.0
FRICTION = 1.5


def shaft_with_play() -> RigModel:
    """A motor that drives a load through a shaft whose play is described."""
    links = (
        Link(name="motor_bearing", a="motor", damping=0.4),
        Link(name="load_bearing", a="load", damping=1.2),
        Link(name="shaft", a="motor", b="load", stiffness=3300.0, damping=2.0, laws=(laws.Backlash(clearance=0.0076),)),
    )
    free = ["bodies.load.mass", "links.motor_bearing.damping", "links.load_bearing.damping", "links.shaft.damping"]
    return RigModel(
        name="two-mass drive",
        bodies=(Body(name="motor", mass=0.45, motion="rotation"), Body(name="load", mass=2.5, motion="rotation")),
        links=links,
        drive=Drive(channel="torque", factor=1.0, pushes={"motor": 1.0}, quantity="torque"),
        sensors=tuple(Sensor(channel=f"{body} angle", body=body, quantity="angle") for body in ("motor", "load")),
        free=tuple(free),
    )


def recorded(rig: RigModel) -> Campaign:
    """Two levels of a random torque with noise in its record; the angles are counts of encoders."""
    draw, runs = np.random.default_rng(SEED), []
    band = np.fft.rfftfreq(SAMPLES, 1.0 / RATE)
    for k, gain in enumerate((9.0, 27.0)):
        spectrum = np.where((band > 0.5) & (band < 25.0), np.exp(2j * np.pi * draw.uniform(size=len(band))), 0.0)
        torque = np.fft.irfft(spectrum, SAMPLES)
        torque *= gain / torque.std() * np.clip(np.arange(SAMPLES) / RATE, 0.0, 1.0)
        seen = simulate(rig, Excitation.prepare(torque, RATE, oversample=8), as_recorded=True).channels
        records = {name: COUNT * np.round(values / COUNT) for name, values in seen.items()}
        records["torque"] = torque + 0.4 * gain * draw.normal(size=SAMPLES)
        channels = {
            name: Channel(name=name, samples=values, quantity="torque" if name == "torque" else "angle",
                          unit="N m" if name == "torque" else "rad")
            for name, values in records.items()
        }  # fmt: skip
        runs.append(Run(id=f"r{k}", configuration="unlocked", sample_rate=RATE, gain=gain, channels=channels))
    return Campaign(runs=tuple(runs), source="two-mass drive")


def diagnosed(rig: RigModel, monkeypatch: pytest.MonkeyPatch) -> tuple[diagnosis.Diagnosis, list[Job]]:
    jobs: list[Job] = []

    def asked(job: Job) -> ShownByForce | None:
        jobs.append(job)
        return hidden_by_noise(job)

    monkeypatch.setattr(diagnosis, "hidden_by_noise", asked)
    return diagnosis.diagnose(recorded(rig), shaft_with_play()), jobs


def test_friction_of_the_load_is_named_beside_a_play_that_makes_the_simulation_sensitive(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rubbing = Contact(name="load_bearing", a="load", law=laws.Coulomb(friction_force=FRICTION))
    found, (job,) = diagnosed(replace(shaft_with_play(), contacts=(rubbing,)), monkeypatch)
    assert found.verdict == "explained"
    assert [(step.cause, step.location) for step in found.steps] == [("coulomb_friction", "load_bearing")]
    assert "noise alone changes it by 13 %, which hides this cause" in found.steps[0].evidence[0]
    value, std, _ = found.steps[0].parameters["friction_force"]
    assert abs(value - FRICTION) < 4.0 * std < 0.1 * FRICTION
    # Values that the required force does not give keep their uncertainties.
    assert set(found.extended.std) == {*shaft_with_play().free, "contacts.load_bearing.law.friction_force"}
    # At the thresholds: of the noise floor, and of the force above its noise that remains.
    shown = found.required_force
    assert shown is not None
    remaining = ((shown.after**2 - shown.noise**2) / (shown.before**2 - shown.noise**2)) ** 0.5
    assert shown.share == pytest.approx(1.0 - remaining**2)
    for factor, kept in ((1.01, True), (0.99, False)):
        with monkeypatch.context() as changed:
            changed.setattr(required_force, "REMAINS", factor * remaining)
            assert (hidden_by_noise(job) is not None) is kept
    for factor, kept in ((0.99, True), (1.01, False)):
        with monkeypatch.context() as changed:
            changed.setattr(required_force, "HIDES", factor * float(np.median(job.floors)))
            again, jobs = diagnosed(replace(shaft_with_play(), contacts=(rubbing,)), changed)
            assert (bool(again.steps), len(jobs)) == (kept, kept)


def test_nothing_is_named_beside_the_play_of_a_sound_drive(monkeypatch: pytest.MonkeyPatch) -> None:
    found, _ = diagnosed(shaft_with_play(), monkeypatch)
    assert (found.verdict, found.steps) == ("adequate", ())
