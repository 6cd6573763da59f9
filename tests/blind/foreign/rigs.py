"""Rigs of several families, drawn at random: bodies, springs, friction, sensors, sessions, and the description that a lab has."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

Draw = np.random.Generator
GROUND = "ground"
ORDER = {
    "displacement": 0, "angle": 0, "velocity": 1, "angular_velocity": 1, "acceleration": 2, "angular_acceleration": 2,
}  # fmt: skip
#: A description's value is wrong by up to this factor, either way.
WRONG = 1.25


@dataclass(kw_only=True)
class Link:
    """A spring and damper; `arms` add factor times coordinate to its elongation."""

    name: str
    a: str
    b: str
    k: float
    c: float
    arms: dict[str, float] = field(default_factory=dict)


@dataclass(kw_only=True)
class Rubbing:
    """Dry friction that the lab knows of, N."""

    name: str
    a: str
    b: str
    force: float


@dataclass(kw_only=True)
class Sensor:
    """What a channel measures."""

    channel: str
    body: str
    quantity: str = "acceleration"
    relative_to: str = GROUND
    arms: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Take:
    """A run: level of the drive, its kind and band in Hz, seconds, seed of its wave, seconds of rest in front."""

    id: str
    level: float
    seconds: float
    wave: int
    begin: float
    kind: Literal["random", "moves", "steps"] = "random"
    band: tuple[float, float] = (0.5, 20.0)
    configuration: str = "unlocked"
    repeat_of: str | None = None


@dataclass(kw_only=True)
class Rig:
    """A sound rig and the session that is measured on it.

    Parameters
    ----------
    name, bodies, links, rubs, sensors
        The rig; `bodies` has each mass in kg (kg m^2 of a rotation).
    drive, quantity, factor
        Channel of the drive, what it measures, and N per unit.
    pushes, imposes
        Weights of the drive's force at the bodies, or the body whose acceleration the drive is.
    locks
        The links that the configuration `locked` blocks.
    unknown
        Paths of the values that the lab does not know.
    takes, rate
        The session, and its sample rate in Hz.
    rms
        rms of the drive at level 1, in its unit.
    turns
        Whether the coordinates are angles.
    counts
        Counts of an encoder over the largest motion; 0 where the channels have converters.
    finest
        Steps of its simulation per second at least.
    """

    name: str
    bodies: dict[str, float]
    links: list[Link]
    rubs: list[Rubbing]
    sensors: list[Sensor]
    drive: str
    quantity: str
    factor: float
    pushes: dict[str, float]
    takes: tuple[Take, ...]
    rate: float
    rms: float
    unknown: tuple[str, ...]
    imposes: str | None = None
    locks: tuple[str, ...] = ()
    turns: bool = False
    counts: int = 0
    finest: float = 32768.0

    def link(self, name: str) -> Link:
        """The link with that name."""
        return next(link for link in self.links if link.name == name)


def _spread(draw: Draw, value: float, share: float) -> float:
    return float(value * np.exp(draw.uniform(-share, share)))


def _session(
    draw: Draw, seconds: float, band: tuple[float, float], kind: Literal["random", "steps"] = "random"
) -> tuple[Take, ...]:
    # Two equal runs, a weak one, a strong one, and one with another drive.
    levels = ("a", 1.0, None), ("b", 1.0, "a"), ("weak", 0.4, None), ("strong", 2.0, None), ("last", 1.4, None)
    waves = draw.integers(2**31, size=5)
    return tuple(
        Take(
            id=name, level=level, seconds=seconds, wave=int(waves[0 if repeat else k]), begin=k * (seconds + 20.0), kind=kind,
            band=band, repeat_of=repeat,
        )
        for k, (name, level, repeat) in enumerate(levels)
    )  # fmt: skip


def wire_bonder(draw: Draw) -> Rig:
    """Head, motor, table and heatblock, dry friction at the isolation, a lock, and moves."""
    m3, m1, m2 = _spread(draw, 16.4, 0.12), _spread(draw, 80.0, 0.15), _spread(draw, 6.0, 0.2)
    spring = {}
    for name, mass, f, zeta in (("table", m1, 10.8, 0.015), ("heatblock", m2, 164.5, 0.009), ("isolation", m3, 5.06, 0.073)):
        omega = 2 * np.pi * _spread(draw, f, 0.08)
        spring[name] = (omega**2 * mass, 2 * _spread(draw, zeta, 0.4) * omega * mass)
    waves = draw.integers(2**31, size=6)
    shake, fine = (0.5, 20.0), (0.5, 400.0)
    takes = (
        Take(id="u70a", level=70.0, seconds=60.0, wave=int(waves[0]), begin=0.0, band=shake),
        Take(id="u70r", level=70.0, seconds=60.0, wave=int(waves[0]), begin=80.0, band=shake, repeat_of="u70a"),
        Take(id="u35", level=35.0, seconds=60.0, wave=int(waves[1]), begin=160.0, band=shake),
        Take(id="u7", level=7.0, seconds=40.0, wave=int(waves[2]), begin=240.0, band=fine),
        Take(id="l70", level=70.0, seconds=40.0, wave=int(waves[3]), begin=300.0, band=shake, configuration="locked"),
        Take(id="l7", level=7.0, seconds=40.0, wave=int(waves[4]), begin=360.0, band=fine, configuration="locked"),
        Take(id="umove", level=70.0, seconds=20.0, wave=int(waves[5]), begin=420.0, kind="moves"),
    )
    links = [Link(name=n, a="motor" if n == "isolation" else n, b=GROUND if n == "table" else "table", k=k, c=c)
             for n, (k, c) in spring.items()]  # fmt: skip
    return Rig(
        name="wire bonder", bodies={"table": m1, "heatblock": m2, "motor": m3}, links=links,
        rubs=[Rubbing(name="isolation", a="motor", b="table", force=float(draw.uniform(5.0, 18.0)))],
        sensors=[Sensor(channel=body, body=body) for body in ("motor", "table", "heatblock")],
        drive="head", quantity="acceleration", factor=_spread(draw, 6.5, 0.15), pushes={"motor": -1.0}, takes=takes,
        rate=1024.0, rms=3.8 / 70.0, locks=("isolation",),
        unknown=("bodies.table.mass", *(f"links.{n}.{x}" for n in spring for x in ("stiffness", "damping")),
                 "contacts.isolation.law.friction_force"),
    )  # fmt: skip


def chain(draw: Draw) -> Rig:
    """Two to four masses in a row on the ground, a measured force, an accelerometer on each."""
    count = int(draw.integers(2, 5))
    masses = [_spread(draw, 1.5, 0.5) for _ in range(count)]
    links = []
    for k in range(count):
        omega = 2 * np.pi * draw.uniform(7.0, 14.0)
        size = omega**2 * float(np.mean(masses)) * (1.0 if k else draw.uniform(1.0, 2.0))
        zeta = draw.uniform(0.015, 0.05)
        links.append(Link(name=f"l{k}", a=f"m{k}", b=f"m{k - 1}" if k else GROUND, k=size, c=2 * zeta * size / omega))
    last = int(draw.integers(count))
    rate, high = float(draw.choice([512.0, 1024.0])), float(draw.uniform(30.0, 60.0))
    return Rig(
        name=f"chain of {count}", bodies={f"m{k}": m for k, m in enumerate(masses)}, links=links, rubs=[],
        sensors=[Sensor(channel=f"a{k}", body=f"m{k}") for k in range(count)], drive="f", quantity="force", factor=1.0,
        pushes={f"m{last}": 1.0}, takes=_session(draw, 30.0, (1.0, high)), rate=rate, rms=15.0,
        unknown=tuple(f"links.{x.name}.{y}" for x in links for y in ("stiffness", "damping")),
    )  # fmt: skip


def cart(draw: Draw) -> Rig:
    """Two or three carts with encoders, rest and steps of a voltage whose factor is unknown."""
    count = int(draw.integers(2, 4))
    names = ("first", "second", "third")[:count]
    bodies = {name: _spread(draw, 1.3, 0.3) for name in names}
    links = [Link(name="wall", a="first", b=GROUND, k=_spread(draw, 420.0, 0.4), c=_spread(draw, 4.0, 0.4))]
    for k, (a, b) in enumerate(zip(names[1:], names[:-1], strict=True)):
        links.append(
            Link(name=f"between{k}" if k else "between", a=a, b=b, k=_spread(draw, 350.0, 0.4), c=_spread(draw, 1.5, 0.4))
        )
    rubs = [Rubbing(name="wall", a="first", b=GROUND, force=float(draw.uniform(0.5, 1.5)))] if draw.random() < 0.4 else []
    return Rig(
        name=f"{count} carts", bodies=bodies, links=links, rubs=rubs,
        sensors=[Sensor(channel=f"x{k + 1}", body=name, quantity="displacement") for k, name in enumerate(names)],
        drive="u", quantity="voltage", factor=_spread(draw, 4.0, 0.4), pushes={"first": 1.0},
        takes=_session(draw, 24.0, (0.1, 8.0), "steps"), rate=float(draw.choice([200.0, 250.0, 500.0])), rms=1.5,
        counts=int(draw.integers(2000, 8000)),
        unknown=("drive.factor", *(f"bodies.{name}.mass" for name in names[1:]),
                 *(f"links.{x.name}.{y}" for x in links for y in ("stiffness", "damping")),
                 *(f"contacts.{x.name}.law.friction_force" for x in rubs)),
    )  # fmt: skip


def stage(draw: Draw) -> Rig:
    """A stage pushed by a coil: one mass on a rail with position and acceleration, or one in a frame on feet."""
    rate, waves = float(draw.choice([500.0, 1000.0])), (0.5, float(draw.uniform(20.0, 40.0)))
    m, f, zeta = _spread(draw, 3.0, 0.4), draw.uniform(3.0, 8.0), draw.uniform(0.03, 0.1)
    omega = 2 * np.pi * f
    framed = bool(draw.random() < 0.5)
    rail = Link(name="rail", a="stage", b="frame" if framed else GROUND, k=m * omega**2, c=2 * zeta * m * omega)
    rubs = [Rubbing(name="rail", a="stage", b=rail.b, force=float(draw.uniform(0.8, 2.5)))] if draw.random() < 0.5 else []
    links, bodies, pushes = [rail], {"stage": m}, {"stage": 1.0}
    sensors = [Sensor(channel="x", body="stage", quantity="displacement", relative_to=rail.b)]
    if framed:
        frame, omega = _spread(draw, 40.0, 0.3), 2 * np.pi * draw.uniform(14.0, 25.0)
        bodies["frame"], pushes["frame"] = frame, -1.0
        links.append(Link(name="feet", a="frame", b=GROUND, k=frame * omega**2, c=2 * draw.uniform(0.02, 0.06) * frame * omega))
        sensors.append(Sensor(channel="frame", body="frame"))
    else:
        sensors.append(Sensor(channel="a", body="stage"))
    return Rig(
        name="stage in a frame" if framed else "stage on a rail", bodies=bodies, links=links, rubs=rubs, sensors=sensors,
        drive="coil", quantity="current", factor=_spread(draw, 18.0, 0.3), pushes=pushes, takes=_session(draw, 30.0, waves),
        rate=rate, rms=float(draw.uniform(0.6, 1.2)),
        unknown=(*(f"links.{x.name}.{y}" for x in links for y in ("stiffness", "damping")),
                 *(f"contacts.{x.name}.law.friction_force" for x in rubs)),
    )  # fmt: skip


def torsion(draw: Draw) -> Rig:
    """A motor and a load that turn, joined by a shaft or a belt, the load held by a spring; torque, angles or speeds."""
    motor, load = _spread(draw, 0.003, 0.4), _spread(draw, 0.015, 0.4)
    ratio = float(draw.choice([1.0, 0.5]))
    belt, mount = 2 * np.pi * draw.uniform(9.0, 16.0), 2 * np.pi * draw.uniform(2.0, 4.0)
    zeta, zeta_mount = draw.uniform(0.02, 0.06), draw.uniform(0.03, 0.08)
    links = [
        Link(name="belt", a="motor", b="load", k=motor * belt**2, c=2 * zeta * motor * belt,
             arms={} if ratio == 1.0 else {"load": 1.0 - ratio}),
        Link(name="mount", a="load", b=GROUND, k=load * mount**2, c=2 * zeta_mount * load * mount),
    ]  # fmt: skip
    rubs = [Rubbing(name="mount", a="load", b=GROUND, force=float(draw.uniform(0.01, 0.03)))] if draw.random() < 0.5 else []
    quantities = ("angle", "angular_velocity", "angular_acceleration")
    sensors = [Sensor(channel=f"{name}_turn", body=name, quantity=str(draw.choice(quantities))) for name in ("motor", "load")]
    return Rig(
        name="torsion drive", bodies={"motor": motor, "load": load}, links=links, rubs=rubs, sensors=sensors,
        drive="torque", quantity="torque", factor=1.0, pushes={"motor": 1.0},
        takes=_session(draw, 30.0, (0.5, float(draw.uniform(25.0, 45.0)))), rate=float(draw.choice([500.0, 1000.0])),
        rms=float(draw.uniform(0.1, 0.25)), turns=True,
        unknown=(*(f"links.{x.name}.{y}" for x in links for y in ("stiffness", "damping")),
                 *(f"contacts.{x.name}.law.friction_force" for x in rubs)),
    )  # fmt: skip


def base(draw: Draw) -> Rig:
    """A device on two stages above a base whose measured acceleration is the drive."""
    bodies = {"base": 20.0, "stage": _spread(draw, 8.0, 0.3), "device": _spread(draw, 3.0, 0.3)}
    links = []
    for name, a, b, f in (
        ("lower", "stage", "base", draw.uniform(5.0, 8.0)),
        ("upper", "device", "stage", draw.uniform(7.0, 13.0)),
    ):
        omega = 2 * np.pi * f
        links.append(Link(name=name, a=a, b=b, k=bodies[a] * omega**2, c=2 * draw.uniform(0.02, 0.06) * bodies[a] * omega))
    rubs = [Rubbing(name="lower", a="stage", b="base", force=float(draw.uniform(1.5, 4.0)))] if draw.random() < 0.3 else []
    return Rig(
        name="shaken base", bodies=bodies, links=links, rubs=rubs,
        sensors=[Sensor(channel=name, body=name) for name in ("stage", "device")], drive="base", quantity="acceleration",
        factor=1.0, pushes={}, imposes="base", takes=_session(draw, 30.0, (1.0, float(draw.uniform(30.0, 50.0)))),
        rate=float(draw.choice([512.0, 1024.0])), rms=float(draw.uniform(0.8, 1.6)),
        unknown=(*(f"links.{x.name}.{y}" for x in links for y in ("stiffness", "damping")),
                 *(f"contacts.{x.name}.law.friction_force" for x in rubs)),
    )  # fmt: skip


def partial(draw: Draw) -> Rig:
    """A chain of three or four masses of which one has no sensor."""
    rig = chain(draw)
    while len(rig.bodies) < 3:
        rig = chain(draw)
    del rig.sensors[int(draw.integers(len(rig.sensors)))]
    rig.name += " with one mass that is not measured"
    return rig


FAMILIES: Mapping[str, Callable[[Draw], Rig]] = {
    "wire_bonder": wire_bonder, "chain": chain, "cart": cart, "stage": stage, "torsion": torsion, "base": base,
    "partial": partial,
}  # fmt: skip


def described(rig: Rig, wrong: Mapping[str, float]) -> str:
    """The rig's description as a lab would have written it.

    Parameters
    ----------
    rig
        The sound rig.
    wrong
        Factors of values by path; others are as they are.
    """

    def value(path: str, true: float) -> float:
        return float(f"{true * wrong.get(path, 1.0):.6g}")

    motion = {"motion": "rotation"} if rig.turns else {}
    bodies = [{"name": name, "mass": value(f"bodies.{name}.mass", mass), **motion} for name, mass in rig.bodies.items()]
    links = [
        {
            "name": x.name, "a": x.a, "b": x.b, "stiffness": value(f"links.{x.name}.stiffness", x.k),
            "damping": value(f"links.{x.name}.damping", x.c), **({"arms": x.arms} if x.arms else {}),
        }
        for x in rig.links
    ]  # fmt: skip
    contacts = [
        {
            "name": x.name, "a": x.a, "b": x.b,
            "law": {"law": "coulomb", "friction_force": value(f"contacts.{x.name}.law.friction_force", x.force)},
        }
        for x in rig.rubs
    ]  # fmt: skip
    acts = {"imposes": rig.imposes} if rig.imposes else {"pushes": rig.pushes, "factor": value("drive.factor", rig.factor)}
    drive = {"channel": rig.drive, "quantity": rig.quantity, **acts}
    sensors = [
        {"channel": x.channel, "body": x.body, "quantity": x.quantity, "relative_to": x.relative_to,
         **({"arms": x.arms} if x.arms else {})}
        for x in rig.sensors
    ]  # fmt: skip
    tree: dict[str, object] = {
        "name": rig.name, "free": list(rig.unknown), "bodies": bodies, "links": links, "contacts": contacts, "drive": drive,
        "sensors": sensors,
    }  # fmt: skip
    if rig.locks:
        tree["configurations"] = {"unlocked": {}, "locked": {"rigid": list(rig.locks)}}
    return "\n".join(f"{key} = {_toml(item)}" for key, item in tree.items()) + "\n"


def _toml(item: object) -> str:
    if isinstance(item, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {_toml(v)}" for k, v in item.items()) + "}"
    if isinstance(item, list | tuple):
        return "[" + ", ".join(_toml(v) for v in item) + "]"
    return json.dumps(item)
