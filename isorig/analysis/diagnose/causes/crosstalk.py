"""A channel that contains another one."""

from collections.abc import Iterable, Iterator

from isorig.analysis.diagnose.causes.base import SMALLEST, Amplitudes, Evidence, RigWithCause, Sizes, WeakestSizes
from isorig.analysis.diagnose.causes.measurement_chain import ChannelCause, chain_of, sensor_channels, with_chain
from isorig.analysis.fitting.candidate import Candidate, Reported
from isorig.analysis.fitting.solve import Free
from isorig.analysis.model.rig_model import RigModel


class Crosstalk(ChannelCause):
    """A share of another channel in the record."""

    kind = "sensor"
    rank = 1
    phrase = "the {place} channel contains {fraction} of another channel"
    signs = frozenset({"independent of amplitude", "ratio of rigid bodies"})
    found_as = frozenset({"crosstalk"})

    def places(self, model: RigModel) -> tuple[str, ...]:
        """The sensors' channels."""
        return sensor_channels(model)

    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        for source in (name for name in _sources(model, place) if not evidence.is_silent(name)):
            path = f"{chain_of(model, place)[1]}.crosstalk.{source}"
            yield Candidate(
                cause=self.name, location=place, family=self.family, rank=self.rank, starts=(_mixed(model, place, source, 0.0),),
                free=(Free(path=path, low=-0.9, high=0.9, log=False, step=1e-3),),
                reported=(Reported(name="fraction", path=path, unit="1"),),
            )  # fmt: skip

    def sized(self, model: RigModel, runs: Amplitudes, place: str, size: float, sizes: Sizes) -> RigWithCause:
        return _sized(model, runs, place, sizes.one_of(_sources(model, place)), size, sizes)

    def smallest(self, model: RigModel, runs: Amplitudes, place: str) -> Iterable[RigWithCause]:
        """From every other channel."""
        return (_sized(model, runs, place, source, SMALLEST, WeakestSizes()) for source in _sources(model, place))


def _sources(model: RigModel, channel: str) -> tuple[str, ...]:
    known = chain_of(model, channel)[0].crosstalk
    return tuple(name for name in (model.drive.channel, *sensor_channels(model)) if name != channel and name not in known)


def _mixed(model: RigModel, channel: str, source: str, fraction: float) -> RigModel:
    return with_chain(model, channel, crosstalk={**chain_of(model, channel)[0].crosstalk, source: fraction})


def _sized(model: RigModel, runs: Amplitudes, channel: str, source: str, size: float, sizes: Sizes) -> RigWithCause:
    share = sizes.one_of((1.0, -1.0)) * size * sizes.weak_to_strong(0.03, 0.1)
    fraction = share * runs.peak[channel] / runs.peak[source]
    return RigWithCause(model=_mixed(model, channel, source, fraction), parameters={"fraction": fraction})
