"""Rigs with several dry contacts by another method than the engine's, twice.

`Located` goes from event to event: scipy's matrix exponential on a dense grid, margins located by Brent's method. At an
instant the accelerations come from the bounded least-squares problem min |M^(-1/2) (f - W' r)|, |r| <= F (scipy's BVLS), whose
solution is unique where breakaway equals sliding friction; where it is greater, the documented rule is written out plainly.

`time_stepped` is Moreau's scheme: implicit small steps, the contacts' impulses by projected Gauss-Seidel; first order, no events.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq, linprog, lsq_linear

#: Grid points between two samples of the drive; speeds below a share of the largest one are rest.
DENSE, REST = 8, 1e-9
#: How far ahead, as a share of a sample, an instant looks to see which way forces at their limits go.
AHEAD = 1e-4


@dataclass
class Located:
    """M x'' + C x' + K x = push u(t) - W' r, r the contacts' resistance: at most `breakaway` held, `sliding` while sliding."""

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    push: np.ndarray
    rows: np.ndarray
    sliding: np.ndarray
    breakaway: np.ndarray
    changes: int = 0
    steps: dict = field(default_factory=dict)
    kept: dict = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.n, self.k = len(self.mass), len(self.rows)
        self.inverse = np.linalg.inv(self.mass)
        self.root = np.linalg.cholesky(self.inverse).T
        self.fastest = 0.0

    def run(self, drive: np.ndarray, h: float) -> np.ndarray:
        """Positions and speeds at the samples, shape (n, samples, 2), for a drive straight between them."""
        z, s = np.zeros(2 * self.n), np.zeros(self.k, dtype=int)
        out = [z]
        for k in range(len(drive) - 1):
            y, left = np.concatenate([z, [1.0, drive[k], (drive[k + 1] - drive[k]) / h]]), h
            while left > 1e-12 * h:
                y, taken, s = self.piece(y, min(h / DENSE, left), h, s)
                left -= taken
            z = y[: 2 * self.n]
            out.append(z)
        return np.array(out)

    def system(self, s: np.ndarray) -> np.ndarray:
        """y' = system y of y = (x, v, 1, u, u') while the contacts are in states s."""
        n = self.n
        system = np.zeros((2 * n + 3, 2 * n + 3))
        system[:n, n : 2 * n] = np.eye(n)
        forces = np.column_stack([-self.stiffness, -self.damping, -self.rows.T @ (s * self.sliding), self.push, 0.0 * self.push])
        held = self.rows[s == 0]
        if len(held):
            a = held @ self.inverse @ held.T
            forces = forces - held.T @ np.linalg.pinv(a, rcond=1e-9) @ held @ self.inverse @ forces
        system[n : 2 * n] = self.inverse @ forces
        system[-2, -1] = 1.0
        return system

    def moved(self, s: np.ndarray, y: np.ndarray, t: float) -> np.ndarray:
        key = (*s, t)
        if key not in self.steps:
            self.steps[key] = expm(self.system(s) * t)
        return self.steps[key] @ y

    def margins(self, s: np.ndarray, y: np.ndarray) -> np.ndarray:
        """What must stay above zero: speed the way it slides; what the held contacts together can still bear."""
        n = self.n
        v = s * (self.rows @ y[n : 2 * n])
        held = np.flatnonzero(s == 0)
        if len(held) == 0:
            return v
        bearing = self.inverse @ (self.loose(y) - self.rows.T @ (s * self.sliding))
        w = self.rows[held]
        a, b = w @ self.inverse @ w.T, w @ bearing
        scale = np.abs(a).max()
        if tuple(held) not in self.kept:
            # Rows that depend on others are left out of the equations.
            _, sizes, right = np.linalg.svd(a / scale)
            self.kept[tuple(held)] = right[sizes > 1e-9]
        kept = self.kept[tuple(held)]
        if len(kept) == len(held):
            v[held] = 1.0 - np.abs(np.linalg.solve(a, b)) / self.breakaway[held]
            return v
        # Shares are open: the least load, as a share of breakaway, that they can hold with.
        force = self.breakaway[held]
        upper = np.column_stack([np.vstack([np.eye(len(held)), -np.eye(len(held))]), -np.tile(force, 2)])
        found = linprog(
            np.append(np.zeros(len(held)), 1.0), A_ub=upper, b_ub=np.zeros(2 * len(held)),
            A_eq=np.column_stack([kept @ a / scale, np.zeros(len(kept))]), b_eq=kept @ b / scale, bounds=(None, None),
        )  # fmt: skip
        v[held] = 1.0 - found.x[-1]
        return v

    def loose(self, y: np.ndarray) -> np.ndarray:
        n = self.n
        return self.push * y[-2] - self.stiffness @ y[:n] - self.damping @ y[n : 2 * n]

    def piece(self, y: np.ndarray, t: float, h: float, s: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
        """Up to `t` further, or to the next event."""
        n = self.n
        self.fastest = max(self.fastest, float(np.abs(self.rows @ y[n : 2 * n]).max(initial=0.0)))
        begin, end = self.margins(s, y), self.moved(s, y, t)
        last = self.margins(s, end)
        tiny = np.where(s == 0, 1e-9, REST * self.fastest)
        best, which = t, -1
        inner = [self.margins(s, self.moved(s, y, t * q / 4)) for q in (1, 2, 3)]
        for i in range(self.k):
            if begin[i] < -tiny[i]:
                return (*self.instant(y, 0.0, h, s, i),)
            low = 0.0
            if begin[i] <= tiny[i]:
                low = 1e-5 * t
                if self.margins(s, expm(self.system(s) * low) @ y)[i] < 0.0 and last[i] < 0.0:
                    return (*self.instant(y, 0.0, h, s, i),)
            high = t
            if last[i] >= 0.0:
                # There and back within: the lowest of some points, where it is near enough.
                middle = [margins[i] for margins in inner]
                at = int(np.argmin(middle))
                if middle[at] > 0.5 * min(begin[i], last[i]) or begin[i] <= tiny[i]:
                    continue
                near = np.linspace(t * at / 4, t * (at + 2) / 4, 65)[1:-1]
                dip = [self.margins(s, expm(self.system(s) * x) @ y)[i] for x in near]
                if min(dip) >= 0.0:
                    continue
                high = float(near[int(np.argmin(dip))])
            found = brentq(lambda x, i=i: self.margins(s, expm(self.system(s) * x) @ y)[i], low, high, xtol=1e-15 * h, rtol=1e-14)
            if found < best:
                best, which = found, i
        if which < 0:
            return end, t, s
        y = expm(self.system(s) * best) @ y
        return (*self.instant(y, best, h, s, which),)

    def instant(self, y: np.ndarray, taken: float, h: float, s: np.ndarray, which: int) -> tuple[np.ndarray, float, np.ndarray]:
        """The states in which the motion goes on, and the state with what rests made to rest."""
        n, rows = self.n, self.rows
        v = rows @ y[n : 2 * n]
        rests = (s == 0) | (np.abs(v) <= REST * self.fastest)
        rests[which] = True
        w = rows[rests]
        y = y.copy()
        y[n : 2 * n] -= self.inverse @ w.T @ np.linalg.pinv(w @ self.inverse @ w.T, rcond=1e-9) @ w @ y[n : 2 * n]
        if np.array_equal(self.sliding, self.breakaway):
            new = self.least_squares(y, h, s, rests)
        else:
            new = self.in_turn(y, h, s, rests, which)
        self.changes += int((new != s).sum())
        return y, taken, new

    def soon(self, y: np.ndarray, acceleration: np.ndarray, h: float) -> np.ndarray:
        n, dt = self.n, AHEAD * h
        later = y.copy()
        later[:n] += dt * y[n : 2 * n] + 0.5 * dt**2 * acceleration
        later[n : 2 * n] += dt * acceleration
        later[-2] += dt * y[-1]
        return self.loose(later)

    def least_squares(self, y: np.ndarray, h: float, s: np.ndarray, rests: np.ndarray) -> np.ndarray:
        moving = np.where(rests, 0, s)
        free = self.rows.T @ (moving * self.sliding)
        w, limit = self.rows[rests], self.sliding[rests]

        def accelerations(force: np.ndarray) -> np.ndarray:
            r = lsq_linear(self.root @ w.T, self.root @ force, bounds=(-limit, limit), method="bvls", tol=1e-15).x
            return self.inverse @ (force - w.T @ r)

        first = accelerations(self.loose(y) - free)
        second = accelerations(self.soon(y, first, h) - free)
        new = moving.copy()
        for i in np.flatnonzero(rests):
            a, b = self.rows[i] @ first, self.rows[i] @ second
            size = np.abs(self.rows[i]).max() * np.abs(self.inverse).max() * np.abs(self.loose(y)).max() + 1e-300
            if abs(a) > 1e-9 * size:
                new[i] = int(np.sign(a))
            elif abs(b) > 1e-12 * size:
                new[i] = int(np.sign(b))
        return new

    def in_turn(self, y: np.ndarray, h: float, s: np.ndarray, rests: np.ndarray, which: int) -> np.ndarray:
        """What holds goes on holding; of what cannot, the most overloaded lets go first."""
        rows = self.rows
        new = s.copy()
        if s[which] != 0:
            new[which] = 0
        elif self.margins(s, y)[which] > -1e-6:
            new[which] = int(np.sign(self.forces(y, s)[which]))
        for _ in range(60):
            first = self.inverse @ (self.loose(y) - rows.T @ self.forces(y, new))
            later = y.copy()
            later[: self.n] += AHEAD * h * y[self.n : 2 * self.n]
            later[self.n : 2 * self.n] += AHEAD * h * first
            later[-2] += AHEAD * h * y[-1]
            load = self.forces(later, new)
            a = rows @ self.inverse @ (self.loose(later) - rows.T @ load)
            wrong = [i for i in np.flatnonzero(rests) if new[i] != 0 and new[i] * a[i] < -1e-12 * np.abs(a).max()]
            if wrong:
                new[wrong[0]] = 0
                continue
            held = np.flatnonzero(new == 0)
            over = np.abs(load[held]) / self.breakaway[held]
            if len(held) == 0 or over.max() <= 1.0 + 1e-12:
                return new
            worst = held[int(np.argmax(over))]
            new[worst] = int(np.sign(load[worst]))
        raise AssertionError("the rule runs in a circle; the reference takes only rigs in which it does not")

    def forces(self, y: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Resistance of every contact in states s."""
        r = s * self.sliding
        held = s == 0
        if held.any():
            w = self.rows[held]
            free = self.inverse @ (self.loose(y) - self.rows.T @ r)
            r = r + 0.0
            r[held] = np.linalg.pinv(w @ self.inverse @ w.T, rcond=1e-9) @ w @ free
        return r


def time_stepped(rig: Located, drive: np.ndarray, h: float, parts: int) -> np.ndarray:
    """Positions and speeds at the samples by Moreau's scheme in `parts` steps a sample, shape (samples, 2 n)."""
    n, dt, rows = rig.n, h / parts, rig.rows
    matrix = np.linalg.inv(rig.mass + dt * rig.damping + dt**2 * rig.stiffness)
    delassus = rows @ matrix @ rows.T
    limit = dt * rig.sliding
    x, v, impulse = np.zeros(n), np.zeros(n), np.zeros(rig.k)
    out = [np.zeros(2 * n)]
    for k in range(len(drive) - 1):
        for part in range(parts):
            u = drive[k] + (drive[k + 1] - drive[k]) * (part + 1) / parts
            free = matrix @ (rig.mass @ v + dt * (rig.push * u - rig.stiffness @ x))
            want = rows @ free
            for _ in range(200):
                before = impulse.copy()
                for i in range(rig.k):
                    rest = want[i] - delassus[i] @ impulse + delassus[i, i] * impulse[i]
                    impulse[i] = np.clip(rest / delassus[i, i], -limit[i], limit[i])
                if np.abs(impulse - before).max() <= 1e-12 * limit.max():
                    break
            v = free - matrix @ rows.T @ impulse
            x = x + dt * v
        out.append(np.concatenate([x, v]))
    return np.array(out)
