"""Effects that a virtual rig can hide: every cause of the catalogue with a random size, and some outside the catalogue."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import msgspec
import numpy as np

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.diagnose.mechanisms.base import exchange
from isorig.analysis.diagnose.mechanisms.relaxation import natural
from isorig.analysis.diagnose.mechanisms.springs import added
from isorig.analysis.errors import ModelError
from isorig.analysis.model.rig_model import GROUND, Body, Chain, Configuration, Contact, Link, RigModel, Sensor
from isorig.analysis.simulate import Excitation, record, simulate
from isorig.rig.errors import RigError
from isorig.rig.virtual.campaign import Take, head_of, known_of, virtual_campaign, without_faults
from isorig.rig.wire_bonder.description import THESIS, wire_bonder

Draw = np.random.Generator
MOTIONS: tuple[tuple[str, Literal["displacement", "velocity"]], ...] = (("d", "displacement"), ("v", "velocity"))
CHANNELS = ("head", "motor", "table", "heatblock")


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """A rig with an effect: the simulated model, and effects that no model contains.

    `truth` has causes of the catalogue with their places; `outside` the kind and place of an effect outside it, as a free shape
    may describe it.
    """

    model: RigModel
    truth: tuple[tuple[str, str], ...] = ()
    outside: tuple[tuple[str, str], ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    known: Mapping[str, float] = field(default_factory=dict)
    per_run: Callable[[RigModel, Run], RigModel] | None = None
    wire: Callable[[Run, dict[str, FloatArray]], dict[str, FloatArray]] | None = None

    def records(
        self, drive: FloatArray, sample_rate: float, *, configuration: str, gain: float, start_time: float, run: str
    ) -> dict[str, FloatArray]:  # fmt: skip
        """The channels of a run without their noise, by channel, each shape (n,).

        Parameters
        ----------
        drive
            The drive's true values, shape (n,).
        sample_rate
            Hz.
        configuration, gain, run
            Configuration of the rig, gain and name of the run.
        start_time
            Seconds since the rig's first run.
        """
        name = self.model.drive.channel
        played = Run(
            id=run, configuration=configuration, sample_rate=sample_rate, gain=gain,
            channels={name: Channel(name=name, samples=drive)},
        )  # fmt: skip
        model = self.model if self.per_run is None else self.per_run(self.model, played)
        excitation = Excitation.prepare(drive, sample_rate, oversample=16)
        seen = simulate(without_faults(model), excitation, configuration=configuration, start_time=start_time).channels
        found = record(model, {name: drive, **seen}, sample_rate)
        return found if self.wire is None else self.wire(played, found)


@dataclass(frozen=True, kw_only=True)
class Scale:
    """Largest displacement (m) and velocity (m/s) of each link at the highest gain, and largest acceleration of each channel."""

    deflection: Mapping[str, float]
    speed: Mapping[str, float]
    peak: Mapping[str, float]


def drawn_rig(draw: Draw) -> RigModel:
    """A wire bonder similar to the thesis's."""
    spread = {
        "head_mass": 0.15, "table_mass": 0.15, "table_frequency": 0.08, "table_damping": 0.5, "heatblock_mass": 0.2,
        "heatblock_frequency": 0.05, "heatblock_damping": 0.4, "motor_mass": 0.1, "motor_frequency": 0.12, "motor_damping": 0.3,
    }  # fmt: skip
    values = {**THESIS, "friction_force": draw.uniform(5.0, 18.0)}
    for name, share in spread.items():
        values[name] *= 1.0 + share * draw.uniform(-1.0, 1.0)
    return wire_bonder(values)


def scale_of(model: RigModel) -> Scale:
    """From half a minute at gain 70."""
    rate = 1024.0
    head = head_of(Take(id="s", configuration="unlocked", gain=70.0, seconds=30.0, start=0.0), rate, 99)
    sensors = tuple(
        Sensor(channel=f"{kind} {link.name}", body=link.a, relative_to=link.b, quantity=quantity)
        for link in model.links
        for kind, quantity in MOTIONS
    )
    seen = simulate(
        msgspec.structs.replace(model, sensors=(*model.sensors, *sensors)), Excitation.prepare(head, rate, oversample=4)
    ).channels  # fmt: skip
    most = {name: float(np.abs(values).max()) for name, values in seen.items()}
    return Scale(
        deflection={link.name: most[f"d {link.name}"] for link in model.links},
        speed={link.name: most[f"v {link.name}"] for link in model.links},
        peak={**{s.channel: most[s.channel] for s in model.sensors}, "head": float(np.abs(head).max())},
    )


def _friction(model: RigModel, law: laws.FrictionLaw) -> RigModel:
    return msgspec.structs.replace(model, contacts=exchange(model.contacts, "isolation", law=law), free=())


def _force(model: RigModel) -> float:
    return model.get("contacts.isolation.law.friction_force")


def _chained(model: RigModel, channel: str, chain: Chain) -> RigModel:
    if channel == "head":
        return msgspec.structs.replace(model, drive=msgspec.structs.replace(model.drive, chain=chain))
    return msgspec.structs.replace(model, sensors=exchange(model.sensors, channel, chain=chain))


def _linked(model: RigModel, place: str, law: laws.LinkLaw) -> RigModel:
    return added(model, model.link(place), law)


def _sign(draw: Draw) -> float:
    return float(draw.choice([-1.0, 1.0]))


def _hardening(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    k3 = size * draw.uniform(0.3, 1.0) * m.link(place).stiffness / s.deflection[place] ** 2
    return Hidden(model=_linked(m, place, laws.Cubic(cubic_stiffness=k3)), parameters={"cubic_stiffness": k3})


def _softening(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    r, scale = size * draw.uniform(0.3, 0.6), draw.uniform(0.1, 0.4) * s.deflection[place]
    return Hidden(
        model=_linked(m, place, laws.BoundedSoftening(softening=r, scale=scale)), parameters={"softening": r, "scale": scale}
    )


def _stribeck(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    force = _force(m)
    static, speed = force * (1.0 + size * draw.uniform(0.5, 1.2)), draw.uniform(0.03, 0.12) * s.speed[place]
    law = laws.Stribeck(friction_force=force, static_force=static, stribeck_velocity=speed)
    return Hidden(model=_friction(m, law), parameters={"static_force": static, "stribeck_velocity": speed})


def _presliding(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    force = _force(m)
    stiffness = force / (size * draw.uniform(0.03, 0.1) * s.deflection[place])
    return Hidden(
        model=_friction(m, laws.Dahl(friction_force=force, bristle_stiffness=stiffness)),
        parameters={"bristle_stiffness": stiffness},
    )


def _asymmetric(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    share = _sign(draw) * size * draw.uniform(0.25, 0.5)
    forward, backward = _force(m) * (1 + share), _force(m) * (1 - share)
    return Hidden(
        model=_friction(m, laws.Asymmetric(forward_force=forward, backward_force=backward)),
        parameters={"forward_force": forward, "backward_force": backward},
    )


def _backlash(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    clearance = size * draw.uniform(0.06, 0.2) * s.deflection[place]
    law = laws.Backlash(clearance=clearance, residual=draw.uniform(0.0, 0.06))
    return Hidden(model=_linked(m, place, law), parameters={"clearance": clearance})


def _end_stop(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    stroke = draw.uniform(0.45, 0.75) * s.deflection[place]
    stiffness = size * draw.uniform(1.5, 5.0) * m.link(place).stiffness
    return Hidden(
        model=_linked(m, place, laws.EndStop(stroke=stroke, contact_stiffness=stiffness)),
        parameters={"stroke": stroke, "contact_stiffness": stiffness},
    )


def _drag(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    drag = size * draw.uniform(0.5, 2.0) * max(_force(m), m.link(place).damping * s.speed[place]) / s.speed[place] ** 2
    return Hidden(model=_linked(m, place, laws.QuadraticDamping(quadratic_damping=drag)), parameters={"quadratic_damping": drag})


def _extra_mode(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    low, high = {"table": (20.0, 90.0), "heatblock": (60.0, 300.0), "motor": (20.0, 120.0)}[place]
    mass, f, zeta = size * draw.uniform(0.02, 0.06) * m.body(place).mass, draw.uniform(low, high), draw.uniform(0.01, 0.04)
    omega = 2 * np.pi * f
    link = Link(name="loose", a="loose", b=place, stiffness=mass * omega**2, damping=2 * zeta * mass * omega)
    model = msgspec.structs.replace(m, bodies=(*m.bodies, Body(name="loose", mass=mass)), links=(*m.links, link))
    return Hidden(model=model, parameters={"mode_mass": mass, "mode_frequency": f, "mode_damping": zeta})


def _moment(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    inertia = m.body("motor").mass * draw.uniform(0.06, 0.12) ** 2
    omega = 2 * np.pi * draw.uniform(15.0, 60.0)
    push, height, bearing = size * draw.uniform(0.01, 0.04), draw.uniform(0.02, 0.06), draw.uniform(0.01, 0.04)
    damping = 2 * draw.uniform(0.02, 0.06) * inertia * omega
    rocking = Link(name="bearings", a="rocking", b=GROUND, stiffness=inertia * omega**2, damping=damping)
    model = msgspec.structs.replace(
        m,
        bodies=(*m.bodies, Body(name="rocking", mass=inertia)),
        links=(*exchange(m.links, "isolation", arms={"rocking": bearing}), rocking),
        sensors=exchange(m.sensors, "motor", arms={"rocking": height}),
        drive=msgspec.structs.replace(m.drive, pushes={**m.drive.pushes, "rocking": push * m.drive.pushes["motor"]}),
        configurations={**m.configurations, "locked": Configuration(rigid=("isolation", "bearings"))},
    )
    return Hidden(model=model, parameters={"drive_arm": push, "sensor_height": height})


def _wrong_mass(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    factor = 1.0 + _sign(draw) * size * draw.uniform(0.06, 0.15)
    return Hidden(
        model=m, known={f"{place}_mass": known_of(m)[f"{place}_mass"] * factor},
        parameters={"mass": known_of(m)[f"{place}_mass"]},
    )  # fmt: skip


def _lock(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    stiffness = m.link("isolation").stiffness * draw.uniform(50.0, 400.0) / size
    damping = 2 * draw.uniform(0.01, 0.05) * np.sqrt(stiffness * m.body("motor").mass)
    locked = Configuration(rigid=("isolation",), lock_stiffness=stiffness, lock_damping=damping)
    return Hidden(
        model=msgspec.structs.replace(m, configurations={**m.configurations, "locked": locked}),
        parameters={"lock_stiffness": stiffness},
    )


def _drift(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    rate = _sign(draw) * size * draw.uniform(0.1, 0.25) / 720.0
    return Hidden(model=_linked(m, place, laws.Drift(drift_rate=rate, until=720.0)), parameters={"drift_rate": rate})


def _relaxing(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    link = m.link(place)
    stiffness, time = size * draw.uniform(0.3, 0.8) * link.stiffness, draw.uniform(0.5, 2.0) / natural(m, link)
    return Hidden(
        model=_linked(m, place, laws.Maxwell(relaxation_stiffness=stiffness, relaxation_time=time)),
        parameters={"relaxation_stiffness": stiffness, "relaxation_time": time},
    )


def _delay(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    delay = size * draw.uniform(0.8, 2.5) / 1024.0
    return Hidden(model=_chained(m, place, Chain(delay=delay)), parameters={"delay": delay})


def _gain(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    factor = 1.0 + _sign(draw) * size * draw.uniform(0.05, 0.2)
    return Hidden(model=_chained(m, place, Chain(gain=factor)), parameters={"factor": factor})


def _clipping(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    limit = (1.0 - size * draw.uniform(0.35, 0.6)) * s.peak[place]
    return Hidden(model=_chained(m, place, Chain(limit=limit)), parameters={"limit": limit})


def _crosstalk(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    source = str(draw.choice([c for c in CHANNELS if c != place]))
    fraction = _sign(draw) * size * draw.uniform(0.03, 0.1) * s.peak[place] / s.peak[source]
    return Hidden(model=_chained(m, place, Chain(crosstalk={source: fraction})), parameters={"fraction": fraction})


def _hum(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    mains, height = float(draw.choice([50.0, 60.0])), size * draw.uniform(0.03, 0.1)
    third, phases = draw.uniform(0.1, 0.5), draw.uniform(0, 2 * np.pi, (20, 2))

    def hum(run: Run, records: dict[str, FloatArray]) -> dict[str, FloatArray]:
        t = np.arange(len(run)) / run.sample_rate
        a, b = phases[sum(map(ord, run.id)) % 20]
        wave = np.sin(2 * np.pi * mains * t + a) + third * np.sin(2 * np.pi * 3 * mains * t + b)
        return {**records, place: records[place] + height * wave}

    return Hidden(model=m, wire=hum, parameters={"amplitude": height, "frequency": mains})


def _foot(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    """The table rubs on the floor."""
    rub = Contact(name="foot", a="table", b=GROUND, law=laws.Coulomb(friction_force=size * draw.uniform(3.0, 10.0)))
    return Hidden(model=msgspec.structs.replace(m, contacts=(*m.contacts, rub)), outside=(("friction_shape", "table"),))


def _cable(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    """A hose or cable connects the motor to the floor."""
    k = m.link("isolation").stiffness
    hose = Link(name="hose", a="motor", b=GROUND, stiffness=size * draw.uniform(0.2, 0.6) * k, damping=0.02 * k / 30.0)
    return Hidden(model=msgspec.structs.replace(m, links=(*m.links, hose)))


def _wear(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    """The friction differs from run to run."""
    levels = 1.0 + size * draw.uniform(-0.6, 0.6, 20)

    def worn(model: RigModel, run: Run) -> RigModel:
        return _friction(model, laws.Coulomb(friction_force=_force(model) * levels[sum(map(ord, run.id)) % 20]))

    return Hidden(model=m, outside=(("drift", "isolation"),), per_run=worn)


def _bent_sensor(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    """A sensor with a quadratic error."""
    channel, bend = str(draw.choice(CHANNELS[1:])), size * draw.uniform(0.15, 0.4)

    def bent(run: Run, records: dict[str, FloatArray]) -> dict[str, FloatArray]:
        return {**records, channel: records[channel] + bend * records[channel] ** 2 / s.peak[channel]}

    return Hidden(model=m, outside=(("sensor", channel),), wire=bent)


def _slow_sensor(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    """A sensor whose high-pass corner frequency is too high."""
    from scipy.signal import butter, lfilter

    channel, corner = str(draw.choice(CHANNELS[1:])), size * draw.uniform(1.0, 4.0)

    def slow(run: Run, records: dict[str, FloatArray]) -> dict[str, FloatArray]:
        b, a = butter(1, corner, "highpass", fs=run.sample_rate)
        return {**records, channel: lfilter(b, a, records[channel])}

    return Hidden(model=m, outside=(("sensor", channel),), wire=slow)


def _loose_plug(m: RigModel, s: Scale, place: str, size: float, draw: Draw) -> Hidden:
    """A connector that loses the signal now and then."""
    channel, seed = str(draw.choice(CHANNELS[1:])), int(draw.integers(2**31))
    share = size * draw.uniform(0.01, 0.04)

    def loose(run: Run, records: dict[str, FloatArray]) -> dict[str, FloatArray]:
        lost = np.repeat(np.random.default_rng(seed + sum(map(ord, run.id))).random(len(run) // 64 + 1) < share, 64)
        return {**records, channel: np.where(lost[: len(run)], 0.0, records[channel])}

    return Hidden(model=m, wire=loose)


Maker = Callable[[RigModel, Scale, str, float, Draw], Hidden]
LINKS = ("isolation", "heatblock", "table")
CAUSES: dict[str, tuple[Maker, tuple[str, ...]]] = {
    "stribeck_friction": (_stribeck, ("isolation",)),
    "presliding_friction": (_presliding, ("isolation",)),
    "asymmetric_friction": (_asymmetric, ("isolation",)),
    "hardening_stiffness": (_hardening, LINKS),
    "softening_stiffness": (_softening, LINKS),
    "backlash": (_backlash, ("isolation",)),
    "end_stop": (_end_stop, ("isolation",)),
    "quadratic_damping": (_drag, ("isolation",)),
    "extra_mode": (_extra_mode, ("table", "heatblock", "motor")),
    "moment_coupling": (_moment, ("motor",)),
    "wrong_mass": (_wrong_mass, ("head", "motor", "heatblock")),
    "imperfect_lock": (_lock, ("lock",)),
    "stiffness_drift": (_drift, LINKS),
    "channel_delay": (_delay, CHANNELS),
    "sensor_gain": (_gain, CHANNELS),
    "clipping": (_clipping, CHANNELS[1:]),
    "crosstalk": (_crosstalk, CHANNELS[1:]),
    "mains_hum": (_hum, CHANNELS[1:]),
    "relaxation": (_relaxing, LINKS),
}
OUTSIDE: dict[str, Maker] = {
    "rubbing foot": _foot, "hose": _cable, "worn friction": _wear, "bent sensor": _bent_sensor,
    "slow sensor": _slow_sensor, "loose plug": _loose_plug,
}  # fmt: skip
KINDS = ("none", *CAUSES, *(f"outside: {name}" for name in OUTSIDE), "two")
#: Pairs of simultaneous effects; the second is added to the first.
PAIRS = (
    ("hardening_stiffness", "sensor_gain"), ("stribeck_friction", "channel_delay"), ("extra_mode", "hardening_stiffness"),
    ("backlash", "sensor_gain"), ("stiffness_drift", "quadratic_damping"), ("end_stop", "crosstalk"),
)  # fmt: skip


def drawn_effect(kind: str, model: RigModel, size: float, draw: Draw) -> Hidden:
    """An effect of that kind, or a pair of effects, added to a rig with random place and parameters.

    Parameters
    ----------
    kind
        One of `KINDS`.
    model
        The rig without it.
    size
        Relative size, 1 is full size.
    draw
        Random generator for place and parameters.
    """
    scale = scale_of(model)
    if kind != "two":
        return hide(kind, model, scale, size, draw)
    hidden = Hidden(model=model)
    for cause in PAIRS[int(draw.integers(len(PAIRS)))]:
        more = hide(cause, hidden.model, scale, size, draw)
        hidden = replace(more, truth=hidden.truth + more.truth, parameters={**hidden.parameters, **more.parameters})
    return hidden


def hidden_in(model: RigModel, kind: str | None, size: float, seed: int) -> Hidden:
    """The effect that a seed selects for a wire bonder; none if no kind is given.

    Raises
    ------
    RigError
        There is no such kind, the size is not allowed, or the rig has no place for it.
    """
    if kind is None:
        return Hidden(model=model)
    if kind not in KINDS:
        raise RigError(f"there is no effect {kind!r}; there are {', '.join(KINDS)}")
    if not 0.0 < size <= 10.0:
        raise RigError(f"the size of the effect is {size:g}; give one above 0 and up to 10, 1 is full size")
    try:
        return drawn_effect(kind, model, size, np.random.default_rng([seed, KINDS.index(kind)]))
    except (ModelError, KeyError):
        raise RigError(f"the rig {model.name!r} has no place for {kind!r}; effects are hidden in a wire bonder") from None


def hide(kind: str, model: RigModel, scale: Scale, size: float, draw: Draw) -> Hidden:
    """One effect added to a rig, its parameters scaled by the largest displacement and velocity of the rig."""
    if kind == "none":
        return Hidden(model=model)
    if kind.startswith("outside: "):
        return OUTSIDE[kind.removeprefix("outside: ")](model, scale, "", size, draw)
    make, places = CAUSES[kind]
    place = str(draw.choice(places))
    return replace(make(model, scale, place, size, draw), truth=((kind, place),))


def played(hidden: Hidden, takes: Sequence[Take], seed: int, noise: float = 1e-3) -> Campaign:
    """A session on a rig with a hidden effect; see `virtual_campaign`."""
    campaign = virtual_campaign(hidden.model, takes, seed=seed, noise=noise)
    known = {**known_of(hidden.model), **hidden.known}
    runs = list(campaign.runs)
    if hidden.per_run is not None:
        for k, take in enumerate(takes):
            runs[k] = virtual_campaign(hidden.per_run(hidden.model, runs[k]), [take], seed=seed + 7 * k, noise=noise).runs[0]
    if hidden.wire is not None:
        for k, run in enumerate(runs):
            records = hidden.wire(run, {name: run.read(name) for name in run.channels})
            channels = {
                name: Channel(
                    name=name, samples=np.round(values / run.channels[name].scale).astype(np.int32),
                    scale=run.channels[name].scale, full_scale=run.channels[name].full_scale, about=run.channels[name].about,
                )
                for name, values in records.items()
            }  # fmt: skip
            runs[k] = replace(run, channels=channels)
    return Campaign(runs=tuple(runs), known=known, source="virtual rig")
