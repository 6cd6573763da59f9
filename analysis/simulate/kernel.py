"""The compiled inner loop: phases of stick and slip, events located inside a step."""

from __future__ import annotations

import numpy as np

from analysis.jit import kernel
from analysis.measured import FloatArray, IntArray


@kernel
def element_force(code: int, p: FloatArray, d: float, v: float, t: float) -> float:
    # force along w (positive d gives negative force)
    if code == 1:
        return -p[0] * d * d * d
    if code == 2:
        return -p[0] * (p[2] * np.tanh(d / p[2]) - d) * p[1]
    if code == 3:
        return p[0] * min(max(d, -p[1]), p[1])
    if code == 4:
        if d > p[0]:
            return -max(p[1] * (d - p[0]) + p[2] * v, 0.0)
        if d < -p[0]:
            return max(-(p[1] * (d + p[0]) + p[2] * v), 0.0)
        return 0.0
    if code == 5:
        return -p[0] * v * abs(v)
    if code == 6:
        return -p[0] * p[1] * min(t, p[2]) * d
    if code == 14:
        return -p[0] * (2 / np.pi) * np.arctan(v / p[1])
    if code == 15:
        return -p[0] * v
    return 0.0


@kernel
def slip_force(code: int, p: FloatArray, v: float, s: float) -> float:
    if code == 10:
        return -p[0] * s
    if code == 11:
        g = (abs(v) / p[2]) ** p[3] if p[3] != 1.0 else abs(v) / p[2]
        if p[4] == 0.0:
            return -s * (p[0] + (p[1] - p[0]) * np.exp(-g))
        return -s * (p[0] + (p[1] - p[0]) / (1.0 + g))
    if s > 0:
        return -(p[0] + p[2] * abs(v))
    return p[1] + p[3] * abs(v)


@kernel
def dahl_force(f: float, p: FloatArray, d0: float, d1: float, v0: float, v1: float, h: float) -> float:
    fc, k = p[0], p[1]
    if v0 * v1 < 0.0:
        tau = h * v0 / (v0 - v1)
        dm = d0 + 0.5 * v0 * tau
        s = 1.0 if v0 > 0 else -1.0
        f = -s * fc + (f + s * fc) * np.exp(-k * abs(dm - d0) / fc)
        s = -s
        return -s * fc + (f + s * fc) * np.exp(-k * abs(d1 - dm) / fc)
    s = 1.0 if d1 >= d0 else -1.0
    return -s * fc + (f + s * fc) * np.exp(-k * abs(d1 - d0) / fc)


@kernel
def taylor(
    A: FloatArray,
    B: FloatArray,
    z: FloatArray,
    in0: FloatArray,
    slope: FloatArray,
    tau: float,
    out: FloatArray,
    term: FloatArray,
    work: FloatArray,
) -> None:
    # z' = A z + B (in0 + slope t)
    m, q = A.shape[0], B.shape[1]
    for i in range(m):
        acc = 0.0
        for j in range(m):
            acc += A[i, j] * z[j]
        for j in range(q):
            acc += B[i, j] * in0[j]
        term[i] = acc * tau
        out[i] = z[i] + term[i]
    for i in range(m):
        acc = 0.0
        for j in range(m):
            acc += A[i, j] * term[j]
        for j in range(q):
            acc += B[i, j] * slope[j] * tau
        work[i] = acc * tau / 2.0
        out[i] += work[i]
    for k in range(3, 40):
        big = 0.0
        for i in range(m):
            acc = 0.0
            for j in range(m):
                acc += A[i, j] * work[j]
            term[i] = acc * tau / k
        for i in range(m):
            work[i] = term[i]
            out[i] += term[i]
            big = max(big, abs(term[i]))
        if big < 1e-18:
            break


@kernel
def run(
    u: FloatArray,
    h: float,
    t0: float,
    A: FloatArray,
    B: FloatArray,
    PA: FloatArray,
    G0: FloatArray,
    G1: FloatArray,
    W: FloatArray,
    minv_w: FloatArray,
    wmw: FloatArray,
    rows: FloatArray,
    codes: IntArray,
    params: FloatArray,
    cel: IntArray,
    sense: FloatArray,
    vout: FloatArray,
    inf: FloatArray,
    limit: FloatArray,
) -> int:
    """Step the rig through a drive on a fine grid; fills `vout` (sensors, steps).

    A phase is the set of sticking contacts, a bit each; each has its own system (A, B) and full step (PA, G0, G1). Inputs are
    the drive's force and every element's; a smooth element's is predicted and corrected over the step. A step that breaks a
    stick or reverses a slip is cut at the event, which is located on the Taylor series of the motion. On landing the contact's
    momentum is shared so that both velocities agree; then the force that would hold it says whether it sticks.
    Returns -1 where the
    motion grows without bound.
    """
    # phases: bitmask over contacts. A,B: (P, m, m),(P,m,q); PA,G0,G1 step matrices; rows: (P, c, m+q) stick force rows
    m = A.shape[1]
    q = B.shape[2]
    n = m // 2
    ne = len(codes)
    nc = len(cel)
    z = np.zeros(m)
    z1 = np.zeros(m)
    za = np.zeros(m)
    wk = np.zeros(m)
    tm = np.zeros(m)
    in0 = np.zeros(q)
    in1 = np.zeros(q)
    sl = np.zeros(q)
    sgn = np.zeros(nc)
    phase = 0
    for c in range(nc):
        phase |= 1 << c
    N = len(u)
    for step in range(N):
        for r in range(sense.shape[0]):
            acc = 0.0
            for i in range(m):
                acc += sense[r, i] * z[i]
            vout[r, step] = acc
        if step == N - 1:
            break
        left = h
        tnow = t0 + step * h
        u0 = u[step]
        u1 = u[step + 1]
        for trip in range(60):
            frac = (h - left) / h
            in0[0] = u0 + (u1 - u0) * frac
            in1[0] = u1
            for e in range(ne):
                d = 0.0
                v = 0.0
                for i in range(n):
                    d += W[e, i] * z[i]
                    v += W[e, i] * z[n + i]
                if codes[e] < 10 or codes[e] >= 14:
                    in0[1 + e] = element_force(codes[e], params[e], d, v, tnow)
                    in1[1 + e] = in0[1 + e]
                elif codes[e] == 12:
                    in0[1 + e] = inf[e]
                    in1[1 + e] = inf[e]
            for c in range(nc):
                e = cel[c]
                if phase & (1 << c):
                    in0[1 + e] = 0.0
                    in1[1 + e] = 0.0
                else:
                    v = 0.0
                    for i in range(n):
                        v += W[e, i] * z[n + i]
                    in0[1 + e] = slip_force(codes[e], params[e], v, sgn[c])
                    in1[1 + e] = in0[1 + e]
            whole = left > h * (1 - 1e-12)
            passes = 1
            for e in range(ne):
                if codes[e] != 10:
                    passes = 3
            for it in range(passes):
                if whole:
                    for i in range(m):
                        acc = 0.0
                        for j in range(m):
                            acc += PA[phase, i, j] * z[j]
                        for j in range(q):
                            acc += G0[phase, i, j] * in0[j] + G1[phase, i, j] * in1[j]
                        z1[i] = acc
                else:
                    for j in range(q):
                        sl[j] = (in1[j] - in0[j]) / left
                    taylor(A[phase], B[phase], z, in0, sl, left, z1, tm, wk)
                if it + 1 < passes:
                    for e in range(ne):
                        d = 0.0
                        v = 0.0
                        d0 = 0.0
                        v0 = 0.0
                        for i in range(n):
                            d += W[e, i] * z1[i]
                            v += W[e, i] * z1[n + i]
                            d0 += W[e, i] * z[i]
                            v0 += W[e, i] * z[n + i]
                        if codes[e] < 10 or codes[e] >= 14:
                            in1[1 + e] = element_force(codes[e], params[e], d, v, tnow + left)
                        elif codes[e] == 12:
                            in1[1 + e] = dahl_force(inf[e], params[e], d0, d, v0, v, left)
                    for c in range(nc):
                        e = cel[c]
                        if not phase & (1 << c):
                            v = 0.0
                            for i in range(n):
                                v += W[e, i] * z1[n + i]
                            if v * sgn[c] < 0.0:
                                v = 0.0
                            in1[1 + e] = slip_force(codes[e], params[e], v, sgn[c])
            # events
            best = 2.0
            which = -1
            kind = 0
            for c in range(nc):
                e = cel[c]
                if phase & (1 << c):
                    lam = 0.0
                    lam0 = 0.0
                    for i in range(m):
                        lam += rows[phase, c, i] * z1[i]
                        lam0 += rows[phase, c, i] * z[i]
                    for j in range(q):
                        lam += rows[phase, c, m + j] * in1[j]
                        lam0 += rows[phase, c, m + j] * in0[j]
                    up = limit[c, 0]
                    dn = limit[c, 1]
                    if lam > up or lam < -dn:
                        bound = up if lam > up else -dn
                        th = (bound - lam0) / (lam - lam0) if lam != lam0 else 0.0
                        th = min(max(th, 0.0), 1.0)
                        if th < best:
                            best = th
                            which = c
                            kind = 1
                else:
                    v0 = 0.0
                    v1 = 0.0
                    a0 = 0.0
                    a1 = 0.0
                    for i in range(n):
                        v0 += W[e, i] * z[n + i]
                        v1 += W[e, i] * z1[n + i]
                    s = sgn[c]
                    if v1 * s < 0.0:
                        for i in range(n):
                            w = W[e, i]
                            if w != 0.0:
                                for j in range(m):
                                    a0 += w * A[phase, n + i, j] * z[j]
                                    a1 += w * A[phase, n + i, j] * z1[j]
                                for j in range(q):
                                    a0 += w * B[phase, n + i, j] * in0[j]
                                    a1 += w * B[phase, n + i, j] * in1[j]
                        lo = 0.0
                        hi = 1.0
                        a0 *= left
                        a1 *= left
                        for _ in range(60):
                            th = 0.5 * (lo + hi)
                            val = (
                                v0 * (1 + 2 * th) * (1 - th) ** 2
                                + a0 * th * (1 - th) ** 2
                                + v1 * th * th * (3 - 2 * th)
                                - a1 * th * th * (1 - th)
                            )
                            if val * s > 0:
                                lo = th
                            else:
                                hi = th
                        if hi < best:
                            best = hi
                            which = c
                            kind = 2
            if which < 0:
                tau = left
                for i in range(m):
                    z[i] = z1[i]
            else:
                tau = best * left
                for j in range(q):
                    sl[j] = (in1[j] - in0[j]) / left
                taylor(A[phase], B[phase], z, in0, sl, tau, za, tm, wk)
                if kind == 1:
                    # refine the instant of breakaway by one secant step on the exact motion
                    for _ in range(3):
                        lam = 0.0
                        rate = 0.0
                        for i in range(m):
                            lam += rows[phase, which, i] * za[i]
                        for j in range(q):
                            inj = in0[j] + sl[j] * tau
                            lam += rows[phase, which, m + j] * inj
                            rate += rows[phase, which, m + j] * sl[j]
                        for i in range(m):
                            r = rows[phase, which, i]
                            if r != 0.0:
                                for k in range(m):
                                    rate += r * A[phase, i, k] * za[k]
                                for k in range(q):
                                    rate += r * B[phase, i, k] * (in0[k] + sl[k] * tau)
                        bound = limit[which, 0] if lam > 0 else -limit[which, 1]
                        if rate == 0.0:
                            break
                        new = min(max(tau - (lam - bound) / rate, 0.0), left)
                        if abs(new - tau) < 1e-15 * h:
                            break
                        tau = new
                        taylor(A[phase], B[phase], z, in0, sl, tau, za, tm, wk)
                    for i in range(m):
                        z[i] = za[i]
                    lam = 0.0
                    for i in range(m):
                        lam += rows[phase, which, i] * z[i]
                    for j in range(q):
                        lam += rows[phase, which, m + j] * (in0[j] + sl[j] * tau)
                    sgn[which] = 1.0 if lam > 0 else -1.0
                    phase &= ~(1 << which)
                else:
                    e = cel[which]
                    for _ in range(4):
                        v = 0.0
                        rate = 0.0
                        for i in range(n):
                            w = W[e, i]
                            if w != 0.0:
                                v += w * za[n + i]
                                for k in range(m):
                                    rate += w * A[phase, n + i, k] * za[k]
                                for k in range(q):
                                    rate += w * B[phase, n + i, k] * (in0[k] + sl[k] * tau)
                        if rate == 0.0 or abs(v) < 1e-17:
                            break
                        new = tau - v / rate
                        if new < 0.0 or new > left:
                            break
                        tau = new
                        taylor(A[phase], B[phase], z, in0, sl, tau, za, tm, wk)
                    for i in range(m):
                        z[i] = za[i]
                    v = 0.0
                    for i in range(n):
                        v += W[e, i] * z[n + i]
                    for i in range(n):
                        z[n + i] -= minv_w[e, i] * v / wmw[e]
                    phase |= 1 << which
                    lam = 0.0
                    for i in range(m):
                        lam += rows[phase, which, i] * z[i]
                    for j in range(q):
                        if j != 1 + e:
                            lam += rows[phase, which, m + j] * (in0[j] + sl[j] * tau)
                    if lam > limit[which, 0] or lam < -limit[which, 1]:
                        sgn[which] = 1.0 if lam > 0 else -1.0
                        phase &= ~(1 << which)
            for e in range(ne):
                if codes[e] == 12:
                    if which < 0:
                        inf[e] = in1[1 + e]
                    else:
                        inf[e] = in0[1 + e] + (in1[1 + e] - in0[1 + e]) * tau / left
            left -= tau
            tnow += tau
            if left <= 1e-13 * h:
                break
        if not abs(z[0]) < 1e9:
            return -1
    return 0
