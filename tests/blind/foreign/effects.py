"""Effects in a rig: every cause of the catalogue and forms outside it, in sizes of the rig's own motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from instrument import Chain
from rigs import GROUND, Draw, Link, Rig


@dataclass(frozen=True, kw_only=True)
class Swing:
    """Largest deflection (m), speed (m/s) of each link and largest value of each channel, and the session's length in s."""

    deflection: Mapping[str, float]
    speed: Mapping[str, float]
    peak: Mapping[str, float]
    seconds: float


@dataclass(kw_only=True)
class Hidden:
    """What the rig really is, in addition to its description.

    Parameters
    ----------
    rig
        The rig, with added bodies.
    laws
        Further laws by link: name and parameters.
    rubs
        Friction by link in place of the described one: name and parameters; None where there is none.
    chains
        Faults of channels.
    lock
        Stiffness and damping of an elastic lock.
    known
        Factors of described values that the lab takes for known, by path.
    uneven
        Share, pitch and phase of an uneven friction level.
    told
        The answer: effect, cause, kinds, place and parameters of everything hidden.
    """

    rig: Rig
    laws: list[tuple[str, str, tuple[float, ...]]] = field(default_factory=list)
    rubs: dict[str, tuple[str, tuple[float, ...]] | None] = field(default_factory=dict)
    chains: dict[str, Chain] = field(default_factory=dict)
    lock: tuple[float, float] | None = None
    known: dict[str, float] = field(default_factory=dict)
    uneven: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    told: list[dict[str, object]] = field(default_factory=list)

    def chain(self, channel: str) -> Chain:
        """The channel's chain, made if there is none."""
        return self.chains.setdefault(channel, Chain())


Maker = Callable[[Hidden, Swing, str, float, Draw], dict[str, float]]


def _sign(draw: Draw) -> float:
    return float(draw.choice([-1.0, 1.0]))


def _spring_force(h: Hidden, s: Swing, place: str) -> float:
    return h.rig.link(place).k * s.deflection[place]


def _level(h: Hidden, place: str) -> float:
    return next(rub.force for rub in h.rig.rubs if rub.name == place)


def _coulomb(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    force = size * draw.uniform(0.08, 0.25) * _spring_force(h, s, place)
    h.rubs[place] = ("coulomb", (force,))
    return {"friction_force": force}


def _stribeck(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    force = _level(h, place)
    static, speed = force * (1 + size * draw.uniform(0.5, 1.2)), draw.uniform(0.03, 0.12) * s.speed[place]
    h.rubs[place] = ("stribeck", (force, static, speed))
    return {"friction_force": force, "static_force": static, "stribeck_velocity": speed}


def _asymmetric(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    share = _sign(draw) * size * draw.uniform(0.3, 0.6)
    forward, backward = _level(h, place) * (1 + share), _level(h, place) * (1 - share)
    # Two dry levels are a constant force while it slides, which no accelerometer sees; a lip seal drags more one way, too.
    drag = share * draw.uniform(0.6, 1.2) * _level(h, place) / s.speed[place]
    h.rubs[place] = ("asymmetric", (forward, backward, max(drag, 0.0), max(-drag, 0.0)))
    return {"forward_force": forward, "backward_force": backward, "forward - backward viscosity": drag}


def _uneven(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    share, pitch = size * draw.uniform(0.5, 0.85), draw.uniform(0.6, 1.8) * s.deflection[place]
    h.uneven[place] = (share, pitch, draw.uniform(0.0, 6.0))
    return {"share": share, "pitch": pitch}


def _worn(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    rate = _sign(draw) * size * draw.uniform(0.4, 0.7) / s.seconds
    h.rubs[place] = ("worn", (_level(h, place), rate))
    return {"rate": rate}


def _presliding(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    force = _level(h, place)
    stiffness = force / (size * draw.uniform(0.03, 0.1) * s.deflection[place])
    h.rubs[place] = None
    h.laws.append((place, "dahl", (force, stiffness)))
    return {"friction_force": force, "bristle_stiffness": stiffness}


def _lugre(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    force, mass = _level(h, place), h.rig.bodies[h.rig.link(place).a]
    bristle = force / (size * draw.uniform(0.03, 0.08) * s.deflection[place])
    static, speed = force * (1 + size * draw.uniform(0.3, 0.7)), draw.uniform(0.05, 0.15) * s.speed[place]
    damping = draw.uniform(0.1, 0.4) * np.sqrt(bristle * mass)
    h.rubs[place] = None
    h.laws.append((place, "lugre", (bristle, force, static, speed, damping)))
    return {"bristle_stiffness": bristle, "friction_force": force, "static_force": static}


def _loop(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    force = _level(h, place) if h.rig.rubs else size * draw.uniform(0.1, 0.25) * _spring_force(h, s, place)
    stiffness = force / ((size if h.rig.rubs else 1.0) * draw.uniform(0.05, 0.2) * s.deflection[place])
    h.rubs[place] = None
    h.laws.append((place, "bouc-wen", (force, stiffness, draw.uniform(1.5, 3.0), draw.uniform(0.5, 0.9))))
    return {"friction_force": force, "initial_stiffness": stiffness}


def _sliders(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    force = _level(h, place) if h.rig.rubs else size * draw.uniform(0.1, 0.25) * _spring_force(h, s, place)
    give = (size if h.rig.rubs else 1.0) * draw.uniform(0.05, 0.15) * s.deflection[place]
    h.rubs[place] = None
    h.laws.append((place, "sliders", (4.0, force / 4.0 / give, force / 4.0, 0.0)))
    return {"friction_force": force, "give": give}


def _play(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    force = size * draw.uniform(0.12, 0.3) * _spring_force(h, s, place)
    play, give = draw.uniform(0.05, 0.2) * s.deflection[place], draw.uniform(0.05, 0.2) * s.deflection[place]
    h.rubs[place] = None
    h.laws.append((place, "sliders", (1.0, force / give, force, play)))
    return {"clearance": play, "slip_force": force}


def _relaxing(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    link = h.rig.link(place)
    mass = h.rig.bodies[link.a]
    stiffness = size * draw.uniform(0.3, 0.8) * link.k
    time = draw.uniform(0.5, 2.0) / np.sqrt(link.k / mass)
    h.laws.append((place, "maxwell", (stiffness, time)))
    return {"relaxation_stiffness": stiffness, "relaxation_time": time}


def _hardening(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    k3 = size * draw.uniform(0.3, 1.0) * h.rig.link(place).k / s.deflection[place] ** 2
    h.laws.append((place, "power", (k3, 3.0)))
    return {"cubic_stiffness": k3}


def _fifth(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    k5 = size * draw.uniform(0.5, 1.2) * h.rig.link(place).k / s.deflection[place] ** 4
    h.laws.append((place, "power", (k5, 5.0)))
    return {"k5": k5}


def _softening(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    share, scale = size * draw.uniform(0.3, 0.6), draw.uniform(0.1, 0.4) * s.deflection[place]
    h.laws.append((place, "softening", (share, scale)))
    return {"softening": share, "scale": scale}


def _backlash(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    clearance = size * draw.uniform(0.08, 0.2) * s.deflection[place]
    h.laws.append((place, "backlash", (clearance, draw.uniform(0.0, 0.06))))
    return {"clearance": clearance}


def _smooth_backlash(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    clearance = size * draw.uniform(0.1, 0.25) * s.deflection[place]
    h.laws.append((place, "smooth backlash", (clearance, draw.uniform(0.02, 0.1), draw.uniform(0.15, 0.4) * clearance)))
    return {"clearance": clearance}


def _stop(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    stroke, k = draw.uniform(0.45, 0.7) * s.deflection[place], size * draw.uniform(1.5, 5.0) * h.rig.link(place).k
    h.laws.append((place, "stop", (stroke, k, 0.0)))
    return {"stroke": stroke, "contact_stiffness": k}


def _damping_stop(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    link = h.rig.link(place)
    stroke, k = draw.uniform(0.4, 0.65) * s.deflection[place], size * draw.uniform(1.5, 5.0) * link.k
    h.laws.append((place, "stop", (stroke, k, draw.uniform(2.0, 6.0) * link.c)))
    return {"stroke": stroke, "contact_stiffness": k}


def _one_stop(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    stroke, k = draw.uniform(0.3, 0.6) * s.deflection[place], size * draw.uniform(2.0, 5.0) * h.rig.link(place).k
    h.laws.append((place, "one-sided stop", (stroke, k, _sign(draw))))
    return {"stroke": stroke, "contact_stiffness": k}


def _cogging(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    force = size * draw.uniform(0.06, 0.15) * _spring_force(h, s, place)
    pitch = draw.uniform(0.35, 0.8) * s.deflection[place]
    h.laws.append((place, "cogging", (force, pitch, draw.uniform(0.0, 2 * np.pi))))
    return {"force": force, "pitch": pitch}


def _drag(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    viscous = h.rig.link(place).c * s.speed[place]
    friction = _level(h, place) if any(rub.name == place for rub in h.rig.rubs) else 0.0
    c2 = size * draw.uniform(0.7, 2.5) * max(viscous, friction) / s.speed[place] ** 2
    h.laws.append((place, "speed power", (c2, 2.0)))
    return {"quadratic_damping": c2}


def _cubic_damping(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    c3 = size * draw.uniform(1.5, 4.0) * h.rig.link(place).c / s.speed[place] ** 2
    h.laws.append((place, "speed power", (c3, 3.0)))
    return {"c3": c3}


def _drift(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    rate = _sign(draw) * size * draw.uniform(0.15, 0.3) / s.seconds
    h.laws.append((place, "drift", (rate,)))
    return {"drift_rate": rate}


def _mode(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    rig = h.rig
    if rig.name == "wire bonder":
        f = draw.uniform(*{"table": (20.0, 90.0), "heatblock": (60.0, 300.0), "motor": (20.0, 120.0)}[place])
        mass, zeta = size * draw.uniform(0.02, 0.06) * rig.bodies[place], draw.uniform(0.01, 0.04)
    else:
        link = next(x for x in rig.links if place in (x.a, x.b))
        f = np.sqrt(link.k / rig.bodies[place]) * draw.uniform(1.2, 2.2) / (2 * np.pi)
        mass, zeta = size * draw.uniform(0.03, 0.1) * rig.bodies[place], draw.uniform(0.01, 0.03)
    _attach(rig, "loose", place, mass, f, zeta)
    return {"mode_mass": mass, "mode_frequency": f, "mode_damping": zeta}


def _attach(rig: Rig, name: str, body: str, mass: float, f: float, zeta: float) -> None:
    omega = 2 * np.pi * f
    rig.bodies[name] = mass
    rig.links.append(Link(name=name, a=name, b=body, k=mass * omega**2, c=2 * zeta * mass * omega))


def _rocking(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    rig = h.rig
    inertia, f = rig.bodies["motor"] * draw.uniform(0.06, 0.12) ** 2, draw.uniform(15.0, 60.0)
    arm, height, bearing = size * draw.uniform(0.01, 0.04), draw.uniform(0.02, 0.06), draw.uniform(0.01, 0.04)
    _attach(rig, "bearings", GROUND, inertia, f, draw.uniform(0.02, 0.06))
    rig.pushes["bearings"] = arm * rig.pushes["motor"]
    rig.link("isolation").arms["bearings"] = bearing
    next(x for x in rig.sensors if x.body == "motor").arms["bearings"] = height
    rig.locks = (*rig.locks, "bearings")
    return {"drive_arm": arm, "sensor_height": height}


def _wrong_mass(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    factor = 1.0 + _sign(draw) * size * draw.uniform(0.08, 0.18)
    h.known["drive.factor" if place == h.rig.drive else f"bodies.{place}.mass"] = factor
    return {"described / true": factor}


def _lock(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    k = h.rig.link("isolation").k * draw.uniform(50.0, 400.0) / size
    h.lock = (k, 2 * draw.uniform(0.01, 0.05) * np.sqrt(k * h.rig.bodies["motor"]))
    return {"lock_stiffness": k}


def _delay(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    h.chain(place).delay = size * draw.uniform(0.8, 2.5) / h.rig.rate
    return {"delay": h.chain(place).delay}


def _gain(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    h.chain(place).gain = 1.0 + _sign(draw) * size * draw.uniform(0.08, 0.2)
    return {"factor": h.chain(place).gain}


def _clipping(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    h.chain(place).limit = (1.0 - size * draw.uniform(0.35, 0.6)) * s.peak[place]
    return {"limit": h.chain(place).limit}


def _crosstalk(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    others = [x.channel for x in h.rig.sensors if x.channel != place and x.quantity == "acceleration"]
    source = str(draw.choice([*others, h.rig.drive]))
    share = _sign(draw) * size * draw.uniform(0.04, 0.1) * s.peak[place] / s.peak[source]
    h.chain(place).crosstalk[source] = share
    return {"fraction": share}


def _hum(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    height = size * draw.uniform(0.02, 0.06) * s.peak[place]
    h.chain(place).hum = (float(draw.choice([50.0, 60.0])), height, draw.uniform(0.1, 0.5), draw.uniform(0, 2 * np.pi))
    return {"amplitude": height}


def _bent(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    chain = h.chain(place)
    chain.bend, chain.peak = _sign(draw) * size * draw.uniform(0.15, 0.35), s.peak[place]
    return {"bend": chain.bend}


def _slow(h: Hidden, s: Swing, place: str, size: float, draw: Draw) -> dict[str, float]:
    h.chain(place).corner = size * draw.uniform(1.0, 3.0)
    return {"corner": h.chain(place).corner}


@dataclass(frozen=True)
class Effect:
    """How it is made, the catalogued cause or None, the kinds that name it, and where it may be.

    `where` is "spring", "rub" (a described friction), "bare" (a link without one), "body", "motor", "mass" (a known one), "lock",
    "channel" (also the drive), "sensor" or "accelerometer".
    """

    make: Maker
    cause: str | None
    kinds: tuple[str, ...]
    where: str


EFFECTS: Mapping[str, Effect] = {
    "coulomb_friction": Effect(_coulomb, "coulomb_friction", ("friction_shape",), "bare"),
    "stribeck_friction": Effect(_stribeck, "stribeck_friction", ("friction_shape",), "rub"),
    "asymmetric_friction": Effect(_asymmetric, "asymmetric_friction", ("friction_shape",), "rub"),
    "presliding_friction": Effect(_presliding, "presliding_friction", ("memory",), "rub"),
    "play_and_friction": Effect(_play, "play_and_friction", ("memory",), "bare"),
    "relaxation": Effect(_relaxing, "relaxation", ("memory",), "spring"),
    "hardening_stiffness": Effect(_hardening, "hardening_stiffness", ("spring_shape",), "spring"),
    "softening_stiffness": Effect(_softening, "softening_stiffness", ("spring_shape",), "spring"),
    "backlash": Effect(_backlash, "backlash", ("spring_shape",), "spring"),
    "end_stop": Effect(_stop, "end_stop", ("spring_shape",), "spring"),
    "quadratic_damping": Effect(_drag, "quadratic_damping", ("damping_shape",), "spring"),
    "stiffness_drift": Effect(_drift, "stiffness_drift", ("drift",), "spring"),
    "extra_mode": Effect(_mode, "extra_mode", ("added_motion",), "body"),
    "moment_coupling": Effect(_rocking, "moment_coupling", ("added_motion",), "motor"),
    "wrong_mass": Effect(_wrong_mass, "wrong_mass", ("known_value",), "mass"),
    "imperfect_lock": Effect(_lock, "imperfect_lock", ("added_motion",), "lock"),
    "channel_delay": Effect(_delay, "channel_delay", ("sensor",), "channel"),
    "sensor_gain": Effect(_gain, "sensor_gain", ("sensor",), "sensor"),
    "clipping": Effect(_clipping, "clipping", ("sensor",), "accelerometer"),
    "crosstalk": Effect(_crosstalk, "crosstalk", ("sensor",), "accelerometer"),
    "mains_hum": Effect(_hum, "mains_hum", ("sensor",), "accelerometer"),
    "uneven friction": Effect(_uneven, None, ("friction_shape",), "rub"),
    "worn friction": Effect(_worn, None, ("drift",), "rub"),
    "lugre": Effect(_lugre, None, ("memory", "friction_shape"), "rub"),
    "hysteresis": Effect(_loop, "hysteresis", ("memory",), "slide"),
    "iwan": Effect(_sliders, None, ("memory",), "slide"),
    "fifth power": Effect(_fifth, None, ("spring_shape",), "spring"),
    "cogging": Effect(_cogging, None, ("spring_shape",), "spring"),
    "one-sided stop": Effect(_one_stop, None, ("spring_shape",), "spring"),
    "stop that damps": Effect(_damping_stop, "end_stop", ("spring_shape",), "spring"),
    "smooth backlash": Effect(_smooth_backlash, "backlash", ("spring_shape",), "spring"),
    "cubic damping": Effect(_cubic_damping, None, ("damping_shape",), "spring"),
    "bent sensor": Effect(_bent, None, ("sensor",), "sensor"),
    "slow sensor": Effect(_slow, "ac_coupling", ("sensor",), "accelerometer"),
}
PAIRS = (
    ("hardening_stiffness", "sensor_gain"), ("stribeck_friction", "channel_delay"), ("extra_mode", "hardening_stiffness"),
    ("backlash", "sensor_gain"), ("stiffness_drift", "quadratic_damping"), ("end_stop", "crosstalk"),
    ("coulomb_friction", "channel_delay"), ("coulomb_friction", "hardening_stiffness"), ("cogging", "sensor_gain"),
    ("relaxation", "sensor_gain"), ("one-sided stop", "coulomb_friction"), ("uneven friction", "wrong_mass"),
    ("end_stop", "coulomb_friction"), ("quadratic_damping", "channel_delay"), ("wrong_mass", "hardening_stiffness"),
)  # fmt: skip
#: Effects of the wire bonder's sliding isolation: its other springs have too small strokes or no stops.
SLIDING = frozenset({
    "backlash", "end_stop", "quadratic_damping", "cogging", "one-sided stop", "stop that damps", "smooth backlash",
})  # fmt: skip


def places(name: str, rig: Rig) -> list[str]:
    """Where an effect may be in a rig; empty if it has no place for it."""
    where = EFFECTS[name].where
    rubbing = [rub.name for rub in rig.rubs]
    bonder = rig.name == "wire bonder"
    springs = [x.name for x in rig.links if x.k > 0.0]
    slides = ["isolation"] if bonder else springs
    accelerometers = [x.channel for x in rig.sensors if x.quantity == "acceleration"]
    bodies = [x for x in rig.bodies if x != rig.imposes]
    # With an unknown factor or an imposed motion only ratios of masses matter: another mass imitates a wrong one.
    ratios = "drive.factor" in rig.unknown or rig.imposes is not None
    found = {
        "spring": slides if name in SLIDING else springs,
        "rub": rubbing,
        "bare": [] if bonder else [x for x in springs if x not in rubbing],
        "slide": rubbing if rubbing else slides,
        "body": bodies,
        "motor": ["motor"] if bonder else [],
        "mass": ["head", "motor", "heatblock"] if bonder else [] if ratios else bodies,
        "lock": ["lock"] if rig.locks else [],
        "channel": [rig.drive, *(x.channel for x in rig.sensors)],
        "sensor": [x.channel for x in rig.sensors],
        "accelerometer": accelerometers,
    }  # fmt: skip
    return found[where]


def soil(h: Hidden, s: Swing, share: float, draw: Draw) -> list[tuple[str, str]]:
    """Small loose parts, uneven friction, bent sensors and calibrations; returns (kind, place) of what an answer may name."""
    found: list[tuple[str, str]] = []
    bodies = [name for name in h.rig.bodies if name not in ("loose", "bearings", h.rig.imposes)]
    for k in range(2):
        body = str(draw.choice(bodies))
        link = next(x for x in h.rig.links if body in (x.a, x.b))
        low, high = (15.0, 250.0) if h.rig.name == "wire bonder" else np.sqrt(link.k / h.rig.bodies[body]) * np.array([0.2, 0.7])
        mass = share * draw.uniform(0.05, 0.25) * h.rig.bodies[body]
        _attach(h.rig, f"dirt{k}", body, mass, draw.uniform(low, high), draw.uniform(0.01, 0.04))
        found.append(("added_motion", body))
    for place in dict.fromkeys([rub.name for rub in h.rig.rubs] + [name for name, rub in h.rubs.items() if rub]):
        if place not in h.uneven:
            h.uneven[place] = (2.0 * share, draw.uniform(0.5, 1.5) * s.deflection[place], draw.uniform(0.0, 6.0))
        found.append(("friction_shape", place))
    for sensor in h.rig.sensors:
        chain = h.chain(sensor.channel)
        if not chain.bend:
            chain.bend, chain.peak = share * draw.uniform(-0.5, 0.5), s.peak[sensor.channel]
        chain.gain *= 1.0 + 0.25 * share * draw.normal()
        found.append(("sensor", sensor.channel))
    return found
