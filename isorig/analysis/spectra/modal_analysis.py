"""Modal analysis: natural frequencies, damping ratios and mode shapes common to all sensors and references, and their number.

Poles come from the stabilization diagram of `poles`; those that persist over many orders are fitted to all transfer functions
together (`common_poles`), and each is kept only if it reduces the error by more than its parameters do by chance (Schwarz 1978).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from isorig.analysis import campaign
from isorig.analysis.campaign import SI_UNIT, ComplexArray, FloatArray
from isorig.analysis.errors import DataError, FitError
from isorig.analysis.given import all_of_type, given_guesses, interval, whole
from isorig.analysis.spectra.common_poles import ITERATIONS, Data, SolvedPoles, fit, model, solve
from isorig.analysis.spectra.modal_fit import NARROW
from isorig.analysis.spectra.poles import Pole, poles_by_order
from isorig.analysis.spectra.welch import FEWEST, Frf
from isorig.analysis.spectra.window_effect import WindowEffect, bin_deviation, pole_of
from isorig.analysis.views import Viewed

#: A pole that persists over this many orders, allowing gaps of `GAP`, is tried as a mode.
LONG, GAP = 5, 2
#: Maximum distance of poles of one mode at two orders: share of the larger half bandwidth, and of the frequency.
NEAR, NEAR_FREQUENCY = 0.5, 0.002
#: Number of candidates tried at once, the most persistent first.
CANDIDATES = 40
#: Steps of a fit before superfluous modes are dropped.
FIRST = 8
#: A mode must exceed the magnitude that it is added to by this share, in one transfer function at least.
VISIBLE = 0.05
#: Bins that one independent error is spread over by a Hann window (its noise bandwidth), and the required improvement of a mode
#: in multiples of the chance improvement by its parameters: leakage errors are larger at resonances than between them.
TIED, CLEAR = 1.5, 2.5
#: Modes closer than this many half bandwidths are reported as close.
CLOSE = 2.0
#: Order of motion of a unit: power of s relative to a displacement.
MOTION = {SI_UNIT[quantity]: order for quantity, order in campaign.MOTION.items()}


@dataclass(frozen=True, kw_only=True)
class ModeShape:
    """A mode with its shape."""

    #: Natural frequency and its standard deviation, Hz.
    frequency: float
    frequency_std: float
    #: Damping ratio and its standard deviation.
    damping: float
    damping_std: float
    shape: ComplexArray  #: Complex, shape (responses,): the largest component is near 1, rotated to be as real as possible.
    #: 1 if all components are in phase or antiphase, 0 if phases are evenly distributed (modal phase collinearity).
    collinearity: float


@dataclass(frozen=True, kw_only=True)
class ShapedMode(ModeShape):
    """A mode that all transfer functions share, with the frequency bins in its bandwidth 2 zeta f.

    The modal `constants`, shape (responses, references), are products of the mass-normalized shape at response and reference if
    the references are forces (1/kg).
    """

    constants: ComplexArray
    bins: float


@dataclass(frozen=True, kw_only=True)
class ModalModel(Viewed):
    """Result of modal analysis.

    Parameters
    ----------
    modes
        Ascending in frequency.
    responses, references
        Channel names, in the order of shapes and modal constants.
    frequency
        Frequency bins of the band, Hz, shape (bins,).
    measured, fitted
        Transfer functions and the model as seen by the estimate, shape (responses, references, bins).
    misfit
        rms of the weighted residuals; 1 if the error bars explain them. NaN if there are none.
    poles
        Of every order: the stabilization diagram. Empty if guesses were given.
    warnings
        Warnings.
    """

    modes: tuple[ShapedMode, ...]
    responses: tuple[str, ...]
    references: tuple[str, ...]
    frequency: FloatArray
    measured: ComplexArray = field(repr=False)
    fitted: ComplexArray = field(repr=False)
    misfit: float
    poles: tuple[Pole, ...] = field(repr=False)
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        modes = ", ".join(f"{mode.frequency:.4g} Hz ({100.0 * mode.damping:.2g} %)" for mode in self.modes)
        return f"ModalModel({modes})"

    def shapes(self) -> ComplexArray:
        """Mode shapes, shape (responses, modes)."""
        return np.stack([mode.shape for mode in self.modes], axis=1)


def modal_analysis(
    frfs: Sequence[Frf], band: tuple[float, float], *, guesses: Sequence[tuple[float, float]] = (), count: int | None = None,
    order: int | None = None,
) -> ModalModel:  # fmt: skip
    """The modes in a band that are common to a set of transfer functions.

    Parameters
    ----------
    frfs
        From every reference to every response, in the same bins: the complete set of one configuration.
    band
        The fitted band, Hz.
    guesses
        (frequency in Hz, damping ratio) of each mode; if none are given, their number and starting values are determined.
    count
        Number of modes to keep, the clearest; as many as the errors justify if None.
    order
        Largest order of the stabilization diagram; limited by the number of bins if None.

    Raises
    ------
    ArgumentError
        An argument is of another type.
    DataError
        The transfer functions are incompatible, or the band has too few bins.
    FitError
        There is no mode in the band, or a guess leads out of it.

    Examples
    --------
    >>> import isorig as iso
    >>> found = iso.frf(iso.read("campaign.h5"), reference="table", responses=["heatblock"], resolution=0.5)
    >>> locked = [item for item in found if item.configuration == "locked" and item.gain == 7.0]
    >>> mode = iso.modes(locked, (140.0, 190.0)).modes[0]
    >>> bool(abs(mode.frequency - 164.5) < 1.0)
    True
    """
    frfs = all_of_type(frfs, Frf, "the argument frfs", "a sequence of transfer functions; give those of iso.frf(campaign)")
    band, guesses = interval(band, "the band"), given_guesses(guesses)
    count = None if count is None else whole(count, "the number of modes", 1)
    order = None if order is None else whole(order, "the largest order", 1)
    grid = _Grid(frfs)
    kept = (grid.frequency >= band[0]) & (grid.frequency <= band[1]) & (grid.frequency > 0.0)
    if int(kept.sum()) < max(8, 4 * len(guesses) + 4):
        raise DataError(
            f"the band {band[0]:g} to {band[1]:g} Hz has {int(kept.sum())} frequency bins, too few for "
            f"{len(guesses) or 'any'} modes; widen it or use a finer resolution"
        )
    data = grid.data(kept)
    poles: tuple[Pole, ...] = ()
    if guesses:
        solved = fit(data, np.array(guesses, dtype=np.float64).reshape(-1, 2))
        for f, zeta in solved.pairs:
            if not band[0] <= f <= band[1] or zeta > 0.9:
                raise FitError(
                    f"the fit of {len(solved.pairs)} modes left the band {band[0]:g} to {band[1]:g} Hz for {f:.4g} Hz with a "
                    f"damping ratio of {zeta:.2g}; give other guesses, fewer modes or another band"
                )
    else:
        poles = poles_by_order(grid.matrix(data.values), data.frequency, grid.weights(data), order)
        solved = _selected(data, _candidates(poles), grid.known, count)
    return grid.model(data, solved, poles)


class _Grid:
    """Transfer functions in the order responses by references, and their errors."""

    def __init__(self, frfs: Sequence[Frf]) -> None:
        if not frfs:
            raise DataError("no transfer function was given; give at least one")
        first = frfs[0]
        self.responses = tuple(dict.fromkeys(frf.response for frf in frfs))
        self.references = tuple(dict.fromkeys(frf.reference for frf in frfs))
        by_pair = {(frf.response, frf.reference): frf for frf in frfs}
        missing = [(o, i) for o in self.responses for i in self.references if (o, i) not in by_pair]
        if missing or len(by_pair) != len(frfs):
            what = f"{missing[0][0]} over {missing[0][1]} is missing" if missing else "one of them is given twice"
            raise DataError(f"the transfer functions are not a full set, {what}; give each response over each reference once")
        self.frfs = [by_pair[o, i] for o in self.responses for i in self.references]
        if any(
            not np.array_equal(frf.frequency, first.frequency) or WindowEffect.of(frf) != WindowEffect.of(first) for frf in frfs
        ):
            raise DataError("the transfer functions have different frequency bins or windows; estimate them in the same way")
        self.frequency = first.frequency
        #: Whether error bars are known.
        self.known = first.averages >= FEWEST
        self._values = np.stack([frf.value for frf in self.frfs])
        self._deviations = np.stack([bin_deviation(frf) for frf in self.frfs])
        # Power of s relative to a receptance: 2 if the units are unknown.
        moved, driven = (MOTION.get(unit) for unit in first.units)
        self._power = 2 if moved is None or driven is not None else moved

    def data(self, kept: np.ndarray) -> Data:
        """The frequency bins of a band."""
        return Data(
            frequency=self.frequency[kept], values=self._values[:, kept], deviations=self._deviations[:, kept],
            seen=WindowEffect.of(self.frfs[0]), power=self._power,
        )  # fmt: skip

    def matrix(self, values: ComplexArray) -> ComplexArray:
        """Rows of functions as (responses, references, bins)."""
        return values.reshape(len(self.responses), len(self.references), -1)

    def weights(self, data: Data) -> FloatArray:
        """1 / standard deviation of each response in each bin, over all references, shape (responses, bins)."""
        variance = (data.deviations.reshape(len(self.responses), len(self.references), -1) ** 2).mean(axis=1)
        return np.asarray(1.0 / np.sqrt(variance))

    def model(self, data: Data, solved: SolvedPoles, poles: tuple[Pole, ...]) -> ModalModel:
        """The result with shapes and standard deviations."""
        free = data.numbers - solved.residues.size * 2 - solved.background.size * 2 - solved.pairs.size
        scale = solved.chi2 / max(free, 1)
        noise = max(scale, 1.0) if self.known else scale
        covariance = TIED * noise * np.linalg.pinv(solved.normal)
        relative = np.sqrt(np.maximum(np.diag(covariance), 0.0)).reshape(-1, 2)
        modes = [self._mode(data, solved, m, relative[m]) for m in np.argsort(solved.pairs[:, 0])]
        return ModalModel(
            modes=tuple(modes), responses=self.responses, references=self.references, frequency=data.frequency,
            measured=self.matrix(data.values), fitted=self.matrix(model(data, solved)),
            misfit=float(np.sqrt(scale)) if self.known else float("nan"), poles=poles, warnings=_warnings(modes),
        )  # fmt: skip

    def _mode(self, data: Data, solved: SolvedPoles, m: int, relative: FloatArray) -> ShapedMode:
        f, zeta = (float(x) for x in solved.pairs[m])
        pole = pole_of(f, zeta)
        # The residue of a normal mode's receptance is phi phi / (2 i omega_d m).
        constants = self.matrix(solved.residues[:, m, None])[:, :, 0] / pole**data.power * 2j * pole.imag
        shape = as_real(np.linalg.svd(constants, full_matrices=False)[0][:, 0])
        return ShapedMode(
            frequency=f, frequency_std=f * float(relative[0]), damping=zeta, damping_std=zeta * float(relative[1]), shape=shape,
            constants=constants, collinearity=collinearity(shape),
            bins=2.0 * zeta * f / self.frfs[0].resolution,
        )  # fmt: skip


def _candidates(poles: Sequence[Pole]) -> FloatArray:
    # Poles that persist over the orders: the median of the later half of each track, the longest tracks first.
    halves = [track[len(track) // 2 :] for track in persistent(poles)[:CANDIDATES]]
    return np.array([(np.median([p.frequency for p in half]), np.median([p.damping for p in half])) for half in halves]).reshape(
        -1, 2
    )


def persistent(poles: Sequence[Pole]) -> list[list[Pole]]:
    """Tracks of poles that persist over the orders, the longest first."""
    tracks: list[list[Pole]] = []
    for n in sorted({pole.order for pole in poles}):
        fresh = [pole for pole in poles if pole.order == n]
        open_tracks = [track for track in tracks if n - track[-1].order <= GAP + 1]
        distance = _pole_distances([track[-1] for track in open_tracks], fresh)
        used: set[int] = set()
        taken: set[int] = set()
        for i, j in sorted(np.argwhere(distance < 1.0).tolist(), key=lambda pair: float(distance[pair[0], pair[1]])):
            if i not in used and j not in taken:
                open_tracks[i].append(fresh[j])
                used.add(i)
                taken.add(j)
        tracks += [[pole] for j, pole in enumerate(fresh) if j not in taken]
    return sorted((track for track in tracks if len(track) >= LONG), key=len, reverse=True)


def _pole_distances(some: Sequence[Pole], others: Sequence[Pole]) -> FloatArray:
    # Distances in the plane of poles, relative to the allowed distance of one mode's poles, shape (some, others).
    a, b = (
        pole_of(np.array([pole.frequency for pole in poles]), np.array([pole.damping for pole in poles]))
        for poles in (some, others)
    )
    reach = np.maximum(NEAR * np.maximum(-a.real[:, None], -b.real), NEAR_FREQUENCY * np.abs(a)[:, None])
    return np.asarray(np.abs(a[:, None] - b) / reach)


def _selected(data: Data, pairs: FloatArray, known: bool, count: int | None) -> SolvedPoles:
    # Fit, drop the mode with the smallest effect on the error, fit again, until each remaining mode is justified.
    if not len(pairs):
        raise FitError("no pole persists over the orders of the stabilization diagram; widen the band or give guesses")
    pairs = pairs[: max(1, int(data.numbers / len(data.values) / 8))]
    solved = _pruned(data, solve(data, pairs), known, count)
    steps = FIRST
    while True:
        # Superfluous modes do not converge: they are dropped before the fit is complete.
        refined = _pruned(data, fit(data, solved.pairs, steps), known, count)
        if len(refined.pairs) == len(solved.pairs):
            if steps > FIRST:
                return refined
            steps = ITERATIONS
        solved = refined


def _pruned(data: Data, solved: SolvedPoles, known: bool, count: int | None) -> SolvedPoles:
    while True:
        modes, functions = len(solved.pairs), len(data.values)
        free = max(data.numbers - 2 * modes * (functions + 1) - 4 * functions, 1)
        scale = solved.chi2 / free
        noise = max(scale, 1.0) if known else scale
        # Chance improvement by a mode's parameters: ln(n) each (Schwarz 1978), errors correlated over TIED bins.
        worth = CLEAR * TIED * noise * (2 * functions + 2) * np.log(data.numbers / TIED)
        visible = _visible(data, solved)
        inside = (solved.pairs[:, 0] >= data.frequency[0]) & (solved.pairs[:, 0] <= data.frequency[-1])
        value = np.where(inside & (visible > VISIBLE), solved.gains / worth, 0.0)
        least = int(np.argmin(value))
        enough = modes <= count if count is not None else value[least] >= 1.0
        if enough:
            return solved
        if modes == 1:
            raise FitError(
                f"no mode exceeds the errors between {data.frequency[0]:g} and {data.frequency[-1]:g} Hz; "
                "use another band, or give guesses"
            )
        solved = solve(data, np.delete(solved.pairs, least, axis=0))


def _visible(data: Data, solved: SolvedPoles) -> FloatArray:
    # Largest ratio, over the functions, of a mode's own peak to the measured value there, shape (modes,).
    at = np.array([int(np.argmin(np.abs(data.frequency - f))) for f in solved.pairs[:, 0]])
    f, zeta = solved.pairs.T
    own = np.abs(solved.residues) * np.abs(data.seen.pole(f, pole_of(f, zeta)))
    measured = np.maximum(np.abs(data.values[:, at]), data.deviations[:, at])
    return np.asarray((own / measured).max(axis=0))


def as_real(shape: ComplexArray) -> ComplexArray:
    """A shape rotated to be as real as possible, its largest component positive with magnitude 1 (Gladwell 1991)."""
    turned = shape * np.exp(-0.5j * np.angle((shape**2).sum()))
    largest = turned[int(np.argmax(np.abs(turned)))]
    return np.asarray(turned * (1.0 if largest.real >= 0.0 else -1.0) / max(abs(largest), np.finfo(float).tiny))


def collinearity(shape: ComplexArray) -> float:
    """Modal phase collinearity of a shape, 0 to 1 (Juang and Pappa 1985)."""
    return float(np.abs((shape**2).sum()) ** 2 / max((np.abs(shape) ** 2).sum() ** 2, np.finfo(float).tiny))


def _warnings(modes: Sequence[ShapedMode]) -> tuple[str, ...]:
    said = [
        f"mode {k} at {mode.frequency:.4g} Hz has only {mode.bins:.1f} frequency bins in its bandwidth; use a finer resolution"
        for k, mode in enumerate(modes, 1)
        if mode.bins < NARROW
    ]
    for k, (one, other) in enumerate(pairwise(modes)):
        apart = (other.frequency - one.frequency) / max(one.damping * one.frequency, other.damping * other.frequency)
        if apart < CLOSE:
            said.append(
                f"modes {k + 1} and {k + 2} are {apart:.1f} half bandwidths apart; their shapes mix, so compare them with other "
                "references"
            )
    return tuple(said)
