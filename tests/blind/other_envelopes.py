"""Envelopes of rigs that are not the wire bonder: a chain, two carts and a stage, with forms of no catalogue, dirt and rest.

The effects are drawn in the sizes of the rig's own motion. `KINDS` names everything that can be drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import msgspec
import numpy as np
from small_rigs import SESSION, Take, carts, chain, guessed, played, stage

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign, Channel, FloatArray
from isorig.analysis.diagnose.kinds import kind_of
from isorig.analysis.model.rig_model import Body, Chain, Contact, Link, RigModel, Sensor
from isorig.analysis.simulate import Excitation, simulate
from isorig.rig.wire_bonder.effects import generator_of

Draw = np.random.Generator


@dataclass(frozen=True, kw_only=True)
class OtherEnvelope:
    """What was hidden and what the lab has.

    Parameters
    ----------
    kind
        As drawn.
    truth
        (cause or None where no catalogue has it, kind, place) of everything hidden.
    campaign, later
        What was measured, then and afterwards.
    guess
        The rig as its description gives it.
    disturbances
        (kind, place) of the small imperfections, which an answer may name: they are there.
    """

    kind: str
    truth: tuple[tuple[str | None, str, str], ...]
    campaign: Campaign
    later: Campaign
    guess: RigModel
    disturbances: frozenset[tuple[str, str]] = frozenset()


@dataclass(frozen=True, kw_only=True)
class Motion:
    """How far (m) and how fast (m/s) each link moves, and the largest value of each channel, at the highest level."""

    deflection: Mapping[str, float]
    speed: Mapping[str, float]
    peak: Mapping[str, float]


RIGS: tuple[Callable[[], RigModel], ...] = (chain, carts, stage)


def drawn(draw: Draw) -> RigModel:
    """One of the rigs, its values up to a third off."""
    model = RIGS[int(draw.integers(len(RIGS)))]()
    values = {f"bodies.{b.name}.mass": b.mass for b in model.bodies}
    for link in model.links:
        values[f"links.{link.name}.stiffness"] = link.stiffness
        values[f"links.{link.name}.damping"] = link.damping
    return model.replace({path: value * float(draw.uniform(0.75, 1.33)) for path, value in values.items()})


def motion_of(model: RigModel) -> Motion:
    """From the session's highest level, undisturbed."""
    campaign = played(model, seed=0, takes=(max(SESSION, key=lambda take: take.level),))
    run = campaign.runs[0]
    seen = simulate(
        msgspec.structs.replace(
            model,
            sensors=(
                *model.sensors,
                *(
                    Sensor(channel=f"{kind} {link.name}", body=link.a, relative_to=link.b, quantity=quantity)
                    for link in model.links
                    for kind, quantity in (("d", "displacement"), ("v", "velocity"))
                ),
            ),
        ),
        Excitation.prepare(run.read(model.drive.channel), run.sample_rate, oversample=4),
    ).channels
    most = {name: float(np.abs(values).max()) for name, values in seen.items()}
    return Motion(
        deflection={link.name: most[f"d {link.name}"] for link in model.links},
        speed={link.name: most[f"v {link.name}"] for link in model.links},
        peak={sensor.channel: most[sensor.channel] for sensor in model.sensors},
    )


def _linked(model: RigModel, place: str, *more: laws.LinkLaw) -> RigModel:
    links = tuple(msgspec.structs.replace(x, laws=(*x.laws, *more)) if x.name == place else x for x in model.links)
    return msgspec.structs.replace(model, links=links)


def _rubbing(model: RigModel, place: str, law: laws.FrictionLaw) -> RigModel:
    link = model.link(place)
    return msgspec.structs.replace(model, contacts=(*model.contacts, Contact(name=place, a=link.a, b=link.b, law=law)))


def _chained(model: RigModel, channel: str, chain_: Chain) -> RigModel:
    sensors = tuple(msgspec.structs.replace(s, chain=chain_) if s.channel == channel else s for s in model.sensors)
    return msgspec.structs.replace(model, sensors=sensors)


def _curve(at: FloatArray, values: FloatArray, over: str = "deflection") -> laws.Curve:
    return laws.Curve(over=over, at=tuple(at.tolist()), values=tuple(values.tolist()))  # type: ignore[arg-type]


Maker = Callable[[RigModel, Motion, str, float, Draw], RigModel]


def _spring_force(m: RigModel, s: Motion, place: str) -> float:
    return m.link(place).stiffness * s.deflection[place]


def _coulomb(m: RigModel, s: Motion, place: str, size: float, draw: Draw) -> RigModel:
    return _rubbing(m, place, laws.Coulomb(friction_force=size * draw.uniform(0.08, 0.25) * _spring_force(m, s, place)))


def _stribeck(m: RigModel, s: Motion, place: str, size: float, draw: Draw) -> RigModel:
    force = draw.uniform(0.06, 0.15) * _spring_force(m, s, place)
    law = laws.Stribeck(
        friction_force=force, static_force=force * (1 + size * draw.uniform(0.6, 1.2)),
        stribeck_velocity=draw.uniform(0.05, 0.15) * s.speed[place],
    )  # fmt: skip
    return _rubbing(m, place, law)


def _hardening(m: RigModel, s: Motion, place: str, size: float, draw: Draw) -> RigModel:
    return _linked(
        m, place, laws.Cubic(cubic_stiffness=size * draw.uniform(0.3, 1.0) * m.link(place).stiffness / s.deflection[place] ** 2)
    )


def _end_stop(m: RigModel, s: Motion, place: str, size: float, draw: Draw) -> RigModel:
    k = size * draw.uniform(1.5, 5.0) * m.link(place).stiffness
    return _linked(m, place, laws.EndStop(stroke=draw.uniform(0.4, 0.65) * s.deflection[place], contact_stiffness=k))


def _damping_stop(m: RigModel, s: Motion, place: str, size: float, draw: Draw) -> RigModel:
    link = m.link(place)
    k, c = size * draw.uniform(1.5, 5.0) * link.stiffness, draw.uniform(2.0, 6.0) * link.damping
    stroke = draw.uniform(0.4, 0.65) * s.deflection[place]
    return _linked(m, place, laws.EndStop(stroke=stroke, contact_stiffness=k, contact_damping=c))


def _backlash(m: RigModel, s: Motion, place: str, size: float, draw: Draw) -> RigModel:
    return _linked(m, place, laws.Backlash(clearance=size * draw.uniform(0.06, 0.2) * s.deflection[place], residual=0.03))


def _drag(m: RigModel, s: Motion, place: str, size: float, draw: Draw) -> RigModel:
    link = m.link(place)
    return _linked(
        m, place, laws.QuadraticDamping(quadratic_damping=size * draw.uniform(1.0, 3.0) * link.damping / s.speed[place])
    )


def _mode(m: RigModel, s: Motion, place: str, size: float, draw: Draw) -> RigModel:
    body = m.body(m.link(place).a)
    omega = np.sqrt(m.link(place).stiffness / body.mass) * draw.uniform(1.2, 2.5)
    mass = size * draw.uniform(0.03, 0.1) * body.mass
    link = Link(name="loose", a="loose", b=body.name, stiffness=mass * omega**2, damping=0.04 * mass * omega)
    return msgspec.structs.replace(m, bodies=(*m.bodies, Body(name="loose", mass=mass)), links=(*m.links, link))


def _late(m: RigModel, s: Motion, place: str, size: float, draw: Draw) -> RigModel:
    return _chained(m, place, Chain(delay=size * draw.uniform(0.8, 2.5) / 200.0))


def _scaled(m: RigModel, s: Motion, place: str, size: float, draw: Draw) -> RigModel:
    return _chained(m, place, Chain(gain=1.0 + float(draw.choice([-1, 1])) * size * draw.uniform(0.08, 0.2)))


def _fifth(m: RigModel, s: Motion, place: str, size: float, draw: Draw) -> RigModel:
    at = 1.5 * s.deflection[place] * np.linspace(-1, 1, 41)
    return _linked(
        m, place, _curve(at, size * draw.uniform(0.5, 1.2) * _spring_force(m, s, place) * (at / s.deflection[place]) ** 5)
    )


def _cogging(m: RigModel, s: Motion, place: str, size: float, draw: Draw) -> RigModel:
    at = 1.5 * s.deflection[place] * np.linspace(-1, 1, 65)
    pitch = draw.uniform(0.35, 0.8) * s.deflection[place]
    wave = np.sin(2 * np.pi * at / pitch + draw.uniform(0, 2 * np.pi))
    wave = wave - np.interp(0.0, at, wave)
    return _linked(m, place, _curve(at, size * draw.uniform(0.06, 0.15) * _spring_force(m, s, place) * wave))


def _one_stop(m: RigModel, s: Motion, place: str, size: float, draw: Draw) -> RigModel:
    at = 1.5 * s.deflection[place] * np.linspace(-1, 1, 65)
    beyond = np.maximum(float(draw.choice([-1, 1])) * at - draw.uniform(0.3, 0.6) * s.deflection[place], 0.0)
    side = np.sign(at) * beyond
    return _linked(m, place, _curve(at, size * draw.uniform(2.0, 5.0) * m.link(place).stiffness * side))


def _cubic_damping(m: RigModel, s: Motion, place: str, size: float, draw: Draw) -> RigModel:
    at = 1.5 * s.speed[place] * np.linspace(-1, 1, 41)
    force = size * draw.uniform(1.5, 4.0) * m.link(place).damping * s.speed[place] * (at / s.speed[place]) ** 3
    return _linked(m, place, _curve(at, force, "speed"))


def _uneven(m: RigModel, s: Motion, place: str, size: float, draw: Draw) -> RigModel:
    at = 1.2 * s.deflection[place] * np.linspace(-1, 1, 31)
    level = draw.uniform(0.08, 0.2) * _spring_force(m, s, place)
    bend = size * draw.uniform(0.4, 0.8)
    levels = level * (1 + bend * np.sin(np.pi * at / s.deflection[place] * draw.uniform(0.7, 1.5) + draw.uniform(0, 6)))
    return _rubbing(m, place, laws.FrictionCurve(over="position", at=tuple(at.tolist()), levels=tuple(levels.tolist())))


def _loop(m: RigModel, s: Motion, place: str, size: float, draw: Draw) -> RigModel:
    force = size * draw.uniform(0.1, 0.25) * _spring_force(m, s, place)
    law = laws.BoucWen(
        friction_force=force, initial_stiffness=force / (draw.uniform(0.1, 0.3) * s.deflection[place]),
        sharpness=draw.uniform(1.5, 3.0), pinching=draw.uniform(0.5, 0.9),
    )  # fmt: skip
    return _rubbing(m, place, law)


def _bent(m: RigModel, s: Motion, place: str, size: float, draw: Draw) -> RigModel:
    at = 1.2 * s.peak[place] * np.linspace(-1, 1, 31)
    error = size * draw.uniform(0.15, 0.3) * at**2 / s.peak[place]
    return _chained(m, place, Chain(bend=tuple(zip(at.tolist(), error.tolist(), strict=True))))


#: Effects by name: what makes them, the catalogued cause or None, and where they sit: a link or a channel.
EFFECTS: dict[str, tuple[Maker, str | None, str, str]] = {
    "coulomb_friction": (_coulomb, "coulomb_friction", "friction_shape", "link"),
    "stribeck_friction": (_stribeck, "stribeck_friction", "friction_shape", "link"),
    "hardening_stiffness": (_hardening, "hardening_stiffness", "spring_shape", "link"),
    "end_stop": (_end_stop, "end_stop", "spring_shape", "link"),
    "backlash": (_backlash, "backlash", "spring_shape", "link"),
    "quadratic_damping": (_drag, "quadratic_damping", "damping_shape", "link"),
    "extra_mode": (_mode, "extra_mode", "added_motion", "body"),
    "channel_delay": (_late, "channel_delay", "sensor", "channel"),
    "sensor_gain": (_scaled, "sensor_gain", "sensor", "channel"),
    "stop that damps": (_damping_stop, "end_stop", "spring_shape", "link"),
    "fifth power": (_fifth, None, "spring_shape", "link"),
    "cogging": (_cogging, None, "spring_shape", "link"),
    "one-sided stop": (_one_stop, None, "spring_shape", "link"),
    "cubic damping": (_cubic_damping, None, "damping_shape", "link"),
    "uneven friction": (_uneven, None, "friction_shape", "link"),
    "hysteresis": (_loop, None, "memory", "link"),
    "bent sensor": (_bent, None, "sensor", "channel"),
}
PAIRS = (
    ("coulomb_friction", "channel_delay"), ("coulomb_friction", "hardening_stiffness"), ("hardening_stiffness", "sensor_gain"),
    ("end_stop", "coulomb_friction"), ("quadratic_damping", "channel_delay"),
)  # fmt: skip
KINDS = ("none", *EFFECTS, "two")


@dataclass(frozen=True, kw_only=True)
class Hiding:
    """A rig, its motion, the same with something hidden in it, and what: (cause or None, kind, place) of each."""

    sound: RigModel
    motion: Motion
    hidden: RigModel
    truth: tuple[tuple[str | None, str, str], ...]


def hide_other(kind: str, size: float, draw: Draw) -> Hiding:
    """Draw rig, place and numbers."""
    model = drawn(draw)
    motion = motion_of(model)
    truth: list[tuple[str | None, str, str]] = []
    hidden = model
    for name in () if kind == "none" else PAIRS[int(draw.integers(len(PAIRS)))] if kind == "two" else (kind,):
        make, cause, what, where = EFFECTS[name]
        link = model.links[int(draw.integers(len(model.links)))].name
        place = model.sensors[int(draw.integers(len(model.sensors)))].channel if where == "channel" else link
        hidden = make(hidden, motion, place, size, draw)
        truth.append((cause, what, model.link(link).a if where == "body" else place))
    return Hiding(sound=model, motion=motion, hidden=hidden, truth=tuple(truth))


def draw_other(kind: str, size: float, seed: int, *, soil: float = 0.0, rest: bool = False) -> OtherEnvelope:
    """Draw rig, place and numbers by the seed, and play the session and the one after it.

    Parameters
    ----------
    kind, size, seed
        What is hidden, how large (1 is full size), and the draw's seed.
    soil
        Share of every signal that no model has: an uneven rail, a small loose part, a floor that shakes, bent sensors.
    rest
        Whether every run begins with seconds of rest.
    """
    draw = generator_of(seed, kind)
    found = hide_other(kind, size, draw)
    hidden = found.hidden
    disturbances: frozenset[tuple[str, str]] = frozenset()
    if soil:
        hidden = _soiled(hidden, found.motion, soil, draw)
        loose = next(link for link in hidden.links if link.name == "dirt")
        disturbances = frozenset({("added_motion", loose.b), *(("sensor", sensor.channel) for sensor in hidden.sensors)})
    takes = tuple(Take(take.level, take.wave, rest=float(draw.uniform(0.3, 2.0)) if rest else 0.0) for take in SESSION)
    later = (Take(4.5, 11, rest=takes[0].rest), Take(6.0, 12, rest=takes[0].rest), Take(2.0, 13, rest=takes[0].rest))
    campaign = _shaken(played(hidden, seed=seed, takes=takes), soil, seed)
    after = _shaken(played(hidden, seed=seed + 500, takes=later), soil, seed + 1)
    return OtherEnvelope(
        kind=kind, truth=found.truth, campaign=campaign, later=after, guess=guessed(found.sound, seed), disturbances=disturbances
    )


def _soiled(model: RigModel, motion: Motion, soil: float, draw: Draw) -> RigModel:
    # A small loose part at one body, friction of a few per mille and bent sensors.
    link = model.links[int(draw.integers(len(model.links)))].name
    body = model.body(model.link(link).a)
    omega = np.sqrt(model.link(link).stiffness / body.mass) * draw.uniform(1.5, 4.0)
    mass = soil * draw.uniform(0.1, 0.4) * body.mass
    loose = Link(name="dirt", a="dirt", b=body.name, stiffness=mass * omega**2, damping=0.06 * mass * omega)
    model = msgspec.structs.replace(model, bodies=(*model.bodies, Body(name="dirt", mass=mass)), links=(*model.links, loose))
    for sensor in model.sensors:
        if not sensor.chain.bend:
            peak = motion.peak[sensor.channel]
            at = 1.5 * peak * np.linspace(-1, 1, 21)
            bend = soil * draw.uniform(-0.5, 0.5) * at**2 / peak
            model = _chained(
                model, sensor.channel,
                msgspec.structs.replace(sensor.chain, bend=tuple(zip(at.tolist(), bend.tolist(), strict=True))),
            )  # fmt: skip
    return model


def _shaken(campaign: Campaign, soil: float, seed: int) -> Campaign:
    # A floor that shakes: narrow noise in every channel that the drive did not cause.
    if not soil:
        return campaign
    from scipy.signal import butter, sosfilt

    draw = np.random.default_rng(seed)
    runs = []
    for run in campaign.runs:
        channels = dict(run.channels)
        for name, channel in run.channels.items():
            if channel.quantity in ("force", "voltage"):
                continue
            values = run.read(name)
            band = butter(2, [2.0, 20.0], btype="band", fs=run.sample_rate, output="sos")
            noise = sosfilt(band, draw.normal(0.0, 1.0, len(values)))
            noise *= 0.5 * soil * np.std(values) / np.std(noise)
            channels[name] = Channel(name=name, samples=values + noise, quantity=channel.quantity, unit=channel.unit)
        runs.append(replace(run, channels=channels))
    return replace(campaign, runs=tuple(runs))


def answer_of(envelope: OtherEnvelope, named: list[tuple[str, str | None, str]], alike: list[set[tuple[str, str]]]) -> str:
    """Say "right", "kind" (place and kind, another form or none), "part" (one of two), "silent", "disturbance" or "wrong".

    A rig with disturbances may have them named beside the hidden effect; "disturbance" if nothing else is named.

    Parameters
    ----------
    envelope
        What was hidden.
    named
        (cause, form, place) of each step.
    alike
        Groups of (cause, place) that the answer calls indistinguishable.
    """
    if not named:
        return "right" if not envelope.truth else "silent"
    truths = {(kind, place) for _, kind, place in envelope.truth}
    best, found = "right", 0
    for cause, _, place in named:
        reach = {(cause, place)} | {x for group in alike if (cause, place) in group for x in group}
        kinds = {(kind_of(c), at) for c, at in reach}
        if any((true or kind, at) in reach for true, kind, at in envelope.truth):
            found += 1
        elif kinds & truths:
            best, found = "kind", found + 1
        elif not kinds & envelope.disturbances:
            return "wrong"
    if not found:
        return "disturbance"
    met = {(kind_of(cause), place) for cause, _, place in named}
    if best == "right" and found < len(envelope.truth) and not truths <= met:
        return "part"
    return best
