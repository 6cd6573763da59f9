"""A link's force from the records: its free body, and a curve over the deflection from it by linear least squares.

The bodies beyond a link are connected by it only, so the link transmits F = push - sum of m a. A curve of F over the deflection,
the damping, the friction, and a drive factor or masses that are unknown too, follow at once, for any shape of the curve: no
local minimum can mislead. Noise biases such values; they are starting values for fits.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import MOTION, FloatArray, Run
from isorig.analysis.equations.forms import FACTOR
from isorig.analysis.lowpass import low_passed, signal_edge
from isorig.analysis.model.rig_model import GROUND, Link, RigModel, Sensor
from isorig.analysis.spectra.motion import acceleration_of, motion_of

#: Minimum number of samples per point of a curve, or per bin.
FEWEST = 30
#: Seconds at both ends of a record in which filters are not settled.
EDGE = 1.0


@dataclass(frozen=True, kw_only=True)
class LinkRecord:
    """Motion and free body of a link in a run; arrays of shape (samples,), without the record's edges."""

    #: Of its ends, m and m/s.
    deflection: FloatArray
    velocity: FloatArray
    push: FloatArray  #: The drive on the bodies beyond the link for a drive factor of one.
    acceleration: Mapping[str, FloatArray]  #: Of the bodies beyond the link by name, m/s^2.
    sign: float  #: 1 if these are at the link's first end, else -1: the link's force is sign * (factor * push - sum of m a), N.
    rate: float  #: Hz.
    corner: float  #: Corner frequency in Hz of the low-pass of all but the deflection, whose second derivative is noise above it.


@dataclass(frozen=True, kw_only=True)
class LinkForce:
    """A link's force from a record."""

    #: Its curve: deflections in m, and spring forces in N including the linear part, shape (points,).
    at: FloatArray
    values: FloatArray
    #: N s/m, and the mean force that reverses with the velocity in N.
    damping: float
    friction: float
    others: Mapping[str, float]  #: Drive factor and masses that were unknown, by path.


def link_record(model: RigModel, link: Link, run: Run) -> LinkRecord | None:
    """Motion and free body of a link; None if not all bodies beyond it are measured, or if something else acts on them."""
    sensors = [s for s in model.sensors if s.relative_to == GROUND and s.force_in is None and not s.arms]
    beyond = _outboard(model, link)
    ends = [end for end in (link.a, link.b) if end != GROUND]
    if not beyond or len(model.drives) > 1 or model.imposed or {*beyond, *ends} - {s.body for s in sensors}:
        return None
    if any((c.a in beyond) != (c.b in beyond) for c in model.contacts if c.name != link.name):
        return None

    def nearest(body: str, order: int) -> Sensor:
        return min((s for s in sensors if s.body == body), key=lambda s: abs(MOTION[s.quantity] - order))

    placed, accelerated = [nearest(end, 0) for end in ends], {name: nearest(name, 2) for name in beyond}
    used = {s.channel for s in (*placed, *accelerated.values()) if MOTION[s.quantity] != 2}
    rate = run.sample_rate
    corner = min((signal_edge(run.read(name), rate) for name in used), default=np.inf)
    pairs = [motion_of(run.read(s.channel), s.quantity, rate, run.band) for s in placed]
    v, d = (a - b for a, b in zip(*pairs, strict=True)) if len(pairs) == 2 else pairs[0]
    whole = slice(round(EDGE * rate), -round(EDGE * rate))
    share = sum(model.drive.pushes.get(name, 0.0) for name in beyond)
    acceleration = {
        name: low_passed(acceleration_of(run.read(s.channel), s.quantity, rate), rate, corner)[whole]
        for name, s in accelerated.items()
    }
    return LinkRecord(
        deflection=d[whole], velocity=low_passed(v, rate, corner)[whole],
        push=share * low_passed(run.read(model.drive.channel), rate, corner)[whole], acceleration=acceleration,
        sign=1.0 if link.a in beyond else -1.0, rate=rate, corner=corner,
    )  # fmt: skip


def link_force(model: RigModel, link: Link, run: Run, at: FloatArray) -> LinkForce | None:
    """A link's force from a record, with the curve at deflections `at` in m; None if the force is unknown.

    Least squares fit of the transmitted force: a damper, friction, and a piecewise linear function of the deflection, regularized
    where there are few samples; the drive factor and masses that are free are fitted along, if one of them is
    known and the accelerations were measured.
    """
    seen = link_record(model, link, run)
    # Two records of one motion leave their link without a deflection.
    if seen is None or len(seen.deflection) < FEWEST * len(at) or not np.any(seen.deflection):
        return None
    known = {"drive.factor": -seen.push} | {f"bodies.{name}.mass": values for name, values in seen.acceleration.items()}
    unknown = [path for path in known if path in model.free and np.any(known[path])]
    # Noise of differentiated displacements would make the masses too small.
    if np.isfinite(seen.corner) or all(path in unknown or not np.any(known[path]) for path in known):
        unknown = []
    found = _solved(model, seen, at, known, unknown)
    if any(not 1.0 / FACTOR < found.others[path] / model.get(path) < FACTOR for path in unknown):
        return _solved(model, seen, at, known, [])
    return found


def _solved(model: RigModel, seen: LinkRecord, at: FloatArray, terms: Mapping[str, FloatArray], unknown: list[str]) -> LinkForce:
    place = np.clip((seen.deflection - at[0]) / (at[1] - at[0]), 0.0, len(at) - 1.001)
    low, rows = place.astype(int), np.arange(len(place))
    hats = np.zeros((len(place), len(at)))
    hats[rows, low], hats[rows, low + 1] = 1.0 - (place - low), place - low
    others = [seen.sign * terms[path] for path in unknown]
    # The equation also holds for filtered terms, if all are filtered alike.
    laws = low_passed(np.column_stack([np.sign(seen.velocity), hats]), seen.rate, seen.corner)
    basis = np.column_stack([*others, seen.velocity, laws])
    force = -seen.sign * sum(model.get(path) * values for path, values in terms.items() if path not in unknown)
    second = np.diff(np.eye(len(at)), 2, axis=0) * np.sqrt(FEWEST)
    held = np.column_stack([np.zeros((len(second), basis.shape[1] - len(at))), second])
    solution = np.linalg.lstsq(np.vstack([basis, held]), np.concatenate([force, np.zeros(len(second))]), rcond=None)[0]
    first = len(unknown)
    return LinkForce(
        at=at, values=solution[first + 2 :], damping=float(solution[first]), friction=float(solution[first + 1]),
        others=dict(zip(unknown, solution[:first].tolist(), strict=True)),
    )  # fmt: skip


def _outboard(model: RigModel, link: Link) -> tuple[str, ...]:
    # The bodies connected by this link only; empty if another path leads from them to ground.
    joins = [(other.a, other.b) for other in model.links if other.name != link.name]
    reached = {GROUND}
    while True:
        grown = reached | {b for a, b in joins if a in reached} | {a for a, b in joins if b in reached}
        if grown == reached:
            break
        reached = grown
    if link.arms or (link.a in reached) == (link.b in reached):
        return ()
    return tuple(body.name for body in model.bodies if body.name not in reached)
