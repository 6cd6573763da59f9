"""Hammer hits in a record: detection, validation, and extraction with a pre-trigger interval.

A hammer's force is zero except for short pulses of one sign. Each hit becomes a record of fixed length that starts shortly before
the pulse; it is rejected if the hammer bounced, an input was overloaded, the rig still moved from the hit before, or the record
is incomplete. The method is modal testing by impact (Ewins 2000, 3.7; ISO 7626-5:2019).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from isorig.analysis.campaign import MOTION, BoolArray, Channel, FloatArray, IntArray, Run, once
from isorig.analysis.errors import DataError
from isorig.analysis.rounding import deviation_by_median
from isorig.analysis.spectra.hum import MAINS
from isorig.analysis.spectra.overload import FULL, ROW, blocks, cut_off, extremes, plateaus
from isorig.analysis.spectra.welch import estimate, stretches

Reason = Literal["", "double hit", "overload", "still moving", "too soon", "cut short", "weak"]

#: A pulse starts where the force exceeds this share of the record's largest, and this many noise levels: one of 1e9 samples of
#: Gaussian noise does.
TRIGGER, ABOVE_NOISE = 0.1, 6.0
#: A force is a hammer's if pulses of one sign contain at least this share of its energy in at most this share of its time.
ENERGY, TIME = 0.9, 0.1
#: Least kurtosis of a hammer's force: with a share E of its energy in a share T of its time it is at least E^2 / T (Gaussian
#: noise has 3).
IMPULSIVE = ENERGY**2 / TIME
#: Kurtosis of the force outside of the pulses up to which it is noise or hum; weak pulses, or some of the other sign, exceed it.
#: Chosen: Gaussian noise has 3, a sine 1.5, and noise of a few hundred independent samples less than 5.
NOISE_LIKE = 5.0
#: A second pulse above this share of the first is a double hit (ISO 7626-5 requires single pulses), if it exceeds the filter's
#: ringing by this factor.
DOUBLE, RINGING = 0.05, 2.0
#: A hit below this share of the median hit is too weak to be used.
WEAK = 0.1
#: Maximum share of a record before its pulse.
BEFORE = 0.05
#: A response whose rms before the pulse exceeds the first share of its peak, and this multiple of its quietest interval, still
#: rings from the hit before: this increases the scatter of the hits; above the second share the hit is rejected.
STILL, SPOILT, ABOVE_FLOOR = 0.02, 0.2, 3.0
#: Samples after a pulse that belong to it, in widths of the pulse, and at least this many.
TAIL, TAIL_LEAST = 2, 8
#: Share of the hits that must be complete with the chosen length.
WHOLE = 0.75
#: Minimum length of a record in samples.
SHORTEST = 32
#: Samples that decide whether a reference is a hammer's force, at most.
FIRST = 2**20
#: Shortest segment of the pauses in samples, and the least number of segments: coherence without a relation is then a tenth.
#: Segments are as long as this number allows, because a slow drive is far below the sample rate.
SEGMENT, SEGMENTS = 64, 8
#: The frequency bins with this share of the force's power are compared.
COMPARED = 0.9
#: Both sensors may show hum: multiples of the mains frequencies are left out with so many bins on either side.
LEAKS = 3
#: If less than this share of the power remains without hum, it is leakage of the hum. Chosen: the window's is below it.
REMAINS = 1e-2
#: Coherence, as the median of these bins, from which the force drives: as much of the response follows from it as does not.
COHERENT = 0.5
#: A force whose rms in the pauses is below this share of the highest pulse is none: converters do not resolve it.
RESOLVED = 1e-6


@dataclass(frozen=True, kw_only=True)
class Hit:
    """One blow of the hammer."""

    run: str  #: Its run.
    seconds: float  #: Time of the pulse's maximum, from the run's first sample.
    peak: float  #: The highest force, in the channel's unit.
    #: First sample of its record in the run, and first sample after its pulse.
    first: int
    pulse_end: int
    rejected: Reason = ""  #: Why it is excluded from averages; empty if it is not.
    text: str = ""  #: The same as a sentence with numbers; empty if it is kept.
    moving: float = 0.0  #: Largest rms of a response before the pulse, as a share of its peak; 0 where all were at rest.


@dataclass(frozen=True, kw_only=True)
class Pulses:
    """Pulses of a force: first sample, highest sample and first sample after each pulse, shape (pulses,); sign and noise."""

    begin: IntArray
    top: IntArray
    end: IntArray
    sign: float
    noise: float
    offset: float


def pulses(run: Run, reference: str) -> Pulses | None:
    """The pulses of a hammer's force in a whole run, or None if the channel is not a hammer's."""
    if len(run) < SHORTEST or len(run.channel(reference)) < SHORTEST:
        return None
    values = run.read(reference)
    offset = float(np.median(values))
    values -= offset
    noise = deviation_by_median(values)
    top = float(max(values.max(), -values.min()))
    level = max(TRIGGER * top, ABOVE_NOISE * noise)
    if top == 0.0 or top <= level:
        return None
    sign = 1.0 if values[int(np.argmax(np.abs(values)))] > 0.0 else -1.0
    begin, end = _crossings(sign * values, level)
    highest = np.array([b + int(np.argmax(sign * values[b:e])) for b, e in zip(begin, end, strict=True)], dtype=np.int64)
    widths = end - begin
    within = np.zeros(len(values), dtype=bool)
    for b, e, wide in zip(begin, end, widths, strict=True):
        within[max(0, b - wide) : e + TAIL * wide] = True
    kept, rest = values[within], values[~within]
    forward = float((np.maximum(sign * kept, 0.0) ** 2).sum())
    pulsed = float((kept**2).sum()) - noise**2 * len(kept)
    # What remains of the rest without its noise is uncertain by more than a short pulse has if the noise is strong.
    left = 0.0 if _kurtosis(rest) <= NOISE_LIKE else float((rest**2).sum()) - noise**2 * len(rest)
    if within.mean() > TIME or forward < ENERGY * (pulsed + left):
        return None
    return Pulses(begin=begin, top=highest, end=end, sign=sign, noise=noise, offset=offset)


def _kurtosis(values: FloatArray) -> float:
    # Of values around zero.
    square = values**2
    return float(np.mean(square**2)) / max(float(np.mean(square)) ** 2, np.finfo(float).tiny) if len(values) else 0.0


def _crossings(values: FloatArray, level: float) -> tuple[IntArray, IntArray]:
    edges = np.flatnonzero(np.diff(values > level, prepend=False, append=False)).astype(np.int64)
    return edges[::2], edges[1::2]


@once
def looks_hit(run: Run, reference: str) -> bool:
    """Whether the reference is a hammer's force: short single pulses, in a run whose excitation is "other" or "random".

    Between its pulses a hammer drives nothing; noise that begins with the transient of a filter does.

    Of a run whose excitation is "random" only the first `FIRST` samples are read, unless they are too impulsive for noise.
    """
    if reference not in run.channels or run.excitation not in ("other", "random"):
        return False
    if run.excitation == "random":
        values = run.channel(reference).read(0, min(FIRST, len(run)))
        if not len(values):
            return False
        if _kurtosis(values - np.median(values)) < IMPULSIVE:
            return False
    blows = pulses(run, reference)
    return blows is not None and not drives_in_pauses(run, reference, blows.begin, blows.end)


def longest_record(found: Sequence[Pulses], runs: Sequence[Run]) -> int:
    """Samples of a record that are available for `WHOLE` of the hits before the next one or the end of the run."""
    room = [
        after - begin
        for blows, run in zip(found, runs, strict=True)
        for begin, after in pairwise((*blows.begin, len(run)))
        if after - begin >= SHORTEST
    ]
    if not room:
        raise DataError(
            f"no hit is followed by {SHORTEST} samples before the next; pause between hits and record on after the last"
        )
    return int(np.quantile(room, 1.0 - WHOLE) / (1.0 + BEFORE))


def checked(run: Run, reference: str, responses: Sequence[str], blows: Pulses, length: int, median: float) -> list[Hit]:
    """Every hit of a run in records of `length` samples, with its faults.

    `median` is that of the hits' highest forces, in the channel's unit.
    """
    force = blows.sign * (run.read(reference) - blows.offset)
    unit, rate = run.channel(reference).unit, run.sample_rate
    whole = list(stretches(run))
    names = (reference, *responses)
    ends = {name: extremes(run.channel(name)) if plateaus(run.channel(name)) else () for name in names}
    floors = {name: _quietest(run.channel(name), length) for name in responses}
    hits: list[Hit] = []
    last = -length
    for begin, top, end in zip(blows.begin, blows.top, blows.end, strict=True):
        peak, wide = float(force[top]), int(end - begin)
        if hits and begin < last:
            # Part of the record before, whose check includes it.
            continue
        first = max(int(begin) - max(int(BEFORE * length), 1), 0)
        after = int(end) + max(TAIL * wide, TAIL_LEAST)
        at = f"the hit at {top / rate:.4g} s of run {run.id!r} ({peak:.3g} {unit})"
        second = _second(force[first : first + length], int(top) - first, peak, blows.noise)
        moving, name = _moving(run, floors, first, int(begin) - wide, first + length)
        overloaded = _overloaded(run, ends, first, first + length)
        reason: Reason = ""
        text = ""
        if not any(start <= first and first + length <= stop for start, stop in whole):
            reason, text = "cut short", f"{at} is incomplete: its record ends before {length / rate:.3g} s"
        elif second is not None:
            when, size = second
            reason = "double hit" if when < end - first + length // 4 else "too soon"
            phrase = "bounced" if reason == "double hit" else "was followed too soon"
            text = f"{at} {phrase}: a second pulse of {100 * size / peak:.0f} % comes "
            text += f"{1e3 * (when + first - top) / rate:.3g} ms later"
        elif overloaded:
            reason, text = "overload", f"{at} overloaded {overloaded}"
        elif peak < WEAK * median:
            reason, text = "weak", f"{at} is weak: the median hit has {median:.3g} {unit}"
        elif moving > SPOILT:
            reason, text = "still moving", f"{at} came while {name} still moved by {100 * moving:.0f} % (rms) of its peak"
        last = first + length if reason != "too soon" else int(end)
        hits.append(
            Hit(
                run=run.id, seconds=top / rate, peak=peak, first=first, pulse_end=after, rejected=reason, text=text, moving=moving
            )
        )
    return hits


def _second(force: FloatArray, top: int, peak: float, noise: float) -> tuple[int, float] | None:
    # A later pulse with the same sign; a filter rings in both directions equally.
    level = max(DOUBLE * peak, ABOVE_NOISE * noise)
    # The pulse has ended when it has fallen below the level.
    end = top + int(np.argmax(force[top:] < level))
    rest = force[end:]
    begins, ends = _crossings(rest, level)
    for b, e in zip(begins, ends, strict=True):
        size = float(rest[b:e].max())
        around = rest[max(0, b - TAIL_LEAST) : e + TAIL_LEAST]
        if size > RINGING * max(float(-around.min()), 0.0):
            return int(b) + end, size
    return None


def _overloaded(run: Run, ends: Mapping[str, tuple[float, ...]], first: int, last: int) -> str:
    for name, limits in ends.items():
        channel = run.channel(name)
        values = channel.read(first, last)
        if channel.full_scale is not None and (np.abs(values) >= FULL * channel.full_scale).any():
            return f"{name}: it reached the end of its range of ±{channel.full_scale:g} {channel.unit}"
        stayed = next((limit for limit in limits if (cut_off(values, values == limit) >= ROW).any()), None)
        if stayed is not None:
            return f"{name}: it remains at its extreme of {stayed:.4g} {channel.unit} for several samples"
    return ""


def _quietest(channel: Channel, length: int) -> float:
    # Level of a response between hits, or of its noise: the quietest interval as long as the time before a pulse.
    wide = max(int(BEFORE * length), 2)
    least = np.inf
    for block in blocks(channel):
        rows = block[: len(block) // wide * wide].reshape(-1, wide)
        least = min(least, float(rows.std(axis=1).min())) if len(rows) else least
    return least


def _moving(run: Run, floors: Mapping[str, float], first: int, begin: int, last: int) -> tuple[float, str]:
    worst = (0.0, "")
    for name, floor in floors.items():
        values = run.channel(name).read(first, last)
        before = values[: begin - first]
        if len(before) < 2:
            continue
        level, size = float(before.std()), float(np.abs(values - before.mean()).max())
        if level > STILL * size and level > ABOVE_FLOOR * floor:
            worst = max(worst, (level / size, name))
    return worst


def drives_in_pauses(run: Run, reference: str, begin: IntArray, end: IntArray) -> bool:
    """Whether a response of the rig follows the reference in the second half of the pauses, where vibrations have decayed.

    False where the pauses are too short, the reference is zero there, or the run has no response that is a motion. Pulses have
    their first samples in `begin`, the first samples after them in `end`, shape (pulses,).
    """
    size = len(run.channel(reference))
    names = [
        name for name, channel in run.sensors.items() if name != reference and channel.quantity in MOTION and len(channel) == size
    ]
    records = {name: run.channel(name).read(0, FIRST) for name in (reference, *names)}
    highest = float(np.abs(records[reference]).max())
    # A pulse begins about its own width before it crosses the trigger level.
    stops = np.minimum(np.append(begin[1:] - (end - begin)[1:], size), len(records[reference]))
    halves = [(int(a), int(b)) for a, b in zip((end + stops) // 2, stops, strict=True) if b - a >= SEGMENT]
    if not names or not halves:
        return False
    length = 2 ** int(np.log2(max(b - a for a, b in halves)))
    while length > SEGMENT and sum(max(2 * (b - a) // length - 1, 0) for a, b in halves) < SEGMENTS:
        length //= 2
    parts = [
        replace(run, gaps=(), channels={
            name: replace(run.channel(name), samples=values[a:b], scale=1.0, offset=0.0) for name, values in records.items()
        }) for a, b in halves if b - a >= length
    ]  # fmt: skip
    spectra = estimate(parts, references=[reference], resolution=run.sample_rate / length, jackknife=False)
    force, quiet = spectra.density(reference), _without_hum(spectra.frequency)
    driven = np.where(quiet, force, 0.0)
    least = max((RESOLVED * highest) ** 2 / spectra.resolution, REMAINS * float(force.sum()))
    if spectra.segments < SEGMENTS or driven.sum() <= least:
        return False
    order = np.argsort(driven)[::-1]
    compared = order[: 1 + int(np.searchsorted(np.cumsum(driven[order]), COMPARED * driven.sum()))]
    return any(np.median(spectra.frf(name, reference).coherence[compared]) >= COHERENT for name in names)


def _without_hum(frequency: FloatArray) -> BoolArray:
    # Without the lowest and highest bin, which hold offsets, and the bins to which hum leaks.
    distance = np.min([np.abs(frequency - mains * np.maximum(np.rint(frequency / mains), 1.0)) for mains in MAINS], axis=0)
    found = distance > LEAKS * (frequency[1] - frequency[0])
    found[[0, -1]] = False
    return np.asarray(found)
