"""Whether what a model leaves of a measurement is related to the drive and to the motion, or is noise.

What a wrong model leaves follows from the drive: it is coherent with the drive, or with a function of a link's deflection or
velocity. Sensor noise is coherent with none of them, even if its spectrum and level differ between runs. Noise in the recorded
drive is part of the drive that the model gets; so only frequency bins in which the drive is far above its noise count.
"""

from collections.abc import Sequence

import msgspec
import numpy as np

from isorig.analysis.campaign import ComplexArray, FloatArray
from isorig.analysis.errors import ModelError, SimulationError
from isorig.analysis.fitting.excess import SIMULATION_LIMIT
from isorig.analysis.fitting.trials import Trial, expected
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.parallel import side_by_side
from isorig.analysis.simulate import simulate
from isorig.analysis.simulate.gauges import link_sensors
from isorig.analysis.spectra.welch import WELL_DRIVEN, effective_averages
from isorig.analysis.spectra.windows import HANN
from isorig.analysis.wording import in_per_cent

#: Segments of a record, half overlapping.
SEGMENTS = 23
#: Neighbouring bins of a Hann window that share one independent value.
TIED = 2.0
#: Probability of a chance coherence, over all runs, responses and functions, below which the rest is related to the motion, if
#: the coherent share of its power is above `SHARE` and above the simulation's own error.
CHANCE, SHARE = 1e-3, 0.1
#: Error as a share of the signal, rms, above which what follows the drive or the motion counts. Derived: twice the accuracy of
#: the simulation, which follows them, too.
RELATED = 2.0 * SIMULATION_LIMIT
#: How a remainder is described that is not related to them, after "is" or "what is".
UNRELATED = f"related to neither the drive nor the motion beyond {in_per_cent(RELATED)} of the signal"
#: Coherence that must show if it is there, for what is left to count as unrelated. Chosen: half of it.
DETECTABLE = 0.5


def depends_on_drive(model: RigModel, trials: Sequence[Trial]) -> bool:
    """Whether the difference between measurement and model is coherent with the drives or with functions of the motion.

    Also where the records are too short to exclude it: a share of `DETECTABLE` of its power would not show. Runs that are judged
    by their drive's force count as related.
    """
    if any(trial.motion is not None for trial in trials):
        return True
    found: list[tuple[float, bool, float]] = []
    for each in side_by_side(lambda trial: _coherences(model, trial), trials):
        if each is None:
            return True
        found += each
    least = min((detectable for *_, detectable in found), default=1.0)
    return least * len(found) >= CHANCE or any(large and chance * len(found) < CHANCE for chance, large, _ in found)


def _coherences(model: RigModel, trial: Trial) -> list[tuple[float, bool, float]] | None:
    # `_chance` of what the model leaves in each channel with each drive and function of the motion; None without a simulation.
    try:
        left = trial.measured - expected(model, trial)
        inputs = _drives_and_motions(model, trial)
    except (SimulationError, ModelError):
        return None
    drive = inputs[0]
    n = min(len(rows) for rows in (*left, *inputs))
    length = 2 * (n // (SEGMENTS + 1))
    driven = _power(_segments(drive[:n], length))
    kept = driven >= WELL_DRIVEN * driven.max()
    seen = [_segments(values[:n], length)[:, kept] for values in inputs]
    averages = effective_averages(HANN.samples(length), len(seen[0]), length // 2)
    found: list[tuple[float, bool, float]] = []
    for rows, signal in zip(left, trial.measured, strict=True):
        rest, size = _segments(rows[:n], length)[:, kept], _power(_segments(signal[:n], length)[:, kept])
        found += [_chance(rest, values, float(size.sum()), averages) for values in seen]
    return found


def _drives_and_motions(model: RigModel, trial: Trial) -> list[FloatArray]:
    # The drives, and functions of each link's simulated deflection and velocity.
    sensors = link_sensors(model.links)
    watched = msgspec.structs.replace(model, sensors=(*model.sensors, *sensors))
    seen = simulate(
        watched, trial.excitation, configuration=trial.run.configuration, start_time=trial.start_time, start=trial.start_of(model)
    ).channels
    inputs = [trial.excitation.recorded, *(other.recorded for other in trial.excitation.others)]
    for sensor in sensors:
        inputs += _functions(seen[sensor.channel], sensor.quantity)
    return inputs


def _functions(values: FloatArray, quantity: str) -> list[FloatArray]:
    x = values / max(float(np.std(values)), 1e-300)
    return [x, np.abs(x), np.sign(x) if quantity == "velocity" else x**3]


def _chance(left: ComplexArray, values: ComplexArray, size: float, averages: float) -> tuple[float, bool, float]:
    # Probability that unrelated records are as coherent as these two, the bins weighted by the power of what is left, whether the
    # coherent power matters relative to the signal's, and the probability of a coherence of `DETECTABLE`.
    from scipy.special import gammaincc

    cross = np.abs((np.conj(left) * values).sum(axis=0)) ** 2
    power, input_power = _power(left), _power(values)
    if power.sum() == 0.0 or input_power.sum() == 0.0:
        return 1.0, False, 0.0
    coherence = float((power / power.sum()) @ (cross / np.maximum(power * input_power, 1e-300)))
    # Without a relation coherence times averages has an exponential distribution, a weighted sum nearly a gamma distribution.
    shape = 1.0 / (TIED * float(((power / power.sum()) ** 2).sum()))
    share = max(coherence - 1.0 / averages, 0.0) / (1.0 - 1.0 / averages)
    large = share > SHARE and share * power.sum() > RELATED**2 * size
    chance, detectable = (float(gammaincc(shape, shape * averages * each)) for each in (coherence, DETECTABLE))
    return chance, bool(large), detectable


def _power(segments: ComplexArray) -> FloatArray:
    return np.asarray((np.abs(segments) ** 2).sum(axis=0))


def _segments(values: FloatArray, length: int) -> ComplexArray:
    parts = np.lib.stride_tricks.sliding_window_view(values, length)[:: length // 2]
    return np.asarray(np.fft.rfft((parts - parts.mean(axis=1, keepdims=True)) * HANN.samples(length), axis=1)[:, 1:])
