"""A sensor that does not record fast motion."""

from collections.abc import Iterator

from isorig.analysis.diagnose.causes.base import Amplitudes, Evidence, RigWithCause, Sizes
from isorig.analysis.diagnose.causes.measurement_chain import ChannelCause, sensor_channels, with_chain, with_one_value
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.solve import Free
from isorig.analysis.model.rig_model import RigModel

#: Corner frequencies from which a fit starts, and the bounds of a fit, as shares of the sample rate. Chosen: below the lower
#: bound a sensor is no sensor of the motion; above the upper one it is a delay.
STARTS, LOWEST, HIGHEST = (0.3, 0.1, 0.03), 1e-3, 10.0


class LowPass(ChannelCause):
    """A sensor behind a first-order low-pass (a slow amplifier, a smoothing filter), which loses fast motion.

    Below the corner frequency its record is late, and above it falls with the frequency.
    """

    kind = "sensor"
    family = "delay"
    phrase = "a low-pass with a corner frequency of {cutoff} in the {place} channel"
    signs = frozenset({"independent of amplitude", "delay"})
    found_as = frozenset({"low-pass"})

    def places(self, model: RigModel) -> tuple[str, ...]:
        """The sensors without one."""
        return tuple(channel for channel in sensor_channels(model) if not model.sensor(channel).chain.cutoff)

    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        path, rate = f"sensors.{place}.chain.cutoff", evidence.sample_rate
        starts = (with_chain(model, place, cutoff=share * rate) for share in STARTS)
        yield with_one_value(self, place, starts, Free(path=path, low=LOWEST * rate, high=HIGHEST * rate), "cutoff", "Hz")

    def supposed_places(self, model: RigModel) -> tuple[str, ...]:
        # Tests hide it with a filter of their own.
        return ()

    def sized(self, model: RigModel, runs: Amplitudes, place: str, size: float, sizes: Sizes) -> RigWithCause:
        cutoff = runs.sample_rate / (size * sizes.weak_to_strong(2.5, 8.0))
        return RigWithCause(model=with_chain(model, place, cutoff=cutoff), parameters={"cutoff": cutoff})
