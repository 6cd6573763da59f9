"""Hum of the mains."""

from __future__ import annotations

from collections.abc import Iterator

from isorig.analysis.diagnose.causes.base import Amplitudes, Evidence, RigWithCause, Sizes
from isorig.analysis.diagnose.causes.measurement_chain import ChannelCause, chain_of, sensor_channels, with_chain
from isorig.analysis.fitting.candidate import Candidate, Reported
from isorig.analysis.fitting.solve import Free
from isorig.analysis.model.rig_model import RigModel


class MainsHum(ChannelCause):
    """50 or 60 Hz and multiples in the record.

    It is proposed only where the misfit has such a spectral peak.
    """

    kind = "sensor"
    family = "hum"
    phrase = "mains hum of {frequency} in the {place} channel"
    signs = frozenset({"hum"})
    found_as = frozenset({"hum"})
    always_tried = True

    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        """One for this channel alone; for the channel with most of it also one for all that have hum, of the same wiring."""
        left = [name for name in evidence.mains if chain_of(model, name)[0].mains_frequency is None]
        if place not in left:
            return
        for channels in ([place], left) if place == left[0] and len(left) > 1 else ([place],):
            begun, free = model, list[Free]()
            for name in channels:
                frequency = evidence.mains[name]
                begun = with_chain(begun, name, mains_frequency=frequency)
                path = f"{chain_of(model, name)[1]}.mains_frequency"
                free.append(Free(path=path, low=frequency - 0.1, high=frequency + 0.1, log=False, step=1e-4))
            yield Candidate(
                cause=self.name, location=place, family=self.family, rank=self.rank, starts=(begun,), free=tuple(free),
                reported=(Reported(name="frequency", path=f"{chain_of(model, place)[1]}.mains_frequency", unit="Hz"),),
            )  # fmt: skip

    def supposed_places(self, model: RigModel) -> tuple[str, ...]:
        return sensor_channels(model)

    def sized(self, model: RigModel, runs: Amplitudes, place: str, size: float, sizes: Sizes) -> RigWithCause:
        frequency, amplitude = sizes.one_of((50.0, 60.0)), size * sizes.weak_to_strong(0.03, 0.1)
        values = {"amplitude": amplitude, "frequency": frequency}
        return RigWithCause(model=model, parameters=values, hum=(place, amplitude, frequency))
