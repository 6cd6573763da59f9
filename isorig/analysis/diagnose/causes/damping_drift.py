"""A damping that drifts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from isorig.analysis.diagnose.causes.at_link import LinkCause, LinkInRuns
from isorig.analysis.diagnose.causes.base import Evidence, RecordedRuns, Sizes
from isorig.analysis.diagnose.causes.stiffness_drift import runs_at_one_time
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import DampingDrift as DampingDriftLaw
from isorig.analysis.model.rig_model import Link, RigModel


class DampingDrift(LinkCause):
    """A damping that changes linearly with time.

    The damping is c (1 + rate t): a bearing that warms up, for example.
    """

    kind = "drift"
    family = "drift"
    law = DampingDriftLaw
    phrase = "a damping of the {place} that changes by {per_hour} per hour"
    signs = frozenset({"blocked by the lock", "time"})
    found_as = frozenset({"drift of damping"})

    def can_be_at(self, model: RigModel, link: Link) -> bool:
        return link.damping > 0.0

    def starts(self, link: LinkInRuns, evidence: Evidence) -> Iterable[RigModel]:
        end = evidence.end_time
        return (link.having(DampingDriftLaw(drift_rate=0.0, until=end)),) if end > 0.0 else ()

    def free(self, link: LinkInRuns) -> Iterable[Free]:
        # Until the end the damping stays above zero.
        most = 0.95 / max(link.runs.end_time, 1e-9)
        return (Free(path="drift_rate", low=-most, high=10.0 * most, log=False, step=0.01 * most),)

    def sized_law(self, link: LinkInRuns, size: float, sizes: Sizes) -> DampingDriftLaw:
        # A damping may double where a stiffness changes by a quarter.
        whole = size * sizes.weak_to_strong(0.5, 1.5)
        return DampingDriftLaw(drift_rate=whole / link.runs.end_time, until=link.runs.end_time)

    def not_identifiable(self, model: RigModel, runs: RecordedRuns) -> Iterator[tuple[str, str]]:
        return runs_at_one_time(runs, (link.name for link in model.links if link.damping > 0.0))
