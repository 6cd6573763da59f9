"""A limited record."""

from collections.abc import Iterator

from isorig.analysis.campaign import SI_UNIT
from isorig.analysis.diagnose.causes.base import Amplitudes, Evidence, RigWithCause, Sizes
from isorig.analysis.diagnose.causes.measurement_chain import ChannelCause, chain_of, sensor_channels, with_chain, with_one_value
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.solve import Free
from isorig.analysis.model.rig_model import RigModel


class Clipping(ChannelCause):
    """A record limited below the range of its input.

    It is proposed only if the record has flat tops.
    """

    kind = "sensor"
    phrase = "the {place} channel is limited at {limit}"
    signs = frozenset({"amplitude", "ratio of rigid bodies", "flat tops"})
    found_as = frozenset({"static curve", "clipping"})
    always_tried = True

    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        level = evidence.flat_tops.get(place)
        if level is None:
            return
        path = f"{chain_of(model, place)[1]}.limit"
        quantity = model.drive.quantity if place == model.drive.channel else model.sensor(place).quantity
        free = Free(path=path, low=0.9 * level, high=1.1 * level)
        yield with_one_value(self, place, (with_chain(model, place, limit=level),), free, "limit", SI_UNIT[quantity])

    def supposed_places(self, model: RigModel) -> tuple[str, ...]:
        return sensor_channels(model)

    def sized(self, model: RigModel, runs: Amplitudes, place: str, size: float, sizes: Sizes) -> RigWithCause:
        limit = (1.0 - size * sizes.weak_to_strong(0.35, 0.6)) * runs.peak[place]
        return RigWithCause(model=with_chain(model, place, limit=limit), parameters={"limit": limit})
