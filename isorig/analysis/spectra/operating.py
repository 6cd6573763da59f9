"""Modes of a machine in operation, whose drive is not measured: from the responses alone.

Stochastic subspace identification from covariances (Peeters and De Roeck 1999), with uncertainties from blocks of the record
(Döhler and Mevel 2013), both by pyOMA2. Poles that persist over the orders are modes; a rotating part's harmonic persists too and
is distinguished by its constant amplitude.
"""

from collections.abc import Sequence
from contextlib import redirect_stderr
from dataclasses import dataclass, field
from io import StringIO
from typing import Any

import numpy as np

from isorig.analysis.campaign import ComplexArray, FloatArray
from isorig.analysis.errors import DataError, FitError
from isorig.analysis.spectra.modal_analysis import ModeShape, as_real, collinearity, persistent
from isorig.analysis.spectra.poles import HEAVY, Pole, status_of

#: Sample rate of the analysis in multiples of the band's upper end: the analyzers' convention.
RATE = 2.56
#: Lags of the covariances that the identification uses: half a period of the band's lower end, within these limits.
LAGS = (20, 60)
#: Largest model order, and the blocks of the record for the uncertainties. Chosen: with 40 blocks the scatter of 30 simulated
#: records is 0.66 to 1.2 of the stated uncertainty.
ORDER, BLOCKS = 40, 40
#: Periods of the band's lower end that a record needs: each block then has five.
PERIODS = 5 * BLOCKS
#: Standard uncertainty of a frequency in half bandwidths above which a pole is no mode. Chosen: of 50 simulated records' modes
#: none exceeded 0.48, and superfluous poles that persisted had 0.6 and more.
CERTAIN = 0.5
#: Modal assurance criterion of two shapes (Allemang 2003) above which poles within a half bandwidth are one mode. Usual bound.
SAME_SHAPE = 0.9
#: Relative variance of the squared envelope within a mode's bandwidth below which it is a harmonic: 1 for a mode that noise
#: excites (its envelope has a Rayleigh distribution), 0 for a constant sine. Chosen: the middle.
HARMONIC = 0.5
#: Least half width of the band of an envelope, relative to the frequency: a narrower one has too few independent values.
LEAST_WIDTH = 0.005


@dataclass(frozen=True, kw_only=True)
class OperatingMode(ModeShape):
    """A mode of a machine in operation.

    `variation` is the relative variance of the squared envelope around it: 1 for a mode that noise excites, 0 for a harmonic.
    """

    variation: float


@dataclass(frozen=True, kw_only=True)
class OperatingModes:
    """Result of an operating modal analysis: modes ascending in frequency, with shapes in the order of the responses.

    `frequency` are the bins of the band, Hz, shape (bins,); `power` is the density of each response, unit^2/Hz, shape (responses,
    bins); `poles` are those of every order: the stabilization diagram.
    """

    modes: tuple[OperatingMode, ...]
    responses: tuple[str, ...]
    frequency: FloatArray
    power: FloatArray = field(repr=False)
    poles: tuple[Pole, ...] = field(repr=False)
    warnings: tuple[str, ...] = ()


def operating_modes(
    records: FloatArray, rate: float, band: tuple[float, float], *, responses: Sequence[str], resolution: float = 0.25,
    count: int | None = None,
) -> OperatingModes:  # fmt: skip
    """The modes in a band from records of responses to an unmeasured broad-band excitation.

    The responses have one quantity, shape (responses, n), rate, band and resolution of their spectra are in Hz. Of the modes
    those `count` are kept that persist over the most orders, all if None. Raises DataError if there are fewer than two responses,
    the record is too short, or the band reaches beyond half the sample rate; FitError if pyOMA2 is not installed, or no pole
    persists.
    """
    from scipy.signal import detrend, resample_poly

    low, high = band
    _check(records, rate, band)
    step = max(int(rate / (RATE * high)), 1)
    values, reduced = np.asarray(resample_poly(detrend(records, axis=1), 1, step, axis=1)), rate / step
    result = _identified(values, reduced, min(LAGS[1], max(LAGS[0], int(np.ceil(reduced / (2.0 * low))))))
    places = _poles(result, band)
    std = {pole: float(result.Fn_poles_std[place]) for pole, place in places.items()}
    modes: list[OperatingMode] = []
    for track in persistent(list(places)):
        # Higher orders also fit noise, which scatters the poles and widens their uncertainty up to three times.
        early = [pole for pole in track[: -(-len(track) // 2)] if std[pole] <= CERTAIN * pole.damping * pole.frequency]
        if not early:
            continue
        # The middle of them, as the most typical one: the least uncertainty of all would be too small.
        pole = sorted(early, key=lambda each: each.frequency)[len(early) // 2]
        row, column = places[pole]
        shape = as_real(np.asarray(result.Phi_poles[row, column], dtype=np.complex128))
        if any(_alike(mode, pole, shape) for mode in modes):
            continue
        modes.append(
            OperatingMode(
                frequency=pole.frequency, frequency_std=std[pole], damping=pole.damping,
                damping_std=float(result.Xi_poles_std[row, column]), shape=shape, collinearity=collinearity(shape),
                variation=envelope_variation(np.conj(shape) @ values, reduced, pole.frequency, max(pole.damping, LEAST_WIDTH)),
            )
        )  # fmt: skip
    if not modes:
        raise FitError("no pole persists over the orders of the stabilization diagram; widen the band or measure for longer")
    modes = modes[:count]
    modes.sort(key=lambda mode: mode.frequency)
    frequency, power = _densities(records, rate, band, resolution)
    return OperatingModes(
        modes=tuple(modes), responses=tuple(responses), frequency=frequency, power=power, poles=tuple(places),
        warnings=_warnings(modes),
    )  # fmt: skip


def envelope_variation(values: FloatArray | ComplexArray, rate: float, frequency: float, damping: float) -> float:
    """Relative variance of the squared envelope of a signal, shape (n,), in a band of a mode's half bandwidths around a
    frequency.

    Rate and frequency are in Hz; `damping` is half the width of the band relative to the frequency.
    """
    n = len(values)
    bins = np.fft.fftfreq(n, 1.0 / rate)
    spectrum = np.fft.fft(values) * (np.abs(bins - frequency) <= damping * frequency)
    square = np.abs(np.fft.ifft(spectrum)) ** 2
    return float(np.var(square) / max(float(np.mean(square)) ** 2, np.finfo(float).tiny))


def _alike(mode: OperatingMode, pole: Pole, shape: ComplexArray) -> bool:
    # Whether a track is another one of the same mode.
    sizes = float(np.sum(np.abs(mode.shape) ** 2) * np.sum(np.abs(shape) ** 2))
    near = abs(pole.frequency - mode.frequency) < mode.damping * mode.frequency
    return near and float(np.abs(np.conj(mode.shape) @ shape) ** 2) > SAME_SHAPE * sizes


def _check(records: FloatArray, rate: float, band: tuple[float, float]) -> None:
    if len(records) < 2:
        raise DataError("operating modes need two responses of one quantity or more, and there is one; measure at another point")
    if band[0] <= 0.0 or band[1] > rate / 2.0:
        raise DataError(f"the band {band[0]:g} to {band[1]:g} Hz is not within 0 to {rate / 2.0:g} Hz; give another one")
    seconds = records.shape[1] / rate
    if seconds * band[0] < PERIODS:
        raise DataError(
            f"the record of {seconds:.4g} s has {seconds * band[0]:.0f} periods of {band[0]:g} Hz, and {PERIODS} are needed; "
            f"measure for {PERIODS / band[0]:.0f} s, or give a higher lower end of the band"
        )


def _identified(values: FloatArray, rate: float, lags: int) -> Any:
    try:
        from pyoma2.algorithms.ssi import SSI
        from pyoma2.setup.single import SingleSetup
    except ImportError:
        raise FitError(
            "operating modes need the package pyOMA-2, which is missing; install it with pip install 'isorig[operating]'"
        ) from None
    import logging

    logging.getLogger("pyoma2").setLevel(logging.ERROR)
    order = min(ORDER, lags * len(values) // 2)
    algorithm = SSI(name="modes", method="cov", br=lags, ordmax=order, calc_unc=True, nb=BLOCKS)
    setup = SingleSetup(values.T, fs=rate)
    setup.add_algorithms(algorithm)
    # Its progress bars and warnings of unphysical poles are not ours.
    with np.errstate(all="ignore"), redirect_stderr(StringIO()):
        setup.run_all()
    return algorithm.result


def _poles(result: Any, band: tuple[float, float]) -> dict[Pole, tuple[int, int]]:
    # The poles in the band by order, and the place of each in the result's tables (poles, orders).
    found: dict[Pole, tuple[int, int]] = {}
    before: list[tuple[float, float]] = []
    for column in range(result.Fn_poles.shape[1]):
        now: dict[tuple[float, float], tuple[int, int]] = {}
        for row in np.flatnonzero(np.isfinite(result.Fn_poles[:, column]) & np.isfinite(result.Xi_poles_std[:, column])):
            f, zeta = float(result.Fn_poles[row, column]), float(result.Xi_poles[row, column])
            if band[0] <= f <= band[1] and 0.0 < zeta < HEAVY:
                now[f, zeta] = int(row), column
        for (f, zeta), place in sorted(now.items()):
            found[Pole(order=column, frequency=f, damping=zeta, status=status_of(f, zeta, before))] = place
        # A real system gains a mode with every second order.
        before = sorted(now) or before
    return found


def _densities(records: FloatArray, rate: float, band: tuple[float, float], resolution: float) -> tuple[FloatArray, FloatArray]:
    from scipy.signal import welch

    frequency, power = welch(records, fs=rate, nperseg=min(round(rate / resolution), records.shape[1]))
    kept = (frequency >= band[0]) & (frequency <= band[1])
    return np.asarray(frequency[kept]), np.asarray(power[:, kept])


def _warnings(modes: Sequence[OperatingMode]) -> tuple[str, ...]:
    return tuple(
        f"{mode.frequency:.4g} Hz has a constant amplitude: it is a harmonic of a rotating part rather than a mode."
        for mode in modes
        if mode.variation < HARMONIC
    )
