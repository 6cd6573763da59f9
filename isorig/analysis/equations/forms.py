"""Starting values from the equations: the rig's parameters, and those of a form from the recorded force of its element."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from isorig.analysis.campaign import BoolArray, FloatArray, IntArray
from isorig.analysis.equations.balances import Balance, Element
from isorig.analysis.equations.columns import DRY_FRICTION, PERIODIC, RARE_STOP, SHAPES, Shape, periodic
from isorig.analysis.equations.filters import resonator
from isorig.analysis.equations.known import law_columns
from isorig.analysis.equations.ranking import Explanation
from isorig.analysis.equations.sliding import Sliding, SlidingFit
from isorig.analysis.equations.system import CHANNEL_FAULTS, FRICTION_COLUMN, HOLDS, Equations, is_shaped
from isorig.analysis.equations.unknown_force import rest_of
from isorig.analysis.errors import ModelError
from isorig.analysis.fitting.solve import Free, base_parameters
from isorig.analysis.laws.base import NO_LINK, Law
from isorig.analysis.model.rig_model import RigModel

#: Largest ratio of a parameter from the equations to its given value, and its inverse: others are artefacts of a wrong equation.
FACTOR = 5.0
#: Share of the power of an element's force that a regression in the time domain leaves, from which on the spectra give the force,
#: if the equation holds in them. Chosen: half of its rms; a beam's flat modes left 0.8, other rigs up to 0.3.
HIDDEN = 0.25
#: Number of samples for the fit of a form.
MOST_SAMPLES = 3000
#: Weight of a curve point's distance from its neighbours' course, in its allowed deviations, relative to the rms of the force.
#: Chosen: a single sample outweighs it.
HELD = 0.02
#: Largest residual of a sample in such a fit, in rms of the force: larger ones have no square.
LARGEST = 1e6
#: Largest number of evaluations of such a fit, and the finite difference of its search coordinates.
EVALUATIONS, DIFFERENCE = 60, 1e-6


@dataclass(frozen=True, kw_only=True)
class RecordedMotion:
    """An element's deflection in m and velocity in m/s in a whole run, shape (samples,), and the indices of samples in use."""

    deflection: FloatArray
    velocity: FloatArray
    used: IntArray


@dataclass(frozen=True, kw_only=True)
class ElementForce:
    """The recorded force of an element and its motion, at samples of all runs; arrays of shape (n,)."""

    #: m, m/s, and seconds since the campaign's start.
    deflection: FloatArray
    velocity: FloatArray
    time: FloatArray
    force: FloatArray  #: N.
    left: FloatArray  #: What the regression with the free shape leaves of it, N.
    #: The whole runs, for laws with memory; their samples in use are those of the other arrays, in this order.
    motions: tuple[RecordedMotion, ...]
    rate: float  #: Sample rate of the motions, Hz.
    parallel: frozenset[str] = frozenset()  #: Names of the links between the same ends, whose force is in it.
    allowed: float = 0.0  #: What its noise and accuracy allow any form to leave, rms, N; 0 where it is not known.

    def until(self, share: float) -> BoolArray:
        """Whether each sample is in the first `share` of its run, shape (n,)."""
        return np.concatenate([motion.used < share * len(motion.deflection) for motion in self.motions])

    def part(self, kept: BoolArray) -> ElementForce:
        """The samples `kept`, shape (n,)."""
        ends = np.cumsum([len(motion.used) for motion in self.motions])[:-1]
        of_runs = zip(self.motions, np.split(kept, ends), strict=True)
        return replace(
            self, deflection=self.deflection[kept], velocity=self.velocity[kept], time=self.time[kept], force=self.force[kept],
            left=self.left[kept], motions=tuple(replace(motion, used=motion.used[here]) for motion, here in of_runs),
        )  # fmt: skip


class FormFit(NamedTuple):
    """A form fitted to a recorded force: its values by path, the rms force it leaves in N, and the deflections' offset in m."""

    values: dict[str, float]
    left: float
    offset: float


def shape_of(explanation: Explanation) -> Shape | None:
    """The free shape of an explanation; None if it is no shape at an element."""
    if explanation.what == PERIODIC:
        return periodic(explanation.values["pitch"])
    return next((shape for shape in (*SHAPES, RARE_STOP) if shape.name == explanation.what), None)


def element_force(
    equations: Equations, place: str, shape: Shape | None, scales: Mapping[str, float] | None = None
) -> ElementForce | None:  # fmt: skip
    """The recorded force of an element, with a free shape or the model's own laws; None if no equation contains it alone.

    Where a balance takes something as given for its scale, with that times its value in `scales`.
    """
    for balance in equations.balances:
        element = next((e for e, _ in balance.crossing if e.name == place), None)
        if element is None:
            continue
        # Undescribed dry friction shows while the element slides; through reversals, the low-pass spreads its force.
        found = equations.in_time(balance, element, sliding=True if shape is DRY_FRICTION else None)
        if found is not None and not found[0].through_reversals:
            size = abs(next(s for e, s in balance.crossing if e.name == element.name))
            scale = (scales or {}).get(balance.name, 1.0)
            force = _sliding_force(equations, balance, element, shape, size, *found)
            # An estimated force has no content where noise hides it, at low frequencies above all.
            hidden = equations.only is not None or np.mean(force.left**2) > HIDDEN * np.mean(force.force**2)
            spectral = balance.name in equations.prepared and element.link is not None and not law_columns(element)
            if shape is not None and hidden and spectral:
                force = _spectral_force(equations, balance, element, shape, force)
            return replace(force, force=scale * force.force, left=scale * force.left, allowed=abs(scale) * force.allowed)
    return None


def _spectral_force(
    equations: Equations, balance: Balance, element: Element, shape: Shape, in_time: ElementForce
) -> ElementForce:  # fmt: skip
    # The force of an element that noise hides `in_time` from the regression of the spectra, in which each frequency bin counts by
    # its noise. Each half of the segments gives one: samples have them in turn, and so the error of their mean as noise.
    prepared = equations.prepared[balance.name]
    columns = len(prepared.rows) - 1
    courses = [equations.course(run, element, balance) for run in prepared.runs]
    unknown = [path for path, _, _ in equations.unknown_rows(balance)]
    place, sign = next((k, sign) for k, (other, sign) in enumerate(balance.crossing) if other.name == element.name)
    before = [other for other, _ in balance.crossing[:place] if other.link is not None]
    own_values = slice(len(unknown) + sum(2 + law_columns(other) for other in before), None)

    def force(values: FloatArray) -> FloatArray:
        damping, stiffness, *_ = values[own_values]
        scale = _scale(dict(zip(unknown, values.tolist(), strict=False)))
        own = (damping * c.velocity + stiffness * c.deflection + shape.columns(c) @ values[columns:] / sign for c in courses)
        found = np.concatenate(list(own)) / scale
        return np.asarray(found - found.mean())  # spectra tell no constant

    solved = [equations.shaped(balance, element, shape, half) for half in (0, 1)]
    if solved[0].residual >= HOLDS:
        return in_time  # more than this shape is missing
    halves = np.stack([force(each.values) for each in solved])
    d = np.concatenate([course.deflection for course in courses])
    samples = _thinned(d)
    runs = np.concatenate([np.full(len(course.place), k) for k, course in enumerate(courses)])[samples]
    at = np.concatenate([course.place for course in courses])[samples]
    taken = halves[np.arange(len(samples)) % 2, samples]
    return replace(
        in_time, deflection=d[samples], velocity=np.concatenate([course.velocity for course in courses])[samples],
        time=np.concatenate([course.time for course in courses])[samples], force=taken,
        left=taken - halves.mean(axis=0)[samples], rate=equations.rate, allowed=0.0,
        motions=tuple(
            RecordedMotion(deflection=course.deflection, velocity=course.velocity, used=at[runs == k])
            for k, course in enumerate(courses)
        ),
    )  # fmt: skip


def _sliding_force(
    equations: Equations, balance: Balance, element: Element, shape: Shape | None, size: float, sliding: Sliding, base: SlidingFit
) -> ElementForce:  # fmt: skip
    state, fitted, columns = sliding.state(), base, equations.base_columns(element)
    if shape is not None:
        own = equations.own_frequency(element, balance)
        fitted = equations.slid(element, sliding, base, shape, own)
        sliding.restore(equations.slow_parts(sliding, shape))
        columns = equations.columns_with(element, sliding, shape, own)
    first = 3 + law_columns(element)
    unknown = [path for path, _, _ in equations.unknown_rows(balance)]
    size *= _scale(dict(zip(unknown, fitted.values[first:].tolist(), strict=False)))
    d, v, t, f, left, places = [], [], [], [], [], []
    for block in (sliding.active[k] for k in fitted.sound):
        place = block.first + block.used
        run = block.run
        places.append(np.stack([np.full(len(place), run.run), place]))
        matrix, _ = sliding.evaluated(block, columns)
        others = slice(first, first + run.fixed.shape[1])
        d.append((run.deflection + run.slow)[place])
        v.append((run.velocity + run.slow_velocity)[place])
        t.append(run.time[place])
        f.append(sliding.left(block, matrix[:, others], fitted.values[others]) / size)
        left.append(sliding.left(block, matrix, fitted.values) / size)
    sliding.restore(state)
    samples = _thinned(np.concatenate(d))
    runs, at = np.concatenate(places, axis=1)[:, samples]
    return ElementForce(
        deflection=np.concatenate(d)[samples], velocity=np.concatenate(v)[samples], time=np.concatenate(t)[samples],
        force=np.concatenate(f)[samples], left=np.concatenate(left)[samples], rate=sliding.rate,
        allowed=float(np.sqrt(sliding.allowed)) / abs(size),
        parallel=frozenset(other.name for other, _ in balance.crossing if other.link is not None and element.has_ends_of(other)),
        motions=tuple(
            RecordedMotion(deflection=run.deflection, velocity=run.velocity, used=at[runs == run.run]) for run in sliding.runs
        ),
    )  # fmt: skip


def _thinned(d: FloatArray) -> IntArray:
    # Indices of half of the samples evenly in time, half where the deflection is large: rare events decide.
    even = np.linspace(0, len(d) - 1, min(MOST_SAMPLES // 2, len(d))).astype(int)
    order = np.argsort(d)
    across = order[np.searchsorted(d[order], np.linspace(d.min(), d.max(), MOST_SAMPLES // 2)).clip(0, len(d) - 1)]
    return np.unique(np.concatenate([even, across]))


def fitted_form(
    model: RigModel, free: Sequence[Free], element: Element, force: ElementForce, *, robust: bool = True
) -> FormFit | None:
    """Parameters of an element's laws from its recorded force; None if none is free, or motion does not give its force.

    Integrated deflections have an unknown common offset, and accelerations no mean: an offset of the deflection and a constant
    force are fitted along, and the former is kept small where it makes no difference. Free parameters of the element, and of
    links between the same ends, are used. In a `robust` fit single samples far from the form count less, as the errors of a few
    blocks; not where rare events tell.
    """
    from scipy.optimize import least_squares

    names = element.names | force.parallel
    own = [f for f in free if any(f.path.startswith(f"{part}.{name}.") for part in ("links", "contacts") for name in names)]
    courses: dict[Law, FloatArray] = {}
    if not own:
        return None
    size = float(np.std(force.force)) or 1.0
    low = np.array([f.encode(f.low) if f.low > 0.0 or not f.log else -np.inf for f in own])
    high = np.array([f.encode(f.high) for f in own])

    @lru_cache(maxsize=1)  # least_squares asks for the derivatives where it has just asked for the residual
    def residual_at(place: bytes) -> FloatArray:
        coordinates = np.frombuffer(place)
        values = {f.path: f.decode(float(c)) for f, c in zip(own, coordinates, strict=False)}
        try:
            trial = model.replace(values)
        except ModelError:
            return np.full(len(force.force) + held_points + 1, 1e3)
        predicted = force_of(trial, element, force, swing * float(coordinates[-1]), courses)
        left = np.clip((predicted - force.force) / size, -LARGEST, LARGEST)
        # Points of a curve without samples follow their neighbours.
        values = {**given, **values}
        held = [(values[f.path] - sum(weight * values[path] for path, weight in f.follows)) / f.give for f in own if f.follows]
        return np.concatenate([left - left.mean(), HELD * np.array(held), coordinates[-1:]])

    def residual(coordinates: FloatArray) -> FloatArray:
        return residual_at(coordinates.tobytes())

    swing = float(np.abs(force.deflection).max())
    held_points = sum(bool(f.follows) for f in own)
    given = {path: model.get(path) for f in own for path, _ in f.follows}
    start = np.clip(np.array([f.encode(model.get(f.path)) for f in own]), low + 1e-9, high - 1e-9)
    start, low, high = np.append(start, 0.0), np.append(low, -1.0), np.append(high, 1.0)
    # The force is linear in the points of a curve.
    linear = {k for k, f in enumerate(own) if f.follows}
    known: dict[int, FloatArray] = {}

    def jacobian(coordinates: FloatArray) -> FloatArray:
        here = residual(coordinates)
        found = np.empty((len(here), len(coordinates)))
        for k in range(len(coordinates)):
            if k not in known or k not in linear:
                there = coordinates.copy()
                step = own[k].step if k in linear else DIFFERENCE * max(abs(float(there[k])), 1.0)
                there[k] += step if there[k] + step <= high[k] else -step
                known[k] = (residual(there) - here) / (there[k] - coordinates[k])
            found[:, k] = known[k]
        return found

    with suppress(ValueError):
        done = least_squares(
            residual, start, jac=jacobian, bounds=(low, high), x_scale="jac", max_nfev=EVALUATIONS,
            loss="soft_l1" if robust else "linear", f_scale=0.05,
        )  # fmt: skip
        values = {f.path: f.decode(float(c)) for f, c in zip(own, done.x, strict=False)}
        left = float(np.sqrt(np.mean(residual(done.x)[: len(force.force)] ** 2))) * size
        return FormFit(values=values, left=left, offset=swing * float(done.x[-1]))
    return None


def force_left(model: RigModel, element: Element, force: ElementForce, offset: float) -> float:
    """The rms force in N that a model's element leaves of the recorded one, without a constant, with an offset in m of the
    deflections."""
    return float(np.std(force.force - force_of(model, element, force, offset)))


def force_of(
    model: RigModel, element: Element, force: ElementForce, offset: float = 0.0,
    courses: dict[Law, FloatArray] | None = None,
) -> FloatArray:  # fmt: skip
    """The force in N that a model's element has along its recorded motion, with an offset in m of the deflections, shape (n,).

    `courses` keeps that of laws with memory, which depends on their own parameters only.
    """
    courses = {} if courses is None else courses
    d, v, t = force.deflection + offset, force.velocity, force.time
    total = np.zeros(len(d))
    links = [link for link in model.links if link.name in element.names | force.parallel]
    contact = next((contact for contact in model.contacts if contact.name in element.names), None)
    for link in links:
        total = total + link.stiffness * d + link.damping * v
    laws = [(law, model.constants_of(link)) for link in links for law in link.laws]
    for law, constants in laws + ([(contact.law, NO_LINK)] if contact is not None else []):
        if not law.remembers:
            total = total + law.force(d, v, t, np.zeros((1, len(d))), constants)
        else:
            if law not in courses:
                along = (law.along(run.deflection, run.velocity, force.rate, constants)[run.used] for run in force.motions)
                courses[law] = np.concatenate(list(along))
            total = total + courses[law]
    return total


def solved_values(equations: Equations, explanation: Explanation | None = None) -> dict[str, float]:
    """Values by path that the equations solve for, known or free, with an explanation's effect taken out.

    Stiffnesses and dampings of links, levels of contacts, free parameters; each from the equation with the fewest elements. With
    dry friction as the explanation, its level, too, at a contact with the name of its element.
    """
    found: dict[str, float] = {}
    bent = ""  # the stiffness that is part of a curve
    if explanation is not None and explanation.what == "force over deflection":
        bent = f"links.{explanation.place}.stiffness"
    scales = scales_of(equations, explanation)
    for balance in sorted(equations.balances, key=lambda b: len(b.crossing)):
        for path, scaled in _values_of(equations, balance, explanation).items():
            value = scales[balance.name] * scaled
            if path not in found and path != bent and value > 0.0 and _is_likely(equations, path, value):
                found[path] = value
    return found


def scales_of(equations: Equations, explanation: Explanation | None = None) -> dict[str, float]:
    """By balance, the likely value of what it takes as given for its scale (`Equations.assumed_scale`), over the given one.

    A stiffness or a mass that two balances share has one value: it gives the scale of one of them by that of the other. Balances
    without a connection to one of known scale keep what is given, as those of known scale do.
    """
    found = {balance.name: 1.0 for balance in equations.balances if not equations.assumed_scale(balance)}
    pending = [balance.name for balance in equations.balances if balance.name not in found]
    if not pending:
        return found
    values = {balance.name: _of_scale(equations, balance, explanation) for balance in equations.balances}
    known = {path: value for name in found for path, value in values[name].items()}
    while pending:
        name, shared = next(((n, p) for n in pending for p in values[n] if p in known), (pending[0], ""))
        ratio = known[shared] / values[name][shared] if shared else 1.0
        found[name] = ratio if _is_plausible(ratio) else 1.0
        known = {path: found[name] * value for path, value in values[name].items()} | known
        pending.remove(name)
    return found


def _of_scale(equations: Equations, balance: Balance, explanation: Explanation | None) -> dict[str, float]:
    # A balance's masses and stiffnesses by path, and what it takes as given for its scale; the stiffness at the place of an
    # explanation without this, for it may be part of a curve.
    solved, place = _values_of(equations, balance, explanation), explanation.place if explanation is not None else ""
    if any(place == element.name for element, _ in balance.crossing):
        solved |= {
            path: value for path, value in _values_of(equations, balance, None).items() if path == f"links.{place}.stiffness"
        }
    if assumed := equations.assumed_scale(balance):
        solved[assumed] = equations.model.get(assumed)
    kinds = ("mass", "stiffness", "factor")
    return {path: value for path, value in solved.items() if path.rpartition(".")[2] in kinds and value > 0.0}


def _is_likely(equations: Equations, path: str, value: float) -> bool:
    # Whether no artefact determines a value.
    if path.endswith(("damping", "friction_force")):
        return True
    given = equations.model.get(path)
    return given <= 0.0 or _is_plausible(value / given)


def _is_plausible(ratio: float) -> bool:
    # Whether a value from the equations, over its given one, may be true.
    return 1.0 / FACTOR < ratio < FACTOR


def lacks_inertia(equations: Equations) -> bool:
    """Whether an equation holds with a mass far from the described one: then a constant force, or none, explains its record."""
    return any(
        path.endswith(".mass") and not _is_likely(equations, path, value)
        for balance in equations.balances
        for path, value in _values_of(equations, balance, None).items()
    )


def start_values(equations: Equations, explanation: Explanation | None = None) -> dict[str, float]:
    """The rig's free parameters by path from the equations, with an explanation's effect taken out.

    Parameters that the equations do not determine, or only with an artefact, are left out; those that they take as given for
    their scale are in it.
    """
    model, scales = equations.model, scales_of(equations, explanation)
    found = {path: value for path, value in solved_values(equations, explanation).items() if path in model.free}
    for balance in equations.balances:
        if path := equations.assumed_scale(balance):
            found.setdefault(path, scales[balance.name] * model.get(path))
    if equations.only is not None:  # all records together tell more of the rest of the rig than each equation
        found |= rest_of(model, equations.only)
    return found


def fit_start(equations: Equations) -> RigModel:
    """The rig with the start values of its free parameters for a fit; as described where no equation holds sample by sample."""
    known = equations.prepared or equations.sliding
    return _with_laws(equations, equations.model.replace(start_values(equations))) if known else equations.model


def _with_laws(equations: Equations, model: RigModel) -> RigModel:
    # The values of described contacts from their recorded force: a simulation that sticks where the rig slips leads nowhere.
    free = base_parameters(model)
    for element in equations.elements():
        law = f"contacts.{element.contact.name}.law." if element.contact is not None else ""
        if not law or sum(f.path.startswith(law) for f in free) < 2:
            continue  # a level alone follows from the equation
        force = element_force(equations, element.name, DRY_FRICTION)
        solved = fitted_form(model, free, element, force) if force is not None else None
        if solved is not None:
            with suppress(ModelError):
                model = model.replace(solved.values)
    return model


def _values_of(equations: Equations, balance: Balance, explanation: Explanation | None) -> dict[str, float]:
    # The values of an equation's parameters by path.
    unknown = [path for path, _, _ in equations.unknown_rows(balance)]
    found: dict[str, float] = {}
    dry = explanation is not None and explanation.what == DRY_FRICTION.name
    rubbed = next((e for e, _ in balance.crossing if dry and explanation is not None and e.name == explanation.place), None)
    in_time = equations.in_time(balance, rubbed, sliding=True) if rubbed is not None else None
    if balance.name in equations.prepared and in_time is None:
        values = _solved(equations, balance, explanation)
        found |= zip(unknown, values.tolist(), strict=False)
        k = len(unknown)
        for element, _ in balance.crossing:
            if element.link is not None:
                found[f"links.{element.link.name}.damping"] = float(values[k])
                found[f"links.{element.link.name}.stiffness"] = float(values[k + 1])
                k += 2 + law_columns(element)
    elif balance.name in equations.sliding or in_time is not None:
        element = rubbed or equations.primary(balance)
        size = abs(next(s for e, s in balance.crossing if e.name == element.name))
        fit = in_time[1] if in_time is not None else _slid(equations, balance, element, explanation)
        values = fit.values
        if element.link is not None:
            found[f"links.{element.link.name}.stiffness"] = float(values[0]) / size
            found[f"links.{element.link.name}.damping"] = float(values[1]) / size
        if element.contact is not None and (level := getattr(element.contact.law, "friction_force", None)) is not None:
            own = level if is_shaped(element.contact.law) else 1.0  # the column is the law's force then
            found[f"contacts.{element.contact.name}.law.friction_force"] = own * float(values[FRICTION_COLUMN]) / size
        elif rubbed is not None:
            found[f"contacts.{rubbed.name}.law.friction_force"] = float(values[FRICTION_COLUMN]) / size
        paths = [path for path, _ in equations.fixed_rows(balance, element)]
        found |= zip(paths, values[3 + law_columns(element) :].tolist(), strict=False)
        found.pop("-", None)
    scale = _scale(found)
    if found.pop("", None) is None:
        return found
    return {path: value / scale for path, value in found.items()} | {"drive.factor": equations.model.drive.factor / scale}


def _scale(values: Mapping[str, float]) -> float:
    # An equation whose drive's factor is unknown is solved for the given factor and the scale of the given masses, which has no
    # path: its forces are those of the rig times this scale.
    scale = values.get("", 1.0)
    return scale if _is_plausible(scale) else 1.0


def _slid(equations: Equations, balance: Balance, element: Element, explanation: Explanation | None) -> SlidingFit:
    sliding, base = equations.sliding[balance.name]
    shape = shape_of(explanation) if explanation is not None else None
    if explanation is None or shape is None or explanation.place != element.name:
        return base
    return equations.slid(element, sliding, base, shape, equations.own_frequency(element, balance))


def _solved(equations: Equations, balance: Balance, explanation: Explanation | None) -> FloatArray:
    prepared = equations.prepared[balance.name]
    if explanation is None:
        return prepared.solved.values
    spectra = equations.spectra
    values: Mapping[str, float] = explanation.values
    if explanation.what in CHANNEL_FAULTS:
        source = explanation.source or None
        fault = equations.fault(explanation.what, explanation.place, np.array([values["value"]]), source)
        return prepared.without_fault(*fault)[0].values
    if explanation.what in ("mass", "resonator") and balance.weights.get(explanation.place) == 1.0:
        row, mass = equations.body_row(explanation.place), values["mass"]
        if explanation.what == "resonator":
            gain = resonator(spectra.omega, values["frequency"], values["damping"])
            return prepared.solve([{name: gain * weight for name, weight in row.items()}]).values
        if explanation.place not in equations.unknown_masses(balance):
            mass -= equations.model.body(explanation.place).mass
        return prepared.solve(known={name: -mass * weight for name, weight in row.items()}).values
    shape = shape_of(explanation)
    element = next((e for e, _ in balance.crossing if e.name == explanation.place), None)
    if shape is not None and element is not None:
        return equations.shaped(balance, element, shape).values
    return prepared.solved.values
