"""One step of a diagnosis: elimination of candidates on short data, full fits of the best, and selection of one or none."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial

import msgspec
import numpy as np

from isorig.analysis.campaign import Campaign, FloatArray
from isorig.analysis.diagnose.causes import CATALOGUE
from isorig.analysis.diagnose.causes.base import Evidence, Kind
from isorig.analysis.diagnose.evidence import Sign
from isorig.analysis.diagnose.free_shapes import free_shapes, tabulated
from isorig.analysis.diagnose.kinds import SHAPED, kind_of
from isorig.analysis.diagnose.observe import observe
from isorig.analysis.diagnose.pairs import Pair, pairs
from isorig.analysis.diagnose.places import Places, compared_places
from isorig.analysis.diagnose.policy import POLICY, form_stands, rivals_alike, wins
from isorig.analysis.diagnose.suspects import ALWAYS, Suspects, equations_of, suspects
from isorig.analysis.equations.system import HOLDS, Equations
from isorig.analysis.errors import FitError, ModelError, OutOfTimeError
from isorig.analysis.fitting.candidate import Candidate, Reported
from isorig.analysis.fitting.excess import excess, ratio, share_removed
from isorig.analysis.fitting.ladder import (
    BEHIND,
    CLOSE,
    FAR_WORSE,
    PROMISING,
    SCREENS,
    Race,
    Rung,
    Running,
    Starts,
    diverse,
    finished,
    horizon,
    ladder,
    race,
    starts_of,
    stays,
    tried,
    unrolled,
    verified,
    without,
)
from isorig.analysis.fitting.score import Score, adequate, confidence, margin_in_errors, score, units
from isorig.analysis.fitting.screen import Progress, Screen, ScreenedCandidate, shortened
from isorig.analysis.fitting.solve import Fit, Problem, fit
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.laws import FrictionCurve
from isorig.analysis.model.parameter_units import unit_of
from isorig.analysis.model.rig_model import RigModel

#: Number of candidates with a full fit, of free shapes, and of pairs of suspected causes.
FINALISTS, CURVES, PAIRS = 4, 3, 2
#: Share of the model's misfit on the last rung that candidates for a further step must remove. Chosen: half of what the step must
#: remove to count (`Policy.of_rest`).
PROMISING_LATER = 0.25
#: Kinds that simulations search for where the equations of motion show nothing. An equation in which a given mass is the only
#: scale holds with any value of it.
UNSEEN: frozenset[Kind] = frozenset({"friction_shape", "memory", "known_value"})


@dataclass(frozen=True, kw_only=True)
class Rival:
    """Another candidate and its held-out error."""

    cause: str
    location: str
    holdout_error: float


@dataclass(frozen=True, kw_only=True)
class Curve:
    """The free shape of a step.

    Parameters
    ----------
    over, unit, value_unit
        Its abscissa, the units of abscissa and values.
    points
        (position, value, standard deviation), ascending; negative velocities are those of the backward direction.
    reached
        Lowest and highest position covered by the runs.
    paths
        Each point's path in the model.
    """

    over: str
    unit: str
    value_unit: str
    points: tuple[tuple[float, float, float], ...]
    reached: tuple[float, float]
    paths: tuple[str, ...] = ()

    def known(self, std: Mapping[str, float]) -> Curve:
        """The curve with the standard uncertainties of a fit, by path."""
        points = [(x, y, std.get(path, s)) for path, (x, y, s) in zip(self.paths, self.points, strict=True)]
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
        The closest form and its share of the excess, if none is named.
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
    def level(self) -> float:
        """Typical sliding force of a fitted friction curve in N; 0 for others."""
        law = next((c.law for c in self.fit.model.contacts if c.name == self.candidate.location), None)
        return float(np.median(law.levels)) if isinstance(law, FrictionCurve) else 0.0

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


def next_step(
    campaign: Campaign,
    guesses: Sequence[RigModel],
    current: Fit,
    now: Score,
    equations: Equations,
    trials: Sequence[Trial],
    fine: Sequence[Trial],
    floors: FloatArray,
    progress: Progress,
    left: float = 1.0,
    steps: int = 1,
    forms_only: bool = False,
) -> Found | None:
    """The best cause for the remaining error of the current model; None if no candidate could be fitted.

    Catalogued forms are fitted first, then pairs of them. If neither makes the model adequate, free shapes are fitted at every
    place to determine place and kind; a form is then named only if it comes close to the free shape.

    Parameters
    ----------
    campaign, guesses
        The measurement, and the rig before any fit, the most trusted guess first.
    current, now
        The model to be extended and its score.
    equations
        The equations of motion of the records, for the current model.
    trials, fine
        The fit data, and the held-out data.
    floors
        The error allowed in each held-out run and channel, shape (runs, channels).
    progress
        Called with one line for each stage.
    left
        Share of the baseline's excess that the current model leaves. If it is small, a linear step predicts the effect of a
        candidate, and only promising ones are fitted.
    steps
        Maximum number of further steps.
    forms_only
        Whether to skip pairs and free shapes: they were fitted before, from a less accurate fit of the same model.
    """
    job = _Job(
        campaign=campaign, guesses=guesses, current=current, now=now, trials=trials, fine=fine, floors=floors, progress=progress,
        left=left, evidence=observe(campaign, current.model, trials, guesses[0]), seconds=horizon(current.model, trials),
    )  # fmt: skip
    progress("looking for the equations of motion that do not hold")
    # A rig that is judged by its drive is compared at each moment: there a search costs little, and finds smaller effects.
    by_drive = left < 1.0 and any(trial.motion for trial in trials)
    places = _possible_places(job, equations)
    found_by = None if by_drive or places else suspects(equations, further=left < 1.0)
    anywhere = left >= 1.0 or by_drive or not equations.residuals()
    # Where all equations hold, only a simulation shows what they leave out: effects of friction near reversals, scales.
    hold = equations.complete and max(equations.residuals().values(), default=0.0) < HOLDS
    kinds = UNSEEN if hold and not by_drive else None
    tries = _suspected(job, found_by) if found_by else _searched(job, kinds, places) if anywhere or places else None
    if tries is None:
        return None
    forms = _entries(tries.run.ranked[:FINALISTS], trials, fine, floors, progress)
    # What the equations hardly show may be what they do not see; what breaks an estimated motion may be beyond it.
    weak = found_by is not None and not found_by.ranking.broken and not any(adequate(entry.score, floors) for entry in forms)
    if anywhere and (weak or (equations.hidden and (found_by or places) and not _help(forms, now, floors))):
        unseen = _searched(job, kinds)
        if unseen is not None:
            tries, found_by = unseen, None
            forms = _better([*forms, *_entries(tries.run.ranked[:FINALISTS], trials, fine, floors, progress)], floors)
    # The error remaining after a form that removes nearly all is not due to another place or kind; another law of its own kind is
    # tested anyway.
    nearly = next((e for e in forms if share_removed(now.error, e.score.error, floors) > 1.0 - POLICY.settled), None)
    best_form = min(forms, key=lambda entry: excess(entry.score.error, floors), default=None)
    helps = _help(forms, now, floors)
    stands = (
        helps and found_by is not None and best_form is not None and found_by.stands(best_form.candidate, current, job.evidence)
    )
    alone = stands or any(adequate(entry.score, floors) for entry in forms) or (nearly is not None and nearly.kind not in SHAPED)
    shapes: list[Entry] = []
    try:
        if left >= POLICY.rest and not forms_only and not alone:
            if nearly is None and steps > 1 and (found_by is None or found_by.leaves_another(current, job.evidence)):
                progress("no form makes the model adequate; fitting pairs of forms")
                both = _together(tries.pairs(), forms, now, trials, fine, floors, progress)
                if both is not None:
                    return both
            progress("no forms make the model adequate; fitting free shapes")
            place, below = None, np.inf
            if nearly is not None:
                # A shape of its kind that is no better on the last rung leaves the form as close as it must come.
                place = nearly.place
                below = next(done.cost for c, done in tries.run.ranked if c is nearly.candidate) / POLICY.form_close**2
            shapes = _entries(contenders(tries.shapes(forms, place), tries.run, below), trials, fine, floors, progress)
            again = _again(tries.screened, forms, shapes, now, current, floors, job.rungs, progress)
            forms = _better([*forms, *_entries(again, trials, fine, floors, progress)], floors)
            if (shapes or nearly is None) and not any(adequate(entry.score, floors) for entry in forms):
                return _kind_and_form(job, tries, forms, shapes)
    except OutOfTimeError:
        if shapes:
            return _by_kind(forms, shapes, now, floors, job.evidence)
    if not forms:
        return None
    best = _by_form(sorted(forms, key=lambda entry: float(np.mean(np.log(entry.score.blocks)))), now, floors)
    return replace(best, shown=found_by is not None and found_by.shown(best.step.cause, best.step.location))


@dataclass(frozen=True, kw_only=True)
class _Job:
    # What a search for a step is about.
    campaign: Campaign
    guesses: Sequence[RigModel]
    current: Fit
    now: Score
    trials: Sequence[Trial]
    fine: Sequence[Trial]
    floors: FloatArray
    progress: Progress
    left: float
    evidence: Evidence
    seconds: float

    @cached_property
    def rungs(self) -> tuple[Rung, ...]:
        # If a shorter interval shows the misfit too, fits may approach on that.
        return ladder(self.trials, 0.0 if self.seconds < SCREENS[-1] else self.seconds)

    @property
    def promising(self) -> float:
        return PROMISING if self.left >= 1.0 else PROMISING_LATER


@dataclass(frozen=True, kw_only=True)
class _Tries:
    # Fitted forms, the causes and places that were considered, and how pairs of forms and the free shapes are found.
    run: Race
    screened: Sequence[ScreenedCandidate]
    known: frozenset[tuple[str, str]]
    pairs: Callable[[], list[Pair]]
    shapes: Callable[[Sequence[Entry], tuple[Kind, str] | None], Running]


def _possible_places(job: _Job, equations: Equations) -> Places | None:
    # Where bodies have no sensors, the misfit of all records tells more about the place than equations that rest on estimates.
    places = compared_places(job.current.model, job.trials) if equations.hidden else None
    if places is None or not places.possible:
        return None
    job.progress("the misfit can come from " + ", ".join(sorted(places.possible)))
    return places


def _searched(job: _Job, kinds: Collection[Kind] | None, places: Places | None = None) -> _Tries | None:
    """All candidates of some kinds (None: all) at some places (None: all): the equations of motion show nothing."""

    def sought(candidate: Candidate) -> bool:
        return (kinds is None or kind_of(candidate.cause) in kinds) and (places is None or places.includes(candidate.location))

    problem = Problem(shortened(job.trials, job.seconds))
    glance = fit(job.current.model, job.current.free, problem, iterations=3, tolerance=CLOSE)
    proposed = (c for cause in CATALOGUE for c in cause.candidates(glance.model, job.evidence))
    candidates = [c for c in proposed if sought(c) or c.cause in ALWAYS]
    screened = Screen(glance, problem).ranked(candidates)
    if screened:
        job.progress("most promising: " + ", ".join(f"{x.candidate.cause} ({x.candidate.location})" for x in screened[:3]))
    if job.left < POLICY.rest and not (screened and screened[0].cost < (1.0 - POLICY.worth) * glance.cost):
        return None
    starts = starts_of(diverse(screened), job.current, job.guesses, job.rungs[0])
    run = race(starts, job.rungs, job.current, job.progress, job.promising)

    def found_pairs() -> list[Pair]:
        if kinds is not None:
            return []
        seen = partial(observe, job.campaign, trials=job.trials, guess=job.guesses[0])
        return pairs(run, job.rungs, seen, job.progress)

    def shapes(forms: Sequence[Entry], place: tuple[Kind, str] | None) -> Running:
        starts = _shape_starts(forms, job.current, job.evidence, place)
        starts = [start for start in starts if sought(start[0])]
        return race(starts, job.rungs, job.current, job.progress, job.promising).ranked

    known = frozenset(item.candidate.key for item in screened)
    return _Tries(run=run, screened=screened, known=known, pairs=found_pairs, shapes=shapes)


def _suspected(job: _Job, found_by: Suspects) -> _Tries:
    """The candidates that the equations of motion point to, started from them."""
    job.progress("suspected: " + ", ".join(f"{x.kind} ({x.place}, {x.what}, score {x.score:.2f})" for x in found_by.chosen))
    begun = _started(found_by.candidates(job.current, job.evidence), found_by, job.current)

    def fitted(starts: Starts) -> Race:
        run = verified(starts, job.rungs[-1], job.progress)
        # A further cause that the equations give values for is close from the start, or it is none.
        if job.left < 1.0 or stays(run, job.current, job.rungs[-1]):
            return run
        return race(starts, job.rungs, job.current, job.progress, job.promising)

    def shapes(forms: Sequence[Entry], place: tuple[Kind, str] | None) -> Running:
        suspected = found_by.shapes(job.current, job.evidence)
        keys = {(shape.key, shape.shape, len(shape.free)) for shape in suspected}
        from_forms = [
            start
            for start in _shape_starts(forms, job.current, job.evidence, place)
            if (start[0].key, start[0].shape, len(start[0].free)) in keys
            and all(start[2] is not model for model in start[0].starts)
        ]
        return fitted([*_started(suspected, found_by, job.current), *from_forms]).ranked

    considered = (c for cause in CATALOGUE for c in cause.candidates(job.current.model, job.evidence))
    return _Tries(
        run=fitted(begun), screened=(), known=frozenset(c.key for c in considered),
        pairs=lambda: _suspected_pairs(job, begun), shapes=shapes,
    )  # fmt: skip


def _kind_and_form(job: _Job, tries: _Tries, forms: Sequence[Entry], shapes: Sequence[Entry]) -> Found | None:
    """The best kind and place, after forms that extend those there were fitted too; the best form if one is adequate."""
    named = _by_kind(forms, shapes, job.now, job.floors, job.evidence)
    place = named.entry.place if named is not None and named.step.form is None else None
    more = _extended(place, forms, tries.known, job.current, job.evidence, job.rungs, job.progress)
    forms = _better([*forms, *_entries(more, job.trials, job.fine, job.floors, job.progress)], job.floors)
    if any(adequate(entry.score, job.floors) for entry in forms):
        return _by_form(sorted(forms, key=lambda entry: float(np.mean(np.log(entry.score.blocks)))), job.now, job.floors)
    return _by_kind(forms, shapes, job.now, job.floors, job.evidence) if more else named


def _started(candidates: Sequence[Candidate], found_by: Suspects, current: Fit) -> Starts:
    """Starting points of suspected candidates, from the equations."""
    return [
        (candidate, candidate.parameters(current.model, current.free), model)
        for candidate in candidates
        for model in found_by.started(candidate, current.free)
    ]


def _suspected_pairs(job: _Job, begun: Starts) -> list[Pair]:
    """Pairs of forms that stay with the data: each suspected one at its starting values, and what the equations point to then."""
    found: list[Pair] = []
    for first, free, model in unlike(begun)[:PAIRS]:
        own = {f.path for f in first.free}
        then = suspects(equations_of(job.campaign, model), further=True)
        if then is None:
            continue
        extended = replace(job.current, model=model, free=free)
        candidates = [c for c in then.candidates(extended, job.evidence) if c.key != first.key and c.cause not in ALWAYS]
        starts = [
            (second, paths, start)
            for second, paths, start in _started(candidates, then, extended)
            if own <= {f.path for f in paths}
        ]
        run = verified(starts, job.rungs[-1], job.progress) if starts else Race(ranked=[], telling=())
        alone = tried(model, free, job.rungs[-1])
        if run.ranked and alone is not None and stays(run, job.current, job.rungs[-1]):
            second, both = run.ranked[0]
            found.append(Pair(first=first, second=second, alone=alone, fit=both))
    return sorted(found, key=lambda pair: pair.fit.cost)[:PAIRS]


def unlike(begun: Starts) -> Starts:
    """The first starting point of each cause and place."""
    return [start for k, start in enumerate(begun) if all(start[0].key != other.key for other, _, _ in begun[:k])]


def _help(entries: Sequence[Entry], now: Score, floors: FloatArray) -> bool:
    # Whether one removes as much as no other single cause can then.
    return any(share_removed(now.error, entry.score.error, floors) >= POLICY.contributes for entry in entries)


def _entries(
    ranked: Sequence[tuple[Candidate, Fit]], trials: Sequence[Trial], fine: Sequence[Trial], floors: FloatArray,
    progress: Progress,
) -> list[Entry]:  # fmt: skip
    entries: list[Entry] = []
    for candidate, rough in ranked:
        lost = bool(entries) and rough.cost > BEHIND * ranked[0][1].cost
        if lost and len(entries) > 1:
            break
        # One with a much larger error is no contender: its rough fit serves to show by how much. One that predicts the held-out
        # data to the noise needs no more data.
        entry = Entry(candidate=candidate, fit=rough, score=score(rough.model, fine))
        try:
            if not (lost or adequate(entry.score, floors)):
                done = unrolled(rough, trials) if candidate.shape else finished(rough, trials)
                entry = replace(entry, fit=done, score=score(done.model, fine))
        except FitError:  # it fits the first seconds only
            continue
        except OutOfTimeError:
            if entries:
                break
        entries.append(entry)
        progress(f"{candidate.cause} ({candidate.location}): held-out error {entry.score.figure:.3g}")
    return entries


def _shape_starts(
    forms: Sequence[Entry], current: Fit, evidence: Evidence, only: tuple[Kind, str] | None = None
) -> Starts:  # fmt: skip
    """Starting points of all free shapes, or of those of one kind and place."""
    begun: Starts = []
    for shape in free_shapes(current.model, evidence):
        if only not in (None, (kind_of(shape.cause), shape.location)):
            continue
        free = shape.parameters(current.model, current.free)
        begun += [(shape, free, start) for start in shape.starts]
        # A shape continues from the best form of its kind.
        for entry in forms:
            if entry.place == (kind_of(shape.cause), shape.location):
                begun += [
                    (shape, free, start)
                    for other in free_shapes(entry.fit.model, evidence)
                    if other.key == shape.key and other.shape == shape.shape and _paths(other) == _paths(shape)
                    for start in other.starts
                ]
                break
    return begun


def _paths(candidate: Candidate) -> list[str]:
    # Beside a form that the shape does not replace, its parameters have other places in the rig.
    return [free.path for free in candidate.free]


def contenders(ranked: Running, run: Race, below: float) -> Running:
    """The free shapes to be finished, judged by their misfit on the last rung.

    A shape whose misfit is above `below` is none. Neither is one that is far worse than the best shape or form, nor one that is
    hardly better than a form of its kind at its place: that form stands (`Policy.form_alike`).
    """
    costs: dict[tuple[Kind, str], float] = {}
    for candidate, rough in run.ranked:
        costs.setdefault((kind_of(candidate.cause), candidate.location), rough.cost)
    best = min((rough.cost for _, rough in (*ranked, *run.ranked)), default=np.inf)
    chosen: Running = []
    for candidate, rough in ranked:
        own = costs.get((kind_of(candidate.cause), candidate.location), np.inf) / POLICY.form_alike**2
        if rough.cost < min(FAR_WORSE * best, below, own) and all(candidate.key != other.key for other, _ in chosen):
            chosen.append((candidate, rough))
    return chosen[:CURVES]


def _again(
    screened: Sequence[ScreenedCandidate],
    forms: Sequence[Entry],
    shapes: Sequence[Entry],
    now: Score,
    current: Fit,
    floors: FloatArray,
    rungs: Sequence[Rung],
    progress: Progress,
) -> list[tuple[Candidate, Fit]]:
    """Forms of the best free shape's kind and place again, starting from the other parameters of its fit.

    If the missing effect has biased the whole fit, a form may not converge; a curve does, because it is linear in its values.
    None if one of them already comes close to the shape.
    """
    best = min(shapes, key=lambda entry: excess(entry.score.error, floors), default=None)
    if best is None:
        return []
    mates = (form for form in forms if form.place == best.place)
    if any(form_stands(now.error, best.score.error, form.score.error, floors) for form in mates):
        return []
    led = {path: value for path, value in best.fit.values.items() if path in {free.path for free in current.free}}
    starts: Starts = []
    for item in screened:
        candidate = item.candidate
        if (kind_of(candidate.cause), candidate.location) == best.place:
            free = candidate.parameters(current.model, current.free)
            own = {f.path for f in candidate.free}
            values = {f.path: led[f.path] for f in free if f.path in led and f.path not in own}
            values |= {path: level for path in own if path.endswith("friction_force") and (level := best.level)}
            for model in (*item.models, *candidate.starts):
                with suppress(ModelError):
                    starts.append((candidate, free, model.replace(values)))
    return race(starts, rungs, current, progress).ranked


def _extended(
    place: tuple[Kind, str] | None, forms: Sequence[Entry], known: Collection[tuple[str, str]], current: Fit,
    evidence: Evidence, rungs: Sequence[Rung], progress: Progress,
) -> list[tuple[Candidate, Fit]]:  # fmt: skip
    """Forms of a kind and place that extend one of the `forms` there; none if no place is given.

    A rig whose baseline has no friction has no Stribeck friction to try before it has some.
    """
    starts: Starts = []
    for entry in (entry for entry in forms if entry.place == place):
        model = msgspec.structs.replace(entry.fit.model, free=tuple(free.path for free in entry.fit.free))
        for candidate in (c for cause in CATALOGUE for c in cause.candidates(model, evidence)):
            if (kind_of(candidate.cause), candidate.location) == place and candidate.key not in known:
                free = candidate.parameters(model, entry.fit.free)
                starts += [(candidate, free, start) for start in candidate.starts]
    return race(starts, rungs, current, progress).ranked if starts else []


def _together(
    found: Sequence[Pair], forms: Sequence[Entry], now: Score, trials: Sequence[Trial], fine: Sequence[Trial],
    floors: FloatArray, progress: Progress,
) -> Found | None:  # fmt: skip
    """The best pair of forms that makes the model adequate, as two steps; None if there is none."""
    done: list[tuple[Pair, Entry]] = []
    for pair in found:
        with suppress(FitError):
            both = finished(pair.fit, trials)
            entry = Entry(candidate=pair.second, fit=both, score=score(both.model, fine))
            progress(f"{' and '.join(' at '.join(key) for key in sorted(pair.keys))}: held-out error {entry.score.figure:.3g}")
            if adequate(entry.score, floors):
                done.append((pair, entry))
    if not done:
        return None
    pair, last = min(done, key=lambda other: (other[0].first.rank + other[0].second.rank, len(other[1].fit.free)))
    alone = without(last.fit, pair.alone, trials)
    first = Entry(candidate=pair.first, fit=alone, score=score(alone.model, fine))
    of_first = {key for other, _ in done if pair.first.key not in other.keys for key in other.keys - pair.keys}
    of_last = {key for other, _ in done if pair.second.key not in other.keys for key in other.keys - pair.keys}
    sure = confidence(last.score, [entry.score for entry in (*forms, first)])
    then = _found(last, [last], first.score, of_last, sure, None, None)
    return replace(_found(first, [*forms, first], now, of_first, sure, None, None), then=then)


def _better(entries: Sequence[Entry], floors: FloatArray) -> list[Entry]:
    # Of two fits of one candidate the better.
    best: dict[tuple[str, str], Entry] = {}
    for entry in sorted(entries, key=lambda entry: excess(entry.score.error, floors)):
        best.setdefault(entry.candidate.key, entry)
    return list(best.values())


def _by_form(entries: Sequence[Entry], now: Score, floors: FloatArray) -> Found:
    best = entries[0]

    def alike(rival: Entry) -> bool:
        behind = margin_in_errors(best.score, rival.score)
        return rivals_alike(best.score.error, rival.score.error, floors, behind)

    close = [entry for entry in entries if entry is best or alike(entry)]
    # Of indistinguishable candidates, the simplest is used.
    carried = simplest(close)
    apart = [entry.score for entry in entries if all(entry is not other for other in close)]
    twins = {entry.candidate.key for entry in close if entry is not carried}
    return _found(carried, entries, now, twins, confidence(carried.score, apart), None, None)


def simplest(entries: Sequence[Entry]) -> Entry:
    """Of indistinguishable entries the one of lowest rank, then with fewest parameters."""
    return min(entries, key=lambda entry: (entry.candidate.rank, len(entry.candidate.free)))


def without_form(found: Found, share: float) -> tuple[Step, Found]:
    """A step that names kind and place only: the form, which removes `share` of the excess error, may be merely the closest."""
    step = replace(found.step, cause=found.step.kind, form=None, closest=(found.step.cause, share))
    return step, replace(found, step=step)


def _by_kind(forms: Sequence[Entry], shapes: Sequence[Entry], now: Score, floors: FloatArray, evidence: Evidence) -> Found | None:
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
    chosen = min(close, key=lambda entry: len(entry.candidate.free))
    mates = [entry for entry in entries if entry.place == chosen.place and entry.candidate.shape is None]
    standing = [
        entry
        for entry in mates
        if chosen.candidate.shape is None or form_stands(now.error, chosen.score.error, entry.score.error, floors)
    ]
    apart = [units(other.score) for other in others if all(other is not entry for entry in close)]
    sureness = wins(units(chosen.score), apart)
    twins = {(entry.candidate.cause, entry.candidate.location) for entry in close if entry is not chosen}
    if standing:
        carried = min(
            (e for e in standing if ratio(e.score.error, standing[0].score.error, floors) < POLICY.matters),
            key=lambda entry: (len(entry.candidate.free), entry.candidate.rank),
        )
        # A form at another place that cannot be excluded stands for the free shape there.
        for other in close:
            form = next((e for e in entries if e.place == other.place and e.candidate.shape is None), None)
            if other is not chosen and form is not None and ratio(form.score.error, carried.score.error, floors) < POLICY.matters:
                twins = twins - {other.candidate.key} | {form.candidate.key}
        return _found(carried, entries, now, twins, sureness, None, None)
    closest = (mates[0].candidate.cause, share_removed(now.error, mates[0].score.error, floors)) if mates else None
    return _found(chosen, entries, now, twins, sureness, closest, curve_of(chosen.candidate, chosen.fit, evidence))


def _found(
    carried: Entry, entries: Sequence[Entry], now: Score, twins: set[tuple[str, str]], sure: float,
    closest: tuple[str, float] | None, curve: Curve | None,
) -> Found:  # fmt: skip
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
        evidence=(
            f"With {candidate.cause} at {candidate.location} the held-out error falls from {now.figure:.3g} to "
            f"{carried.score.figure:.3g}.",
        ),
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
