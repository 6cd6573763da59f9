"""The rig of a campaign: its own description, or the wire bonder with the known values of the campaign."""

import tomllib
from collections.abc import Mapping

from isorig.analysis.campaign import Campaign
from isorig.analysis.errors import AnalysisError, ModelError
from isorig.analysis.fitting.plausible import Doubt, doubts_of_records
from isorig.analysis.model.rig_model import RigModel, from_tree
from isorig.rig.choices import Baseline
from isorig.rig.errors import PlanError, RecordingError, RigError
from isorig.rig.wire_bonder.description import THESIS, wire_bonder

#: What precedes doubts about units, channels and given values.
CHECK_FIRST = "CHECK UNITS, CHANNELS AND GIVEN VALUES FIRST."


def baseline_model(campaign: Campaign, baseline: Baseline = "coulomb") -> RigModel:
    """The baseline with starting values.

    The wire bonder's known masses are read from the recording; starting values for fitted parameters from the recording if
    available, otherwise from the thesis. Raises RecordingError if the campaign lacks a channel that the rig needs, or its
    description is unusable; PlanError if the description has no sensor.
    """
    if campaign.description is not None:
        try:
            model = from_tree(tomllib.loads(campaign.description))
        except tomllib.TOMLDecodeError as error:
            raise RecordingError(f"{campaign.source}: the rig's description is not TOML ({error}); correct it") from None
        except ModelError as error:
            raise RecordingError(f"{campaign.source}: {error}") from None
    else:
        model = wire_bonder({**THESIS, **campaign.known}, friction=baseline == "coulomb")
    return recorded_in(model, campaign)


def doubts_in(campaign: Campaign, units: Mapping[str, str] | None = None) -> tuple[Doubt, ...]:
    """Units, given values, signs and sample rates of a campaign that contradict each other; () if no run can be compared.

    Only a rig with its own description or with known values is compared. `units` are those that the channels were read as.
    """
    if campaign.description is None and not campaign.known:
        return ()
    try:
        return doubts_of_records(baseline_model(campaign), campaign, units)
    except (RigError, AnalysisError):
        return ()


def with_sensors(model: RigModel, where: str) -> RigModel:
    """The same rig, if it has a sensor: without one, no simulation can be compared with a record. Raises PlanError if it has
    none; `where` names the description."""
    if not model.sensors:
        raise PlanError(
            f"{where} describes the rig {model.name!r} without a sensor, but a rig needs at least one recorded response; "
            "add it to sensors, with its channel and body"
        )
    return model


def recorded_in(model: RigModel, campaign: Campaign) -> RigModel:
    """The same model, if it has a sensor, and every run has its channels and a configuration of it. Raises PlanError if the model
    has no sensor; RecordingError if a channel is missing, or a configuration is unknown."""
    with_sensors(model, campaign.source or "the campaign")
    for run in campaign.runs:
        for name in model.channels:
            if name not in run.channels:
                raise RecordingError(
                    f"{campaign.source}: run {run.id!r} lacks channel {name!r}, which the rig's model needs "
                    f"(it has {', '.join(sorted(run.channels))}); measure it or remove the run"
                )
        if run.configuration not in model.configurations:
            raise RecordingError(
                f"{campaign.source}: run {run.id!r} has configuration {run.configuration!r}; the rig has "
                f"{', '.join(model.configurations)}, so correct it"
            )
    return model
