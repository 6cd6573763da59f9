"""Poles of many transfer functions at once, at every model order: the poly-reference least squares complex frequency method.

A right matrix fraction description in z over a band is fitted by linear least squares to the transfer functions from all
references to all responses (Guillaume, Verboven, Vanlanduit, Van der Auweraer and Peeters 2003). Physical poles persist over the
orders, numerical ones do not: the stabilization diagram.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from isorig.analysis.campaign import ComplexArray, FloatArray

Status = Literal["new", "frequency", "stable"]

#: Largest order, and frequency bins needed for each order.
ORDER, BINS_PER_ORDER = 60, 3.0
#: A pole matches one of the order before if its frequency differs by less than the first share, and is stable if its damping
#: ratio differs by less than the second (usual bounds; Peeters, Van der Auweraer, Guillaume and Leuridan 2004).
SAME_FREQUENCY, SAME_DAMPING = 0.01, 0.05
#: Poles with a damping ratio above this are not modes.
HEAVY = 0.3
#: Share of the unit circle that the band is mapped to: a gap separates the ends of the band.
CIRCLE = 0.95


@dataclass(frozen=True, kw_only=True)
class Pole:
    """A pole at one model order: natural frequency (Hz), damping ratio, and its status compared with the order before."""

    order: int
    frequency: float
    damping: float
    status: Status


def poles_by_order(values: ComplexArray, frequency: FloatArray, weights: FloatArray, order: int | None) -> tuple[Pole, ...]:
    """The poles at every order from 1 to the largest: `ORDER` or as the number of bins allows if None.

    They have positive frequency and damping ratios between 0 and `HEAVY`, and are by order and ascending in frequency. The
    transfer functions have shape (responses, references, bins), at evenly spaced frequencies in Hz, the weights of each response
    (responses, bins).
    """
    references = values.shape[1]
    most = min(order or ORDER, int(len(frequency) * len(values) / (BINS_PER_ORDER * references)), int(len(frequency) / 2) - 1)
    blocks = _normal_blocks(values, frequency, weights, most)
    found: list[Pole] = []
    before: list[tuple[float, float]] = []
    for n in range(1, most + 1):
        now = sorted(_poles(_reduced(blocks, n, references), n, references, frequency))
        found += [Pole(order=n, frequency=f, damping=zeta, status=status_of(f, zeta, before)) for f, zeta in now]
        before = now
    return tuple(found)


def _normal_blocks(
    values: ComplexArray, frequency: FloatArray, weights: FloatArray, most: int
) -> list[tuple[ComplexArray, ComplexArray, ComplexArray]]:
    # For each response the sums over bins of basis * basis, basis * H and H * H, each for all powers up to `most`.
    turn = -2j * np.pi * CIRCLE / (frequency[-1] - frequency[0])
    basis = np.exp(turn * np.outer(frequency - frequency[0], np.arange(most + 1)))
    blocks = []
    for row, weight in zip(values, weights, strict=True):
        x = basis * weight[:, None]
        y = -(x[:, :, None] * row.T[:, None, :]).reshape(len(frequency), -1)
        blocks.append((np.conj(x.T) @ x, np.conj(x.T) @ y, np.conj(y.T) @ y))
    return blocks


def _reduced(blocks: Sequence[tuple[ComplexArray, ComplexArray, ComplexArray]], n: int, references: int) -> ComplexArray:
    # The normal equations of the denominator alone: sum of T - S^H R^-1 S.
    a, b = n + 1, (n + 1) * references
    total = np.zeros((b, b), dtype=np.complex128)
    for r, s, t in blocks:
        total += t[:b, :b] - np.conj(s[:a, :b].T) @ np.linalg.lstsq(r[:a, :a], s[:a, :b], rcond=None)[0]
    return total


def _poles(total: ComplexArray, n: int, references: int, frequency: FloatArray) -> list[tuple[float, float]]:
    # With the unit matrix as the constant coefficient, purely numerical poles are unstable and are removed.
    free = total[references:, references:]
    alpha = np.linalg.lstsq(free, -total[references:, :references], rcond=None)[0]
    # A(z) = I + A_1 z + ... + A_n z^n: 1 / z are the eigenvalues of the companion matrix.
    size = n * references
    companion = np.zeros((size, size), dtype=np.complex128)
    for j in range(n):
        companion[:references, j * references : (j + 1) * references] = -alpha[j * references : (j + 1) * references].T
    companion[references:, :-references] = np.eye(size - references)
    inverse = np.linalg.eigvals(companion)
    inverse = inverse[np.abs(inverse) > 1e-9]
    # z = exp(turn (s - s1) / 2 pi i): back to s.
    span = frequency[-1] - frequency[0]
    logs = np.log(inverse)
    turns = np.where(logs.imag < -np.pi * (1.0 - CIRCLE), logs.imag + 2.0 * np.pi, logs.imag)
    s = (logs.real + 1j * turns) * span / CIRCLE + 2j * np.pi * frequency[0]
    natural = np.abs(s) / (2.0 * np.pi)
    damping = -s.real / np.abs(s)
    kept = (damping > 0.0) & (damping < HEAVY) & (natural >= frequency[0]) & (natural <= frequency[-1])
    return [(float(f), float(zeta)) for f, zeta in zip(natural[kept], damping[kept], strict=True)]


def status_of(f: float, zeta: float, before: Sequence[tuple[float, float]]) -> Status:
    """What a pole's frequency (Hz) and damping ratio agree with among the poles of the order before."""
    near = [other for other in before if abs(other[0] - f) < SAME_FREQUENCY * f]
    if not near:
        return "new"
    return "stable" if any(abs(other[1] - zeta) < SAME_DAMPING * zeta for other in near) else "frequency"
