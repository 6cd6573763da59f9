"""Sizes in words: a share of the signal, the factor between two values."""

from __future__ import annotations

import numpy as np

#: From this share on a size is given as a multiple, and from this factor on a difference as a factor: three digits of per cent
#: say no more than two digits of these.
MULTIPLE, FACTOR = 0.99, 1.9


def of_signal(share: float, digits: int = 2) -> str:
    """An error as a share of the signal, to significant digits.

    Examples
    --------
    >>> of_signal(0.0312), of_signal(642729.08)
    ('3.1 % of the signal', '6.4e+05 times the signal')
    """
    if share >= MULTIPLE:
        return f"{share:.{digits}g} times the signal"
    return f"{100.0 * share:.{digits}g} % of the signal"


def by_factor(log_ratio: float) -> str:
    """The difference of two positive values from the logarithm of their ratio, of either sign.

    Examples
    --------
    >>> by_factor(0.0488), by_factor(-13.4)
    ('5 %', 'a factor of 6.6e+05')
    """
    factor = float(np.exp(abs(log_ratio)))
    return f"a factor of {factor:.2g}" if factor >= FACTOR else f"{100.0 * (factor - 1.0):.2g} %"
