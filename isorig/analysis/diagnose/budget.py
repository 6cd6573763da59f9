"""Composition of the held-out error: its power split into noise, disturbance, linear, amplitude, time and unassigned.

A model's error in each run and channel is compared with the drive, with other gains, and with repetitions of the same drive. The
repeatable part is due to the model; the part related to the drive by one transfer function at all gains could be removed by a
linear model.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.fitting.coherent_power import SEGMENT, coherent_density, coherent_power, segments
from isorig.analysis.fitting.repeats import disturbance, repeated
from isorig.analysis.fitting.trials import Trial, expected
from isorig.analysis.model.rig_model import RigModel

NATURES = ("noise", "disturbance", "linear", "amplitude", "time", "unassigned")
#: Number of bootstrap draws of runs for the intervals.
DRAWS = 400


@dataclass(frozen=True, kw_only=True)
class Budget:
    """Shares of the held-out error's power by nature, which sum to 1."""

    shares: Mapping[str, tuple[float, float, float]]  #: (value, low, high) by nature, with the 95 % interval over resampled runs.
    #: Values alone.
    by_channel: Mapping[str, Mapping[str, float]]
    by_configuration: Mapping[str, Mapping[str, float]]
    how: str  #: How each was determined, in a sentence.
    repeated: bool  #: Whether runs with one drive measure the disturbance; otherwise it is part of what is unassigned.


def budget(model: RigModel, trials: Sequence[Trial], noise: FloatArray, *, unrelated: bool = False) -> Budget:
    """The budget of a model's held-out error.

    `noise` is the error that the sensors' noise makes, as a share of the signal, shape (runs, channels); with `unrelated`, what
    the model leaves was found to be related to neither the drive nor the motion.
    """
    left = [(trial.measured - expected(model, trial))[:, trial.held_out] for trial in trials]
    signal = np.stack([np.mean(trial.measured[:, trial.held_out] ** 2, axis=1) for trial in trials])
    pairs = repeated(trials)
    measured = bool(pairs) or any(trial.disturbance is not None for trial in trials)
    shaken = disturbance(model, trials) ** 2 * signal if measured else None
    parts = _powers(trials, left, noise**2 * signal, shaken) / np.maximum(signal, 1e-300)[:, :, None]
    if unrelated:
        parts[..., NATURES.index("disturbance")] += parts[..., NATURES.index("unassigned")]
        parts[..., NATURES.index("unassigned")] = 0.0
    played = ", ".join(f"{trials[a].run.id} and {trials[b].run.id}" for a, b in pairs)
    return Budget(
        shares=_intervals(parts), repeated=measured,
        by_channel={
            name: _shares(parts[:, [trials[0].recorded(other) == name for other in trials[0].channels]].reshape(-1, len(NATURES)))
            for name in dict.fromkeys(map(trials[0].recorded, trials[0].channels))
        },
        by_configuration={
            name: _shares(parts[[trial.run.configuration == name for trial in trials]].reshape(-1, len(NATURES)))
            for name in dict.fromkeys(trial.run.configuration for trial in trials)
        },
        how="Noise: of the sensors, and of the drive channel propagated through the model. Disturbance: "
        + (
            f"the difference between runs with one drive ({played}) beyond the noise; the same amount is assumed in other "
            "runs, limited to the part that is not related to the drive. "
            if pairs
            else "what the repeated runs do not share, limited to the part that is not related to the drive. "
            if measured
            else "what is related to neither the drive nor the motion; not measured, because no drive was repeated. "
            if unrelated
            else "not measured, because no drive was repeated; at most the unassigned part. "
        )
        + "Linear: the part removed by one transfer function from the drive, the same at all gains of a configuration (modes "
        f"narrower than a segment's resolution, {1.0 / SEGMENT:g} Hz at best, count as amplitude). "
        "Amplitude: the further repeatable or drive-related part. Time: due to transfer functions that differ between equal "
        "runs.",
    )  # fmt: skip


def _shares(parts: FloatArray) -> dict[str, float]:
    whole = parts.sum(axis=0)
    return dict(zip(NATURES, (whole / max(float(whole.sum()), 1e-300)).tolist(), strict=True))


def _intervals(parts: FloatArray) -> dict[str, tuple[float, float, float]]:
    by_run = parts.sum(axis=1)
    picks = np.random.default_rng(23).integers(0, len(by_run), (DRAWS, len(by_run)))
    drawn = by_run[picks].sum(axis=1)
    drawn /= np.maximum(drawn.sum(axis=1, keepdims=True), 1e-300)
    low, high = np.quantile(drawn, (0.025, 0.975), axis=0)
    return {name: (value, float(low[k]), float(high[k])) for k, (name, value) in enumerate(_shares(by_run).items())}


def _powers(trials: Sequence[Trial], left: Sequence[FloatArray], noise: FloatArray, shaken: FloatArray | None) -> FloatArray:
    # Power of each nature, shape (runs, channels, natures). What repeats is measured in runs of one drive; in others it is what
    # the disturbance found there leaves, or, where no drive was played twice, what follows the drive.
    whole = np.stack([np.mean(error**2, axis=1) for error in left])
    noise = np.minimum(noise, whole)
    beyond = whole - noise
    linear, coherent = np.minimum(coherent_power(trials, left), beyond)
    linear = np.minimum(linear, coherent)
    repeats, drifts = _shared(trials, left)
    if shaken is not None:
        repeats = np.where(np.isnan(repeats), np.maximum(beyond - shaken, coherent), repeats)
    known = ~np.isnan(repeats)
    repeats = np.where(known, np.clip(repeats, 0.0, beyond), coherent)
    drifts = np.minimum(drifts, beyond - repeats)
    amplitude = np.maximum(repeats - linear, 0.0)
    linear = np.minimum(linear, repeats)
    rest = np.maximum(beyond - linear - amplitude - drifts, 0.0)
    disturbance, unassigned = np.where(known, rest, 0.0), np.where(known, 0.0, rest)
    return np.stack([noise, disturbance, linear, amplitude, drifts, unassigned], axis=2)


def _shared(trials: Sequence[Trial], left: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    # What repeats when the drive is played again (NaN where it was not), and what its transfer functions lost meanwhile.
    shape = len(trials), len(left[0])
    repeats, drifts = np.full(shape, np.nan), np.zeros(shape)
    for one, other in repeated(trials):
        n = min(left[one].shape[1], left[other].shape[1])
        a, b = left[one][:, :n], left[other][:, :n]
        same = np.mean(a * b, axis=1)
        apart = 0.5 * (a - b)
        drive = segments(trials[one], trials[one].excitation.recorded[trials[one].held_out][:n])
        for channel in range(shape[1]):
            error = segments(trials[one], apart[channel])
            if len(drive) and len(error) == len(drive):
                size = float(np.sum(np.mean(np.abs(error) ** 2, axis=0))) + 1e-300
                own = coherent_density(drive, error)
                luck = 2.0 / len(drive)
                share = max((float(np.sum(own)) / size - luck) / (1.0 - luck), 0.0)
                drifts[[one, other], channel] = share * float(np.mean(apart[channel] ** 2))
        repeats[one] = repeats[other] = same
    return repeats, drifts
