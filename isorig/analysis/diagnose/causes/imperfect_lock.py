"""An elastic lock."""

from collections.abc import Iterator
from math import sqrt

import msgspec

from isorig.analysis.diagnose.causes.base import Amplitudes, Cause, Evidence, RecordedRuns, RigWithCause, Sizes, blocked_links
from isorig.analysis.fitting.candidate import Candidate, Reported
from isorig.analysis.fitting.solve import Free
from isorig.analysis.model.rig_model import RigModel

#: Stiffness at the starts, in multiples of the blocked spring's.
STIFFNESSES = (1000.0, 100.0)


class ImperfectLock(Cause):
    """A lock that is a stiff spring instead of rigid."""

    kind = "added_motion"
    family = "lock"
    rank = 2
    phrase = "a lock that yields, with {lock_stiffness}"
    signs = frozenset({"independent of amplitude", "lock"})
    found_as = frozenset({"elastic lock"})

    def places(self, model: RigModel) -> tuple[str, ...]:
        return ("lock",) if _rigid_configurations(model) else ()

    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        for name in _rigid_configurations(model):
            if name not in evidence.configurations:
                continue
            spring = _spring(model, name)
            path, damping = f"configurations.{name}.lock_stiffness", f"configurations.{name}.lock_damping"
            yield Candidate(
                cause=self.name, location=place, family=self.family, rank=self.rank,
                starts=tuple(_elastic(model, name, factor * spring, 0.5 * sqrt(factor * spring)) for factor in STIFFNESSES),
                free=(Free(path=path, low=spring, high=1e6 * spring), Free(path=damping, low=1e-3, high=1e7)),
                reported=(
                    Reported(name="lock_stiffness", path=path, unit="N/m"),
                    Reported(name="lock_damping", path=damping, unit="N s/m"),
                ),
            )  # fmt: skip

    def sized(self, model: RigModel, runs: Amplitudes, place: str, size: float, sizes: Sizes) -> RigWithCause:
        name = _rigid_configurations(model)[0]
        stiffness = _spring(model, name) * sizes.weak_to_strong(400.0, 50.0) / size
        body = model.body(model.link(model.configurations[name].rigid[0]).a)
        damping = 2.0 * sizes.between(0.01, 0.05) * sqrt(stiffness * body.mass)
        return RigWithCause(model=_elastic(model, name, stiffness, damping), parameters={"lock_stiffness": stiffness})

    def not_identifiable(self, model: RigModel, runs: RecordedRuns) -> Iterator[tuple[str, str]]:
        if blocked_links(model) and not any(model.configurations[name].rigid for name in runs.configurations):
            yield "lock", "No run was recorded in the locked configuration; record one."


def _rigid_configurations(model: RigModel) -> list[str]:
    return [name for name, setup in model.configurations.items() if setup.rigid and setup.lock_stiffness is None]


def _spring(model: RigModel, configuration: str) -> float:
    return model.link(model.configurations[configuration].rigid[0]).stiffness


def _elastic(model: RigModel, configuration: str, stiffness: float, damping: float) -> RigModel:
    setup = msgspec.structs.replace(model.configurations[configuration], lock_stiffness=stiffness, lock_damping=damping)
    return msgspec.structs.replace(model, configurations={**model.configurations, configuration: setup})
