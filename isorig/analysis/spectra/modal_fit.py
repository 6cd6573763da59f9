"""Natural frequencies and damping ratios from transfer functions, by a fit that includes the window.

For a broad-band drive an averaged H1 is the Fourier transform of the impulse response times the window's autocorrelation. A
mode's impulse response is exponential and windows are sums of cosines, so that transform has a closed form, and the fit includes
the same window as the estimate: the frequency resolution does not bias its damping.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from isorig.analysis.campaign import ComplexArray, FloatArray
from isorig.analysis.errors import DataError, FitError
from isorig.analysis.given import flag, given_guesses, interval, of_type, one_of, whole
from isorig.analysis.jackknife import deviation
from isorig.analysis.spectra.hits import BEFORE
from isorig.analysis.spectra.leakage import error_moments, record_moments, through
from isorig.analysis.spectra.welch import FEWEST, Frf
from isorig.analysis.spectra.window_effect import WindowEffect, bin_deviation, bin_variance, pole_of

#: Relative step of the numerical derivatives of a mode.
STEP = 1e-6
#: Smallest damping ratio of a fitted mode, and the share of a limit of the fit within which a mode is at that limit.
LEAST, EDGE = 1e-7, 1e-3
#: Bins in a bandwidth below which a mode is reported as narrow.
NARROW = 1.5
#: Factor by which the scatter between groups must exceed the computed standard deviation to replace it. Chosen: 28 groups
#: determine it to 13 %, ten to 22 %; sparse impulses give 6.
CONTRADICTED = 1.6

FrfKind = Literal["accelerance", "transmissibility", "general"]


@dataclass(frozen=True, kw_only=True)
class Mode:
    """A natural frequency (Hz) and a damping ratio with standard deviations, and the bandwidth 2 zeta f in frequency bins."""

    frequency: float
    frequency_std: float
    damping: float
    damping_std: float
    bins: float


@dataclass(frozen=True, kw_only=True)
class ModalFit:
    """Modes fitted to a transfer function.

    Parameters
    ----------
    modes
        Ascending in frequency.
    kind
        Form of each mode.
    frequency, fitted
        Hz and the complex model as seen through the window, shape (bins,): for plots with the estimate.
    misfit
        rms of the weighted residuals; 1 if the error bars explain them.
    warning
        A warning, may be empty.
    leakage
        The modes as seen through the window minus the same without a window, at any frequencies in Hz: the bias of the estimate.
    """

    modes: tuple[Mode, ...]
    kind: FrfKind
    frequency: FloatArray
    fitted: ComplexArray
    misfit: float
    warning: str = ""
    leakage: Callable[[FloatArray], ComplexArray] | None = field(default=None, repr=False, compare=False)

    def __repr__(self) -> str:
        modes = ", ".join(f"{mode.frequency:.4g} Hz ({100.0 * mode.damping:.2g} %)" for mode in self.modes)
        return f"ModalFit({modes}; {self.kind}, misfit {self.misfit:.2g})"


def fit_modes(
    frf: Frf, band: tuple[float, float], *, kind: FrfKind = "accelerance", guesses: Sequence[tuple[float, float]] = (),
    residuals: int = 2, tapered: bool = True,
) -> ModalFit:  # fmt: skip
    """Fit modes to the frequency bins of a band, including the window of the estimate.

    Parameters
    ----------
    frf
        Estimated by `isorig.analysis.spectra.welch.estimate`, H1.
    band
        The fitted band, Hz.
    kind
        accelerance: each mode is A s^2 / (s^2 + 2 zeta w s + w^2); transmissibility: A (2 zeta w s + w^2) divided by the same. A
        is real and fitted. general: any complex residue, for modes coupled by damping, and complex residuals.
    guesses
        (frequency in Hz, damping ratio) of each mode; by default the highest peak in the band.
    residuals
        Terms for modes outside the band: 0 none, 1 a constant, 2 a constant and one proportional to frequency squared.
    tapered
        Whether the window is included. Without it this is the ordinary fit, for comparison.

    Raises
    ------
    ArgumentError
        An argument is of another type.
    DataError
        The band has too few frequency bins.
    FitError
        The fit finds no mode within the band.

    Notes
    -----
    Weights are the error bars. Standard deviations come from the covariance of the bins' errors, which the window correlates, and
    increase with a misfit above 1; or from the scatter between groups of segments, if that is `CONTRADICTED` times larger: a
    drive with few impulses scatters more than that covariance.

    Examples
    --------
    >>> import isorig as iso
    >>> runs = iso.read("campaign.h5").select(gain=7.0)
    >>> frf = iso.estimate(runs, references=["table"], resolution=0.5).frf("heatblock", "table")
    >>> mode = iso.fit_modes(frf, (150.0, 180.0), kind="transmissibility").modes[0]
    >>> abs(mode.frequency - 164.5) < 4.0 * mode.frequency_std
    True
    """
    of_type(frf, Frf, "the transfer function", "one of iso.frf; give one, for example iso.frf(campaign)[0]")
    band = interval(band, "the band")
    guesses = given_guesses(guesses)
    one_of(kind, get_args(FrfKind), "the kind")
    residuals, tapered = whole(residuals, "the number of residuals", 0), flag(tapered, "the argument tapered")
    found = solved_modes(frf, band, kind=kind, guesses=guesses, residuals=residuals, tapered=tapered)
    # A single average does not determine its errors: the residuals must.
    least = 1.0 if frf.averages >= FEWEST else 0.0
    std = _deviations(frf, found, max(found.misfit, least)).reshape(-1, 2)
    order = np.argsort(found.pairs[:, 0])
    modes = tuple(
        Mode(
            frequency=float(f), frequency_std=float(f_std), damping=float(zeta), damping_std=float(zeta_std),
            bins=float(2.0 * zeta * f / frf.resolution),
        )
        for (f, zeta), (f_std, zeta_std) in zip(found.pairs[order], std[order], strict=True)
    )  # fmt: skip
    narrow = min(mode.bins for mode in modes)
    return ModalFit(
        modes=modes, kind=kind, frequency=found.frequency, fitted=found.fitted, misfit=found.misfit,
        warning=f"only {narrow:.1f} frequency bins in the narrowest bandwidth; use a finer resolution" if narrow < NARROW else "",
        leakage=found.leakage,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class SolvedModes:
    """Modes fitted to a transfer function, without their uncertainties."""

    pairs: FloatArray  #: Frequencies (Hz) and damping ratios, shape (modes, 2), in any order.
    amplitudes: FloatArray  #: Of the columns of the model, shape (columns,).
    misfit: float  #: rms of the weighted residuals.
    deviation: FloatArray  #: Standard deviation of the real and of the imaginary part in each fitted bin, shape (bins,).
    shape: _Shape = field(repr=False)  #: The model's columns.

    @property
    def frequency(self) -> FloatArray:
        """Of the fitted bins, Hz, shape (bins,)."""
        return self.shape.frequency

    @property
    def fitted(self) -> ComplexArray:
        """The model as seen through the window in the fitted bins, shape (bins,)."""
        return np.asarray(self.shape.columns(self.pairs.ravel()) @ self.amplitudes)

    def leakage(self, f: FloatArray) -> ComplexArray:
        """The model as seen through the window minus the same without a window, at frequencies in Hz."""
        pairs = self.pairs.ravel()
        return np.asarray((self.shape.at(f, tapered=True).columns(pairs) - self.shape.at(f).columns(pairs)) @ self.amplitudes)


def solved_modes(
    frf: Frf, band: tuple[float, float], *, kind: FrfKind, guesses: Sequence[tuple[float, float]], residuals: int = 2,
    tapered: bool = True, settled: float = 1e-12,
) -> SolvedModes:  # fmt: skip
    """The modes of `fit_modes`, whose arguments these are, without their uncertainties, which take half of its time.

    The fit ends with a step that reduces the sum of squares by less than the share `settled`. Raises DataError if the band has
    too few frequency bins, FitError if the fit finds no mode within the band.
    """
    from scipy.optimize import least_squares

    kept = (frf.frequency >= band[0]) & (frf.frequency <= band[1]) & (frf.frequency > 0.0)
    f, value = frf.frequency[kept], frf.value[kept]
    guesses = guesses or _guess(f, np.abs(value), frf.resolution)
    if 2 * len(f) <= 4 * len(guesses) + 2 * residuals or len(f) < 5:
        raise DataError(
            f"the band {band[0]:g} to {band[1]:g} Hz has {len(f)} frequency bins, too few for {len(guesses)} modes; "
            "widen it or use a finer resolution"
        )
    sigma = np.asarray(bin_deviation(frf)[kept], dtype=np.float64)
    shape = _Shape(f, kind, residuals, WindowEffect.of(frf) if tapered else WindowEffect(decay=frf.decay))
    # Without bounds a mode that steps out of the band often stays there, although there is a minimum within. A mode within one
    # bin of it counts as inside.
    low, high = max(band[0] - frf.resolution, 0.5 * frf.resolution), band[1] + frf.resolution
    bounds = np.log(np.tile([(low, LEAST), (high, 1.0)], len(guesses)))
    start = np.clip(np.log([number for guess in guesses for number in guess]), *bounds)
    side = _parts(value / sigma)

    def error(theta: FloatArray) -> FloatArray:
        columns = _parts(shape.columns(np.exp(theta)) / sigma[:, None])
        return np.asarray(columns @ np.linalg.lstsq(columns, side, rcond=None)[0] - side)

    def slope(theta: FloatArray) -> FloatArray:
        # The amplitudes follow the modes (Golub and Pereyra 1973, eq. 4.14).
        pairs = np.exp(theta)
        columns = _parts(shape.columns(pairs) / sigma[:, None])
        inverse = np.linalg.pinv(columns)
        amplitudes = inverse @ side
        moved = shape.slopes(pairs) * pairs[:, None] / sigma[:, None, None]
        ahead = _parts(moved @ amplitudes)
        follow = np.tensordot(_parts(moved), columns @ amplitudes - side, axes=(0, 0))
        return np.asarray(ahead - columns @ (inverse @ ahead) - (follow @ inverse).T)

    solved = least_squares(error, start, jac=slope, bounds=tuple(bounds), method="trf", x_scale="jac", xtol=1e-12, ftol=settled)
    pairs = np.asarray(np.exp(solved.x), dtype=np.float64).reshape(-1, 2)
    at = np.abs(solved.x - bounds) < EDGE
    if at[:, ::2].any() or at[1, 1::2].any():
        raise FitError(
            f"the fit of {len(guesses)} modes left the band {band[0]:g} to {band[1]:g} Hz; give guesses or another band"
        )
    weighted = _parts(shape.columns(pairs.ravel()) / sigma[:, None])
    amplitudes = np.asarray(np.linalg.lstsq(weighted, side, rcond=None)[0], dtype=np.float64)
    misfit = float(np.sqrt(np.mean((weighted @ amplitudes - side) ** 2)))
    return SolvedModes(pairs=pairs, amplitudes=amplitudes, misfit=misfit, deviation=sigma, shape=shape)


def _guess(f: FloatArray, size: FloatArray, resolution: float) -> list[tuple[float, float]]:
    top = int(np.argmax(size)) if len(size) else 0
    wide = int((size > 0.7 * size[top]).sum()) if len(size) else 1
    return [(float(f[top]), min(0.3, max(wide - 1.0, 1.0) * resolution / (2.0 * float(f[top]))))] if len(f) else [(1.0, 0.1)]


def _parts(values: ComplexArray) -> FloatArray:
    return np.concatenate([values.real, values.imag])


class _Shape:
    """The model's columns: one per mode and one per residual term, each as seen through the window."""

    def __init__(self, f: FloatArray, kind: FrfKind, residuals: int, seen: WindowEffect, top: float | None = None) -> None:
        self.frequency = f
        self._kind, self._seen, self._residuals = kind, seen, residuals
        self._top = float(f.max()) if top is None else top
        rest: list[ComplexArray] = [np.ones(f.shape, dtype=np.complex128), np.asarray((f / self._top) ** 2 + 0j)][:residuals]
        # Distant damped modes leave a background of any phase.
        self._rest = [turn * term for term in rest for turn in (1.0, 1j)] if kind == "general" else rest

    def at(self, f: FloatArray, *, tapered: bool = False) -> _Shape:
        """The same model at other frequencies, without the window unless `tapered`."""
        seen = self._seen if tapered else WindowEffect(decay=self._seen.decay)
        return _Shape(f, self._kind, self._residuals, seen, self._top)

    def columns(self, pairs: FloatArray) -> ComplexArray:
        """Shape (..., modes + residuals), for frequencies (Hz) and damping ratios in turn."""
        modes = self._modes(pairs.reshape(-1, 2)).reshape(-1, *self.frequency.shape)
        return np.stack([*modes, *self._rest], axis=-1)

    def slopes(self, pairs: FloatArray) -> ComplexArray:
        """Derivatives of the columns with respect to `pairs`, shape (bins, pairs, columns)."""
        own = pairs.reshape(-1, 1, 2)
        ahead, behind = (self._modes(own * (1.0 + step * np.eye(2))) for step in (STEP, -STEP))
        each = (ahead - behind) / (2.0 * STEP * pairs.reshape(-1, 2, 1, 1))
        modes, _, many, bins = each.shape
        found = np.zeros((bins, modes, 2, modes * many + len(self._rest)), dtype=np.complex128)
        for m, one in enumerate(each):
            found[:, m, :, m * many : (m + 1) * many] = np.moveaxis(one, -1, 0)
        return found.reshape(bins, 2 * modes, -1)

    def _modes(self, pairs: FloatArray) -> ComplexArray:
        # Columns of modes, (..., columns, bins), for pairs (..., 2). (2 zeta w s + w^2) / (s^2 + 2 zeta w s + w^2) in partial
        # fractions; s^2 divided by the same is 1 minus it.
        frequency, zeta = pairs[..., :1], pairs[..., 1:]
        omega, pole = 2.0 * np.pi * frequency, pole_of(frequency, zeta)
        seen, mirrored = (self._seen.pole(self.frequency.ravel(), each) for each in (pole, np.conj(pole)))
        if self._kind == "general":
            return np.stack([omega * (seen + mirrored), 1j * omega * (seen - mirrored)], axis=-2)
        residue = (2.0 * zeta * omega * pole + omega**2) / (pole - np.conj(pole))
        ratio = (residue * seen + np.conj(residue) * mirrored)[..., None, :]
        return np.asarray(ratio if self._kind == "transmissibility" else 1.0 - ratio)


def _deviations(frf: Frf, found: SolvedModes, misfit: float) -> FloatArray:
    # Weighted least squares with correlated errors: (J'J)^-1 J'CJ (J'J)^-1, J the weighted derivatives with respect to
    # frequencies, damping ratios and amplitudes.
    shape, pairs, amplitudes, sigma = found.shape, found.pairs.ravel(), found.amplitudes, found.deviation
    columns = shape.columns(pairs)
    rows: ComplexArray = np.concatenate([shape.slopes(pairs) @ amplitudes, columns], axis=1)
    stacked = _parts(rows / sigma[:, None])
    bread = np.asarray(np.linalg.pinv(stacked.T @ stacked), dtype=np.float64)[: len(pairs)]
    changes = None if frf.group_changes is None else frf.group_changes(shape.frequency)
    if frf.window is None:
        whole = parts = record_moments(2.0 * sigma**2, frf.decay / frf.resolution, BEFORE)
    else:
        variance = 2.0 * bin_variance(frf)[np.isin(frf.frequency, shape.frequency)]
        whole, parts = error_moments(
            lambda f: np.asarray(shape.at(f).columns(pairs) @ amplitudes), np.asarray(columns @ amplitudes), shape.frequency,
            frf.resolution, variance, frf.averages, frf.window, frf.overlap, 1 if changes is None else len(changes),
        )  # fmt: skip

    def deviations(moments: tuple[ComplexArray, ComplexArray]) -> FloatArray:
        covariance = bread @ through(rows / sigma[:, None] ** 2, moments) @ bread.T
        return np.asarray(misfit * np.sqrt(np.maximum(np.diag(covariance), 0.0)))

    std = deviations(whole)
    if changes is None:
        return std
    # To first order: a group moves the values by bread Re(rows^H change / sigma^2).
    moves = np.real(changes / sigma**2 @ np.conj(rows)) @ bread.T
    scatter = np.array([deviation(moves, unit) for unit in np.eye(len(pairs))])
    return np.where(scatter > CONTRADICTED * (grouped := deviations(parts)), scatter * std / grouped, std)
