"""A delayed channel."""

from collections.abc import Iterator

from isorig.analysis.diagnose.causes.base import Amplitudes, Evidence, RigWithCause, Sizes
from isorig.analysis.diagnose.causes.measurement_chain import ChannelCause, chain_of, with_chain, with_one_value
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.solve import Free
from isorig.analysis.model.rig_model import RigModel


class ChannelDelay(ChannelCause):
    """A channel that is late.

    A delay biases the fit of the other parameters, so starting values also include a grid of delays with these as before any fit.
    """

    kind = "sensor"
    family = "delay"
    phrase = "the {place} channel is {shifted}"
    signs = frozenset({"independent of amplitude", "delay"})
    found_as = frozenset({"delay"})

    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        path, sample = f"{chain_of(model, place)[1]}.delay", 1.0 / evidence.sample_rate
        like = evidence.guess.free == model.free
        before = model.replace({path: evidence.guess.get(path) for path in model.free}) if like else model
        grid = (before.replace({path: 0.5 * k * sample}) for k in range(-8, 9) if k and like)
        free = Free(path=path, low=-50 * sample, high=50 * sample, log=False, step=0.02 * sample)
        yield with_one_value(self, place, (model, *grid), free, "delay", "s")

    def sized(self, model: RigModel, runs: Amplitudes, place: str, size: float, sizes: Sizes) -> RigWithCause:
        delay = size * sizes.weak_to_strong(0.8, 2.5) / runs.sample_rate
        return RigWithCause(model=with_chain(model, place, delay=delay), parameters={"delay": delay})
