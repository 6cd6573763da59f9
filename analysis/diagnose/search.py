"""Candidate fits: a short look at every candidate, a full fit of the best."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnose.mechanisms.base import Candidate
from analysis.errors import ModelError
from analysis.fit import Fit, Free, Problem, base_parameters
from analysis.measured import FloatArray
from analysis.model import RigModel
from analysis.trials import Trial

Progress = Callable[[str], None]
#: Starts of a candidate that are followed; of more, those with the least misfit.
MOST_STARTS = 4


@dataclass(frozen=True, kw_only=True)
class Look:
    """What a short fit made of a candidate: mean square weighted residual, and the model it reached."""

    candidate: Candidate
    cost: float
    model: RigModel


def shortened(trials: Sequence[Trial], seconds: float) -> tuple[Trial, ...]:
    """The same trials with fits limited to their first seconds."""
    return tuple(replace(t, fitted=min(t.fitted, round(seconds * t.run.sample_rate))) for t in trials)


def parameters_of(model: RigModel, candidate: Candidate, known: Sequence[Free] = ()) -> tuple[Free, ...]:
    """What is fitted of a candidate: the current model's parameters and the candidate's own."""
    kept = known or base_parameters(model)
    own = {free.path for free in candidate.free}
    return (
        *(free for free in kept if free.path not in candidate.dropped and free.path not in own),
        *candidate.free,
    )


class Screen:
    """Looks at candidates from a fitted model, with the model's own derivatives taken once.

    The derivatives with respect to the model's parameters change little when a cause is added, so a candidate costs a
    simulation per new parameter and step instead of one per parameter.
    """

    def __init__(self, current: Fit, problem: Problem) -> None:
        self.current = current
        self.problem = problem
        self.cost = current.cost

    def look(self, candidate: Candidate, *, steps: int = 2) -> Look:
        """One step from each of the candidate's starts, a few more from the best."""
        starts = candidate.starts
        if len(starts) > MOST_STARTS:
            costs = [float(r @ r) for r in self.problem.residuals(starts)]
            order = np.argsort(np.nan_to_num(costs, nan=np.inf))
            starts = tuple(starts[k] for k in order[:MOST_STARTS])
        looks = [self._descend(candidate, start, 1) for start in starts]
        best = min(looks, key=lambda look: look.cost)
        return self._descend(candidate, best.model, steps) if best.cost < np.inf else best

    def _descend(self, candidate: Candidate, start: RigModel, steps: int) -> Look:
        free = parameters_of(self.current.model, candidate, self.current.free)
        base = [f for f in free if f not in candidate.free]
        columns = [self.current.free.index(f) for f in base]
        known = self.current.jacobian[:, columns]
        theta = np.array([f.encode(start.get(f.path)) for f in free])

        def build(coordinates: FloatArray) -> RigModel | None:
            try:
                return start.replace({f.path: f.decode(c) for f, c in zip(free, coordinates, strict=True)})
            except ModelError:
                return None

        def cost_of(models: Sequence[RigModel | None]) -> list[FloatArray]:
            whole = [model for model in models if model is not None]
            found = iter(self.problem.residuals(whole)) if whole else iter(())
            return [next(found) if model is not None else np.full(self.problem.size, np.nan) for model in models]

        model = build(theta)
        residual = cost_of([model])[0]
        best = float(residual @ residual)
        if model is None or not np.isfinite(best):
            return Look(candidate=candidate, cost=np.inf, model=start)
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
            scale = np.diag(normal).copy()
            scale[scale <= 0.0] = 1.0
            gradient = jacobian.T @ residual
            tries = []
            for damping in (1e-3, 1.0):
                step = -np.linalg.solve(normal + damping * np.diag(scale), gradient)
                worst = max((abs(s) / 0.9 for s, f in zip(step, free, strict=True) if f.log), default=0.0)
                step = step / max(worst, 1.0)
                tries.append(np.array([f.encode(f.decode(c)) for f, c in zip(free, theta + step, strict=True)]))
            results = cost_of([build(t) for t in tries])
            costs = [float(r @ r) if np.all(np.isfinite(r)) else np.inf for r in results]
            k = int(np.argmin(costs))
            if costs[k] >= best * (1 - 1e-3):
                break
            theta, residual, best = tries[k], results[k], costs[k]
        reached = build(theta)
        return Look(
            candidate=candidate,
            cost=best / self.problem.size,
            model=reached if reached is not None else start,
        )
