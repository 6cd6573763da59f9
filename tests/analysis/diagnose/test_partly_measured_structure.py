"""A structure of five lightly damped modes, described up to a fifth off, with sensors at three points; scipy integrates it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Literal

import msgspec
import numpy as np
import pytest
from scipy.signal import StateSpace, lsim

from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.diagnose.diagnosis import diagnose
from isorig.analysis.fitting import transfer_functions
from isorig.analysis.fitting.linear_spectra import spectra_of
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.solve import Free, base_parameters
from isorig.analysis.fitting.transfer_functions import BINS, fitted_to_transfer_functions, steps_towards
from isorig.analysis.laws import Coulomb, Cubic
from isorig.analysis.model.rig_model import Body, Contact, Drive, Link, RigModel, Sensor

SEED, RATE, SECONDS, FINER = 8700, 1000.0, 6.0, 12
MASSES, SEEN = np.array([1.6, 3.4, 3.6, 1.7, 3.2]), (0, 2, 4)
STIFFNESS, DAMPING = np.array([7.0e5, 7.3e5, 6.2e5, 4.8e5, 4.5e5]), np.array([10.0, 15.0, 14.0, 9.0, 11.0])


def described(seed: int, masses: FloatArray = MASSES) -> RigModel:
    off = np.random.default_rng(seed).uniform(0.8, 1.2, (2, len(masses)))
    links = tuple(
        Link(name=f"j{k}", a=f"m{k}", b=f"m{k - 1}" if k else "ground", stiffness=s, damping=c)
        for k, (s, c) in enumerate(zip((STIFFNESS * off[0]).tolist(), (DAMPING * off[1]).tolist(), strict=True))
    )
    return RigModel(
        name="structure", bodies=tuple(Body(name=f"m{k}", mass=m) for k, m in enumerate(masses.tolist())), links=links,
        drive=Drive(channel="f", pushes={"m1": 1.0}, quantity="force"),
        sensors=tuple(Sensor(channel=f"a{k}", body=f"m{k}") for k in SEEN),
        free=tuple(f"links.j{k}.{what}" for k in range(len(links)) for what in ("stiffness", "damping")),
    )  # fmt: skip


def fitted(rig: RigModel, campaign: Campaign) -> RigModel | None:
    return fitted_to_transfer_functions(rig, base_parameters(rig), spectra_of(rig, campaign, BINS))


@cache
def recorded(drive: Literal["multisine", "hammer"], noise: float = 1e-4) -> Campaign:
    along = np.eye(len(MASSES)) - np.eye(len(MASSES), k=-1)  # elongation of each link
    stiffness, damping = (along.T @ np.diag(values) @ along for values in (STIFFNESS, DAMPING))
    own, n = np.eye(len(MASSES)), len(MASSES)
    rates = np.block([[np.zeros((n, n)), own], [-stiffness / MASSES[:, None], -damping / MASSES[:, None]]])
    push = np.concatenate([np.zeros(n), own[1] / MASSES])[:, None]
    system = StateSpace(rates, push, rates[[n + k for k in SEEN]], push[[n + k for k in SEEN]])
    runs = []
    for number, level in enumerate((40.0, 120.0)):
        draw, t = np.random.default_rng([SEED, number]), np.arange(round(SECONDS * RATE * FINER)) / (RATE * FINER)
        if drive == "multisine":
            lines = np.arange(8.0, 180.0, 0.5)
            force = np.sum([np.cos(2.0 * np.pi * (f * t + draw.uniform())) for f in lines], axis=0) * level / np.sqrt(len(lines))
        else:  # twelve milliseconds long, a hundredth of a second after the start
            inside = (t > 0.01) & (t < 0.022)
            force = np.where(inside, level * (1.0 - np.cos(2.0 * np.pi * (t - 0.01) / 0.012)), 0.0)
        _, motion, _ = lsim(system, force, t)
        records = {"f": force[::FINER]} | {f"a{k}": row[::FINER] for k, row in zip(SEEN, motion.T, strict=True)}
        channels = {}
        for name, row in records.items():
            quantity: Literal["force", "acceleration"] = "force" if name == "f" else "acceleration"
            samples = row + draw.normal(0.0, noise * row.std(), len(row))
            channels[name] = Channel(name=name, samples=samples, quantity=quantity, unit="N" if name == "f" else "m/s^2")
        runs.append(Run(id=f"r{number}", configuration="unlocked", sample_rate=RATE, gain=level, channels=channels))
    return Campaign(runs=tuple(runs), source="structure")


@pytest.mark.parametrize("drive", ["multisine", "hammer"])
def test_transfer_functions_give_the_values_of_a_structure_described_a_fifth_off(drive: Literal["multisine", "hammer"]) -> None:
    for seed in range(2):
        found = fitted(described(seed), recorded(drive))
        assert found is not None
        np.testing.assert_allclose([link.stiffness for link in found.links], STIFFNESS, rtol=0.01)
        np.testing.assert_allclose([link.damping for link in found.links], DAMPING, rtol=0.25)


def test_large_errors_and_noise_count_less(monkeypatch: pytest.MonkeyPatch) -> None:
    """Noise hides the responses between the resonances, whose logarithms then mean nothing."""

    def errors() -> FloatArray:
        found = fitted(described(0), recorded("multisine", 0.03))
        assert found is not None
        return np.abs(np.array([link.stiffness for link in found.links]) / STIFFNESS - 1.0)

    assert errors().max() < 0.05
    monkeypatch.setattr(transfer_functions, "LARGE", 30.0)
    assert errors().max() > 0.3


def test_only_linear_rigs_have_transfer_functions() -> None:
    rig, campaign = described(0), recorded("multisine")
    law = msgspec.structs.replace(rig.links[2], laws=(Cubic(cubic_stiffness=1e9),))
    curved = msgspec.structs.replace(rig, links=(*rig.links[:2], law, *rig.links[3:]))
    rubbing = msgspec.structs.replace(rig, contacts=(Contact(name="guide", a="m0", law=Coulomb(friction_force=1.0)),))
    held = msgspec.structs.replace(rig, free=())
    late = msgspec.structs.replace(rig, free=("sensors.a0.chain.delay",))
    assert [fitted(each, campaign) for each in (curved, rubbing, held, late)] == [None] * 4


def test_a_sensor_that_the_drive_does_not_reach_counts_for_nothing() -> None:
    """A mass beside the structure moves, but its description has no force on it."""
    rig = described(0)
    beside = msgspec.structs.replace(
        rig, bodies=(*rig.bodies, Body(name="beside", mass=1.0)), links=(*rig.links, Link(name="own", a="beside", stiffness=1e4)),
        sensors=(*rig.sensors[:2], Sensor(channel="a4", body="beside")),
    )  # fmt: skip
    found = fitted(beside, recorded("multisine"))
    assert found is not None
    assert np.isfinite([link.stiffness for link in found.links]).all()


@pytest.mark.parametrize("drive", [pytest.param("multisine", marks=pytest.mark.study), "hammer"])
def test_a_sound_structure_is_adequate(drive: Literal["multisine", "hammer"]) -> None:
    found = diagnose(recorded(drive, 1e-3), described(1))
    assert (found.verdict, found.steps) == ("adequate", ())


def with_gain(campaign: Campaign, channel: str, gain: float) -> Campaign:
    def scaled(run: Run) -> Run:
        record = run.channels[channel]
        return replace(run, channels={**run.channels, channel: replace(record, samples=gain * np.asarray(record.samples))})

    return replace(campaign, runs=tuple(map(scaled, campaign.runs)))


def test_a_step_towards_the_transfer_functions_shows_a_sensors_gain() -> None:
    campaign, rig = with_gain(recorded("multisine"), "a2", 0.88), described(1)
    spectra, free = spectra_of(rig, campaign, BINS), base_parameters(rig)
    near = fitted_to_transfer_functions(rig, free, spectra)
    assert near is not None
    gains = [Free(path=f"sensors.a{k}.chain.gain", low=0.1, high=10.0) for k in SEEN]
    shares = steps_towards(near, free, gains, spectra)
    assert np.argmax(shares) == SEEN.index(2)
    assert shares[1] > 3.0 * np.delete(shares, 1).max()
    # What the free values have already removes nothing more.
    again = steps_towards(near, free, free[:1], spectra)
    assert again[0] < 1e-6


def test_a_whole_hit_is_held_out() -> None:
    trials = prepare(recorded("hammer", 1e-3), described(1))
    assert [trial.fitted for trial in trials] == [0, trials[1].samples]  # the weaker of two hits


# What is held out is tested above, and the share of a gain too.
@pytest.mark.study
def test_a_hit_shows_a_sensors_gain() -> None:
    """At the end of a hit, the damping of the slowest mode decides alone; a gain is hidden there."""
    campaign = with_gain(recorded("hammer", 1e-3), "a2", 0.88)
    found = diagnose(campaign, described(1))
    (step,) = found.steps
    assert (found.verdict, step.cause, step.location) == ("explained", "sensor_gain", "a2")
    assert step.parameters["factor"][0] == pytest.approx(0.88, abs=0.002)
