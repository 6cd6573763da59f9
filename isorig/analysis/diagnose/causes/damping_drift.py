"""A damping that drifts."""

from isorig.analysis.diagnose.causes.base import Sizes
from isorig.analysis.diagnose.causes.stiffness_drift import DriftCause
from isorig.analysis.laws import DampingDrift as DampingDriftLaw
from isorig.analysis.model.rig_model import Link, RigModel


class DampingDrift(DriftCause):
    """A damping that changes linearly with time.

    The damping is c (1 + rate t): a bearing that warms up, for example.
    """

    kind = "drift"
    law = DampingDriftLaw
    phrase = "a damping of the {place} that changes by {change}"
    found_as = frozenset({"drift of damping"})

    def can_be_at(self, model: RigModel, link: Link) -> bool:
        return link.damping > 0.0

    def changed(self, size: float, sizes: Sizes) -> float:
        # A damping may double where a stiffness changes by a quarter.
        return size * sizes.weak_to_strong(0.5, 1.5)
