"""Hypothetical causes at the smallest relevant size: what a run must be able to reveal."""

from contextlib import suppress

from isorig.analysis.diagnose.causes import CATALOGUE
from isorig.analysis.diagnose.causes.base import Amplitudes, RigWithCause
from isorig.analysis.diagnose.causes.measurement_chain import chain_of, sensor_channels
from isorig.analysis.diagnose.kinds import kind_of
from isorig.analysis.errors import ModelError
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.proposals.limits import LargestMotions
from isorig.analysis.proposals.policy import POLICY
from isorig.analysis.proposals.prediction import Variant


def hypotheses(model: RigModel, peaks: LargestMotions, sample_rate: float) -> tuple[Variant, ...]:
    """Every cause of the catalogue at every place, at its smallest relevant size, added to the model of the runs so far.

    Sizes are relative to `peaks`, the largest magnitudes in the strongest allowed runs; the sample rate is in Hz. A cause at a
    body whose motion is imposed is left out where no record contains it.
    """
    links = [link.name for link in model.links]
    amplitudes = Amplitudes(
        deflection={link: max(peaks.stroke.get(link, 0.0), POLICY.no_motion) for link in links},
        speed={link: max(peaks.speed.get(link, 0.0), POLICY.no_motion) for link in links},
        peak={channel: max(peaks.channels.get(channel, 0.0), POLICY.no_motion) for channel in model.channels},
        sample_rate=sample_rate, end_time=POLICY.session,
    )  # fmt: skip
    found = []
    # Bodies whose inertia changes no record: their motion is imposed, and no sensor measures the force that this takes.
    felt = {sensor.force_in for sensor in model.sensors}
    hidden = {drive.imposes for drive in model.drives if drive.imposes is not None and f"drive.{drive.channel}" not in felt}
    for cause in CATALOGUE:
        for place in cause.supposed_places(model):
            if cause.at_bodies and place in hidden:
                continue
            with suppress(ModelError):
                found += [
                    Variant(cause=cause.name, location=place, model=rig.model, hum=rig.hum, detail=_detail(model, rig, place))
                    for rig in cause.smallest(model, amplitudes, place)
                ]
    # Causes that do not change the motion come first: one simulation serves all of them.
    return tuple(sorted(found, key=lambda variant: kind_of(variant.cause) != "sensor"))


def _detail(model: RigModel, rig: RigWithCause, place: str) -> str:
    # Crosstalk is assumed from every other channel, a resonator at several frequencies.
    if (frequency := rig.parameters.get("mode_frequency")) is not None:
        return f"with {frequency:g} Hz"
    if place not in sensor_channels(model):
        return ""
    sources = chain_of(rig.model, place)[0].crosstalk.keys() - chain_of(model, place)[0].crosstalk.keys()
    return "".join(f"from {source}" for source in sources)
