"""A drive that follows its command slowly."""

from collections.abc import Iterator

from isorig.analysis.diagnose.causes.base import Amplitudes, Evidence, RigWithCause, Sizes
from isorig.analysis.diagnose.causes.measurement_chain import DriveCause, with_drive, with_one_value
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.solve import Free
from isorig.analysis.model.rig_model import RigModel

#: Time constants from which a fit starts, and the bounds of a fit, in samples. Chosen: below the lower bound no record shows a
#: lag, beyond the upper one the drive hardly acts.
STARTS, LEAST, MOST = (1.0, 4.0, 16.0), 0.02, 1000.0


class DriveLag(DriveCause):
    """A drive whose force follows its command with a first-order lag (a coil's inductance, a valve, a slow amplifier)."""

    kind = "sensor"
    family = "delay"
    rank = 1
    phrase = "the force of the {place} drive follows its command with a time constant of {time_constant}"
    signs = frozenset({"independent of amplitude", "delay"})
    found_as = frozenset({"lag"})

    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        sample = 1.0 / evidence.sample_rate
        starts = (with_drive(model, lag=samples * sample) for samples in STARTS)
        free = Free(path="drive.lag", low=LEAST * sample, high=MOST * sample)
        twin = ("low_pass", model.sensors[0].channel) if len(model.sensors) == 1 else None
        yield with_one_value(self, place, starts, free, "time_constant", "s", twin)

    def sized(self, model: RigModel, runs: Amplitudes, place: str, size: float, sizes: Sizes) -> RigWithCause:
        lag = size * sizes.weak_to_strong(0.8, 2.5) / runs.sample_rate
        return RigWithCause(model=with_drive(model, lag=lag), parameters={"time_constant": lag})
