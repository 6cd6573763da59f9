"""The whole diagnosis of a campaign: baseline, misfit, candidates, selection, verdict."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from isorig.analysis.campaign import Campaign, FloatArray
from isorig.analysis.deadline import Deadline, ask_time, keep_time, out_of_time, time_left, time_spent
from isorig.analysis.diagnose.budget import Budget, budget
from isorig.analysis.diagnose.causes.base import Evidence
from isorig.analysis.diagnose.chain_errors import in_words, with_chain_errors
from isorig.analysis.diagnose.considered import ConsideredCandidate, all_considered
from isorig.analysis.diagnose.early_answer import pointed
from isorig.analysis.diagnose.estimate_pairs import Doubles, doubles
from isorig.analysis.diagnose.evidence import Sign, record_signs, signs
from isorig.analysis.diagnose.exchanged import exchanged_sensors
from isorig.analysis.diagnose.guides import with_guides
from isorig.analysis.diagnose.kinds import SHAPED, kind_of
from isorig.analysis.diagnose.misfit import Discrepancy, at_first, discrepancies
from isorig.analysis.diagnose.observe import observe
from isorig.analysis.diagnose.policy import (
    POLICY,
    Stage,
    adequacy_threshold,
    explains_own_channel,
    may_be_noise,
    more_draws,
    step_counts,
    verdict,
)
from isorig.analysis.diagnose.required_force import ShownByForce, hidden_by_noise, noise_hides, shown_by_force
from isorig.analysis.diagnose.revise import Revision, SearchStage, merged, stage_of
from isorig.analysis.diagnose.search import Job, best_fits, next_step
from isorig.analysis.diagnose.step import Entry, Found, Step, updated, vanishes, with_evidence, without_form
from isorig.analysis.diagnose.suspects import BROKEN, SHOWN, Suspects, suspects
from isorig.analysis.equations.forms import fit_start, solved_values
from isorig.analysis.equations.ranking import ranking
from isorig.analysis.equations.system import Equations, equations_of
from isorig.analysis.errors import FitError, OutOfTimeError, SimulationError
from isorig.analysis.fitting.division import Divide, Division, beginnings, ends, refined
from isorig.analysis.fitting.excess import SIMULATION_LIMIT, is_adequate, log_excess, ratio, share_removed
from isorig.analysis.fitting.ladder import (
    bare_cost,
    baseline_fit,
    calibrated,
    finished,
    ladder,
    misfit,
    not_fitted,
    tried,
    widened,
    without,
    without_step,
)
from isorig.analysis.fitting.linear_spectra import spectra_of
from isorig.analysis.fitting.plausible import Doubt, doubts, doubts_of_records, explains_as_given, is_near
from isorig.analysis.fitting.preparation import prepare, zero_errors
from isorig.analysis.fitting.repeats import disturbance, with_disturbance
from isorig.analysis.fitting.residual_analysis import UNRELATED, depends_on_drive
from isorig.analysis.fitting.residuals import Problem
from isorig.analysis.fitting.score import (
    Improvement,
    Score,
    improvement,
    noise_floors,
    score,
    share_interval,
    surely_removes,
    worst,
)
from isorig.analysis.fitting.screen import Progress
from isorig.analysis.fitting.solve import Fit, base_parameters
from isorig.analysis.fitting.transfer_functions import BINS, fitted_to_transfer_functions
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.fitting.uncertainty import MOST_NOISE, assessed
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.simulate.natural import lowest_mode
from isorig.analysis.spectra.quality import faults
from isorig.analysis.spectra.zero_errors import wandering_in_words
from isorig.analysis.wording import in_per_cent, of_signal

#: Maximum number of steps; there is none while the records contradict the description.
MOST_STEPS = 3
#: Kinds of causes that may explain data with a wrong unit.
MAY_STAND_FOR_UNITS = {"sensor", "known_value"}
#: Doubts by the ratio of measured to predicted levels; and ratio of the largest residuals that the best explanations leave, with
#: the drive as described and with its factor corrected by that ratio, below which such a doubt is refuted. Chosen: with a wrong
#: unit it is far above one, with friction and a ripple in the rig as described 0.56.
OF_LEVELS, REFUTES = {"unit", "decade"}, 0.7
#: Time that is kept for what follows the search (uncertainties, evidence, page), and for evidence and page alone, as multiples of
#: the time in which runs and equations are prepared. Chosen: evidence and page took 0.4 to 2.4 times that time.
AFTER_SEARCH, AFTER_FITS = 5.0, 2.5
#: Largest share of the time left after preparing that is kept for it. Chosen: a first preparation may compile the simulation.
KEPT = 0.5
#: Seconds that a ranking of the equations may take if the search did not come to it, even if the limit is shorter. Chosen: short
#: records are ranked in this time, and without it there is no answer at all.
LEAST_RANKING = 2.0
#: What the evidence says of a remainder that counts as a disturbance.
DISTURBED = (
    f"Disturbance: what the model leaves, {{}} of the signal, is {UNRELATED}, so it counts as noise or as a disturbance from "
    "outside. Play one drive twice (repeat_of) to measure it."
)
#: The same of one that does so once small errors of all channels are fitted, too.
IN_CHAIN = (
    "Measuring chain: what follows the drive in the misfit of {} is within small errors of several channels together{}. "
    f"The rest is {UNRELATED}."
)


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """The result of a diagnosis.

    Parameters
    ----------
    verdict
        "adequate", "explained", "partly explained" or "unexplained".
    baseline, extended
        The fitted models before and after.
    discrepancies
        What the baseline gets wrong.
    steps
        The named causes, largest first.
    baseline_error, extended_error, floor
        Held-out error of baseline and extended model, and the noise floor.
    scores
        The held-out errors of both behind these, run by run and channel by channel.
    signs
        Evidence from the records compared with the baseline, before any cause is fitted.
    worst, enough, calibration
        The baseline's largest ratio of error to allowed error, its adequacy threshold, and the ratio of simulated data of the
        baseline itself (None if not needed).
    improvement
        Reduction of the error by the extension, with intervals.
    trials
        The runs.
    compared
        The same runs compared with the baseline's simulation.
    division
        The division into fitted and held-out data.
    shares
        For each step: share of the baseline's excess error that it removes (value, low, high).
    budgets
        For baseline and extended model: composition of their errors.
    considered
        Every candidate with its status.
    searched
        Every search for a step: the score before it, and the fully fitted candidates, without the derivatives of their fits.
    tolerance
        Error that counts as adequate, as a share of the signal.
    cut_short
        Whether the time limit ended the search for causes.
    residuals
        Residual over noise of each equation of motion of the records, for the rig as described; empty without equations.
    pointed
        Kind and place to which the equations of motion point, if no simulation confirms any cause.
    spread
        The largest contributions to an unexplained error by the equations of motion, as a sentence; empty if one stands out.
    doubts
        Implausible fitted values: check units and given values first.
    zero_errors
        A sentence on the accelerometers whose wrong or wandering zeros do not count; empty if there is none.
    required_force
        What confirms the cause if no simulation can follow the motion; None if simulations do.
    chain_errors
        Small errors of several channels with which the model explains all that follows the drive, one phrase each; None where
        these do not count.
    """

    verdict: str
    baseline: Fit
    extended: Fit
    discrepancies: tuple[Discrepancy, ...]
    steps: tuple[Step, ...]
    baseline_error: float
    extended_error: float
    floor: float
    scores: tuple[Score, Score]
    signs: tuple[Sign, ...]
    worst: float
    enough: float
    calibration: float | None
    improvement: Improvement
    trials: tuple[Trial, ...]
    compared: Doubles
    division: Division
    shares: tuple[tuple[float, float, float], ...]
    budgets: tuple[Budget, Budget]
    considered: tuple[ConsideredCandidate, ...]
    searched: tuple[tuple[Score, tuple[Entry, ...]], ...]
    tolerance: float
    cut_short: bool
    residuals: Mapping[str, float]
    pointed: tuple[str, str] | None
    spread: str
    doubts: tuple[Doubt, ...]
    zero_errors: str
    required_force: ShownByForce | None
    chain_errors: Sequence[str] | None


def diagnose(campaign: Campaign, model: RigModel, *, tolerance: float = 0.0, progress: Progress = lambda text: None) -> Diagnosis:
    """Fit the baseline, show its misfit, and identify the cause.

    The deadline in force (`isorig.analysis.deadline`) ends the search so early that what follows it ends in time, too. The answer
    is then what was found so far, at least by the equations of motion if `LEAST_RANKING` suffices, and `cut_short` states this.

    Parameters
    ----------
    campaign
        The measurement.
    model
        The baseline with starting values; its `free` parameters are fitted.
    tolerance
        Error, as a share of the signal, that counts as adequate.
    progress
        Called with a line for each stage, and before every fit of a candidate.

    Examples
    --------
    >>> import isorig as iso
    >>> found = iso.diagnose(iso.read("campaign.h5"), iso.wire_bonder())
    >>> found.verdict, found.steps
    ('adequate', ())
    """
    found = _at_described_places(campaign, model, tolerance, progress)
    guided = with_guides(model)
    if found.verdict == "adequate" or found.cut_short or out_of_time() or guided is model or _ends_well(found):
        return found
    progress("no described place explains the whole error; looking for friction on the ground where nothing joins a body to it")
    extended = [with_guides(found.extended.model)] if found.steps else []
    try:
        if not any(_rubs_at_a_guide(campaign, each, model) for each in (guided, *extended)):
            return found
    except OutOfTimeError:
        return replace(found, cut_short=True)
    again = _at_described_places(campaign, guided, tolerance, progress)
    added = {link.name for link in guided.links} - {link.name for link in model.links}
    there = [step.location for step in again.steps if step.location in added and step.kind == "friction_shape"]
    if not there or again.extended_error * POLICY.matters > found.extended_error:
        return found
    text = "Places: the description has no {}, but friction there, on the ground, explains the records; add this link."
    return replace(again, signs=(Sign(text=text.format(" and the ".join(there))), *again.signs))


def _rubs_at_a_guide(campaign: Campaign, guided: RigModel, model: RigModel) -> bool:
    # Whether the equations of motion show friction at a guide that the rig's description does not have, or cannot tell.
    equations = equations_of(campaign, guided)
    if equations.hidden:
        return True
    found = suspects(equations)
    added = {link.name for link in guided.links} - {link.name for link in model.links}
    return found is not None and any(found.includes("coulomb_friction", name) for name in added)


def _ends_well(found: Diagnosis) -> bool:
    # Whether the causes leave too little for a further one to count.
    return found.verdict == "explained" and found.extended_error <= POLICY.guides * found.baseline_error


def _at_described_places(campaign: Campaign, model: RigModel, tolerance: float, progress: Progress) -> Diagnosis:
    begun = time_spent()
    trials = prepare(campaign, model)
    progress(f"{len(trials)} runs prepared; fitting the baseline")
    equations = equations_of(campaign, model)
    residuals = equations.residuals()
    preparing = min(time_spent() - begun, KEPT * max(time_left(), 0.0) / AFTER_SEARCH)
    keep_time(AFTER_SEARCH * preparing)
    guess = fit_start(equations)
    starts = [guess, model]
    # Where motions are estimated, the transfer functions of the sensors that are there give better values than the equations.
    if equations.hidden:
        spectra = spectra_of(model, campaign, BINS)
        if (fitted := fitted_to_transfer_functions(model, base_parameters(model), spectra)) is not None:
            guess, starts = fitted, [fitted, *starts]
    try:
        trials, baseline = _baseline(starts, trials, misfits=_surely_misfits(equations, residuals))
        late = False
    except OutOfTimeError:
        baseline, late = not_fitted(guess), True
    # Records in wrong units, or exchanged, have no cause in the rig: they are to be corrected first.
    contradicted = () if explains_as_given(model, baseline) else _contradictions(campaign, model, equations)
    search = _Search(campaign, model, guess, equations, trials, progress, tolerance, most_steps=0 if contradicted else MOST_STEPS)
    search.cut_short = late
    found = search.causes(baseline, ends)
    # A search may have led the baseline to a better fit.
    baseline = found.stages[0].fit
    settled = search.cut_short or found.disturbed  # a disturbance is at the beginnings, too
    if found.verdict == "adequate" and not settled and search.begins_otherwise(baseline, found.enough):
        progress("the ends of the runs fit, but not their beginnings: the beginnings of some are held out from the fits")
        searched, search.entries = search.entries, []
        with search.until_the_time_ends():
            again = search.causes(widened(finished(baseline, beginnings(trials).fits)), beginnings)
            found = found if again.verdict == "adequate" else again
        if found.verdict == "adequate":
            search.entries = searched  # errors at the beginnings have another shape
    keep_time(AFTER_FITS * preparing)
    progress("computing the uncertainties")
    found = search.settled(found if contradicted else search.confirmed_by_force(found))
    found = search.with_hidden_by_noise(found)
    progress("gathering the evidence")
    stages, first, last = found.stages, found.stages[0], found.stages[found.kept]
    fine = tuple(refined(trial) for trial in trials)
    compared = [doubles(stage.fit.model, fine) for stage in stages[: max(found.kept, 1)]]
    shown_by_equations, blamed = search.shown_by_equations(found, contradicted=bool(contradicted))
    said = _said(found, campaign, fine, compared, blamed, cut_short=search.cut_short)
    by_force = found.required_force
    steps = (stage.step for stage in stages[1 : found.kept + 1])
    floor = search.stated_floor(last.fit.model, found.division.judged)
    considered = all_considered(
        search.entries, [stage.step for stage in stages[1 : found.kept + 1] if stage.step], found.replaced, found.exchanged,
        first.score, _allowed(found.quiet), first.fit.model, trials, shown_by_equations,
    )  # fmt: skip
    shown = at_first(found.division.judged, first.score.error, found.quiet) if found.division.beginnings else ()
    return Diagnosis(
        verdict=found.verdict, baseline=first.fit, extended=last.fit,
        discrepancies=(*shown, *discrepancies(campaign, first.fit.model, fine, compared[0])), compared=compared[0],
        steps=tuple(with_evidence(updated(step, last.fit), each) for step, each in zip(steps, said, strict=False) if step),
        baseline_error=first.score.figure, extended_error=last.score.figure, floor=floor, scores=(first.score, last.score),
        signs=said[0], worst=worst(first.score, _allowed(found.quiet)), enough=found.enough,
        calibration=found.calibration, improvement=improvement(first.score, last.score, floor), trials=fine,
        division=found.division,
        shares=tuple(
            (by_force.share,) * 3 if by_force is not None and after is last
            else share_interval(first.score, before.score, after.score, _allowed(found.quiet))
            for before, after in pairwise(stages[: found.kept + 1])
        ),
        budgets=(
            search.budget(first.fit.model, found.division, unrelated=found.disturbed and first is last),
            search.budget(last.fit.model, found.division, unrelated=found.disturbed),
        ),
        considered=by_force.considered(considered) if by_force is not None else considered,
        searched=tuple((before, tuple(_lean(entry) for entry in entries)) for before, entries in search.entries),
        tolerance=tolerance, cut_short=search.cut_short,
        residuals=residuals, pointed=shown_by_equations, spread=blamed.spread if blamed is not None else "",
        doubts=contradicted or _standing(_doubted(found, model, campaign), campaign, model, equations),
        zero_errors=wandering_in_words(zero_errors(campaign, model), lowest_mode(model)), required_force=by_force,
        chain_errors=found.chain_errors,
    )  # fmt: skip


def _said(
    found: _Found, campaign: Campaign, fine: Sequence[Trial], compared: Sequence[Doubles], blamed: Suspects | None, *,
    cut_short: bool,
) -> list[tuple[Sign, ...]]:  # fmt: skip
    # The evidence that each model leaves, that of the whole search with the first.
    last = found.stages[found.kept]
    if found.verdict == "adequate":  # nothing differs from the simulation
        said = [record_signs(campaign, last.fit.model, fine)]
    else:
        said = [signs(campaign, stage.fit.model, fine, each) for stage, each in zip(found.stages, compared, strict=False)]
    whole: list[str] = []
    if blamed is not None and blamed.clearly:
        ended, lost = "The time ended before a simulation confirmed it.", "No simulation with it follows the records."
        whole.append(f"Equations of motion: {blamed.clearly} {ended if cut_short else lost}")
    if found.chain_errors is not None:
        listed = ": " + ", ".join(found.chain_errors) if found.chain_errors else ", none of them large"
        whole.append(IN_CHAIN.format(of_signal(last.score.figure), listed))
    elif found.disturbed:
        whole.append(DISTURBED.format(in_per_cent(last.score.figure)))
    if found.required_force is not None:
        whole.append(found.required_force.sentence)
    said[0] = (*said[0], *(Sign(text=text) for text in whole))
    return said


def _surely_misfits(equations: Equations, residuals: Mapping[str, float]) -> bool:
    # Equations with estimated motions may also break because the values behind these are wrong.
    return not equations.hidden and max(residuals.values(), default=0.0) >= BROKEN


def _baseline(starts: Sequence[RigModel], trials: Sequence[Trial], *, misfits: bool) -> tuple[tuple[Trial, ...], Fit]:
    # The runs with the disturbance that they show, and the baseline fitted to them.
    fitted = baseline_fit(starts, trials, misfits=misfits)
    weighted = with_disturbance(fitted.model, trials)
    if any(trial.disturbance is not None for trial in weighted):
        fitted = finished(fitted, weighted)
    return weighted, widened(fitted)


def _contradictions(campaign: Campaign, model: RigModel, equations: Equations) -> tuple[Doubt, ...]:
    found = _standing(doubts_of_records(model, campaign), campaign, model, equations)
    if not found:
        with suppress(OutOfTimeError):
            return exchanged_sensors(campaign, model, equations)
    return found


def _standing(found: Sequence[Doubt], campaign: Campaign, model: RigModel, equations: Equations) -> tuple[Doubt, ...]:
    # The doubts without those that the equations of motion, with what explains them best, refute. Strong friction holds two
    # bodies together as a far stiffer link would, and moves levels as a drive in another unit would.
    drive = f"drive.{model.drive.channel}"
    if not any(doubt.parameter == drive or doubt.parameter.startswith("links.") for doubt in found):
        return tuple(found)
    blamed = None
    with suppress(OutOfTimeError):
        blamed = suspects(equations)
    values = solved_values(equations, blamed.chosen[0] if blamed is not None else None)

    def refuted(doubt: Doubt) -> bool:
        if doubt.parameter != drive or doubt.kind not in OF_LEVELS or blamed is None or not blamed.exact:
            return doubt.parameter in values and is_near(values[doubt.parameter], model.get(doubt.parameter))
        with suppress(OutOfTimeError):
            other = suspects(equations_of(campaign, model.replace({"drive.factor": model.drive.factor * doubt.ratio})))
            return other is not None and blamed.remains < REFUTES * other.remains
        return False

    return tuple(doubt for doubt in found if not refuted(doubt))


def _credible(found: _Found) -> tuple[Fit, ...]:
    # The fits whose values should be plausible. A baseline without the cause that explains the data may have any; but a sensor
    # fault or a wrong given value may stand for a wrong unit.
    first, last = found.stages[0].fit, found.stages[found.kept].fit
    kinds = {stage.step.kind for stage in found.stages[1 : found.kept + 1] if stage.step}
    return (last,) if found.verdict == "explained" and not kinds & MAY_STAND_FOR_UNITS else (first, last)


def _doubted(found: _Found, model: RigModel, campaign: Campaign) -> tuple[Doubt, ...]:
    # The doubts without those about the spring of a link whose force a named cause gives: its stiffness is a part of that.
    steps = [stage.step for stage in found.stages[1 : found.kept + 1] if stage.step]
    given = {f"links.{step.location}.stiffness" for step in steps if step.kind in ("spring_shape", "memory")}
    return tuple(doubt for doubt in doubts(model, _credible(found), campaign) if doubt.parameter not in given)


def _lean(entry: Entry) -> Entry:
    # The derivatives are as long as the campaign.
    return replace(entry, fit=replace(widened(entry.fit), jacobian=np.zeros((0, 0)), residual=np.zeros(0)))


@dataclass(frozen=True, kw_only=True)
class _Found:
    # Result of a search: division of the runs, intermediate models, how many of them count, their allowed errors, the causes
    # whose steps were replaced, those exchanged for others (cause and place of both), and what else shows the cause.
    division: Division
    stages: Sequence[SearchStage]
    verdict: str
    kept: int
    quiet: FloatArray
    enough: float
    calibration: float | None
    replaced: frozenset[tuple[str, str]]
    exchanged: Mapping[tuple[str, str], tuple[str, str]]
    required_force: ShownByForce | None = None
    disturbed: bool = False  #: Whether what the last model leaves counts as a disturbance (`_Search._only_disturbed`).
    chain_errors: Sequence[str] | None = None  #: Small errors of several channels with which alone it does, one phrase each.


#: Errors by model and held-out data, which are kept so that their identity stays theirs.
_Floors = dict[tuple[bytes, int], tuple[Sequence[Trial], FloatArray]]


class _Search:
    # The search for causes, from a fitted baseline.

    def __init__(
        self, campaign: Campaign, described: RigModel, guess: RigModel, equations: Equations, trials: Sequence[Trial],
        progress: Progress, tolerance: float, most_steps: int,
    ) -> None:  # fmt: skip
        self._most_steps = most_steps
        self._campaign, self._described, self._guess, self._trials, self._progress = campaign, described, guess, trials, progress
        self._equations = equations
        self._tolerance = tolerance
        self.entries: list[tuple[Score, tuple[Entry, ...]]] = []
        self.first: Job | None = None
        self.cut_short = False
        self._noise_floors: _Floors = {}
        self._disturbances: _Floors = {}
        self._related: dict[bytes, bool] = {}
        self._chained: dict[bytes, Fit | None] = {}  # with small errors of all channels

    def causes(self, baseline: Fit, divide: Divide) -> _Found:
        division = divide(self._trials)
        judged = division.judged
        stages = [SearchStage(fit=baseline, score=score(baseline.model, judged))]
        quiet = self._quiet(stages, judged)
        calibration = self._calibration(stages[0], divide, quiet)
        enough = adequacy_threshold(calibration)
        begun = None
        if not (self._most_steps == 0 or self._equations.hidden or self._ends(stages, quiet, enough)):
            begun = self._job(stages, division, _allowed(quiet), 1.0, forms_only=False)
            if (shown := self._by_required_force(begun, stages, division, enough, searched=False)) is not None:
                return shown
        stages, quiet, disturbed, chain_errors = self._searched(stages, division, quiet, enough, begun)
        if len(stages) > 1 and self._adequate(stages[0].score, _allowed(quiet), enough):
            # Where a cause makes the rig sensitive, noise on the drive may be as large as the baseline's error: that is no noise
            # of the baseline.
            quiet = self.floors([stages[0].fit.model], judged)
        quiet = np.maximum(quiet, stages[-1].score.error if disturbed else 0.0)
        word, named, replaced, exchanged = self._concluded(stages, division, _allowed(quiet), enough)
        return _Found(
            division=division, stages=named, verdict=word, kept=len(named) - 1, quiet=quiet, enough=enough,
            calibration=calibration, replaced=replaced, exchanged=exchanged, disturbed=disturbed,
            chain_errors=chain_errors,
        )  # fmt: skip

    def _searched(
        self, stages: list[SearchStage], division: Division, quiet: FloatArray, enough: float, begun: Job | None
    ) -> tuple[list[SearchStage], FloatArray, bool, Sequence[str] | None]:  # fmt: skip
        # The stages with a cause each, their floors, and whether the last one leaves a disturbance only, with which errors of the
        # measuring chain; the search may have begun with a job for the first.
        judged = division.judged
        tries, repeated, disturbed = 0, False, False
        chain_errors: Sequence[str] | None = None
        while len(stages) <= self._most_steps and not self._ends(stages, quiet, enough):
            now, floors = stages[-1], _allowed(quiet)
            self._progress(
                f"held-out error {in_per_cent(now.score.figure)}, noise floor {in_per_cent(float(np.median(quiet)))}; "
                "searching for a cause"
            )
            # The first search goes on with what the required force took from the equations.
            job = begun or self._job(stages, division, floors, self._left(stages, quiet), forms_only=repeated)
            disturbed, chain_errors = self._remainder(job, stages, division, floors, searched=False)
            begun, found = None, None if disturbed else self._next_step(job)
            if found is None:
                if not disturbed:
                    disturbed, chain_errors = self._remainder(job, stages, division, floors, searched=True)
                break
            if found.then is not None and self._adequate(found.entry.score, floors, enough):
                found = replace(found, then=None)  # the first of two suffices, once it starts from both
            step, last = found.step, found.then or found
            better, best = last.entry.fit, last.entry.score
            if found.then is None and self.cut_short and not found.shaped and not self._adequate(best, floors, enough):
                if not found.shown:
                    break  # the form may be merely the closest
                step = without_form(step, share_removed(now.score.error, best.error, floors))
                found = replace(found, step=step)
            moved = 0.0
            with self.until_the_time_ends():
                stages, moved = self._compared(stages, step, better, division, floors)
                quiet = self._quiet(stages, judged)
            now = stages[-1]
            fall = log_excess(now.score.error, floors) - log_excess(best.error, floors)
            if moved > max(POLICY.refitted, fall) and tries < MOST_STEPS:
                # The refit improved more than the cause: search for it again from the better fit.
                tries, repeated = tries + 1, step.form is not None
                continue
            if found.then is not None:
                stages += [stage_of(now.score, found), stage_of(found.entry.score, found.then)]
                self.entries.append((found.entry.score, found.then.entries))
                quiet = self._quiet(stages, judged)
                continue
            repeated = False
            stage = stage_of(now.score, found)
            if not (
                step_counts(_seen([*stages, stage]), len(stages), floors, enough)
                and explains_own_channel(now.score.error, best.error, floors, _of_sensors(step, judged[0].channels))
                and (len(stages) == 1 or surely_removes(now.score, best, floors))
            ):
                disturbed, chain_errors = self._remainder(job, stages, division, floors, searched=True)
                break
            # A cause may make the rig sensitive: then noise on the drive has a larger effect.
            stages.append(stage)
            quiet = self._quiet(stages, judged)
        return stages, quiet, disturbed, chain_errors

    def _remainder(
        self, job: Job, stages: Sequence[SearchStage], division: Division, floors: FloatArray, *, searched: bool
    ) -> tuple[bool, Sequence[str] | None]:  # fmt: skip
        # Whether what the last model leaves is a disturbance only, and small errors of several channels after which alone it is.
        if self.cut_short:
            return False, None
        if self._only_disturbed(job, searched=searched):
            return True, None
        errors = None
        with self.until_the_time_ends():
            errors = self._in_chain(job, stages, division, floors, searched=searched)
        return errors is not None, errors

    def _in_chain(
        self, job: Job, stages: Sequence[SearchStage], division: Division, floors: FloatArray, *, searched: bool
    ) -> Sequence[str] | None:  # fmt: skip
        # Not where motions are estimated with the values behind these errors, or what is left has one cause.
        if job.now.figure >= MOST_NOISE or job.equations.hidden or self._is_explained(job, searched=searched):
            return None
        known = job.current.model.encoded
        if known not in self._chained:
            self._chained[known] = with_chain_errors(job.current, division.fits)
        fitted = self._chained[known]
        if fitted is None or self._is_related(fitted.model):
            return None
        last = replace(stages[-1], fit=fitted, score=score(fitted.model, division.judged))
        rest = self._job([*stages, last], division, floors, job.left, forms_only=True)
        return None if self._is_explained(rest, searched=searched) else in_words(job.current, fitted, division.fits)

    def _only_disturbed(self, job: Job, *, searched: bool) -> bool:
        # Whether what a model leaves is a disturbance from outside, or noise: related to neither the drive nor the motion, and no
        # explanation removes it from the equations of motion.
        if job.now.figure >= MOST_NOISE:
            return False
        disturbed = False
        questions = [partial(self._is_explained, job, searched=searched), partial(self._is_related, job.current.model)]
        # The search for a cause needs the ranking, too; not where bodies have no sensors, where it takes most of the time.
        if job.equations.hidden:
            questions.reverse()
        with self.until_the_time_ends():
            disturbed = not any(question() for question in questions)
        return disturbed

    @staticmethod
    def _is_explained(job: Job, *, searched: bool) -> bool:
        # Whether an explanation removes what a model leaves from the equations of motion. Hum is a disturbance, too, where
        # several channels have it, or no search has confirmed it as a cause.
        several = searched or len(job.evidence.mains) > 1
        explained = [item for item in ranking(job.equations).explanations if not (several and item.what == "hum")]
        return bool(explained) and explained[0].score >= SHOWN

    def _is_related(self, model: RigModel) -> bool:
        # Whether what a model leaves is related to the drive or the motion, computed once.
        if model.encoded not in self._related:
            self._related[model.encoded] = depends_on_drive(model, [refined(trial) for trial in self._trials])
        return self._related[model.encoded]

    def _by_required_force(
        self, job: Job, stages: Sequence[SearchStage], division: Division, enough: float, *, searched: bool
    ) -> _Found | None:  # fmt: skip
        # The cause that the required force shows if no simulation can follow the motion, or, after the search, none does.
        shown = None
        with self.until_the_time_ends(), suppress(SimulationError):  # a motion that grows without bound
            shown = shown_by_force(job, searched=searched)
        if shown is None:
            return None
        both = [stages[0], stage_of(stages[0].score, shown.found)]
        self.entries.append((stages[0].score, shown.found.entries))
        return _Found(
            division=division, stages=both, verdict="partly explained" if searched else "explained", kept=1, enough=enough,
            calibration=None, quiet=self._quiet(both, division.judged), replaced=frozenset(), exchanged={}, required_force=shown,
        )  # fmt: skip

    def confirmed_by_force(self, found: _Found) -> _Found:
        """A search without an answer, with the cause that the required force shows instead, if there is one."""
        if found.verdict != "unexplained" or self._equations.hidden or self.first is None or self.cut_short or out_of_time():
            return found
        shown = self._by_required_force(self.first, found.stages, found.division, found.enough, searched=True)
        return found if shown is None else shown

    def with_hidden_by_noise(self, found: _Found) -> _Found:
        """An adequate model with a further cause that noise hides from its simulation, if the equations of motion show one."""
        last, floors = found.stages[found.kept], _allowed(found.quiet)
        ended = self.cut_short or out_of_time() or found.disturbed or found.division.beginnings or found.kept >= self._most_steps
        if ended or not (noise_hides(floors) and self._adequate(last.score, floors, found.enough)):
            return found
        shown = None
        with self.until_the_time_ends(), suppress(SimulationError):  # a motion that grows without bound
            shown = hidden_by_noise(self._job(found.stages, found.division, floors, 0.0, forms_only=False))
        if shown is None:
            return found
        stage = stage_of(last.score, shown.found)
        self.entries.append((last.score, shown.found.entries))
        return replace(
            found, stages=[*found.stages, replace(stage, fit=last.fit.with_values_of(stage.fit))], kept=found.kept + 1,
            verdict="explained", required_force=shown,
        )  # fmt: skip

    def _concluded(
        self, stages: Sequence[SearchStage], division: Division, floors: FloatArray, enough: float
    ) -> tuple[str, list[SearchStage], frozenset[tuple[str, str]], Mapping[tuple[str, str], tuple[str, str]]]:  # fmt: skip
        # The verdict, the stages that count, the causes whose steps were replaced, and those exchanged for others.
        word, kept = verdict(_seen(stages), floors, enough, self._tolerance)
        named, replaced = merged(stages[: kept + 1], floors)
        revision = Revision(
            division=division, floors=floors, enough=enough, tolerance=self._tolerance, evidence_of=self._evidence_of,
            progress=self._progress,
        )  # fmt: skip
        revised = named
        with self.until_the_time_ends():
            revised = revision.revised(named)
        if revised is not named:
            word, kept = verdict(_seen(revised), floors, enough, self._tolerance)
            named = revised[: kept + 1]
        return word, named, replaced, revision.exchanged

    def _evidence_of(self, model: RigModel) -> Evidence:
        # What the records show of a model without a fit.
        return observe(self._campaign, model, self._trials, self._described, self._guess)

    def _ends(self, stages: Sequence[SearchStage], quiet: FloatArray, enough: float) -> bool:
        # Whether the last stage is adequate, or a free shape that leaves little.
        step = stages[-1].step
        shaped = step is not None and step.form is None and self._left(stages, quiet) < POLICY.rest
        return shaped or self._adequate(stages[-1].score, _allowed(quiet), enough)

    @staticmethod
    def _left(stages: Sequence[SearchStage], quiet: FloatArray) -> float:
        # Share of the baseline's excess that the last stage leaves.
        return 1.0 - share_removed(stages[0].score.error, stages[-1].score.error, _allowed(quiet))

    def _next_step(self, job: Job) -> Found | None:
        # The next step, if there is one; what each candidate removes is kept in any case.
        found = None
        with self.until_the_time_ends():
            ask_time()
            found = next_step(job)
        fitted = found.entries if found else tuple(best_fits(job.judged, job.floors))
        if fitted:
            self.entries.append((job.now, fitted))
        return found

    def _job(
        self, stages: Sequence[SearchStage], division: Division, floors: FloatArray, left: float, *, forms_only: bool
    ) -> Job:  # fmt: skip
        step = stages[-1].step
        job = Job(
            campaign=self._campaign, described=self._described, guess=self._guess, current=stages[-1].fit, now=stages[-1].score,
            equations=self._equations_for(stages), trials=division.fits, fine=division.judged, floors=floors,
            progress=self._progress, left=left, steps=self._most_steps - len(stages) + 1, forms_only=forms_only,
            allowed=lambda model: _allowed(self.floors([model], division.judged)),
            rubbing=step.location if step and step.kind == "friction_shape" else "",
            curved=(step.kind, step.location) if step and step.form is None and step.kind in SHAPED else None,
        )  # fmt: skip
        self.first = self.first or job
        return job

    def _equations_for(self, stages: Sequence[SearchStage]) -> Equations:
        # Bodies without sensors are estimated with fitted values, which a given rig has not.
        given = len(stages) == 1 and not self._equations.hidden
        return self._equations if given else equations_of(self._campaign, stages[-1].fit.model)

    def _compared(
        self, stages: list[SearchStage], step: Step, better: Fit, division: Division, floors: FloatArray
    ) -> tuple[list[SearchStage], float]:  # fmt: skip
        # The stages with the last one as it is without the step; and its improvement, which is infinite where from there the
        # steps before it are superfluous, too.
        last, moved = self._without(step, better, stages[-1], division, floors)
        if moved > POLICY.refitted and len(stages) > 1:
            before = stages[1].step
            assert before is not None
            first, improved = self._without(before, last.fit, stages[0], division, floors)
            if improved > POLICY.refitted:
                return [first], np.inf
        return [*stages[:-1], last], moved

    def _without(
        self, step: Step, better: Fit, now: SearchStage, division: Division, floors: FloatArray
    ) -> tuple[SearchStage, float]:
        # The model without a step, refitted from the parameters after it: the stage from now on if it improved by more than
        # `Policy.refitted`; and the improvement. The parameters as they are, where they fit no worse, or the first seconds of the
        # runs tell whether there may be one.
        model = without_step(better, now.fit)
        predicts = log_excess(now.score.error, floors) - log_excess(score(model, division.judged).error, floors) > POLICY.refitted
        if not (predicts and _fits_no_worse(model, now.fit.model, Problem(division.fits))):
            rung = ladder(division.fits)[-1]
            glance = tried(model, now.fit.free, rung)
            before = bare_cost(now.fit, rung)
            if glance is None or 0.5 * np.log(before / glance.cost) <= 0.5 * POLICY.refitted:
                return now, 0.0
        bare = without(better, now.fit, division.fits)
        plain = score(bare.model, division.judged)
        moved = log_excess(now.score.error, floors) - log_excess(plain.error, floors)
        if moved <= POLICY.refitted:
            return now, moved
        self._progress(f"without {step.cause} the same parameters reach {plain.figure:.3g}")
        return replace(now, fit=widened(bare), score=plain), moved

    @contextmanager
    def until_the_time_ends(self) -> Iterator[None]:
        """A part of the search; once the time has ended, what was fitted until then is the answer."""
        with suppress(OutOfTimeError):
            yield
        self.cut_short = out_of_time()

    def _adequate(self, found: Score, floors: FloatArray, enough: float) -> bool:
        return is_adequate(found.error, floors, enough, self._tolerance)

    def _quiet(self, stages: Sequence[SearchStage], judged: Sequence[Trial]) -> FloatArray:
        # The noise floor of the stages' models; the first of two causes is no model without the second.
        return self.floors([stage.fit.model for stage in stages if not stage.paired], judged)

    def floors(self, models: Sequence[RigModel], judged: Sequence[Trial]) -> FloatArray:
        """The noise floor of models in held-out data, shape (runs, channels).

        Noise counts as in the model most sensitive to it; a disturbance is what no model explains of the difference between
        repeated runs, for example one with a drift.
        """
        noise = np.max([self._noise_floors_of(model, judged)[0] for model in models], axis=0)
        return np.asarray(np.hypot(noise, np.min([self._disturbance(model, judged) for model in models], axis=0)))

    def _disturbance(self, model: RigModel, judged: Sequence[Trial]) -> FloatArray:
        return _once(self._disturbances, model, judged, lambda: disturbance(model, judged))

    def stated_floor(self, model: RigModel, judged: Sequence[Trial]) -> float:
        """The error that noise and disturbance alone typically cause: the median over runs and channels."""
        return float(np.median(np.hypot(self._noise_floors_of(model, judged)[1], self._disturbance(model, judged))))

    def _noise_floors_of(self, model: RigModel, judged: Sequence[Trial]) -> FloatArray:
        return _once(self._noise_floors, model, judged, lambda: noise_floors(model, judged))

    def settled(self, found: _Found) -> _Found:
        """The search with the last model at its minimum, and the uncertainty of its values; without time it stays as it is."""
        last, fits = found.stages[found.kept], [refined(trial) for trial in found.division.fits]
        if self.cut_short or out_of_time() or not last.fit.free or found.required_force is not None:
            return found
        try:
            judged = found.division.judged
            same = len(judged) == len(fits) and not found.division.beginnings
            floors = self.floors([last.fit.model], judged)
            fit = assessed(last.fit, fits, self._campaign.known, floors if same else None).fit
        except (OutOfTimeError, FitError):
            return found
        # The refined values differ by less than their uncertainty, so noise passes through them alike.
        self._noise_floors[fit.model.encoded, id(judged)] = judged, self._noise_floors_of(last.fit.model, judged)
        stage = replace(last, fit=fit, score=score(fit.model, judged))
        if ratio(stage.score.error, last.score.error, _allowed(floors)) > POLICY.matters:
            # A minimum that predicts less is that of a few events; the values before it have the same uncertainty.
            stage = replace(last, fit=replace(fit, model=last.fit.model))
        if stage.step is not None and stage.step.form is not None and stage.candidate is not None:
            entry, before = Entry(candidate=stage.candidate, fit=fit, score=stage.score), found.stages[found.kept - 1].score
            if vanishes(entry):  # the refined values are less certain
                share = share_removed(before.error, stage.score.error, _allowed(floors))
                stage = replace(stage, step=without_form(stage.step, share))
        return replace(found, stages=[*found.stages[: found.kept], stage])

    def shown_by_equations(self, found: _Found, *, contradicted: bool) -> tuple[tuple[str, str] | None, Suspects | None]:
        """Kind and place to which the equations of motion point where no cause is named, and the suspects behind them."""
        by_equations = found.verdict == "unexplained" and not self._equations.hidden
        points = found.verdict == "unexplained" and (by_equations or self.cut_short) and not contradicted
        shown, blamed = None, None
        with suppress(OutOfTimeError), Deadline(max(time_left(), LEAST_RANKING)):
            shown = pointed(self._equations) if points else None
            blamed = self.first.suspects if by_equations and self.first is not None else None
        if blamed is not None and blamed.clearly and not contradicted:
            shown = shown or blamed.clear
        return shown, blamed

    def begins_otherwise(self, fitted: Fit, enough: float) -> bool:
        judged = beginnings(self._trials).judged
        if not judged:
            return False
        floors = _allowed(self.floors([fitted.model], judged))
        if self._adequate(score(fitted.model, judged), floors, enough):
            return False
        # A rig that moved before its record started may differ at the beginning for that reason.
        bad = {f.run for f in faults(self._campaign, reference=fitted.model.drive.channel) if f.kind == "not at rest"}
        return all(trial.run.id not in bad for trial in judged)

    def budget(self, model: RigModel, division: Division, *, unrelated: bool) -> Budget:
        """Composition of a model's error, of which the part that is not assigned may be `unrelated` to the drive."""
        return budget(model, division.judged, self._noise_floors_of(model, division.judged)[0], unrelated=unrelated)

    def _calibration(self, stage: SearchStage, divide: Divide, quiet: FloatArray) -> float | None:
        # Only needed near the noise; a rig judged by its drive has no simulated motion.
        floors = _allowed(quiet)
        measured = worst(stage.score, floors)
        if not may_be_noise(measured) or any(trial.motion for trial in self._trials):
            return None
        self._progress("not far above the noise; determining the error of simulated data of the baseline itself")
        draws: list[float] = []
        with self.until_the_time_ends():
            while more_draws(measured, draws):
                draws.append(calibrated(stage.fit, self._trials, divide, floors, len(draws)))
        return max(draws, default=None)


def _fits_no_worse(model: RigModel, other: RigModel, problem: Problem) -> bool:
    return misfit(model, problem) <= misfit(other, problem)


def _once(known: _Floors, model: RigModel, judged: Sequence[Trial], compute: Callable[[], FloatArray]) -> FloatArray:
    # The errors of a model in held-out data, computed once.
    key = model.encoded, id(judged)
    if key not in known:
        known[key] = judged, compute()
    return known[key][1]


def _allowed(quiet: FloatArray) -> FloatArray:
    return np.asarray(np.hypot(quiet, SIMULATION_LIMIT))


def _seen(stages: Sequence[SearchStage]) -> list[Stage]:
    seen: list[Stage] = []
    rubbing: set[str] = set()
    for stage in stages:
        step = stage.step
        if step is None:
            seen.append(Stage(error=stage.score.error))
            continue
        # A contact has one friction law: a further one there is a generalization.
        refines = step.kind == "friction_shape" and step.location in rubbing
        seen.append(
            Stage(
                error=stage.score.error, place=step.location, kind=step.kind, certain=is_certain(step), refines=refines,
                paired=stage.paired, shown=stage.shown,
            )
        )  # fmt: skip
        if step.kind == "friction_shape":
            rubbing.add(step.location)
    return seen


def is_certain(step: Step) -> bool:
    """Whether a step's kind and place are certain: it beats every rival of another kind or place, and a free shape bounds it."""
    apart = any((kind_of(cause), place) != (step.kind, step.location) for cause, place in step.indistinguishable)
    return step.confidence >= POLICY.certain and not apart and step.kind in SHAPED


def _of_sensors(step: Step, channels: Sequence[str]) -> list[int]:
    # Columns of the channel whose sensor the step changes; none if it changes anything else.
    return [k for k, name in enumerate(channels) if step.kind == "sensor" and step.location == name]
