"""The frequency offset of the heatblock's peaks, unlocked minus locked: measurement, and possible explanations.

The locked motor adds its mass to the table, which lowers the heatblock's resonance: with mass loading alone, the unlocked peak is
slightly higher. A motor held by friction adds its mass too, so its peak coincides with the locked one. A remaining difference, or
a change with the gain, indicates a nonlinearity.
"""

from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import Campaign, Run, broad
from isorig.analysis.errors import AnalysisError, DataError
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.simulate.natural import natural_modes
from isorig.analysis.spectra.modal_fit import Mode, fit_modes
from isorig.analysis.spectra.welch import Frf, estimate

#: Search range for the peak, relative to its expected frequency; required bins per bandwidth, and minimum segments in a record.
AROUND = (0.85, 1.2)
BINS, SEGMENTS = 8.0, 12.0
#: A difference of this many standard deviations is significant.
SIGNIFICANT = 3.0


@dataclass(frozen=True, kw_only=True)
class PeakPair:
    """The heatblock's peak unlocked and locked at one gain; `offset` is unlocked minus locked, Hz."""

    gain: float
    unlocked: Mode
    locked: Mode

    @property
    def offset(self) -> float:
        """Hz."""
        return self.unlocked.frequency - self.locked.frequency

    @property
    def std(self) -> float:
        """Standard deviation of the offset, Hz."""
        return float(np.hypot(self.unlocked.frequency_std, self.locked.frequency_std))


@dataclass(frozen=True, kw_only=True)
class PeakOffset:
    """Offsets of the peaks."""

    pairs: tuple[PeakPair, ...]  #: By gain, highest first.
    mass_loading: float  #: Offset predicted by the linear rig, with the motor free compared with its mass added to the table, Hz.
    #: Change of the offset with the gain, Hz per unit of gain; NaN with one gain.
    slope: float
    slope_std: float
    #: Difference between the largest and the smallest offset over the gains, and its standard deviation, Hz; NaN with one gain.
    change: tuple[float, float]
    verdict: str  #: Conclusion from the data, in a sentence.


def peak_offset(campaign: Campaign, model: RigModel) -> PeakOffset:
    """Fit the heatblock's peak unlocked and locked at every gain whose drive excites it.

    The values of the model are to be accurate enough to predict mass loading, e.g. fitted ones. Raises DataError if no gain
    excites the peak in both configurations.
    """
    guess, loading = loaded_frequencies(model, "heatblock")
    pairs, reason = [], ""
    for gain in sorted({run.gain for run in campaign.runs}, reverse=True):
        runs = {c: broad(campaign.select(configuration=c, gain=gain)) for c in ("unlocked", "locked")}
        bands = [[run.band or (0.0, np.inf) for run in same] for same in runs.values()]
        if not all(any(low < AROUND[0] * guess and high > AROUND[1] * guess for low, high in same) for same in bands):
            continue
        try:
            unlocked, locked = (_peak(same, guess) for same in runs.values())
        except AnalysisError as error:
            reason = f" ({error})"
            continue
        pairs.append(PeakPair(gain=gain, unlocked=unlocked, locked=locked))
    if not pairs:
        raise DataError(
            f"no gain shows the heatblock's peak near {guess:.4g} Hz both unlocked and locked{reason}; excite that band in both "
            "configurations"
        )
    slope, slope_std, change = _change(pairs)
    return PeakOffset(
        pairs=tuple(pairs), mass_loading=loading, slope=slope, slope_std=slope_std, change=change,
        verdict=_verdict(pairs, loading, change),
    )  # fmt: skip


def loaded_frequencies(model: RigModel, body: str) -> tuple[float, float]:
    """Frequency of a body's dominant mode with the motor's mass added to the table, and its increase with the motor free, Hz."""
    row = [b.name for b in model.bodies].index(body)
    locked, unlocked = (
        max(natural_modes(model, name), key=lambda mode: abs(mode.shape[row]) / np.linalg.norm(mode.shape)).frequency
        for name in ("locked", "unlocked")
    )
    return locked, unlocked - locked


def _peak(runs: list[Run], guess: float) -> Mode:
    def estimated(resolution: float) -> Frf:
        return estimate(runs, references=["head"], channels=["heatblock"], resolution=resolution).frf("heatblock", "head")

    finest = SEGMENTS / max(run.duration for run in runs)
    frf = estimated(max(finest, guess / 300.0))
    at, width = _top(frf, guess)
    frf = estimated(max(finest, width / BINS))
    reach = 3.0 * width + 4.0 * frf.resolution
    return fit_modes(frf, (at - reach, at + reach), kind="general", guesses=[(at, width / (2.0 * at))]).modes[0]


def _top(frf: Frf, guess: float) -> tuple[float, float]:
    near = frf.within((AROUND[0] * guess, AROUND[1] * guess))
    f, size = near.frequency, np.abs(near.value)
    top = int(np.argmax(size))
    if top in (0, len(f) - 1):
        raise DataError(f"the magnitude has no peak between {f[0]:.4g} and {f[-1]:.4g} Hz")
    return float(f[top]), float((size > size[top] / np.sqrt(2.0)).sum() * frf.resolution)


def _change(pairs: list[PeakPair]) -> tuple[float, float, tuple[float, float]]:
    if len(pairs) < 2:
        return float("nan"), float("nan"), (float("nan"), float("nan"))
    gain, offset, std = (np.array(v) for v in zip(*((p.gain, p.offset, p.std) for p in pairs), strict=True))
    fit, covariance = np.polyfit(gain, offset, 1, w=1.0 / std, cov="unscaled")
    high, low = max(pairs, key=lambda p: p.offset), min(pairs, key=lambda p: p.offset)
    return float(fit[0]), float(covariance[0, 0] ** 0.5), (high.offset - low.offset, float(np.hypot(high.std, low.std)))


def _verdict(pairs: list[PeakPair], loading: float, change: tuple[float, float]) -> str:
    best = min(pairs, key=lambda p: p.std)
    text = f"at gain {best.gain:g} the unlocked peak is at {best.offset:+.3f} ± {best.std:.3f} Hz relative to the locked one"
    loads = [abs(p.offset - loading) <= SIGNIFICANT * p.std for p in pairs]
    moves = len(pairs) > 1 and change[0] > SIGNIFICANT * change[1]
    if all(loads) and not moves:
        said = f"which agrees with mass loading alone ({loading:+.3f} Hz); no nonlinearity is needed"
    elif any(loads) and moves:
        said = (
            f"mass loading predicts {loading:+.3f} Hz, and the offset changes by {change[0]:.3f} ± {change[1]:.3f} Hz with the "
            "gain: the data support both, mass loading at one gain and a nonlinearity that removes it at another"
        )
    elif abs(best.offset) <= SIGNIFICANT * best.std:
        said = (
            f"so there is no mass loading, which would shift it by {loading:+.3f} Hz: the unlocked motor moves with the table "
            "like the locked one, held by friction, which is a nonlinearity and not an effect of mass"
        )
    else:
        away = abs(best.offset - loading) / best.std
        said = (
            f"{away:.0f} standard deviations from the prediction of mass loading alone ({loading:+.3f} Hz): the data support a "
            "nonlinearity (friction that holds the motor part of the time) in addition to mass loading"
        )
    more = "" if len(pairs) > 1 else "; only one gain excites the peak, so its change with the gain is unknown"
    return f"The heatblock's peak: {text}, {said}{more}."
