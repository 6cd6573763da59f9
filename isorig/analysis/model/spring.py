"""A spring and damper by the natural frequency and damping ratio of the mass that it carries."""

from __future__ import annotations

from math import pi

from isorig.analysis.errors import ModelError
from isorig.analysis.model.rig_model import Link


def spring(name: str, a: str, b: str, *, mass: float, frequency: float, damping_ratio: float) -> Link:
    """A link with given uncoupled values: k = (2 pi f)^2 m, c = 2 zeta sqrt(k m) (thesis, Eq. 1-3)."""
    if mass <= 0.0 or frequency < 0.0 or damping_ratio < 0.0:
        raise ModelError(
            f"link {name!r}: mass {mass:g} kg, frequency {frequency:g} Hz and damping ratio {damping_ratio:g} "
            "must be positive; correct the negative one"
        )
    omega = 2.0 * pi * frequency
    return Link(name=name, a=a, b=b, stiffness=omega**2 * mass, damping=2.0 * damping_ratio * omega * mass)
