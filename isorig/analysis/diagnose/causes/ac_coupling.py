"""A sensor that does not record slow motion."""

from collections.abc import Iterator

from isorig.analysis.diagnose.causes.base import Amplitudes, Evidence, RigWithCause, Sizes
from isorig.analysis.diagnose.causes.measurement_chain import ChannelCause, sensor_channels, with_chain, with_one_value
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.solve import Free
from isorig.analysis.model.rig_model import RigModel

#: Corner frequencies in Hz from which a fit starts: of amplifiers with a long and a usual time constant, and of a leaking cable.
STARTS = (0.1, 0.5, 2.0)
#: Largest corner frequency in Hz. Chosen: beyond it a sensor is no sensor of the motion.
HIGHEST = 50.0


class AcCoupling(ChannelCause):
    """A sensor coupled by a capacitor (a piezoelectric accelerometer, a leaking cable), which loses slow motion.

    Below the corner frequency its record falls with the frequency and leads the motion.
    """

    kind = "sensor"
    family = "coupling"
    phrase = "an AC coupling with a corner frequency of {corner} in the {place} channel"
    found_as = frozenset({"high-pass"})

    def places(self, model: RigModel) -> tuple[str, ...]:
        """The sensors without one."""
        return tuple(channel for channel in sensor_channels(model) if not model.sensor(channel).chain.corner)

    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        path = f"sensors.{place}.chain.corner"
        starts = (with_chain(model, place, corner=corner) for corner in STARTS)
        yield with_one_value(self, place, starts, Free(path=path, low=1e-3, high=HIGHEST), "corner", "Hz")

    def supposed_places(self, model: RigModel) -> tuple[str, ...]:
        # Virtual rigs hide it with a filter of their own ("slow sensor").
        return ()

    def sized(self, model: RigModel, runs: Amplitudes, place: str, size: float, sizes: Sizes) -> RigWithCause:
        corner = size * sizes.weak_to_strong(1.0, 4.0)
        return RigWithCause(model=with_chain(model, place, corner=corner), parameters={"corner": corner})
