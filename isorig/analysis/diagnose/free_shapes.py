"""Free shapes: at a place, a curve determined by the data instead of the formula of a law.

A free shape shows that something of its kind is at its place, and no law of that kind can fit better there.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Literal

import msgspec
import numpy as np

from isorig.analysis import laws
from isorig.analysis.campaign import SI_UNIT, FloatArray
from isorig.analysis.diagnose.causes.at_contact import OFFSET
from isorig.analysis.diagnose.causes.base import Evidence, Kind, exchange
from isorig.analysis.diagnose.causes.coulomb_friction import SHARE_OF_PUSH
from isorig.analysis.diagnose.causes.measurement_chain import follows_command, with_chain, with_drive
from isorig.analysis.fitting.candidate import Candidate, Shape
from isorig.analysis.fitting.ladder import Rung, tried
from isorig.analysis.fitting.solve import Fit, Free
from isorig.analysis.laws.base import NO_LINK
from isorig.analysis.model.linear import floats
from isorig.analysis.model.rig_model import Link, RigModel, damps

#: Points of a curve over a two-sided range (odd, so that one is in the middle), over velocities, over a session, of a sensor's
#: static curve, and taps of its filter.
POINTS, LEVELS, MOMENTS, BENDS, TAPS = 15, 8, 5, 9, 5
#: Points of a drive's static curve on each side, as shares of its largest value: a dead band is at small ones.
DRIVEN = np.array([0.01, 0.03, 0.1, 0.25, 0.5, 0.75, 1.0])
#: Maximum points of a refined curve of force over deflection or velocity, and of friction, which has separate curves for the two
#: directions and whose simulation is slower the closer its points are.
FINEST_POINTS, FINEST_LEVELS = 57, 15
#: Points of a curve with starting values from a record.
RECORDED_POINTS = 45
#: A curve with a misfit above this, in allowed errors, is tried with more points, as long as that reduces it by this share.
FLAT, REFINES = 1.2, 0.15
#: Range of a curve, in multiples of the largest swing.
REACH = 1.05
#: Finite difference of a value, and allowed deviation of a point from its neighbours' mean (see `Free.give`), as shares of the
#: largest force there.
STEP, GIVE = 2e-4, 0.05
#: Displacements at which the sliders of a bundle slip, as shares of the largest swing.
YIELDS = (0.01, 0.05, 0.2, 0.6)
#: Friction if unknown, as a share of the link's largest force; for a link without a spring.
RUBS, ALONE = 0.02, 1.0
#: If friction is unknown, a second starting value is this many times larger: from little friction no gradient leads to sticking.
RUBS_MORE = 8.0
#: Velocity in m/s that represents the onset of sliding.
SLOWEST = 1e-9
#: Laws replaced by a curve over deflection or over velocity.
SPRINGS = (laws.Cubic, laws.BoundedSoftening, laws.Backlash, laws.EndStop)
DAMPERS = (laws.QuadraticDamping,)


def free_shapes(model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
    """Every free shape at every place of a rig without one of its kind there."""
    jobs = [(make, place) for kind, makers in AT_LINKS.items() for make in makers for place in _places(model, kind)]
    found = [make(model, evidence, place) for make, place in jobs]
    found += [make(model, evidence, sensor.channel) for make in (_bend, _taps) for sensor in model.sensors]
    found.append(_drive_curve(model, evidence))
    return tuple(shape for shape in found if shape is not None)


def _places(model: RigModel, kind: Kind) -> tuple[str, ...]:
    # At links with a spring, at those with sliding ends, or, of a force over deflection in a rig that no spring holds, at all.
    blocked = {name for configuration in model.configurations.values() for name in configuration.rigid}
    own = [link for link in model.links if not link.name.endswith("_added") and (kind != "damping_shape" or damps(model, link))]
    if kind == "drift" or (kind == "spring_shape" and not floats(model)):
        return tuple(link.name for link in own if link.stiffness > 0.0)
    if kind == "spring_shape":
        return tuple(link.name for link in own)
    return tuple(link.name for link in own if link.name in blocked or not blocked)


def _two_sided(reach: float, points: int = POINTS) -> FloatArray:
    return REACH * reach * np.linspace(-1.0, 1.0, points)


def _curve(
    model: RigModel,
    link: Link,
    over: Literal["deflection", "speed", "time"],
    at: FloatArray,
    replaced: tuple[type, ...],
    of: Literal["stiffness", "damping"] = "stiffness",
) -> tuple[RigModel, str] | None:
    # The rig with the laws of these types at a link replaced by an equivalent curve, and the curve's path.
    if any(isinstance(law, laws.Curve) and (law.over, law.of) == (over, of) for law in link.laws):
        return None
    kept = tuple(law for law in link.laws if not isinstance(law, replaced))
    still = np.zeros(len(at))
    d, v = (still, at) if over == "speed" else (at, still)
    gone = [law.force(d, v, still, still[None], model.constants_of(link)) for law in link.laws if isinstance(law, replaced)]
    values = np.sum([still, *gone], axis=0)
    curve = laws.Curve(over=over, at=tuple(at.tolist()), values=tuple(values.tolist()), of=of)
    free = tuple(path for path in model.free if not path.startswith(f"links.{link.name}.laws"))
    changed = msgspec.structs.replace(model, free=free, links=exchange(model.links, link.name, laws=(*kept, curve)))
    return changed, f"links.{link.name}.laws.{len(kept)}"


def _spring(model: RigModel, evidence: Evidence, place: str) -> Candidate | None:
    link, at = model.link(place), _two_sided(evidence.deflection[place])
    # The spring's linear part belongs to the curve; a constant force would only shift the equilibrium.
    scale = _scale(link, evidence)
    begun = _curve(model, link, "deflection", at, SPRINGS)
    return begun and _added_curve("spring_shape", place, *begun, at, scale, ("deflection", "m", "N"), "stiffness")


def _recorded_spring(model: RigModel, evidence: Evidence, place: str) -> Candidate | None:
    # The same with many points, starting from the recorded force: a force that rises and falls cannot be reached from a line.
    if place not in evidence.forces:
        return None
    link, at = model.link(place), _two_sided(evidence.deflection[place], RECORDED_POINTS)
    begun = _curve(model, link, "deflection", at, SPRINGS)
    if begun is None:
        return None
    start, path = begun
    force = evidence.forces[place]
    bent = np.interp(at, force.at, force.values - link.stiffness * force.at)
    values = {f"{path}.values.{k}": float(v) for k, v in enumerate(bent - bent[len(at) // 2])}
    damping = {f"links.{place}.damping": force.damping} if force.damping > 0.0 else {}
    start = start.replace({**values, **damping, **force.others})
    scale = _scale(link, evidence)
    return _added_curve("spring_shape", place, start, path, at, scale, ("deflection", "m", "N"), "stiffness")


def _damping(model: RigModel, evidence: Evidence, place: str) -> Candidate | None:
    link, at = model.link(place), _two_sided(evidence.speed[place])
    begun = _curve(model, link, "speed", at, DAMPERS)
    rubbing = max((_level(contact.law) for contact in model.contacts if contact.name == place), default=0.0)
    scale = max(link.damping * evidence.speed[place], rubbing, 1e-3 * _largest_force(link, evidence))
    return begun and _added_curve("damping_shape", place, *begun, at, scale, ("speed", "m/s", "N"), "damping")


def _damping_by_deflection(model: RigModel, evidence: Evidence, place: str) -> Candidate | None:
    link, at = model.link(place), _two_sided(evidence.deflection[place])
    begun = _curve(model, link, "deflection", at, (), "damping")
    scale, units = max(link.damping, 1e-3 * _largest_force(link, evidence) / evidence.speed[place]), ("deflection", "m", "N s/m")
    return begun and _added_curve("damping_shape", place, *begun, at, scale, units, "damping")


def _added_curve(
    kind: Kind, place: str, start: RigModel, path: str, at: FloatArray, scale: float, units: tuple[str, str, str], straight: str
) -> Candidate:
    first = Free(path="", low=-np.inf, log=False, step=STEP * scale, give=GIVE * scale)
    over, unit, value_unit = units
    free = _points(first, path, "values", len(at), len(at) // 2, straight=value_unit == "N")
    shape = Shape(over=over, unit=unit, value_unit=value_unit, path=path, tables=("values",))
    return Candidate(
        cause=kind, location=place, family=f"{kind} curve", starts=(start,), free=free, reported=(),
        dropped=(f"links.{place}.{straight}", f"links.{place}.laws"), rank=9, shape=shape,
    )  # fmt: skip


def _points(first: Free, path: str, table: str, count: int, middle: int, *, straight: bool) -> tuple[Free, ...]:
    """The points of a table as parameters like `first`, each coupled to its neighbour further from the middle.

    Without data, a force continues linearly (`straight`) through its fixed middle, and a level is constant.
    """

    def one(k: int) -> Free:
        inner = k - int(np.sign(k - middle))
        further = 2 * inner - k
        follows: tuple[tuple[int, float], ...]
        if not straight:
            follows = () if k == middle else ((inner, 1.0),)
        elif inner == middle:
            follows = ((further, -1.0),)
        else:
            follows = ((inner, 2.0), (further, -1.0))
        return replace(first, path=f"{path}.{table}.{k}", follows=tuple((f"{path}.{table}.{i}", w) for i, w in follows))

    return tuple(one(k) for k in range(count) if not straight or k != middle)


def _scale(link: Link, evidence: Evidence) -> float:
    # The spring's largest force, or the damper's of a link without a spring, N.
    return link.stiffness * evidence.deflection[link.name] or _largest_force(link, evidence)


def _largest_force(link: Link, evidence: Evidence) -> float:
    """Largest force of the link's spring or damper, N."""
    return max(link.stiffness * evidence.deflection[link.name], link.damping * evidence.speed[link.name], 1e-9)


def _level(law: laws.FrictionLaw) -> float:
    """A contact's typical sliding force, N."""
    if isinstance(law, laws.FrictionCurve):
        return float(np.mean(law.levels))
    if isinstance(law, laws.Asymmetric):
        return 0.5 * (law.forward_force + law.backward_force)
    return float(getattr(law, "friction_force", 0.0))


def _levels(law: laws.FrictionLaw, speed: FloatArray, way: float) -> FloatArray:
    # Force while sliding in one direction (1 or -1) at velocities >= 0 (m/s), N; for a law with memory, its typical force.
    if law.remembers:
        return np.full(len(speed), _level(law))
    still = np.zeros(len(speed))
    return way * law.force(still, way * np.maximum(speed, SLOWEST), still, still[None], NO_LINK)


def _rubbed(model: RigModel, evidence: Evidence, place: str, law: laws.FrictionLaw) -> tuple[RigModel, laws.FrictionLaw, float]:
    # The rig with another friction at a place, the previous friction, and its level in N.
    model = model.replace({OFFSET: evidence.described.get(OFFSET)})  # it may have absorbed a part of the friction
    link = model.link(place)
    old = next((contact.law for contact in model.contacts if contact.name == place), None)
    least = RUBS * _largest_force(link, evidence)
    if old is None:
        rubbed = msgspec.structs.replace(model, contacts=(*model.contacts, link.rubbing(law)))
        return rubbed, laws.Coulomb(friction_force=least), least
    free = tuple(path for path in model.free if not path.startswith(f"contacts.{place}.law"))
    changed = msgspec.structs.replace(model, contacts=exchange(model.contacts, place, law=law), free=free)
    return changed, old, max(_level(old), 1e-2 * least)


def _pushed(model: RigModel, evidence: Evidence, place: str) -> float:
    # Expected friction from the drive if it is unknown; 0 otherwise.
    return 0.0 if any(contact.name == place for contact in model.contacts) else SHARE_OF_PUSH * evidence.push


def _friction_by_speed(model: RigModel, evidence: Evidence, place: str) -> Candidate | None:
    # Points are closer at low velocity: there friction varies most.
    at = REACH * evidence.speed[place] * np.linspace(0.0, 1.0, LEVELS) ** 2
    flat = laws.FrictionCurve(over="speed", at=tuple(at.tolist()), levels=(0.0,) * LEVELS)
    start, old, level = _rubbed(model, evidence, place, flat)
    ways = (tuple(np.maximum(_levels(old, at, way), 1e-3 * level).tolist()) for way in (1.0, -1.0))
    return _friction(
        start, place, dict(zip(("levels", "backward"), ways, strict=True)), level, "speed", "m/s", _pushed(model, evidence, place)
    )


def _friction_by_position(model: RigModel, evidence: Evidence, place: str) -> Candidate | None:
    at = _two_sided(evidence.deflection[place])
    flat = laws.FrictionCurve(over="position", at=tuple(at.tolist()), levels=(0.0,) * len(at))
    start, _, level = _rubbed(model, evidence, place, flat)
    return _friction(start, place, {"levels": (level,) * len(at)}, level, "position", "m", _pushed(model, evidence, place))


def _friction_by_time(model: RigModel, evidence: Evidence, place: str) -> Candidate | None:
    if evidence.end_time <= 0.0:
        return None
    at = evidence.end_time * np.linspace(0.0, 1.0, MOMENTS)
    flat = laws.FrictionCurve(over="time", at=tuple(at.tolist()), levels=(0.0,) * len(at))
    start, _, level = _rubbed(model, evidence, place, flat)
    found = _friction(start, place, {"levels": (level,) * len(at)}, level, "time", "s", _pushed(model, evidence, place))
    return replace(found, cause="drift", family="drift curve")


def _friction(
    start: RigModel, place: str, tables: Mapping[str, tuple[float, ...]], level: float, over: str, unit: str, push: float
) -> Candidate:
    path = f"contacts.{place}.law"
    law = msgspec.structs.replace(start.contact(place).law, **tables)
    start = msgspec.structs.replace(start, contacts=exchange(start.contacts, place, law=law))
    first = Free(path="", low=0.0, high=max(50.0 * level, 5.0 * push), log=False, step=1e-3 * level, give=2.0 * GIVE * level)
    free = tuple(
        point
        for table, values in tables.items()
        for point in _points(first, path, table, len(values), len(values) // 2 if over == "position" else 0, straight=False)
    )
    shape = Shape(over=over, unit=unit, value_unit="N", path=path, tables=tuple(tables))
    more = max(RUBS_MORE, push / level)
    starts = (start, start.replace({point.path: more * start.get(point.path) for point in free})) if push else (start,)
    return Candidate(
        cause="friction_shape", location=place, family="friction_shape curve", starts=starts, free=free, reported=(),
        dropped=(path, OFFSET), rank=9, shape=shape,
    )  # fmt: skip


def _memory(model: RigModel, evidence: Evidence, place: str) -> Candidate | None:
    # Sliders with play and springs that slip one after another, in addition to the remaining friction there.
    link = model.link(place)
    if any(isinstance(law, laws.ElastoSlip) for law in link.laws):
        return None
    contact = next((contact for contact in model.contacts if contact.name == place), None)
    dahl = contact is not None and isinstance(contact.law, laws.Dahl)
    rubs = RUBS if link.stiffness > 0.0 else ALONE
    level = max(_level(contact.law) if contact is not None else 0.0, rubs * _largest_force(link, evidence))
    share, swing = level * (1.0 if dahl else 0.2) / len(YIELDS), evidence.deflection[place]
    row = tuple(laws.ElastoSlip(spring_stiffness=share / (give * swing), slip_force=share) for give in YIELDS)
    contacts, free = model.contacts, model.free
    if contact is not None:
        left = laws.Coulomb(friction_force=0.0 if dahl else 0.8 * level)
        contacts = exchange(contacts, place, law=left)
        free = tuple(path for path in free if not path.startswith(f"contacts.{place}.law"))
    start = msgspec.structs.replace(
        model, free=free, links=exchange(model.links, place, laws=(*link.laws, *row)), contacts=contacts
    )
    path = f"links.{place}.laws"
    own = [
        Free(path=f"{path}.{len(link.laws) + k}.{name}", low=1e-6 * value, high=1e4 * value)
        for k, law in enumerate(row)
        for name, value in (("spring_stiffness", law.spring_stiffness), ("slip_force", law.slip_force))
    ]
    own += [
        Free(path=f"{path}.{len(link.laws) + k}.clearance", high=swing, log=False, step=1e-3 * swing) for k in range(len(row))
    ]
    if contact is not None:
        own.append(Free(path=f"contacts.{place}.law.friction_force", high=50.0 * level, log=False, step=1e-3 * level))
    return Candidate(
        cause="memory", location=place, family="memory curve", starts=(start,), free=tuple(own), reported=(), rank=9,
        dropped=(f"contacts.{place}.law",), shape=Shape(over="", unit="m", value_unit="N", path=path, tables=()),
    )  # fmt: skip


def _drift_of(
    of: Literal["stiffness", "damping"], unit: str, law: type[laws.SpringLaw], model: RigModel, evidence: Evidence, place: str
) -> Candidate | None:
    link = model.link(place)
    constant = getattr(link, of)
    if evidence.end_time <= 0.0 or constant <= 0.0:
        return None
    at = evidence.end_time * np.linspace(0.0, 1.0, MOMENTS)
    begun = _curve(model, link, "time", at, (law,), of)
    if begun is None:
        return None
    start, path = begun
    free = tuple(
        Free(path=f"{path}.values.{k}", low=-0.95 * constant, log=False, step=1e-3 * constant) for k in range(1, len(at))
    )
    shape = Shape(over="time", unit="s", value_unit=unit, path=path, tables=("values",))
    # Where it takes the place of a law, the other laws have other places.
    dropped = (f"links.{place}.laws",) if any(isinstance(each, law) for each in link.laws) else ()
    return Candidate(
        cause="drift", location=place, family="drift curve", starts=(start,), free=free, reported=(), dropped=dropped, rank=9,
        shape=shape,
    )  # fmt: skip


def _bend(model: RigModel, evidence: Evidence, channel: str) -> Candidate | None:
    sensor, peak = model.sensor(channel), evidence.peak.get(channel, 0.0)
    if sensor.chain.bend or peak <= 0.0:
        return None
    flat = _flat(_two_sided(peak, BENDS))
    start, path = with_chain(model, channel, bend=flat), f"sensors.{channel}.chain"
    return _static_curve(start, channel, f"{path}.bend", flat, SI_UNIT[sensor.quantity], dropped=f"{path}.gain")


def _drive_curve(model: RigModel, evidence: Evidence) -> Candidate | None:
    drive, peak = model.drive, evidence.peak.get(model.drive.channel, 0.0)
    if not follows_command(model) or peak <= 0.0:
        return None
    flat = _flat(REACH * peak * np.array([*(-DRIVEN[::-1]), 0.0, *DRIVEN]))
    start = with_drive(model, curve=flat)
    return _static_curve(start, drive.channel, "drive.curve", flat, SI_UNIT[drive.quantity], dropped="drive.factor")


def _flat(at: FloatArray) -> tuple[tuple[float, float], ...]:
    return tuple((float(x), 0.0) for x in at)


def _static_curve(
    start: RigModel, channel: str, path: str, flat: tuple[tuple[float, float], ...], unit: str, dropped: str
) -> Candidate:
    # What is added to a channel's value; zero in the middle.
    points, peak = (k for k in range(len(flat)) if k != len(flat) // 2), flat[-1][0]
    return Candidate(
        cause="sensor", location=channel, family="sensor curve", starts=(start,), reported=(), rank=9, dropped=(dropped,),
        free=tuple(Free(path=f"{path}.{k}.1", low=-np.inf, log=False, step=1e-3 * peak) for k in points),
        shape=Shape(over="value", unit=unit, value_unit=unit, path=path, tables=()),
    )  # fmt: skip


def _taps(model: RigModel, evidence: Evidence, channel: str) -> Candidate | None:
    chain = model.sensor(channel).chain
    if chain.taps:
        return None
    middle = TAPS // 2
    taps = tuple(1.0 if k == middle else 0.0 for k in range(TAPS))
    start = with_chain(model, channel, taps=taps)
    path = f"sensors.{channel}.chain.taps"
    free = tuple(Free(path=f"{path}.{k}", low=-5.0, high=5.0, log=False, step=1e-3) for k in range(TAPS))
    return Candidate(
        cause="sensor", location=channel, family="sensor curve", starts=(start,), free=free, reported=(), rank=9,
        dropped=(f"sensors.{channel}.chain.gain",), shape=Shape(over="", unit="s", value_unit="1", path=path, tables=()),
    )  # fmt: skip


Maker = Callable[[RigModel, Evidence, str], Candidate | None]
AT_LINKS: Mapping[Kind, Sequence[Maker]] = {
    "spring_shape": (_spring, _recorded_spring),
    "damping_shape": (_damping, _damping_by_deflection),
    "friction_shape": (_friction_by_speed, _friction_by_position, _friction_by_time),
    "memory": (_memory,),
    "drift": (partial(_drift_of, "stiffness", "N/m", laws.Drift), partial(_drift_of, "damping", "N s/m", laws.DampingDrift)),
}


def with_more_points(candidate: Candidate, rough: Fit, rung: Rung) -> tuple[Candidate, Fit]:
    """A fitted curve with more points, as long as they improve the fit."""
    if rough.cost < FLAT:
        return candidate, rough
    while (denser := finer(candidate, rough.model)) is not None:
        kept = tuple(free for free in rough.free if all(free.path != own.path for own in candidate.free))
        done = tried(denser.starts[0], (*kept, *denser.free), rung)
        if done is None or done.cost > (1.0 - REFINES) * rough.cost:
            break
        candidate, rough = denser, done
    return candidate, rough


def finer(candidate: Candidate, fitted: RigModel) -> Candidate | None:
    """A free shape with twice as many intervals, started from a fitted one; None if it is fine enough or has no single curve."""
    shape = candidate.shape
    if shape is None or shape.over not in ("deflection", "speed", "position"):
        return None
    law = _at(fitted, shape.path)
    at, count = np.array(law.at), 2 * len(law.at) - 1
    if count > (FINEST_LEVELS if shape.over == "speed" and isinstance(law, laws.FrictionCurve) else FINEST_POINTS):
        return None
    from scipy.interpolate import CubicSpline

    places = np.interp(np.linspace(0, len(at) - 1, count), np.arange(len(at)), at)
    lowest = 0.0 if isinstance(law, laws.FrictionCurve) else -np.inf
    tables = {
        table: tuple(np.maximum(CubicSpline(at, getattr(law, table), bc_type="natural")(places), lowest).tolist())
        for table in shape.tables
    }
    denser = msgspec.structs.replace(law, at=tuple(places.tolist()), **tables)
    first = candidate.free[0]
    straight = isinstance(law, laws.Curve) and law.of != "damping"
    middle = count // 2 if shape.over in ("deflection", "position") or straight else 0
    free = tuple(point for table in shape.tables for point in _points(first, shape.path, table, count, middle, straight=straight))
    return replace(candidate, free=free, starts=(_exchanged(fitted, shape.path, denser),))


def _at(model: RigModel, path: str) -> laws.Curve | laws.FrictionCurve:
    group, name, _, *rest = path.split(".")
    law = model.link(name).laws[int(rest[0])] if group == "links" else model.contact(name).law
    assert isinstance(law, laws.Curve | laws.FrictionCurve)
    return law


def _exchanged(model: RigModel, path: str, law: laws.Curve | laws.FrictionCurve) -> RigModel:
    group, name, _, *rest = path.split(".")
    if group == "links":
        link, k = model.link(name), int(rest[0])
        changed = tuple(law if i == k else old for i, old in enumerate(link.laws))
        return msgspec.structs.replace(model, links=exchange(model.links, name, laws=changed), free=())
    return msgspec.structs.replace(model, contacts=exchange(model.contacts, name, law=law), free=())


def tabulated(
    model: RigModel, shape: Shape, evidence: Evidence
) -> tuple[tuple[float, ...], dict[str, tuple[float, ...]], float, tuple[float, float]]:
    """Points of a shape's curve in a model: positions, values by table (those of a damping include the link's own), the slope
    of the link's linear part, and the range of the runs."""
    law = _at(model, shape.path)
    place = shape.path.split(".")[1]
    straight, constant, swing = 0.0, 0.0, evidence.deflection.get(place, law.at[-1])
    if isinstance(law, laws.Curve) and shape.over != "time":
        link = model.link(place)
        if law.of == "damping":
            constant = link.damping
        else:
            straight = link.stiffness if shape.over == "deflection" else link.damping
    if shape.over == "time":
        reached = (0.0, evidence.end_time)
    else:
        most = evidence.speed.get(place, law.at[-1]) if shape.over == "speed" else swing
        reached = (-most, most)
    tables = {table: tuple(constant + value for value in getattr(law, table)) for table in shape.tables}
    return law.at, tables, straight, reached
