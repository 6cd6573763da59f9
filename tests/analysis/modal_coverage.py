"""The study of intervals of transfer functions and modes: how often nominal 95 % intervals contain the true value.

`python tests/analysis/modal_coverage.py [--repeats 300] [--case NAME ...]` writes docs/study/modal-coverage.csv and prints it.
The column `curve` is for the limits that `rig frf` prints, `bars` for the magnitude with the standard deviation of its random
error, both in the bins near the peak; `without` are the repeats whose limits are missing in a bin there, in percent.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from isorig.analysis.campaign import Channel, FloatArray, Run
from isorig.analysis.errors import AnalysisError
from isorig.analysis.spectra.magnitude_limits import magnitude_limits
from isorig.analysis.spectra.modal_fit import Mode, fit_modes
from isorig.analysis.spectra.welch import Frf, Spectra, estimate

TABLE = Path(__file__).parents[2] / "docs" / "study" / "modal-coverage.csv"
PAGE = Path(__file__).parents[2] / "docs" / "theory.md"
#: Columns of the table on that page, and their titles.
SHOWN = {
    "frequency": "natural frequency", "damping": "damping ratio", "curve": "limits of the magnitude",
    "bars": "random error alone",
}  # fmt: skip
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
    "both channels' noise 10 %": (0.1, 0.1, False, 5.0),
    "response noise 2 %, 3 bins": (0.0, 0.02, False, 3.0),
    "response noise 2 %, 20 bins": (0.0, 0.02, False, 20.0),
    "peak narrower than the resolution": (0.0, 0.02, False, 0.7),
    "sparse impulses": (0.0, 0.02, False, 5.0),
}
#: Mean distance of the impulses of a sparse drive, s.
APART = 1.0


def measured(reference_noise: float, response_noise: float, coloured: bool, seed: int, *, sparse: bool = False) -> Run:
    """White noise, or sparse impulses, through one mode, with noise in the channels."""
    draw = np.random.default_rng(seed)
    n = round(RATE * SECONDS)
    drive = draw.standard_normal(n)
    if sparse:
        drive *= draw.random(n) < 1.0 / (APART * RATE)
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


def estimated(case: str, seed: int) -> Spectra:
    """The spectra of one repeat of a case."""
    reference, response, coloured, bins = CASES[case]
    run = measured(reference, response, coloured, seed, sparse=case == "sparse impulses")
    return estimate([run], references=["drive"], resolution=2.0 * DAMPING * FREQUENCY / bins)


def fitted_mode(frf: Frf) -> Mode:
    """The mode of a repeat. Raises AnalysisError if the fit finds none."""
    reach = max(8.0 * DAMPING * FREQUENCY, 6.0 * frf.resolution)
    band, guess = (FREQUENCY - reach, FREQUENCY + reach), [(1.002 * FREQUENCY, 1.3 * DAMPING)]
    return fit_modes(frf, band, kind="accelerance", guesses=guess, residuals=1).modes[0]


def covered(case: str, repeats: int) -> dict[str, object]:
    """The covered shares of a case."""
    hits: dict[str, list[float]] = {"frequency": [], "damping": [], "curve": [], "bars": []}
    refused = without = 0
    for seed in range(repeats):
        spectra = estimated(case, seed)
        frf = spectra.frf("answer", "drive")
        near = np.abs(frf.frequency - FREQUENCY) < max(2.0 * DAMPING * FREQUENCY, 2.0 * frf.resolution)
        true, limits = np.abs(accelerance(frf.frequency)), magnitude_limits(frf, spectra.density("drive"))
        given = near & np.isfinite(limits.low)
        without += not np.isfinite(limits.low[near]).all()
        hits["curve"] += ((limits.low <= true) & (true <= limits.high))[given].astype(float).tolist()
        error = np.abs(np.abs(frf.value) - true)[near]
        hits["bars"].append(float(np.mean(error <= QUANTILE * frf.magnitude_std[near])))
        try:
            mode = fitted_mode(frf)
        except AnalysisError:
            refused += 1
            continue
        hits["frequency"].append(float(abs(mode.frequency - FREQUENCY) <= QUANTILE * mode.frequency_std))
        hits["damping"].append(float(abs(mode.damping - DAMPING) <= QUANTILE * mode.damping_std))
    shares = {name: f"{100.0 * np.mean(values):.1f}" if values else "" for name, values in hits.items()}
    return {"case": case, "repeats": repeats, "refused": refused, **shares, "without": f"{100.0 * without / repeats:.1f}"}


def write_page() -> None:
    """The table in docs/theory.md."""
    with TABLE.open(newline="") as file:
        rows = list(csv.DictReader(file))
    text = "\n".join("| " + " | ".join(row[column] for column in ("case", *SHOWN)) + " |" for row in rows)
    page = PAGE.read_text(encoding="utf-8")
    head = "| case | " + " | ".join(SHOWN.values()) + " |\n|" + "---|" * (1 + len(SHOWN)) + "\n"
    start = page.index(head) + len(head)
    PAGE.write_text(page[:start] + text + page[page.index("\n\n", start) :], encoding="utf-8")


def main() -> None:
    """Count and write the table; cases that are not counted keep their rows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=300)
    parser.add_argument("--case", action="append", choices=list(CASES), help="count only this case; repeatable")
    given = parser.parse_args()
    with TABLE.open(newline="") as file:
        rows: dict[str, dict[str, object]] = {row["case"]: dict(row) for row in csv.DictReader(file)}
    for case in given.case or CASES:
        rows[case] = covered(case, given.repeats)
        print(rows[case], flush=True)
        with TABLE.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(rows[case]), lineterminator="\n", extrasaction="ignore")
            writer.writeheader()
            writer.writerows(rows[name] for name in CASES if name in rows)
        write_page()


if __name__ == "__main__":
    main()
