"""Hypothetical causes at the smallest relevant size: what a run must be able to reveal."""

from __future__ import annotations

from contextlib import suppress

from isorig.analysis.diagnose.causes import CATALOGUE
from isorig.analysis.diagnose.causes.base import Amplitudes
from isorig.analysis.diagnose.kinds import kind_of
from isorig.analysis.errors import ModelError
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.proposals.limits import LargestMotions
from isorig.analysis.proposals.policy import POLICY
from isorig.analysis.proposals.prediction import Variant


def hypotheses(model: RigModel, peaks: LargestMotions, sample_rate: float) -> tuple[Variant, ...]:
    """Every cause of the catalogue at every place, at its smallest relevant size, added to a model.

    Parameters
    ----------
    model
        The model that explains the runs so far.
    peaks
        Largest magnitudes in the strongest allowed runs: sizes are relative to these.
    sample_rate
        Hz.
    """
    links = [link.name for link in model.links]
    channels = (model.drive.channel, *(sensor.channel for sensor in model.sensors))
    amplitudes = Amplitudes(
        deflection={link: max(peaks.stroke.get(link, 0.0), POLICY.no_motion) for link in links},
        speed={link: max(peaks.speed.get(link, 0.0), POLICY.no_motion) for link in links},
        peak={channel: max(peaks.channels.get(channel, 0.0), POLICY.no_motion) for channel in channels},
        sample_rate=sample_rate, end_time=POLICY.session,
    )  # fmt: skip
    found = []
    for cause in CATALOGUE:
        for place in cause.supposed_places(model):
            with suppress(ModelError):
                found += [
                    Variant(cause=cause.name, location=place, model=rig.model, hum=rig.hum)
                    for rig in cause.smallest(model, amplitudes, place)
                ]
    # Causes that do not change the motion come first: one simulation serves all of them.
    return tuple(sorted(found, key=lambda variant: kind_of(variant.cause) != "sensor"))
