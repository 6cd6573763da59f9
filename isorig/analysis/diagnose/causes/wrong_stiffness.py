"""A wrong given stiffness."""

from collections.abc import Iterator

from isorig.analysis.diagnose.causes.base import Amplitudes, Cause, Evidence, RigWithCause, Sizes, beyond_calibration
from isorig.analysis.fitting.candidate import Candidate, Reported
from isorig.analysis.fitting.solve import Free
from isorig.analysis.model.rig_model import RigModel

#: Factors on a given stiffness from which its fits start, besides the given value.
FACTORS = (0.5, 0.7, 1.4, 2.0)


class WrongStiffness(Cause):
    """A stiffness, given as known, that differs from its given value.

    The equations of motion take every stiffness as unknown, so only a simulation shows it.
    """

    kind = "known_value"
    family = "stiffness"
    rank = 0
    phrase = "the stiffness of the {place} is {stiffness}"
    signs = frozenset({"independent of amplitude"})
    always_tried = True

    def places(self, model: RigModel) -> tuple[str, ...]:
        """The springs whose stiffness is not fitted."""
        return tuple(link.name for link in model.links if link.stiffness > 0.0 and _path(link.name) not in model.free)

    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        path = _path(place)
        given = model.get(path)
        yield Candidate(
            cause=self.name, location=place, family=self.family, rank=self.rank,
            starts=(model, *(model.replace({path: factor * given}) for factor in FACTORS)),
            free=(Free(path=path, low=0.05 * given, high=20.0 * given),),
            reported=(Reported(name="stiffness", path=path, unit="N/m"),), plausible=beyond_calibration(path, given),
        )  # fmt: skip

    def sized(self, model: RigModel, runs: Amplitudes, place: str, size: float, sizes: Sizes) -> RigWithCause:
        path = _path(place)
        stiffness = model.get(path) * (1.0 + sizes.one_of((1.0, -1.0)) * size * sizes.weak_to_strong(0.1, 0.3))
        return RigWithCause(model=model.replace({path: stiffness}), parameters={"stiffness": stiffness})


def _path(place: str) -> str:
    return f"links.{place}.stiffness"
