"""Damping from a transfer function: bias and spread over repetitions, compared with pyEMA, a plain fit and half-power.

Run `python bench/damping.py [--repeats REPEATS]`; the standard uncertainty of a spread is 3 % with 500 repeats and 16 % with 20.
Every row has random seeds of its own. pyEMA comes with the extra `bench`. The cases are a heatblock (164.5 Hz, 0.009) and a motor
(5.06 Hz, 0.073) over 300 s of white drive with 2 % noise in the response, evaluated at several frequency resolutions.
"""

from __future__ import annotations

import contextlib
import io
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from table import Row, keep, options

from isorig.analysis.campaign import Channel, FloatArray, Run
from isorig.analysis.errors import AnalysisError
from isorig.analysis.spectra.half_power import half_power
from isorig.analysis.spectra.modal_fit import FrfKind, fit_modes
from isorig.analysis.spectra.welch import Frf, estimate

SECONDS, NOISE = 300.0, 0.02
CASES = ((164.5, 0.009, 1024.0), (5.06, 0.073, 64.0))
LINES = (1.5, 4.7, 9.5, 20.0)
LIMIT_BIAS, LIMIT_SPREAD = 0.01, (0.9, 1.1)
#: Repeats, with which the limits of the spread are three of its standard uncertainties away from 1, and those with `--quick`.
REPEATS, QUICK = 500, 20
#: Repeats whose estimates by other methods are averaged: enough for their bias.
OTHERS = 10


def measured(frequency: float, damping: float, rate: float, kind: FrfKind, lines: float, seed: tuple[int, int]) -> Frf:
    """The H1 estimate of one mode under white noise, with `lines` frequency bins per half-power bandwidth."""
    generator = np.random.default_rng(seed)
    n = round(SECONDS * rate)
    drive = generator.standard_normal(n)
    s, w = 2j * np.pi * np.fft.rfftfreq(n, 1.0 / rate), 2.0 * np.pi * frequency
    top = s**2 if kind == "accelerance" else 2.0 * damping * w * s + w**2
    answer = np.fft.irfft(np.fft.rfft(drive) * top / (s**2 + 2.0 * damping * w * s + w**2), n)
    answer += NOISE * answer.std() * generator.standard_normal(n)
    channels = {"drive": Channel(name="drive", samples=drive), "answer": Channel(name="answer", samples=answer)}
    run = Run(id="bench", configuration="unlocked", sample_rate=rate, gain=1.0, channels=channels)
    spectra = estimate([run], references=["drive"], resolution=2.0 * damping * frequency / lines)
    return spectra.frf("answer", "drive")


def ours(frf: Frf, frequency: float, damping: float, kind: FrfKind, *, tapered: bool = True) -> tuple[float, float]:
    """Damping ratio and its stated standard uncertainty by our fit."""
    reach = max(8.0 * damping * frequency, 6.0 * frf.resolution)
    band = max(frequency - reach, 2.0 * frf.resolution), frequency + reach
    guess = [(1.01 * frequency, 1.3 * damping)]
    fit = fit_modes(frf, band, kind=kind, guesses=guess, residuals=0 if kind == "transmissibility" else 1, tapered=tapered)
    return fit.modes[0].damping, fit.modes[0].damping_std


def lscf(frf: Frf, frequency: float) -> float:
    """pyEMA's LSCF of order 10: the pole nearest to the frequency."""
    import pyEMA

    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = pyEMA.Model(
            frf=frf.value[None, :], freq=frf.frequency, lower=0.5 * frequency, upper=1.5 * frequency, pol_order_high=10
        )
        model.get_poles(show_progress=False)
    poles = np.atleast_1d(model.all_poles[-1])
    natural = np.abs(poles) / (2.0 * np.pi)
    near = poles[(poles.real < 0.0) & (np.abs(natural / frequency - 1.0) < 0.2)]
    if not len(near):
        return float("nan")
    pole = near[np.argmin(np.abs(np.abs(near) / (2.0 * np.pi) - frequency))]
    return float(-pole.real / np.abs(pole))


def polymax(frf: Frf, frequency: float) -> float:
    """SDynPy's PolyMax of order 10: the pole nearest to the frequency; nan where it is not installed."""
    # It opens no window, but its import needs a place for some.
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            import sdynpy
        except ImportError:
            return float("nan")
        place = sdynpy.coordinate_array(1, "X+")
        kind = sdynpy.data.FunctionTypes.FREQUENCY_RESPONSE_FUNCTION
        function = sdynpy.data_array(kind, frf.frequency, frf.value[None, :].copy(), np.array([[place, place]]))
        fit = sdynpy.modal.PolyPy(function.reshape(1, 1), 0.5 * frequency, 1.5 * frequency)
        fit.compute_poles(np.arange(2, 11, 2))
    poles = fit.pole_list[0]
    near = poles[np.abs(poles["omega"] / (2.0 * np.pi * frequency) - 1.0) < 0.2]
    return float(near["zeta"][np.argmin(np.abs(near["omega"] / (2.0 * np.pi) - frequency))]) if len(near) else float("nan")


@dataclass(frozen=True, kw_only=True)
class Judged:
    """Bias of our fit, of the plain fit, of pyEMA and of half-power, as shares; and our scatter over the stated uncertainty."""

    bias: float
    others: FloatArray
    spread: float

    @property
    def good(self) -> bool:
        """Whether our bias and spread are within the limits."""
        return abs(self.bias) <= LIMIT_BIAS and LIMIT_SPREAD[0] <= self.spread <= LIMIT_SPREAD[1]


def judged(values: Sequence[Sequence[float]], damping: float) -> Judged:
    """The figures of a row from the estimates of its repeats."""
    table = np.array(values)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        others = np.nanmean(table[:, 2:], axis=0) / damping - 1.0
    spread = table[:, 0].std(ddof=1) / np.sqrt((table[:, 1] ** 2).mean())
    return Judged(bias=table[:, 0].mean() / damping - 1.0, others=others, spread=float(spread))


def estimated(frequency: float, damping: float, rate: float, kind: FrfKind, lines: float, seed: tuple[int, int]) -> list[float]:
    """Our damping ratio with its stated uncertainty, and in the first repeats that of the plain fit, pyEMA and half-power."""
    frf = measured(frequency, damping, rate, kind, lines, seed)
    plain = peer = half = float("nan")
    if seed[1] < OTHERS:
        plain = ours(frf, frequency, damping, kind, tapered=False)[0]
        with contextlib.suppress(AnalysisError):
            found = half_power(frf, (0.7 * frequency, 1.4 * frequency)).mode
            half = found.damping if found else half
        peer = lscf(frf, frequency)
    return [*ours(frf, frequency, damping, kind), plain, peer, half]


def main(repeats: int) -> list[Row]:
    """Print the table, and whether the limits are met."""
    kept: list[Row] = []
    print(f"{repeats} repeats of {SECONDS:g} s; bias in %; 'spread' is the scatter of our fit over its stated uncertainty")
    print(f"{'case':28s} {'B/df':>5s} {'ours':>7s} {'spread':>7s} {'plain':>7s} {'pyEMA':>7s} {'half-power':>11s}")
    held = True
    kinds: tuple[FrfKind, ...] = ("accelerance", "transmissibility")
    for number, ((frequency, damping, rate), kind, lines) in enumerate(product(CASES, kinds, LINES)):
        values = [estimated(frequency, damping, rate, kind, lines, (number, seed)) for seed in range(repeats)]
        row = judged(values, damping)
        held &= row.good
        shown = ["none" if np.isnan(value) else f"{100 * value:+.1f}" for value in row.others]
        print(
            f"{frequency:6.2f} Hz {kind:18s} {lines:5.1f} {100 * row.bias:+7.2f} {row.spread:7.2f} "
            f"{shown[0]:>7s} {shown[1]:>7s} {shown[2]:>11s}",
            flush=True,
        )
        what = f"{frequency:g} Hz, {kind}, {lines:g} frequency bins in the bandwidth"
        limit = f"bias, and spread {row.spread:.2f} of the stated over {repeats} repeats: {'met' if row.good else 'not met'}"
        for peer, other in zip(("plain fit", "pyEMA", "half-power"), row.others, strict=True):
            if not np.isnan(other):
                kept.append(Row(what=what, unit="%", ours=100.0 * row.bias, peer=peer, theirs=100.0 * other, limit=limit))
    print(
        f"limits (bias {100 * LIMIT_BIAS:g} %, spread {LIMIT_SPREAD[0]:g} to {LIMIT_SPREAD[1]:g}): {'met' if held else 'not met'}"
    )
    return kept


if __name__ == "__main__":
    parser = options(__doc__)
    parser.add_argument("--repeats", type=int, help=f"repeats of each row: {REPEATS}, or {QUICK} with --quick")
    given = parser.parse_args()
    keep(main(given.repeats or (QUICK if given.quick else REPEATS)), given.rows)
