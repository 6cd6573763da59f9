"""Equations of bodies that nothing pushes, the values of a contact with a memory, and kept derivatives; own integrator."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.integrate import solve_ivp

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.equations import forms
from isorig.analysis.equations.balances import Balance
from isorig.analysis.equations.forms import scales_of, solved_values, start_values
from isorig.analysis.equations.motion import LONGEST, derivatives
from isorig.analysis.equations.system import Equations, equations_of
from isorig.analysis.laws.hysteresis import BoucWen
from isorig.analysis.model.rig_model import Body, Contact, Drive, Link, RigModel, Sensor

SEED, RATE, SAMPLES = 9100, 200.0, 4000
TRUE = {"bodies.second.mass": 1.7, "links.one.stiffness": 900.0, "links.two.stiffness": 600.0}
#: Masses described a quarter off; only the first cart is known, and pushed.
CARTS = RigModel(
    name="carts", bodies=(Body(name="first", mass=1.2), Body(name="second", mass=2.2)),
    links=(
        Link(name="one", a="first", stiffness=1000.0, damping=3.0),
        Link(name="two", a="second", b="first", stiffness=800.0, damping=2.0),
    ),
    drive=Drive(channel="u", pushes={"first": 1.0}),
    sensors=tuple(Sensor(channel=f"x{k}", body=name, quantity="displacement") for k, name in ((1, "first"), (2, "second"))),
    free=("bodies.second.mass", *(f"links.{name}.{value}" for name in ("one", "two") for value in ("stiffness", "damping"))),
)  # fmt: skip


def recorded(seed: int) -> Campaign:
    draw, time = np.random.default_rng(seed), np.arange(SAMPLES) / RATE
    spectrum = np.zeros(SAMPLES // 2 + 1, dtype=complex)
    spectrum[20:240] = np.exp(2j * np.pi * draw.uniform(size=220))
    force = 20.0 * np.fft.irfft(spectrum) / np.std(np.fft.irfft(spectrum))
    mass, k1, k2 = TRUE.values()

    def rates(t: float, y: FloatArray) -> list[float]:
        x1, x2, v1, v2 = y
        between = k2 * (x2 - x1) + 1.6 * (v2 - v1)
        return [v1, v2, (np.interp(t, time, force) - k1 * x1 - 2.5 * v1 + between) / 1.2, -between / mass]

    course = solve_ivp(rates, (0.0, time[-1]), np.zeros(4), t_eval=time, rtol=1e-8, atol=1e-11, max_step=0.005).y
    channels = {"u": Channel(name="u", samples=force, quantity="force", unit="N")}
    for k in (0, 1):
        values = course[k] + draw.normal(0.0, 1e-6, SAMPLES)
        channels[f"x{k + 1}"] = Channel(name=f"x{k + 1}", samples=values, quantity="displacement", unit="m")
    return Campaign(
        runs=(Run(id="r0", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels),), source="carts"
    )  # fmt: skip


def test_an_equation_that_holds_with_any_mass_has_the_scale_of_one_that_does_not() -> None:
    """That of the second cart alone; that of both contains the force."""
    equations = equations_of(recorded(SEED), CARTS)
    (relative,) = (balance for balance in equations.balances if equations.assumed_scale(balance))
    assert equations.assumed_scale(relative) == "bodies.second.mass"
    assert scales_of(equations)[relative.name] == pytest.approx(1.7 / 2.2, rel=0.02)
    found = start_values(equations)
    assert {path: found[path] for path in TRUE} == pytest.approx(TRUE, rel=0.02)


@pytest.mark.parametrize(("shared", "scale"), [(40.0, 0.4), (501.0, 1.0), (19.9, 1.0)])
def test_a_stiffness_in_two_equations_gives_the_scale_of_one_if_it_is_likely(
    shared: float, scale: float, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    values = {"first": {"links.two.stiffness": shared, "links.two.damping": 9.0}, "second": {"links.two.stiffness": 100.0}}
    balances = [SimpleNamespace(name=name, crossing=()) for name in values]
    equations = SimpleNamespace(
        balances=balances, model=CARTS, assumed_scale=lambda one: "bodies.second.mass" if one.name == "second" else ""
    )
    monkeypatch.setattr(forms, "_values_of", lambda equations, balance, explanation: dict(values[balance.name]))
    assert scales_of(cast("Equations", equations)) == {"first": 1.0, "second": pytest.approx(scale)}


def test_without_a_known_scale_an_equation_keeps_the_described_one() -> None:
    """A free factor of the drive: then even the first cart's equation has it as given."""
    rig = replace(CARTS, free=(*CARTS.free, "bodies.first.mass", "drive.factor"))
    equations = equations_of(recorded(SEED), rig)
    assert {equations.assumed_scale(balance) for balance in equations.balances} == {"bodies.second.mass", "drive.factor"}
    found = start_values(equations)
    assert found["drive.factor"] == pytest.approx(1.0)
    assert found["bodies.first.mass"] == pytest.approx(1.2, rel=0.02)
    assert found["bodies.second.mass"] == pytest.approx(1.7, rel=0.02)


def test_the_force_of_a_contact_with_a_memory_is_part_of_its_equation() -> None:
    draw, time = np.random.default_rng(SEED), np.arange(SAMPLES) / RATE
    d = 4e-3 * np.sin(2.0 * np.pi * 0.8 * time) * (0.3 + 0.7 * time / time[-1])
    law = BoucWen(friction_force=280.0, initial_stiffness=4e5, sharpness=2.0, pinching=0.6)
    force = law.along(d, np.gradient(d, 1.0 / RATE), RATE) + 5e4 * d + draw.normal(0.0, 1.0, SAMPLES)
    channels = {
        "d": Channel(name="d", samples=d, quantity="displacement", unit="m"),
        "f": Channel(name="f", samples=force, quantity="force", unit="N"),
    }
    run = Run(id="r0", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels)
    rig = RigModel(
        name="damper", bodies=(Body(name="rod", mass=1e-3),), links=(Link(name="damper", a="rod", stiffness=4e4, damping=1.0),),
        drive=Drive(channel="d", imposes="rod", quantity="displacement"),
        sensors=(Sensor(channel="f", quantity="force", force_in="drive.d"),),
        free=("links.damper.stiffness", "links.damper.damping"),
    )  # fmt: skip
    campaign = Campaign(runs=(run,), source="damper")
    plain = equations_of(
        campaign, replace(rig, contacts=(Contact(name="damper", a="rod", law=laws.Coulomb(friction_force=280.0)),))
    )
    looped = equations_of(campaign, replace(rig, contacts=(Contact(name="damper", a="rod", law=law),)))
    assert looped.residuals()["rod"] < 2.0
    assert plain.residuals()["rod"] > 20.0
    assert solved_values(looped)["contacts.damper.law.friction_force"] == pytest.approx(280.0, rel=0.01)


def test_compared_equations_have_the_same_band() -> None:
    campaign = recorded(SEED)
    first, softer = equations_of(campaign, CARTS), CARTS.replace({"links.one.stiffness": 300.0})
    assert equations_of(campaign, softer).lowest != first.lowest
    compared = equations_of(campaign, softer, first)
    assert (compared.lowest, compared.edge, compared.length) == (first.lowest, first.edge, first.length)


def test_derivatives_of_the_same_record_are_kept_up_to_a_length() -> None:
    values = np.random.default_rng(SEED).normal(size=LONGEST)
    first = derivatives(values, 2, RATE, 1.0, np.inf)
    assert derivatives(values.copy(), 2, RATE, 1.0, np.inf) is first
    assert derivatives(values, 2, RATE, 2.0, np.inf) is not first
    assert not first.orders[0].flags.writeable
    longer = np.append(values, 0.0)
    assert derivatives(longer, 2, RATE, 1.0, np.inf) is not derivatives(longer, 2, RATE, 1.0, np.inf)
    assert LONGEST == 131072


@pytest.mark.parametrize(("mass", "lacks"), [(0.45, False), (0.43, True), (10.9, False), (11.1, True), (-2.0, True)])
def test_an_equation_lacks_inertia_where_its_mass_is_five_times_off(
    mass: float, lacks: bool, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    """The second cart is described with 2.2 kg; a stiffness may be anything."""
    equations = SimpleNamespace(balances=[SimpleNamespace(name="second", crossing=())], model=CARTS)
    values = {"bodies.second.mass": mass, "links.two.stiffness": 1.0}
    monkeypatch.setattr(forms, "_values_of", lambda equations, balance, explanation: values)
    assert forms.lacks_inertia(cast("Equations", equations)) is lacks


@pytest.mark.parametrize(
    ("law", "value", "held"),
    [
        (laws.Coulomb(friction_force=6.0), 5.1, True),
        (laws.Coulomb(friction_force=6.0), 4.9, False),
        # Its column is the law's own force, so its value is a factor.
        (laws.Stribeck(friction_force=6.0, static_force=7.0, stribeck_velocity=0.1), 0.84, True),
        (laws.Stribeck(friction_force=6.0, static_force=7.0, stribeck_velocity=0.1), 0.83, False),
    ],
)
def test_a_run_is_held_whose_force_stays_below_the_friction(law: laws.FrictionLaw, value: float, held: bool) -> None:
    """A force of 5 N."""
    fake = SimpleNamespace(
        sliding={"table": (None, SimpleNamespace(values=np.array([0.0, 0.0, value])))}, records=[SimpleNamespace(index=0)],
        signals=[{}], combined=lambda signals, row: np.full(50, 5.0), force_row=lambda balance: {},
        primary=lambda balance: SimpleNamespace(contact=SimpleNamespace(law=law)),
    )  # fmt: skip
    assert Equations._held(cast("Equations", fake), 0, cast("Balance", SimpleNamespace(name="table"))) is held
