"""Hum of the mains."""

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
        humming = [name for name in evidence.mains if chain_of(model, name)[0].mains_frequency is None]
        if place not in humming:
            return
        for channels in ([place], humming) if place == humming[0] and len(humming) > 1 else ([place],):
            start, paths = model, {name: f"{chain_of(model, name)[1]}.mains_frequency" for name in channels}
            for name in channels:
                start = with_chain(start, name, mains_frequency=evidence.mains[name])
            yield Candidate(
                cause=self.name, location=place, family=self.family, rank=self.rank, starts=(start,),
                free=tuple(
                    Free(path=path, low=evidence.mains[name] - 0.1, high=evidence.mains[name] + 0.1, log=False, step=1e-4)
                    for name, path in paths.items()
                ),
                reported=(Reported(name="frequency", path=paths[place], unit="Hz"),),
            )  # fmt: skip

    def supposed_places(self, model: RigModel) -> tuple[str, ...]:
        return sensor_channels(model)

    def sized(self, model: RigModel, runs: Amplitudes, place: str, size: float, sizes: Sizes) -> RigWithCause:
        frequency, amplitude = sizes.one_of((50.0, 60.0)), size * sizes.weak_to_strong(0.03, 0.1)
        values = {"amplitude": amplitude, "frequency": frequency}
        return RigWithCause(model=model, parameters=values, hum=(place, amplitude, frequency))
