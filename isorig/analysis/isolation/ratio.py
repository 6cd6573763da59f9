"""The isolation ratio: |heatblock / head| unlocked divided by locked, stitched from several gains.

Thesis, Eq. 6: |heatblock / head| unlocked divided by |heatblock / head| locked. The highest gain covers low frequencies, where
its drive has power and friction is overcome; at higher frequencies only a low gain can be used.
"""

from dataclasses import dataclass
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from isorig.analysis.campaign import Campaign, FloatArray, Measured, Run, broad, given_campaign
from isorig.analysis.errors import DataError
from isorig.analysis.given import all_of_type, interval, number, of_type, positive, text
from isorig.analysis.model.rig_model import RigModel, Sensor
from isorig.analysis.model.spring import uncoupled_frequency
from isorig.analysis.simulate import simulate
from isorig.analysis.simulate.free_run import excitation_of
from isorig.analysis.spectra.welch import Frf, estimate, frfs_in_common_bins
from isorig.analysis.views import Viewed

#: The thesis's stitching frequency, Hz.
STITCH = 15.0
#: Frequency bins within this share of the stitching frequency around it determine the step.
AROUND = 0.25
#: Relative velocities below this share of the body's own rms velocity count as sticking.
AT_REST = 1e-3
#: The motor is stuck at a gain at which it sticks for more than this share of the time.
MOSTLY_STUCK = 0.5

#: The isolation is effective above this multiple of its natural frequency: there the transmissibility is below 1.
ABOVE = float(np.sqrt(2.0))
#: A Hann window correlates neighbouring frequency bins, which increases the variance of a sum over bins by this factor.
TIED = 2.0


class Isolated(NamedTuple):
    """The isolation of the heatblock's vibration in a band (Hz) at a gain, as a share, and its standard uncertainty.

    1 - sqrt(sum of |unlocked|^2 / sum of |locked|^2) over the frequency bins: refers to the rms acceleration of the heatblock
    with a drive that is flat over the band.
    """

    share: float
    std: float
    band: tuple[float, float]
    gain: float

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of a normal variable."""
        return self.share - 1.96 * self.std, self.share + 1.96 * self.std


class Peaks(NamedTuple):
    """The heatblock's peaks: their frequencies (Hz), the ratio of the two peak values, and the ratio at one frequency.

    `std` is that of `ratio`; `by_line` is the ratio at the frequency of the unlocked peak.
    """

    unlocked: float
    locked: float
    ratio: float
    std: float
    by_line: float


@dataclass(frozen=True, kw_only=True)
class Piece:
    """The ratio at one gain."""

    gain: float
    band: tuple[float, float]  #: Band of the drive, Hz.
    #: The two transfer functions.
    unlocked: Frf
    locked: Frf
    #: Ratio |unlocked| / |locked| and its standard deviation, shape (bins,).
    ratio: FloatArray
    std: FloatArray


@dataclass(frozen=True, kw_only=True)
class IsolationRatio(Viewed):
    """The stitched ratio.

    Parameters
    ----------
    frequency, ratio, std
        Hz, 1, 1, shape (bins,): only within the band of some gain.
    gain
        Gain of each frequency bin, shape (bins,).
    pieces
        The ratio at each gain, highest first.
    stitches
        Frequencies at which the gain changes, Hz.
    steps
        Ratio of the higher gain divided by that of the lower gain around each stitch, and its standard deviation.
    peaks
        Around the heatblock's peak, at the lowest gain; NaN if its drive does not excite it.
    """

    frequency: FloatArray
    ratio: FloatArray
    std: FloatArray
    gain: FloatArray
    pieces: tuple[Piece, ...]
    stitches: tuple[float, ...]
    steps: tuple[tuple[float, float], ...]
    peaks: Peaks

    def __repr__(self) -> str:
        f = self.frequency
        band = f"{f[0]:.4g} to {f[-1]:.4g} Hz" if len(f) else "no frequencies"
        return f"IsolationRatio({band}, {len(self.pieces)} gains, stitched at {', '.join(f'{at:g} Hz' for at in self.stitches)})"


def isolation_ratio(
    campaign: Measured, *, response: str = "heatblock", reference: str = "head",
    configurations: tuple[str, str] = ("unlocked", "locked"), resolution: float = 0.25, stitch: float = STITCH,
    around_peak: tuple[float, float] = (120.0, 220.0),
) -> IsolationRatio:  # fmt: skip
    """The isolation ratio of a campaign, measured or simulated.

    Parameters
    ----------
    campaign
        Measurement or path of its recording; must contain broad-band runs in both configurations at one gain at least.
    response, reference
        Channels.
    configurations
        Numerator and denominator.
    resolution
        Frequency resolution, Hz.
    stitch
        Upper limit of the highest gain, Hz; further stitches are at the upper band limits of the gains.
    around_peak
        Search range for the heatblock's peak, Hz.

    Raises
    ------
    ArgumentError
        An argument is of another type.
    DataError
        No gain was measured in both configurations.

    Examples
    --------
    >>> import isorig as iso
    >>> found = iso.isolation_ratio(iso.read("campaign.h5"))
    >>> found.stitches
    (15.0,)
    """
    campaign = given_campaign(campaign)
    resolution, stitch = positive(resolution, "the resolution"), positive(stitch, "the stitching frequency")
    around_peak = interval(around_peak, "the range around the peak")
    for name in (response, reference):
        text(name, "the name of a channel", "table")
    two = 'two configurations, numerator and denominator; give for example ("unlocked", "locked")'
    given = all_of_type(configurations, str, "the argument configurations", two)
    if len(given) != 2:
        raise DataError(f"the argument configurations has {len(given)} names, but must be {two}")
    configurations = given[0], given[1]
    pieces = _pieces(campaign, response, reference, configurations, resolution)
    frequency = pieces[0].unlocked.frequency
    source = np.full(len(frequency), -1)
    stitches: list[float] = []
    low = min(piece.band[0] for piece in pieces)
    for k, piece in enumerate(pieces):
        last = k == len(pieces) - 1
        high = piece.band[1] if last else min(stitch, piece.band[1])
        source[(frequency >= low) & (frequency <= high) & (source < 0)] = k
        if not last:
            stitches.append(high)
        low = max(low, high)
    kept = np.flatnonzero(source >= 0)
    piece_of = source[kept]
    return IsolationRatio(
        frequency=frequency[kept], ratio=np.stack([p.ratio for p in pieces])[piece_of, kept],
        std=np.stack([p.std for p in pieces])[piece_of, kept], gain=np.array([p.gain for p in pieces])[piece_of],
        pieces=pieces, stitches=tuple(stitches),
        steps=tuple(_step(a, b, at) for a, b, at in zip(pieces, pieces[1:], stitches, strict=False)),
        peaks=_peaks(pieces[-1], around_peak),
    )  # fmt: skip


def isolated_share(found: IsolationRatio, above: float) -> Isolated:
    """The isolation as one number: at the highest gain, where friction is overcome, from `above` (Hz) to the end of its band.

    Raises
    ------
    ArgumentError
        An argument is of another type.
    DataError
        The band of that gain ends below.

    Examples
    --------
    >>> import isorig as iso
    >>> found = iso.isolation_ratio(iso.read("campaign.h5"))
    >>> isolated = iso.isolated_share(found, above=7.2)
    >>> isolated.gain, 0.0 < isolated.share < 1.0
    (70.0, True)
    """
    of_type(found, IsolationRatio, "the isolation ratio", "a result of iso.isolation_ratio; give one")
    above = number(above, "the argument above")
    piece = found.pieces[0]
    f = piece.unlocked.frequency
    kept = (f >= max(above, piece.band[0])) & (f <= piece.band[1])
    if kept.sum() < 2:
        raise DataError(
            f"gain {piece.gain:g} covers frequencies up to {piece.band[1]:g} Hz, below the {above:.3g} Hz above which the "
            "isolation is effective; extend its band"
        )
    unlocked, locked = ((np.abs(frf.value[kept]), frf.magnitude_std[kept]) for frf in (piece.unlocked, piece.locked))
    passed, std = rms_ratio(*unlocked, *locked)
    return Isolated(share=1.0 - passed, std=std, band=(float(f[kept][0]), float(f[kept][-1])), gain=piece.gain)


def isolation_frequency(model: RigModel) -> float:
    """Natural frequency of the link that can be locked, sqrt(k / m) / 2 pi, Hz; 0 if nothing can be locked."""
    locked = model.configurations.get("locked")
    return 0.0 if locked is None or not locked.rigid else uncoupled_frequency(model, locked.rigid[0])


def magnitude_ratio(upper: Frf, lower: Frf) -> tuple[FloatArray, FloatArray]:
    """|upper| / |lower| in each frequency bin and its standard deviation, both shape (bins,)."""
    tiny = np.finfo(float).tiny
    size_u, size_l = np.abs(upper.value), np.maximum(np.abs(lower.value), tiny)
    ratio = size_u / size_l
    return ratio, ratio * np.hypot(upper.magnitude_std / np.maximum(size_u, tiny), lower.magnitude_std / size_l)


def rms_ratio(upper: FloatArray, upper_std: FloatArray, lower: FloatArray, lower_std: FloatArray) -> tuple[float, float]:
    """rms of a magnitude over frequency bins divided by that of another, and its standard deviation by first-order propagation.

    All have the shape (bins,).
    """
    ratio = float(np.sqrt((upper**2).sum() / (lower**2).sum()))
    parts = [np.sqrt(TIED * ((x * s) ** 2).sum()) / (x**2).sum() for x, s in ((upper, upper_std), (lower, lower_std))]
    return ratio, ratio * float(np.hypot(*parts))


def _pieces(
    campaign: Campaign, response: str, reference: str, configurations: tuple[str, str], resolution: float
) -> tuple[Piece, ...]:
    gains = []
    for gain in sorted({run.gain for run in campaign.runs}, reverse=True):
        both = [broad(campaign.select(configuration=c, gain=gain)) for c in configurations]
        if all(both):
            gains.append((gain, both))
    found = [
        estimate(runs, references=[reference], channels=[response], resolution=resolution, jackknife=False).frf(
            response, reference
        )
        for _, both in gains
        for runs in both
    ]
    # Runs may have different sample rates, and therefore different frequency bins.
    lined_up = frfs_in_common_bins(found) if found else []
    pieces = []
    for (gain, both), u, k in zip(gains, lined_up[::2], lined_up[1::2], strict=True):
        ratio, std = magnitude_ratio(u, k)
        bands = [run.band for runs in both for run in runs if run.band is not None]
        band = (max(b[0] for b in bands), min(b[1] for b in bands)) if bands else (resolution, both[0][0].sample_rate / 2.56)
        pieces.append(Piece(gain=gain, band=band, unlocked=u, locked=k, ratio=ratio, std=std))
    if not pieces:
        text = ", ".join(sorted({f"{run.configuration} at gain {run.gain:g}" for run in broad(campaign.runs)})) or "none"
        raise DataError(
            f"{campaign.source or 'the campaign'} has no gain measured both {' and '.join(configurations)} with a broad-band "
            f"drive (it has {text}); measure the missing one"
        )
    return tuple(pieces)


def _step(high: Piece, low: Piece, at: float) -> tuple[float, float]:
    f = high.unlocked.frequency
    near = (np.abs(f - at) <= AROUND * at) & (f <= high.band[1]) & (f >= low.band[0])
    if near.sum() < 2:
        return float("nan"), float("nan")
    relative = np.hypot(high.std[near] / high.ratio[near], low.std[near] / low.ratio[near])
    weight = 1.0 / np.maximum(relative, 1e-9) ** 2
    step = float(np.exp(np.average(np.log(high.ratio[near] / low.ratio[near]), weights=weight)))
    return step, step / float(np.sqrt(weight.sum()))


def _peaks(piece: Piece, around: tuple[float, float]) -> Peaks:
    f = piece.unlocked.frequency
    near = np.flatnonzero((f >= around[0]) & (f <= min(around[1], piece.band[1])))
    if len(near) < 3:
        return Peaks(*[float("nan")] * 5)
    unlocked, locked = piece.unlocked, piece.locked
    u, k = (int(near[np.argmax(np.abs(frf.value[near]))]) for frf in (unlocked, locked))
    size_u, size_k = float(np.abs(unlocked.value[u])), float(np.abs(locked.value[k]))
    relative = float(np.hypot(unlocked.magnitude_std[u] / size_u, locked.magnitude_std[k] / size_k))
    ratio = size_u / size_k
    return Peaks(unlocked=float(f[u]), locked=float(f[k]), ratio=ratio, std=ratio * relative, by_line=float(piece.ratio[u]))


def stuck_share(model: RigModel, run: Run) -> float:
    """Share of a run's time in which the simulated bodies at the ends of the isolation stick."""
    joint = model.link("isolation")
    sliding = Sensor(channel="sliding", body=joint.a, relative_to=joint.b, quantity="velocity")
    moving = Sensor(channel="moving", body=joint.a, quantity="velocity")
    watched = msgspec.structs.replace(model, sensors=(sliding, moving), free=())
    excitation = excitation_of(model, run)
    seen = simulate(watched, excitation, configuration=run.configuration).channels
    return float(np.mean(np.abs(seen["sliding"]) <= AT_REST * float(seen["moving"].std())))


def friction_bound(ratio: IsolationRatio, shares: dict[float, float]) -> NDArray[np.bool_]:
    """Frequency bins from a gain at which the motor is stuck for more than half of the time, shape (bins,)."""
    return np.asarray(np.isin(ratio.gain, [gain for gain, share in shares.items() if share > MOSTLY_STUCK]))
