"""A drive whose channel records the command, while its force is limited or lags behind it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import msgspec
import numpy as np
import pytest
from scipy.signal import butter, lsim, resample, sosfilt

from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.analysis.diagnose.causes.drive_lag import DriveLag
from isorig.analysis.diagnose.causes.drive_saturation import DriveSaturation
from isorig.analysis.diagnose.causes.measurement_chain import with_drive
from isorig.analysis.diagnose.diagnosis import diagnose
from isorig.analysis.equations import ranking as of_equations
from isorig.analysis.equations.ranking import ranking
from isorig.analysis.equations.system import HOLDS, equations_of
from isorig.analysis.errors import ModelError
from isorig.analysis.fitting.division import ends
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.score import score
from isorig.analysis.model.rig_model import Body, Drive, Link, RigModel, Sensor

SEED, RATE, FINER = 7100, 400.0, 10
MASSES, STIFFNESSES, DAMPINGS = (1.3, 0.8), (3900.0, 2100.0), (3.5, 2.0)


@dataclass(frozen=True)
class Amplifier:
    """Its largest force in N, and the time constant in s of its coil."""

    limit: float = np.inf
    lag: float = 0.0
    gradual: bool = False  #: Whether it comes near its limit gradually.
    dead: float = 0.0  #: The command in N below which it delivers nothing, and by which it delivers less above.


@cache
def pushed(amplifier: Amplifier, *, springs: bool = True) -> tuple[Campaign, RigModel]:
    """Two masses in a row by scipy, the last one pushed by an amplifier whose command is recorded; without springs one cart."""
    draw, runs = np.random.default_rng(SEED), []
    for number, level in enumerate((1.0, 2.0)):
        n = round(8.0 * RATE)
        command = level * 5.0 * sosfilt(butter(2, [0.6, 30.0], "band", fs=RATE, output="sos"), draw.normal(0.0, 1.0, n))
        fine = resample(command, FINER * n)
        limit = amplifier.limit
        fine = limit * np.tanh(fine / limit) if amplifier.gradual else np.clip(fine, -limit, limit)
        fine = fine - np.clip(fine, -amplifier.dead, amplifier.dead)
        time = np.arange(len(fine)) / (FINER * RATE)
        if amplifier.lag:
            fine = lsim(([1.0], [amplifier.lag, 1.0]), fine, time)[1]
        if springs:
            k, c = (np.array([[a + b, -b], [-b, b]]) for a, b in (STIFFNESSES, DAMPINGS))
            inverse = np.diag(1.0 / np.array(MASSES))
            system = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ k, -inverse @ c]])
            push = np.array([[0.0], [0.0], [0.0], [1.0 / MASSES[1]]])
            seen = lsim((system, push, system[2:], push[2:]), fine, time)[1][::FINER]
            records = {"a0": (seen[:, 0], "acceleration", "m/s^2"), "a1": (seen[:, 1], "acceleration", "m/s^2")}
        else:
            seen = lsim(([1.0], [MASSES[0], 6.0, 0.0]), fine, time)[1][::FINER]
            records = {"x": (seen, "displacement", "m")}
        channels = {"f": Channel(name="f", samples=command, quantity="force", unit="N")}
        for name, (values, quantity, unit) in records.items():
            noise = draw.normal(0.0, (2e-3 if springs else 2e-5) * values.std(), n)
            channels[name] = Channel(name=name, samples=values + noise, quantity=quantity, unit=unit)
        runs.append(
            Run(id=f"r{number}", configuration="unlocked", sample_rate=RATE, gain=level, channels=channels, excitation="random")
        )
    drive = Drive(channel="f", factor=1.0, pushes={"m1" if springs else "m0": 1.0}, quantity="force")
    if springs:
        rig = RigModel(
            name="row", bodies=tuple(Body(name=f"m{j}", mass=mass) for j, mass in enumerate(MASSES)), drive=drive,
            links=(
                Link(name="l0", a="m0", stiffness=1.1 * STIFFNESSES[0], damping=DAMPINGS[0]),
                Link(name="l1", a="m1", b="m0", stiffness=0.9 * STIFFNESSES[1], damping=DAMPINGS[1]),
            ),
            sensors=tuple(Sensor(channel=f"a{j}", body=f"m{j}") for j in range(2)),
            free=tuple(f"links.l{j}.{name}" for j in range(2) for name in ("stiffness", "damping")),
        )  # fmt: skip
    else:
        rig = RigModel(
            name="cart", bodies=(Body(name="m0", mass=MASSES[0]),), drive=drive, links=(Link(name="slide", a="m0", damping=5.0),),
            sensors=(Sensor(channel="x", body="m0", quantity="displacement"),), free=("links.slide.damping",),
        )  # fmt: skip
    return Campaign(runs=tuple(runs), source="commands"), rig


@pytest.mark.parametrize(
    ("amplifier", "cause", "value", "springs"),
    [
        (Amplifier(limit=6.0), "drive_saturation", ("limit", 6.0, "N"), False),
        (Amplifier(lag=0.012), "drive_lag", ("time_constant", 0.012, "s"), True),
        (Amplifier(lag=0.012), "drive_lag", ("time_constant", 0.012, "s"), False),
        # On springs, a drive that saturates gradually is diagnosed below.
        pytest.param(Amplifier(limit=6.0), "drive_saturation", ("limit", 6.0, "N"), True, marks=pytest.mark.study),
    ],
)
def test_a_drive_that_does_not_follow_its_command_is_named(
    amplifier: Amplifier, cause: str, value: tuple[str, float, str], springs: bool
) -> None:
    """With one sensor, a lag of the drive is also that of the sensor."""
    found = diagnose(*pushed(amplifier, springs=springs))
    assert found.verdict == "explained"
    assert [(step.cause, step.location) for step in found.steps] == [(cause, "f")]
    name, size, unit = value
    fitted = found.steps[0].parameters[name]
    assert fitted[0] == pytest.approx(size, rel=0.02)
    assert fitted[2] == unit
    same = (("low_pass", "x"),) if cause == "drive_lag" and not springs else ()
    assert found.steps[0].indistinguishable == same


def test_a_drive_that_saturates_gradually_has_a_static_curve() -> None:
    """No form of the catalogue explains it; the curve does, and the hard limit is the closest form."""
    found = diagnose(*pushed(Amplifier(limit=9.0, gradual=True)))
    (step,) = found.steps
    assert (found.verdict, step.cause, step.location) == ("explained", "sensor", "f")
    assert step.closest is not None
    assert step.closest[0] == "drive_saturation"
    at, added = np.array(found.extended.model.drive.curve).T
    inside = np.abs(at) <= 9.0
    acting = (at + added)[inside]
    np.testing.assert_allclose(acting, 9.0 * np.tanh(at[inside] / 9.0), atol=0.2)


# On springs, the equations with a dead band are tested below, and a diagnosed static curve is above.
@pytest.mark.parametrize("springs", [pytest.param(True, marks=pytest.mark.study), False])
def test_a_drive_with_a_dead_band_has_a_static_curve(springs: bool) -> None:
    """A valve with overlap: no form of the catalogue is one, and the band is a small part of the command's range."""
    found = diagnose(*pushed(Amplifier(dead=0.5), springs=springs))
    assert [(step.cause, step.location) for step in found.steps] == [("sensor", "f")]
    assert found.extended_error < 0.2 * found.baseline_error
    at, added = np.array(found.extended.model.drive.curve).T
    inside = np.abs(at) < 8.0
    np.testing.assert_allclose(added[inside], -np.clip(at[inside], -0.5, 0.5), atol=0.15)


def test_the_equations_hold_with_a_dead_band() -> None:
    before, best = (ranked := ranking(equations_of(*pushed(Amplifier(dead=0.2))))).residuals, ranked.explanations[0]
    assert (best.place, best.what) == ("f", "saturation")
    assert max(best.residuals.values()) < HOLDS < 2.0 * HOLDS < max(before.values())


@pytest.mark.parametrize(("own", "holds"), [(None, False), (-np.inf, True)])
def test_a_curve_that_cancels_the_command_explains_nothing(
    own: float | None, holds: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the command is the only scale, all forces may be zero."""
    if own is not None:
        monkeypatch.setattr(of_equations, "OWN", own)
    campaign, rig = pushed(Amplifier(lag=0.012))
    rig = msgspec.structs.replace(rig, free=(*rig.free, "bodies.m0.mass", "bodies.m1.mass"))
    curve = next(item for item in ranking(equations_of(campaign, rig)).explanations if item.what == "saturation")
    assert (max(curve.residuals.values()) < HOLDS) == holds


@pytest.mark.parametrize("changes", [{"limit": 0.05}, {"lag": 20.0}], ids=["limit", "lag"])
def test_a_drive_that_delivers_hardly_anything_does_not_seem_to_fit(changes: dict[str, float]) -> None:
    """A rig that is judged by its drive: where nothing acts, nothing is required."""
    campaign, rig = pushed(Amplifier(limit=6.0), springs=False)
    judged = ends(prepare(campaign, rig)).judged
    assert score(with_drive(rig, **changes), judged).figure > score(rig, judged).figure > 0.05


def test_only_a_drive_whose_command_is_recorded_can_differ_from_it() -> None:
    _, rig = pushed(Amplifier(), springs=False)
    shaken = msgspec.structs.replace(rig, drive=Drive(channel="head", factor=0.5, pushes={"m0": -1.0}))
    for cause in (DriveLag(), DriveSaturation()):
        assert cause.places(rig) == ("f",)
        assert cause.places(shaken) == ()
        assert cause.places(with_drive(rig, lag=0.01)) == ()


@pytest.mark.parametrize(
    ("changes", "refused"), [({"limit": 0.0}, "has limit 0"), ({"lag": -0.1}, "has lag -0.1 s")], ids=["limit", "lag"]
)
def test_a_drive_without_a_force_or_ahead_of_its_command_is_refused(changes: dict[str, float], refused: str) -> None:
    _, rig = pushed(Amplifier(), springs=False)
    with pytest.raises(ModelError, match=refused):
        with_drive(rig, **changes)


def test_a_drive_that_follows_its_command_is_adequate() -> None:
    assert diagnose(*pushed(Amplifier())).verdict == "adequate"
