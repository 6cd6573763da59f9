"""A drive that cannot deliver its command."""

from collections.abc import Iterator

from isorig.analysis.campaign import SI_UNIT
from isorig.analysis.diagnose.causes.base import Amplitudes, Evidence, RigWithCause, Sizes
from isorig.analysis.diagnose.causes.measurement_chain import DriveCause, with_drive, with_one_value
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.solve import Free
from isorig.analysis.model.rig_model import RigModel

#: Limits from which a fit starts, and the lower bound of a fit, as shares of the largest recorded value. Chosen: a drive that
#: delivers less than a twentieth of its command is a wrong factor.
STARTS, LOWEST = (0.8, 0.5, 0.25), 0.05


class DriveSaturation(DriveCause):
    """A drive whose force is limited below what its channel records (an amplifier that saturates, a command beyond its range)."""

    kind = "sensor"
    family = "chain"
    phrase = "the force of the {place} drive is limited at {limit}"
    signs = frozenset({"amplitude"})
    found_as = frozenset({"saturation"})

    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        peak = evidence.peak.get(place, 0.0)
        starts = (with_drive(model, limit=share * peak) for share in STARTS if peak)
        free = Free(path="drive.limit", low=LOWEST * peak, high=peak)
        yield with_one_value(self, place, starts, free, "limit", SI_UNIT[model.drive.quantity])

    def sized(self, model: RigModel, runs: Amplitudes, place: str, size: float, sizes: Sizes) -> RigWithCause:
        limit = (1.0 - size * sizes.weak_to_strong(0.3, 0.6)) * runs.peak[place]
        return RigWithCause(model=with_drive(model, limit=limit), parameters={"limit": limit})
