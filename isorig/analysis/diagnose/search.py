"""The search for one cause: candidates from the equations of motion or from the misfit, verified by simulation.

`sources` says where candidates come from, the most trusted source first. Their forms are fitted to the first seconds of the runs
and judged on held-out data; where no form explains the error, free shapes show place and kind (`step.py` selects and names).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import msgspec
import numpy as np

from isorig.analysis.campaign import Campaign, FloatArray
from isorig.analysis.deadline import Deadline, ask_time, out_of_time, samples_simulated, time_left
from isorig.analysis.diagnose.cause_in_model import without_cause
from isorig.analysis.diagnose.causes import contains, proposed
from isorig.analysis.diagnose.causes.base import Evidence, Kind
from isorig.analysis.diagnose.forms_in_equations import comparable_forms, shows_two
from isorig.analysis.diagnose.forms_of_curves import starts_from_curve
from isorig.analysis.diagnose.free_shapes import free_shapes, with_more_points
from isorig.analysis.diagnose.kinds import SHAPED, kind_of
from isorig.analysis.diagnose.observe import observe
from isorig.analysis.diagnose.policy import POLICY
from isorig.analysis.diagnose.step import (
    Entry,
    Found,
    best_form,
    best_kind,
    curve_of,
    found_step,
    is_undetermined,
    vanishes,
)
from isorig.analysis.diagnose.suspects import ALWAYS, BROKEN, STANDS_ALIKE, Suspects, suspects
from isorig.analysis.equations.at_place import equations_at
from isorig.analysis.equations.forms import lacks_inertia, solved_values, start_values
from isorig.analysis.equations.ranking import removed
from isorig.analysis.equations.system import HOLDS, CausePlace, Equations, equations_of
from isorig.analysis.equations.unknown_force import Places, compared_places, rest_of
from isorig.analysis.errors import FitError, ModelError, OutOfTimeError
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.excess import excess, log_excess, ratio, share_removed
from isorig.analysis.fitting.ladder import (
    AGREES,
    BEHIND,
    BENT,
    CLOSE,
    DECISIVE,
    FAR_WORSE,
    LEAVES,
    PROMISING,
    SCREENS,
    STAYS,
    TELLING,
    Rung,
    Running,
    Start,
    Starts,
    bare_cost,
    continued,
    finished,
    followed,
    horizon,
    ladder,
    misfit,
    tried,
    unrolled,
    verified,
    without,
)
from isorig.analysis.fitting.linear_spectra import spectra_of
from isorig.analysis.fitting.residuals import Problem
from isorig.analysis.fitting.score import Score, adequate, confidence, score
from isorig.analysis.fitting.screen import Progress, Screen, ScreenedCandidate, shortened
from isorig.analysis.fitting.solve import Fit, fit
from isorig.analysis.fitting.transfer_functions import BINS, fitted_to_transfer_functions, steps_towards
from isorig.analysis.fitting.trials import SIGNAL_SHARE, Trial
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.wording import in_per_cent

#: Number of candidates with a full fit, of free shapes, and of pairs of suspected causes.
FINALISTS, CURVES, PAIRS = 4, 3, 2
#: Number of places of a partly measured rig whose equations are solved.
PLACES = 3
#: Most simulated samples for pairs of causes in multiples of those for single ones before, and at least. Chosen: pairs that were
#: found took up to six times as many; where they need more, the best single cause is named. A wire bonder's least
#: takes about 45 s.
FOR_PAIRS, LEAST_FOR_PAIRS = 5, 150_000_000
#: Share of the model's misfit in the first seconds that candidates for a further step must remove. Chosen: half of what the step
#: must remove to count (`Policy.of_rest`).
PROMISING_LATER = 0.25
#: Number of screened candidates that are fitted, in addition to the best of each family.
SCREENED = 6
#: Number of gains that are fitted of those which one step towards the transfer functions chooses. Chosen: in structures of
#: which half the bodies had sensors, the first was right.
NEAREST = 2
#: Misfit, in allowed errors, above which even the best fit may have lost the motion. Chosen: a twentieth of the signal; after
#: impacts a fit from close values ended at 7 % and one over growing lengths of the runs at the noise.
LOST = (0.05 / SIGNAL_SHARE) ** 2
#: Kinds of causes whose force depends on more than the motion at its moment: regressions on the records do not show all of it.
UNSEEN: frozenset[Kind] = frozenset({"memory", "friction_shape"})
#: Families that can make bodies stick: no small step shows the effect of a larger force, so they count place by place.
STICKING = ("friction", "memory")


class SolvedWith(NamedTuple):
    """What the equations of motion give with a model."""

    residuals: Mapping[str, float]
    values: Mapping[str, float]  #: Of the rig's free parameters, by path.


@dataclass(frozen=True, kw_only=True)
class Job:
    """What a search is about."""

    #: The measurement, and the rig as it is described.
    campaign: Campaign
    described: RigModel
    guess: RigModel  #: The rig before any fit, with the values of the equations where these give some.
    #: The model to be extended and its score.
    current: Fit
    now: Score
    equations: Equations  #: The equations of motion of the records, for the current model.
    #: The fit data, and the held-out data.
    trials: Sequence[Trial]
    fine: Sequence[Trial]
    floors: FloatArray  #: The error allowed in each held-out run and channel, shape (runs, channels).
    progress: Progress  #: Called with one line for each stage.
    left: float = 1.0  #: Share of the baseline's excess that the current model leaves.
    steps: int = 1  #: Maximum number of further steps.
    #: Whether to skip pairs and free shapes: they were fitted before, from a less accurate fit of the same model.
    forms_only: bool = False
    allowed: Callable[[RigModel], FloatArray]  #: The same as `floors` for another model, which may amplify noise on the drive.
    rubbing: str = ""  #: Place at which the step before found dry friction; empty for none.
    #: Kind and place of the free shape that the step before found; None for a form, and for the first step.
    curved: tuple[Kind, str] | None = None
    judged: list[Entry] = field(default_factory=list)  #: Takes every candidate that is judged on held-out data.
    with_models: dict[tuple[bytes, bytes], SolvedWith | None] = field(default_factory=dict)  #: The equations with models.

    @cached_property
    def evidence(self) -> Evidence:
        """What the records show without a fit of a candidate."""
        return observe(self.campaign, self.current.model, self.trials, self.described, self.guess)

    def solved_with(self, model: RigModel, like: Equations) -> SolvedWith | None:
        """The equations with a model, in the frequencies of those with which they are compared; computed once.

        None where these are not the same equations: with a further body, one that never slides, or a first friction, with which
        an equation is solved in the time domain. As without the model where its effect cancels the inertia.
        """
        key = model.encoded, like.model.encoded
        if key not in self.with_models:
            ask_time()
            found, solved = equations_of(self.campaign, model, like), None
            if found.sliding.keys() == like.sliding.keys() and like.residuals().keys() <= found.residuals().keys():
                wrong = lacks_inertia(found) and not lacks_inertia(like)
                solved = SolvedWith(like.residuals(), {}) if wrong else SolvedWith(found.residuals(), start_values(found))
            self.with_models[key] = solved
        return self.with_models[key]

    def evidence_of(self, model: RigModel) -> Evidence:
        """The same for a model that may have more links."""
        if len(model.links) == len(self.current.model.links):
            return self.evidence
        return observe(self.campaign, model, self.trials, self.described, self.guess)

    @cached_property
    def suspects(self) -> Suspects | None:
        """What the equations of motion point to; None if they cannot say, or if only ones with estimated motions do not hold."""
        equations = self.equations
        measured = (value for name, value in equations.residuals().items() if name not in equations.with_estimates)
        return self.by_estimates if not equations.hidden or max(measured, default=0.0) >= BROKEN else None

    @cached_property
    def by_estimates(self) -> Suspects | None:
        """The same, also by equations with estimated motions: where bodies have no sensors this takes most of the time."""
        return suspects(self.equations, further=self.left < 1.0)

    @cached_property
    def seconds(self) -> float:
        """Seconds of each run after which the misfit is as visible as in the whole."""
        if self.suspects is not None and self.suspects.rare:
            return np.inf
        return horizon(self.current.model, self.trials)

    @cached_property
    def rungs(self) -> tuple[Rung, ...]:
        """Growing lengths of the runs. If a shorter one shows the misfit too, fits may approach on that."""
        return ladder(self.trials, 0.0 if self.seconds < SCREENS[-1] else self.seconds)

    @cached_property
    def whole(self) -> Problem:
        """All fit data."""
        return Problem(self.trials)

    @cached_property
    def unseen(self) -> Problem | None:
        """The same where the fits of candidates see a part of it; None where they see all."""
        return self.whole if self.whole.size > self.rungs[-1].problem.size else None

    @property
    def promising(self) -> float:
        """Share of the misfit that a candidate must remove."""
        return PROMISING if self.left >= 1.0 else PROMISING_LATER

    @property
    def judged_by_drive(self) -> bool:
        """Whether a further cause is searched for a rig that is judged by its drive, moment by moment.

        There a simulated search costs little, and finds smaller effects than the equations.
        """
        return self.left < 1.0 and any(trial.motion for trial in self.trials)

    @cached_property
    def bare(self) -> float:
        """Misfit of the current model refitted to the first seconds of the runs."""
        return bare_cost(self.current, self.rungs[-1])

    @cached_property
    def solved(self) -> dict[str, float]:
        """Values by path that the equations of motion solve for."""
        return solved_values(self.equations)

    def with_values_before_fit(self, starts: Starts) -> Starts:
        """The same with each candidate's own starting points on the likely values of the rig before any fit.

        These are added where a missing effect has biased the fitted values already over the first moments of the runs. A
        parameter of the candidate that the equations solve for starts at that value, too.
        """
        found = list(starts)
        if self.left >= 1.0 and misfit(self.current.model, self.rungs[0].problem) > BENT:
            for candidate, free, _ in unlike(starts):
                paths = [f.path for f in free if f not in candidate.free and f.path in self.guess.free]
                values = _values_at(self.guess, paths)
                solved = {f.path: self.solved[f.path] for f in candidate.free if f.path in self.solved}
                for start in [*candidate.starts, *([candidate.starts[0].replace(solved)] if solved else [])]:
                    with suppress(ModelError):  # values that exclude the candidate's own
                        found.append((candidate, free, start.replace(values)))
        return found

    def judges(self, candidate: Candidate) -> bool:
        """Whether the runs can judge a candidate: a drive's force judges no body whose motion is not recorded."""
        bodies = len(self.current.model.bodies)
        return len(candidate.starts[0].bodies) == bodies or not any(trial.motion for trial in self.trials)

    def stays(self, run: Running) -> bool:
        """Whether the best fit stays with the data: its misfit is well below that of the current model."""
        return bool(run) and run[0][1].cost < max((1.0 - DECISIVE) * self.bare, TELLING)

    def follows(self, run: Running) -> bool:
        """Whether the best fit has not lost the motion."""
        return self.stays(run) and run[0][1].cost < max(LOST, POLICY.settled * self.bare)

    @property
    def keeps_the_motion(self) -> bool:
        """Whether the current model has not lost the motion, so that no fit from it has either."""
        return bool(self.equations.hidden) and self.now.figure < STAYS

    def helps(self, entries: Sequence[Entry]) -> bool:
        """Whether one removes as much as no other single cause can then."""
        return any(share_removed(self.now.error, entry.score.error, self.floors) >= POLICY.contributes for entry in entries)

    def explains(self, entry: Entry) -> bool:
        """Whether it makes the model adequate, or removes as much of the baseline's error as an explanation does."""
        return (self.left >= 1.0 and self.removes_most(entry)) or adequate(entry.score, self.floors)

    def contradicts(self, entry: Entry) -> bool:
        """Whether the equations of motion clearly show another kind at its place, and it leaves more than a small part."""
        return self.suspects is not None and self.suspects.show_another(*entry.candidate.key) and not self.nearly(entry)

    def removes_most(self, entry: Entry) -> bool:
        """Whether it removes as much of the current model's excess as an explanation does of the baseline's."""
        return share_removed(self.now.error, entry.score.error, self.floors) >= POLICY.explained

    def nearly(self, entry: Entry) -> bool:
        """Whether it leaves so little that the rest is due to no other kind or place."""
        return share_removed(self.now.error, entry.score.error, self.floors) > 1.0 - POLICY.settled

    def entries(self, ranked: Running) -> list[Entry]:
        """Fits of candidates as they are, judged on held-out data: those that are no contenders only show by how much."""
        near = [pair for k, pair in enumerate(ranked) if k < 2 or pair[1].cost <= BEHIND * ranked[0][1].cost]
        return [Entry(candidate=candidate, fit=rough, score=score(rough.model, self.fine)) for candidate, rough in near]

    def following(self, shapes: Running, forms: Running, most: Collection[tuple[Kind, str]]) -> Running:
        """The free shapes without those that predict the runs as well as a form that removes `most` of the excess.

        Both, the form of the same kind at the same place, are fitted to the first seconds only: what follows shows whether the
        shape has found more than its freedom explains (`Policy.form_close`).
        """

        def predicts(candidate: Candidate, rough: Fit) -> bool:
            place = kind_of(candidate.cause), candidate.location
            own = next((fit for other, fit in forms if place in most and (kind_of(other.cause), other.location) == place), None)
            return own is None or misfit(rough.model, self.whole) < misfit(own.model, self.whole) / POLICY.form_close**2

        return [(candidate, rough) for candidate, rough in shapes if predicts(candidate, rough)]

    def finished(self, entries: Sequence[Entry]) -> list[Entry]:
        """The same with the contenders fitted to all fit data; one that predicts the held-out data to the noise needs no more."""
        done: list[Entry] = []
        for rough in entries:
            entry, lost = rough, bool(done) and rough.fit.cost > BEHIND * entries[0].fit.cost
            try:
                if not (lost or adequate(rough.score, self.floors)):
                    better = (unrolled if rough.candidate.shape else finished)(rough.fit, self.trials)
                    if not rough.candidate.plausible(better.model):
                        continue
                    entry = replace(rough, fit=better, score=score(better.model, self.fine))
            except FitError:  # it fits the first seconds only
                continue
            except OutOfTimeError:
                if done:
                    break
            if vanishes(entry):
                continue
            done.append(entry)
            self.judged.append(entry)
            self.progress(
                f"{entry.candidate.cause} ({entry.candidate.location}): held-out error {in_per_cent(entry.score.figure)}"
            )
        return done


def best_fits(entries: Sequence[Entry], floors: FloatArray) -> list[Entry]:
    """Of several fits of one candidate the best by all runs and channels alike, so that a sensitive one does not decide.

    The candidates with the least excess come first.
    """
    best: dict[tuple[str, str], Entry] = {}
    for entry in sorted(entries, key=lambda entry: log_excess(entry.score.error, floors)):
        best.setdefault(entry.candidate.key, entry)
    return sorted(best.values(), key=lambda entry: excess(entry.score.error, floors))


def next_step(job: Job) -> Found | None:
    """The best cause for the remaining error of the current model; None if no candidate could be fitted.

    Catalogued forms are fitted to the first seconds, and pairs of them where the equations show another cause. If neither makes
    the model adequate, free shapes are fitted to determine place and kind; a form is then named only if it comes close to them.
    """
    job.progress("looking for the equations of motion that do not hold")
    asked = _Asked(whole=job.left >= POLICY.rest and not job.forms_only)
    try:
        if both := asked.of_sources(job):
            return both
    except OutOfTimeError:
        if not (asked.forms or asked.shapes):
            raise
    source, forms, shapes, whole = asked.source, asked.forms, asked.shapes, asked.whole
    if source is None:
        return None
    # The error remaining after a form that removes nearly all is not due to another place or kind; another law of its own kind is
    # tested anyway.
    nearly = next((entry for entry in forms if job.nearly(entry)), None)
    alone = any(adequate(entry.score, job.floors) for entry in forms) or (nearly is not None and nearly.kind not in SHAPED)
    try:
        if whole and not alone and not (job.helps(forms) and source.suffices(forms)):
            if shapes is None:
                job.progress("no form makes the model adequate; fitting free shapes")
                most = {entry.place for entry in forms if job.removes_most(entry)}
                chosen = contenders(source.shapes(forms, nearly), source.forms, nearly)
                shapes = job.finished(job.entries(job.following(chosen, source.forms, most)))
            if shapes or nearly is None:
                return _as_shown(_kind_and_form(job, source.known, forms, shapes), source)
    except OutOfTimeError:
        if shapes:
            return best_kind(forms, shapes, job.now, job.floors, job.evidence)
    if not forms:
        return None
    return _as_shown(best_form(forms, job.now, job.floors), source)


@dataclass
class _Asked:
    # What the sources of candidates have given so far: the source that counts, the forms, and the free shapes where no form
    # follows the records; `whole` is whether pairs and shapes are fitted, too.
    whole: bool
    source: Source | None = None
    forms: list[Entry] = field(default_factory=list)
    shapes: list[Entry] | None = None

    def of_sources(self, job: Job) -> Found | None:
        """Ask one source after the other; a pair of causes, if one is found."""
        begun = samples_simulated()
        for each in sources(job):
            if self.whole and isinstance(each, Suspected) and each.shows_two:
                both = _both(job, each, [], samples_simulated() - begun)
                if both is not None and adequate((both.then or both).entry.score, job.floors):
                    return both
            rough = job.entries(each.forms[:FINALISTS])
            self.whole = self.whole and not out_of_time()
            if self.whole and (both := _both(job, each, rough, samples_simulated() - begun)):
                return both
            more = job.finished(rough)
            allowed = [one for one in more if (job.explains(one) or each.allows(one)) and not job.contradicts(one)]
            self.source = each if self.source is None or (more and not self.source.leads) or job.helps(allowed) else self.source
            self.forms = best_fits([*self.forms, *allowed], job.floors)
            if more and (out_of_time() or not each.doubtful(self.forms)):
                break
            if self.whole and each.leads and not more:
                self.shapes = [*(self.shapes or ()), *_without_forms(job, each)]
            if any(job.removes_most(entry) and each.shown(*entry.candidate.key) for entry in self.shapes or ()):
                break
        return None


def _both(job: Job, source: Source, forms: Sequence[Entry], spent: int) -> Found | None:
    # The best pair, found with a multiple of the samples that were simulated for the forms; None without one, or where one cause
    # is enough.
    if job.steps > 1 and not any(adequate(entry.score, job.floors) or job.nearly(entry) for entry in forms):
        with Deadline(time_left(), samples=max(FOR_PAIRS * spent, LEAST_FOR_PAIRS)), suppress(OutOfTimeError):
            return _together(job, source.pairs, forms)
    return None


def _without_forms(job: Job, source: Source) -> list[Entry]:
    # Where no form follows the records, a free shape at the place that the equations show may explain all.
    job.progress("no form follows the records there; fitting free shapes")
    return job.finished(job.entries(contenders(source.shapes([]), source.forms, None)))


def _as_shown(found: Found | None, source: Source) -> Found | None:
    return found and replace(found, shown=source.shown(found.step.cause, found.step.location))


def sources(job: Job) -> Iterator[Source]:
    """Where candidates come from, the most trusted source first."""
    equations = job.equations
    if job.curved is not None and not equations.hidden and job.suspects is not None and job.suspects.only(*job.curved):
        return  # what the free shape leaves there, no law of its kind explains
    if equations.hidden and job.left < POLICY.settled:
        return  # with estimated motions this little may be due to the form that was found
    compared = _compared(job) if equations.hidden else None
    possible = compared if compared is not None and compared.possible else None
    refuted = False
    if possible is not None:
        # Where bodies have no sensors, the misfit of all records tells more about the place than equations that rest on
        # estimates.
        listed = (f"{one.place.kind} {one.place.name} (leaves {one.left:.3g} times the noise)" for one in possible.possible)
        job.progress("the misfit can come from " + ", ".join(listed))
        found = job.suspects
        if found is not None and found.exact and possible.includes(found.chosen[0].place):
            yield Suspected(job=job, found=found)
    if equations.hidden and job.left >= 1.0:
        yield InTransferFunctions(job=job, places=possible)
    if possible is not None:
        for one in possible.possible[:PLACES]:
            there = suspects(equations_at(one, job.campaign, job.trials))
            if there is not None:
                yield Suspected(job=job, found=there)
        yield Screened(job=job, places=possible)
    elif (shown := job.by_estimates) is not None and (not job.judged_by_drive or shown.clear is not None):
        yield Suspected(job=job, found=shown)
        refuted = shown.ranking.broken
        others = shown.others if refuted and job.left >= 1.0 else None
        if others is not None:  # no simulation confirms those: one may remove more from the equations than the right one
            yield Suspected(job=job, found=others)
    elif job.rubbing and not job.judged_by_drive:
        # The equations leave out what friction does near reversals; other laws of it replace the one that was found.
        yield Screened(job=job, kinds={"friction_shape"}, only=job.rubbing)
    # Where all equations hold, only a simulation shows what they leave out: effects of friction near reversals, scales.
    # Those that hold nearly, and point to nothing, do not tell either.
    limit = BROKEN if (job.suspects if possible is not None else job.by_estimates) is None else HOLDS
    hold = equations.complete and max(equations.residuals().values(), default=0.0) < limit
    if job.left >= 1.0 or job.judged_by_drive or hold or not equations.residuals():
        # A whole motion shows smaller effects than its single moments; but where complete equations do not hold, they show the
        # place and kind of all causes without a memory.
        kinds = UNSEEN if refuted and equations.complete and not job.judged_by_drive else None
        yield Screened(job=job, strict=hold or refuted, tried=possible, kinds=kinds)


def _compared(job: Job) -> Places | None:
    # What each place of a partly measured rig leaves of the misfit; before a cause is in it fitted from the description, too.
    return compared_places(job.current.model, job.trials, [job.guess] if job.left >= 1.0 else [])


@dataclass(frozen=True, kw_only=True)
class Suspected:
    """The kinds and places that the equations of motion show, started from their values."""

    job: Job
    found: Suspects

    @cached_property
    def known(self) -> frozenset[tuple[str, str]]:
        """Cause and place of every candidate that was considered."""
        return frozenset(candidate.key for candidate in proposed(self.job.current.model, self.job.evidence))

    @cached_property
    def _started(self) -> Starts:
        candidates = self.found.candidates(self.job.current, self.job.evidence)
        return self._comparable(_started([c for c in candidates if self.job.judges(c)], self.found, self.job.current), self.found)

    def _comparable(self, starts: Starts, found: Suspects) -> Starts:
        # The starting points without the forms that the equations with them in the model refute, and those of the others with the
        # rig's values from these equations, too.
        after = self._in_model(starts, found)
        kept = comparable_forms(found.ranking.residuals, after)
        chosen: Starts = []
        for candidate, free, model in (start for start in starts if start[0].key not in after or start[0].key in kept):
            solved = self.job.with_models.get((model.encoded, found.equations.model.encoded))
            if solved is not None:  # without the form, its effect is in the rig's other values
                with suppress(ModelError):  # values that exclude the candidate's own
                    paths = {each.path for each in free}
                    better = model.replace({path: value for path, value in solved.values.items() if path in paths})
                    chosen.append((candidate, free, better))
            chosen.append((candidate, free, model))
        return chosen

    def _in_model(self, starts: Starts, found: Suspects) -> dict[tuple[str, str], Mapping[str, float]]:
        # The residuals of the equations with each form that they suggest in the model; none where motions are estimated, or few
        # events broke the equations.
        after: dict[tuple[str, str], Mapping[str, float]] = {}
        if not found.broken or self.job.equations.hidden or found.tentative or found.rare:
            return after
        solved_once: set[int] = set()
        for candidate, _, model in starts:
            # Values from a link's recorded force are about the same from every start, but not for every variant of a form.
            known = id(candidate) in solved_once and found.left(candidate, self.job.current.free) > 0.0
            if candidate.shape is None and not known and found.score_of(*candidate.key) > 0.0:
                solved_once.add(id(candidate))
                solved = self.job.solved_with(model, found.equations)
                if solved is not None:
                    best = after.get(candidate.key, solved.residuals)
                    after[candidate.key] = max(solved.residuals, best, key=lambda one: removed(found.ranking.residuals, one))
        return after

    @cached_property
    def shows_two(self) -> bool:
        """Whether the equations show two causes at different places."""
        return shows_two(self.found.ranking.residuals, self._in_model(self._started, self.found))

    @cached_property
    def forms(self) -> Running:
        """Fitted forms, best first."""
        chosen = (f"{x.kind} ({x.place}, {x.what}, score {x.score:.2f})" for x in self.found.chosen)
        self.job.progress("suspected: " + ", ".join(chosen))
        return self._fitted(self._started)

    def _fitted(self, starts: Starts) -> Running:
        # Values from the equations are usually close; a further cause that is not close from the start is none.
        job = self.job
        near = job.left < 1.0 and not self.found.tentative
        limit = LEAVES * misfit(job.current.model, job.rungs[-1].problem) if near else np.inf
        # An earlier cause may bend the equation, and the values from it lead away. A fault of a channel bends it, too, and a fit
        # without it follows the records closely.
        begun = {(id(candidate), id(model)) for candidate, _, model in starts}
        fitted = [(c, free) for c, free, _ in unlike(starts) if c.shape is None and (near or kind_of(c.cause) == "sensor")]
        own = [(c, free, m) for c, free in fitted for m in c.starts]
        starts = [*starts, *(start for start in own if (id(start[0]), id(start[2])) not in begun)]
        starts = job.with_values_before_fit(starts)
        run = verified(starts, job.rungs[-1], job.progress, sure=self.found.shows, limit=limit, whole=job.unseen)
        run = continued(run, job.rungs[-1])
        if (place := self.found.equations.only) is not None and run:
            # The force there has no content where noise hides it, which biases the values of a form.
            best = next(start for start in starts if start[0] is run[0][0])
            more = verified(self._with_own_values(best, place), job.rungs[-1], job.progress)
            run = sorted([*run, *more], key=lambda pair: pair[1].cost)
        if job.left < 1.0 or len(job.rungs) == 1 or out_of_time() or job.follows(run):
            return run
        if job.keeps_the_motion and run:
            # Each contains the current model, so only those that leave more have lost the motion.
            lost = [candidate for candidate, done in run if done.cost > job.bare]
            starts = [start for start in starts if any(start[0] is candidate for candidate in lost)]
            again = followed(starts, job.rungs, job.current, job.progress, job.promising) if starts else []
            return sorted([*again, *(pair for pair in run if pair[0] not in lost)], key=lambda pair: pair[1].cost)
        # Impacts soon make two motions differ, however close their parameters are.
        again = followed(starts, job.rungs, job.current, job.progress, job.promising)
        return run if job.stays(run) and not (again and again[0][1].cost < run[0][1].cost) else again

    def _with_own_values(self, start: Start, place: CausePlace) -> Starts:
        # A candidate's own starting points, with the rest of the rig as the unknown force at its place leaves it.
        candidate, free, _ = start
        paths = {each.path for each in free}
        rest = {path: value for path, value in rest_of(self.found.equations.model, place).items() if path in paths}
        return [(candidate, free, model.replace(rest)) for model in candidate.starts]

    @property
    def leads(self) -> bool:
        """Whether its free shapes are tried even if another source has forms: broken equations show place and kind better."""
        return self.found.ranking.broken and not self.found.tentative

    def shapes(self, forms: Sequence[Entry], nearly: Entry | None = None) -> Running:
        """Fitted free shapes, best first, from the equations' values and from the best form of their kind."""
        if self.found.tentative:
            return []
        shown = self.found.shapes(self.job.current, self.job.evidence, refuted=not forms)
        suspected = [shape for shape in shown if _wanted(shape, nearly)]
        keys = {(shape.key, shape.shape, len(shape.free)) for shape in suspected}
        from_forms = [
            start
            for start in shape_starts(forms, self.job.current, self.job.evidence)
            if (start[0].key, start[0].shape, len(start[0].free)) in keys
            and all(start[2] is not model for model in start[0].starts)
        ]
        return self._fitted([*_started(suspected, self.found, self.job.current), *from_forms])

    @cached_property
    def pairs(self) -> list[tuple[Candidate, Fit, Candidate, Fit]]:
        """Each suspected form at its starting values, with what the equations show then."""
        job, found = self.job, list[tuple[Candidate, Fit, Candidate, Fit]]()
        if self.found.tentative or not self.found.leaves_another(job.current, job.evidence):
            return found
        for begun in self._firsts[:PAIRS]:
            if any(pair[3].cost <= AGREES for pair in found) and not self.found.blamed(begun[0].cause, begun[0].location):
                break  # only what the equations show as clearly may stand for the first cause of a pair that agrees
            starts, then = self._after(begun)
            if not starts or then is None:
                continue
            job.progress(f"an equation does not hold with {begun[0].cause} ({begun[0].location}); fitting another cause with it")
            run, back = self._with_second(begun, starts, then)
            behind = {id(start[0]): other for start, other in back}
            first = behind.get(id(run[0][0]), begun) if run else begun
            if run and (forms := self._forms_for(run[0], first)):
                run, first = forms
                behind = {id(candidate): first for candidate, _ in run}
            if not job.stays(run):
                continue
            # Others that agree with the data too are reported as indistinguishable.
            named: list[set[tuple[str, str]]] = []
            for candidate, both in [run[0], *(pair for pair in run[1:] if pair[1].cost <= AGREES)]:
                first = behind.get(id(candidate), begun)
                keys = {first[0].key, candidate.key}
                if keys in named:
                    continue
                # Without the other one its values may be none that would be named.
                alone = tried(first[2], first[1], job.rungs[-1])
                if alone is not None:
                    named.append(keys)
                    found.append((first[0], alone, candidate, both))
        return sorted(found, key=lambda pair: pair[3].cost)[:FINALISTS]

    @property
    def _firsts(self) -> Starts:
        # The first causes of pairs: the curve of the best explanation in place of its forms, or, if one of these repairs the
        # equations as well, after it.
        curved = self._with_curve(self._started, self.found, self.job.current, self.job.evidence)
        curve = next((start for start in curved if start[0].shape is not None), None)
        if curve is None:
            return unlike(curved)
        before = self.found.ranking.residuals
        there = [left for key, left in self._in_model(self._started, self.found).items() if key[1] == curve[0].location]
        with_curve = self.job.solved_with(curve[2], self.found.equations) if there else None
        if with_curve is None or all(removed(before, left) < removed(before, with_curve.residuals) for left in there):
            return unlike(curved)
        return unlike([self._started[0], curve, *self._started[1:]])

    def _with_curve(self, starts: Starts, found: Suspects, current: Fit, evidence: Evidence) -> Starts:
        # The same with the curve of the best explanation in place of its forms, if none of these leaves as little of a link's
        # force; after the forms of other explanations that are as good, which are simpler.
        curve = found.curve(current, evidence)
        if curve is None or any(found.stands(candidate, current, evidence) for candidate, _, _ in starts):
            return starts
        best, (shape, model) = found.chosen[0].score, curve
        simpler = [start for start in starts if found.otherwise(start[0].cause, start[0].location)]
        others = [start for start in starts if found.score_of(start[0].cause, start[0].location) < best]
        others = [start for start in others if all(start is not other for other in simpler)]
        return [*simpler, (shape, shape.parameters(current.model, current.free), model), *others]

    def _with_second(self, begun: Start, starts: Starts, then: Suspects) -> tuple[Running, list[tuple[Start, Start]]]:
        # Fits of a first cause with a second one that starts at one of these points, best first; and the starts that have another
        # first one, each with that.
        job = self.job
        forms = self._forms_of_curves(begun, starts, then)
        run = verified([start for start, _ in forms], job.rungs[-1], job.progress) if forms else []
        if job.follows(run):
            return run, forms
        run = verified(starts, job.rungs[-1], job.progress)
        if run and run[0][1].cost <= TELLING:
            return run, []
        # Impacts soon make two motions differ, however close they begin.
        again = followed(starts, job.rungs, job.current, job.progress, job.promising)
        return (again if again and (not run or again[0][1].cost < run[0][1].cost) else run), []

    def _forms_of_curves(self, begun: Start, starts: Starts, then: Suspects) -> list[tuple[Start, Start]]:
        # Forms of a curve and of the second cause at its place whose sum leaves about as little of the link's recorded force as
        # that cause with the curve: each second cause, and the first one before it. A simulation of a curve takes much longer.
        (curve, with_curve, _), current = begun, self.job.current
        there = [start[0] for start in starts if start[0].location == curve.location]
        if curve.shape is None or not there:
            return []
        enough = POLICY.form_close * min(then.left(other, with_curve) for other in there)
        wanted = {other.cause for other in there}  # a free shape has its kind as its cause
        found: list[tuple[float, Start, Start]] = []
        evidence, known = (each.located(self.job.evidence) for each in (self.found, then))
        for form in proposed(current.model, evidence):
            if form.location != curve.location or kind_of(form.cause) != kind_of(curve.cause):
                continue
            free, model = form.parameters(current.model, current.free), self.found.started(form, current.free)[0]
            for second in proposed(model, known):
                if second.location == curve.location and {second.cause, kind_of(second.cause)} & wanted:
                    left, first = then.left(second, free), (form, free, model)
                    if left <= enough:
                        own = second.parameters(model, free)
                        found += [(left, (second, own, start), first) for start in then.started(second, free)]
        return [(start, first) for _, start, first in sorted(found, key=lambda item: item[0])]

    def _forms_for(self, pair: tuple[Candidate, Fit], begun: Start) -> tuple[Running, Start] | None:
        # Forms that come as close to the data as the curve of a pair, and the other cause of that with the values as they were
        # fitted with the curve: what the equations show then, and, of kinds that they do not see, the forms that were fitted
        # alone at the curve's place. None without a curve, or without such a form.
        (second, both), (first, _, _), current = pair, begun, self.job.current
        alone = replace(current, model=begun[2], free=begun[1])
        shape, other, before, after = (second, first, alone, both) if second.shape else (first, second, current, alone)
        if shape.shape is None or other.shape is not None or not _paths(other) <= {f.path for f in both.free}:
            return None
        rest = without_cause(before, after, both)
        if rest is None:
            return None
        found: Start = (other, rest[1], rest[0])
        forms, _ = self._after(found, curves=False)
        if kind_of(shape.cause) in UNSEEN:
            own = _values_at(both.model, sorted(_paths(other)))
            for form, single in self.forms:
                if form.location == shape.location and kind_of(form.cause) in UNSEEN:
                    with suppress(ModelError):  # the other cause is in a law that its model lacks
                        start = single.model.replace(own)
                        forms.append((form, form.parameters(start, (*current.free, *other.free)), start))
            forms = [each for each in forms if _keeps(other, each)]
        run = verified(forms, self.job.rungs[-1], self.job.progress) if forms else []
        close = [one for one in run if one[1].cost <= max(AGREES, POLICY.form_close**2 * both.cost)]
        return (close, found) if close else None

    def _after(self, begun: Start, *, curves: bool = True) -> tuple[Starts, Suspects | None]:
        # Starting points of a second cause by the equations with the first one in place, and what these point to; none if they
        # hold. What replaces the first cause, or is of a kind there that the equations cannot distinguish from it, is no second
        # one.
        job, (first, free, model) = self.job, begun
        then = suspects(equations_of(job.campaign, model), further=True)
        if then is None or then.tentative or not then.broken:
            return [], None
        extended = replace(job.current, model=model, free=free)
        evidence = job.evidence_of(model)
        others = (c for c in then.candidates(extended, evidence) if c.cause not in ALWAYS and job.judges(c))
        candidates = [c for c in others if not then.alike(c.key, first.key) and c.key not in then.untested]
        starts = self._comparable(_started(candidates, then, extended), then)
        starts = self._with_curve(starts, then, extended, evidence) if curves else starts
        return [start for start in starts if start[0].key != first.key and _keeps(first, start)], then

    def doubtful(self, forms: Sequence[Entry]) -> bool:
        """Whether the next source is asked, too.

        What the equations hardly show may be what they do not see; what breaks an estimated motion may be beyond it.
        """
        weak = not self.found.ranking.broken and not any(adequate(entry.score, self.job.floors) for entry in forms)
        return weak or (bool(self.job.equations.hidden) and not self.job.helps(forms))

    def suffices(self, forms: Sequence[Entry]) -> bool:
        """Whether the best form stands without free shapes: it leaves as little of a link's recorded force as any curve there."""
        best = min(forms, key=lambda entry: excess(entry.score.error, self.job.floors))
        return self.found.stands(best.candidate, self.job.current, self.job.evidence)

    def allows(self, entry: Entry) -> bool:
        """Whether a form may be named that leaves a visible error.

        The equations blame its kind and place as much as any other, or, for a first cause, none clearly.
        What they cannot show is allowed as a first cause that removes what no other single one can.
        """
        if self.found.tentative:
            return self.job.removes_most(entry)
        if not self.found.broken:
            return self.job.left >= 1.0
        untested = entry.candidate.key in self.found.untested and self.job.left >= 1.0 and self.job.helps([entry])
        return untested or self.found.blamed(entry.candidate.cause, entry.candidate.location)

    def shown(self, cause: str, place: str) -> bool:
        """Whether the equations of motion show this cause and place, and no other."""
        return self.found.shown(cause, place)


@dataclass(frozen=True, kw_only=True)
class InTransferFunctions:
    """The gains of sensors, chosen by one linear step of each from the fit to the transfer functions.

    Where motions are estimated from the records, a wrong gain breaks every equation.
    """

    job: Job  #: What the search is about.
    places: Places | None = None  #: Those of the candidates; None for all.

    @property
    def leads(self) -> bool:
        """It has no shapes."""
        return False

    @cached_property
    def _sought(self) -> list[Candidate]:
        model, evidence = self.job.current.model, self.job.evidence
        gains = (c for c in proposed(model, evidence) if [free.path.rpartition(".")[2] for free in c.free] == ["gain"])
        return [c for c in gains if self.places is None or self.places.includes(c.location)]

    @property
    def known(self) -> frozenset[tuple[str, str]]:
        """Cause and place of every candidate that was considered."""
        return frozenset(candidate.key for candidate in self._sought)

    @cached_property
    def forms(self) -> Running:
        """Fitted forms, best first."""
        job, free = self.job, self.job.current.free
        spectra = spectra_of(job.current.model, job.campaign, BINS)
        guess = fitted_to_transfer_functions(job.guess, free, spectra)
        if guess is None or not self._sought:
            return []
        shares = steps_towards(guess, free, [c.free[0] for c in self._sought], spectra)
        nearest = [self._sought[k] for k in np.argsort(-shares)[:NEAREST]]
        job.progress("transfer functions suggest: " + ", ".join(f"{c.cause} ({c.location})" for c in nearest))
        starts: Starts = []
        for candidate in nearest:
            own = candidate.parameters(job.current.model, free)
            fitted = fitted_to_transfer_functions(candidate.starts[0], own, spectra)
            if fitted is not None:
                starts.append((candidate, own, fitted))
        return continued(verified(starts, job.rungs[-1], job.progress), job.rungs[-1])

    def shapes(self, forms: Sequence[Entry], nearly: Entry | None = None) -> Running:
        """None: the rig is linear."""
        return []

    @property
    def pairs(self) -> list[tuple[Candidate, Fit, Candidate, Fit]]:
        """A second cause is searched for after the first."""
        return []

    def doubtful(self, forms: Sequence[Entry]) -> bool:
        """What explains most needs no other source."""
        return not any(self.job.explains(entry) for entry in forms)

    def suffices(self, forms: Sequence[Entry]) -> bool:
        """Whether a form explains most."""
        return not self.doubtful(forms)

    def allows(self, entry: Entry) -> bool:
        """Only one that explains most."""
        return False

    def shown(self, cause: str, place: str) -> bool:
        """The equations show nothing."""
        return False


@dataclass(frozen=True, kw_only=True)
class Screened:
    """Candidates chosen by one linear step of each from the current fit."""

    job: Job  #: What the search is about.
    #: Those of the candidates; None for all.
    kinds: Collection[Kind] | None = None
    places: Places | None = None
    only: str = ""  #: The only place, also of candidates that are always tried; empty for none.
    #: Whether only a candidate that explains the error counts, or, of given kinds, one that removes what no other can: all
    #: equations of motion hold, or a simulation refuted what they show.
    strict: bool = False
    tried: Places | None = None  #: Places at which another source has tried all causes; None for none.

    def _sought(self, candidate: Candidate) -> bool:
        if self.only:
            return candidate.location == self.only and kind_of(candidate.cause) in (self.kinds or ())
        kind = self.kinds is None or kind_of(candidate.cause) in self.kinds
        return candidate.cause in ALWAYS or (kind and (self.places is None or self.places.includes(candidate.location)))

    @cached_property
    def _screen(self) -> Screen:
        problem = Problem(shortened(self.job.trials, self.job.seconds))
        current = fit(self.job.current.model, self.job.current.free, problem, iterations=3, tolerance=CLOSE)
        return Screen(current, problem.about(current.model))

    @cached_property
    def _screened(self) -> list[ScreenedCandidate]:
        job, current = self.job, self._screen.current
        sought = [candidate for candidate in proposed(current.model, job.evidence) if self._sought(candidate)]
        ranked = self._screen.ranked([c for c in sought if self.tried is None or not self.tried.includes(c.location)])
        least = current.cost if job.left >= POLICY.rest else (1.0 - POLICY.worth) * current.cost
        return ranked if ranked and (job.left >= POLICY.rest or ranked[0].cost < least) else []

    @property
    def known(self) -> frozenset[tuple[str, str]]:
        """Cause and place of every candidate that was considered."""
        return frozenset(item.candidate.key for item in self._screened)

    @cached_property
    def forms(self) -> Running:
        """Fitted forms, best first."""
        job, chosen = self.job, diverse(self._screened)
        if not chosen:
            return []
        job.progress("most promising: " + ", ".join(f"{x.candidate.cause} ({x.candidate.location})" for x in chosen[:3]))
        starts = [(x.candidate, x.candidate.parameters(job.current.model, job.current.free), m) for x in chosen for m in x.models]
        starts = job.with_values_before_fit(starts)
        # Growing lengths of the runs are needed only where motions drift apart.
        run: Running = []
        if self.places is not None and misfit(job.current.model, job.rungs[-1].problem) < (STAYS / SIGNAL_SHARE) ** 2:
            run = verified(starts, job.rungs[-1], job.progress)
        return run if job.follows(run) else followed(starts, job.rungs, job.current, job.progress, job.promising)

    @property
    def leads(self) -> bool:
        """Another source's shapes may be better founded."""
        return False

    def shapes(self, forms: Sequence[Entry], nearly: Entry | None = None) -> Running:
        """Fitted free shapes, best first, the leading ones with as many points as they need."""
        job, every = self.job, shape_starts(forms, self.job.current, self.job.evidence)
        begun = [start for start in every if self._sought(start[0]) and _wanted(start[0], nearly)]
        from_forms = [start for start in begun if all(start[2] is not model for model in start[0].starts)]
        if nearly is not None and from_forms:
            # A form that removes nearly all stays with the data, and so do curves that begin like it.
            return self._denser(verified(from_forms, job.rungs[-1], job.progress))
        stepped = [self._screen.screen(candidate) for candidate in {id(start[0]): start[0] for start in begun}.values()]
        stepped.sort(key=lambda item: item.cost)
        # The linear step shows the place better than the kind: from little friction no step leads to sticking, but a form does.
        least = (1.0 - job.promising) * self._screen.current.cost
        followed_forms = {(kind_of(candidate.cause), candidate.location) for candidate, _ in self.forms}

        def may_explain(item: ScreenedCandidate) -> bool:
            shape = item.candidate
            here = shape.location == stepped[0].candidate.location
            return here and (item.cost <= least or (kind_of(shape.cause), shape.location) in followed_forms)

        near = [item for k, item in enumerate(stepped) if k < CURVES or may_explain(item)]
        starts = [(x.candidate, x.candidate.parameters(job.current.model, job.current.free), x.models[0]) for x in near]
        starts += [start for start in from_forms if any(start[0] is x.candidate for x in near)]
        return self._denser(followed(starts, job.rungs, job.current, job.progress, job.promising))

    def _denser(self, run: Running) -> Running:
        denser = [with_more_points(candidate, done, self.job.rungs[-1]) for candidate, done in run[:CURVES]]
        return sorted([*denser, *run[CURVES:]], key=lambda pair: pair[1].cost)

    @property
    def pairs(self) -> list[tuple[Candidate, Fit, Candidate, Fit]]:
        """A second cause is searched for after the first."""
        return []

    def doubtful(self, forms: Sequence[Entry]) -> bool:
        """The fault may be elsewhere than the direction of the misfit shows."""
        return self.places is not None and not self.job.helps(forms)

    def suffices(self, forms: Sequence[Entry]) -> bool:
        """Only free shapes tell."""
        return False

    def allows(self, entry: Entry) -> bool:
        """Where the equations give no reason, only a first cause that removes what no other single one can, of what they miss.

        They leave out what friction does near reversals: another law of a friction that was found may come much closer.
        """
        if entry.place == ("friction_shape", self.job.rubbing):
            return ratio(self.job.now.error, entry.score.error, self.job.floors) >= POLICY.form_close
        if self.strict:
            return self.kinds is not None and self.job.left >= 1.0 and self.job.helps([entry])
        return self.kinds is None or self.job.left >= 1.0

    def shown(self, cause: str, place: str) -> bool:
        """The equations show nothing."""
        return False


#: Where candidates come from.
Source = Suspected | InTransferFunctions | Screened


def diverse(screened: Sequence[ScreenedCandidate]) -> list[ScreenedCandidate]:
    """The best candidates, and the best of each family, so that no kind is lost because of a rough first step."""

    def kind(item: ScreenedCandidate) -> tuple[str, str]:
        candidate = item.candidate
        return candidate.family, candidate.location if candidate.family in STICKING else ""

    chosen = list(screened[:SCREENED])
    for item in screened[SCREENED:]:
        if all(kind(item) != kind(other) for other in chosen):
            chosen.append(item)
    return chosen


def _started(candidates: Sequence[Candidate], found: Suspects, current: Fit) -> Starts:
    # Starting points of suspected candidates, from the equations; those of the best explanation first, and of these the simplest
    # of those that leave least of a link's recorded force.
    left = {id(c): (found.score_of(c.cause, c.location), found.left(c, current.free)) for c in candidates}
    least = {score: min(rest for other, rest in left.values() if other == score) for score, _ in left.values()}

    def order(candidate: Candidate) -> tuple[float, bool, int, int]:
        score, rest = left[id(candidate)]
        return -score, rest > STANDS_ALIKE * least[score], candidate.rank, len(candidate.free)

    return [
        (candidate, candidate.parameters(current.model, current.free), model)
        for candidate in sorted(candidates, key=order)
        for model in found.started(candidate, current.free)
    ]


def unlike(begun: Starts) -> Starts:
    """The first starting point of each cause and place."""
    return [start for k, start in enumerate(begun) if all(start[0].key != other.key for other, _, _ in begun[:k])]


def shape_starts(forms: Sequence[Entry], current: Fit, evidence: Evidence) -> Starts:
    """Starting points of all free shapes: their own, and the best form of their kind and place."""
    begun: Starts = []
    for shape in free_shapes(current.model, evidence):
        free = shape.parameters(current.model, current.free)
        begun += [(shape, free, start) for start in shape.starts]
        form = next((entry for entry in forms if entry.place == (kind_of(shape.cause), shape.location)), None)
        if form is not None:
            begun += [
                (shape, free, start)
                for other in free_shapes(form.fit.model, evidence)
                if other.key == shape.key and other.shape == shape.shape and _paths(other) == _paths(shape)
                for start in other.starts
            ]
    return begun


def _paths(candidate: Candidate) -> set[str]:
    # Next to a form that the shape does not replace, its parameters have other places in the rig.
    return {free.path for free in candidate.free}


def _keeps(first: Candidate, start: Start) -> bool:
    # Whether a cause leaves the first one in the rig: its law does not take the place of the law of that.
    return _paths(first) <= {free.path for free in start[1]} - _paths(start[0])


def contenders(shapes: Running, forms: Running, nearly: Entry | None) -> Running:
    """The free shapes to be finished, judged by their misfit in the first seconds.

    None that is far worse than the best, nor one that is hardly better than a form of its kind at its place: that form stands
    (`Policy.form_alike`). Where a form removes `nearly` all, only shapes of its kind and place that are closer to the data than
    a form must come (`Policy.form_close`).
    """
    of_forms: dict[tuple[Kind, str], float] = {}
    for candidate, rough in forms:
        of_forms.setdefault((kind_of(candidate.cause), candidate.location), rough.cost)
    best = min((rough.cost for _, rough in (*shapes, *forms)), default=np.inf)
    enough = next((r.cost / POLICY.form_close**2 for c, r in forms if nearly and c is nearly.candidate), np.inf)
    chosen: Running = []
    for candidate, rough in shapes:
        place = kind_of(candidate.cause), candidate.location
        own = of_forms.get(place, np.inf) / POLICY.form_alike**2
        wanted = nearly is None or place == nearly.place
        if wanted and rough.cost < min(FAR_WORSE * best, own, enough) and all(candidate.key != c.key for c, _ in chosen):
            chosen.append((candidate, rough))
    return chosen[:CURVES]


def _wanted(shape: Candidate, nearly: Entry | None) -> bool:
    # Whether a free shape may be better than a form that removes nearly all.
    return nearly is None or (kind_of(shape.cause), shape.location) == nearly.place


def _kind_and_form(
    job: Job, known: Collection[tuple[str, str]], forms: Sequence[Entry], shapes: Sequence[Entry]
) -> Found | None:  # fmt: skip
    # The best kind and place, after forms that extend those there, and the best form, were fitted too; the best form if one is
    # adequate.
    named = best_kind(forms, shapes, job.now, job.floors, job.evidence)
    place = named.entry.place if named is not None and named.step.form is None else None
    starts: Starts = []
    for entry in (entry for k, entry in enumerate(forms) if (k == 0 and entry.kind in SHAPED) or entry.place == place):
        # A rig whose baseline has no friction has no Stribeck friction to try before it has some.
        model = msgspec.structs.replace(entry.fit.model, free=tuple(free.path for free in entry.fit.free))
        for candidate in proposed(model, job.evidence):
            if (kind_of(candidate.cause), candidate.location) == entry.place and candidate.key not in known:
                free = candidate.parameters(model, entry.fit.free)
                starts += [(candidate, free, start) for start in candidate.starts]
    if named is not None and named.step.curve is not None and place is not None:
        tried_there = {entry.candidate.key for entry in job.judged}
        starts += starts_from_curve(
            named.entry.candidate, named.entry.fit, named.step.curve, job.current, job.evidence, tried_there
        )
    if starts:
        more = followed(starts, job.rungs, job.current, job.progress, job.promising)
        extended = [entry for entry in job.finished(job.entries(more)) if _extends(entry, forms, job.floors)]
        forms = best_fits([*forms, *extended], job.floors)
        named = best_kind(forms, shapes, job.now, job.floors, job.evidence)
    stand = any(adequate(entry.score, job.floors) for entry in forms)
    return best_form(forms, job.now, job.floors) if stand else named


def _extends(entry: Entry, forms: Sequence[Entry], floors: FloatArray) -> bool:
    # Whether a more general law leaves clearly less than the forms at its place. Without one value that the data determine, it
    # imitates what they lack.
    if is_undetermined(entry):
        return False
    simpler = [form for form in forms if form.place == entry.place]
    return adequate(entry.score, floors) or all(
        ratio(form.score.error, entry.score.error, floors) >= POLICY.form_alike for form in simpler
    )


def _together(
    job: Job, pairs: Sequence[tuple[Candidate, Fit, Candidate, Fit]], forms: Sequence[Entry]
) -> Found | None:  # fmt: skip
    # The best pair that makes the model adequate, or leaves as little as one cause may or a tenth of what each alone
    # leaves, as two steps; None if there is none.
    if not pairs:
        return None
    done: list[tuple[Candidate, Fit, Entry, bool]] = []
    # One cause alone may be all.
    named = {candidate.key for first, _, second, _ in pairs for candidate in (first, second)}
    single = job.finished([entry for entry in forms if entry.candidate.key in named])
    if any(adequate(entry.score, job.floors) for entry in single):
        return None
    others = [job.now, *(entry.score for entry in (*single, *forms))]
    alone_at_best = min(excess(one.error, job.floors) for one in others)
    # In each run alike: one whose motion is lost after an impact does not decide.
    alike_at_best = min(log_excess(one.error, job.floors) for one in others)
    for first, alone, second, rough in pairs:
        with suppress(FitError):
            both = finished(rough, job.trials)
            entry = Entry(candidate=second, fit=both, score=score(both.model, job.fine))
            names = sorted((first.key, second.key))
            job.progress(f"{' and '.join(' at '.join(key) for key in names)}: held-out error {in_per_cent(entry.score.figure)}")
            # A fit that agrees with its own data to the noise may leave other data because its motion is sensitive to noise.
            floors = np.maximum(job.floors, job.allowed(both.model)) if both.cost <= AGREES else job.floors
            left = excess(entry.score.error, job.floors)
            alike = log_excess(entry.score.error, job.floors) <= alike_at_best + 0.5 * np.log(POLICY.rest)
            decisive = (left <= POLICY.rest * alone_at_best or alike) and job.explains(entry)
            stands = adequate(entry.score, floors)
            # Two causes that leave more than one does are not both there.
            if stands or decisive or (job.nearly(entry) and left < alone_at_best):
                done.append((first, alone, entry, stands))
    if not done:
        return None
    done = [pair for pair in done if pair[3]] or done
    first, alone, last, _ = min(done, key=lambda pair: (pair[0].rank + pair[2].candidate.rank, len(pair[2].fit.free)))
    bare = without(last.fit, alone, job.trials)
    entry = Entry(candidate=first, fit=bare, score=score(bare.model, job.fine))
    named = {first.key, last.candidate.key}
    keys = [{one.key, other.candidate.key} for one, _, other, _ in done]
    of_first, of_last = (
        {key for pair in keys if own not in pair for key in pair - named if not contains(key, own)}
        for own in (first.key, last.candidate.key)
    )
    sure = confidence(last.score, [other.score for other in (*forms, entry)])
    curves = [curve_of(e.candidate, e.fit, job.evidence) for e in (last, entry)]
    then = found_step(last, [last], entry.score, of_last, sure, curve=curves[0])
    return replace(found_step(entry, [*forms, entry], job.now, of_first, sure, curve=curves[1]), then=then)


def _values_at(model: RigModel, paths: Sequence[str]) -> dict[str, float]:
    # A model's values by path.
    return {path: model.get(path) for path in paths}
