"""Faults of the measurement chain: delay, gain, clipping, crosstalk, hum."""

from __future__ import annotations

from typing import ClassVar

import msgspec

from isorig.analysis.diagnose.mechanisms.base import Evidence, Kind, exchange
from isorig.analysis.fitting.candidate import Candidate, Reported
from isorig.analysis.fitting.solve import Free
from isorig.analysis.model.rig_model import Chain, RigModel


def chain_of(model: RigModel, channel: str) -> tuple[Chain, str]:
    """The chain of a channel and its path in the model."""
    if channel == model.drive.channel:
        return model.drive.chain, "drive.chain"
    return model.sensor(channel).chain, f"sensors.{channel}.chain"


def with_chain(model: RigModel, channel: str, chain: Chain) -> RigModel:
    """The rig with another chain on a channel."""
    if channel == model.drive.channel:
        return msgspec.structs.replace(model, drive=msgspec.structs.replace(model.drive, chain=chain))
    return msgspec.structs.replace(model, sensors=exchange(model.sensors, channel, chain=chain))


def channels_of(model: RigModel) -> tuple[str, ...]:
    """The drive channel and the sensors' channels."""
    return (model.drive.channel, *(sensor.channel for sensor in model.sensors))


class ChannelDelay:
    """A delayed channel.

    A delay biases the fit of the other parameters, so starting values also include a grid of delays with these as before any fit.
    """

    cause: ClassVar[str] = "channel_delay"
    kind: ClassVar[Kind] = "sensor"

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        sample = 1.0 / evidence.sample_rate
        like = evidence.guess.free == model.free
        before = model.replace({path: evidence.guess.get(path) for path in model.free}) if like else model
        found = []
        for channel in channels_of(model):
            path = f"{chain_of(model, channel)[1]}.delay"
            grid = tuple(before.replace({path: 0.5 * k * sample}) for k in range(-8, 9) if k and like)
            found.append(
                Candidate(
                    cause=self.cause, location=channel, family="delay",
                    starts=(model, *grid),
                    free=(Free(path=path, low=-50 * sample, high=50 * sample, log=False, step=0.02 * sample),),
                    reported=(Reported(name="delay", path=path, unit="s"),), rank=0,
                )
            )  # fmt: skip
        return tuple(found)


class SensorGain:
    """A factor on the recorded value."""

    cause: ClassVar[str] = "sensor_gain"
    kind: ClassVar[Kind] = "sensor"

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        found = []
        for channel in channels_of(model):
            path = f"{chain_of(model, channel)[1]}.gain"
            found.append(
                Candidate(
                    cause=self.cause, location=channel, family="chain", starts=(model,),
                    free=(Free(path=path, low=0.2, high=5.0),),
                    reported=(Reported(name="factor", path=path, unit="1"),), rank=0, twin=_twin(model, channel),
                )
            )  # fmt: skip
        return tuple(found)


def _twin(model: RigModel, channel: str) -> tuple[str, str] | None:
    # Where the drive's force is mass times acceleration, the channel's gain and the mass are one factor.
    drive = model.drive
    force_by_mass = channel == drive.channel and drive.quantity == "acceleration" and drive.imposes is None
    return ("wrong_mass", channel) if force_by_mass else None


class Clipping:
    """A recorded value limited below its range: proposed only if the record has flat tops."""

    cause: ClassVar[str] = "clipping"
    kind: ClassVar[Kind] = "sensor"

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        found = []
        for channel, level in evidence.flat_tops.items():
            if channel not in channels_of(model):
                continue
            chain, path = chain_of(model, channel)
            path = f"{path}.limit"
            start = with_chain(model, channel, msgspec.structs.replace(chain, limit=level))
            found.append(
                Candidate(
                    cause=self.cause, location=channel, family="chain", starts=(start,),
                    free=(Free(path=path, low=0.9 * level, high=1.1 * level),),
                    reported=(Reported(name="limit", path=path, unit="m/s^2"),), rank=0,
                )
            )  # fmt: skip
        return tuple(found)


class Crosstalk:
    """A share of another channel in this one."""

    cause: ClassVar[str] = "crosstalk"
    kind: ClassVar[Kind] = "sensor"

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        found = []
        for channel in channels_of(model)[1:]:
            chain, path = chain_of(model, channel)
            for source in channels_of(model):
                if source == channel or source in chain.crosstalk:
                    continue
                mixed = msgspec.structs.replace(chain, crosstalk={**chain.crosstalk, source: 0.0})
                share = f"{path}.crosstalk.{source}"
                found.append(
                    Candidate(
                        cause=self.cause, location=channel, family="chain",
                        starts=(with_chain(model, channel, mixed),),
                        free=(Free(path=share, low=-0.9, high=0.9, log=False, step=1e-3),),
                        reported=(Reported(name="fraction", path=share, unit="1"),),
                    )
                )  # fmt: skip
        return tuple(found)


class MainsHum:
    """50 or 60 Hz and multiples: proposed only if the misfit has such a spectral line."""

    cause: ClassVar[str] = "mains_hum"
    kind: ClassVar[Kind] = "sensor"

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        found = []
        for channel, frequency in evidence.mains.items():
            chain, path = chain_of(model, channel)
            if chain.mains_frequency is not None:
                continue
            start = with_chain(model, channel, msgspec.structs.replace(chain, mains_frequency=frequency))
            path = f"{path}.mains_frequency"
            free = Free(path=path, low=frequency - 0.1, high=frequency + 0.1, log=False, step=1e-4)
            found.append(
                Candidate(
                    cause=self.cause, location=channel, family="hum", starts=(start,), free=(free,),
                    reported=(Reported(name="frequency", path=path, unit="Hz"),), rank=0,
                )
            )  # fmt: skip
        return tuple(found)
