"""One parameter of one rig over its campaigns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import DataError

#: Relative rounding error of a value.
ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True)
class Series:
    """Values of one parameter in order of time.

    Parameters
    ----------
    time
        Date of each campaign, days, ascending, shape (n,).
    value
        The parameter, or its logarithm if it is positive, shape (n,).
    std
        Standard uncertainty of each fit, in the unit of `value`, shape (n,).
    """

    time: FloatArray
    value: FloatArray
    std: FloatArray

    def __post_init__(self) -> None:
        if not len(self.time) == len(self.value) == len(self.std):
            raise DataError(
                f"there are {len(self.time)} times, {len(self.value)} values and {len(self.std)} uncertainties; give one of each"
            )
        if not all(np.isfinite(part).all() for part in (self.time, self.value, self.std)):
            raise DataError("a series contains a value that is not finite; leave that campaign out")
        if (np.diff(self.time) < 0.0).any() or (self.std < 0.0).any():
            raise DataError(
                "a series goes back in time or has a negative uncertainty; sort it by time and correct the uncertainty"
            )

    def __len__(self) -> int:
        return len(self.value)

    def variance(self, between: float) -> FloatArray:
        """Variance of each value about its level: that of the fit plus that between campaigns, shape (n,)."""
        # Values without any uncertainty differ by rounding at least.
        rounding = ROUNDING * max(float(np.abs(self.value).max(initial=0.0)), 1.0)
        return np.asarray(np.maximum(self.std**2 + between, rounding**2))
