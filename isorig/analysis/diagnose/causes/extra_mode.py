"""An unmodelled resonator."""

from collections.abc import Iterable, Iterator
from functools import partial
from math import copysign, pi, sqrt

import msgspec

from isorig.analysis.diagnose.causes.base import (
    SMALLEST,
    Amplitudes,
    Cause,
    Evidence,
    RigWithCause,
    Sizes,
    WeakestSizes,
    exchange,
)  # fmt: skip
from isorig.analysis.fitting.candidate import Candidate, Reported
from isorig.analysis.fitting.solve import Free
from isorig.analysis.model.rig_model import Body, Link, RigModel

#: Relative spacing of starting frequencies.
CLOSE = 0.035
#: A resonator closer than this share to the resonance of its body is not compensated for any further.
NEAR = 0.3
#: Mass as a share of the body's, and damping ratio, at the starts. A light one too: near a resonance a heavy resonator splits it,
#: and no gradient leads back.
MASSES, DAMPING = (0.04, 0.01), 0.03
#: Frequencies that a hidden one can have, Hz; and the same in multiples of the frequency of its body, which it must not follow
#: rigidly.
HIDDEN, OWN = (20.0, 120.0), (0.36, 1.8)
#: Frequencies at which proposals assume one, Hz. Chosen: two from the range used in the study of the diagnosis, 20 to 300 Hz.
HIDDEN_MODES = (30.0, 110.0)


class ExtraMode(Cause):
    """A resonator attached to a body."""

    kind = "added_motion"
    family = "mode"
    rank = 3
    phrase = "a resonator of {mode_mass} at {mode_frequency} attached to the {place}"
    signs = frozenset({"independent of amplitude", "mode"})
    found_as = frozenset({"resonator"})
    at_bodies = True

    def places(self, model: RigModel) -> tuple[str, ...]:
        """The bodies with fewer than two: what is attached to a body may be several parts."""
        return tuple(body.name for body in model.bodies if not body.name.endswith("_added") and _names_left(model, body.name))

    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        body, name = model.body(place), _names_left(model, place)[0]
        mass, fastest = MASSES[0] * body.mass, 2.0 * pi * evidence.sample_rate
        frequencies = _around(evidence.misfit_frequencies)
        at_mass, stiffness, damping = f"bodies.{name}.mass", f"links.{name}.stiffness", f"links.{name}.damping"
        yield Candidate(
            cause=self.name, location=place, family=self.family, rank=self.rank,
            starts=tuple(_attached_to_fitted(model, body, share * body.mass, f) for share in MASSES for f in frequencies),
            free=(
                Free(path=at_mass, low=1e-4 * body.mass, high=body.mass),
                Free(path=stiffness, low=mass * 2.0, high=mass * fastest**2),
                Free(path=damping, low=1e-6, high=mass * fastest),
            ),
            reported=(
                Reported(name="mode_mass", path=at_mass, unit="kg"),
                Reported(name="mode_frequency", path=stiffness, unit="Hz", value=partial(_frequency, name)),
                Reported(name="mode_damping", path=damping, unit="1", value=partial(_damping_ratio, name)),
            ),
        )  # fmt: skip

    def sized(self, model: RigModel, runs: Amplitudes, place: str, size: float, sizes: Sizes) -> RigWithCause:
        body = model.body(place)
        own = max((sqrt(link.stiffness / body.mass) / (2.0 * pi) for link in model.links if link.a == place), default=0.0)
        frequency = sizes.between(*(max(limit, share * own) for limit, share in zip(HIDDEN, OWN, strict=True)))
        return _sized(model, body, frequency, size, sizes)

    def smallest(self, model: RigModel, runs: Amplitudes, place: str) -> Iterable[RigWithCause]:
        """At several frequencies."""
        return (_sized(model, model.body(place), frequency, SMALLEST, WeakestSizes()) for frequency in HIDDEN_MODES)


def _sized(model: RigModel, body: Body, frequency: float, size: float, sizes: Sizes) -> RigWithCause:
    mass, damping = size * sizes.weak_to_strong(0.02, 0.06) * body.mass, sizes.between(0.01, 0.04)
    values = {"mode_mass": mass, "mode_frequency": frequency, "mode_damping": damping}
    return RigWithCause(model=_attached(model, body, mass, frequency, damping), parameters=values)


def _names_left(model: RigModel, body: str) -> list[str]:
    # Names for attached parts that the rig does not have yet.
    names = {body.name for body in model.bodies}
    return [name for name in (f"{body}_added", f"{body}_second_added") if name not in names]


def _attached(model: RigModel, body: Body, mass: float, frequency: float, damping: float) -> RigModel:
    name, omega = _names_left(model, body.name)[0], 2.0 * pi * frequency
    link = Link(name=name, a=name, b=body.name, stiffness=mass * omega**2, damping=2.0 * damping * mass * omega)
    return msgspec.structs.replace(model, bodies=(*model.bodies, Body(name=name, mass=mass)), links=(*model.links, link))


def _attached_to_fitted(model: RigModel, body: Body, mass: float, frequency: float) -> RigModel:
    # At the resonance of its body an attached resonator has the apparent mass m / (1 - (f / f_added)^2); the fit without it has
    # compensated this by the mass there or by the spring.
    bodies, links = model.bodies, model.links
    for own in (link for link in model.links if link.a == body.name):
        below = 1.0 - own.stiffness / (body.mass * (2.0 * pi * frequency) ** 2)
        share = mass / body.mass / copysign(max(abs(below), NEAR), below)
        if f"bodies.{body.name}.mass" in model.free:
            bodies = exchange(bodies, body.name, mass=(1.0 - share) * body.mass)
        else:
            links = exchange(links, own.name, stiffness=(1.0 + share) * own.stiffness, damping=(1.0 + share) * own.damping)
    return _attached(msgspec.structs.replace(model, bodies=bodies, links=links), body, mass, frequency, DAMPING)


def _around(frequencies: tuple[float, ...]) -> list[float]:
    # A band is wide compared with a mode with little damping: use closer spacing at the largest residual.
    close = [f * (1.0 + CLOSE * k) for f in frequencies[:2] for k in range(-3, 4)]
    return [*close, *frequencies[2:]]


def _frequency(name: str, model: RigModel) -> float:
    return float(sqrt(model.link(name).stiffness / model.body(name).mass) / (2.0 * pi))


def _damping_ratio(name: str, model: RigModel) -> float:
    return float(model.link(name).damping / (2.0 * sqrt(model.link(name).stiffness * model.body(name).mass)))
