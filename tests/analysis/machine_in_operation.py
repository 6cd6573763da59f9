"""Records of a machine in operation whose modes are known: two masses, both pushed by noise."""

from __future__ import annotations

import numpy as np
from scipy.signal import cont2discrete, decimate, lfilter

from isorig.analysis.campaign import FloatArray

MASS = np.diag([4.0, 2.0])
STIFFNESS = np.array([[7000.0, -3000.0], [-3000.0, 3000.0]])
DAMPING = 0.0012 * STIFFNESS + 0.2 * MASS
RESPONSES = ("low", "top")
#: Sample rate in Hz, simulated samples for each of them, number of samples, and the band of the modes in Hz.
RATE, FINER, SAMPLES, BAND = 100.0, 8, 30_000, (1.5, 15.0)


def records(seed: int) -> FloatArray:
    """Accelerations of two masses pushed by independent noise, with noise of 2 % of each record, five minutes, shape (2, n)."""
    draw = np.random.default_rng(seed)
    inverse = np.linalg.inv(MASS)
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ STIFFNESS, -inverse @ DAMPING]])
    b = np.vstack([np.zeros((2, 2)), inverse])
    step, push, read, direct, _ = cont2discrete((a, b, a[2:], b[2:]), 1.0 / (RATE * FINER))
    force = draw.normal(0.0, 5.0, (SAMPLES * FINER, 2)).T
    # Mode by mode: a recurrence of the state takes fifty times as long.
    values, vectors = np.linalg.eig(step)
    pushed = np.linalg.solve(vectors, push.astype(np.complex128)) @ force
    states = np.stack([lfilter([0.0, 1.0], [1.0, -value], row) for value, row in zip(values, pushed, strict=True)])
    shown = decimate((read @ vectors @ states).real + direct @ force, FINER, axis=1, ftype="fir")
    return np.asarray(shown + draw.normal(size=shown.shape) * 0.02 * shown.std(axis=1, keepdims=True))


def truth() -> tuple[FloatArray, FloatArray]:
    """Natural frequencies in Hz and damping ratios."""
    inverse = np.linalg.inv(MASS)
    values = np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ STIFFNESS, -inverse @ DAMPING]]))
    values = sorted((value for value in values if value.imag > 0.0), key=abs)
    return np.abs(values) / (2.0 * np.pi), -np.real(values) / np.abs(values)
