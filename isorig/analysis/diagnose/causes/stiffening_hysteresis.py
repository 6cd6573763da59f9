"""Hysteresis that stiffens: a mount of rubber with a filler, a wire rope that is pulled tight."""

from collections.abc import Callable, Iterable
from functools import partial

from isorig.analysis.diagnose.causes.at_link import LinkCause, LinkInRuns
from isorig.analysis.diagnose.causes.base import Evidence, Sizes
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import StiffeningHysteresis as Law
from isorig.analysis.model.rig_model import RigModel

#: Initial stiffness at the starts, as a share of the link's; stiffening and dissipation, over the largest deflection.
STIFFNESS, STIFFENING, DISSIPATION = 0.5, (0.5, 2.0), (0.3, 1.0)


class StiffeningHysteresis(LinkCause):
    """A force with hysteresis that stiffens while it is loaded and more while it is unloaded (Bouc-Wen without a limit).

    The force is k d + c v + f, df/dt = v (k1 + |f| (stiffening - dissipation sign(v f))).
    """

    kind = "memory"
    family = "memory"
    rank = 5
    law = Law
    generalizes = frozenset({"presliding_friction"})
    phrase = (
        "hysteresis in the {place} that stiffens: {initial_stiffness} without force, stiffening {stiffening}, "
        "dissipation {dissipation}"
    )
    signs = frozenset({"amplitude", "blocked by the lock", "stiffens"})
    found_as = frozenset({"slip"})

    def starts(self, link: LinkInRuns, evidence: Evidence) -> Iterable[RigModel]:
        return (
            link.having(_law(link, STIFFNESS, stiffening, dissipation))
            for stiffening, dissipation in zip(STIFFENING, DISSIPATION, strict=True)
        )

    def free(self, link: LinkInRuns) -> Iterable[Free]:
        per_swing = 1.0 / link.deflection
        return (
            Free(path="initial_stiffness", low=1e-3 * link.stiffness, high=1e2 * link.stiffness),
            Free(path="stiffening", low=1e-2 * per_swing, high=1e2 * per_swing),
            Free(path="dissipation", low=1e-2 * per_swing, high=1e2 * per_swing),
        )

    def plausible(self, link: LinkInRuns, evidence: Evidence, path: str) -> Callable[[RigModel], bool]:
        return partial(_stays_below_its_limit, path, link.deflection)

    def sized_law(self, link: LinkInRuns, size: float, sizes: Sizes) -> Law:
        return _law(link, size * sizes.weak_to_strong(0.3, 0.8), sizes.between(1.0, 2.0), sizes.between(0.5, 1.0))


def _stays_below_its_limit(path: str, deflection: float, model: RigModel) -> bool:
    # A force that comes near its limit, k1 / (dissipation - stiffening), within the deflection is plain hysteresis.
    return (model.get(f"{path}.dissipation") - model.get(f"{path}.stiffening")) * deflection < 1.0


def _law(link: LinkInRuns, share: float, stiffening: float, dissipation: float) -> Law:
    swing = link.deflection
    return Law(initial_stiffness=share * link.stiffness, stiffening=stiffening / swing, dissipation=dissipation / swing)
