"""Small rigs that are not the wire bonder, played by the project's own simulator with noise on every channel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.analysis.model.rig_model import Body, Chain, Contact, Drive, Link, RigModel, Sensor
from isorig.analysis.simulate import Excitation, simulate

#: Cubic stiffness in N/m^3 of the spring that the fixture `hardened` hides between two carts.
HARDENING = 4e5
UNITS = {"displacement": "m", "acceleration": "m/s^2", "force": "N", "voltage": "V"}


@dataclass(frozen=True)
class Take:
    """A run: level of the drive, seed of its wave (equal seeds are one drive), seconds of rest in front."""

    level: float
    wave: int
    rest: float = 0.0


SESSION = (Take(3.0, 1), Take(3.0, 1), Take(1.5, 2), Take(6.0, 3))
#: A small drive and a large one: enough where neither repetitions nor drifts between runs count.
PAIR = SESSION[::3]


def carts() -> RigModel:
    """Two carts with encoders; a voltage pushes the first through a factor that nobody knows."""
    return RigModel(
        name="two carts",
        bodies=(Body(name="first", mass=1.5), Body(name="second", mass=1.1)),
        links=(
            Link(name="wall", a="first", stiffness=410.0, damping=3.0),
            Link(name="between", a="first", b="second", stiffness=330.0, damping=0.8),
        ),
        drive=Drive(channel="u", factor=4.0, pushes={"first": 1.0}, quantity="voltage"),
        sensors=tuple(Sensor(channel=f"x{k}", body=body, quantity="displacement") for k, body in enumerate(("first", "second"))),
        free=(
            "drive.factor", "links.wall.stiffness", "links.wall.damping", "links.between.stiffness", "links.between.damping",
            "bodies.second.mass",
        ),
    )  # fmt: skip


def chain() -> RigModel:
    """Three masses in a row, pushed at the last one by a measured force."""
    return RigModel(
        name="chain",
        bodies=tuple(Body(name=f"m{k}", mass=1.0 + 0.3 * k) for k in range(3)),
        links=(
            Link(name="l0", a="m0", stiffness=4200.0, damping=4.0),
            Link(name="l1", a="m1", b="m0", stiffness=2900.0, damping=3.0),
            Link(name="l2", a="m2", b="m1", stiffness=3500.0, damping=3.0),
        ),
        drive=Drive(channel="f", factor=1.0, pushes={"m2": 1.0}, quantity="force"),
        sensors=tuple(Sensor(channel=f"a{k}", body=f"m{k}") for k in range(3)),
        free=tuple(f"links.l{k}.{name}" for k in range(3) for name in ("stiffness", "damping")),
    )


def stage() -> RigModel:
    """One mass on a soft spring and a rail, pushed by a measured force, with position and acceleration measured."""
    return RigModel(
        name="stage",
        bodies=(Body(name="table", mass=4.0),),
        links=(Link(name="rail", a="table", stiffness=2500.0, damping=12.0),),
        drive=Drive(channel="f", factor=1.0, pushes={"table": 1.0}, quantity="force"),
        sensors=(
            Sensor(channel="x", body="table", quantity="displacement"),
            Sensor(channel="a", body="table", quantity="acceleration"),
        ),
        free=("links.rail.stiffness", "links.rail.damping", "bodies.table.mass"),
    )


def with_law(model: RigModel, link: str, law: laws.LinkLaw) -> RigModel:
    """The rig with one more law on a link."""
    return replace(model, links=tuple(replace(one, laws=(*one.laws, law)) if one.name == link else one for one in model.links))


def rubbing(model: RigModel, link: str, force: float) -> RigModel:
    """The rig with dry friction beside a link."""
    one = model.link(link)
    contact = Contact(name=link, a=one.a, b=one.b, arms=one.arms, law=laws.Coulomb(friction_force=force))
    return replace(model, contacts=(*model.contacts, contact))


def late(model: RigModel, seconds: float) -> RigModel:
    """The rig whose drive channel is recorded late."""
    return replace(model, drive=replace(model.drive, chain=Chain(delay=seconds)))


def played(truth: RigModel, *, seed: int, takes: Sequence[Take] = PAIR, longer: float = 1.0) -> Campaign:
    """What a lab would have recorded of a rig: steps for a voltage, band-limited noise for a force; so many times longer."""
    from scipy.signal import butter, sosfilt

    draw = np.random.default_rng(seed)
    steps = truth.drive.quantity == "voltage"
    rate, seconds = (200.0, 20.0) if steps else (400.0, 12.0)
    runs = []
    for k, take in enumerate(takes):
        wave, n = np.random.default_rng(take.wave), round(longer * seconds * rate)
        if steps:
            drive = np.repeat(wave.uniform(-1.0, 1.0, n // 100 + 1), 100)[:n]
        else:
            drive = 6.0 * sosfilt(butter(2, [1.0, 30.0], btype="band", fs=rate, output="sos"), wave.normal(0.0, 1.0, n))
        drive = np.concatenate([np.zeros(round(take.rest * rate)), take.level * drive])
        seen = simulate(truth, Excitation.prepare(drive, rate, oversample=4), as_recorded=True).channels

        # Noise is as large in every run: the response grows with the level, the sensor's noise does not.
        usual = takes[0].level / take.level

        sensors = {sensor.channel: sensor.quantity for sensor in truth.sensors}
        quantities = {truth.drive.channel: truth.drive.quantity, **sensors}
        clean = {truth.drive.channel: drive, **{name: seen[name] for name in sensors}}
        records = {
            name: values + draw.normal(0.0, usual * (2e-3 if name in sensors else 1e-4) * float(np.std(values)), len(values))
            for name, values in clean.items()
        }
        channels = {
            name: Channel(name=name, samples=records[name], quantity=quantity, unit=UNITS[quantity])
            for name, quantity in quantities.items()
        }
        runs.append(
            Run(id=f"r{k}", configuration="unlocked", sample_rate=rate, gain=take.level, channels=channels, excitation="random")
        )
    return Campaign(runs=tuple(runs), source=truth.name)


def guessed(model: RigModel, seed: int) -> RigModel:
    """The rig as its description would give it: every free value up to a quarter off."""
    draw = np.random.default_rng(seed)
    return model.replace({path: model.get(path) * float(draw.uniform(0.8, 1.25)) for path in model.free})
