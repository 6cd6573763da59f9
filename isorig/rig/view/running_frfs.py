"""Transfer functions of a running session, by configuration and gain, and their ratio between two configurations."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import BROAD, FloatArray, Run
from isorig.analysis.errors import DataError
from isorig.analysis.isolation.ratio import magnitude_ratio
from isorig.analysis.spectra.welch import Frf, RunningSpectra, Spectra, averages_in, merged, segment_length
from isorig.rig.report.charts import spread_over, unjoined
from isorig.rig.view.messages import Planned

#: Frequency resolution, Hz: fine enough for the rig's modes, and the first average is complete after two seconds.
RESOLUTION = 0.5
#: Maximum number of frequency bins drawn for a transfer function.
BINS = 600
#: Bytes of the spectra of a run: without a band, a run of 8 channels at 51.2 kHz would take 180 MiB.
MEMORY = 32 << 20


class GrowingSpectra:
    """The spectra of a growing run; there are no averages if its drive is not broad-band."""

    def __init__(self, run: Run, drive: str) -> None:
        self.configuration, self.gain = run.configuration, round(run.gain, 6)
        #: None if the run does not give it: it is then where the drive has power.
        self.band = run.band
        self._rate = run.sample_rate
        self._running: RunningSpectra | None = None
        self._done: Spectra | None = None
        if run.excitation in BROAD and drive in run.channels and run.sample_rate >= 8.0 * RESOLUTION:
            self._running = RunningSpectra(
                run, references=[drive], resolution=RESOLUTION, highest=run.band[1] if run.band else run.sample_rate / 2.56,
                memory=MEMORY,
            )  # fmt: skip

    def add(self, run: Run) -> None:
        """Add the new samples since the last call."""
        if self._running is not None:
            self._running.add(run)

    @property
    def segments(self) -> int:
        """Number of segments so far."""
        spectra = self._done
        return self._running.segments if self._running is not None else 0 if spectra is None else spectra.segments

    def close(self) -> None:
        """Release the sums; nothing more will be added."""
        self._done, self._running = self.spectra(), None

    def spectra(self) -> Spectra | None:
        """The spectra so far; None before the first segment."""
        if self._running is None or not self._running.segments:
            return self._done
        return self._running.spectra()

    def averages_in(self, seconds: float) -> float:
        """Number of independent averages in the given seconds at this run's rate."""
        return averages_in(round(seconds * self._rate), segment_length(self._rate, RESOLUTION))


@dataclass(frozen=True, kw_only=True)
class AveragedRuns:
    """The runs of one configuration and gain: averaged spectra within a band, and number of averages at the session's end."""

    configuration: str
    gain: float
    drive: str
    band: tuple[float, float]
    spectra: Spectra
    planned: float | None

    def frfs(self) -> dict[str, Frf]:
        """The transfer function of each response relative to the drive."""
        return {name: self.spectra.frf(name, self.drive) for name in self.spectra.channels if name != self.drive}

    def bins(self) -> np.ndarray:
        """Indices of the frequency bins within the band."""
        f = self.spectra.frequency
        return np.flatnonzero((f >= max(self.band[0], f[1])) & (f <= self.band[1]))

    def error(self) -> float:
        """Relative standard deviation of the magnitude, median over the band's bins and all responses; NaN if there are none."""
        kept = self.bins()
        shares = [(frf.magnitude_std / np.maximum(np.abs(frf.value), 1e-300))[kept] for frf in self.frfs().values()]
        return float(np.median(np.concatenate(shares))) if shares and len(kept) else float("nan")

    def text(self, alone: bool) -> str:
        """Progress of the averaging, in words; `alone` states that the rig has one configuration, which needs no name."""
        error, n = self.error(), self.spectra.averages
        set_up = f"gain {self.gain:g}" if alone else f"{self.configuration}, gain {self.gain:g}"
        phrase = f"{set_up}: averages {n:.0f}"
        if not np.isfinite(error):
            return f"{phrase}, error not available: no response has a frequency bin within the band"
        if self.planned is None or self.planned <= n:
            return f"{phrase}, error {100 * error:.2g} %"
        at_end = error * np.sqrt(n / self.planned)
        return f"{phrase} of {self.planned:.0f}, error {100 * error:.2g} % now, {100 * at_end:.2g} % at the end"


def groups_of(
    responses: Mapping[str, GrowingSpectra], planned: Mapping[str, Planned], drive: str
) -> dict[tuple[str, float], AveragedRuns]:
    """Runs of a configuration and gain, averaged; the keys are (configuration, gain)."""
    found = {}
    for key in dict.fromkeys((item.configuration, item.gain) for item in responses.values()):
        names = [name for name, item in responses.items() if (item.configuration, item.gain) == key]
        parts = [part for name in names if (part := responses[name].spectra()) is not None]
        if not parts:
            continue
        bands = [band for name in names if (band := responses[name].band) is not None]
        coming = [item for item in planned.values() if (item.configuration, item.gain) == key and item.broad]
        with_plan = set(names) <= planned.keys()
        try:
            spectra = merged(parts)
        except DataError:  # runs with different rates or bands: use the last one
            spectra = parts[-1]
        found[key] = AveragedRuns(
            configuration=key[0], gain=key[1], drive=drive, spectra=spectra,
            band=(max(b[0] for b in bands), min(b[1] for b in bands)) if bands else spectra.extent(drive),
            planned=sum(responses[names[0]].averages_in(item.seconds) for item in coming) if with_plan else None,
        )  # fmt: skip
    return found


def transfer_rows(group: AveragedRuns) -> tuple[list[str], FloatArray]:
    """Names of the responses, and rows to plot: Hz, then for each response magnitude, std, phase, std (deg), coherence."""
    frfs, kept = group.frfs(), group.bins()
    kept = kept[_even(group.spectra.frequency[kept])]
    rows = [group.spectra.frequency[kept]]
    for frf in frfs.values():
        seen = frf.bins(kept)
        phase = unjoined(np.degrees(np.angle(seen.value)))
        rows += [np.abs(seen.value), seen.magnitude_std, phase, np.degrees(seen.phase_std), seen.coherence]
    return list(frfs), np.stack(rows)


def ratio_rows(
    groups: Mapping[tuple[str, float], AveragedRuns], response: str, drive: str, over: tuple[str, str]
) -> tuple[list[str], FloatArray] | None:
    """The ratio |response / drive| of two configurations (thesis, Eq. 6).

    Names of the gains measured in both configurations, and rows to plot: Hz, then each ratio and its std; None without one."""
    curves: dict[float, tuple[FloatArray, list[FloatArray]]] = {}
    for gain in sorted({gain for _, gain in groups}, reverse=True):
        upper, lower = (groups.get((configuration, gain)) for configuration in over)
        if upper is None or lower is None or not {response, drive} <= set(upper.spectra.channels) & set(lower.spectra.channels):
            continue
        n = min(len(upper.spectra.frequency), len(lower.spectra.frequency))
        frequency = upper.spectra.frequency[:n]
        if np.array_equal(frequency, lower.spectra.frequency[:n]):
            found = magnitude_ratio(*(group.spectra.frf(response, drive).bins(slice(n)) for group in (upper, lower)))
            inside = np.isin(np.arange(n), np.intersect1d(upper.bins(), lower.bins()))
            curves[gain] = frequency, [np.where(inside, values, np.nan) for values in found]
    if not curves:
        return None
    longest = max((frequency for frequency, _ in curves.values()), key=len)
    if not all(np.array_equal(longest[: len(frequency)], frequency) for frequency, _ in curves.values()):
        return None
    rows = [np.pad(row, (0, len(longest) - len(row)), constant_values=np.nan) for _, pair in curves.values() for row in pair]
    kept = np.flatnonzero(np.isfinite(rows).any(axis=0))
    return [f"gain {gain:g}" for gain in curves], np.stack([longest, *rows])[:, kept[_even(longest[kept])]]


def _even(frequency: FloatArray) -> np.ndarray | slice:
    return spread_over(frequency, BINS) if len(frequency) else slice(None)
