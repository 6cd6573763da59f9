"""A stiffness that drifts."""

from collections.abc import Iterable, Iterator
from typing import ClassVar

import numpy as np

from isorig.analysis.diagnose.causes.at_link import LinkCause, LinkInRuns
from isorig.analysis.diagnose.causes.base import Evidence, RecordedRuns, Sizes
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import Drift
from isorig.analysis.laws.springs import LinearDrift
from isorig.analysis.model.rig_model import RigModel


class DriftCause(LinkCause):
    """A constant of a link that changes linearly with time."""

    family = "drift"
    law: ClassVar[type[LinearDrift]]
    signs = frozenset({"blocked by the lock", "time"})

    def starts(self, link: LinkInRuns, evidence: Evidence) -> Iterable[RigModel]:
        end = evidence.end_time
        return (link.having(self.law(drift_rate=0.0, until=end)),) if end > 0.0 else ()

    def free(self, link: LinkInRuns) -> Iterable[Free]:
        # Until the end the constant stays above zero.
        most = 0.95 / max(link.runs.end_time, 1e-9)
        return (Free(path="drift_rate", low=-most, high=10.0 * most, log=False, step=0.01 * most),)

    def changed(self, size: float, sizes: Sizes) -> float:
        """The change over the session as a share of the constant."""
        raise NotImplementedError(f"{type(self).__name__} has no size; implement changed")

    def sized_law(self, link: LinkInRuns, size: float, sizes: Sizes) -> LinearDrift:
        return self.law(drift_rate=self.changed(size, sizes) / link.runs.end_time, until=link.runs.end_time)

    def not_identifiable(self, model: RigModel, runs: RecordedRuns) -> Iterator[tuple[str, str]]:
        if len(runs.start_times) < 2 or np.ptp(runs.start_times) == 0.0:
            for link in (link for link in model.links if self.can_be_at(model, link)):
                yield (
                    link.name,
                    "The runs have no start times, or there is only one; record several, minutes apart.",
                )


class StiffnessDrift(DriftCause):
    """A stiffness that changes linearly with time.

    The stiffness is k (1 + rate t).
    """

    kind = "drift"
    law = Drift
    phrase = "a stiffness of the {place} that changes by {change}"
    found_as = frozenset({"drift of stiffness"})

    def changed(self, size: float, sizes: Sizes) -> float:
        return sizes.one_of((1.0, -1.0)) * size * sizes.weak_to_strong(0.1, 0.25)
