"""The verdict's rules: every threshold with its meaning and source, and the decisions as functions of errors alone.

Errors are held-out errors by run and channel, rms(predicted - measured) / rms(measured); floors are the errors of a perfect
model, of the same shape. The excess is the mean square of an error above its floor.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.fitting.excess import ADEQUATE, excess, is_adequate, log_excess, pooled, ratio, share_removed


@dataclass(frozen=True, kw_only=True)
class Policy:
    """The thresholds of a diagnosis."""

    #: Adequacy threshold: a model is adequate if its largest ratio of error to floor, over runs and channels, is below this.
    #: Chosen by the study: 406 campaigns without an effect stayed below it.
    enough: float = ADEQUATE
    explained: float = 0.8  #: Share of the baseline's excess that the steps must remove for "explained" (findings, version 2).
    #: Rms excess error, as a share of the signal, above which a model that is not adequate is at most "partly explained". Chosen:
    #: what a reader sees at once in records and simulation; the right causes of a measured friction damper leave less.
    visible: float = 0.2
    #: Share of the baseline's median error over runs and channels that such a model may leave, if it is not noise, without being
    #: at most "partly explained". Chosen: an error that is most of what it was is not explained, though one channel had more.
    typical: float = 0.7
    #: Share of it that certain steps must remove for "partly explained". More than half: no other single cause can then remove as
    #: much. (Findings, version 2, call a cause a main contributor from 0.3 on; this is its status.)
    contributes: float = 0.5
    #: Share from which a candidate is a main contributor (findings, version 2): less makes no form the closest to a curve.
    main: float = 0.3
    certain: float = 0.95  #: Share of resampled runs in which a cause must beat its rivals: 1.96 standard errors.
    #: Ratio of rms errors above which a difference between rivals is relevant: rivals with a smaller ratio are indistinguishable,
    #: even if the difference is significant. Chosen: other starting values or time steps of a fit change the error by a few per
    #: cent.
    matters: float = 1.05
    #: Share of the remaining excess, or decrease of the errors' mean logarithm, above which a step is tried further. Chosen by
    #: the study.
    worth: float = 0.15
    #: Share of the baseline's excess below which the search ends after a free shape: the error of a curve with finitely many
    #: points.
    rest: float = 0.1
    #: Share of the baseline's excess that a further step must remove unless it makes the model adequate, or explains what
    #: remained (`explained`) and removes what may have another cause (`settled`) at another place.
    later: float = 0.03
    #: Share of the remaining excess that it must remove then; at a place that already has a step.
    of_rest: float = 0.5
    of_rest_here: float = 0.8
    form_share: float = 0.9  #: Share of what the free shape removes that a form must remove too (findings, version 2).
    #: Standard errors over runs by which a form's error may exceed the free shape's (findings, version 2).
    form_errors: float = 4.0
    #: Share of the excess below which the error remaining after a form has another cause, or is due to its form: then neither
    #: pairs of causes nor free shapes of other kinds and places are fitted, and no further cause at its place counts. Chosen: a
    #: tenth of the error; forms of the wrong kind leave several per cent.
    settled: float = 0.01
    #: Ratio of rms errors up to which a form counts as within those standard errors, however small they are. Chosen as `matters`,
    #: a few per cent, and twice that because a curve with many points also fits small imperfections in every run.
    form_alike: float = 1.1
    #: Ratio of rms errors up to which a form is as good as the free shape. Chosen: a free shape also fits small imperfections and
    #: its error is up to a third smaller than that of the true form; the error of forms that are merely the closest is twice as
    #: large and more.
    form_close: float = 1.5
    #: Difference in standard errors over blocks above which a form's rival is worse: 95 % of a normal variable.
    form_apart: float = 2.0
    #: Standard uncertainties within which a value that may have either sign is zero: 95 % of a normal variable.
    zero: float = 2.0
    #: Rivals above this multiple of the adequacy threshold are distinguishable from an adequate form, even if only few blocks
    #: show the difference. Chosen: a short event raises only the largest error and leaves most blocks unchanged.
    distinguishable: float = 1.5
    #: Multiple of the adequacy threshold up to which the baseline's largest error may be due to the scatter of the floor, so that
    #: data simulated with the baseline are fitted and scored for comparison. Chosen: this takes a fit, so only near the
    #: threshold.
    doubtful: float = 4.0
    #: Maximum number of such draws, and ratio of the largest to the smallest from two draws on below which no more are taken.
    #: Where noise decides when a body sticks, draws differed by a factor of four. Chosen: each draw takes a fit; the largest of
    #: five exceeds five sixths of all draws on average.
    calibrations: int = 5
    scatter: float = 1.25
    #: Required ratio of the measured error to that of such simulated data. Chosen: one draw of such data scatters.
    beyond_calibration: float = 1.2
    #: Share of the baseline's error above which causes at described places leave room for friction on the ground where the
    #: description joins nothing. Chosen: what a reader still sees.
    guides: float = 0.1
    #: Decrease of the errors' mean logarithm above which a model refitted from the parameters after a step is a different model.
    #: Chosen: a tenth, about twice the value of `matters`.
    refitted: float = 0.1


POLICY = Policy()


def wins(best: FloatArray, rivals: Sequence[FloatArray], *, draws: int = 1000) -> float:
    """Share of resampled runs in which a model's pooled square error is below that of every rival.

    Parameters
    ----------
    best, rivals
        Square errors by independent unit (run, or block of time if there are few runs), shape (units,).
    draws
        Number of resamplings.
    """
    if not rivals:
        return 1.0
    picks = np.random.default_rng(11).integers(0, len(best), (draws, len(best)))
    own = best[picks].sum(axis=1)
    return float(np.mean([own <= rival[picks].sum(axis=1) for rival in rivals], axis=1).min())


def form_stands(before: FloatArray, shape: FloatArray, form: FloatArray, floors: FloatArray, policy: Policy = POLICY) -> bool:
    """Whether the error of a form is within the uncertainty of that of the free shape of its kind at its place."""
    if share_removed(before, form, floors) < policy.form_share * share_removed(before, shape, floors):
        return False
    behind = ratio(form, shape, floors)
    if behind > policy.form_close:
        return False
    worse = np.sqrt(pooled(form, floors)) - np.sqrt(pooled(shape, floors))
    spread = float(np.std(worse, ddof=1) / np.sqrt(len(worse))) if len(worse) > 1 else np.inf
    return behind <= policy.form_alike or bool(np.mean(worse) <= policy.form_errors * spread)


def rivals_alike(best: FloatArray, rival: FloatArray, floors: FloatArray, behind: float, policy: Policy = POLICY) -> bool:
    """Whether the data cannot distinguish a form's rival, worse by `behind` standard errors over blocks, from it."""
    adequate = is_adequate(best, floors, policy.enough)
    if adequate and not is_adequate(rival, floors, policy.distinguishable * policy.enough):
        return False
    return behind < policy.form_apart or ratio(rival, best, floors) < policy.matters


def explains_own_channel(
    before: FloatArray, after: FloatArray, floors: FloatArray, own: Sequence[int], policy: Policy = POLICY
) -> bool:
    """Whether a sensor fault explains its own channels, not only the effect of a faulty channel on the rest of a fit.

    `own` are the columns of the faulty sensors' channels; a cause that is no sensor fault has none.
    """
    if not own:
        return True
    left = [log_excess(error[:, list(own)], floors[:, list(own)]) for error in (before, after)]
    return left[0] - left[1] >= policy.worth * left[0]


def may_be_noise(worst: float, policy: Policy = POLICY) -> bool:
    """Whether a model's largest error relative to its floor may be due to the floor's scatter: a calibration is needed."""
    return policy.enough <= worst < policy.doubtful * policy.enough


def more_draws(worst: float, draws: Sequence[float], policy: Policy = POLICY) -> bool:
    """Whether another draw of simulated data is needed to decide whether a model's largest error may be due to noise.

    The error, and those of the data simulated so far, are relative to their floors.
    """
    if not draws:
        return True
    if worst < adequacy_threshold(max(draws), policy) or len(draws) >= policy.calibrations:
        return False
    return len(draws) < 2 or max(draws) >= policy.scatter * min(draws)


def adequacy_threshold(calibration: float | None, policy: Policy = POLICY) -> float:
    """The threshold for these data: the policy's, or higher after data simulated with the model itself (None: not needed)."""
    return max(policy.enough, policy.beyond_calibration * (calibration or 0.0))


def is_superfluous(
    without: FloatArray, present: FloatArray, floors: FloatArray, enough: float, tolerance: float = 0.0, policy: Policy = POLICY
) -> bool:  # fmt: skip
    """Whether the causes found after a cause leave it nothing to explain, by the errors of the last model refitted without it."""
    return is_adequate(without, floors, enough, tolerance) or ratio(without, present, floors) < policy.matters


def explains_better(
    other: FloatArray, present: FloatArray, floors: FloatArray, enough: float, tolerance: float = 0.0, policy: Policy = POLICY
) -> bool:  # fmt: skip
    """Whether a model with another cause is clearly better: it alone is adequate, or its error is lower by `Policy.refitted`."""
    if is_adequate(present, floors, enough, tolerance):
        return False
    return (
        is_adequate(other, floors, enough, tolerance) or log_excess(present, floors) - log_excess(other, floors) > policy.refitted
    )


@dataclass(frozen=True, kw_only=True)
class Stage:
    """An intermediate model of a diagnosis, as needed for the verdict."""

    error: FloatArray  #: Its held-out errors, shape (runs, channels).
    #: Place and kind of the step that led to it; empty for the baseline.
    place: str = ""
    kind: str = ""
    #: Whether that step beats every rival of another kind or place, and a free shape bounds what any law of its kind can explain:
    #: without a bound, the closest of few guesses may remove much and still be wrong.
    certain: bool = True
    refines: bool = False  #: Whether that step replaces the law of an earlier step there by a more general one of its kind.
    #: Whether that step and the next one belong together: neither makes the model adequate without the other.
    paired: bool = False
    shown: bool = False  #: Whether the equations of motion of the records show that step's kind and place, and no other.


def step_counts(stages: Sequence[Stage], k: int, floors: FloatArray, enough: float, policy: Policy = POLICY) -> bool:
    """Whether the step to stage k adds something to the stages before it."""
    whole, now, then = (excess(stages[i].error, floors) for i in (0, k - 1, k))
    there = [stage for stage in stages[1:k] if stage.place == stages[k].place]
    here, own = bool(there), any(not _apart(stages[k].kind, stage.kind) for stage in there)
    if own and not stages[k].refines and now < policy.settled * whole:
        # What a form leaves at its own place may be due to its form, unless the equations show that it is of another kind,
        # which leaves nothing.
        another = stages[k].kind not in {stage.kind for stage in there}
        return another and stages[k].shown and is_adequate(stages[k].error, floors, enough)
    if k == 0 or is_adequate(stages[k].error, floors, enough):
        return True
    if stages[k].paired and k + 1 < len(stages):
        both = stages[k + 1].error
        if is_adequate(both, floors, enough) or share_removed(stages[k - 1].error, both, floors) >= policy.explained:
            return True
    if k == 1:
        # Disturbances may be most of the excess; a cause that the equations show is confirmed by a decrease everywhere, too.
        decrease = log_excess(stages[0].error, floors) - log_excess(stages[1].error, floors) if stages[1].shown else 0.0
        return now - then >= policy.worth * whole or decrease >= policy.worth
    if stages[k].refines or stages[k].shown:
        return now - then >= policy.worth * now
    explains = not here and now - then >= policy.explained * now
    of_whole = policy.settled if explains else policy.later
    of_rest = policy.of_rest_here if here else policy.of_rest
    return now - then >= of_whole * whole and now - then >= of_rest * now


def _apart(kind: str, other: str) -> bool:
    # Whether what a form of one kind leaves cannot be due to its form and look like the other: forces over deflection and over
    # velocity.
    return {kind, other} in ({"spring_shape", "friction_shape"}, {"spring_shape", "damping_shape"})


def verdict(
    stages: Sequence[Stage], floors: FloatArray, enough: float, tolerance: float = 0.0, policy: Policy = POLICY
) -> tuple[str, int]:
    """The verdict on the baseline and the models after each step, and the number of steps that it keeps."""
    first = stages[0].error
    if is_adequate(first, floors, enough, tolerance):
        return "adequate", 0
    counted = next((k - 1 for k in range(1, len(stages)) if not step_counts(stages, k, floors, enough, policy)), len(stages) - 1)
    if counted and is_adequate(stages[counted].error, floors, enough, tolerance):
        return "explained", counted
    if counted and share_removed(first, stages[counted].error, floors) >= policy.explained:
        visible = excess(stages[counted].error, floors) > policy.visible**2
        before, after, floor = (float(np.median(each)) for each in (first, stages[counted].error, floors))
        remains = visible or (after >= enough * floor and after > policy.typical * before)
        return "partly explained" if remains else "explained", counted
    certain = next((k - 1 for k in range(1, counted + 1) if not stages[k].certain), counted)
    if certain and share_removed(first, stages[certain].error, floors) >= policy.contributes:
        return "partly explained", certain
    # Disturbances may be most of the error: the equations show a cause that is less than half of it.
    shown = next((k - 1 for k in range(1, counted + 1) if not stages[k].shown), counted)
    if shown:
        return "partly explained", shown
    return "unexplained", 0
