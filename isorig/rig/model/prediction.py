"""A model's prediction of a campaign's responses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np

from isorig.analysis.campaign import SI_UNIT, Campaign, Channel, Measured, Run, given_campaign
from isorig.analysis.given import flag, of_type
from isorig.analysis.model.rig_model import RigModel, given_rig
from isorig.analysis.simulate import simulate
from isorig.analysis.simulate.free_run import excitation_of
from isorig.rig.errors import RecordingError


@dataclass(frozen=True, kw_only=True)
class Model:
    """A rig to be simulated for comparison: its name, and the time of a drifting model's zero."""

    name: str
    rig: RigModel
    origin: datetime | None = None


def predicted(model: RigModel, campaign: Measured, *, origin: datetime | None = None, as_recorded: bool = False) -> Campaign:
    """The same runs with the recorded drive, and responses simulated from rest.

    `campaign` is the measurement or the path of its recording; `origin` is the time of a drifting model's zero, the campaign's
    first sample if None.

    Raises
    ------
    ArgumentError
        An argument is of another type.
    RecordingError
        A run lacks the drive or has a configuration that the model does not have.

    Examples
    --------
    >>> import isorig as iso
    >>> measured = iso.read("campaign.h5")
    >>> same = iso.predict(iso.wire_bonder(), measured)
    >>> run, other = measured.runs[0], same.runs[0]
    >>> float(abs(run.read("table") - other.read("table")).max()) < 0.02 * float(abs(run.read("table")).max())
    True
    """
    runs = []
    model, campaign = given_rig(model), given_campaign(campaign)
    flag(as_recorded, "the argument as_recorded")
    if origin is not None:
        of_type(origin, datetime, "the origin", "a datetime; give one, for example campaign.runs[0].started")
    for run in campaign.runs:
        here = f"{campaign.source}: run {run.id!r}"
        for drive in model.drives:
            if drive.channel not in run.channels:
                raise RecordingError(f"{here} lacks the drive's channel {drive.channel!r}; record it")
        if run.configuration not in model.configurations:
            raise RecordingError(
                f"{here} has configuration {run.configuration!r}; the model has {', '.join(model.configurations)}"
            )
        excitation = excitation_of(model, run)
        response = simulate(
            model, excitation, configuration=run.configuration, start_time=seconds_from(campaign, run, origin),
            as_recorded=as_recorded,
        )  # fmt: skip
        # A streamed gain stays with the drive that it made.
        channels = {name: channel for name, channel in run.channels.items() if name in (*model.drive_channels, "gain")}
        for sensor in model.sensors:
            channels[sensor.channel] = Channel(
                name=sensor.channel, samples=response.channels[sensor.channel], quantity=sensor.quantity,
                unit=SI_UNIT[sensor.quantity],
            )  # fmt: skip
        # What is known of the records, for example gaps and spectra, is not true of simulated ones.
        runs.append(replace(run, channels=channels, repeat_of=None, gaps=(), usable_to=None, spectra=()))
    return replace(campaign, runs=tuple(runs))


def measured_and_simulated(campaign: Campaign, models: Sequence[Model]) -> dict[str, Campaign]:
    """A campaign as "measured", and the same runs as each model predicts their records, by the names of the models."""
    return {"measured": campaign} | {m.name: predicted(m.rig, campaign, origin=m.origin, as_recorded=True) for m in models}


def errors(measured: Campaign, other: Campaign) -> dict[str, dict[str, float]]:
    """rms(predicted - measured) / rms(measured) by run and channel, for the responses that were measured."""
    found: dict[str, dict[str, float]] = {}
    for run, simulated in zip(measured.runs, other.runs, strict=True):
        row = {}
        for name in simulated.channels:
            if name in run.channels and name != "gain":
                y = run.read(name)
                size, off = float(np.sqrt(np.mean(y**2))), float(np.sqrt(np.mean((simulated.read(name) - y) ** 2)))
                if size > 0.0 and simulated.channels[name] is not run.channels[name]:
                    row[name] = off / size
        found[run.id] = row
    return found


def seconds_from(campaign: Campaign, run: Run, origin: datetime | None) -> float:
    """Seconds from a drifting model's zero to the run's first sample."""
    if origin is None or run.started is None:
        return campaign.seconds_since_start(run)
    return max((run.started - origin).total_seconds(), 0.0)
