"""A link that relaxes: a spring and a damper in series, parallel to it."""

from __future__ import annotations

from math import sqrt
from typing import ClassVar

from isorig.analysis.diagnose.mechanisms.base import Evidence, Kind
from isorig.analysis.diagnose.mechanisms.springs import added
from isorig.analysis.fitting.candidate import Candidate, Reported
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import Maxwell
from isorig.analysis.model.rig_model import GROUND, Link, RigModel

#: Relaxation stiffness at a start, as shares of the link's stiffness, and relaxation time, as multiples of 1 / w of the link. Far
#: above w = 1 / T it is a spring and far below it a damper, which the link has already.
STIFFNESSES, TIMES = (0.3, 1.5), (0.3, 1.0, 3.0)
#: Largest multiple of 1 / w: a longer time is a stiffness in every record of some periods.
LONGEST = 300.0


def natural(model: RigModel, link: Link) -> float:
    """Natural angular frequency in rad/s of the lighter of a link's two bodies on the link alone."""
    mass = min(model.body(body).mass for body in (link.a, link.b) if body != GROUND)
    return sqrt(link.stiffness / mass)


class Relaxation:
    """k d + c v + f, df/dt = k1 v - f / T: a rubber mount, a hose or a cable."""

    cause: ClassVar[str] = "relaxation"
    kind: ClassVar[Kind] = "memory"

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        """One for every spring that does not relax yet."""
        found = []
        for link in model.links:
            if link.stiffness <= 0.0 or any(isinstance(law, Maxwell) for law in link.laws):
                continue
            omega = natural(model, link)
            stiffness, time = (
                f"links.{link.name}.laws.{len(link.laws)}.{key}" for key in ("relaxation_stiffness", "relaxation_time")
            )
            starts = tuple(
                added(model, link, Maxwell(relaxation_stiffness=share * link.stiffness, relaxation_time=times / omega))
                for share in STIFFNESSES
                for times in TIMES
            )
            found.append(
                Candidate(
                    cause=self.cause, location=link.name, family="memory", starts=starts,
                    free=(
                        Free(path=stiffness, low=1e-3 * link.stiffness, high=1e2 * link.stiffness),
                        Free(path=time, low=min(0.5 / evidence.sample_rate, 0.1 / omega), high=LONGEST / omega),
                    ),
                    reported=(
                        Reported(name="relaxation_stiffness", path=stiffness, unit="N/m"),
                        Reported(name="relaxation_time", path=time, unit="s"),
                    ),
                    rank=2,
                )
            )  # fmt: skip
        return tuple(found)
