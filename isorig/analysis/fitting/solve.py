"""Fits a rig's parameters to a measurement, by the free-run simulation error.

The model runs free from each run's first sample, with the recorded drive as its only input, and its waveforms are compared up to
each run's ceiling frequency. Levenberg-Marquardt (Moré 1978) with finite differences.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from math import remainder
from typing import Protocol

import numpy as np

from isorig.analysis.campaign import BoolArray, FloatArray
from isorig.analysis.errors import FitError, ModelError
from isorig.analysis.fitting.residuals import Problem
from isorig.analysis.model.rig_model import RigModel

#: A parameter whose Jacobian column has at most this square has only rounding effects.
FAINT = 1e-6
#: Derivatives from this size on are those of a simulation that diverges: the sum of their squares would overflow.
DIVERGED = 1e100
#: Directions with less than this share of the information of the best-known one are ignored; and share of the information on a
#: direction below which the other trials do not determine it.
SINGULAR, ALONE = 1e-12, 0.01
#: Maximum change of a curve point in one step, in allowed deviations from its neighbours' mean.
STRAYS = 20.0
#: After a step that reduces the cost by this share of the predicted reduction, the derivatives are used once more.
FORETOLD = 0.8


@dataclass(frozen=True, kw_only=True)
class Free:
    """A free parameter of a fit."""

    path: str  #: Dotted path in the model.
    #: Bounds of the value.
    low: float = 0.0
    high: float = np.inf
    log: bool = True  #: Whether it is searched on a logarithmic scale (it is positive).
    step: float = 1e-5  #: Finite difference: relative if `log`, absolute otherwise.
    turn: float = np.inf  #: Period of an angle: its value is within half of one around zero.
    #: For a point of a curve: its expected value from its neighbours, as (path, weight), and the deviation from it that costs as
    #: much as one residual of 1. It holds the points without data.
    follows: tuple[tuple[str, float], ...] = ()
    give: float = np.inf

    def encode(self, value: float) -> float:
        """The search coordinate of a value."""
        return float(np.log(max(value, 1e-300))) if self.log else value

    def decode(self, coordinate: float) -> float:
        """The value of a search coordinate, within the bounds."""
        value = float(np.exp(min(coordinate, 700.0))) if self.log else remainder(coordinate, self.turn)
        return float(min(max(value, self.low), self.high))

    def at_upper_bound(self, coordinate: float) -> bool:
        """Whether less than half a finite difference remains between a search coordinate and the upper bound."""
        return self.decode(coordinate + 0.5 * self.step) == self.high


def coordinates_of(model: RigModel, free: Sequence[Free]) -> FloatArray:
    """Search coordinates of a model's values, shape (k,)."""
    return np.array([f.encode(model.get(f.path)) for f in free])


def at_coordinates(model: RigModel, free: Sequence[Free], coordinates: FloatArray) -> RigModel:
    """The model with the values at other search coordinates, shape (k,). Raises ModelError if physics excludes them."""
    return model.replace({f.path: f.decode(c) for f, c in zip(free, coordinates, strict=True)})


def slopes_of(model: RigModel, free: Sequence[Free]) -> FloatArray:
    """Derivatives of a model's values with respect to their search coordinates, shape (k,)."""
    return np.array([model.get(f.path) if f.log else 1.0 for f in free])


class Spread(Protocol):
    """What determines the uncertainty of fitted values."""

    @property
    def given(self) -> FloatArray:
        """Changes of the values with one standard uncertainty of each known value, shape (known values, k)."""
        ...

    @property
    def std(self) -> FloatArray:
        """Standard uncertainties of the values, shape (k,)."""
        ...

    def deviation(self, slope: FloatArray) -> float:
        """Standard uncertainty of a quantity with derivatives `slope` with respect to the values, shape (k,)."""
        ...


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A fitted model."""

    model: RigModel  #: The rig with the fitted values.
    free: tuple[Free, ...]  #: The fitted parameters.
    covariance: FloatArray  #: Of the values in the order of `free`, shape (k, k), from the residuals with their autocorrelation.
    cost: float  #: Mean square of the weighted residuals (1 if noise and `SIGNAL_SHARE` explain all).
    evaluations: int  #: Number of simulated campaigns.
    #: At the last step: derivatives of the weighted residual, shape (size, k), the residual, shape (size,), and the number of its
    #: entries for each trial.
    jacobian: FloatArray = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    residual: FloatArray = field(default_factory=lambda: np.zeros(0), repr=False)
    sizes: tuple[int, ...] = ()
    #: What determines the uncertainty of the values (`uncertainty`); None of a fit that is only compared with others.
    known: Spread | None = field(default=None, repr=False)
    converged: bool = True  #: Whether it ended before its maximum number of steps.

    @property
    def values(self) -> dict[str, float]:
        """Fitted value by path."""
        return {free.path: self.model.get(free.path) for free in self.free}

    @property
    def std(self) -> dict[str, float]:
        """Standard uncertainty by path."""
        rows = np.eye(len(self.free))
        whole = self.known.std.tolist() if self.known is not None else [self.deviation(row) for row in rows]
        return dict(zip((free.path for free in self.free), whole, strict=True))

    def with_values_of(self, other: Fit) -> Fit:
        """The other fit's model and values, with the uncertainties of this one's further values, taken as independent."""
        paths = {free.path for free in other.free}
        kept = [k for k, free in enumerate(self.free) if free.path not in paths]
        free, own, std = (*(self.free[k] for k in kept), *other.free), len(kept), self.std
        covariance = np.zeros((len(free),) * 2)
        covariance[range(own), range(own)] = [std[each.path] ** 2 for each in free[:own]]
        covariance[own:, own:] = other.covariance
        return Fit(model=other.model, free=free, covariance=covariance, cost=np.nan, evaluations=0)

    def deviation(self, slope: FloatArray) -> float:
        """Standard uncertainty of a quantity with derivatives `slope` with respect to the values, shape (k,)."""
        if self.known is not None:
            return self.known.deviation(slope)
        # At a bound rounding may leave a variance below zero.
        return float(np.sqrt(max(float(slope @ self.covariance @ slope), 0.0)))


def fit(
    model: RigModel,
    free: Sequence[Free],
    problem: Problem,
    *,
    iterations: int = 12,
    tolerance: float = 1e-4,
    tether: float = 0.0,
    coarse: Problem | None = None,
) -> Fit:
    """Fit the free parameters by Levenberg-Marquardt.

    Parameters
    ----------
    model
        The starting point.
    free
        The free parameters.
    problem
        The residuals.
    iterations
        Maximum number of Jacobians.
    tolerance
        The fit ends when a step reduces the cost by less than this share.
    tether
        Weight of a parameter's distance from its start, in e-folds or hundreds of finite differences, relative to residuals of 1:
        so small that it holds only what the data do not determine.
    coarse
        The same residuals from coarser simulations, for the first derivatives of a fit that is to be exact. Then derivatives are
        used for as many steps as reduce the cost as they predict, up to the number of simulations that new ones take.

    Raises
    ------
    FitError
        The starting model cannot be simulated.
    OutOfTimeError
        The time limit was reached before the fit has ended.
    """
    free = tuple(free)
    theta = coordinates_of(model, free)
    build = partial(at_coordinates, model, free)
    # Rows of the tethers and of the curves' smoothness, below those of the data: ties @ coordinates - ties_at.
    hold = np.diag([_tethered(f, tether) for f in free])
    bend, straight = bending(model, free)
    ties, ties_at = np.vstack([hold, bend]), np.concatenate([hold @ theta, -straight])

    def cost_of(seen: FloatArray, coordinates: FloatArray) -> float:
        return _size(seen) + _size(ties @ coordinates - ties_at)

    def misfit(coordinates: FloatArray) -> tuple[FloatArray, float]:
        found = np.full(problem.size, np.nan)
        with suppress(ModelError):
            if problem.parts_of_step(trial := build(coordinates)) <= finest:
                found = np.asarray(local.residuals([trial])[0])
        return found, cost_of(found, coordinates)

    # A run that begins in motion has a state for each model: those of the steps follow from that of the last derivatives.
    local, finest = problem.about(build(theta)), problem.most_parts(build(theta))
    residual, cost = misfit(theta)
    if not np.isfinite(cost):
        raise FitError(f"the model {model.name!r} cannot be simulated at its starting values; correct its parameters")
    evaluations, damping, converged = 1, 1e-3, False
    jacobian = np.zeros((len(residual), len(free)))
    taken, steps, fresh = 0, 0, True
    while taken < iterations or not fresh:
        if fresh:
            earlier, local = local, local.about(build(theta))
            if local is not earlier:
                residual, cost = misfit(theta)
            rough = coarse if taken == 0 else None
            here = residual if rough is None else rough.residuals([build(theta)])[0]
            jacobian = jacobian_of(rough or local, build, theta, free, here)
            normal = jacobian.T @ jacobian + ties.T @ ties
            taken, steps, evaluations = taken + 1, 0, evaluations + len(free)
        steps += 1
        gradient = jacobian.T @ residual + ties.T @ (ties @ theta - ties_at)
        before = foretold = cost
        for _ in range(6 if fresh else 1):
            trial = _stepped(theta, free, normal, gradient, damping)
            candidate, new = misfit(trial)
            evaluations += 1
            linear = cost_of(residual + jacobian @ (trial - theta), trial)
            if np.isfinite(new) and new < cost:
                theta, residual, cost, foretold = trial, candidate, new, linear
                damping = max(damping / 9.0, 1e-9)
                break
            if cost - linear <= tolerance * cost:  # a shorter step would reduce the cost by even less
                break
            damping *= 8.0
        small = before - cost <= tolerance * before
        converged = small and (fresh or before - linear <= tolerance * before)
        if converged:
            break
        fresh = small or (not fresh and (coarse is None or steps > len(free))) or before - cost < FORETOLD * (before - foretold)
    fitted = build(theta)
    return Fit(
        model=fitted, free=free, covariance=_covariance(jacobian, residual, fitted, free), cost=cost / problem.size,
        evaluations=evaluations, jacobian=jacobian, residual=residual, sizes=problem.sizes, converged=converged,
    )  # fmt: skip


def _stepped(theta: FloatArray, free: Sequence[Free], normal: FloatArray, gradient: FloatArray, damping: float) -> FloatArray:
    # Where a step leads; parameters that would leave their bounds stay there, and the others step as if these were known.
    def within(coordinates: FloatArray) -> FloatArray:
        return np.array([f.encode(f.decode(c)) for f, c in zip(free, coordinates, strict=True)])

    there = theta + _limited(damped_step(normal, gradient, damping), free)
    trial = within(there)
    stays = (trial == within(theta)) & (there != trial)
    if stays.any():
        trial = within(theta + _limited(damped_step(normal, gradient, damping, stays), free))
    return trial


def damped_step(normal: FloatArray, gradient: FloatArray, damping: float, held: BoolArray | None = None) -> FloatArray:
    """A Levenberg-Marquardt step, shape (k,), from the normal matrix and the gradient of half the cost.

    Parameters that are not identifiable, or `held`, stay: their steps would be rounding, and would shorten all others.
    """
    scale = np.diag(normal)
    live = np.flatnonzero(scale > FAINT if held is None else (scale > FAINT) & ~held)
    step = np.zeros(len(gradient))
    step[live] = -np.linalg.solve((normal + damping * np.diag(scale))[np.ix_(live, live)], gradient[live])
    return step


def _size(values: FloatArray) -> float:
    return float(values @ values)


def _tethered(free: Free, tether: float) -> float:
    # Curve points without data follow their neighbours, not their start.
    return 0.0 if free.follows else tether / (1.0 if free.log else 100.0 * free.step)


def bending(model: RigModel, free: Sequence[Free]) -> tuple[FloatArray, FloatArray]:
    """Deviations of curve points from their neighbours' expectation, in those that cost as much as a residual of 1.

    Returns rows on the search coordinates, shape (points, k), and constants, shape (points,).
    """
    index = {f.path: k for k, f in enumerate(free)}
    points = [f for f in free if f.follows]
    rows, constants = np.zeros((len(points), len(free))), np.zeros(len(points))
    for row, point in enumerate(points):
        for path, weight in ((point.path, -1.0), *point.follows):
            if path in index:
                rows[row, index[path]] += weight / point.give
            else:
                constants[row] += weight * model.get(path) / point.give
    return rows, constants


def jacobian_of(
    problem: Problem,
    build: Callable[[FloatArray], RigModel],
    theta: FloatArray,
    free: Sequence[Free],
    residual: FloatArray,
) -> FloatArray:
    """One-sided differences of the residual, shape (size, parameters)."""
    close = problem.about(build(theta))
    if close is not problem:
        residual = close.residuals([build(theta)])[0]
    shifted = []
    # At an upper bound the other side is inside.
    steps = np.array([-f.step if f.at_upper_bound(c) else f.step for f, c in zip(free, theta, strict=True)])
    for i in range(len(free)):
        moved = theta.copy()
        moved[i] += steps[i]
        try:
            shifted.append(build(moved))
        except ModelError:  # the step exceeded what physics allows; the other side is inside
            moved[i] -= 2.0 * steps[i]
            steps[i] = -steps[i]
            try:
                shifted.append(build(moved))
            except ModelError:  # not allowed on both sides: unchanged
                shifted.append(build(theta))
    columns = close.residuals(shifted)
    columns -= residual
    columns /= steps[:, None]
    # A simulation that diverges by the step has no slope.
    columns[~(np.abs(columns) < DIVERGED)] = 0.0
    return np.asarray(columns.T)


def _limited(step: FloatArray, free: Sequence[Free]) -> FloatArray:
    # No parameter on a logarithmic scale moves by more than a factor e^0.7 at once, no curve point by more than some of its
    # allowed deviation: rarely reached points are hardly determined by the data.
    worst = max((abs(s) / 0.7 for s, f in zip(step, free, strict=True) if f.log), default=0.0)
    most = np.array([STRAYS * f.give for f in free])
    return np.clip(step / max(worst, 1.0), -most, most)


def _covariance(jacobian: FloatArray, residual: FloatArray, fitted: RigModel, free: Sequence[Free]) -> FloatArray:
    # White's (1980) sandwich: frequency bins are independent, so a coloured residual only has unequal variances.
    if jacobian.shape[1] == 0:
        return np.zeros((0, 0))
    # Values that are no logarithms have any size: in units in which they have the effect of the others.
    sizes, logarithms = np.sqrt((jacobian**2).sum(axis=0)), np.array([f.log for f in free])
    usual = float(np.max(sizes, initial=0.0, where=logarithms)) or 1.0
    scale = np.where(logarithms | (sizes == 0.0), 1.0, sizes / usual)
    scaled = jacobian / scale
    normal = np.linalg.pinv(scaled.T @ scaled, rcond=1e-14)
    meat = scaled.T @ (scaled * (residual**2)[:, None])
    covariance = normal @ meat @ normal
    slope = slopes_of(fitted, free) / scale
    return np.asarray(covariance * np.outer(slope, slope))


def positive(path: str, value: float, *, span: float = 1e3) -> Free:
    """A positive parameter that may move by a factor `span` in either direction from its starting value."""
    return Free(path=path, low=value / span, high=value * span)


def base_parameters(model: RigModel) -> tuple[Free, ...]:
    """The parameters marked as free in the rig's description; an offset may have either sign."""
    return tuple(_described(path, model.get(path)) for path in model.free)


def _described(path: str, value: float) -> Free:
    if path.endswith(".offset"):
        return Free(path=path, low=-np.inf, log=False, step=1e-4)
    # A starting value may have lost the friction altogether.
    return positive(path, value, span=1e6 if path.endswith("friction_force") else 1e3)


def disagreement(fitted: Fit) -> FloatArray:
    """Covariance of the fitted values from the differences between runs: the jackknife over trials, shape (k, k).

    Leaving one trial out moves the values by (A - A_g)^-1 J_g' r_g to first order, A = J'J and A_g the trial's share of it. A
    model that is wrong asks for other values in every run, which residuals taken as noise do not tell (Efron and Stein 1981).
    """
    if len(fitted.sizes) < 2:
        return np.zeros((len(fitted.free),) * 2)
    whole = fitted.jacobian.T @ fitted.jacobian
    scale = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    # Along the axes in which all trials together have the same information in every direction.
    sizes, axes = np.linalg.eigh(whole / np.outer(scale, scale))
    kept = sizes > SINGULAR * sizes[-1]
    axes = axes[:, kept] / np.sqrt(sizes[kept])
    moves = []
    ends = np.cumsum(fitted.sizes)
    for start, end in zip(ends - np.array(fitted.sizes), ends, strict=True):
        own, residual = fitted.jacobian[start:end] / scale @ axes, fitted.residual[start:end]
        shares, ways = np.linalg.eigh(np.eye(own.shape[1]) - own.T @ own)
        # Information from this trial only, with which no other can disagree.
        inverse = np.where(shares > ALONE, 1.0 / np.maximum(shares, ALONE), 0.0)
        moves.append(axes @ (ways @ (inverse * (ways.T @ (own.T @ residual)))) / scale)
    count = len(moves)
    steps = np.array(moves) - np.mean(moves, axis=0)
    slope = slopes_of(fitted.model, fitted.free)
    return np.asarray((count - 1.0) / count * steps.T @ steps * np.outer(slope, slope))
