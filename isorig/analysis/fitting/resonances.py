"""The largest resonance of a response, as recorded and as the given rig has it."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

import numpy as np

from isorig.analysis.campaign import MOTION, FloatArray
from isorig.analysis.fitting.linear_spectra import LinearRig, Spectrum, given_parameters
from isorig.analysis.model.rig_model import RigModel

#: Frequencies at which the given rig's response is computed, and how many times it reaches beyond the recorded ones. The spacing
#: is a third of a per cent.
POINTS, BEYOND = 6000, 1e4
#: A resonance exceeds the response at both ends of the recorded frequencies by this factor. Chosen: a damping ratio of 0.25.
PEAK = 2.0


@dataclass(frozen=True, kw_only=True)
class Resonance:
    """The largest resonance of a response: the frequency in the records and that of the given rig, Hz."""

    channel: str
    recorded: float
    given: float

    @property
    def ratio(self) -> float:
        """Recorded over given frequency."""
        return self.recorded / self.given


def resonance(given: RigModel, spectra: Sequence[Spectrum]) -> Resonance | None:
    """The response with the median ratio of recorded to given frequency of its largest resonance; None if none shows.

    Of the spectra that with the largest drive is used, of a rig with one drive.
    """
    if given.more_drives or not spectra:
        return None
    spectrum = max(spectra, key=lambda each: each.square * float(each.drives[0, 0].real.sum()))
    omega = np.geomspace(spectrum.omega[0] / BEYOND, spectrum.omega[-1] * BEYOND, POINTS)
    predicted = LinearRig(given, spectrum.run.configuration).responses(omega, given_parameters(given))[:, 0, 0]
    base = MOTION.get(given.drive.quantity, 0) if given.drive.imposes is not None else 0
    found = []
    for k, sensor in enumerate(given.sensors):
        order = MOTION.get(sensor.quantity, 0) - base
        recorded = _peak(spectrum.omega, np.abs(spectrum.across[0, k]) / spectrum.drives[0, 0].real, order)
        own = _peak(omega, np.abs(predicted[k]), order)
        if recorded is not None and own is not None:
            found.append(Resonance(channel=sensor.channel, recorded=recorded, given=own))
    return sorted(found, key=lambda each: each.ratio)[len(found) // 2] if found else None


def _peak(omega: FloatArray, response: FloatArray, order: int) -> float | None:
    # The frequency, Hz, of the largest peak of a response as a displacement.
    size = response / omega**order
    top = int(np.argmax(size))
    return float(omega[top]) / (2.0 * pi) if size[top] >= PEAK * max(size[0], size[-1]) else None
