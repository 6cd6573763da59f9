"""Detects exchanged channels from the shape of their ratio: for every pair, from a single run.

The ratio of two channels over frequency has a shape that the given rig predicts for the recorded drive. If the recorded ratio has
the inverse shape, the channels may be exchanged, and the phases decide it (`plausible.py`). Levels do not matter, so a wrong unit
is no exchange; channels with the same motion over the drive's band cannot be distinguished. Bands in which a record does not
exceed its noise do not count.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from isorig.analysis.campaign import BoolArray, FloatArray, broad
from isorig.analysis.fitting.linear_spectra import LinearRig, Spectrum, dampers, friction_level, given_parameters
from isorig.analysis.model.rig_model import RigModel

#: The fewest bands that make a shape.
FEWEST = 6
#: rms of a predicted ratio's logarithm about its mean above which it has a shape.
SHAPED = 0.35
#: Regression of the recorded on the predicted shape: ideally +1, and -1 for exchanged channels. Of 1 610 pairs of records without
#: faults on eleven rigs none was below 0.08, with starting values wrong by up to a factor of 1.6; an exchange changes the sign.
TURNED = -0.1
#: An exchange with the drive must reduce the distance of all channels' shapes by this (mean |log|): a wrong drive predicts
#: another motion, so the regression is less informative. For records without faults there was no reduction at all.
NEARER = 0.3
#: Share of that distance that an exchange with the drive must remove. Chosen: those of the tests remove at least twice as much,
#: and a misfit by strong contacts, whose shapes are turned by chance, not even a hundredth.
EXPLAINS = 0.1
#: Power that counts as none, far below that of any record.
NONE = 1e-200
#: Power of a record relative to its noise from which a band counts. Chosen: half of it is then motion.
ABOVE_NOISE = 2.0


def swapped_channels(given: RigModel, spectra: Sequence[Spectrum]) -> dict[tuple[str, str], list[str]]:
    """Pairs of channels that seem exchanged, and the runs concerned; runs without a broad-band drive are skipped."""
    found: dict[tuple[str, str], list[str]] = {}
    names = (given.drive.channel, *(sensor.channel for sensor in given.sensors))
    for spectrum in spectra:
        heard = exceeds_noise(spectrum)
        if broad([spectrum.run]) and heard.sum() >= FEWEST:
            predicted = _Predicted(given, spectrum)
            pairs = list(_nearer(predicted, spectrum, *_shapes(predicted, spectrum, heard), heard))
            if pairs:
                _, a, b = max(pairs)
                found.setdefault((names[a], names[b]), []).append(spectrum.run.id)
    return found


class _Predicted:
    # The responses of the given rig in the configuration and at the frequencies of a run.

    def __init__(self, given: RigModel, spectrum: Spectrum) -> None:
        self._rig, self._values = LinearRig(given, spectrum.run.configuration), given_parameters(given)
        self._free = self._rig.free_motion(spectrum.omega, self._values)
        self._forces = np.array([[friction_level(contact.law)] for contact in given.contacts]).reshape(-1, 1)
        self._as_recorded = np.ones((len(given.drives), 1))

    def power(self, spectrum: Spectrum) -> FloatArray:
        """With the drives of a spectrum of the run, which determine the damping by friction, shape (responses, groups)."""
        rubs = dampers(self._free, self._values, spectrum, self._forces, self._as_recorded)
        response = self._rig.responses(spectrum.omega, replace(self._values, friction=rubs), self._free)
        return spectrum.predicted(response)[:, 0]


def _nearer(
    rig: _Predicted, spectrum: Spectrum, recorded: FloatArray, predicted: FloatArray, heard: BoolArray
) -> Iterator[tuple[float, int, int]]:
    # Exchanges indicated by the records, and the reduction of the distance by each.
    as_is = _distance(recorded, predicted)
    for a, b in combinations(range(len(recorded)), 2):
        turned = _turned(recorded[a] - recorded[b], predicted[a] - predicted[b])
        if a == 0:
            gain = as_is - _distance(*_shapes(rig, _exchanged(spectrum, b - 1), heard))
            if gain > (EXPLAINS * as_is if turned else NEARER):
                yield gain, a, b
        elif turned:
            order = list(range(len(recorded)))
            order[a], order[b] = b, a
            gain = as_is - _distance(recorded[order], predicted)
            if gain > 0.0:
                yield gain, a, b


def _shapes(rig: _Predicted, spectrum: Spectrum, heard: BoolArray) -> tuple[FloatArray, FloatArray]:
    # Logarithms of the amplitudes of drive and responses in the bands that count, as recorded and as predicted by the given rig.
    drive = spectrum.drives[:1, 0].real
    powers = (np.concatenate([drive, each]) for each in (spectrum.power, rig.power(spectrum)))
    # Friction that holds a body for all of a run leaves no motion.
    recorded, predicted = (0.5 * np.log(np.maximum(spectrum.in_bands(power)[:, heard], NONE)) for power in powers)
    return recorded, predicted


def exceeds_noise(spectrum: Spectrum) -> BoolArray:
    """Whether the power of all responses in each band is at least `ABOVE_NOISE` times that of their noise, shape (bands,)."""
    power, noise = spectrum.in_bands(spectrum.power), spectrum.in_bands(spectrum.noise)
    return np.asarray(((power > 0.0) & (power >= ABOVE_NOISE * noise)).all(axis=0))


def _turned(recorded: FloatArray, predicted: FloatArray) -> bool:
    recorded, predicted = recorded - recorded.mean(), predicted - predicted.mean()
    size = float(predicted @ predicted)
    return bool(np.sqrt(size / len(predicted)) > SHAPED and float(recorded @ predicted) < TURNED * size)


def _distance(recorded: FloatArray, predicted: FloatArray) -> float:
    # Mean distance of the responses' shapes relative to the drive.
    apart = (recorded[1:] - recorded[0]) - (predicted[1:] - predicted[0])
    return float(np.mean(np.abs(apart - apart.mean(axis=1, keepdims=True))))


def _exchanged(spectrum: Spectrum, row: int) -> Spectrum:
    # The spectrum with its first drive and one response exchanged.
    drives, power = spectrum.drives.copy(), spectrum.power.copy()
    power[row] = drives[0, 0].real
    drives[0, 0] = spectrum.power[row]
    drives[1:, 0] = spectrum.across[1:, row]
    drives[0, 1:] = drives[1:, 0].conj()
    return replace(spectrum, drives=drives, power=power)
