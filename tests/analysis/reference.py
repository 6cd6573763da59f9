"""An integrator that shares nothing with the engine: DOP853 at tight tolerance, sample by sample, events located, any law."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

THREE = {"m": (80.0, 6.0, 16.4), "f": (10.8, 164.5, 5.06), "z": (0.015, 0.009, 0.073)}


@dataclass
class Reference:
    """The thesis's three-mass rig with friction between motor and table, written out from its equations.

    `sliding(v, s)` is the resistance while it slides the way s, `static` what holds it; `spring(d, v, region)` is a further
    resistance of the isolation, smooth in each region between its `corners` of d.
    """

    sliding: Callable[[float, float], float]
    static: float
    spring: Callable[[float, float, int], float] = lambda d, v, region: 0.0
    corners: tuple[float, ...] = ()
    changes: int = 0
    corners_met: int = 0

    def __post_init__(self) -> None:
        self.region = len(self.corners) // 2
        w = [2 * np.pi * f for f in THREE["f"]]
        self.k = [w[i] ** 2 * THREE["m"][i] for i in range(3)]
        self.c = [2 * THREE["z"][i] * w[i] * THREE["m"][i] for i in range(3)]

    def rates(self, z: np.ndarray, force: float, s: float) -> np.ndarray:
        (m1, m2, m3), (k1, k2, k3), (c1, c2, c3) = THREE["m"], self.k, self.c
        x1, x2, x3, v1, v2, v3 = z.tolist()
        isolation = k3 * (x3 - x1) + c3 * (v3 - v1) + self.spring(x3 - x1, v3 - v1, self.region)
        block = k2 * (x2 - x1) + c2 * (v2 - v1)
        on1, on3 = isolation + block - c1 * v1 - k1 * x1, force - isolation
        # Holding both at one speed: (on1 + r) / m1 = (on3 - r) / m3.
        r = (m1 * on3 - m3 * on1) / (m1 + m3) if s == 0.0 else self.sliding(v3 - v1, s)
        return np.array([v1, v2, v3, (on1 + r) / m1, -block / m2, (on3 - r) / m3])

    def holding(self, z: np.ndarray, force: float) -> float:
        m3 = THREE["m"][2]
        held, free = self.rates(z, force, 0.0), self.rates(z, force, 1.0)
        return float(self.sliding(z[5] - z[3], 1.0) + m3 * (free[5] - held[5]))

    def run(self, drive: np.ndarray, h: float) -> np.ndarray:
        """State at every sample, shape (n, 6), for a drive straight between samples."""
        z, s = np.zeros(6), 0.0
        states = [z]
        for k in range(len(drive) - 1):
            u0, slope, t = drive[k], (drive[k + 1] - drive[k]) / h, 0.0
            while t < h:
                z, t, s = self._piece(z, t, h, s, u0, slope)
            states.append(z)
        return np.array(states)

    def _piece(self, z: np.ndarray, t: float, h: float, s: float, u0: float, slope: float) -> tuple[np.ndarray, float, float]:
        def rhs(time, z):
            return self.rates(z, u0 + slope * time, s)

        if s == 0.0:
            witnesses = [lambda time, z, q=q: self.static - q * self.holding(z, u0 + slope * time) for q in (1.0, -1.0)]
        else:
            witnesses = [lambda time, z: s * (z[5] - z[3])]
        ends = len(witnesses)
        witnesses += [lambda time, z, c=c: z[2] - z[0] - c for c in self.corners]
        # An event that is zero at the start fires again: step off the surface first.
        young = s != 0.0 and abs(z[5] - z[3]) < 1e-13
        if s == 0.0 and min(w(t, z) for w in witnesses[:2]) < 0.0:
            self.changes += 1
            return z, t, float(np.sign(self.holding(z, u0 + slope * t)))
        begin = t
        if young:
            begin = min(t + 1e-9, h)
            z = _rk4(rhs, t, z, begin - t)
        for w in witnesses:
            w.terminal = True
        for w in witnesses[:ends]:
            w.direction = -1.0
        if begin >= h:
            return z, h, s
        for parts in (2.01, 40.01):
            found = solve_ivp(
                rhs, (begin, h), z, method="DOP853", rtol=1e-12, atol=1e-15, events=witnesses,
                max_step=(h - begin) / parts, dense_output=True,
            )  # fmt: skip
            # Below zero and back between two steps of the integrator goes unseen: look again, closely.
            between = np.linspace(begin, found.t[-1], 22)[1:-1]
            passed = list(zip(between, found.sol(between).T, strict=True))
            if all(w(*each) > -1e-15 for w in witnesses[:ends] for each in passed):
                break
        fired = [i for i, times in enumerate(found.t_events) if len(times)]
        if not fired:
            return found.y[:, -1], h, s
        i = fired[0]
        z, t = found.y_events[i][0].copy(), float(found.t_events[i][0])
        if i >= ends:
            # Past the corner of a spring: only the integrator must begin anew.
            self.corners_met += 1
            self.region += 1 if z[5] > z[3] else -1
            step = min(1e-9, h - t)
            return _rk4(rhs, t, z, step), t + step, s
        self.changes += 1
        if s == 0.0:
            return z, t, 1.0 if i == 0 else -1.0
        m1, _, m3 = THREE["m"]
        z[3] = z[5] = (m1 * z[3] + m3 * z[5]) / (m1 + m3)
        return z, t, 0.0


def _rk4(rhs, t, z, h):
    k1 = rhs(t, z)
    k2 = rhs(t + h / 2, z + h / 2 * k1)
    k3 = rhs(t + h / 2, z + h / 2 * k2)
    k4 = rhs(t + h, z + h * k3)
    return z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def smooth(
    drive: np.ndarray,
    h: float,
    *,
    force: Callable[[float, float], float],
    memory: Callable[[float, float], float] = lambda inner, v: 0.0,
) -> np.ndarray:
    """The same rig with a friction that never sticks, force(inner, v) and d inner / dt = memory(inner, v), shape (n, 6)."""
    plain = Reference(sliding=lambda v, s: 0.0, static=0.0)
    z, states = np.zeros(7), [np.zeros(6)]
    for k in range(len(drive) - 1):
        slope = (drive[k + 1] - drive[k]) / h

        def rhs(time: float, z: np.ndarray, u0: float = float(drive[k]), slope: float = float(slope)) -> np.ndarray:
            v = z[5] - z[3]
            rates, friction = plain.rates(z[:6], u0 + slope * time, 1.0), force(z[6], v)
            rates[3] += friction / THREE["m"][0]
            rates[5] -= friction / THREE["m"][2]
            return np.append(rates, memory(z[6], v))

        z = solve_ivp(rhs, (0.0, h), z, method="DOP853", rtol=1e-11, atol=1e-14).y[:, -1]
        states.append(z[:6])
    return np.array(states)
