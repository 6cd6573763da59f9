"""What the baseline gets wrong, against noise: by channel, configuration, gain and band, each in one sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.model import RigModel
from analysis.trials import Trial, expected

#: A band counts where the misfit's power exceeds the noise's by this factor.
ABOVE_NOISE = 4.0


@dataclass(frozen=True, kw_only=True)
class Discrepancy:
    """A misfit: where it shows, how large it is, and how large noise alone would be.

    Parameters
    ----------
    size, noise
        rms of the misfit and of the noise over the rms of the signal, in the band.
    """

    channel: str
    configuration: str
    gain: float
    run: str
    band_hz: tuple[float, float]
    what: str
    size: float
    noise: float
    text: str


def discrepancies(model: RigModel, trials: Sequence[Trial], *, most: int = 12) -> tuple[Discrepancy, ...]:
    """The bands in which the model's error stands above the noise, largest first."""
    found = []
    for trial in trials:
        rate, n = trial.sample_rate, trial.samples
        predicted = expected(model, trial)
        frequency = np.fft.rfftfreq(n, 1.0 / rate)
        edges = np.geomspace(1.0, rate / 2.1, 40)
        which = np.digitize(frequency, edges)
        for row, name in enumerate(trial.channels):
            error = np.abs(np.fft.rfft(predicted[row] - trial.measured[row])) ** 2 / n
            signal = np.abs(np.fft.rfft(trial.measured[row])) ** 2 / n
            counts = np.bincount(which, minlength=len(edges) + 1)[1:-1]
            e = np.bincount(which, error, minlength=len(edges) + 1)[1:-1]
            s = np.bincount(which, signal, minlength=len(edges) + 1)[1:-1]
            quiet = counts * max(trial.noise[row], 1e-12) ** 2
            bad = (e > ABOVE_NOISE * quiet) & (e > 0.02**2 * s) & (counts > 3)
            if not bad.any():
                continue
            weight = np.where(bad, e, 0.0)
            order = np.cumsum(weight) / weight.sum()
            low, high = int(np.searchsorted(order, 0.05)), int(np.searchsorted(order, 0.95))
            inside = slice(low, high + 1)
            size = float(np.sqrt(e[inside].sum() / s[inside].sum()))
            noise = float(np.sqrt(quiet[inside].sum() / s[inside].sum()))
            band = (round(float(edges[low]), 2), round(float(edges[high + 1]), 2))
            text = (
                f"{trial.run.configuration} at gain {trial.run.gain:g} ({trial.run.id}) the {name} "
                f"between {band[0]:g} and {band[1]:g} Hz "
                f"is simulated with an error of {100 * size:.1f} % of the signal, where noise alone would be {100 * noise:.2g} %"
            )
            found.append(
                Discrepancy(
                    channel=name, configuration=trial.run.configuration, gain=trial.run.gain, run=trial.run.id,
                    band_hz=band, what="time" if trial.run.excitation == "moves" else "frf", size=size, noise=noise,
                    text=text[0].upper() + text[1:] + ".",
                )
            )  # fmt: skip
    found.sort(key=lambda d: -d.size / max(d.noise, 1e-6))
    return tuple(found[:most])
