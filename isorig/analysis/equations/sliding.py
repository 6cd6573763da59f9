"""Equations with dry friction, in the time domain, while the contact slides.

The force of the element follows from its equation without any unknown, or with linear ones. Its deflection is integrated, so its
slow part (integrated noise, a rest position off centre) is unknown: in blocks of some periods a cubic B-spline is added to it and
eliminated block by block, linearized about the current fit (Gauss-Newton). Every second block is held out from the coefficients.
Where the element's own motion is known but another one's integrated deflection is not, that one's slow force is such a spline.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from isorig.analysis.campaign import BoolArray, FloatArray, IntArray
from isorig.analysis.lowpass import lowpass_gain

#: Distance of the knots of the slow part, and length of a block, in periods of the rig's lowest mode. Chosen: with five periods a
#: knot, the spline cannot follow the motion itself.
KNOT_PERIODS, BLOCK_KNOTS = 5.0, 10
#: Number of blocks of the moving part of a run where the deflection has no unknown part.
BLOCKS = 8
#: Length of such a block in lengths of the low-pass, if there are two: near reversals no samples are used.
LONGER = 4
#: Samples next to a reversal that are left out: the converter's filter spreads the step of the friction over them. A low-pass
#: spreads it over this share of its period, also next to samples that stick.
REVERSAL, SPREAD = 5, 0.6
#: Half of its length in periods of the low-pass, and the parameter of its Kaiser window. Derived: it passes less than 0.015 of
#: what is above 1.45 times its edge. Chosen: a stronger window smooths friction that falls with velocity by 5 %.
TAPS, KAISER = 2.0, 1.0
#: Velocity below which a contact counts as not sliding, as a share of the largest rms velocity of the runs. Chosen: integrated
#: noise and the sampling filter blur the moment of a reversal. If the deflection is measured, from a smaller share on, and from
#: this many times the velocity's noise: friction that falls with velocity shows there.
SLOW, SLOW_MEASURED, SURE_SPEED = 0.1, 0.03, 3.0
#: Share of the time below this share of a run's own rms velocity above which an element is moved and rests. Chosen: a sine or a
#: random motion is as slow for less than a tenth of the time.
RESTS = 0.25
#: Largest number of samples in use: neighbours repeat each other.
MOST_SAMPLES = 20_000
#: Samples for each knot of the slow part: there are fewer blocks where knots are close.
PER_KNOT = 20
#: Samples of a block below which it is not used: with and without a slow part to be fitted.
FEWEST, FEWEST_ALONE = 50, 10
#: Relative accuracy of the force, rms (see `spectral.ACCURACY`), and ratio by which the force's noise may exceed its estimate,
#: rms. Chosen: with it sound rigs whose equations are mostly noise hold; it was 1.2 for carts with noisy encoders.
ACCURACY, NOISIER = 0.004, 1.6
#: Largest correction of the slow part in one step, as a share of the largest deflection, and damping of its steps as a share of
#: the spring's own curvature. Chosen: undamped, a spring with gaps diverges in single blocks.
CLIP, DAMPED = 0.1, 1e-3
#: Added to a block's mean square residual, relative to what is allowed, before its logarithm.
FLOOR = 0.05
#: Residual of a block in multiples of the median (or of what is allowed) above which its slow part may be wrong.
SOUND = 3.0
#: Share of its residual without a shape that a block may have with it and be sound all the same: rare events are in few blocks.
EXPLAINED = 0.5
#: Factor of a step that is taken back, and the smallest such factor.
BACK, LEAST = 0.3, 0.05
#: Decrease of the mean logarithm of the blocks' residuals below which a fit ends.
CONVERGED = 0.01
#: Largest number of Gauss-Newton steps.
ROUNDS = 15
#: Residual of a block, relative to that of the base equation, above which its weight decreases.
WORSE = 1.5

#: Columns of an equation for samples of a run: deflection (m), velocity (m/s), the run, the samples' indices; shape (n, columns).
Columns = Callable[[FloatArray, FloatArray, "SlidingRun", IntArray], FloatArray]


@dataclass(kw_only=True)
class SlidingRun:
    """The equation's signals in one run, each shape (n,)."""

    run: int  #: Index of the run.
    force: FloatArray  #: The element's force as far as known, N.
    #: Of the element, without the slow part, m and m/s.
    deflection: FloatArray
    velocity: FloatArray
    fixed: FloatArray  #: Columns that do not depend on the element's motion: other elements, unknown masses; shape (n, columns).
    time: FloatArray  #: Seconds since the campaign's start.
    usable: BoolArray  #: Samples that may be used.
    #: The slow part of the deflection, m, and its derivative.
    slow: FloatArray
    slow_velocity: FloatArray
    memory: dict[str, FloatArray] = field(default_factory=dict)  #: Signals computed once, by name.
    #: Velocity in m/s up to which a contact counts as not sliding; 0 where no low-pass spreads what is assumed of such samples.
    creep: float = 0.0

    def without_slow_part(self) -> SlidingRun:
        """The same signals with a slow part of their own, still zero."""
        n = len(self.deflection)
        return replace(self, slow=np.zeros(n), slow_velocity=np.zeros(n), memory={})


@dataclass(kw_only=True)
class _Block:
    run: SlidingRun
    first: int
    held_out: bool
    spline: FloatArray
    used: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    base: float = np.inf


@dataclass(frozen=True, kw_only=True)
class _Reduced:
    # A block's normal equations without its slow part: the last row and column are the residual's.
    block: _Block
    normal: FloatArray
    back: FloatArray
    count: int
    power: float


@dataclass(frozen=True, kw_only=True)
class SlidingFit:
    """A fit of the equation."""

    values: FloatArray  #: Coefficients of the columns.
    #: Mean square residual of the held-out blocks, N^2: geometric and arithmetic mean over blocks.
    geometric: float
    arithmetic: float
    #: Indices of the active blocks whose residual is not far above the median, or that a shape explains: in a few the slow part
    #: may be wrong.
    sound: tuple[int, ...]


class Sliding:
    """An equation with dry friction.

    Parameters
    ----------
    runs
        Its signals.
    rate
        Hz.
    period
        Of the rig's lowest mode, s.
    integrated
        Whether the deflection was integrated, so that its slow part is unknown.
    drifts
        Whether the force has an unknown slow part: that of another element's integrated deflection.
    stiffness
        First value of the element's stiffness, N/m.
    noise
        Standard deviation of the force's noise, N.
    velocity_noise
        Standard deviation of the velocity's noise, m/s, if the deflection is measured.
    parts
        Mean square of the channels' parts in the force, N^2: each is accurate to `ACCURACY`.
    edge
        Corner frequency in Hz of the low-pass that the force went through (`shortly_low_passed`), but not yet the columns;
        infinite for none.
    rubs
        Whether a contact acts: then only samples that slide are used.
    """

    def __init__(
        self, runs: Sequence[SlidingRun], rate: float, period: float, *, integrated: bool, drifts: bool, stiffness: float,
        noise: float, velocity_noise: float, parts: float, edge: float, rubs: bool,
    ) -> None:  # fmt: skip
        self.runs, self.rate, self.integrated, self.noise, self.parts = tuple(runs), rate, integrated, noise, parts
        self.drifts, self.with_slow_part = drifts, integrated or drifts
        self.rubs, self.fewest = rubs, FEWEST if self.with_slow_part else FEWEST_ALONE
        self.through_reversals = False  #: Whether samples close to a reversal are used, too.
        self.reach = REVERSAL if np.isinf(edge) else max(REVERSAL, round(SPREAD * rate / edge))
        self.spread = 0 if np.isinf(edge) else self.reach
        self.taps = _taps(rate, edge)
        self._gains: dict[int, FloatArray] = {}  # of the low-pass, by length of the transform
        # The columns that were evaluated last, and their values by block, where nothing of the motion is fitted.
        self._columns: Columns | None = None
        self._matrices: dict[tuple[int, int], FloatArray] = {}
        self.speed = max((float(np.std(run.velocity)) for run in self.runs if len(run.velocity)), default=1e-2)
        known = max(SLOW_MEASURED * self.speed, SURE_SPEED * velocity_noise)
        self.slow = SLOW * self.speed if integrated else min(known, SLOW * self.speed)
        for run in self.runs:
            run.creep = self.slow if self.spread else 0.0
        shortest = min(len(run.force) for run in runs)
        self.knot = max(round(KNOT_PERIODS * period * rate), 8)
        knots = BLOCK_KNOTS if self.with_slow_part else 1
        if not self.with_slow_part:
            moving = max(int((np.abs(run.velocity) > self.slow).sum()) for run in runs)
            moving = min(shortest, moving)
            self.knot = max(moving // BLOCKS, min(LONGER * len(self.taps), moving // 2), 8)
        elif BLOCK_KNOTS * self.knot > shortest // 2:
            knots = max(shortest // 2 // self.knot, 1)
            self.knot = min(self.knot, shortest // 2)
        self.length = knots * self.knot
        place = np.arange(self.length) / self.knot
        self._first = np.minimum(place.astype(int), knots - 1)
        x = place - self._first
        self._value = np.stack([(1 - x) ** 3, 3 * x**3 - 6 * x**2 + 4, -3 * x**3 + 3 * x**2 + 3 * x + 1, x**3], 1) / 6.0
        slope = np.stack([-3 * (1 - x) ** 2, 9 * x**2 - 12 * x, -9 * x**2 + 6 * x + 3, 3 * x**2], 1) / 6.0
        self._slope = slope * rate / self.knot
        self.knots = knots + 3
        self.blocks = [
            _Block(run=run, first=k * self.length, held_out=bool(k % 2), spline=np.zeros(self.knots))
            for run in self.runs
            for k in range(max(len(run.force) // self.length, 0))
        ]
        # An odd stride keeps every second block held out.
        stride = int(np.ceil(len(self.blocks) * PER_KNOT * self.knots / MOST_SAMPLES)) // 2 * 2 + 1
        self.blocks = self.blocks[::stride]
        if len(self.blocks) > 1 and not any(block.held_out for block in self.blocks):
            for block in self.blocks[1::2]:
                block.held_out = True
        self.swing = max((float(np.abs(run.deflection).max()) for run in self.runs if len(run.deflection)), default=1e-3)
        self.stiffness, self.damping = stiffness, 0.0
        self.count = self.select()

    def select(self) -> int:
        """Choose the samples that slide; returns their number."""
        self._columns = None
        masks = {run.run: self.slides(run) & run.usable if self.rubs else run.usable for run in self.runs}
        inner = [masks[block.run.run][block.first : block.first + self.length].copy() for block in self.blocks]
        every = max(1, sum(int(mask.sum()) for mask in inner) // MOST_SAMPLES)
        for block, inside in zip(self.blocks, inner, strict=True):
            if self.integrated:  # the slow part is known inside of the block only
                inside[: len(self.taps) // 2] = inside[len(inside) - len(self.taps) // 2 :] = False
            block.used = np.flatnonzero(inside)[::every]
        # Held-out samples outside the range of the others would be extrapolated.
        seen = [self._deflection(block) for block in self.blocks if not block.held_out and len(block.used) >= self.fewest]
        if seen and sum(map(len, seen)) > self.fewest:
            low, high = np.quantile(np.concatenate(seen), [0.0003, 0.9997])
            for block in self.blocks:
                if block.held_out and len(block.used):
                    d = self._deflection(block)
                    block.used = block.used[(d >= low) & (d <= high)]
        self.active = [block for block in self.blocks if len(block.used) >= self.fewest]
        if self.active:
            d = np.concatenate([self._deflection(block) for block in self.active])
            v = np.concatenate([self._velocity(block) for block in self.active])
            margin = 0.05 * float(np.ptp(d))
            low, high = np.quantile(d, [0.0005, 0.9995])
            self.range = float(low) - margin, float(high) + margin
            self.fastest = 1.05 * float(np.quantile(np.abs(v), 0.9995))
            self.power = float(np.mean(np.concatenate([block.run.force[block.first + block.used] for block in self.active]) ** 2))
        return sum(len(block.used) for block in self.active)

    def slide_through_reversals(self) -> None:
        """Choose the samples again, with those close to a reversal: the low-pass spreads the step of a friction over its column,
        too, but not what holds an element that sticks."""
        self.through_reversals = True
        self.count = self.select()

    def slides(self, run: SlidingRun) -> BoolArray:
        """Which samples slide, shape (n,): neither slow nor, as a rule, close to a reversal."""
        velocity = run.velocity + run.slow_velocity
        slow = np.abs(velocity) <= self.slow
        if self.spread:
            slow = np.convolve(slow, np.ones(2 * self.spread + 1), mode="same") > 0.5
        if self.through_reversals:
            return np.asarray(~slow)
        turned = np.flatnonzero((velocity[1:] > 0) != (velocity[:-1] > 0))
        for offset in range(1 - self.reach, self.reach + 1):
            slow[np.clip(turned + offset, 0, len(slow) - 1)] = True
        return np.asarray(~slow)

    @property
    def usable(self) -> bool:
        """Whether the element moves, and enough blocks slide for a fit and a check of it: two records of one motion cancel."""
        return self.swing > 0.0 and any(b.held_out for b in self.active) and any(not b.held_out for b in self.active)

    @property
    def rests(self) -> bool:
        """Whether the element is at rest for a good part of the time although its position is measured: it is moved."""
        return not self.integrated and still(run.velocity for run in self.runs) > RESTS

    @property
    def allowed(self) -> float:
        """Mean square residual that noise and the accuracy of the force allow, N^2."""
        return (NOISIER * self.noise) ** 2 + ACCURACY**2 * max(self.power, self.parts)

    def residual(self, fitted: SlidingFit, before: SlidingFit | None = None) -> float:
        """Residual power over what is allowed; one if the equation holds.

        Rare events show in the arithmetic mean only, single bad blocks too: of both ratios to a fit before, the better counts.
        """
        of_blocks = fitted.geometric / self.allowed
        if before is None:
            return 1.0 + of_blocks
        improved = (
            (1.0 + before.geometric / self.allowed) * (self.allowed + fitted.arithmetic) / (self.allowed + before.arithmetic)
        )
        return min(1.0 + of_blocks, improved)

    def state(self) -> list[tuple[FloatArray, ...]]:
        """The slow parts, for `restore`."""
        return [(run.slow.copy(), run.slow_velocity.copy()) for run in self.runs] + [(b.spline.copy(),) for b in self.blocks]

    def restore(self, state: Sequence[tuple[FloatArray, ...]]) -> None:
        """Set the slow parts."""
        for run, (slow, velocity) in zip(self.runs, state, strict=False):
            run.slow[:], run.slow_velocity[:] = slow, velocity
        for block, (spline,) in zip(self.blocks, state[len(self.runs) :], strict=True):
            block.spline = spline.copy()

    @np.errstate(over="ignore", invalid="ignore")  # a step that leaves all bounds is taken back
    def fit(
        self, columns: Columns, values: FloatArray, rounds: int, penalty: FloatArray | None = None, *, damped: bool = True
    ) -> SlidingFit:
        """Fit coefficients and slow parts by Gauss-Newton steps; the best iterate counts.

        Parameters
        ----------
        columns
            The columns of the equation.
        values
            First coefficients, shape (columns,).
        rounds
            Largest number of steps.
        penalty
            Quadratic form of the coefficients, in N^2, shape (columns, columns).
        damped
            Whether steps of the slow part are damped.
        """
        best: tuple[float, FloatArray, list[tuple[FloatArray, ...]], list[_Reduced]] | None = None
        scale = 1.0
        if not self.integrated:
            rounds = 1
        for again in range(rounds + 1):
            reduced = [self._reduced(block, columns, values, damped) for block in self.active]
            fitted = [item for item in reduced if not item.block.held_out]
            cost = float(np.mean([np.log(max(item.power, 0.0) / self.allowed + FLOOR) for item in fitted]))
            if best is None or cost < best[0]:
                done = best is not None and cost > best[0] - CONVERGED
                scale = min(1.0, 2.0 * scale)
                best = (cost, values, self.state(), reduced)
                if done:
                    break
            else:
                if cost < best[0] + 1e-3 or scale < LEAST:
                    break
                self.restore(best[2])
                values, reduced = best[1], best[3]
                fitted = [item for item in reduced if not item.block.held_out]
                scale *= BACK
            if again == rounds:
                break
            normal = np.sum([item.normal * min(1.0, WORSE * item.block.base / (item.power + 1e-300)) for item in fitted], axis=0)
            change = self._step(normal, values, penalty)
            values = values + scale * change
            self._move(reduced, change, scale)
        assert best is not None
        self.restore(best[2])
        if self.drifts:
            for item in best[3]:
                item.block.spline = item.back[:, -1]
        tested = [item for item in best[3] if item.block.held_out]
        power = np.array([item.power for item in tested])
        count = np.array([item.count for item in tested])
        geometric = float(np.exp(np.mean(np.log(np.maximum(power, 0.0) + FLOOR * self.allowed))))
        powers = np.array([item.power for item in best[3]])
        begun = np.array([item.block.base if np.isfinite(item.block.base) else 0.0 for item in best[3]])
        usual = SOUND * max(float(np.median(powers)), self.allowed)
        sound = np.flatnonzero((powers <= usual) | (powers <= EXPLAINED * begun))
        return SlidingFit(
            values=best[1],
            geometric=geometric,
            arithmetic=float((power * count).sum() / count.sum()),
            sound=tuple(sound.tolist()),
        )

    def left(self, block: _Block, matrix: FloatArray, values: FloatArray) -> FloatArray:
        """What columns with these coefficients leave of the force at a block's samples in use, without its slow part, N."""
        slow = self._spread(block.used, self._value[block.used]) @ block.spline if self.drifts else 0.0
        return np.asarray(block.run.force[block.first + block.used] - matrix @ values - slow)

    def share_kept(self, columns: Columns, before: FloatArray, after: FloatArray) -> float:
        """Share of the force with the coefficients `before`, by projection, that the coefficients `after` also give."""
        matrices = [self.evaluated(block, columns)[0] for block in self.active]
        old = np.concatenate([matrix @ before for matrix in matrices])
        new = np.concatenate([matrix @ after for matrix in matrices])
        return float(old @ new / max(old @ old, 1e-300))

    def settle(self, columns: Columns, values: FloatArray) -> SlidingFit:
        """Fit the base equation, choosing the sliding samples again as the slow part becomes known."""
        found = self.fit(columns, values, 2, damped=False)
        for _ in range(2):
            self.stiffness, self.damping = float(found.values[0]), max(float(found.values[1]), 0.0)
            self.count = self.select()
            if not self.usable:
                return found
            found = self.fit(columns, found.values, 1, damped=False)
        found = self.fit(columns, found.values, ROUNDS, damped=False)
        for item in (self._reduced(block, columns, found.values, False) for block in self.active):
            item.block.base = item.power
        return found

    def _deflection(self, block: _Block) -> FloatArray:
        place = block.first + block.used
        return np.asarray(block.run.deflection[place] + block.run.slow[place])

    def _velocity(self, block: _Block) -> FloatArray:
        place = block.first + block.used
        return np.asarray(block.run.velocity[place] + block.run.slow_velocity[place])

    def _reduced(self, block: _Block, columns: Columns, values: FloatArray, damped: bool) -> _Reduced:
        place = block.first + block.used
        matrix, motion = self.evaluated(block, columns, values if self.integrated else None)
        left = block.run.force[place] - matrix @ values
        whole = np.column_stack([matrix, left])
        normal: FloatArray = np.asarray(whole.T @ whole, dtype=np.float64)
        count = len(place)
        back = np.zeros((self.knots, whole.shape[1]))
        if self.with_slow_part:
            basis = motion if self.integrated else self._spread(block.used, self._value[block.used])
            gram = basis.T @ basis
            scale = max(abs(self.stiffness), 1e-12) ** 2 if self.integrated else 1.0
            if damped and self.integrated:
                plain = self._spread(block.used, self._value[block.used])
                gram += DAMPED * scale * (plain.T @ plain)
            # Where no sample in use determines a coefficient, and without a described spring, the others set the scale.
            gram[np.diag_indices(self.knots)] += 1e-6 * max(scale, 1e-6 * float(np.trace(gram)))
            cross = basis.T @ whole
            back = np.asarray(np.linalg.solve(gram, cross), dtype=np.float64)
            normal = np.asarray(normal - cross.T @ back, dtype=np.float64)
        return _Reduced(block=block, normal=normal, back=back, count=count, power=float(normal[-1, -1]) / count)

    def evaluated(self, block: _Block, columns: Columns, values: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
        """Columns at a block's samples in use, and the derivatives of their sum with these values by the knots of the slow part.

        Where the force went through a low-pass, both go through it.
        """
        if not self.integrated:
            if columns is not self._columns:
                self._columns, self._matrices = columns, {}
            key = block.run.run, block.first
            if key not in self._matrices:
                self._matrices[key], _ = self._evaluated(block, columns, None)
            return self._matrices[key], np.zeros((len(block.used), 0))
        return self._evaluated(block, columns, values)

    def _evaluated(self, block: _Block, columns: Columns, values: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        beyond = 0 if self.integrated else len(self.taps) // 2
        used = block.used if len(self.taps) == 1 else np.arange(-beyond, self.length + beyond)
        place = np.clip(block.first + used, 0, len(block.run.force) - 1)
        d, v = block.run.deflection[place] + block.run.slow[place], block.run.velocity[place] + block.run.slow_velocity[place]
        matrix, motion = columns(d, v, block.run, place), np.zeros((len(used), 0))
        if values is not None:
            step = 1e-4 * self.swing
            slope = (columns(d + step, v, block.run, place) - matrix) @ values / step
            motion = self._spread(used, slope[:, None] * self._value[used] + self.damping * self._slope[used])
        if len(self.taps) > 1:
            both = self._through_lowpass(np.column_stack([matrix, motion]))[block.used + beyond]
            matrix, motion = both[:, : matrix.shape[1]], both[:, matrix.shape[1] :]
        return matrix, motion

    def _through_lowpass(self, columns: FloatArray) -> FloatArray:
        # Columns through the low-pass; not valid within half of its length from their ends, where no samples are used.
        size = next_fast_len(len(columns), real=True)
        if size not in self._gains:  # of the symmetric taps, about their middle
            half = len(self.taps) // 2
            self._gains[size] = rfft(np.roll(np.pad(self.taps, (0, size - len(self.taps))), -half)).real
        return np.asarray(irfft(rfft(columns, size, axis=0) * self._gains[size][:, None], size, axis=0), dtype=np.float64)

    def _spread(self, used: IntArray, weights: FloatArray) -> FloatArray:
        # Weights of the four splines at each sample as columns of all splines of a block, shape (n, knots).
        found = np.zeros((len(used), self.knots))
        found[np.arange(len(used))[:, None], self._first[used][:, None] + np.arange(4)] = weights
        return found

    def _step(self, normal: FloatArray, values: FloatArray, penalty: FloatArray | None) -> FloatArray:
        p = len(values)
        matrix, side = normal[:p, :p].copy(), normal[:p, -1].copy()
        if penalty is not None:
            matrix += penalty
            side -= penalty @ values
        size = np.sqrt(np.abs(np.diag(matrix))) + 1e-300
        matrix = matrix / size[:, None] / size + 1e-9 * np.eye(p)
        return np.asarray(np.linalg.lstsq(matrix, side / size, rcond=1e-13)[0] / size)

    def _move(self, reduced: Sequence[_Reduced], change: FloatArray, scale: float) -> None:
        if not self.integrated:
            return
        most = CLIP * self.swing
        for item in reduced:
            block = item.block
            block.spline = block.spline + np.clip(scale * (item.back[:, -1] - item.back[:, :-1] @ change), -most, most)
            inside = slice(block.first, block.first + self.length)
            # Between two knots four coefficients count, with the same weights in every interval.
            parts = np.lib.stride_tricks.sliding_window_view(block.spline, 4).T
            block.run.slow[inside] = (self._value[: self.knot] @ parts).T.ravel()
            block.run.slow_velocity[inside] = (self._slope[: self.knot] @ parts).T.ravel()


def direction_of_sliding(velocity: FloatArray, creep: float) -> FloatArray:
    """Direction of sliding, shape (n,); linear in time where a contact sticks, as its force is close to there.

    A low-pass spreads what is assumed there over samples that slide.
    """
    way, slides = np.sign(velocity), np.abs(velocity) > creep
    if creep == 0.0 or slides.all() or not slides.any():
        return np.asarray(way)
    at = np.arange(len(way))
    return np.interp(at, at[slides], way[slides])


def still(velocities: Iterable[FloatArray]) -> float:
    """Share of the time in which an element hardly moves, each run compared with its own rms velocity."""
    return float(np.mean(np.concatenate([np.abs(v) <= SLOW * np.sqrt(np.mean(v**2)) for v in velocities])))


def shortly_low_passed(values: FloatArray, rate: float, edge: float) -> FloatArray:
    """A record, shape (n,), through the low-pass of the columns, mirrored about its ends.

    This filter is short, so its gain differs from that of `low_passed`: the sides of an equation must pass the same one.
    """
    from scipy.ndimage import convolve1d

    return np.asarray(convolve1d(values, _taps(rate, edge), mode="mirror"))


def _taps(rate: float, edge: float) -> FloatArray:
    # The low-pass of `low_passed` as a short symmetric filter, shape (odd,); one for none.
    if np.isinf(edge):
        return np.ones(1)
    half = int(np.ceil(TAPS * rate / edge))
    response = np.fft.irfft(lowpass_gain(np.asarray(np.fft.rfftfreq(64 * half, 1.0 / rate)), edge))
    taps = np.concatenate([response[-half:], response[: half + 1]]) * np.kaiser(2 * half + 1, KAISER)
    return np.asarray(taps / taps.sum())


def spline_columns(values: FloatArray, low: float, high: float, intervals: int) -> FloatArray:
    """Uniform cubic B-splines over [low, high], shape (n, intervals + 3); values outside count as the ends."""
    step = (high - low) / intervals
    place = np.clip((values - low) / step, 0.0, intervals - 1e-9)
    first = place.astype(int)
    x = place - first
    parts = np.stack([(1 - x) ** 3, 3 * x**3 - 6 * x**2 + 4, -3 * x**3 + 3 * x**2 + 3 * x + 1, x**3], 1) / 6.0
    found = np.zeros((len(values), intervals + 3))
    rows = np.arange(len(values))
    for k in range(4):
        found[rows, first + k] = parts[:, k]
    return found


def bending(count: int) -> FloatArray:
    """Second differences of neighbouring coefficients as a quadratic form, shape (count, count)."""
    second = np.diff(np.eye(count), 2, axis=0)
    return np.asarray(second.T @ second)
