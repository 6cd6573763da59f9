"""Candidate fits: a short first fit of every candidate, a full fit of the best."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import ModelError
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.residuals import Problem
from isorig.analysis.fitting.solve import Fit, at_coordinates, coordinates_of, damped_step
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.lowpass import fast_length
from isorig.analysis.model.rig_model import RigModel

Progress = Callable[[str], None]
#: Maximum simulation steps per sample of a short fit.
SHORT_OVERSAMPLE = 4
#: Maximum number of a candidate's starting points that are evaluated, and used in the elimination.
MOST_STARTS, RACED = 4, 2
#: Trusted range of the linear extrapolation to a starting point, in distances to it.
BEYOND = 3.0
#: Candidates evaluated more closely: the best of all, and the best of each family.
CLOSER, CLOSER_OF_FAMILY = 8, 2


@dataclass(frozen=True, kw_only=True)
class ScreenedCandidate:
    """Prediction of a short fit for a candidate: mean square weighted residual, and the models it reached, best first."""

    candidate: Candidate
    cost: float
    models: tuple[RigModel, ...]


def shortened(trials: Sequence[Trial], seconds: float) -> tuple[Trial, ...]:
    """The same trials for a short fit: `seconds` from the drive's onset on, on a coarser grid."""

    def cut(trial: Trial) -> Trial:
        fitted = fast_length(round(min(trial.fitted, trial.onset + seconds * trial.sample_rate)))
        coarse = trial.excitation.resampled(min(trial.excitation.oversample, SHORT_OVERSAMPLE))
        begins = trial.moving.measured.shape[1] if trial.moving is not None else 0  # the records that tell the state at the start
        return replace(trial, fitted=fitted, excitation=coarse.beginning(max(fitted, begins)))

    return tuple(cut(trial) for trial in trials)


class Screen:
    """Short fits of candidates from a fitted model, with the model's own derivatives computed once.

    The derivatives with respect to the model's parameters change little when a cause is added, so a candidate costs one
    simulation per new parameter and step instead of one per parameter.
    """

    def __init__(self, current: Fit, problem: Problem) -> None:
        self.current = current
        self.problem = problem
        self._span = np.linalg.qr(current.jacobian)[0]

    def ranked(self, candidates: Sequence[Candidate]) -> list[ScreenedCandidate]:
        """All candidates, best first: one step for each, and some more for the promising ones."""
        first = sorted((self.screen(candidate) for candidate in candidates), key=lambda item: item.cost)
        met: dict[str, int] = {}
        screened = []
        for place, item in enumerate(first):
            family = item.candidate.family
            met[family] = met.get(family, 0) + 1
            close = place < CLOSER or met[family] <= CLOSER_OF_FAMILY
            screened.append(self._closer(item) if close and item.cost < np.inf else item)
        return sorted((item for item in screened if item.cost < np.inf), key=lambda item: item.cost)

    def screen(self, candidate: Candidate) -> ScreenedCandidate:
        """One step from the candidate's first starting point, the closest to the current model, and from the most promising."""
        starts = candidate.starts
        residuals = self.problem.residuals(starts)
        reached = self._reached(residuals)
        order = dict.fromkeys([0, *np.argsort(reached)[: MOST_STARTS - 1].tolist()])
        screened = sorted((self._descend(candidate, starts[k], residuals[k], 1) for k in order), key=lambda item: item.cost)
        # For a starting point far from the current model, use the linear extrapolation to it; a step from there falls short.
        promised = min(screened[0].cost, float(reached.min()) / self.problem.size)
        return ScreenedCandidate(candidate=candidate, cost=promised, models=tuple(item.models[0] for item in screened[:RACED]))

    def _reached(self, residuals: FloatArray) -> FloatArray:
        # Remaining error after a linear step of the current parameters and along the line to each starting point and beyond.
        span = self._span
        here, away = (r - (r @ span) @ span.T for r in (self.current.residual, residuals - self.current.residual))
        length = (away**2).sum(axis=1)
        far = np.clip(-(away @ here) / np.maximum(length, 1e-300), 0.0, BEYOND)
        left = here @ here + 2.0 * far * (away @ here) + far**2 * length
        return np.where(np.isfinite(left), left, np.inf)

    def _closer(self, item: ScreenedCandidate) -> ScreenedCandidate:
        first, *others = item.models
        closer = self._descend(item.candidate, first, self.problem.residuals([first])[0], 2)
        return replace(item, cost=min(closer.cost, item.cost), models=(*closer.models, *others))

    def _descend(self, candidate: Candidate, start: RigModel, residual: FloatArray, steps: int) -> ScreenedCandidate:
        free = candidate.parameters(self.current.model, self.current.free)
        base = [f for f in free if f not in candidate.free]
        columns = [self.current.free.index(f) for f in base]
        known = self.current.jacobian[:, columns]
        theta = coordinates_of(start, free)

        def build(coordinates: FloatArray) -> RigModel | None:
            try:
                return at_coordinates(start, free, coordinates)
            except ModelError:
                return None

        def cost_of(models: Sequence[RigModel | None]) -> list[FloatArray]:
            whole = [model for model in models if model is not None]
            found = iter(self.problem.residuals(whole)) if whole else iter(())
            return [next(found) if model is not None else np.full(self.problem.size, np.nan) for model in models]

        best = float(residual @ residual)
        if not np.isfinite(best):
            return ScreenedCandidate(candidate=candidate, cost=np.inf, models=(start,))
        for _ in range(steps):
            moved = []
            for i in range(len(base), len(free)):
                other = theta.copy()
                other[i] += free[i].step
                moved.append(build(other))
            fresh = np.array(cost_of(moved)) - residual
            fresh = np.nan_to_num(fresh / np.array([f.step for f in candidate.free])[:, None]).T
            jacobian = np.hstack([known, fresh])
            normal = jacobian.T @ jacobian
            if not np.all(np.isfinite(normal)):  # the motion diverges
                break
            gradient = jacobian.T @ residual
            before = best
            for damping in (1e-3, 1.0):
                step = damped_step(normal, gradient, damping)
                worst = max((abs(s) / 0.9 for s, f in zip(step, free, strict=True) if f.log), default=0.0)
                there = np.array([f.encode(f.decode(c)) for f, c in zip(free, theta + step / max(worst, 1.0), strict=True)])
                found = cost_of([build(there)])[0]
                cost = float(found @ found)
                if np.isfinite(cost) and cost < best:
                    theta, residual, best = there, found, cost
                    break
            if best > 0.999 * before:
                break
        reached = build(theta)
        return ScreenedCandidate(
            candidate=candidate,
            cost=best / self.problem.size,
            models=(reached if reached is not None else start,),
        )
