"""Interim engine."""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from analysis import laws
from analysis.errors import ModelError, SimulationError
from analysis.jit import fast_kernel, kernel
from analysis.measured import FloatArray
from analysis.model import GROUND, Link, RigModel, direction, matrices

TAPS = 16


@lru_cache(maxsize=16)
def _lowpass(factor: int, half: int) -> FloatArray:
    from scipy.signal import firwin

    return firwin(2 * half * factor + 1, 1.0 / factor, window=("kaiser", 8.0)) if factor > 1 else np.ones(1)


def interpolate(x: FloatArray, factor: int) -> FloatArray:
    from scipy.signal import upfirdn

    if factor == 1:
        return x
    h = _lowpass(factor, TAPS) * factor
    y = upfirdn(h, x, up=factor)
    lead = TAPS * factor
    return y[lead : lead + len(x) * factor]


def decimate(x: FloatArray, factor: int, axis: int = -1) -> FloatArray:
    from scipy.signal import upfirdn

    h = _lowpass(factor, TAPS)
    y = upfirdn(h, x, down=factor, axis=axis)
    lead = TAPS
    return y[..., lead : lead + (x.shape[-1] + factor - 1) // factor]


@dataclass(frozen=True)
class Excitation:
    recorded: FloatArray
    sample_rate: float
    oversample: int
    fine: FloatArray

    @classmethod
    def prepare(cls, drive: FloatArray, sample_rate: float, *, oversample: int = 8) -> Excitation:
        return cls(np.asarray(drive), sample_rate, oversample, interpolate(np.asarray(drive), oversample))


@dataclass(frozen=True)
class Response:
    sample_rate: float
    channels: dict[str, FloatArray]
    relative: dict[str, tuple[FloatArray, FloatArray]]


CODES = {laws.Cubic: 1, laws.BoundedSoftening: 2, laws.Backlash: 3, laws.EndStop: 4, laws.QuadraticDamping: 5,
         laws.Drift: 6, laws.Coulomb: 10, laws.Stribeck: 11, laws.Dahl: 12, laws.Asymmetric: 13, laws.Arctan: 14, laws.Viscous: 15}


@kernel
def element_force(code, p, d, v, t):
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
def slip_force(code, p, v, s):
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
def dahl_force(f, p, d0, d1, v0, v1, h):
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
def taylor(A, B, z, in0, slope, tau, out, term, work):
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
def run(u, h, t0, A, B, PA, G0, G1, W, minv_w, wmw, rows, codes, params, cel, sense, vout, dout, inf, limit, stats):
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
        for e in range(ne):
            acc = 0.0
            acv = 0.0
            for i in range(n):
                acc += W[e, i] * z[i]
                acv += W[e, i] * z[n + i]
            dout[0, e] = max(dout[0, e], abs(acc))
            dout[1, e] = max(dout[1, e], abs(acv))
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
                            val = (v0 * (1 + 2 * th) * (1 - th) ** 2 + a0 * th * (1 - th) ** 2 + v1 * th * th * (3 - 2 * th) - a1 * th * th * (1 - th))
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
                stats[0] += 1
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


@dataclass
class Compiled:
    A: Any; B: Any; PA: Any; G0: Any; G1: Any; W: Any; minv_w: Any; wmw: Any; rows: Any
    codes: Any; params: Any; cel: Any; limit: Any; n: int; T: Any; names: list[str]


def constraint_basis(model: RigModel, links: list[Link]) -> FloatArray:
    from scipy.linalg import null_space
    n = len(model.bodies)
    if not links:
        return np.eye(n)
    rows = np.array([direction(model, l.a, l.b, l.arms) for l in links])
    T = np.eye(n)
    for row in rows:
        r = row @ T
        k = int(np.argmax(np.abs(r)))
        # eliminate coordinate k
        E = np.delete(np.eye(T.shape[1]), k, axis=1)
        E[k] = -np.delete(r, k) / r[k]
        T = T @ E
    return T


def compile_rig(model: RigModel, configuration: str, h: float) -> Compiled:
    from scipy.linalg import expm
    if configuration not in model.configurations:
        raise ModelError(f"configuration {configuration!r} is unknown; the rig has {list(model.configurations)}")
    conf = model.configurations[configuration]
    M, C, K = matrices(model)
    rigid: list[Link] = []
    for name in conf.rigid:
        link = model.link(name)
        if conf.lock_stiffness is None:
            rigid.append(link)
        else:
            w = direction(model, link.a, link.b, {})
            K = K + conf.lock_stiffness * np.outer(w, w)
            C = C + conf.lock_damping * np.outer(w, w)
    T = constraint_basis(model, rigid)
    blocked = set(conf.rigid)
    M, C, K = T.T @ M @ T, T.T @ C @ T, T.T @ K @ T
    elements = []
    for link in model.links:
        if link.name in blocked:
            continue
        w = direction(model, link.a, link.b, link.arms) @ T
        for law in link.laws:
            if isinstance(law, laws.Cubic): p = [law.cubic_stiffness]
            elif isinstance(law, laws.BoundedSoftening): p = [link.stiffness, law.softening, law.scale]
            elif isinstance(law, laws.Backlash): p = [link.stiffness * (1 - law.residual), law.clearance]
            elif isinstance(law, laws.EndStop): p = [law.stroke, law.contact_stiffness, law.contact_damping]
            elif isinstance(law, laws.QuadraticDamping): p = [law.quadratic_damping]
            else: p = [link.stiffness, law.drift_rate, 1e18 if law.until is None else law.until]
            elements.append((w, CODES[type(law)], p, link.name))
    contacts = []
    for contact in model.contacts:
        if contact.name in blocked:
            continue
        w = direction(model, contact.a, contact.b, contact.arms) @ T
        law = contact.law
        lim = None
        if isinstance(law, laws.Coulomb):
            fs = law.friction_force if law.static_force is None else law.static_force
            p, lim = [law.friction_force], (fs, fs)
        elif isinstance(law, laws.Stribeck):
            p = [law.friction_force, law.static_force, law.stribeck_velocity, law.exponent, 0.0 if law.shape == "exponential" else 1.0]
            lim = (law.static_force,) * 2
        elif isinstance(law, laws.Asymmetric):
            p, lim = [law.forward_force, law.backward_force, law.forward_viscosity, law.backward_viscosity], (law.forward_force, law.backward_force)
        elif isinstance(law, laws.Dahl):
            p = [law.friction_force, law.bristle_stiffness]
        elif isinstance(law, laws.Arctan):
            p = [law.friction_force, law.smoothing_velocity]
        else:
            p = [law.viscous_coefficient]  # type: ignore
        if lim is not None:
            contacts.append((len(elements), lim))
        elements.append((w, CODES[type(law)], p, contact.name))
    n = T.shape[1]
    ne = len(elements)
    W = np.array([e[0] for e in elements]).reshape(ne, n)
    Minv = np.linalg.inv(M)
    b = np.zeros(len(model.bodies))
    names = [body.name for body in model.bodies]
    for name, factor in model.drive.pushes.items():
        b[names.index(name)] += factor
    F = np.column_stack([T.T @ b * model.drive.factor, *W]) if ne else (T.T @ b * model.drive.factor)[:, None]
    q = 1 + ne
    m = 2 * n
    nc = len(contacts)
    P = 1 << nc
    A = np.zeros((P, m, m)); B = np.zeros((P, m, q)); PA = np.zeros((P, m, m)); G0 = np.zeros((P, m, q)); G1 = np.zeros((P, m, q))
    rows = np.zeros((P, max(nc, 1), m + q))
    for ph in range(P):
        acc = -Minv @ np.column_stack([K, C]); bb = Minv @ F
        S = [contacts[c][0] for c in range(nc) if ph >> c & 1]
        if S:
            Ws = W[S]
            G = np.linalg.pinv(Ws @ Minv @ Ws.T)
            lam = G @ Ws @ np.column_stack([acc, bb])  # force that holds: positive = tends to slide forward
            acc = acc - Minv @ Ws.T @ lam[:, :m]; bb = bb - Minv @ Ws.T @ lam[:, m:]
            k = 0
            for c in range(nc):
                if ph >> c & 1:
                    rows[ph, c] = lam[k]; k += 1
        A[ph, :n, n:] = np.eye(n); A[ph, n:] = acc; B[ph, n:] = bb
        aug = np.zeros((m + 2 * q, m + 2 * q))
        aug[:m, :m] = A[ph] * h; aug[:m, m:m + q] = B[ph] * h; aug[m:m + q, m + q:] = np.eye(q)
        E = expm(aug)
        PA[ph] = E[:m, :m]; G1[ph] = E[:m, m + q:]; G0[ph] = E[:m, m:m + q] - G1[ph]
    return Compiled(A, B, PA, G0, G1, W if ne else np.zeros((0, n)), (Minv @ W.T).T.copy() if ne else np.zeros((0, n)),
                    np.einsum("ij,jk,ik->i", W, Minv, W) if ne else np.zeros(0), rows,
                    np.array([e[1] for e in elements], dtype=np.int64),
                    np.array([e[2] + [0.0] * (5 - len(e[2])) for e in elements]).reshape(ne, 5),
                    np.array([c[0] for c in contacts], dtype=np.int64), np.array([c[1] for c in contacts]).reshape(nc, 2), n, T, [e[3] for e in elements])


@lru_cache(maxsize=16)
def _sampler(factor: int, differentiate: bool) -> FloatArray:
    h = _lowpass(factor, TAPS)
    g = np.convolve(h, [0.5, 0.0, -0.5]) if differentiate else h
    # zeros in front bring the filter's middle onto the decimated grid
    return np.concatenate([np.zeros(-(len(g) // 2) % factor), g])


@fast_kernel
def fir(taps, x, down, lead, n):
    length = len(taps)
    flipped = taps[::-1].copy()
    out = np.zeros(n)
    for k in range(n):
        last = (k + lead) * down
        first = last - length + 1
        lo = max(0, -first)
        hi = min(length, len(x) - first)
        acc = 0.0
        for j in range(lo, hi):
            acc += flipped[j] * x[first + j]
        out[k] = acc
    return out


def sampled(fine: FloatArray, factor: int, n: int, h: float, differentiate: bool) -> FloatArray:
    tail = TAPS * factor + 2
    if differentiate:
        slope = fine[-1] - fine[-2]
        fine = np.concatenate([fine, fine[-1] + slope * np.arange(1, tail)])
    g = _sampler(factor, differentiate)
    lead = TAPS + (1 if differentiate and factor > 1 else 0)
    if factor == 1:
        lead = 1 if differentiate else 0
    return fir(g / h if differentiate else g, fine, factor, lead, n)


def shift(x: FloatArray, delay: float, rate: float) -> FloatArray:
    """x(t - delay), band-limited, on zero-padded spectrum."""
    if delay == 0.0:
        return x
    n = len(x)
    size = 1 << int(np.ceil(np.log2(n + 2 * abs(delay) * rate + 64)))
    f = np.fft.rfftfreq(size, 1.0 / rate)
    return np.fft.irfft(np.fft.rfft(x, size) * np.exp(-2j * np.pi * f * delay), size)[:n]


def record(model: RigModel, motion: Mapping[str, FloatArray], rate: float) -> dict[str, FloatArray]:
    chains = {model.drive.channel: model.drive.chain, **{s.channel: s.chain for s in model.sensors}}
    out = {}
    for name, true in motion.items():
        chain = chains[name]
        y = chain.gain * shift(true, chain.delay, rate) if (chain.gain != 1.0 or chain.delay) else true
        for source, fraction in chain.crosstalk.items():
            if fraction:
                y = y + fraction * motion[source]
        if chain.limit is not None:
            y = np.clip(y, -chain.limit, chain.limit)
        out[name] = y
    return out


def true_drive(model: RigModel, excitation: Excitation) -> FloatArray:
    """The drive channel's true values, its own chain's gain and delay undone."""
    chain = model.drive.chain
    return shift(excitation.recorded, -chain.delay, excitation.sample_rate) / chain.gain


def simulate(model: RigModel, excitation: Excitation, *, configuration: str = "unlocked", start_time: float = 0.0,
             as_recorded: bool = False, samples: int | None = None) -> Response:
    rate, over = excitation.sample_rate, excitation.oversample
    n = len(excitation.recorded) if samples is None else samples
    margin = 2 * TAPS
    total = min((n + margin) * over, len(excitation.fine))
    fine = excitation.fine[:total]
    chain = model.drive.chain
    if chain.delay:
        fine = shift(excitation.fine, -chain.delay, rate * over)[:total]
    if chain.gain != 1.0:
        fine = fine / chain.gain
    h = 1.0 / (rate * over)
    comp = compile_rig(model, configuration, h)
    sense = np.zeros((len(model.sensors), 2 * comp.n))
    for k, s in enumerate(model.sensors):
        w = direction(model, s.body, s.relative_to, s.arms) @ comp.T
        if s.quantity in ("acceleration", "velocity"):
            sense[k, comp.n:] = w
        else:
            sense[k, : comp.n] = w
    vout = np.zeros((len(model.sensors), total))
    peaks = np.zeros((2, len(comp.codes)))
    stats = np.zeros(4, dtype=np.int64)
    status = run(np.ascontiguousarray(fine), h, start_time, comp.A, comp.B, comp.PA, comp.G0, comp.G1, comp.W, comp.minv_w, comp.wmw,
                 comp.rows, comp.codes, comp.params, comp.cel, sense, vout, peaks, np.zeros(len(comp.codes)), comp.limit, stats)
    if status < 0:
        raise SimulationError(f"the rig {model.name!r} grows without bound; correct its stiffness and damping")
    channels = {s.channel: sampled(vout[k], over, n, h, s.quantity == "acceleration") for k, s in enumerate(model.sensors)}
    if as_recorded:
        motion = {model.drive.channel: true_drive(model, excitation)[:n], **channels}
        done = record(model, motion, rate)
        channels = {k: done[k] for k in channels}
    return Response(rate, channels, {name: (peaks[0, i], peaks[1, i]) for i, name in enumerate(comp.names)})
