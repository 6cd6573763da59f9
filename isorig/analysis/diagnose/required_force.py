"""A cause that the required force shows where no simulation follows the motion, or noise hides the cause from the simulation.

Play, stops and other strong nonlinearities can make a motion so sensitive that noise in the recorded drive alone changes a
simulation of the true rig by as much as the signal, or as much as a further cause does; or no fit finds the values with which
a simulation follows. Then no simulation confirms or refutes a cause. The force that the recorded motion requires at a link does,
sample by sample: the values of a cause follow from its first part in every run, and the rest shows how much of it the cause
leaves.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.diagnose.considered import ConsideredCandidate
from isorig.analysis.diagnose.policy import POLICY
from isorig.analysis.diagnose.search import Job
from isorig.analysis.diagnose.step import Entry, Found, curve_of, found_step
from isorig.analysis.diagnose.suspects import Suspects
from isorig.analysis.equations.balances import Element
from isorig.analysis.equations.forms import ElementForce, fitted_form, force_left
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.excess import ratio
from isorig.analysis.fitting.held_out import FIT_SHARE
from isorig.analysis.fitting.ladder import STAYS
from isorig.analysis.fitting.score import score
from isorig.analysis.fitting.solve import Fit, Free
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.wording import in_per_cent

#: Noise floor of a model, as a share of the signal, from which no simulation of it can follow the motion. Chosen: two simulations
#: that differ by noise alone have lost half of the motion.
SENSITIVE = 0.5
#: Share of the required force that a cause may leave on held-out samples to be named. Chosen: as `LITTLE` of a curve.
REMAINS = 0.3
#: Number of parts of the samples of a fit, each left out once for the uncertainty of its values (jackknife; Efron 1982).
PARTS = 6
#: Share of the required force that a model must leave for a cause without a simulation. Chosen: errors of sensors are smaller.
VISIBLE = 0.05
#: Noise floor of an adequate model, as a share of the signal, from which it may hide a further cause. Chosen: as `VISIBLE`.
HIDES = VISIBLE
#: Why the required force decides.
CANNOT_FOLLOW = "No simulation can follow this motion, which noise alone changes as much as any cause."
DOES_NOT_FOLLOW = "No simulation with this cause follows the records."
HIDDEN = "The simulation is as close to the records as noise allows, but noise alone changes it by {}, which hides this cause."


@dataclass(frozen=True, kw_only=True)
class ShownByForce:
    """A cause that the required force shows on held-out samples."""

    found: Found
    before: float  #: Share of the required force that the model without the cause leaves.
    after: float  #: That which the model with it leaves.
    noise: float  #: That which no cause explains, since the curve there leaves it, too; 0 if it does not count.
    reason: str  #: Why no simulation decides.
    follows: bool = False  #: Whether a simulation follows the motion nonetheless, and noise hides the cause from it.

    @property
    def share(self) -> float:
        """Share of the mean square force left by the model without the cause, above noise, that the cause removes."""
        return 1.0 - (_above(self.after, self.noise) / _above(self.before, self.noise)) ** 2

    def considered(self, candidates: Sequence[ConsideredCandidate]) -> tuple[ConsideredCandidate, ...]:
        """All considered candidates, the cause with what the required force says of it."""
        named = self.found.entry.candidate.key
        return tuple(
            one if (one.cause, one.location) != named
            else replace(one, standing="established", share=self.share, why=self.sentence)
            for one in candidates
        )  # fmt: skip

    @property
    def sentence(self) -> str:
        """What was compared, and why no simulation."""
        noise = f" (noise alone is {in_per_cent(self.noise)})" if self.noise else ""
        return (
            f"{self.reason} So the force that the recorded motion requires at "
            f"{self.found.step.location} was compared, sample by sample: without the cause the model leaves "
            f"{in_per_cent(self.before)} of it, with it {in_per_cent(self.after)}{noise}, on the last "
            f"{100.0 * (1.0 - FIT_SHARE):.0f} % of every run."
        )


def _above(share: float, noise: float) -> float:
    return float(np.sqrt(max(share**2 - noise**2, 0.0)))


def shown_by_force(job: Job, *, searched: bool) -> ShownByForce | None:
    """The cause that the equations of motion show alone and that explains the force that the records require there.

    Before the search for causes only one that no simulation can follow; after it has found none, `searched`, any: then as a kind
    at a place, with its curve.
    """
    suspects = job.suspects
    if suspects is None or suspects.clear is None:
        return None
    chosen = _chosen(job, suspects, form=not searched)
    if chosen is None:
        return None
    start = suspects.started(chosen, job.current.free)[0]
    stays = score(start, job.fine).figure < STAYS  # a simulation that follows the records can follow them
    sensitive = not stays and float(np.median(job.floors)) < SENSITIVE <= float(np.median(job.allowed(start)))
    return _by_force(job, suspects, chosen, CANNOT_FOLLOW if sensitive else DOES_NOT_FOLLOW) if sensitive or searched else None


def noise_hides(floors: FloatArray) -> bool:
    """Whether noise may hide a further cause from an adequate model with these noise floors, shape (runs, channels)."""
    return float(np.median(floors)) >= HIDES


def hidden_by_noise(job: Job) -> ShownByForce | None:
    """A further cause that the equations of motion of an adequate model show alone, where noise hides it from the simulation.

    The simulation with the cause must not be worse.
    """
    suspects = job.suspects
    chosen = _chosen(job, suspects, form=True) if suspects is not None and suspects.clear is not None else None
    if suspects is None or chosen is None or chosen.shape is not None:
        return None
    shown = _by_force(job, suspects, chosen, HIDDEN.format(in_per_cent(float(np.median(job.floors)))), follows=True)
    worse = shown is None or ratio(shown.found.entry.score.error, job.now.error, job.floors) > POLICY.matters
    return None if worse else shown


def _by_force(
    job: Job, suspects: Suspects, chosen: Candidate, reason: str, *, follows: bool = False
) -> ShownByForce | None:  # fmt: skip
    # A candidate whose values follow from the first part of the required force, if it explains the rest. Where a simulation
    # `follows` and noise hides the cause from it, the force may have much noise, too.
    recorded = suspects.recorded(chosen)
    if recorded is None:
        return None
    (element, force), start = recorded, suspects.started(chosen, job.current.free)[0]
    early = force.until(FIT_SHARE)
    if early.all() or not early.any():  # samples near reversals of a sliding contact do not count
        return None
    free, first, later = chosen.parameters(start, job.current.free), force.part(early), force.part(~early)
    bare, solved = fitted_form(job.current.model, job.current.free, element, first), fitted_form(start, free, element, first)
    if bare is None or solved is None:
        return None
    size = float(np.std(later.force)) or 1.0
    before = force_left(job.current.model.replace(bare.values), element, later, bare.offset) / size
    after = force_left(start.replace(solved.values), element, later, solved.offset) / size
    noise = float(np.sqrt(np.mean(later.left**2))) / size if follows else 0.0
    if (visible := _above(min(before, 1.0), noise)) < VISIBLE or _above(after, noise) > REMAINS * visible:
        return None
    fitted = _with_uncertainty(start.replace(solved.values), tuple(f for f in free if f.path in solved.values), element, first)
    entry = Entry(candidate=chosen, fit=fitted, score=score(fitted.model, job.fine))
    curve = curve_of(chosen, fitted, job.evidence)
    found = found_step(entry, [entry], job.now, set(), 1.0, curve=curve)
    shown = ShownByForce(
        found=replace(found, shown=True), before=before, after=after, noise=noise, reason=reason, follows=follows
    )  # fmt: skip
    return replace(shown, found=replace(shown.found, step=replace(found.step, evidence=(shown.sentence,))))


def _chosen(job: Job, suspects: Suspects, *, form: bool) -> Candidate | None:
    # The simplest form, if one is wanted, that leaves as little of the recorded force as any curve, or the curve.
    current = job.current
    forms = [
        one for one in (suspects.candidates(current, job.evidence) if form else ())
        if suspects.shown(*one.key) and suspects.stands(one, current, job.evidence)
    ]  # fmt: skip
    if forms:
        return min(forms, key=lambda one: (one.rank, len(one.free)))
    curve = suspects.curve(current, job.evidence)
    return curve[0] if curve is not None and suspects.shown(*curve[0].key) else None


def _with_uncertainty(model: RigModel, own: tuple[Free, ...], element: Element, force: ElementForce) -> Fit:
    # The values, with their uncertainty from fits without one part each.
    parts = np.array_split(np.argsort(force.time), PARTS)
    without = (fitted_form(model, own, element, force.part(~np.isin(np.arange(len(force.time)), part))) for part in parts)
    values = np.array([[again.values[f.path] for f in own] for again in without if again is not None])
    spread = values - values.mean(axis=0)
    covariance = (len(values) - 1.0) / len(values) * spread.T @ spread
    return Fit(model=model, free=own, covariance=covariance, cost=np.nan, evaluations=0)
