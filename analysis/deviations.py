"""How well a fit knows its values: how far each spectral line of the residual moves them.

Noise in the recorded drive reaches all channels of a line together, and lines of a stationary residual are independent
whatever its autocorrelation. So the values are worked out once without each line, all channels of it (the jackknife, to first
order the HC3 of MacKinnon and White 1985). Where few lines carry a value, its deviation is itself uncertain, and grows to what
Student's distribution with that many degrees of freedom needs (Satterthwaite 1946, as Bell and McCaffrey 2002).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnose.fits import NARROW
from analysis.fit import Fit, Problem, fit
from analysis.measured import FloatArray
from analysis.trials import Trial

#: Rounds of fits with finer differences, and the relative gain in cost from which one more is worth it.
ROUNDS, GAIN = 4, 1e-5
#: Bounds of the relative size of a finite difference.
FINEST, COARSEST = 1e-6, 1e-3
#: A value whose whole size changes the residual by less than this, in deviations of the noise, leaves no trace in the data.
TRACE = 2.0
#: Shares of a friction force that leaves no trace because nothing slides against it: the data may slide all the same.
SMALLER = np.geomspace(0.95, 0.05, 30).tolist()


def polished(done: Fit, trials: Sequence[Trial]) -> Fit:
    """A fit taken to where its cost is least to a small part of a deviation, its finite differences as small as its deviations.

    A step of a deviation is seen against the noise by one in the cost, of as many as there are lines; fits that compare models
    stop long before.
    """
    problem = Problem(trials, share=NARROW)
    for _ in range(ROUNDS):
        size = {path: abs(value) or 1.0 for path, value in done.values.items()}
        free = tuple(
            replace(f, step=float(np.clip(done.std[f.path] / size[f.path], FINEST, COARSEST))) if f.log else f for f in done.free
        )
        before = done.cost
        done = fit(done.model, free, problem, iterations=8, tolerance=GAIN / 10.0)
        if before - done.cost <= GAIN * before:
            break
    return done


def untraced(done: Fit) -> frozenset[str]:
    """Paths of the fitted values that leave no trace in the data, so that nothing is known of them."""
    sizes = np.sqrt((done.jacobian**2).sum(axis=0))
    return frozenset(f.path for f, size in zip(done.free, sizes, strict=True) if f.log and size < TRACE)


def awakened(done: Fit, trials: Sequence[Trial]) -> Fit:
    """The fit, begun again from a smaller friction where its own lets nothing slide, if that explains the data better."""
    problem = Problem(trials, share=NARROW)
    for path in sorted(path for path in untraced(done) if path.endswith("friction_force")):
        smaller = [done.model.replace({path: share * done.values[path]}) for share in SMALLER]
        costs = np.nan_to_num((problem.residuals(smaller) ** 2).mean(axis=1), nan=np.inf)
        begun = fit(smaller[int(np.argmin(costs))], done.free, problem, iterations=12, tolerance=1e-3)
        done = min(done, begun, key=lambda f: f.cost)
    return done


def line_moves(done: Fit, trials: Sequence[Trial]) -> FloatArray:
    """How far leaving out each spectral line would move the fitted values, shape (lines, values), in the values' units."""
    scale = np.maximum(np.sqrt((done.jacobian**2).sum(axis=0)), 1e-300)
    jacobian = done.jacobian / scale
    bread = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-12, hermitian=True)
    scores = []
    ends = np.cumsum(done.sizes)
    for trial, start, end in zip((t for t in trials if t.fitted), ends - np.array(done.sizes), ends, strict=True):
        # Real and imaginary parts of all channels, line by line.
        rows = 2 * len(trial.channels)
        own = jacobian[start:end].reshape(rows, -1, len(scale)).transpose(1, 0, 2)
        residual = done.residual[start:end].reshape(rows, -1).T
        left = np.eye(rows) - np.einsum("kap,pq,kbq->kab", own, bread, own, optimize=True)
        alone = np.linalg.solve(left + 1e-9 * np.eye(rows), residual[:, :, None])
        scores.append(np.einsum("kap,ka->kp", own, alone[:, :, 0]))
    slope = np.array([done.model.get(f.path) if f.log else 1.0 for f in done.free])
    return np.asarray(np.concatenate(scores) @ bread / scale * slope)


def grid_shift(done: Fit, trials: Sequence[Trial]) -> FloatArray:
    """How far a simulation on twice as fine a grid would move the fitted values, shape (values,), in their units."""
    finer = tuple(replace(t, excitation=t.excitation.resampled(2 * t.excitation.oversample)) for t in trials)
    change = Problem(finer, share=NARROW).residuals([done.model])[0] - done.residual
    scale = np.maximum(np.sqrt((done.jacobian**2).sum(axis=0)), 1e-300)
    jacobian = done.jacobian / scale
    moved = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-12, hermitian=True) @ (jacobian.T @ np.nan_to_num(change)) / scale
    return np.asarray(moved * [done.model.get(f.path) if f.log else 1.0 for f in done.free])


def deviation(moves: FloatArray, slope: FloatArray) -> float:
    """Standard deviation of a figure that goes with the fitted values by `slope`, shape (values,); see `line_moves`."""
    from scipy.stats import t

    own = (moves @ slope) ** 2
    whole = float(own.sum())
    if whole == 0.0:
        return 0.0
    # Of a normal variable the fourth moment is three times the second one's square.
    degrees = 3.0 * whole**2 / float((own**2).sum())
    return float(np.sqrt(whole) * t.ppf(0.975, max(degrees, 2.0)) / 1.959964)
