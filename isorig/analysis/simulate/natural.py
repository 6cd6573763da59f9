"""The modes of a rig's linear part: frequency, damping and shape in a configuration."""

from dataclasses import dataclass
from math import pi

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.model.linear import free_part
from isorig.analysis.model.rig_model import RigModel

#: Ratio to the largest root below which a root counts as a motion that no spring holds.
HELD = 1e-6


@dataclass(frozen=True, kw_only=True)
class NaturalMode:
    """A mode."""

    frequency: float  #: Undamped natural frequency |root| / 2 pi, Hz.
    damping: float  #: Damping ratio, below 1.
    shape: FloatArray  #: Motion of each body, shape (bodies,), the largest 1.


def natural_modes(model: RigModel, configuration: str) -> tuple[NaturalMode, ...]:
    """The modes in ascending frequency, from the roots of the damped equations of motion without friction and laws.

    Motions that no spring holds and overdamped motions are not included; bodies whose motion is imposed are fixed.
    """
    basis, square = free_part(model, configuration)
    n = basis.shape[1]
    if n == 0:
        return ()
    roots, vectors = np.linalg.eig(square)
    least = HELD * float(np.abs(roots).max(initial=0.0))
    found = []
    for root, vector in zip(roots, vectors.T, strict=True):
        if root.imag > least:
            shape = basis @ vector[:n]
            # Rotated in the complex plane to be as real as possible: bodies then move in phase or in antiphase.
            turned = np.real(shape * np.exp(-0.5j * np.angle((shape**2).sum())))
            largest = turned[int(np.argmax(np.abs(turned)))]
            size = float(abs(root))
            found.append(NaturalMode(frequency=size / (2.0 * pi), damping=float(-root.real) / size, shape=turned / largest))
    return tuple(sorted(found, key=lambda mode: mode.frequency))


def lowest_mode(model: RigModel) -> float:
    """Frequency in Hz of the lowest mode in any configuration; 0 of a rig without modes."""
    return min((mode.frequency for name in model.configurations for mode in natural_modes(model, name)), default=0.0)
