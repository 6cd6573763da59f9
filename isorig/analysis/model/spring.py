"""A spring and damper by the natural frequency and damping ratio of the mass that it carries alone."""

from math import pi

import msgspec
import numpy as np

from isorig.analysis.errors import DataError, ModelError
from isorig.analysis.model.rig_model import Link, RigModel


def spring(name: str, a: str, b: str, *, mass: float, frequency: float, damping_ratio: float) -> Link:
    """A link with given uncoupled values: k = (2 pi f)^2 m, c = 2 zeta sqrt(k m) (thesis, Eq. 1-3)."""
    if mass <= 0.0 or frequency < 0.0 or damping_ratio < 0.0:
        raise ModelError(
            f"link {name!r}: mass {mass:g} kg, frequency {frequency:g} Hz and damping ratio {damping_ratio:g} "
            "must be positive; correct the negative one"
        )
    omega = 2.0 * pi * frequency
    return Link(name=name, a=a, b=b, stiffness=omega**2 * mass, damping=2.0 * damping_ratio * omega * mass)


def uncoupled_frequency(model: RigModel, link: str) -> float:
    """Natural frequency sqrt(k / m) / 2 pi of a link's body `a` alone, Hz."""
    part = model.link(link)
    return float(np.sqrt(part.stiffness / model.body(part.a).mass) / (2.0 * np.pi))


def with_frequency(model: RigModel, link: str, frequency: float) -> RigModel:
    """The rig with another natural frequency (Hz) of a link's body `a` alone: k = (2 pi f)^2 m, with the same damping ratio.

    Raises DataError if the link has no stiffness.
    """
    present = model.link(link)
    mass = model.body(present.a).mass
    stiffness = (2.0 * np.pi * frequency) ** 2 * mass
    if present.stiffness <= 0.0:
        raise DataError(f"link {link!r} has no stiffness, so its damping ratio is undefined; give that of the present design")
    damping = present.damping * (stiffness / present.stiffness) ** 0.5
    links = tuple(msgspec.structs.replace(p, stiffness=stiffness, damping=damping) if p.name == link else p for p in model.links)
    return msgspec.structs.replace(model, links=links, free=())
