"""The cause of a rig's change: causes are fitted to a campaign after the change, with the earlier fit as the baseline."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from isorig.analysis.campaign import Campaign, FloatArray
from isorig.analysis.diagnose.causes import proposed
from isorig.analysis.diagnose.observe import observe
from isorig.analysis.errors import AnalysisError, FitError
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.residuals import Problem
from isorig.analysis.fitting.screen import Screen, ScreenedCandidate, shortened
from isorig.analysis.fitting.solve import Fit, Free, base_parameters, fit
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.trends.policy import POLICY

#: Maximum steps of a fit.
STEPS = 10


@dataclass(frozen=True, kw_only=True)
class CauseOfChange:
    """A cause of a change."""

    #: From the catalogue; or the last word of a parameter's path and its part, if a parameter of the baseline has changed.
    cause: str
    location: str
    #: The parameter's path, or its name in the catalogue, with its unit; the unit of a path is determined by the caller.
    parameter: str
    unit: str
    #: Its value before (NaN if the cause was absent) and after, with the standard uncertainty of the latter.
    old: float
    new: float
    std: float
    #: Sum of the squared weighted residuals with it, of squared distances from the earlier fit in standard deviations, and for
    #: each of its own parameters the logarithm of the number of residuals (Schwarz 1978).
    misfit: float
    share: float = 0.0  #: Reduction of the misfit relative to that by the best cause.
    alike: bool = False  #: Whether the data cannot distinguish it from the best.


class ProblemWithPriors(Problem):
    """The residuals of a campaign, with the earlier fit as further residuals: distances in standard deviations.

    `known` are the parameters of the earlier fit that may scatter: fitted parameter, its search coordinate, and its standard
    deviation there.
    """

    def __init__(self, trials: Sequence[Trial], known: Sequence[tuple[Free, float, float]]) -> None:
        super().__init__(trials)
        self._known = tuple(known)
        self.measured = self.size
        self.size += len(self._known)
        self.sizes = (*self.sizes, len(self._known))

    def residuals(self, models: Sequence[RigModel]) -> FloatArray:
        """Weighted residuals of several models, shape (models, size)."""
        return np.hstack([super().residuals(models), np.array([[self._distance(m, *k) for k in self._known] for m in models])])

    def misfit(self, done: Fit, changed: Mapping[str, float], own: int) -> float:
        """The misfit of a cause with some parameters of its own, see `CauseOfChange`; `changed` as for `unaccounted`."""
        return float(done.cost * self.size + own * np.log(self.size)) + self.unaccounted(done.model, changed)

    def unaccounted(self, model: RigModel, changed: Mapping[str, float]) -> float:
        """What more campaigns than this one add to the squared distances of the parameters that have changed.

        `changed` has the standard uncertainty of each change, in search coordinates.
        """
        better = [(one, changed[one[0].path]) for one in self._known if changed.get(one[0].path, np.inf) < one[2]]
        return sum(self._distance(model, *one) ** 2 * ((one[2] / std) ** 2 - 1.0) for one, std in better)

    @staticmethod
    def _distance(model: RigModel, free: Free, before: float, deviation: float) -> float:
        try:
            return (free.encode(model.get(free.path)) - before) / deviation
        except AnalysisError:  # a cause may replace a part of the rig
            return 0.0


def explanations(
    campaign: Campaign, earlier: RigModel, scatter: Mapping[str, float], *, today: Mapping[str, float],
    changed: Mapping[str, float],
) -> tuple[CauseOfChange, ...]:  # fmt: skip
    """Possible changes between an earlier fit and a campaign, best first; empty if scatter alone explains the campaign.

    Every parameter of the baseline alone, and every cause of the catalogue, is fitted to the campaign, while all others keep
    their values of the earlier fit, within their campaign-to-campaign scatter.

    Parameters
    ----------
    campaign
        The campaign after the change.
    earlier
        The rig as fitted before; its free parameters may scatter.
    scatter
        Campaign-to-campaign standard deviation of those parameters, by path: relative for a positive one.
    today
        The same parameters as fitted to this campaign alone, where the fits start: from the earlier values they may not converge.
    changed
        Parameters that have changed according to more campaigns than this one, by path: standard uncertainties of their changes
        in search coordinates. Each is an explanation even if this campaign alone would not show it, and another explanation
        must account for the change: what it leaves of it is judged by these uncertainties.

    Raises
    ------
    FitError
        The earlier fit cannot be simulated on the campaign.
    """
    trials = prepare(campaign, earlier)
    short = shortened(trials, POLICY.compared_seconds)
    free = base_parameters(earlier)
    known = [(f, f.encode(earlier.get(f.path)), _deviation(f, scatter)) for f in free]
    whole = ProblemWithPriors(short, known)
    still = fit(earlier.replace(today), free, whole, iterations=STEPS)
    found = []
    for one in known:
        freed = ProblemWithPriors(short, [k for k in known if k is not one])
        done = fit(still.model, free, freed, iterations=STEPS)
        path = one[0].path
        _, place, *_, last = path.split(".")
        found.append(
            CauseOfChange(
                cause=last, location=place, parameter=path, unit="", old=earlier.get(path), new=done.values[path],
                std=done.std[path], misfit=freed.misfit(done, changed, 1),
            )
        )  # fmt: skip
    evidence = observe(campaign, still.model, trials, earlier, earlier)
    with np.errstate(all="ignore"):  # a cause that does not fit may diverge
        screened = Screen(still, whole).ranked(list(proposed(still.model, evidence)))
    distinct: dict[tuple[str, str], ScreenedCandidate] = {}
    for item in screened:
        distinct.setdefault(item.candidate.key, item)
    for item in list(distinct.values())[: POLICY.fitted_causes]:
        candidate, first = item.candidate, item.candidate.reported[0]
        tried = _fitted(item, earlier, candidate.parameters(still.model, free), whole)
        if tried is not None and candidate.plausible(tried.model):
            found.append(
                CauseOfChange(
                    cause=candidate.cause, location=candidate.location, parameter=first.name, unit=first.unit, old=np.nan,
                    new=first.of(tried.model), std=tried.std.get(first.path, np.nan),
                    misfit=whole.misfit(tried, changed, len(candidate.free)),
                )
            )  # fmt: skip
    return _judged(found, still.cost * whole.size, whole.measured, changed)


def _fitted(item: ScreenedCandidate, earlier: RigModel, free: Sequence[Free], problem: ProblemWithPriors) -> Fit | None:
    # The scattering parameters may be biased by the missing effect: then the fit starts from the earlier values as well.
    own = {f.path for f in item.candidate.free}
    done = None
    for start in (item.models[0], item.models[0].replace({f.path: earlier.get(f.path) for f in free if f.path not in own})):
        try:
            # A cause that does not fit may diverge; it is then no explanation.
            with np.errstate(all="ignore"):
                new = fit(start, free, problem, iterations=STEPS)
        except FitError:  # it cannot be simulated there
            continue
        done = new if done is None or new.cost < done.cost else done
        if done.cost * problem.size <= problem.measured:
            break
    return done


def _deviation(free: Free, scatter: Mapping[str, float]) -> float:
    return max(scatter.get(free.path, POLICY.unknown_scatter if free.log else 100.0 * free.step), 1e-3 * free.step)


def _judged(found: Sequence[CauseOfChange], unchanged: float, size: int, suspected: Collection[str]) -> tuple[CauseOfChange, ...]:
    clear = 2.0 * float(np.log(POLICY.likelihood_ratio))
    likely = (item for item in found if item.misfit < unchanged - clear or item.parameter in suspected)
    ordered = sorted(likely, key=lambda item: item.misfit)
    if not ordered:
        return ()
    best = ordered[0].misfit
    # If even the best leaves more than noise, residuals are correlated, and only a clear difference counts.
    enough = clear if best <= size else max(clear * best / size, POLICY.better * best)
    gone = max(unchanged - best, 1e-12)
    return tuple(
        replace(item, share=max(1.0 - (item.misfit - best) / gone, 0.0), alike=bool(item.misfit - best <= enough))
        for item in ordered
    )
