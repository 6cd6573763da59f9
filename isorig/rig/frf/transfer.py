"""The transfer functions of a campaign: one for each response, configuration and gain, with the band of the drive."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from isorig.analysis.campaign import Campaign, FloatArray, Measured, Run, broad, given_campaign
from isorig.analysis.errors import DataError
from isorig.analysis.given import all_of_type, channel_names, flag, of_type, one_of
from isorig.analysis.spectra.estimators import Estimator
from isorig.analysis.spectra.gain_levels import by_drive, by_level, level_of
from isorig.analysis.spectra.hammer_test import HammerTest, hammer_test
from isorig.analysis.spectra.hits import looks_hit
from isorig.analysis.spectra.magnitude_limits import SLIGHT, MagnitudeLimits, magnitude_limits
from isorig.analysis.spectra.periodic import PeriodicFrf, periodic
from isorig.analysis.spectra.quality import Fault, faults, sound
from isorig.analysis.spectra.welch import OVERLAP, Frf, Spectra, estimate
from isorig.analysis.spectra.windows import WindowName, window_named
from isorig.analysis.wording import state
from isorig.rig.files.rigfile import references_of


@dataclass(frozen=True, kw_only=True)
class Transfer(Frf):
    """A transfer function, with configuration, gain and the runs of its average; `band` is the drive's, Hz.

    `reference_density` is the power spectral density of the reference, unit^2 / Hz; `left_out` are runs with faulty records;
    `periods` is the same period by period, for a periodic drive; `hammer` is the hammer test, if it is one. `imported` are
    those that another program estimated: their averages and runs are unknown. `level` is the rms of the drive with its unit, if
    runs of the same stated gain were driven differently; empty otherwise. `alone` are those of a recording with one
    configuration, whose name says nothing.
    """

    configuration: str
    gain: float
    runs: tuple[str, ...]
    band: tuple[float, float]
    reference_density: FloatArray
    left_out: tuple[str, ...] = ()
    periods: PeriodicFrf | None = None
    hammer: HammerTest | None = None
    imported: bool = False
    level: str = ""
    alone: bool = False

    @classmethod
    def of(cls, frf: Frf, **more: Any) -> Transfer:
        """A transfer function with what else is known about it."""
        return cls(**{item.name: getattr(frf, item.name) for item in fields(Frf)}, **more)

    def __repr__(self) -> str:
        return f"Transfer({self.in_words}, {self.label})"

    @property
    def frf(self) -> Frf:
        """The same: a `Transfer` is an `Frf`."""
        return self

    @property
    def name(self) -> str:
        """As part of a file name."""
        if self.imported:
            return f"{self.response}-over-{self.reference}"
        level = f"-{self.level.replace(' ', '').replace('/', '-per-')}" if self.level else ""
        set_up = f"gain{self.gain:g}" if self.alone else f"{self.configuration}-gain{self.gain:g}"
        return f"{self.response}-over-{self.reference}-{set_up}{level}"

    @property
    def label(self) -> str:
        """As a legend entry."""
        if self.imported:
            return self.configuration
        size = f"{self.level} rms" if self.level else f"gain {self.gain:g}"
        return size if self.alone else f"{self.configuration}, {size}"

    @cached_property
    def limits(self) -> MagnitudeLimits:
        """The 95 % limits of its magnitude."""
        return magnitude_limits(self, self.reference_density)

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Which frequency bins are within the band of the drive, shape (bins,)."""
        return np.asarray((self.frequency >= self.band[0]) & (self.frequency <= self.band[1]))

    @property
    def top(self) -> int:
        """Index of the frequency bin within the band that has the largest magnitude."""
        inside = np.flatnonzero(self.inside)
        return int(inside[np.argmax(np.abs(self.value[inside]))])

    @property
    def median_coherence(self) -> float:
        """Over the frequency bins within the band of the drive."""
        return float(np.median(self.coherence[self.inside]))

    def within_band(self) -> Frf:
        """The frequency bins within the band of the drive."""
        return self.within(self.band)


def transfer_functions(
    campaign: Measured,
    *,
    reference: str | Sequence[str] | None = None,
    responses: Sequence[str] = (),
    resolution: float = 0.25,
    estimator: Estimator = "H1",
    window: WindowName = "hann",
    overlap: float = OVERLAP,
    found: Sequence[Fault] | None = None,
    jackknife: bool = True,
) -> list[Transfer]:
    """Transfer functions by response, configuration and gain (highest first), averaged over the broad-band runs.

    A run whose gain changed counts as one run for each gain. Runs whose reference consists of hammer pulses are evaluated hit by
    hit (`isorig.analysis.spectra.hammer_test`) if their excitation is "other" or "random".

    Parameters
    ----------
    campaign
        Measured or simulated, or the path of a recording.
    reference
        The drive channel, or all channels that drive at the same time; those of the rig's description if None.
    responses, resolution, estimator, window, overlap, jackknife
        As in `isorig.analysis.spectra.welch`; by default all other channels are responses. Hammer hits need no window and no
        overlap.
    found
        Faults of the campaign's records; computed if None. Faulty runs are left out if others remain.

    Raises
    ------
    ArgumentError
        An argument is of another type.
    DataError
        No run has a broad-band drive, a channel or every response is missing, several drives cannot be separated, or no hammer
        hit is valid.

    Examples
    --------
    >>> import isorig as iso
    >>> found = iso.frf(iso.read("campaign.h5"), reference="table", responses=["heatblock"], resolution=0.5)
    >>> [item.label for item in found]
    ['unlocked, gain 70', 'unlocked, gain 7', 'locked, gain 70', 'locked, gain 7']
    >>> peak = abs(found[3].frf.value).argmax()
    >>> bool(abs(found[3].frf.frequency[peak] - 164.5) <= 1.0)
    True
    """
    campaign = by_level(given_campaign(campaign))
    reference = references_of(campaign) if reference is None else reference
    drives = (reference,) if isinstance(reference, str) else tuple(dict.fromkeys(channel_names(reference, "the reference")))
    responses = channel_names(responses, "the argument responses")
    one_of(estimator, get_args(Estimator), "the estimator")
    of_type(window, str, "the window", 'the name of a window; give one, for example "hann"')
    jackknife = flag(jackknife, "the jackknife")
    if not drives:
        raise DataError(f"no reference was given; give the drive channel, {references_of(campaign)[0]!r}, or leave it out")
    if found is not None:
        found = all_of_type(found, Fault, "the argument found", "a sequence of faults; give those of iso.faults")
    runs = broad(campaign.runs)
    if not runs:
        raise DataError(f"{campaign.source} has no run with a broad-band drive; measure one with noise, a multisine or a sweep")
    wrong = faults_in(campaign, drives[0]) if found is None else found
    seen_through = window_named(window)
    transfers = []
    for averaged, names, struck, about in _averages(campaign, runs, drives, responses, wrong):
        if struck:
            test = hammer_test(averaged, reference=drives[0], channels=names, resolution=resolution)
            spectra, about["hammer"], about["band"] = test.spectra, test, test.band
        else:
            spectra = estimate(
                averaged, references=drives, channels=names, resolution=resolution, window=seen_through, overlap=overlap,
                jackknife=jackknife,
            )  # fmt: skip
            about["band"] = _band(averaged, spectra, drives[0])
        transfers += [
            Transfer.of(
                frf, reference_density=spectra.density(frf.reference),
                periods=None if struck else _by_period(averaged, name, drives), **about,
            )
            for name in names
            for frf in spectra.frfs(name, drives, estimator)
        ]  # fmt: skip
    if not transfers:
        raise DataError(f"{campaign.source} has only the channel of the drive, {', '.join(drives)}; record at least one response")
    return sorted(transfers, key=lambda item: item.response)


def _averages(
    campaign: Campaign, runs: Sequence[Run], drives: Sequence[str], responses: Sequence[str], wrong: Sequence[Fault]
) -> Iterator[tuple[list[Run], list[str], bool, dict[str, Any]]]:
    # Runs that are averaged together, the responses that are valid in them, whether hits drive them, and what is known of them.
    hit = {run.id for run in runs if len(drives) == 1 and looks_hit(run, drives[0])}
    order = list(dict.fromkeys(run.configuration for run in campaign.runs))
    for configuration, gain in sorted({(run.configuration, run.gain) for run in runs}, key=lambda k: (order.index(k[0]), -k[1])):
        same = broad(campaign.select(configuration=configuration, gain=gain))
        names = responses or [name for name in same[0].sensors if name not in drives]
        struck = [run for run in same if run.id in hit]
        if struck and len(struck) < len(same):
            rest = next(run.id for run in same if run.id not in hit)
            raise DataError(
                f"run {struck[0].id!r} is a hammer test and run {rest!r} is not, but both are "
                f"{state(configuration, gain, campaign.alone)}; put them into separate recordings, or give them different gains"
            )
        levels = [same] if struck or len(drives) > 1 else by_drive(same, drives[0])
        for driven in levels:
            alike: dict[tuple[str, ...], list[str]] = {}
            for name in names:
                alike.setdefault(tuple(run.id for run in sound(driven, wrong, [*drives, name])), []).append(name)
            for kept, group in alike.items():
                yield [run for run in driven if run.id in kept], group, bool(struck), {
                    "configuration": configuration, "gain": gain, "runs": kept, "alone": campaign.alone,
                    "level": _level(driven, drives[0]) if len(levels) > 1 else "",
                    "left_out": tuple(run.id for run in driven if run.id not in kept),
                }  # fmt: skip


def _band(runs: Sequence[Run], spectra: Spectra, reference: str) -> tuple[float, float]:
    # Where no run gives its band, it is where the drive has power.
    bands = [run.band for run in runs if run.band is not None]
    low, high = spectra.extent(reference)
    band = (max(b[0] for b in bands), min(b[1] for b in bands)) if bands else (low, min(high, runs[0].sample_rate / 2.56))
    return max(band[0], spectra.resolution), band[1]


def _level(runs: Sequence[Run], drive: str) -> str:
    return f"{np.median([level_of(run, drive) for run in runs]):.3g} {runs[0].channel(drive).unit}"


def levels_in_words(campaign: Campaign, drive: str) -> list[str]:
    """A sentence for each configuration and gain whose runs were driven at different levels."""
    said = []
    runs = [run for run in broad(campaign.runs) if drive in run.channels]
    for configuration, gain in dict.fromkeys((run.configuration, run.gain) for run in runs):
        groups = by_drive([run for run in runs if (run.configuration, run.gain) == (configuration, gain)], drive)
        if len(groups) > 1:
            levels = ", ".join(_level(group, drive) for group in groups)
            said.append(
                f"The runs {state(configuration, gain, campaign.alone)} differ in level: the rms of {drive} is {levels}; they "
                "are not averaged with one another, so state the levels as gains when importing."
            )
    return said


def faults_in(campaign: Campaign, reference: str, find: Callable[..., Sequence[Fault]] = faults) -> tuple[Fault, ...]:
    """Faults of a campaign's records, with the drive of its rig if it was measured, otherwise with the reference.

    For a hammer test only dead channels are reported: its hits are checked one by one, and its records are mostly silent.
    """
    drive, *others = references_of(campaign)
    driven = any(drive in run.channels for run in campaign.runs)
    hit = {run.id for run in campaign.runs if looks_hit(run, reference)}
    # Further drives are silent in a released run, too.
    silent = {(run.id, name) for run in campaign.runs if run.excitation == "free" for name in others}
    found = find(campaign, reference=drive if driven else reference)
    return tuple(
        fault for fault in found if (fault.run not in hit if fault.kind != "dead" else (fault.run, fault.channel) not in silent)
    )


def limits_in_words(found: Sequence[Transfer]) -> tuple[str, ...]:
    """What the 95 % limits of the transfer functions include, and where there are none: one sentence for each reason."""
    said = []
    corrected = [(_too_low(item), item) for item in found if any(item.band[0] <= f <= item.band[1] for f in item.limits.narrow)]
    if corrected:
        share, item = max(corrected, key=lambda pair: pair[0])
        f = min(item.limits.narrow, key=lambda f: abs(f - float(item.frequency[item.top])))
        said.append(
            f"Leakage lowers and widens peaks with few frequency bins ({_where(item, f)}: {100 * share:.2g} % too low"
            f"{_more(corrected)}); the limits and the printed peaks are corrected for it, the magnitudes of curves and files are "
            f"not: use a finer --resolution than {item.resolution:.3g} Hz."
        )
    unknown = [(f, item) for item in found for f in item.limits.unknown if item.band[0] <= f <= item.band[1]]
    if unknown:
        f, item = unknown[0]
        said.append(
            f"There are no limits near peaks with few frequency bins that no mode fits ({_where(item, f)}"
            f"{_more(unknown)}): their leakage is unknown; use a finer --resolution than {item.resolution:.3g} Hz."
        )
    noisy = []
    for item in found:
        share = float(item.limits.reference_noise[item.top])
        if share * abs(item.value[item.top]) > SLIGHT * item.magnitude_std[item.top]:
            noisy.append((share, item))
    if noisy:
        share, item = max(noisy, key=lambda pair: pair[0])
        said.append(
            f"Noise on the reference may make H1 up to {100 * share:.2g} % too low "
            f"({_where(item, item.frequency[item.top])}{_more(noisy)}): the coherence does not show which channel has the noise; "
            "the upper limits include it, and H2 is unbiased by it."
        )
    reasons = dict.fromkeys(item.limits.reason for item in found if item.limits.reason)
    return (*said, *(f"No 95 % limits of the magnitude: {reason}." for reason in reasons))


def _too_low(item: Transfer) -> float:
    # The largest share, over the bins in the band, by which leakage lowers the magnitude.
    inside = item.inside & np.isfinite(item.limits.leakage)
    leakage, size = item.limits.leakage[inside], np.abs(item.value[inside])
    return float(np.max(-leakage / np.maximum(size - leakage, 1e-300), initial=0.0))


def _where(item: Transfer, frequency: float) -> str:
    return f"{item.response} over {item.reference}, {item.label} at {frequency:.4g} Hz"


def _more(cases: Sequence[object]) -> str:
    return f", and {len(cases) - 1} more" if len(cases) > 1 else ""


def unnamed_excitation(found: Sequence[Transfer], campaign: Campaign) -> tuple[str, ...]:
    """Sentences for runs that do not name their excitation and were averaged as noise, and for hammer tests named noise."""
    averaged = {run for item in found if item.hammer is None for run in item.runs}
    unnamed = [run.id for run in campaign.runs if run.id in averaged and run.excitation == "other"]
    struck = {run for item in found if item.hammer is not None for run in item.runs}
    misnamed = [run.id for run in campaign.runs if run.id in struck and run.excitation == "random"]
    said = []
    if misnamed:
        said.append(
            f"The excitation of run {misnamed[0]!r}{_more(misnamed)} is recorded as 'random', but the reference consists of "
            "hammer pulses: evaluated hit by hit. Correct the excitation to 'other'."
        )
    if unnamed:
        runs = f"Run {unnamed[0]!r} does" if len(unnamed) == 1 else f"{len(unnamed)} runs do"
        said.append(
            f"{runs} not name the excitation (it is 'other') and the reference has no hammer hits: averaged as noise, by "
            "segments. Name the excitation in the recording, or the force channel of the hammer with --reference."
        )
    return tuple(said)


def _by_period(runs: Sequence[Run], response: str, drives: Sequence[str]) -> PeriodicFrf | None:
    # None where there are too few periods: then there is the average over segments alone.
    if len(drives) == 1 and all(run.period is not None for run in runs):
        with suppress(DataError):
            return periodic(runs, response=response, reference=drives[0])
    return None


def about(item: Transfer) -> dict[str, Any]:
    """A transfer function as plain values."""
    seen = item.within_band()
    further: dict[str, Any] = {} if item.periods is None else {"periods": _about_periods(item.periods)}
    if seen.multiple_coherence is not None:
        further["median_multiple_coherence"] = float(np.median(seen.multiple_coherence))
    if item.hammer is not None:
        hits = [
            {"run": hit.run, "seconds": float(hit.seconds), "peak": hit.peak, "rejected": hit.rejected or None, "text": hit.text}
            for hit in item.hammer.hits
        ]
        decay = item.hammer.spectra.decay
        further["hammer"] = {"hits": hits, "exponential_window_per_s": decay, "text": list(item.hammer.text)}
    return {
        "name": item.name, "response": seen.response, "reference": seen.reference, "configuration": item.configuration,
        "gain": item.gain, "level": item.level, "runs": list(item.runs), "left_out": list(item.left_out),
        "estimator": seen.estimator, "averages": None if item.imported else seen.averages,
        "resolution_hz": seen.resolution, "band_hz": list(item.band),
        "peak": {
            "frequency_hz": float(item.frequency[item.top]), "magnitude": float(np.abs(item.value[item.top])),
            "magnitude_std": float(item.magnitude_std[item.top]), **_about_limits(item.limits, item.top),
        },
        "median_coherence": item.median_coherence,
        "units": list(seen.units), "window": None if seen.window is None else seen.window.name, "overlap": seen.overlap,
        **further,
    }  # fmt: skip


def _about_limits(limits: MagnitudeLimits, k: int) -> dict[str, Any]:
    # Of one frequency bin; null where there is none.
    low, high, leakage, noise = (
        float(rows[k]) if np.isfinite(rows[k]) else None
        for rows in (limits.low, limits.high, limits.leakage, limits.reference_noise)
    )
    return {"magnitude_limits": None if low is None else [low, high], "leakage": leakage, "largest_reference_noise": noise}


def _about_periods(found: PeriodicFrf) -> dict[str, Any]:
    size = np.abs(found.value)
    noise, distortion = float(np.median(found.noise / size)), float(np.median(found.distortion / size))
    text = (
        f"its distortion {100 * distortion:.2g} %"
        if np.isfinite(distortion)
        else "its distortion cannot be determined from one realization of the drive; repeat with other phases"
    )
    return {
        "periods": found.periods, "realizations": found.realizations, "lines": len(found.frequency), "relative_noise": noise,
        "relative_distortion": distortion if np.isfinite(distortion) else None,
        "text": f"Over {found.periods} periods of {found.realizations} runs the noise of {found.response} over "
        f"{found.reference} is {100 * noise:.2g} % (median over frequency bins), {text}.",
    }  # fmt: skip
