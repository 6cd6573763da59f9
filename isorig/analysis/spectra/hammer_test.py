"""Transfer functions from hammer hits: each hit is windowed and transformed as a whole, then averaged over the valid hits.

A force window keeps the pulse and sets the rest to zero. If a response still rings at the end of its record, force and response
are multiplied by the same exponential exp(-a t): the estimate is then exactly the transfer function at s = a + 2 pi i f instead
of 2 pi i f (shift theorem), so a fit at these s has no added damping to correct afterwards.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import FloatArray, Run
from isorig.analysis.errors import DataError
from isorig.analysis.spectra.hits import BEFORE, Hit, checked, longest_record, pulses
from isorig.analysis.spectra.segment_groups import Groups, Sums
from isorig.analysis.spectra.welch import Spectra
from isorig.analysis.wording import capitalized

#: A response that has decayed below this share of its start at the end of its record needs no exponential window; otherwise it is
#: brought down to it (ISO 7626-5:2019 recommends 1 % or less).
END = 0.01
#: Share of a record, at its start and at its end, used to compare the level of a response.
PART = 0.1
#: Force power below this share of its maximum is too small for a transfer function: 20 dB.
DROP = 0.01


@dataclass(frozen=True, kw_only=True)
class HammerTest:
    """Result of a hammer test."""

    spectra: Spectra  #: Averaged over the kept hits; `Spectra.decay` is that of the exponential window, there is no other window.
    hits: tuple[Hit, ...]  #: All hits, in the order of the runs, with the reason for exclusion, if excluded.
    band: tuple[float, float]  #: Band in which the force has power, Hz.
    text: tuple[str, ...]  #: Sentences about the result.


def hammer_test(runs: Sequence[Run], *, reference: str, channels: Sequence[str] | None = None, resolution: float) -> HammerTest:
    """Find the hits of runs, reject faulty ones, and average the rest.

    The runs have one sample rate, and each one hit or many; the responses are all other channels of the first run if no
    `channels` are given. The requested resolution, Hz, becomes coarser if the time between hits is shorter. Raises DataError if a
    run has no hits, or none is valid.
    """
    rate = runs[0].sample_rate
    if any(run.sample_rate != rate for run in runs):
        raise DataError("the runs have several sample rates; average runs of one rate only")
    found = []
    for run in runs:
        blows = pulses(run, reference)
        if blows is None:
            raise DataError(
                f"run {run.id!r} has no hammer hits in {reference!r}: a hammer's force has short pulses of one sign and is zero "
                "between them, so name the channel of the force, or average the run as noise"
            )
        found.append(blows)
    names = tuple(channels or (name for name, channel in runs[0].channels.items() if channel.quantity != "gain"))
    names = tuple(dict.fromkeys((reference, *names)))
    wanted, longest = round(rate / resolution), longest_record(found, runs)
    length = min(wanted, longest) // 2 * 2
    # The maximum of each pulse above the level before it.
    peaks = [abs(float(run.channel(reference).read(top, top + 1)[0]) - blows.offset)
             for run, blows in zip(runs, found, strict=True) for top in blows.top]  # fmt: skip
    hits = [
        hit
        for run, blows in zip(runs, found, strict=True)
        for hit in checked(run, reference, names[1:], blows, length, float(np.median(peaks)))
    ]
    kept = [hit for hit in hits if not hit.rejected]
    if not kept:
        raise DataError(
            f"none of the {len(hits)} hits is valid: {hits[0].text}; hit once, within range, and let the rig come to rest before"
        )
    by_id = {run.id: run for run in runs}
    records = np.stack([_record(by_id[hit.run], names, hit, length) for hit in kept])
    decay = _decay(records, rate)
    whole = _spectra(records, names, runs[0], rate, decay)
    band = _band(whole, reference)
    return HammerTest(spectra=whole, hits=tuple(hits), band=band, text=_sentences(hits, length / rate, wanted / rate, decay))


def _record(run: Run, names: Sequence[str], hit: Hit, length: int) -> FloatArray:
    # All channels from a hit's first sample, minus their mean before the pulse; the force is zero after the pulse.
    before = max(int(BEFORE * length) // 2, 2)
    rows = np.stack([run.channel(name).read(hit.first, hit.first + length) for name in names])
    rows -= rows[:, :before].mean(axis=1, keepdims=True)
    end = hit.pulse_end - hit.first
    fall = max(min(end, length - end), 1)
    window = np.zeros(length)
    window[:end] = 1.0
    # A cosine reduces the rest of the force to zero within the duration of the pulse.
    window[end : end + fall] = 0.5 + 0.5 * np.cos(np.pi * np.arange(1, fall + 1) / (fall + 1))
    rows[0] *= window
    return np.asarray(rows)


def _decay(records: FloatArray, rate: float) -> float:
    # Rate (1/s) of the exponential that reduces the slowest response to END of its start; 0 if all decay without it.
    length = records.shape[2]
    part, before = max(int(PART * length), 2), max(int(BEFORE * length) // 2, 2)
    answers = records[:, 1:]
    noise = (answers[:, :, :before] ** 2).mean(axis=(0, 2))
    late = np.maximum((answers[:, :, -part:] ** 2).mean(axis=(0, 2)) - noise, 0.0)
    early = (answers[:, :, 2 * before : 2 * before + part] ** 2).mean(axis=(0, 2))
    # Noise power at the end says nothing about the ringing.
    ringing = np.where(late > 0.5 * noise, np.sqrt(late / np.maximum(early, np.finfo(float).tiny)), 0.0)
    worst = float(ringing.max(initial=0.0))
    seconds = (1.0 - PART) * length / rate
    return float(np.log(worst / END) / seconds) if worst > END else 0.0


def _spectra(records: FloatArray, names: tuple[str, ...], run: Run, rate: float, decay: float) -> Spectra:
    from scipy.fft import rfft

    hits, _, length = records.shape
    seconds = np.arange(length) / rate
    lines = np.asarray(rfft(records * np.exp(-decay * seconds), axis=2))
    each = 2.0 / (rate * length)
    auto, cross = lines.real**2 + lines.imag**2, np.conj(lines[:, :1]) * lines
    # Every hit is a separate group.
    parts = tuple(Sums(1, auto[h], {names[0]: cross[h]}).single() for h in range(hits))
    return Spectra(
        channels=names, frequency=np.asarray(np.fft.rfftfreq(length, 1.0 / rate)),
        auto=each * auto.mean(axis=0), cross={names[0]: each * cross.mean(axis=0)},
        averages=float(hits), segments=hits, resolution=rate / length, units=tuple(run.channel(name).unit for name in names),
        window=None, overlap=0.0, decay=decay,
        groups=Groups(parts, np.full(lines.shape[2], each)) if hits > 1 else None,
    )  # fmt: skip


def _band(spectra: Spectra, reference: str) -> tuple[float, float]:
    power = spectra.density(reference)[1:]
    enough = power >= DROP * power.max()
    last = int(np.argmin(enough)) if not enough.all() else len(enough) - 1
    # The highest frequencies, attenuated by anti-alias filters, are not usable.
    top = min(float(spectra.frequency[1:][max(last - 1, 1)]), float(spectra.frequency[-1]) / 1.28)
    return spectra.resolution, top


def _sentences(hits: Sequence[Hit], seconds: float, wanted: float, decay: float) -> tuple[str, ...]:
    kept = sum(not hit.rejected for hit in hits)
    counts = Counter(hit.rejected for hit in hits if hit.rejected)
    left = ", ".join(f"{count} {reason}" for reason, count in counts.items())
    notes = [
        f"{kept} of {len(hits)} hammer hits were averaged, in records of {seconds:.3g} s"
        + (f"; left out: {left}." if left else ".")
    ]
    if seconds < 0.999 * wanted:
        notes.append(f"The hits are too close in time for a resolution of {1.0 / wanted:.3g} Hz; it is {1.0 / seconds:.3g} Hz.")
    if decay:
        notes.append(
            f"The responses still ring at the end of a record, so an exponential window of {decay:.3g} /s was applied to them "
            "and to the force; fitted damping ratios are corrected for it, but the peaks of the curves are lower and wider."
        )
    restless = [hit.moving for hit in hits if hit.moving and not hit.rejected]
    if restless:
        notes.append(
            f"Before {len(restless)} of the hits that were kept the rig still moved, by up to {100 * max(restless):.0f} % (rms) "
            "of a response's peak; wait longer between hits."
        )
    if kept == 1:
        notes.append("One hit has no scatter, so the standard deviations are unknown; they are set to the size of the values.")
    return (*notes, *(f"{capitalized(hit.text)}." for hit in hits if hit.rejected))
