"""A factor on the recorded value."""

from collections.abc import Iterator

from isorig.analysis.diagnose.causes.base import Amplitudes, Evidence, RigWithCause, Sizes, beyond_calibration
from isorig.analysis.diagnose.causes.measurement_chain import ChannelCause, chain_of, with_chain
from isorig.analysis.fitting.candidate import Candidate, Reported
from isorig.analysis.fitting.solve import Free
from isorig.analysis.model.rig_model import RigModel


class SensorGain(ChannelCause):
    """A wrong sensitivity."""

    kind = "sensor"
    rank = 1  # an instrument is calibrated; a mass or an inertia of a description may be a guess
    phrase = "the {place} channel reads {factor} of the true value"
    signs = frozenset({"independent of amplitude", "constant ratio", "ratio of rigid bodies"})
    found_as = frozenset({"gain"})

    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        path, drive = f"{chain_of(model, place)[1]}.gain", model.drive
        # Where the drive's force is mass times acceleration, the channel's gain and the mass are one factor.
        force_by_mass = place == drive.channel and drive.quantity == "acceleration" and drive.imposes is None
        yield Candidate(
            cause=self.name, location=place, family=self.family, rank=self.rank, starts=(model,),
            free=(Free(path=path, low=0.2, high=5.0),), reported=(Reported(name="factor", path=path, unit="1"),),
            twin=("wrong_mass", place) if force_by_mass else None, plausible=beyond_calibration(path, model.get(path)),
        )  # fmt: skip

    def sized(self, model: RigModel, runs: Amplitudes, place: str, size: float, sizes: Sizes) -> RigWithCause:
        factor = 1.0 + sizes.one_of((1.0, -1.0)) * size * sizes.weak_to_strong(0.05, 0.2)
        return RigWithCause(model=with_chain(model, place, gain=factor), parameters={"factor": factor})
