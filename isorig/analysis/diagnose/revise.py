"""Earlier steps revised once later causes are in the model.

A cause that was chosen while a later one was missing may have stood for some of that. With the later causes in place, it is left
out if it explains nothing any more, or exchanged for a rival of its search that explains more, or for a simpler one at its place
that explains as much. A law that replaces that of an earlier cause takes the place of its step. A form of a free shape's kind
that comes as close takes the place of that.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise

from isorig.analysis.campaign import FloatArray
from isorig.analysis.diagnose.cause_in_model import with_cause, without_cause
from isorig.analysis.diagnose.causes.base import Evidence
from isorig.analysis.diagnose.forms_of_curves import starts_from_curve
from isorig.analysis.diagnose.policy import POLICY, explains_better, form_stands, is_superfluous
from isorig.analysis.diagnose.step import Entry, Found, Step, found_step, is_determined, rescored, vanishes
from isorig.analysis.errors import FitError, ModelError
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.division import Division
from isorig.analysis.fitting.excess import ratio
from isorig.analysis.fitting.ladder import finished, ladder, tried, verified, widened, without_step
from isorig.analysis.fitting.score import Score, confidence, score
from isorig.analysis.fitting.screen import Progress
from isorig.analysis.fitting.solve import Fit, Free
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.wording import in_per_cent

#: Maximum number of rivals with which a cause is exchanged. Chosen: one or two were as near in the sealed campaigns.
RIVALS = 2


@dataclass(frozen=True, kw_only=True)
class SearchStage:
    """An intermediate model of a search."""

    #: The fitted model and its score.
    fit: Fit
    score: Score
    #: The step that led to it and its candidate; None for the baseline.
    step: Step | None = None
    candidate: Candidate | None = None
    entries: tuple[Entry, ...] = ()  #: All fits of the step's search.
    paired: bool = False  #: Whether the next stage belongs to it.
    shown: bool = False  #: Whether the equations of motion show the step's kind and place.


def stage_of(before: Score, found: Found) -> SearchStage:
    """The stage to which a step leads from a score."""
    entry = found.entry
    step = replace(found.step, before=before.figure, after=entry.score.figure)
    return SearchStage(
        fit=widened(entry.fit), score=entry.score, step=step, candidate=entry.candidate, entries=found.entries,
        paired=found.then is not None, shown=found.shown,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Revision:
    """The revision of a search's stages."""

    #: Fitted and held-out runs, the error allowed in the latter, shape (runs, channels), the adequacy threshold, and the user's
    #: tolerance.
    division: Division
    floors: FloatArray
    enough: float
    tolerance: float
    evidence_of: Callable[[RigModel], Evidence]  #: What the records show of a model.
    progress: Progress  #: Called with one line for each change.
    #: Cause and place of the exchanged causes, and of those that took their place.
    exchanged: dict[tuple[str, str], tuple[str, str]] = field(default_factory=dict)

    def revised(self, stages: list[SearchStage]) -> list[SearchStage]:
        """The stages with better rivals, and without the causes that the later ones leave nothing to explain.

        The forms of a free shape that was found alone have been fitted in its search.
        """
        together, k = any(stage.paired for stage in stages), 1
        while k < len(stages) - 1:
            later = self._leaner(stages, k)
            if later is None:
                stages, k = self._with_best_rival(stages, k), k + 1
            else:
                stages = [*stages[:k], *later]
        if together:
            for k in range(1, len(stages)):
                stages = self._with_form(stages, k)
        return stages

    def _leaner(self, stages: Sequence[SearchStage], k: int) -> list[SearchStage] | None:
        # The stages after stage k without its cause; None if the last one needs that.
        gone, now = stages[k], stages[-1]
        last = self._refitted(stages, k, now)
        if last is None or gone.step is None or gone.candidate is None:
            return None
        superfluous = is_superfluous(last.score.error, now.score.error, self.floors, self.enough, self.tolerance)
        if gone.candidate.plausible(now.fit.model) and not superfluous:
            return None
        self.progress(f"without {gone.step.cause} at {gone.step.location} the later causes reach {last.score.figure:.3g}")
        return self._later(stages, k, stages[k - 1].score, last)

    def _with_best_rival(self, stages: list[SearchStage], k: int) -> list[SearchStage]:
        # The stages with the cause of stage k exchanged for a rival that explains more together with the later ones, or for a
        # simpler one at its place that explains as much.
        gone, before, now = stages[k], stages[k - 1], stages[-1]
        if gone.step is None:
            return stages
        for rival in near_rivals(gone, self.floors):
            simpler = _simpler(rival, gone)
            if gone.paired and not simpler:
                continue
            last = self._refitted(stages, k, now, rival)
            if last is None or not (
                explains_better(last.score.error, now.score.error, self.floors, self.enough, self.tolerance)
                or (simpler and ratio(last.score.error, now.score.error, self.floors) < POLICY.matters)
            ):
                continue
            later = self._later(stages, k, rival.score, last, rival)
            if later is None:
                continue
            key = gone.step.cause, gone.step.location
            self.progress(f"with {' at '.join(rival.candidate.key)} in place of {' at '.join(key)}: {last.score.figure:.3g}")
            self.exchanged[key] = rival.candidate.key
            sure = confidence(last.score, [now.score])
            found = stage_of(before.score, found_step(rival, gone.entries, before.score, set(), sure))
            return [*stages[:k], replace(found, paired=gone.paired), *later]
        return stages

    def _with_form(self, stages: list[SearchStage], k: int) -> list[SearchStage]:
        # The stages with the free shape of stage k exchanged for a form that its search has not fitted, if one comes close to it.
        gone, before, now = stages[k], stages[k - 1], stages[-1]
        if gone.step is None or gone.step.curve is None or gone.candidate is None:
            return stages
        known = {entry.candidate.key for entry in gone.entries}
        evidence, rung = self.evidence_of(before.fit.model), ladder(self.division.fits)[-1]
        starts = starts_from_curve(gone.candidate, gone.fit, gone.step.curve, before.fit, evidence, known)
        for candidate, rough in verified(starts, rung, self.progress):
            form = self._finished(candidate, rough)
            if form is None or vanishes(form) or not is_determined(form):
                continue
            alone = replace(now, fit=form.fit, score=form.score)
            last = alone if now is gone else self._refitted(stages, k, now, form)
            if last is None:
                continue
            if not form_stands(before.score.error, now.score.error, last.score.error, self.floors):
                continue
            sure = confidence(last.score, [entry.score for entry in gone.entries if entry.candidate.shape is None])
            found = stage_of(before.score, found_step(form, [*gone.entries, form], before.score, set(), sure))
            later = self._later(stages, k, form.score, last, form) if now is not gone else []
            if later is not None:
                return [*stages[:k], replace(found, paired=gone.paired), *later]
        return stages

    def _finished(self, candidate: Candidate, rough: Fit) -> Entry | None:
        # A candidate's fit to all fit data, with its score.
        with suppress(FitError):
            done = finished(rough, self.division.fits)
            return Entry(candidate=candidate, fit=done, score=score(done.model, self.division.judged))
        return None

    def _later(
        self, stages: Sequence[SearchStage], k: int, before: Score, last: SearchStage, rival: Entry | None = None
    ) -> list[SearchStage] | None:  # fmt: skip
        # All stages after stage k without its cause, or with a rival in place of it, which begin at the score `before`; the last
        # one is known.
        between = [self._refitted(stages, k, stage, rival) for stage in stages[k + 1 : -1]]
        found = [*(stage for stage in between if stage is not None), last]
        if len(found) <= len(between):
            return None
        figures = [before.figure, *(stage.score.figure for stage in found)]
        return [
            replace(now, step=now.step and rescored(now.step, pair, (stage.fit.model, now.fit.model)))
            for stage, now, pair in zip(stages[k + 1 :], found, pairwise(figures), strict=True)
        ]

    def _refitted(
        self, stages: Sequence[SearchStage], k: int, stage: SearchStage, rival: Entry | None = None
    ) -> SearchStage | None:  # fmt: skip
        # A stage after stage k refitted without the cause of that, or with a rival in place of it; None if that cannot be.
        rung = ladder(self.division.fits)[-1]
        starts = self._starts_without(stages, k, stage, rival)
        fits = [(candidate, fit) for candidate, free, model in starts if (fit := tried(model, free, rung))]
        candidate, rough = min(fits, key=lambda pair: pair[1].cost, default=(None, None))
        if rough is None:
            return None
        try:
            done = finished(rough, self.division.fits)
        except FitError:
            return None
        step = stage.step if candidate is None or stage.step is None else replace(stage.step, reported=candidate.reported)
        known = score(done.model, self.division.judged)
        return replace(stage, fit=widened(done), score=known, candidate=candidate or stage.candidate, step=step)

    def _starts_without(
        self, stages: Sequence[SearchStage], k: int, stage: SearchStage, rival: Entry | None
    ) -> list[tuple[Candidate | None, Sequence[Free], RigModel]]:
        # Starting points of a stage after stage k without the cause of that, or with a rival in place of it; its own candidate
        # is for another model if the place of its law in the list of a link's laws changes.
        before = stages[k - 1].fit
        extended = without_cause(before, stages[k].fit, stage.fit)
        if extended is not None:
            model, free = extended
            if rival is None:
                return [(None, free, model)]
            return [(None, *start[1:]) for start in with_cause(model, free, rival.candidate, rival.fit, self.evidence_of(model))]
        own = stage.candidate
        if stage is not stages[k + 1] or own is None or own.shape is not None:
            return []
        model = without_step(stage.fit, before)
        begun: list[tuple[Sequence[Free], RigModel]] = [(before.free, model)]
        if rival is not None:
            begun = [start[1:] for start in with_cause(model, before.free, rival.candidate, rival.fit, self.evidence_of(model))]
        return [start for free, each in begun for start in with_cause(each, free, own, stage.fit, self.evidence_of(each))]


def near_rivals(stage: SearchStage, floors: FloatArray) -> list[Entry]:
    """The other forms that came close to a step (`Policy.form_close`), the closest first."""
    step = stage.step
    assert step is not None
    near = [
        (apart, k, entry)
        for k, entry in enumerate(stage.entries)
        if entry.candidate.shape is None and entry.candidate.key != (step.cause, step.location)
        if (apart := ratio(entry.score.error, stage.score.error, floors)) < POLICY.form_close
    ]
    return [entry for _, _, entry in sorted(near)[:RIVALS]]


def _simpler(entry: Entry, stage: SearchStage) -> bool:
    # Whether a form is at the place of a stage's cause and simpler than that.
    candidate, own = entry.candidate, stage.candidate
    if own is None or candidate.location != own.location:
        return False
    return (candidate.rank, len(candidate.free)) < (own.rank, len(own.free))


def merged(stages: Sequence[SearchStage], floors: FloatArray) -> tuple[list[SearchStage], frozenset[tuple[str, str]]]:
    """The stages of a search without steps whose law a later one replaces, and the causes and places of those steps.

    The later cause takes the place of the earlier one in the order of the steps, too, and counts from the error before that.
    """
    found: list[SearchStage] = []
    gone: set[tuple[str, str]] = set()
    for stage in stages:
        k = next((k for k, earlier in enumerate(found) if _replaces(stage, earlier, floors)), None)
        if k is None:
            found.append(stage)
            continue
        step, earlier, others = stage.step, found[k].step, found[k + 1 :]
        assert step is not None
        assert earlier is not None
        gone.add((earlier.cause, earlier.location))
        sentence = f"It replaces {earlier.cause} at {earlier.location}, with which the error is {in_per_cent(earlier.after)}."
        after = earlier.after if others else step.after
        step = rescored(step, (earlier.before, after), (stage.fit.model, stage.fit.model))
        found[k] = replace(stage, fit=found[k].fit, score=found[k].score, step=replace(step, evidence=(*step.evidence, sentence)))
        found[-1] = replace(found[-1], fit=stage.fit, score=stage.score, paired=stage.paired)
    return found, frozenset(gone)


def _replaces(stage: SearchStage, before: SearchStage, floors: FloatArray) -> bool:
    # Whether the law of a stage's cause takes the place of that of an earlier one: the values of that are now its own, or gone. A
    # friction that generalizes another one there may be a refinement of it; if that alone is nearly as good, it counts, too.
    step, earlier = stage.step, before.step
    if step is None or earlier is None:
        return False
    if step.kind == earlier.kind == "friction_shape" and step.location == earlier.location:
        return ratio(before.score.error, stage.score.error, floors) > POLICY.form_close
    if stage.candidate is None or before.candidate is None:
        return False
    paths = [free.path for free in before.candidate.free]
    try:
        for path in paths:
            stage.fit.model.get(path)
    except ModelError:
        return True
    return not {free.path for free in stage.candidate.free}.isdisjoint(paths)
