"""A step of a diagnosis: the selection of one cause among fitted candidates, and how it is reported."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.diagnose.causes import contains, supported
from isorig.analysis.diagnose.causes.base import Evidence, Kind
from isorig.analysis.diagnose.evidence import Sign
from isorig.analysis.diagnose.free_shapes import tabulated
from isorig.analysis.diagnose.kinds import OVER_VELOCITY, kind_of
from isorig.analysis.diagnose.policy import POLICY, form_stands, rivals_alike, wins
from isorig.analysis.errors import ModelError
from isorig.analysis.fitting.candidate import Candidate, Reported
from isorig.analysis.fitting.excess import excess, ratio, share_removed
from isorig.analysis.fitting.score import Score, confidence, margin_in_errors, units
from isorig.analysis.fitting.solve import Fit, Free
from isorig.analysis.model.parameter_units import unit_of
from isorig.analysis.model.rig_model import Contact, Link, RigModel
from isorig.analysis.wording import fall

#: Kinds of curves whose values are forces of either sign, and causes that differ by direction.
OF_BOTH_SIGNS = {"spring_shape", "damping_shape"}
UNEVEN = {cause for cause, _ in supported("uneven directions")}


@dataclass(frozen=True, kw_only=True)
class Rival:
    """Another candidate and its held-out error."""

    cause: str
    location: str
    holdout_error: float


@dataclass(frozen=True, kw_only=True)
class Curve:
    """The free shape of a step."""

    #: Its abscissa, the units of abscissa and values.
    over: str
    unit: str
    value_unit: str
    #: (position, value, standard deviation), ascending; negative velocities are those of the backward direction.
    points: tuple[tuple[float, float, float], ...]
    reached: tuple[float, float]  #: Lowest and highest position covered by the runs.
    paths: tuple[str, ...] = ()  #: Each point's path in the model.

    @property
    def of_damping(self) -> bool:
        """Whether the values are a damping, not a force."""
        return " s/" in self.value_unit

    @property
    def is_odd(self) -> bool:
        """Whether a force over deflection or velocity is as large in both directions, within its uncertainty."""
        x, y, std = np.array(self.points).T
        size = x[(x > 0.0) & (x <= -x[0])]
        (y, std), (other, its) = ([np.interp(at, x, each) for each in (y, std)] for at in (size, -size))
        return bool(np.all(np.abs(y + other) <= POLICY.zero * np.hypot(std, its)))

    def known(self, std: Mapping[str, float]) -> Curve:
        """The curve with the standard uncertainties of a fit, by path."""
        points = [(x, y, std.get(path, s)) for path, (x, y, s) in zip(self.paths, self.points, strict=True)]
        return replace(self, points=tuple(points)) if self.paths else self

    def moved(self, before: RigModel, after: RigModel) -> Curve:
        """The curve of one model with the values of another one, which has the same points."""
        points = [(x, y + after.get(path) - before.get(path), s) for path, (x, y, s) in zip(self.paths, self.points, strict=True)]
        return replace(self, points=tuple(points)) if self.paths else self


@dataclass(frozen=True, kw_only=True)
class Step:
    """An identified cause with its evidence.

    Parameters
    ----------
    cause, location
        Names of the findings' catalogue; the kind's name if no form fits.
    kind
        Its kind.
    form
        The catalogued cause, or None if none comes close to the free shape.
    closest
        The closest form and its share of the excess, if none is named and it is a main contributor (`Policy.main`).
    parameters
        (value, standard deviation, unit) by name.
    confidence
        Share of resampled held-out data in which it beats every rival.
    rivals
        The other fully fitted candidates, best first.
    indistinguishable
        Cause and location of rivals that the data cannot distinguish from it.
    evidence
        Sentences.
    before, after
        Held-out error without and with it.
    reported
        How its parameters follow from a model.
    curve
        The free shape, if no form is named.
    """

    cause: str
    location: str
    kind: Kind
    form: str | None
    closest: tuple[str, float] | None
    parameters: dict[str, tuple[float, float, str]]
    confidence: float
    rivals: tuple[Rival, ...]
    indistinguishable: tuple[tuple[str, str], ...]
    evidence: tuple[str, ...]
    before: float
    after: float
    reported: tuple[Reported, ...]
    curve: Curve | None = None


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A fully fitted candidate, its fit and its score."""

    candidate: Candidate
    fit: Fit
    score: Score

    @property
    def kind(self) -> Kind:
        """Its kind."""
        return kind_of(self.candidate.cause)

    @property
    def place(self) -> tuple[Kind, str]:
        """Kind and place."""
        return self.kind, self.candidate.location


@dataclass(frozen=True, kw_only=True)
class Found:
    """Result of a search for one step: the step, its entry, all entries, and the step that belongs to it.

    Two causes that only together explain the data are found at once: the second one is `then`. `shown` is whether the equations
    of motion show this kind and place, and no other.
    """

    step: Step
    entry: Entry
    entries: tuple[Entry, ...]
    then: Found | None = None
    shown: bool = False

    @property
    def shaped(self) -> bool:
        """Whether a free shape was fitted, the bound of what any law of its kind can explain."""
        return any(entry.candidate.shape is not None for entry in self.entries)


def best_form(forms: Sequence[Entry], now: Score, floors: FloatArray) -> Found:
    """The step to the form with the least error, or to the simplest of those that the data cannot distinguish from it."""
    entries = sorted(forms, key=lambda entry: float(np.mean(np.log(entry.score.blocks))))
    close = alike(entries, floors)
    # Of indistinguishable candidates, the simplest is used.
    carried = simplest(close)
    carried = determined(carried, [entry for entry in entries if entry.place == carried.place], floors)
    apart = [entry.score for entry in entries if all(entry is not other for other in close)]
    return found_step(carried, entries, now, _twins(carried, close), confidence(carried.score, apart))


def _twins(carried: Entry, close: Sequence[Entry]) -> set[tuple[str, str]]:
    # Of entries that the data cannot distinguish from one, those that are another cause and do not contain it.
    key = carried.candidate.key
    return {entry.candidate.key for entry in close if entry.candidate.key != key and not contains(entry.candidate.key, key)}


def alike(entries: Sequence[Entry], floors: FloatArray) -> list[Entry]:
    """The first of these entries, and those that the data cannot distinguish from it."""
    best, *others = entries

    def as_good(rival: Entry) -> bool:
        behind = margin_in_errors(best.score, rival.score)
        return rivals_alike(best.score.error, rival.score.error, floors, behind)

    return [best, *(entry for entry in others if as_good(entry))]


def simplest(entries: Sequence[Entry]) -> Entry:
    """Of indistinguishable entries the one of lowest rank, then with fewest parameters."""
    return min(entries, key=lambda entry: (entry.candidate.rank, len(entry.candidate.free)))


def determined(carried: Entry, mates: Sequence[Entry], floors: FloatArray) -> Entry:
    """The entry, or, if the data do not determine its values, the simplest of its kind and place that comes close to it."""
    if is_determined(carried):
        return carried
    simpler = [
        entry
        for entry in mates
        if len(entry.candidate.free) < len(carried.candidate.free) and is_determined(entry)
        if ratio(entry.score.error, carried.score.error, floors) < POLICY.form_close
    ]
    return simplest(simpler) if simpler else carried


def is_determined(entry: Entry) -> bool:
    """Whether the data determine a form's own values: each one's standard uncertainty is smaller than the value."""
    return all(_determined(entry))


def is_undetermined(entry: Entry) -> bool:
    """Whether the data determine none of a form's own values: each one's standard uncertainty is at least the value."""
    own = _determined(entry)
    return bool(own) and not any(own)


def _determined(entry: Entry) -> list[bool]:
    # Whether the data determine each of a form's own values that cannot be zero.
    own = [free.path for free in entry.candidate.free if free.log]
    return [entry.fit.std.get(path, 0.0) < abs(entry.fit.model.get(path)) for path in own]


def vanishes(entry: Entry) -> bool:
    """Whether a form has no effect that the data show: each of its own values is zero within its uncertainty."""

    def is_zero(free: Free) -> bool:
        value, std = entry.fit.model.get(free.path), entry.fit.std[free.path]
        return value < std if free.log else abs(value) <= POLICY.zero * std

    return bool(entry.candidate.free) and all(is_zero(free) for free in entry.candidate.free)


def without_form(step: Step, share: float) -> Step:
    """A step that names kind and place only: the form, which removes `share` of the excess error, may be merely the closest.

    Its values are then none of the rig's.
    """
    return replace(step, cause=step.kind, form=None, closest=(step.cause, share), parameters={}, reported=())


def best_kind(
    forms: Sequence[Entry], shapes: Sequence[Entry], now: Score, floors: FloatArray, evidence: Evidence
) -> Found | None:  # fmt: skip
    """The step to the kind and place with the least error, and to a form there if one comes close to the free shape."""
    entries = sorted((*forms, *shapes), key=lambda entry: excess(entry.score.error, floors))
    if not entries:
        return None
    ceilings: dict[tuple[Kind, str], Entry] = {}
    for entry in entries:
        ceilings.setdefault(entry.place, entry)
    best, *others = ceilings.values()
    sure = {other.place: wins(units(best.score), [units(other.score)]) for other in others}
    close = [
        best,
        *(
            other
            for other in others
            if sure[other.place] < POLICY.certain or ratio(other.score.error, best.score.error, floors) < POLICY.matters
        ),
    ]
    chosen = min(close, key=lambda entry: (len(entry.candidate.free), entry.candidate.rank))
    mates = [entry for entry in entries if entry.place == chosen.place and entry.candidate.shape is None]
    standing = [
        entry
        for entry in mates
        if chosen.candidate.shape is None or form_stands(now.error, chosen.score.error, entry.score.error, floors)
    ]
    apart = [units(other.score) for other in others if all(other is not entry for entry in close)]
    sureness = wins(units(chosen.score), apart)
    twins = {entry.candidate.key for entry in close if entry is not chosen and not _same_curve(entry, chosen)}
    if standing:
        same = alike(standing, floors)
        carried = min(same, key=lambda entry: (len(entry.candidate.free), entry.candidate.rank))
        carried = determined(carried, mates, floors)
        twins |= _twins(carried, same)
        # A form at another place that cannot be excluded stands for the free shape there.
        for other in close:
            form = next((e for e in entries if e.place == other.place and e.candidate.shape is None), None)
            if other is not chosen and form is not None and ratio(form.score.error, carried.score.error, floors) < POLICY.matters:
                twins = twins - {other.candidate.key} | {form.candidate.key}
        return found_step(carried, entries, now, twins, sureness)
    curve = curve_of(chosen.candidate, chosen.fit, evidence)
    odd = chosen.kind in OF_BOTH_SIGNS and curve is not None and curve.is_odd
    return found_step(chosen, entries, now, twins, sureness, _closest(mates, now, floors, odd=odd), curve)


def _closest(mates: Sequence[Entry], now: Score, floors: FloatArray, *, odd: bool) -> tuple[str, float] | None:
    # The form that leaves least, or the simplest of those that leave hardly more; an odd curve is close to no form that differs
    # by direction.
    shares = [(mate, share_removed(now.error, mate.score.error, floors)) for mate in mates]
    shares = [pair for pair in shares if pair[1] >= POLICY.main and not (odd and pair[0].candidate.cause in UNEVEN)]
    if not shares:
        return None
    best, _ = max(shares, key=lambda pair: pair[1])
    near = [pair for pair in shares if ratio(pair[0].score.error, best.score.error, floors) < POLICY.matters]
    form, share = min(near, key=lambda pair: (len(pair[0].candidate.free), -pair[1]))
    return form.candidate.cause, share


def _same_curve(shape: Entry, chosen: Entry) -> bool:
    # Whether a free shape over the velocity is between the same ends as a chosen cause over the velocity: it is no other cause.
    if shape.candidate.shape is None or not {shape.kind, chosen.kind} <= OVER_VELOCITY:
        return False
    parts: tuple[Link | Contact, ...] = (*chosen.fit.model.links, *chosen.fit.model.contacts)
    ends = {part.name: {part.a, part.b} for part in parts}
    return ends.get(shape.candidate.location) == ends.get(chosen.candidate.location)


def found_step(
    carried: Entry, entries: Sequence[Entry], now: Score, twins: set[tuple[str, str]], sure: float,
    closest: tuple[str, float] | None = None, curve: Curve | None = None,
) -> Found:  # fmt: skip
    """The step to a fitted candidate: `entries` are all that were fitted, `twins` those that the data cannot exclude."""
    candidate = carried.candidate
    twins = twins | ({candidate.twin} if candidate.twin else set())
    model = msgspec.structs.replace(carried.fit.model, free=tuple(free.path for free in carried.fit.free))
    carried = replace(carried, fit=replace(carried.fit, model=model))
    step = Step(
        cause=candidate.cause, location=candidate.location, kind=kind_of(candidate.cause),
        form=None if candidate.shape is not None else candidate.cause, closest=closest,
        parameters=_values(candidate.reported, carried.fit), confidence=sure,
        rivals=tuple(
            Rival(cause=e.candidate.cause, location=e.candidate.location, holdout_error=e.score.figure)
            for e in entries
            if e.candidate is not candidate
        ),
        indistinguishable=tuple(sorted(twins)),
        evidence=(_falls(candidate.cause, candidate.location, now.figure, carried.score.figure),),
        before=now.figure, after=carried.score.figure, reported=candidate.reported, curve=curve,
    )  # fmt: skip
    return Found(step=step, entry=carried, entries=tuple(entries))


def curve_of(candidate: Candidate, fitted: Fit, evidence: Evidence) -> Curve | None:
    """The curve of a fitted free shape including the link's linear part; None if the shape is not a single curve."""
    shape = candidate.shape
    if shape is None or not shape.tables:
        return None
    at, tables, straight, reached = tabulated(fitted.model, shape, evidence)
    std = fitted.std
    points: list[tuple[float, float, float]] = []
    paths: list[str] = []
    for table, values in tables.items():
        way = -1.0 if table == "backward" else 1.0
        for k, (x, v) in enumerate(zip(at, values, strict=True)):
            if way > 0.0 or x > 0.0:
                paths.append(f"{shape.path}.{table}.{k}")
                points.append((way * x, float(v + straight * x), std.get(paths[-1], 0.0)))
    order = sorted(range(len(points)), key=points.__getitem__)
    return Curve(
        over=shape.over, unit=shape.unit, value_unit=shape.value_unit, points=tuple(points[k] for k in order), reached=reached,
        paths=tuple(paths[k] for k in order),
    )  # fmt: skip


def _falls(cause: str, place: str, before: float, after: float) -> str:
    return f"With {cause} at {place} the held-out error {fall(before, after)}."


def rescored(step: Step, scores: tuple[float, float], models: tuple[RigModel, RigModel]) -> Step:
    """The step with other held-out errors without and with it, where a step before it is left out.

    Its curve moves with the values from the first of the models, with it before, to the second one, with it now.
    """
    _, *others = step.evidence
    return replace(
        step, before=scores[0], after=scores[1], evidence=(_falls(step.cause, step.location, *scores), *others),
        curve=step.curve and step.curve.moved(*models),
    )  # fmt: skip


def updated(step: Step, extended: Fit) -> Step:
    """The step with its parameters after later steps; a later step may have replaced them altogether."""
    try:
        curve = step.curve and step.curve.known(extended.std)
        return replace(step, parameters=_values(step.reported, extended), curve=curve)
    except ModelError:
        return step


def _values(reported: Sequence[Reported], fitted: Fit) -> dict[str, tuple[float, float, str]]:
    return {r.name: (r.of(fitted.model), _deviation(r, fitted), _unit(r, fitted.model)) for r in reported}


def _unit(reported: Reported, model: RigModel) -> str:
    # A law's parameter has another unit at a rotating part.
    plain = reported.value is None and unit_of(reported.path) == reported.unit
    return unit_of(reported.path, model) if plain else reported.unit


def _deviation(reported: Reported, fitted: Fit) -> float:
    if reported.value is None and reported.path in fitted.values:
        return fitted.std[reported.path]
    # First-order propagation through the formula of the reported value.
    middle = reported.of(fitted.model)
    slope = np.zeros(len(fitted.free))
    for k, free in enumerate(fitted.free):
        value = fitted.model.get(free.path)
        step = 1e-5 * abs(value) or 1e-9
        for way in (step, -step):  # on the other side if this one exceeds what physics allows
            with suppress(ModelError):
                slope[k] = (reported.of(fitted.model.replace({free.path: value + way})) - middle) / way
                break
    return fitted.deviation(slope)


def with_evidence(step: Step, said: Sequence[Sign]) -> Step:
    """The step with the evidence found in the records before it was fitted."""
    speaking = tuple(sign.text for sign in said if sign.supports(step.cause, step.location))
    return replace(step, evidence=(*step.evidence, *speaking))
