"""A lumped rig as data: bodies, links, contacts, a drive, sensors and configurations.

The one-, two- and three-mass rigs of the thesis and the wire bonder are instances of `RigModel`, not classes. A
coordinate is a body's displacement along the axis (m), or an angle (rad) if a body's `mass` is a moment of inertia; `arms` are
lever arms by which an element acts on further coordinates, for example for a rocking motor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from functools import cached_property, reduce
from itertools import pairwise
from math import isfinite
from typing import Any, Literal, TypeVar

import msgspec
import numpy as np

from isorig.analysis.campaign import MOTION, ROTARY, UNLOCKED, FloatArray, Quantity
from isorig.analysis.errors import ModelError
from isorig.analysis.excitations import SyntheticExcitation
from isorig.analysis.given import all_of_type, given_mapping, number, of_type, text
from isorig.analysis.laws import FrictionLaw, LinkLaw
from isorig.analysis.laws.base import LinkConstants
from isorig.analysis.model.limits import Limits
from isorig.analysis.model.refusals import explained
from isorig.analysis.views import call
from isorig.analysis.wording import did_you_mean

GROUND = "ground"


class Part(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of the parts of a rig."""


class Body(Part, frozen=True, kw_only=True):
    """A coordinate with its mass in kg; for a rotation an angle in rad with its moment of inertia in kg m^2.

    `mass_std` is the standard uncertainty of a given mass, in the same unit; 0 if it is not stated.
    """

    name: str
    mass: float
    mass_std: float = 0.0
    motion: Literal["straight", "rotation"] = "straight"


class Joint(Part, frozen=True, kw_only=True):
    """Joins body `a` to body `b` or to "ground"; `arms` adds factor * coordinate to the elongation x_a - x_b (m per rad)."""

    name: str
    a: str
    b: str = GROUND
    arms: dict[str, float] = msgspec.field(default_factory=dict)

    @property
    def joined(self) -> set[str]:
        """Its ends, "ground" if one is, and the bodies on whose coordinates it acts by lever arms."""
        return {self.a, self.b, *self.arms}


class Link(Joint, frozen=True, kw_only=True):
    """A spring (N/m) and damper (N s/m) between the ends of a joint; `laws` add their forces."""

    stiffness: float = 0.0
    damping: float = 0.0
    laws: tuple[LinkLaw, ...] = ()

    def rubbing(self, law: FrictionLaw) -> Contact:
        """Friction that resists the link's elongation: a contact of its name with its ends and arms."""
        return Contact(name=self.name, a=self.a, b=self.b, law=law, arms=self.arms)


class Contact(Joint, frozen=True, kw_only=True):
    """A friction law between the ends of a joint, acting on the velocity of a relative to b."""

    law: FrictionLaw


class Chain(Part, frozen=True, kw_only=True):
    """Faults of a channel's measurement chain. A chain without faults has the defaults.

    recorded(t) = clip(gain * true(t - delay) + offset + sum of fraction * true of another channel + hum, limit); the hum has
    `mains_frequency` (Hz; None for no hum) and its multiples, with any phase. A sensor's `bend` is a static curve added to its
    record, as pairs of (true value, added value), linear beyond its ends; its `taps` are a short filter, the weights of `gain` *
    true at samples around the present one (an odd number, later ones first), applied before the bend. Of a sensor that is coupled
    by a capacitor, `corner` (Hz) is the corner frequency of the first-order high-pass through which gain * true passes; of one
    with a slow amplifier, `cutoff` (Hz) is that of a first-order low-pass; 0 for none.
    """

    gain: float = 1.0
    delay: float = 0.0
    offset: float = 0.0
    limit: float | None = None
    crosstalk: dict[str, float] = msgspec.field(default_factory=dict)
    mains_frequency: float | None = None
    bend: tuple[tuple[float, float], ...] = ()
    taps: tuple[float, ...] = ()
    corner: float = 0.0
    cutoff: float = 0.0


#: The chain of most channels.
WITHOUT_FAULTS = Chain()


class Drive(Part, frozen=True, kw_only=True):
    """What drives: a force on bodies, or the motion of one body.

    The force is `factor` * the drive channel's value, on each coordinate of `pushes` by its weight. For a head of mass m whose
    acceleration is recorded, `factor` is m (kg) and `pushes` is {"motor": -1.0}. With `imposes` the channel is the motion of that
    body, with any force: a shaken base, the ground, an actuator under displacement control. `factor_std` is the standard
    uncertainty of a given factor; 0 if it is not stated.

    Where the channel records a command, the force may differ from it: `curve` is a static curve added to the command, as a
    chain's `bend`, `limit` the largest magnitude that acts, in the channel's unit (None for no limit), and `lag` the time
    constant in s of the first-order lag with which all this acts (an amplifier, a coil); 0 for none.
    """

    channel: str
    factor: float = 1.0
    factor_std: float = 0.0
    pushes: dict[str, float] = msgspec.field(default_factory=dict)
    imposes: str | None = None
    quantity: Quantity = "acceleration"
    chain: Chain = WITHOUT_FAULTS
    curve: tuple[tuple[float, float], ...] = ()
    limit: float | None = None
    lag: float = 0.0

    @property
    def acts_as_recorded(self) -> bool:
        """Whether its force follows its record without a curve, a limit and a lag."""
        return not self.curve and self.limit is None and self.lag == 0.0


class Sensor(Part, frozen=True, kw_only=True):
    """A channel that records a body's motion, absolute or relative to another body, with `arms` as in a link; or a force.

    `force_in` names the force: "links.NAME" passes from a to b through the link, its laws and the contacts between the same two
    ends; "contacts.NAME" is the friction with which it resists a; "drive.CHANNEL" is what it takes to impose that drive's motion.
    """

    channel: str
    body: str = ""
    force_in: str | None = None
    quantity: Quantity = "acceleration"
    relative_to: str = GROUND
    arms: dict[str, float] = msgspec.field(default_factory=dict)
    chain: Chain = WITHOUT_FAULTS


class Configuration(Part, frozen=True, kw_only=True):
    """A configuration of the rig: the links in `rigid` are blocked, unless the lock is elastic.

    `lock_stiffness` (N/m) and `lock_damping` (N s/m) replace each rigid link by a spring; None is a perfect lock.
    `initial_position` (m) and `initial_velocity` (m/s) of bodies are the state at the start of a run, by default at rest at zero:
    for example a mass that is pulled and released.
    """

    rigid: tuple[str, ...] = ()
    lock_stiffness: float | None = None
    lock_damping: float = 0.0
    initial_position: dict[str, float] = msgspec.field(default_factory=dict)
    initial_velocity: dict[str, float] = msgspec.field(default_factory=dict)


class Usual(Part, frozen=True, kw_only=True):
    """The usual measurement of the rig: defaults for commands with a synthetic drive.

    Raises ModelError if a number is not allowed.
    """

    excitation: SyntheticExcitation = "random"  #: Kind of drive.
    #: rms of noise and multisines, peak of all others, in the SI unit of the drive channel; None if not given.
    level: float | None = None
    band: tuple[float, float] | None = None  #: Lowest and highest frequency of the drive, Hz.
    seconds: float = 30.0  #: Length of a run.
    sample_rate: float = 1024.0  #: Hz.

    def __post_init__(self) -> None:
        for key in ("level", "seconds", "sample_rate"):
            value = getattr(self, key)
            if value is not None and not 0.0 < value < float("inf"):
                raise ModelError(f"usual.{key} is {value:g}; give a finite value above zero, or leave it out")
        if self.band is not None and not 0.0 < self.band[0] < self.band[1] <= self.sample_rate / 2.0:
            raise ModelError(
                f"usual.band is {list(self.band)}; give [lowest, highest] in Hz, from above 0 to at most half of "
                f"usual.sample_rate, which is {self.sample_rate / 2.0:g}"
            )


class RigModel(Part, frozen=True, kw_only=True, dict=True):  # dict: for the cached properties
    """A whole rig.

    Parameters
    ----------
    name
        Name of the rig.
    bodies, links, contacts, drive, sensors, configurations
        Its parts. Names are unique within a kind.
    more_drives
        Further simultaneous drives.
    free_free
        Whether bodies may be unconnected to the ground.
    free
        Paths of the parameters that a fit may change, e.g. "bodies.table.mass", "links.isolation.stiffness",
        "contacts.isolation.law.friction_force".
    note
        Free text.
    limits
        Limits for proposed runs.
    usual
        Its usual measurement.

    Raises
    ------
    ModelError
        A part contradicts physics, or names a body that does not exist.

    Examples
    --------
    >>> import isorig as iso
    >>> rig = iso.wire_bonder()
    >>> rig.get("bodies.motor.mass")
    16.4
    >>> rig.replace({"bodies.motor.mass": 20.0}).get("bodies.motor.mass")
    20.0
    """

    name: str
    bodies: tuple[Body, ...]
    drive: Drive
    links: tuple[Link, ...] = ()
    contacts: tuple[Contact, ...] = ()
    sensors: tuple[Sensor, ...] = ()
    configurations: dict[str, Configuration] = msgspec.field(default_factory=lambda: {UNLOCKED: Configuration()})
    free: tuple[str, ...] = ()
    note: str = ""
    limits: Limits = Limits()
    usual: Usual = Usual()
    more_drives: tuple[Drive, ...] = ()
    free_free: bool = False

    def __post_init__(self) -> None:
        check(self)

    def __repr__(self) -> str:
        bodies, sensors = (", ".join(names) for names in ([b.name for b in self.bodies], [s.channel for s in self.sensors]))
        return f"Rig({self.name!r}, bodies {bodies}; drive {self.drive.channel}; sensors {sensors}; {len(self.free)} free)"

    @property
    def joints(self) -> tuple[Link | Contact, ...]:
        """All links, followed by all contacts."""
        return (*self.links, *self.contacts)

    def state_space(self, configuration: str | None = None) -> Any:
        """The linear part in a configuration (the first if None) as an `isorig.analysis.simulate.state_space.StateSpace`."""
        return call(self, "state_space", configuration)

    def plot(self) -> Any:
        """Its sketch, for a notebook."""
        return call(self, "plot")

    def _repr_html_(self) -> str:
        return str(call(self, "html"))

    @property
    def drives(self) -> tuple[Drive, ...]:
        """All drives, the first one first."""
        return (self.drive, *self.more_drives)

    @property
    def usual_ratio(self) -> tuple[str, str, tuple[str, ...]]:
        """Response, reference and configurations that are compared by default: the last sensor over the first drive, in the first
        two configurations (or the only one). For the wire bonder heatblock over head, unlocked relative to locked."""
        reference = self.drive.channel
        response = next((sensor.channel for sensor in reversed(self.sensors) if sensor.channel != reference), reference)
        return response, reference, tuple(self.configurations)[:2]

    def constants_of(self, link: Link) -> LinkConstants:
        """What a law on a link may depend on."""
        mass = min(self.body(body).mass for body in (link.a, link.b) if body != GROUND)
        return LinkConstants(stiffness=link.stiffness, damping=link.damping, mass=mass)

    def sensed_contacts(self, configuration: str) -> tuple[tuple[Contact, str, str], ...]:
        """Contacts that may slide in a configuration, each with the channels that record the motion of its two bodies alike."""
        found = []
        setup = self.configurations[configuration]
        locked = [] if setup.lock_stiffness is not None else [{self.link(name).a, self.link(name).b} for name in setup.rigid]
        for contact in self.contacts:
            ends = {
                body: {s.quantity: s.channel for s in self.sensors if (s.body, s.relative_to) == (body, GROUND) and not s.arms}
                for body in (contact.a, contact.b)
            }
            alike = [quantity for quantity in ends[contact.a] if quantity in ends[contact.b]]
            if alike and not contact.arms and {contact.a, contact.b} not in locked:
                found.append((contact, ends[contact.a][alike[0]], ends[contact.b][alike[0]]))
        return tuple(found)

    @property
    def imposed(self) -> tuple[str, ...]:
        """The bodies whose motion is imposed."""
        return tuple(drive.imposes for drive in self.drives if drive.imposes is not None)

    @property
    def drive_channels(self) -> tuple[str, ...]:
        """The channels of its drives, the main one first."""
        return tuple(drive.channel for drive in self.drives)

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that a run of this rig has: its drives, then its sensors."""
        return (*self.drive_channels, *(sensor.channel for sensor in self.sensors))

    @property
    def quantities(self) -> dict[str, Quantity]:
        """What each of these channels measures."""
        return {drive.channel: drive.quantity for drive in self.drives} | {each.channel: each.quantity for each in self.sensors}

    def limits_within(self, *others: Limits) -> Limits:
        """Its limits and others, the tightest of each.

        Raises
        ------
        ModelError
            Two exclude each other, or one is for a link or channel that the rig does not have.
        """
        limits = reduce(Limits.within, others, self.limits)
        links = [link.name for link in self.links]
        for key, names, known in (("stroke", limits.stroke, links), ("channels", limits.channels, self.channels)):
            if unknown := [name for name in names if name not in known]:
                raise ModelError(f"limits.{key} names {unknown[0]!r}, which the rig does not have; it has {', '.join(known)}")
        return limits

    @cached_property
    def moving_parts(self) -> bytes:
        """All that determines the motion, as a key for caches: not the sensors and the faults of channels."""
        drives = [(drive.pushes, drive.factor, drive.imposes) for drive in self.drives]
        parts = (self.bodies, self.links, self.contacts, self.configurations, drives)
        return msgspec.msgpack.encode(parts, enc_hook=float)

    def moving_in(self, configuration: str) -> bytes:
        """All that determines the sensors' motion in a configuration, as a key for caches: not what a perfect lock blocks."""
        setup = self.configurations[configuration]
        blocked = () if setup.lock_stiffness is not None else setup.rigid
        ends = [(link.a, link.b, link.arms) for link in self.links if link.name in blocked]
        ends += [(b, a, {}) for a, b, arms in ends if not arms]
        forces = any(sensor.force_in is not None for sensor in self.sensors)
        parts = (
            self.bodies, self.drives, setup,
            [link for link in self.links if forces or link.name not in blocked],
            [c for c in self.contacts if forces or (c.a, c.b, c.arms) not in ends],
            [msgspec.structs.replace(sensor, chain=WITHOUT_FAULTS) for sensor in self.sensors],
        )  # fmt: skip
        return msgspec.msgpack.encode(parts, enc_hook=float)

    @cached_property
    def without_faults(self) -> RigModel:
        """The rig with perfect sensors and without free parameters: it moves alike, and so do all that differ in these only."""
        sound = tuple(msgspec.structs.replace(sensor, chain=WITHOUT_FAULTS) for sensor in self.sensors)
        return msgspec.structs.replace(self, sensors=sound, free=())

    @cached_property
    def encoded(self) -> bytes:
        """The model as JSON."""
        return msgspec.json.encode(self)

    def body(self, name: str) -> Body:
        """The body with that name."""
        return _named(self.bodies, name, "body")

    def link(self, name: str) -> Link:
        """The link with that name."""
        return _named(self.links, name, "link")

    def contact(self, name: str) -> Contact:
        """The contact with that name."""
        return _named(self.contacts, name, "contact")

    def sensor(self, channel: str) -> Sensor:
        """The sensor with that channel."""
        for sensor in self.sensors if isinstance(channel, str) else ():
            if sensor.channel == channel:
                return sensor
        text(channel, "the name of a channel", "table")
        names = [sensor.channel for sensor in self.sensors]
        raise ModelError(f"no sensor records {channel!r}{did_you_mean(channel, names)}; the rig has {names}")

    def get(self, path: str) -> float:
        """Value of the parameter at a dotted path, e.g. "links.isolation.stiffness"."""
        item: Any = self
        for step in _path(path).split("."):
            item = _step(item, step, path)
        if isinstance(item, bool) or not isinstance(item, int | float):
            raise ModelError(f"{path!r} is not a number of this rig; give the path of a parameter")
        return float(item)

    def replace(self, values: Mapping[str, float]) -> RigModel:
        """The same rig with new values of the parameters at these dotted paths.

        Raises
        ------
        ArgumentError
            An argument is of another type.
        ModelError
            A path is no parameter, or a value contradicts physics.
        """
        given_mapping(values, "the argument values", 'a mapping of paths to numbers; give for example {"bodies.NAME.mass": 20.0}')
        given = {_path(path): number(value, f"the value of {path!r}") for path, value in values.items()}
        tree: dict[str, Any] = {}
        try:
            for path, value in given.items():
                *way, last = path.split(".")
                node = tree
                for step in way:
                    node = node.setdefault(step, {})
                node[last] = value
            # Names and joints stay as they are, so the numbers are checked only: fits replace values thousands of times.
            changed = copy(self)
            for field, part in tree.items():
                msgspec.structs.force_setattr(changed, field, _with_values(getattr(self, field), part))
        except (LookupError, AttributeError, TypeError, ValueError):
            for path in given:
                self.get(path)  # says which path is no parameter
            raise
        _check_numbers(changed, given)
        return changed


def _path(given: object) -> str:
    return of_type(given, str, "the path of a parameter", 'a text; give one, for example "bodies.NAME.mass"')


def to_tree(model: RigModel) -> dict[str, Any]:
    """The model as plain dicts, lists and numbers, ready for JSON."""
    tree: dict[str, Any] = msgspec.json.decode(model.encoded)
    return tree


def from_tree(tree: Mapping[str, Any]) -> RigModel:
    """A model from plain dicts and lists; numbers may be numpy's. Raises ModelError with the key, the value found and what is
    allowed."""
    try:
        return msgspec.convert(_plain(tree), RigModel)
    except msgspec.ValidationError as error:
        raise ModelError(explained(str(error), tree, RigModel, "the rig")) from None
    except RecursionError:
        raise ModelError("the rig's description is nested too deeply; write its parts as flat tables") from None


def _plain(part: Any) -> Any:
    if isinstance(part, Mapping):
        return {key: _plain(value) for key, value in part.items()}
    if isinstance(part, list | tuple):
        return [_plain(value) for value in part]
    return part.item() if isinstance(part, np.generic) else part


Named = TypeVar("Named", Body, Link, Contact)


def _named(parts: Sequence[Named], name: str, kind: str) -> Named:
    # The part of that name; names may come from a user. Most exist: only others are checked.
    found = next((part for part in parts if part.name == name), None) if isinstance(name, str) else None
    if found is None:
        text(name, f"the name of a {kind}", parts[0].name if parts else kind)
        names = [part.name for part in parts]
        raise ModelError(f"the rig has no {kind} {name!r}{did_you_mean(name, names)}, only {names}; name one of these")
    return found


def _names(parts: tuple[Any, ...]) -> list[str]:
    # Of parts of one kind: their names, channels or indices.
    for key in ("name", "channel"):
        if parts and hasattr(parts[0], key):
            return [getattr(part, key) for part in parts]
    return [str(k) for k in range(len(parts))]


def _step(item: Any, step: str, path: str) -> Any:
    there: list[str] = []
    if isinstance(item, tuple):
        named = dict(zip(_names(item), item, strict=True))
        if step in named:
            return named[step]
        if step.isdigit() and int(step) < len(item):
            return item[int(step)]
        there = list(named)
    elif isinstance(item, dict):
        if step in item:
            return item[step]
        there = list(item)
    elif hasattr(item, "__struct_fields__"):
        if step in item.__struct_fields__:
            return getattr(item, step)
        there = list(item.__struct_fields__)
    raise ModelError(
        f"the rig has no parameter {path!r}: {step!r} is not there{did_you_mean(step, there)}; give an existing path"
    )


def _with_values(item: Any, tree: float | Mapping[str, Any]) -> Any:
    # A part of a rig with other values at existing places; all those of a part at once, since they may depend on each other.
    if isinstance(tree, float):
        if isinstance(item, bool) or not isinstance(item, int | float):
            raise LookupError
        return tree
    if isinstance(item, tuple):
        names = _names(item)
        places = {step if step in names else names[int(step)]: values for step, values in tree.items()}
        return tuple(_with_values(part, places[name]) if name in places else part for name, part in zip(names, item, strict=True))
    if isinstance(item, dict):
        return item | {step: _with_values(item[step], values) for step, values in tree.items()}
    return msgspec.structs.replace(item, **{step: _with_values(getattr(item, step), values) for step, values in tree.items()})


def direction(model: RigModel, a: str, b: str, arms: Mapping[str, float]) -> FloatArray:
    """Weights of the coordinates in x_a - x_b plus arms, shape (bodies,)."""
    index = {body.name: i for i, body in enumerate(model.bodies)}
    weights = np.zeros(len(index))
    if a != GROUND:
        weights[index[a]] += 1.0
    if b != GROUND:
        weights[index[b]] -= 1.0
    for name, factor in arms.items():
        weights[index[name]] += factor
    return weights


def weights_of(model: RigModel, part: Joint | Sensor) -> FloatArray:
    """Weights of the coordinates in a joint's elongation or in the motion that a sensor records, shape (bodies,)."""
    a, b = (part.a, part.b) if isinstance(part, Joint) else (part.body, part.relative_to)
    return direction(model, a, b, part.arms)


def damps(model: RigModel, link: Link) -> bool:
    """Whether a force over the velocity at a link is its own: it has a damping, or no link between the same ends has one."""
    own = weights_of(model, link)
    dampers = (weights_of(model, other) for other in model.links if other.damping > 0.0)
    return link.damping > 0.0 or not any(np.array_equal(own, way * other) for other in dampers for way in (1.0, -1.0))


def weights_by_body(model: RigModel, part: Joint) -> dict[str, float]:
    """The same by body, for the bodies whose coordinates are in a joint's elongation."""
    return {body.name: w for body, w in zip(model.bodies, weights_of(model, part).tolist(), strict=True) if w}


def single_drive(model: RigModel, what: str) -> None:
    """Raise ModelError where a rig has several drives, an imposed motion, a measured force or an initial state.

    `what` is the sentence's subject, e.g. "a scan of parameters".
    """
    setups = model.configurations.values()
    found = {
        "several drives": model.more_drives,
        "an imposed motion": model.imposed,
        "a sensor of a force": any(sensor.force_in is not None for sensor in model.sensors),
        "an initial position or velocity": any(setup.initial_position or setup.initial_velocity for setup in setups),
    }
    for name, there in found.items():
        if there:
            raise ModelError(
                f"{what} does not simulate {name}, which the rig {model.name!r} has; use rig simulate or rig diagnose"
            )


def matrices(model: RigModel) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mass, damping and stiffness matrices of the unconstrained linear part, each shape (bodies, bodies)."""
    n = len(model.bodies)
    mass = np.diag([body.mass for body in model.bodies])
    damping, stiffness = np.zeros((n, n)), np.zeros((n, n))
    for link in model.links:
        w = weights_of(model, link)
        stiffness += link.stiffness * np.outer(w, w)
        damping += link.damping * np.outer(w, w)
    return mass, damping, stiffness


def check(model: RigModel) -> None:
    """Raise ModelError if the parts contradict each other or physics."""
    _typed(model)
    names = [body.name for body in model.bodies]
    _unique(names, "body")
    _unique([link.name for link in model.links], "link")
    _unique([contact.name for contact in model.contacts], "contact")
    _unique(list(model.channels), "channel")
    for name in (
        model.name,
        *names,
        *(joint.name for joint in model.joints),
        *model.channels,
        *model.configurations,
        *model.note.splitlines(),
    ):
        if not name.isprintable():
            raise ModelError(f"the rig has the name {name!r}, which cannot be displayed; rename it")
    if not names:
        raise ModelError("the rig has no bodies; give at least one")
    if GROUND in names:
        raise ModelError('a body has the name "ground", which is reserved for the fixed reference; rename it')
    for part in model.joints:
        here = f"{type(part).__name__.lower()} {part.name!r}"
        _known(names, (part.a, part.b, *part.arms), here)
        if part.a == part.b:
            raise ModelError(f"{here} connects {part.a!r} to itself; give two different ends")
    if not model.free_free:
        _grounded(names, model.joints, model.imposed)
    for sensor in model.sensors:
        _seen(model, sensor)
        if sensor.force_in is None:
            _known(names, (sensor.body, sensor.relative_to, *sensor.arms), f"sensor {sensor.channel!r}")
    _check_numbers(model, msgspec.to_builtins(model, enc_hook=float))
    links = [link.name for link in model.links]
    for name, configuration in model.configurations.items():
        for rigid in configuration.rigid:
            if rigid not in links:
                raise ModelError(f"configuration {name!r} blocks link {rigid!r}, which does not exist; the rig has {links}")
        starts = (*configuration.initial_position, *configuration.initial_velocity)
        _known(names, starts, f"the initial state of configuration {name!r}")
        if fixed := [body for body in starts if body in model.imposed]:
            raise ModelError(
                f"configuration {name!r} gives an initial state of {fixed[0]!r}, whose motion is imposed; leave that out"
            )
    for path in model.free:
        model.get(path)
    for name in model.limits.stroke:
        if name not in links:
            raise ModelError(f"limits.stroke names link {name!r}, which does not exist; the rig has {links}")


def _check_numbers(model: RigModel, given: Mapping[str, Any]) -> None:
    # Raise ModelError if numbers contradict physics; `given` are those that may be infinite, in plain dicts and lists.
    for body in model.bodies:
        if not (0.0 < body.mass < float("inf")):
            raise ModelError(f"body {body.name!r} has mass {body.mass:g}; give a finite mass above zero")
        _uncertain(f"body {body.name!r}", "mass", body.mass, body.mass_std)
    for link in model.links:
        for key in ("stiffness", "damping"):
            value = getattr(link, key)
            if not (0.0 <= value < float("inf")):
                raise ModelError(f"link {link.name!r} has {key} {value:g}; give a finite value of zero or more")
    names = [body.name for body in model.bodies]
    for drive in model.drives:
        _driven(model, names, drive)
        _uncertain(f"the drive {drive.channel!r}", "factor", drive.factor, drive.factor_std)
    _finite(given)
    _chained(model)


def _typed(model: RigModel) -> None:
    # A decoder has checked the types, but a notebook can make parts without one.
    advice = "take them from another rig, for example iso.read_rig(FILE).model"
    of_type(model.name, str, "the name of the rig", "a text; give it in quotes")
    of_type(model.drive, Drive, "the drive of the rig", f"a Drive; {advice}")
    all_of_type(model.free, str, "the argument free of the rig", "a sequence of paths of parameters; give them in brackets")
    kinds: dict[str, type[Part]] = {"bodies": Body, "links": Link, "contacts": Contact, "sensors": Sensor, "more_drives": Drive}
    parts: list[Part] = [model.drive]
    for key, kind in kinds.items():
        allowed = f"a sequence of {kind.__name__}; {advice}"
        parts += all_of_type(getattr(model, key), kind, f"the argument {key} of the rig", allowed)
    setups = given_mapping(model.configurations, "the argument configurations", f"a mapping of names; {advice}")
    parts += [
        of_type(each, Configuration, f"configuration {name!r}", f"a Configuration; {advice}") for name, each in setups.items()
    ]
    for part in parts:
        for key, annotation in type(part).__annotations__.items():
            value = getattr(part, key)
            if annotation == "float" and type(value) is not float:
                number(value, f"{key} of {getattr(part, 'name', 'a part')!r}")


def _seen(model: RigModel, sensor: Sensor) -> None:
    here = f"sensor {sensor.channel!r}"
    if sensor.force_in is not None:
        forces = [f"links.{link.name}" for link in model.links] + [f"contacts.{contact.name}" for contact in model.contacts]
        forces += [f"drive.{drive.channel}" for drive in model.drives if drive.imposes is not None]
        if sensor.force_in not in forces:
            raise ModelError(f"{here} records the force in {sensor.force_in!r}, which does not exist; the rig has {forces}")
        if sensor.quantity not in ("force", "torque") or sensor.body or sensor.arms:
            raise ModelError(
                f'{here} records a force: give it force_in and quantity = "force" (or "torque"), no body and no arms'
            )
        return
    if not sensor.body:
        raise ModelError(f"{here} names no body; give the body whose motion it records, or force_in for a force")
    if sensor.quantity not in MOTION:
        raise ModelError(
            f"{here} records a {sensor.quantity}, which is not a motion of a body; give one of {', '.join(MOTION)}, or for a "
            "force force_in in place of body"
        )
    body = next((body for body in model.bodies if body.name == sensor.body), None)
    if sensor.quantity in ROTARY and not sensor.arms and body is not None and body.motion == "straight":
        raise ModelError(
            f"{here} records an {sensor.quantity} of body {body.name!r}, which moves straight; "
            'give that body motion = "rotation", or correct the quantity'
        )


def _driven(model: RigModel, names: list[str], drive: Drive) -> None:
    here = "the drive" if drive is model.drive else f"the drive {drive.channel!r}"
    _known(names, tuple(drive.pushes), here)
    if drive.factor == 0.0:
        raise ModelError(f"{here} has factor 0, so it drives nothing; give the force per unit of its channel")
    if drive.limit is not None and drive.limit <= 0.0:
        raise ModelError(f"{here} has limit {drive.limit:g}, so it drives nothing; give one above zero, or leave it out for none")
    _curved(f"the curve of {here}", drive.curve)
    if drive.lag < 0.0:
        raise ModelError(f"{here} has lag {drive.lag:g} s; give a time constant above zero, or zero for none")
    if drive.imposes is None:
        if not drive.pushes:
            raise ModelError(f"{here} pushes nothing; give pushes with a body, or imposes for a motion that is imposed")
        return
    if drive.imposes not in names:
        raise ModelError(f"{here} imposes the motion of body {drive.imposes!r}, which does not exist; the rig has {names}")
    if drive.pushes or drive.factor != 1.0 or not drive.acts_as_recorded:
        raise ModelError(f"{here} imposes a motion and has pushes, a factor, a curve, a limit or a lag as well; leave those out")
    if drive.quantity not in MOTION:
        raise ModelError(f"{here} imposes a motion, but its quantity is {drive.quantity}; give one of {', '.join(MOTION)}")
    if model.imposed.count(drive.imposes) > 1:
        raise ModelError(f"two drives impose the motion of body {drive.imposes!r}; leave one out")


def _uncertain(where: str, key: str, value: float, std: float) -> None:
    if not 0.0 <= std < abs(value):
        raise ModelError(
            f"{where} has {key}_std {std:g}; give the standard uncertainty of its {key} {value:g} in the same unit, from zero to "
            "less than that"
        )


def _curved(where: str, points: Sequence[tuple[float, float]]) -> None:
    if len(points) == 1 or not all(one[0] < other[0] for one, other in pairwise(points)):
        raise ModelError(f"{where} is not a curve; give at least two points with increasing true values")


def _chained(model: RigModel) -> None:
    drives, sensors = (
        [(part.channel, part.chain) for part in parts if part.chain != WITHOUT_FAULTS] for parts in (model.drives, model.sensors)
    )
    for _, chain in (*drives, *sensors):
        for key in ("corner", "cutoff"):
            if (value := getattr(chain, key)) < 0.0:
                raise ModelError(f"a chain's {key} is {value:g} Hz; give a frequency above zero, or zero for none")
        if len(chain.taps) % 2 == 0 and chain.taps:
            raise ModelError(f"a chain has {len(chain.taps)} taps; give an odd number, the middle one for the present sample")
        _curved("a chain's bend", chain.bend)
    if any(chain.bend or chain.taps or chain.corner or chain.cutoff for _, chain in drives):
        raise ModelError("the drive's chain has a bend, taps, a corner or a cutoff, which only a sensor's may have; remove them")
    for name, chain in (*drives, *sensors):
        if chain.gain == 0.0:
            raise ModelError(f"the chain of channel {name!r} has gain 0, which records nothing; give its gain, usually 1")


def _finite(part: Any, path: str = "") -> None:
    # Of a part in plain dicts, lists and numbers.
    if isinstance(part, float) and not isfinite(part):
        raise ModelError(f"{path} is {part:g}; give a finite number")
    if isinstance(part, list | tuple):
        part = {each.get("name", each.get("channel", k)) if isinstance(each, dict) else k: each for k, each in enumerate(part)}
    if isinstance(part, dict):
        for key, value in part.items():
            if type(value) is not float or not isfinite(value):
                _finite(value, f"{path}.{key}" if path else key)


def _grounded(names: list[str], joints: Sequence[Joint], imposed: Sequence[str]) -> None:
    held = {GROUND, *imposed}
    while grown := [joint.joined for joint in joints if joint.joined & held and not joint.joined <= held]:
        held |= set().union(*grown)
    for name in names:
        if name not in held:
            raise ModelError(
                f"body {name!r} floats: no link or contact joins it to the ground, directly or through others; "
                'add a link or contact, to "ground" at the last, or write free_free = true for a rig that floats'
            )


def given_rig(given: object) -> RigModel:
    """The same rig, if it is one. Raises ArgumentError if it is of another type."""
    return of_type(given, RigModel, "the rig", "an iso.Rig; give one, for example iso.read_rig(FILE).model")


def given_configuration(model: RigModel, given: object) -> str:
    """The name of a configuration; that of the rig's first one if None. Raises ArgumentError if it is no text."""
    first = next(iter(model.configurations))
    return first if given is None else text(given, "the configuration", first)


def _unique(names: list[str], kind: str) -> None:
    for name in names:
        if names.count(name) > 1:
            raise ModelError(f"the {kind} name {name!r} occurs {names.count(name)} times; give each a unique name")


def _known(names: list[str], used: tuple[str, ...], where: str) -> None:
    for name in used:
        if name != GROUND and name not in names:
            raise ModelError(
                f"{where} names body {name!r}, which does not exist{did_you_mean(name, names)}; the rig has {', '.join(names)}"
            )


# msgspec compiles the decoder of a type at first use, which crashes if two threads do so at once: done here, by one thread.
msgspec.json.Decoder(RigModel)
