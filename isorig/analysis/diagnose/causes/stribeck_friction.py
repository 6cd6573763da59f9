"""Breakaway above sliding friction."""

from collections.abc import Callable, Iterable
from functools import partial

from isorig.analysis.diagnose.causes.at_contact import ContactCause, ContactInRuns
from isorig.analysis.diagnose.causes.base import Sizes
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import Stribeck
from isorig.analysis.model.rig_model import RigModel

#: Highest breakaway force as a multiple of the likely and of the fitted sliding friction, and lowest Stribeck velocity as a share
#: of the largest velocity. Chosen: dry contacts hold with up to twice their sliding force; a steeper fall than both together is
#: slow to simulate.
MOST_STATIC, LEAST_SPEED = 5.0, 2e-3
#: Sliding and breakaway force as multiples of the friction, and velocities as shares of the largest, at the starts.
LEVELS, SPEEDS = ((0.8, 1.3), (0.98, 1.08)), (0.02, 0.1)
#: Exponents of the fall, which no fit changes: the usual ones.
EXPONENTS = (1.0, 2.0)


class StribeckFriction(ContactCause):
    """A breakaway force above the sliding friction, which decreases with velocity."""

    kind = "friction_shape"
    rank = 2
    law = Stribeck
    reports = ("static_force", "friction_force", "stribeck_velocity", "exponent")
    generalizes = frozenset({"coulomb_friction"})
    phrase = (
        "Stribeck friction at the {place} that holds with {static_force} and slides with {friction_force}, "
        "falling over {stribeck_velocity} (exponent {exponent})"
    )
    signs = frozenset({"amplitude", "blocked by the lock", "more at low and high velocity"})

    def plausible(self, path: str) -> Callable[[RigModel], bool]:
        return partial(_slides, path)

    def variants(self, contact: ContactInRuns) -> Iterable[Iterable[RigModel]]:
        return (self.starts(contact, exponent) for exponent in EXPONENTS)

    def starts(self, contact: ContactInRuns, exponent: float = 1.0) -> Iterable[RigModel]:
        force = contact.likely_friction
        for sliding, breakaway in LEVELS:
            for share in SPEEDS:
                yield contact.having(
                    Stribeck(
                        friction_force=sliding * force,
                        static_force=breakaway * force,
                        stribeck_velocity=share * contact.speed,
                        exponent=exponent,
                    )
                )

    def free(self, contact: ContactInRuns) -> Iterable[Free]:
        force = contact.likely_friction
        return (
            Free(path="static_force", low=1e-3 * force, high=MOST_STATIC * force),
            Free(path="stribeck_velocity", low=LEAST_SPEED * contact.speed, high=2.0 * contact.speed),
        )

    def sized_law(self, contact: ContactInRuns, size: float, sizes: Sizes) -> Stribeck:
        static = contact.friction * (1.0 + size * sizes.weak_to_strong(0.5, 1.2))
        velocity = sizes.between(0.03, 0.12) * contact.speed
        return Stribeck(friction_force=contact.friction, static_force=static, stribeck_velocity=velocity)


def _slides(path: str, model: RigModel) -> bool:
    # What hardly slides with any force falls like a damper that is too weak.
    return model.get(f"{path}.static_force") <= MOST_STATIC * model.get(f"{path}.friction_force")
