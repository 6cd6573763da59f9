"""A stiffness that drifts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from isorig.analysis.diagnose.causes.at_link import LinkCause, LinkInRuns
from isorig.analysis.diagnose.causes.base import Evidence, RecordedRuns, Sizes
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import Drift
from isorig.analysis.model.rig_model import RigModel


class StiffnessDrift(LinkCause):
    """A stiffness that changes linearly with time.

    The stiffness is k (1 + rate t).
    """

    kind = "drift"
    family = "drift"
    law = Drift
    phrase = "a stiffness of the {place} that changes by {per_hour} per hour"
    signs = frozenset({"blocked by the lock", "time"})
    found_as = frozenset({"drift of stiffness"})

    def starts(self, link: LinkInRuns, evidence: Evidence) -> Iterable[RigModel]:
        return (link.having(Drift(drift_rate=0.0, until=evidence.end_time)),) if evidence.end_time > 0.0 else ()

    def free(self, link: LinkInRuns) -> Iterable[Free]:
        # Until the end the stiffness stays above zero.
        most = 0.95 / max(link.runs.end_time, 1e-9)
        return (Free(path="drift_rate", low=-most, high=10.0 * most, log=False, step=0.01 * most),)

    def sized_law(self, link: LinkInRuns, size: float, sizes: Sizes) -> Drift:
        whole = sizes.one_of((1.0, -1.0)) * size * sizes.weak_to_strong(0.1, 0.25)
        return Drift(drift_rate=whole / link.runs.end_time, until=link.runs.end_time)

    def not_identifiable(self, model: RigModel, runs: RecordedRuns) -> Iterator[tuple[str, str]]:
        return runs_at_one_time(runs, (link.name for link in model.links if link.stiffness > 0.0))


def runs_at_one_time(runs: RecordedRuns, places: Iterable[str]) -> Iterator[tuple[str, str]]:
    """These places, with the reason why no drift is identifiable there, if the runs do not start at different times."""
    if len(runs.start_times) < 2 or np.ptp(runs.start_times) == 0.0:
        yield from (
            (name, "The runs have no start times, or there is only one; record several, minutes apart.") for name in places
        )
