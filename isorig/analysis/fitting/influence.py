"""Standard uncertainties of fitted values, from the influence of each frequency bin of the residual.

Noise in the recorded drive affects all channels of a bin together, and the bins of a stationary residual are independent for any
autocorrelation. So the values are recomputed without each bin, in all channels (jackknife, to first order the HC3 of MacKinnon
and White 1985).
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.fitting.division import coarsened
from isorig.analysis.fitting.excess import SIMULATION_LIMIT
from isorig.analysis.fitting.residuals import Problem
from isorig.analysis.fitting.solve import Fit, Free, bending, fit, slopes_of
from isorig.analysis.fitting.trials import Trial

#: Largest number of times that the derivatives are computed, and the relative decrease of the cost that ends the fit.
STEPS, FALL = 4, 1e-6
#: Bounds of the relative size of a finite difference.
FINEST, COARSEST = 1e-6, 1e-3
#: Largest relative size of a finite difference of a given value. Derived: it moves a resonance with a damping ratio of 0.001 by
#: less than a hundredth of its width; a whole standard uncertainty may move it by more than that, where no linear step holds.
GIVEN_STEP = 1e-5
#: A value whose full size changes the residual by less than this, in standard deviations of the noise, is not identifiable.
TRACE = 2.0
#: Least size of a Jacobian's column, for a value without any effect. Derived: the fourth power of its inverse is finite.
NO_EFFECT = 1e-50
#: Shares of a friction force that is not identifiable because nothing slides against it: the data may contain sliding.
SMALLER = np.geomspace(0.95, 0.05, 30).tolist()


def at_minimum(done: Fit, trials: Sequence[Trial], steps: int = STEPS) -> Fit:
    """A fit refined until its cost is minimal to a small fraction of a standard uncertainty, with equally small finite
    differences.

    A step of one standard uncertainty changes the cost by one, of as many as there are bins; fits that compare models stop long
    before. `steps` is the largest number of times that the derivatives are computed.
    """
    problem = Problem(trials, share=SIMULATION_LIMIT)
    coarse = Problem([coarsened(trial) for trial in trials], share=SIMULATION_LIMIT)
    done = fit(done.model, _fine_steps(done), problem, iterations=steps, tolerance=FALL, coarse=coarse)
    # What follows differentiates again: with the steps of the final uncertainties.
    return replace(done, free=_fine_steps(done))


def _fine_steps(done: Fit) -> tuple[Free, ...]:
    # The parameters with finite differences of one standard uncertainty.
    return tuple(
        replace(f, step=float(np.clip(std / (abs(value) or 1.0), FINEST, COARSEST))) if f.log else f
        for f, std, value in zip(done.free, done.std.values(), done.values.values(), strict=True)
    )


def not_identifiable(done: Fit) -> frozenset[str]:
    """Paths of the fitted values that are not identifiable from the data."""
    sizes = np.sqrt((done.jacobian**2).sum(axis=0))
    return frozenset(f.path for f, size in zip(done.free, sizes, strict=True) if f.log and size < TRACE)


def from_smaller_friction(done: Fit, trials: Sequence[Trial]) -> Fit:
    """The fit, restarted from a smaller friction if its own lets nothing slide and that explains the data better."""
    problem = Problem(trials, share=SIMULATION_LIMIT)
    for path in sorted(path for path in not_identifiable(done) if path.endswith("friction_force")):
        smaller = [done.model.replace({path: share * done.values[path]}) for share in SMALLER]
        costs = np.nan_to_num((problem.residuals(smaller) ** 2).mean(axis=1), nan=np.inf)
        begun = fit(smaller[int(np.argmin(costs))], done.free, problem, iterations=12, tolerance=1e-3)
        done = min(done, begun, key=lambda f: f.cost)
    return done


def normalised(done: Fit) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Column sizes of a fit's Jacobian, the Jacobian with columns of size one, and the inverse of its normal matrix.

    The normal matrix includes the smoothness of curves, which holds their points without data.
    """
    scale = np.maximum(np.sqrt((done.jacobian**2).sum(axis=0)), NO_EFFECT)
    jacobian, ties = done.jacobian / scale, bending(done.model, done.free)[0] / scale
    return scale, jacobian, np.linalg.pinv(jacobian.T @ jacobian + ties.T @ ties, rcond=1e-12, hermitian=True)


def changes_without_bins(done: Fit, trials: Sequence[Trial]) -> FloatArray:
    """Change of the fitted values without each frequency bin, shape (bins, values), in the values' units."""
    scale, jacobian, bread = normalised(done)
    scores = []
    ends = np.cumsum(done.sizes)
    for trial, start, end in zip((t for t in trials if t.fitted), ends - np.array(done.sizes), ends, strict=True):
        # Real and imaginary parts of all channels, bin by bin.
        rows = 2 * len(trial.channels)
        own = jacobian[start:end].reshape(rows, -1, len(scale)).transpose(1, 0, 2)
        residual = done.residual[start:end].reshape(rows, -1).T
        left = np.eye(rows) - np.einsum("kap,pq,kbq->kab", own, bread, own, optimize=True)
        alone = np.linalg.solve(left + 1e-9 * np.eye(rows), residual[:, :, None])
        scores.append(np.einsum("kap,ka->kp", own, alone[:, :, 0]))
    return np.asarray(np.concatenate(scores) @ bread / scale * slopes_of(done.model, done.free))


def changes_with_given_values(done: Fit, trials: Sequence[Trial], given: Mapping[str, float]) -> FloatArray:
    """Change of the fitted values with the given values, shape (given, values), in the values' units.

    Each row is for one standard uncertainty of a given value (a mass, a sensor's gain), by its path in the model.
    """
    if not given:
        return np.zeros((0, len(done.free)))
    shares = [min(1.0, GIVEN_STEP * abs(done.model.get(path)) / std) for path, std in given.items()]
    moved = [
        done.model.replace({path: done.model.get(path) + share * std})
        for (path, std), share in zip(given.items(), shares, strict=True)
    ]
    # The stored residual may be that of a model which differs by as little.
    here, *there = Problem(trials, share=SIMULATION_LIMIT).residuals([done.model, *moved])
    changes = np.nan_to_num(np.array(there) - here) / np.array(shares)[:, None]
    scale, jacobian, bread = normalised(done)
    back = bread @ jacobian.T
    return np.asarray(-(changes @ back.T) / scale * slopes_of(done.model, done.free))


def change_with_half_step(done: Fit, trials: Sequence[Trial]) -> FloatArray:
    """Change of the fitted values with half the time step, shape (values,), in their units."""
    finer = tuple(trial.on_grid(2 * trial.excitation.oversample) for trial in trials)
    change = Problem(finer, share=SIMULATION_LIMIT).residuals([done.model])[0] - done.residual
    scale, jacobian, bread = normalised(done)
    moved = bread @ (jacobian.T @ np.nan_to_num(change)) / scale
    return np.asarray(moved * slopes_of(done.model, done.free))
