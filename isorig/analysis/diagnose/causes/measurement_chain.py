"""Causes in the measurement chain of a channel."""

from collections.abc import Iterable
from typing import Any

import msgspec

from isorig.analysis.campaign import MOTION
from isorig.analysis.diagnose.causes.base import Cause, Evidence, exchange
from isorig.analysis.fitting.candidate import Candidate, Reported
from isorig.analysis.fitting.solve import Free
from isorig.analysis.model.rig_model import Chain, RigModel


def chain_of(model: RigModel, channel: str) -> tuple[Chain, str]:
    """The chain of a channel and its path in the model."""
    if channel == model.drive.channel:
        return model.drive.chain, "drive.chain"
    return model.sensor(channel).chain, f"sensors.{channel}.chain"


def with_chain(model: RigModel, channel: str, **changes: Any) -> RigModel:
    """The rig with changes of a channel's chain."""
    chain = msgspec.structs.replace(chain_of(model, channel)[0], **changes)
    if channel == model.drive.channel:
        return with_drive(model, chain=chain)
    return msgspec.structs.replace(model, sensors=exchange(model.sensors, channel, chain=chain))


def with_drive(model: RigModel, **changes: Any) -> RigModel:
    """The rig with changes of its drive."""
    return msgspec.structs.replace(model, drive=msgspec.structs.replace(model.drive, **changes))


def with_one_value(
    cause: Cause, place: str, starts: Iterable[RigModel], free: Free, name: str, unit: str, twin: tuple[str, str] | None = None
) -> Candidate:
    """The candidate of a cause with one value of its own, reported by this name and unit."""
    return Candidate(
        cause=cause.name, location=place, family=cause.family, rank=cause.rank, starts=tuple(starts), free=(free,), twin=twin,
        reported=(Reported(name=name, path=free.path, unit=unit),),
    )  # fmt: skip


def sensor_channels(model: RigModel) -> tuple[str, ...]:
    """The sensors' channels."""
    return tuple(sensor.channel for sensor in model.sensors)


def follows_command(model: RigModel) -> bool:
    """Whether the drive pushes as it is recorded by what may be a command: a recorded motion is none."""
    return model.drive.quantity not in MOTION and model.drive.acts_as_recorded


class DriveCause(Cause):
    """A drive whose force differs from the command that its channel records."""

    rank = 0

    def places(self, model: RigModel) -> tuple[str, ...]:
        """The channel of a drive whose record may be a command that it follows so far."""
        return (model.drive.channel,) if follows_command(model) else ()


class ChannelCause(Cause):
    """A cause in the chain of a channel."""

    family = "chain"
    rank = 0

    def places(self, model: RigModel) -> tuple[str, ...]:
        """The drive's channel and the sensors'."""
        return (model.drive.channel, *sensor_channels(model))

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        """Every channel that records anything: a rig that is only released has a drive of zeros."""
        return tuple(c for c in super().candidates(model, evidence) if not evidence.is_silent(c.location))
