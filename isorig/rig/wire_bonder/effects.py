"""Effects that a virtual rig can hide: every cause of the catalogue with a random size, and some outside the catalogue."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from zlib import crc32

import msgspec
import numpy as np

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.diagnose.causes import CATALOGUE
from isorig.analysis.diagnose.causes.base import Amplitudes, Cause, RandomSizes
from isorig.analysis.errors import ModelError
from isorig.analysis.model.rig_model import GROUND, Contact, Link, RigModel
from isorig.analysis.simulate import Excitation, simulate
from isorig.analysis.simulate.gauges import DEFLECTION, SPEED, link_sensors
from isorig.rig.errors import RigError
from isorig.rig.wire_bonder.description import FRICTION, wire_bonder
from isorig.rig.wire_bonder.session import VirtualRun, head_of, known_of, records_of, virtual_campaign

Draw = np.random.Generator
Wire = Callable[[Run, dict[str, FloatArray]], dict[str, FloatArray]]
CHANNELS = ("head", "motor", "table", "heatblock")
#: Length of a session, s: drifts last as long.
LENGTH = 720.0
#: Largest size of an effect relative to its full size.
SIZE_MOST = 10.0


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
    wire: Wire | None = None

    def records(
        self, drive: FloatArray, sample_rate: float, *, configuration: str, gain: float, start_time: float, run: str
    ) -> dict[str, FloatArray]:
        """The channels of a run without their noise, by channel, each shape (n,).

        `drive` are the drive's true values, shape (n,), at a rate in Hz; `start_time` is in seconds since the rig's first run.
        """
        name = self.model.drive.channel
        played = Run(
            id=run, configuration=configuration, sample_rate=sample_rate, gain=gain,
            channels={name: Channel(name=name, samples=drive)},
        )  # fmt: skip
        model = self.model if self.per_run is None else self.per_run(self.model, played)
        found = records_of(model, drive, sample_rate, configuration, start_time)
        return found if self.wire is None else self.wire(played, found)


def amplitudes_of(model: RigModel) -> Amplitudes:
    """The largest motions of a wire bonder, from half a minute at the highest gain, 70."""
    rate = 1024.0
    head = head_of(VirtualRun(id="s", configuration="unlocked", gain=70.0, seconds=30.0, start=0.0), rate, 99)
    watched = msgspec.structs.replace(model, sensors=(*model.sensors, *link_sensors(model.links)))
    seen = simulate(watched, Excitation.prepare(head, rate, oversample=4)).channels
    most = {name: float(np.abs(values).max()) for name, values in seen.items()}
    return Amplitudes(
        deflection={link.name: most[DEFLECTION + link.name] for link in model.links},
        speed={link.name: most[SPEED + link.name] for link in model.links},
        peak={**{s.channel: most[s.channel] for s in model.sensors}, "head": float(np.abs(head).max())},
        sample_rate=rate, end_time=LENGTH,
    )  # fmt: skip


def _hum(channel: str, amplitude: float, mains: float, draw: Draw) -> Wire:
    third, phases = draw.uniform(0.1, 0.5), draw.uniform(0, 2 * np.pi, (20, 2))

    def hum(run: Run, records: dict[str, FloatArray]) -> dict[str, FloatArray]:
        t = np.arange(len(run)) / run.sample_rate
        a, b = phases[sum(map(ord, run.id)) % 20]
        wave = np.sin(2 * np.pi * mains * t + a) + third * np.sin(2 * np.pi * 3 * mains * t + b)
        return {**records, channel: records[channel] + amplitude * wave}

    return hum


def _foot(m: RigModel, motions: Amplitudes, size: float, draw: Draw) -> Hidden:
    """The table rubs on the floor."""
    rub = Contact(name="foot", a="table", b=GROUND, law=laws.Coulomb(friction_force=size * draw.uniform(3.0, 10.0)))
    return Hidden(model=msgspec.structs.replace(m, contacts=(*m.contacts, rub)), outside=(("friction_shape", "table"),))


def _cable(m: RigModel, motions: Amplitudes, size: float, draw: Draw) -> Hidden:
    """A hose or cable connects the motor to the floor."""
    k = m.link("isolation").stiffness
    hose = Link(name="hose", a="motor", b=GROUND, stiffness=size * draw.uniform(0.2, 0.6) * k, damping=0.02 * k / 30.0)
    return Hidden(model=msgspec.structs.replace(m, links=(*m.links, hose)))


def _wear(m: RigModel, motions: Amplitudes, size: float, draw: Draw) -> Hidden:
    """The friction differs from run to run."""
    levels = 1.0 + size * draw.uniform(-0.6, 0.6, 20)

    def worn(model: RigModel, run: Run) -> RigModel:
        level = levels[sum(map(ord, run.id)) % 20]
        return model.replace({FRICTION: level * model.get(FRICTION)})

    return Hidden(model=m, outside=(("drift", "isolation"),), per_run=worn)


def _bent_sensor(m: RigModel, motions: Amplitudes, size: float, draw: Draw) -> Hidden:
    """A sensor with a quadratic error."""
    channel, bend = str(draw.choice(CHANNELS[1:])), size * draw.uniform(0.15, 0.4)

    def bent(run: Run, records: dict[str, FloatArray]) -> dict[str, FloatArray]:
        return {**records, channel: records[channel] + bend * records[channel] ** 2 / motions.peak[channel]}

    return Hidden(model=m, outside=(("sensor", channel),), wire=bent)


def _slow_sensor(m: RigModel, motions: Amplitudes, size: float, draw: Draw) -> Hidden:
    """A sensor whose high-pass corner frequency is too high."""
    from scipy.signal import butter, lfilter

    channel, corner = str(draw.choice(CHANNELS[1:])), size * draw.uniform(1.0, 4.0)

    def slow(run: Run, records: dict[str, FloatArray]) -> dict[str, FloatArray]:
        b, a = butter(1, corner, "highpass", fs=run.sample_rate)
        return {**records, channel: lfilter(b, a, records[channel])}

    return Hidden(model=m, outside=(("sensor", channel),), wire=slow)


def _loose_plug(m: RigModel, motions: Amplitudes, size: float, draw: Draw) -> Hidden:
    """A connector that loses the signal now and then."""
    channel, seed = str(draw.choice(CHANNELS[1:])), int(draw.integers(2**31))
    share = size * draw.uniform(0.01, 0.04)

    def loose(run: Run, records: dict[str, FloatArray]) -> dict[str, FloatArray]:
        lost = np.repeat(np.random.default_rng(seed + sum(map(ord, run.id))).random(len(run) // 64 + 1) < share, 64)
        return {**records, channel: np.where(lost[: len(run)], 0.0, records[channel])}

    return Hidden(model=m, wire=loose)


#: The causes that a wire bonder has a place for, by name.
CAUSES: Mapping[str, Cause] = {cause.name: cause for cause in CATALOGUE if cause.supposed_places(wire_bonder())}
OUTSIDE: Mapping[str, Callable[[RigModel, Amplitudes, float, Draw], Hidden]] = {
    "rubbing foot": _foot, "hose": _cable, "worn friction": _wear, "bent sensor": _bent_sensor,
    "slow sensor": _slow_sensor, "loose plug": _loose_plug,
}  # fmt: skip
KINDS = ("none", *CAUSES, *(f"outside: {name}" for name in OUTSIDE), "two")
#: Pairs of simultaneous effects; the second is added to the first.
PAIRS = (
    ("hardening_stiffness", "sensor_gain"), ("stribeck_friction", "channel_delay"), ("extra_mode", "hardening_stiffness"),
    ("backlash", "sensor_gain"), ("stiffness_drift", "quadratic_damping"), ("end_stop", "crosstalk"),
)  # fmt: skip


def generator_of(seed: int, kind: str) -> Draw:
    """The random numbers of an effect: they follow from its name, so they stay the same when the catalogue grows."""
    return np.random.default_rng([seed, crc32(kind.encode())])


def drawn_effect(kind: str, model: RigModel, size: float, draw: Draw) -> Hidden:
    """An effect of one of `KINDS`, or a pair of effects, added with random place and parameters; `size` 1 is full size."""
    motions, hidden = amplitudes_of(model), Hidden(model=model)
    for each in PAIRS[int(draw.integers(len(PAIRS)))] if kind == "two" else (kind,):
        more = one_effect(each, hidden.model, motions, size, draw)
        parameters = {**hidden.parameters, **more.parameters}
        hidden = replace(more, truth=hidden.truth + more.truth, parameters=parameters, known=known_of(model))
    return hidden


def hidden_in(model: RigModel, kind: str | None, size: float, seed: int) -> Hidden:
    """The effect that a seed selects for a wire bonder; none if no kind is given. Raises RigError if there is no such kind, the
    size is not allowed, or the rig has no place for it."""
    if kind is None:
        return Hidden(model=model)
    if kind not in KINDS:
        raise RigError(f"there is no effect {kind!r}; there are {', '.join(KINDS)}")
    if not 0.0 < size <= SIZE_MOST:
        raise RigError(f"the size of the effect is {size:g}; give one above 0 and up to {SIZE_MOST:g}, 1 is full size")
    try:
        return drawn_effect(kind, model, size, generator_of(seed, kind))
    except (ModelError, KeyError):
        raise RigError(f"the rig {model.name!r} has no place for {kind!r}; effects are hidden in a wire bonder") from None


def one_effect(kind: str, model: RigModel, motions: Amplitudes, size: float, draw: Draw) -> Hidden:
    """One effect added to a rig, its parameters scaled by the largest motions of the rig."""
    if kind == "none":
        return Hidden(model=model)
    if kind.startswith("outside: "):
        return OUTSIDE[kind.removeprefix("outside: ")](model, motions, size, draw)
    cause, sizes = CAUSES[kind], RandomSizes(draw)
    place = sizes.one_of(cause.supposed_places(model))
    rig = cause.sized(model, motions, place, size, sizes)
    return Hidden(
        model=rig.model, truth=((kind, place),), parameters=rig.parameters, known=known_of(model),
        wire=None if rig.hum is None else _hum(*rig.hum, draw),
    )  # fmt: skip


def campaign_with(hidden: Hidden, takes: Sequence[VirtualRun], seed: int, noise: float = 1e-3) -> Campaign:
    """A session on a rig with a hidden effect; see `virtual_campaign`."""
    campaign = virtual_campaign(hidden.model, takes, seed=seed, noise=noise)
    runs = list(campaign.runs)
    for k, take in enumerate(takes):
        if hidden.per_run is not None:
            runs[k] = virtual_campaign(hidden.per_run(hidden.model, runs[k]), [take], seed=seed + 7 * k, noise=noise).runs[0]
        if hidden.wire is not None:
            records = hidden.wire(runs[k], {name: runs[k].read(name) for name in runs[k].channels})
            channels = {
                name: replace(channel, samples=np.round(records[name] / channel.scale).astype(np.int32))
                for name, channel in runs[k].channels.items()
            }
            runs[k] = replace(runs[k], channels=channels)
    return replace(campaign, runs=tuple(runs), known={**campaign.known, **hidden.known})
