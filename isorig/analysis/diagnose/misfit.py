"""Discrepancies of the baseline compared with noise: by channel, configuration, gain and band, each in one sentence."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from isorig.analysis.campaign import Campaign, ComplexArray, FloatArray
from isorig.analysis.diagnose.estimate_pairs import Double, Doubles, Lines
from isorig.analysis.errors import DataError
from isorig.analysis.fitting.trials import Trial, expected
from isorig.analysis.isolation.ratio import isolation_ratio
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.wording import capitalized, of_signal, state, with_article, with_std

#: A band counts if the misfit's power exceeds the noise's by this factor, other quantities by this many standard errors.
ABOVE_NOISE, SURE = 4.0, 4.0
#: Standard errors for a peak's frequency: leakage, which measured and simulated peaks have in common, is included in them.
MOVED = 2.0
#: Reported differences of a coherence, and relative differences of the isolation ratio and of a peak's frequency.
COHERENCE, SHARE = 0.02, 0.002
#: Reported error as a share of a band's signal; frequency bins needed in such a band; bands from 1 Hz to the filter's corner.
BAND_SHARE, BAND_LINES, BANDS = 0.02, 3, 39
#: Middle part of a misfit's power that determines its band.
MIDDLE = (0.05, 0.95)
#: Range around a peak's frequency for the comparison, as a share of it, and frequency bins needed: a third of an octave.
AROUND, PEAK_LINES = 0.25, 5
#: Relative error of the isolation ratio in a frequency bin, and number of such bins, that are reported. Chosen.
RATIO_SHARE, RATIO_LINES = 10 * SHARE, 3
#: Neighbouring frequency bins of a coherence that are averaged.
SMOOTHED = 5
#: Number of reported discrepancies of each kind.
REPORTED = 3


@dataclass(frozen=True, kw_only=True)
class Discrepancy:
    """A discrepancy: where it appears, its size, and the size of noise alone."""

    channel: str
    configuration: str
    gain: float
    run: str
    band_hz: tuple[float, float]
    what: str
    #: rms of the misfit and of the noise divided by the rms of the signal, in the band.
    size: float
    noise: float
    text: str


def discrepancies(
    campaign: Campaign, model: RigModel, trials: Sequence[Trial], compared: Doubles, *, most: int = 8
) -> tuple[Discrepancy, ...]:
    """Discrepancies above the noise: peaks, bands, coherence, the isolation ratio; largest first."""
    kinds = (
        _peaks(model, compared), _bands(model, trials)[:most], _coherences(model, compared)[:REPORTED],
        _ratios(model, campaign, compared.pairs),
    )  # fmt: skip
    found = [d for kind in kinds for d in kind]
    found.sort(key=lambda d: -d.size / max(d.noise, 1e-6))
    return tuple(found)


def at_first(judged: Sequence[Trial], error: FloatArray, quiet: FloatArray) -> tuple[Discrepancy, ...]:
    """Discrepancies at the beginning of runs whose ends fit, largest first.

    `error` and `quiet` are the rms of the misfit and of the noise divided by that of the signal, shape (runs, channels).
    """
    found = []
    alone = len({trial.run.configuration for trial in judged}) == 1
    for trial, errors, noises in zip(judged, error, quiet, strict=True):
        run, seconds = trial.run, trial.samples / trial.sample_rate
        for name, size, noise in zip(trial.channels, errors.tolist(), noises.tolist(), strict=True):
            if size**2 < ABOVE_NOISE * noise**2:
                continue
            text = (
                f"In run {run.id!r} ({state(run.configuration, run.gain, alone)}) the first {seconds:g} s of "
                f"{with_article(name)} are simulated with an error of {of_signal(size)}, where noise alone would be "
                f"{of_signal(noise)}; "
                "the end of the run fits."
            )
            found.append(
                Discrepancy(
                    channel=name, configuration=run.configuration, gain=run.gain, run=run.id, what="time", size=size, noise=noise,
                    band_hz=(0.0, trial.sample_rate / 2.0), text=text,
                )
            )  # fmt: skip
    return tuple(sorted(found, key=lambda d: -d.size / max(d.noise, 1e-6)))


def _bands(model: RigModel, trials: Sequence[Trial]) -> list[Discrepancy]:
    found = []
    for trial in trials:
        rate, n = trial.sample_rate, trial.samples
        predicted = expected(model, trial)
        frequency = np.fft.rfftfreq(n, 1.0 / rate)
        edges = np.geomspace(1.0, rate / 2.1, BANDS + 1)
        which = np.digitize(frequency, edges)
        for row, name in enumerate(trial.channels):
            error = np.abs(np.fft.rfft(predicted[row] - trial.measured[row])) ** 2 / n
            signal = np.abs(np.fft.rfft(trial.measured[row])) ** 2 / n
            counts = np.bincount(which, minlength=len(edges) + 1)[1:-1]
            e = np.bincount(which, error, minlength=len(edges) + 1)[1:-1]
            s = np.bincount(which, signal, minlength=len(edges) + 1)[1:-1]
            quiet = counts * max(trial.noise[row], 1e-12) ** 2
            bad = (e > ABOVE_NOISE * quiet) & (e > BAND_SHARE**2 * s) & (counts > BAND_LINES)
            if not bad.any():
                continue
            weight = np.where(bad, e, 0.0)
            order = np.cumsum(weight) / weight.sum()
            low, high = (int(np.searchsorted(order, q)) for q in MIDDLE)
            inside = slice(low, high + 1)
            heard = float(s[inside].sum())
            if heard <= 0.0:  # a body at rest
                continue
            size, noise = (float(np.sqrt(power[inside].sum() / heard)) for power in (e, quiet))
            band = (round(float(edges[low]), 2), round(float(edges[high + 1]), 2))
            text = (
                f"In run {trial.run.id!r} ({_state(model, trial.run.configuration, trial.run.gain)}) {with_article(name)} is "
                f"simulated between {band[0]:g} and {band[1]:g} Hz with an error of {of_signal(size)}, where noise alone would "
                f"be {of_signal(noise)}."
            )
            found.append(
                Discrepancy(
                    channel=trial.recorded(name), configuration=trial.run.configuration, gain=trial.run.gain, run=trial.run.id,
                    band_hz=band, what="time" if trial.run.excitation == "moves" else "frf", size=size, noise=noise,
                    text=text,
                )
            )  # fmt: skip
    found.sort(key=lambda d: -d.size / max(d.noise, 1e-6))
    # A repeated run gives the same result again.
    kinds = {(d.channel, d.configuration, d.gain, d.what): d for d in reversed(found)}
    return sorted(kinds.values(), key=lambda d: -d.size / max(d.noise, 1e-6))


def _top(frequency: FloatArray, values: ComplexArray) -> tuple[int, float, float]:
    # Bin, frequency and height of the highest peak within the band, by a parabola through three bins of the logarithm.
    size = np.log(np.abs(values))
    inner = np.flatnonzero((size[1:-1] > size[:-2]) & (size[1:-1] >= size[2:])) + 1
    if not len(inner):
        return 0, np.nan, np.nan
    k = int(inner[np.argmax(size[inner])])
    left, middle, right = size[k - 1 : k + 2]
    bend = left - 2 * middle + right
    move = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    step = 0.5 * (frequency[k + 1] - frequency[k - 1])
    return k, float(frequency[k] + move * step), float(np.exp(middle - 0.25 * (left - right) * move))


def _shift(seen: Lines, around: float | None = None) -> tuple[float, float, float, float]:
    # Measured minus simulated peak frequency (Hz), its standard deviation, the frequency, and the ratio of the heights.
    if around is not None:
        kept = np.abs(seen.frequency - around) <= AROUND * around
        if kept.sum() < PEAK_LINES:
            return np.nan, np.nan, np.nan, np.nan
        seen = replace(
            seen, frequency=seen.frequency[kept], measured=seen.measured[kept], simulated=seen.simulated[kept], std=seen.std[kept]
        )
    k, measured, high = _top(seen.frequency, seen.measured)
    near = np.abs(seen.frequency - measured) <= max(AROUND * measured, 4 * float(np.diff(seen.frequency).min()))
    if k == 0 or near.sum() < PEAK_LINES:
        return np.nan, np.nan, np.nan, np.nan
    j, simulated, low = _top(seen.frequency[near], seen.simulated[near])
    size = np.log(np.abs(seen.measured))
    bend = max(-(size[k - 1] - 2 * size[k] + size[k + 1]), 1e-3)
    std = float(seen.std[k]) * np.sqrt(0.5) / bend * float(np.diff(seen.frequency).min())
    return (measured - simulated if j else np.nan), std, measured, high / low


def _agree(shifts: Sequence[tuple[float, float, float, float]]) -> bool:
    # At least one peak was found, and none is clearly shifted.
    known = [(by, std, at) for by, std, at, _ in shifts if np.isfinite(by)]
    return bool(known) and not any(_clear(by, std, at) for by, std, at in known)


def _clear(by: float, std: float, at: float) -> bool:
    return abs(by) > max(MOVED * std, SHARE * at)


def _peaks(model: RigModel, compared: Doubles) -> list[Discrepancy]:
    found = []
    groups = compared.groups
    for sensor in model.sensors:
        shifts = {}
        for key, group in groups.items():
            seen = group.lines(sensor.channel)
            if seen is not None:
                shifts[key] = _shift(seen)
        clear = {key: s for key, s in shifts.items() if np.isfinite(s[0]) and _clear(*s[:3])}
        if not clear:
            continue
        key = max(clear, key=lambda k: abs(clear[k][0]) / clear[k][2])
        (configuration, gain), (by, std, at, height) = key, clear[key]
        trial = groups[key].pairs[0].trial
        band = (round(0.8 * at, 2), round(1.25 * at, 2))
        size, noise = _error_in(groups[key].pairs[0], sensor.channel, band)
        same = {
            g: shift
            for (c, g), group in groups.items()
            if c == configuration and g != gain and (seen := group.lines(sensor.channel)) is not None
            if np.isfinite((shift := _shift(seen, at))[0])
        }
        moving = [g for g, s in same.items() if abs(s[0] - by) > MOVED * np.hypot(s[1], std) + SHARE * at]
        others = sorted({c for c, _ in shifts if c != configuration})
        fit = [c for c in others if _agree([s for k, s in shifts.items() if k[0] == c])]
        text = (
            f"{_at(model, configuration, gain)}, {with_article(sensor.channel)}'s peak is {with_std(abs(by), std)} Hz "
            f"{'higher' if by > 0 else 'lower'} than simulated, at {at:.4g} Hz, and its height is {height:.3g} times the "
            "simulated one"
        )
        if same:
            text += "; it changes with the gain" if moving else "; it is the same at the other gains"
        if fit:
            text += f"; the {' and '.join(fit)} peaks agree"
        found.append(
            Discrepancy(
                channel=sensor.channel, configuration=configuration, gain=gain, run=trial.run.id, band_hz=band, what="frf",
                size=size, noise=noise, text=text + ".",
            )
        )  # fmt: skip
    return found


def _error_in(pair: Double, channel: str, band: tuple[float, float]) -> tuple[float, float]:
    # rms of misfit, and of noise, divided by rms of the signal in a band.
    n, rate = len(pair.measured), pair.measured.sample_rate
    frequency = np.fft.rfftfreq(n, 1.0 / rate)
    inside = (frequency >= band[0]) & (frequency <= band[1])
    measured = np.fft.rfft(pair.measured.read(channel))[inside]
    error = np.fft.rfft(pair.simulated.read(channel))[inside] - measured
    signal = float((np.abs(measured) ** 2).sum())
    quiet = float(pair.trial.noise[pair.trial.channels.index(channel)]) ** 2 * n * int(inside.sum())
    return float(np.sqrt((np.abs(error) ** 2).sum() / signal)), float(np.sqrt(quiet / signal))


def _state(model: RigModel, configuration: str, gain: float) -> str:
    return state(configuration, gain, alone=len(model.configurations) == 1)


def _at(model: RigModel, configuration: str, gain: float) -> str:
    return capitalized(_state(model, configuration, gain))


def _coherences(model: RigModel, compared: Doubles) -> list[Discrepancy]:
    found = []
    for (configuration, gain), group in compared.groups.items():
        for sensor in model.sensors:
            seen = group.lines(sensor.channel, coherence=0.0)
            if seen is None or len(seen.frequency) < 2 * SMOOTHED:
                continue
            off = np.convolve(seen.simulated_coherence - seen.coherence, np.ones(SMOOTHED) / SMOOTHED, mode="same")
            # Bendat and Piersol (2010), 9.2: std of a coherence is sqrt(2 / n) (1 - g2) sqrt(g2); both are estimates.
            std = 2.0 / np.sqrt(seen.averages) * (1.0 - seen.coherence) * np.sqrt(seen.coherence) / np.sqrt(SMOOTHED)
            bad = np.abs(off) > np.maximum(SURE * std, COHERENCE)
            if bad.sum() < SMOOTHED:
                continue
            low, high = seen.frequency[bad][[0, -1]]
            whole = float(np.sqrt(np.mean(seen.coherence[bad] ** 2)))
            size, noise = float(np.sqrt(np.mean(off[bad] ** 2))) / whole, float(np.sqrt(np.mean(std[bad] ** 2))) / whole
            text = (
                f"{_at(model, configuration, gain)}, the coherence of {with_article(sensor.channel)} with the drive is "
                f"{seen.coherence[bad].mean():.3f} in {int(bad.sum())} frequency bins between {low:g} and {high:g} Hz, "
                f"where the simulation has {seen.simulated_coherence[bad].mean():.3f}."
            )
            found.append(
                Discrepancy(
                    channel=sensor.channel, configuration=configuration, gain=gain, run=group.pairs[0].trial.run.id,
                    band_hz=(float(low), float(high)), what="coherence", size=size, noise=noise, text=text,
                )
            )  # fmt: skip
    found.sort(key=lambda d: -d.size)
    return found


def _ratios(model: RigModel, campaign: Campaign, pairs: Sequence[Double]) -> list[Discrepancy]:
    response, reference, (first, *others) = model.usual_ratio
    if not others or response == reference:
        return []
    try:
        measured, simulated = (
            isolation_ratio(
                replace(campaign, runs=tuple(runs)), response=response, reference=reference, configurations=(first, others[0])
            )
            for runs in ([p.measured for p in pairs], [p.simulated for p in pairs])
        )
    except DataError:
        return []
    off = simulated.ratio - measured.ratio
    bad = (np.abs(off) > SURE * measured.std) & (np.abs(off) > RATIO_SHARE * measured.ratio)
    if bad.sum() < RATIO_LINES:
        return []
    # The middle nine tenths of the misfit determine its band.
    order = np.cumsum(np.where(bad, (off / measured.ratio) ** 2, 0.0))
    low, high = (int(np.searchsorted(order, q * order[-1])) for q in MIDDLE)
    inside = slice(low, high + 1)
    whole = float(np.sqrt(np.mean(measured.ratio[inside] ** 2)))
    band = (float(measured.frequency[low]), float(measured.frequency[high]))
    median = float(np.median(simulated.ratio[inside] / measured.ratio[inside]))
    gain = float(np.median(measured.gain[inside]))
    run = next(p.trial.run for p in pairs if p.trial.run.configuration == first and p.trial.run.gain == gain)
    return [
        Discrepancy(
            channel=response, configuration=first, gain=gain, run=run.id, band_hz=band, what="ratio",
            size=float(np.sqrt(np.mean(off[inside] ** 2))) / whole,
            noise=float(np.sqrt(np.mean(measured.std[inside] ** 2))) / whole,
            text=f"Between {band[0]:g} and {band[1]:g} Hz the simulated ratio |{response} / {reference}|, "
            f"{first} over {others[0]}, is {median:.3g} times the "
            f"measured one (median), and differs in {int(bad.sum())} frequency bins "
            f"by more than {SURE:g} standard deviations.",
        )
    ]  # fmt: skip
