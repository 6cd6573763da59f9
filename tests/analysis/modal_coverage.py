"""The study of error bars of transfer functions and modes: how often nominal 95 % intervals contain the true value.

`python tests/analysis/modal_coverage.py [--repeats 300]` writes docs/study/modal-coverage.csv and prints it.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from isorig.analysis.campaign import Channel, FloatArray, Run
from isorig.analysis.errors import AnalysisError
from isorig.analysis.spectra.modes import fit_modes
from isorig.analysis.spectra.welch import estimate

TABLE = Path(__file__).parents[2] / "docs" / "study" / "modal-coverage.csv"
FREQUENCY, DAMPING, RATE, SECONDS = 50.0, 0.01, 256.0, 120.0
#: Two-sided 95 % of the normal distribution.
QUANTILE = 1.959964
#: Noise of the reference and of the response as shares of their rms, whether the latter has its peak at the mode, and frequency
#: bins in the half-power bandwidth.
CASES = {
    "response noise 2 %": (0.0, 0.02, False, 5.0),
    "reference noise 10 %": (0.1, 0.0, False, 5.0),
    "reference noise 30 %": (0.3, 0.0, False, 5.0),
    "coloured response noise 5 %": (0.0, 0.05, True, 5.0),
    "peak narrower than the resolution": (0.0, 0.02, False, 0.7),
}


def measured(reference_noise: float, response_noise: float, coloured: bool, seed: int) -> Run:
    """White noise through one mode, with noise in the channels."""
    draw = np.random.default_rng(seed)
    n = round(RATE * SECONDS)
    drive = draw.standard_normal(n)
    answer = np.fft.irfft(np.fft.rfft(drive) * accelerance(np.fft.rfftfreq(n, 1.0 / RATE)), n)
    noise = draw.standard_normal(n)
    if coloured:
        turn = 2.0 * np.pi * FREQUENCY / RATE
        noise = lfilter([1.0], [1.0, -2.0 * 0.98 * np.cos(turn), 0.98**2], noise)
    rows = {
        "drive": drive + reference_noise * draw.standard_normal(n),
        "answer": answer + response_noise * answer.std() * noise / noise.std(),
    }
    channels = {name: Channel(name=name, samples=values) for name, values in rows.items()}
    return Run(id="a", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels)


def accelerance(f: FloatArray) -> FloatArray:
    """The true transfer function."""
    s, w = 2j * np.pi * f, 2.0 * np.pi * FREQUENCY
    return np.asarray(s**2 / (s**2 + 2.0 * DAMPING * w * s + w**2))


def covered(case: str, repeats: int) -> dict[str, object]:
    """The covered shares of a case."""
    reference, response, coloured, lines = CASES[case]
    hits: dict[str, list[float]] = {"frequency": [], "damping": [], "curve": []}
    refused = 0
    for seed in range(repeats):
        spectra = estimate(
            [measured(reference, response, coloured, seed)], references=["drive"], resolution=2.0 * DAMPING * FREQUENCY / lines
        )
        frf = spectra.frf("answer", "drive")
        near = np.abs(frf.frequency - FREQUENCY) < max(2.0 * DAMPING * FREQUENCY, 2.0 * frf.resolution)
        error = np.abs(np.abs(frf.value) - np.abs(accelerance(frf.frequency)))[near]
        hits["curve"].append(float(np.mean(error <= QUANTILE * frf.magnitude_std[near])))
        reach = max(8.0 * DAMPING * FREQUENCY, 6.0 * frf.resolution)
        try:
            fit = fit_modes(
                frf, (FREQUENCY - reach, FREQUENCY + reach), kind="accelerance", guesses=[(1.002 * FREQUENCY, 1.3 * DAMPING)],
                residuals=1,
            )  # fmt: skip
        except AnalysisError:
            refused += 1
            continue
        mode = fit.modes[0]
        hits["frequency"].append(float(abs(mode.frequency - FREQUENCY) <= QUANTILE * mode.frequency_std))
        hits["damping"].append(float(abs(mode.damping - DAMPING) <= QUANTILE * mode.damping_std))
    shares = {name: f"{100.0 * np.mean(values):.1f}" if values else "" for name, values in hits.items()}
    return {"case": case, "repeats": repeats, "refused": refused, **shares}


def main() -> None:
    """Count and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=300)
    repeats = parser.parse_args().repeats
    rows = []
    for case in CASES:
        rows.append(covered(case, repeats))
        print(rows[-1], flush=True)
    with TABLE.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
