"""An elastic lock."""

from __future__ import annotations

from typing import ClassVar

import msgspec

from isorig.analysis.diagnose.mechanisms.base import Evidence, Kind
from isorig.analysis.fitting.candidate import Candidate, Reported
from isorig.analysis.fitting.solve import Free
from isorig.analysis.model.rig_model import RigModel


class ImperfectLock:
    """A spring instead of the rigid lock."""

    cause: ClassVar[str] = "imperfect_lock"
    kind: ClassVar[Kind] = "added_motion"

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        found = []
        for name, configuration in model.configurations.items():
            if not configuration.rigid or configuration.lock_stiffness is not None:
                continue
            if name not in evidence.configurations:
                continue
            spring = model.link(configuration.rigid[0]).stiffness
            path, damping = f"configurations.{name}.lock_stiffness", f"configurations.{name}.lock_damping"
            starts = tuple(
                msgspec.structs.replace(
                    model,
                    configurations={
                        **model.configurations,
                        name: msgspec.structs.replace(
                            configuration,
                            lock_stiffness=factor * spring,
                            lock_damping=0.5 * spring**0.5 * factor**0.5,
                        ),
                    },
                )
                for factor in (1000.0, 100.0)
            )
            found.append(
                Candidate(
                    cause=self.cause, location="lock", family="lock", starts=starts,
                    free=(Free(path=path, low=spring, high=1e6 * spring), Free(path=damping, low=1e-3, high=1e7)),
                    reported=(
                        Reported(name="lock_stiffness", path=path, unit="N/m"),
                        Reported(name="lock_damping", path=damping, unit="N s/m"),
                    ),
                    rank=2,
                )
            )  # fmt: skip
        return tuple(found)
