"""Transfer functions with one or several simultaneous drives, from their auto and cross spectra.

With several drives, each transfer function is the contribution of its own drive while the others act (Bendat and Piersol 2010,
7.2): the cross-spectral matrix of the drives is inverted in each frequency bin. Correlated drives are separated as far as they
differ, and the error bars increase with their correlation.
"""

from typing import Literal

import numpy as np

from isorig.analysis.campaign import ComplexArray, FloatArray
from isorig.analysis.errors import DataError

Estimator = Literal["H1", "H2", "Hv"]
#: Share of a drive's power that the other drives must leave unexplained (median over frequency bins): the standard deviations of
#: transfer functions are 1 / sqrt(share) times those with independent drives, here 30 times.
OWN_SHARE = 1e-3
#: Averages per drive needed to separate drives: with fewer, any response would be explained.
AVERAGES = 2.0
TINY = np.finfo(float).tiny


class Drives:
    """The auto and cross spectra of the drives in each frequency bin, and their inverse.

    Sxx[k, i, j] = mean of conj(x_i) x_j in bin k, shape (bins, drives, drives), from so many independent averages. Raises
    DataError if the drives cannot be separated.
    """

    def __init__(self, spectra: ComplexArray, names: tuple[str, ...], averages: float) -> None:
        self._spectra, count = spectra, len(names)
        auto = np.maximum(np.einsum("kii->ki", spectra).real, TINY)
        self._size = np.sqrt(auto)
        if count == 1:
            self._inverse: ComplexArray = np.ones(spectra.shape, dtype=np.complex128)
        else:
            if averages < AVERAGES * count:
                raise DataError(
                    f"{averages:.1f} averages cannot separate the drives {' and '.join(names)}; at least "
                    f"{AVERAGES * count:g} are needed, so measure longer or give a coarser resolution"
                )
            scaled = spectra / (self._size[:, :, None] * self._size[:, None, :])
            values, vectors = np.linalg.eigh(scaled)
            values = np.maximum(values, np.finfo(float).eps)
            self._inverse = np.einsum("kim,km,kjm->kij", vectors, 1.0 / values, np.conj(vectors))
            # 1 / (diagonal of the inverse correlation matrix) is the share not explained by the other drives.
            own = np.median(1.0 / np.einsum("kii->ki", self._inverse).real, axis=0)
            worst = int(np.argmin(own))
            if own[worst] < OWN_SHARE:
                rest = " and ".join(name for name in names if name != names[worst])
                raise DataError(
                    f"the drive {names[worst]} is correlated with {rest} (coherence {1.0 - own[worst]:.4f}), so that their "
                    f"effects cannot be separated; drive with independent signals, or name one reference"
                )
        # The diagonal of the inverse of Sxx.
        self._inverse_auto: FloatArray = np.einsum("kii->ki", self._inverse).real / auto

    def h1(self, cross: ComplexArray) -> ComplexArray:
        """Least squares: noise on the response only; `cross` is conj(x_i) y, shape (bins, drives), as is the result."""
        return np.asarray(np.einsum("kij,kj->ki", self._inverse, cross / self._size) / self._size)

    def hv(self, cross: ComplexArray, response: FloatArray, scales: FloatArray) -> ComplexArray:
        """Total least squares: equal noise on all channels, in units of `scales` (drives, then the response).

        The eigenvector of the smallest eigenvalue of all channels' spectra (Rocklin, Crowley and Vold 1985).
        """
        n = cross.shape[1]
        whole = np.empty((len(cross), n + 1, n + 1), dtype=np.complex128)
        whole[:, :n, :n], whole[:, :n, n], whole[:, n, :n], whole[:, n, n] = self._spectra, cross, np.conj(cross), response
        _, vectors = np.linalg.eigh(whole / np.outer(scales, scales))
        least = vectors[:, :, 0]
        last = np.where(least[:, n] == 0.0, TINY, least[:, n])
        return np.asarray(-least[:, :n] / last[:, None] * (scales[n] / scales[:n]))

    def partial_coherence(self, value: ComplexArray, unexplained: FloatArray) -> FloatArray:
        """Share that each drive explains of the response not explained by the others, shape (bins, drives).

        |H_j|^2 / (|H_j|^2 + Snn [Sxx^-1]_jj), with the H1 estimate `value` and the power Snn (`unexplained`) not explained by
        any drive; equals the ordinary coherence for one drive.
        """
        own = np.abs(value) ** 2
        return np.asarray(np.clip(own / np.maximum(own + unexplained[:, None] * self._inverse_auto, TINY), 0.0, 1.0))
