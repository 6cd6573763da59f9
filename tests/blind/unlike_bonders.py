"""Envelopes of wire bonders that no model describes exactly: disturbances in every signal, forms outside the catalogue, rest.

The session is short (320 s) and repeats one drive. `KINDS` names everything that can be drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import timedelta

import msgspec
import numpy as np
import other_envelopes as forms
from envelopes import drawn_rig
from other_envelopes import OtherEnvelope

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.analysis.diagnose.causes.base import Amplitudes, exchange
from isorig.analysis.diagnose.kinds import kind_of
from isorig.analysis.model.rig_model import Body, Link, RigModel
from isorig.rig.virtual.levels import BEGIN
from isorig.rig.wire_bonder.effects import CAUSES, CHANNELS, Hidden, amplitudes_of, drawn_effect, generator_of
from isorig.rig.wire_bonder.session import VirtualRun, head_of, known_of

Draw = np.random.Generator

SESSION = (
    VirtualRun(id="u70a", configuration="unlocked", gain=70.0, seconds=60.0, start=0.0),
    VirtualRun(id="u70r", configuration="unlocked", gain=70.0, seconds=60.0, start=80.0),
    VirtualRun(id="u35", configuration="unlocked", gain=35.0, seconds=60.0, start=160.0),
    VirtualRun(id="u7", configuration="unlocked", gain=7.0, seconds=40.0, start=240.0, band=(0.5, 400.0)),
    VirtualRun(id="l70", configuration="locked", gain=70.0, seconds=40.0, start=300.0),
    VirtualRun(id="l7", configuration="locked", gain=7.0, seconds=40.0, start=360.0, band=(0.5, 400.0)),
    VirtualRun(id="umove", configuration="unlocked", gain=70.0, seconds=20.0, start=420.0, excitation="moves"),
)
REPEATS = {"u70r": "u70a"}
LATER = (
    VirtualRun(id="x70", configuration="unlocked", gain=70.0, seconds=30.0, start=480.0),
    VirtualRun(id="x7", configuration="unlocked", gain=7.0, seconds=30.0, start=530.0, band=(0.5, 400.0)),
    VirtualRun(id="xmove", configuration="unlocked", gain=70.0, seconds=15.0, start=580.0, excitation="moves"),
    VirtualRun(id="xlock", configuration="locked", gain=70.0, seconds=30.0, start=620.0, band=(0.5, 60.0)),
)
RATE = 1024.0


def _friction_levels(model: RigModel, scale: Amplitudes, bend: float, draw: Draw) -> RigModel:
    # Coulomb friction whose level varies with the position.
    reach = 1.2 * scale.deflection["isolation"]
    at = reach * np.linspace(-1.0, 1.0, 31)
    wave = np.sin(2 * np.pi * at / (draw.uniform(0.4, 1.2) * reach) + draw.uniform(0.0, 6.0))
    levels = model.get("contacts.isolation.law.friction_force") * (1.0 + bend * wave)
    law = laws.FrictionCurve(over="position", at=tuple(at.tolist()), levels=tuple(levels.tolist()))
    return msgspec.structs.replace(model, contacts=exchange(model.contacts, "isolation", law=law), free=())


def _uneven(model: RigModel, scale: Amplitudes, place: str, size: float, draw: Draw) -> RigModel:
    return _friction_levels(model, scale, size * draw.uniform(0.5, 0.85), draw)


def _loop(model: RigModel, scale: Amplitudes, place: str, size: float, draw: Draw) -> RigModel:
    force = model.get("contacts.isolation.law.friction_force")
    law = laws.BoucWen(
        friction_force=force, initial_stiffness=force / (size * draw.uniform(0.05, 0.2) * scale.deflection["isolation"]),
        sharpness=draw.uniform(1.5, 3.0), pinching=draw.uniform(0.5, 0.9),
    )  # fmt: skip
    return msgspec.structs.replace(model, contacts=exchange(model.contacts, "isolation", law=law), free=())


def _by(make: forms.Maker) -> Callable[[RigModel, Amplitudes, str, float, Draw], RigModel]:
    def made(model: RigModel, scale: Amplitudes, place: str, size: float, draw: Draw) -> RigModel:
        motion = forms.Motion(deflection=scale.deflection, speed=scale.speed, peak=scale.peak)
        return make(model, motion, place, size, draw)

    return made


SPRINGS = ("isolation", "isolation", "table", "heatblock")
#: Forms outside the catalogue (or nearly in it): maker, catalogued cause or None, kind, places.
FOREIGN: Mapping[str, tuple[Callable[[RigModel, Amplitudes, str, float, Draw], RigModel], str | None, str, tuple[str, ...]]] = {
    "stop that damps": (_by(forms.EFFECTS["stop that damps"][0]), "end_stop", "spring_shape", ("isolation",)),
    "fifth power": (_by(forms.EFFECTS["fifth power"][0]), None, "spring_shape", SPRINGS),
    "cogging": (_by(forms.EFFECTS["cogging"][0]), None, "spring_shape", ("isolation",)),
    "one-sided stop": (_by(forms.EFFECTS["one-sided stop"][0]), None, "spring_shape", ("isolation",)),
    "cubic damping": (_by(forms.EFFECTS["cubic damping"][0]), None, "damping_shape", ("isolation", "table")),
    "uneven friction": (_uneven, None, "friction_shape", ("isolation",)),
    "hysteresis": (_loop, None, "memory", ("isolation",)),
    "bent sensor": (_by(forms.EFFECTS["bent sensor"][0]), None, "sensor", CHANNELS[1:]),
}
KINDS = ("none", *CAUSES, *FOREIGN, "two")


def _soiled(hidden: Hidden, scale: Amplitudes, soil: float, draw: Draw) -> Hidden:
    # Two small loose parts, friction uneven by twice the share, bent sensors and small calibration errors.
    model = hidden.model
    for k in range(2):
        body = str(draw.choice(("table", "heatblock", "motor")))
        mass = soil * draw.uniform(0.05, 0.25) * model.body(body).mass
        omega, zeta = 2 * np.pi * draw.uniform(15.0, 250.0), draw.uniform(0.01, 0.04)
        link = Link(name=f"dirt{k}", a=f"dirt{k}", b=body, stiffness=mass * omega**2, damping=2 * zeta * mass * omega)
        bodies = (*model.bodies, Body(name=f"dirt{k}", mass=mass))
        model = msgspec.structs.replace(model, bodies=bodies, links=(*model.links, link))
    contact = next((c for c in model.contacts if c.name == "isolation"), None)
    if contact is not None and isinstance(contact.law, laws.Coulomb):
        model = _friction_levels(model, scale, 2.0 * soil, draw)
    sensors = []
    for sensor in model.sensors:
        chain = sensor.chain
        if not chain.bend:
            at = 1.5 * scale.peak[sensor.channel] * np.linspace(-1.0, 1.0, 21)
            bend = soil * draw.uniform(-0.5, 0.5) * at**2 / scale.peak[sensor.channel]
            gain = chain.gain * (1.0 + 0.25 * soil * draw.normal())
            chain = msgspec.structs.replace(chain, bend=tuple(zip(at.tolist(), bend.tolist(), strict=True)), gain=gain)
        sensors.append(msgspec.structs.replace(sensor, chain=chain))
    return replace(hidden, model=msgspec.structs.replace(model, sensors=tuple(sensors)))


def _played(hidden: Hidden, takes: tuple[VirtualRun, ...], seed: int, *, soil: float, rest: float, noise: float) -> Campaign:
    from scipy.signal import butter, sosfilt

    runs: dict[str, Run] = {}
    drive = hidden.model.drive.channel
    for k, take in enumerate(takes):
        generator = np.random.default_rng([seed, k])
        first = next((j for j, other in enumerate(takes) if other.id == REPEATS.get(take.id)), k)
        head = head_of(take, RATE, int(np.random.default_rng([seed, first, 1]).integers(2**31)))
        if rest:
            fade = np.minimum(np.arange(len(head)) / (0.5 * RATE), 1.0)
            head = np.concatenate([np.zeros(round(rest * RATE)), fade * head])
        records = hidden.records(
            head, RATE, configuration=take.configuration, gain=take.gain, start_time=take.start, run=take.id
        )  # fmt: skip
        floor = butter(2, [2.0, 30.0], btype="band", fs=RATE, output="sos")
        channels = {}
        for name, clean in records.items():
            values = clean + generator.normal(0.0, noise, len(clean))
            if soil and name != drive:
                shake = sosfilt(floor, generator.normal(0.0, 1.0, len(clean)))
                values += 0.5 * soil * np.std(clean) / np.std(shake) * shake
            channels[name] = Channel(name=name, samples=values)
        runs[take.id] = Run(
            id=take.id, configuration=take.configuration, sample_rate=RATE, gain=take.gain, channels=channels,
            excitation=take.excitation, started=BEGIN + timedelta(seconds=take.start), repeat_of=REPEATS.get(take.id),
            band=None if take.excitation == "moves" else take.band, use=take.use,
        )  # fmt: skip
    known = {**known_of(hidden.model), **hidden.known}
    return Campaign(runs=tuple(runs.values()), known=known, source="virtual rig")


def draw_bonder(kind: str, size: float, seed: int, *, soil: float = 0.0, rest: bool = False) -> OtherEnvelope:
    """Draw rig, place and numbers by the seed, and simulate the session and the one after it.

    Parameters
    ----------
    kind, size, seed
        What is hidden, how large (1 is full size), and the draw's seed.
    soil
        Share of every signal that no model has: small loose parts, uneven friction, vibration of the floor, bent sensors.
    rest
        Whether every run begins with rest, and its drive fades in.
    """
    draw = generator_of(seed, f"{kind} of an unlike bonder")
    model = drawn_rig(draw)
    scale = amplitudes_of(model)
    truth: tuple[tuple[str | None, str, str], ...] = ()
    hidden = Hidden(model=model)
    if kind in FOREIGN:
        make, cause, what, places = FOREIGN[kind]
        place = str(draw.choice(places))
        hidden, truth = Hidden(model=make(model, scale, place, size, draw)), ((cause, what, place),)
    elif kind != "none":
        hidden = drawn_effect(kind, model, size, draw)
        truth = tuple((cause, kind_of(cause), place) for cause, place in hidden.truth)
    disturbances: frozenset[tuple[str, str]] = frozenset()
    if soil:
        hidden = _soiled(hidden, scale, soil, draw)
        loose = {("added_motion", link.b) for link in hidden.model.links if link.name.startswith("dirt")}
        uneven = {("friction_shape", contact.name) for contact in hidden.model.contacts if contact.name == "isolation"}
        disturbances = frozenset({*loose, *uneven, *(("sensor", sensor.channel) for sensor in hidden.model.sensors)})
    lead = float(draw.uniform(0.5, 2.5)) if rest else 0.0
    noise = float(draw.uniform(5e-4, 1.5e-3))
    return OtherEnvelope(
        kind=kind, truth=truth, guess=model, disturbances=disturbances,
        campaign=_played(hidden, SESSION, seed, soil=soil, rest=lead, noise=noise),
        later=_played(hidden, LATER, seed + 1, soil=soil, rest=lead, noise=noise),
    )  # fmt: skip
