"""Whether a reference drives the rig in the pauses between its pulses.

A hammer's force is noise there, and no response depends on it. A drive with noise may begin with the transient of a filter or of
an amplifier that is switched on: a pulse as of a hammer, but followed by a force to which the rig responds.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from isorig.analysis.campaign import MOTION, BoolArray, FloatArray, IntArray, Run
from isorig.analysis.spectra.hum import MAINS
from isorig.analysis.spectra.welch import estimate

#: Samples that decide whether a reference is a hammer's force, at most.
FIRST = 2**20
#: Shortest segment in samples, and the least number of segments: coherence without a relation is then a tenth. Segments are as
#: long as this number allows, because a slow drive is far below the sample rate.
SHORTEST, SEGMENTS = 64, 8
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
    halves = [(int(a), int(b)) for a, b in zip((end + stops) // 2, stops, strict=True) if b - a >= SHORTEST]
    if not names or not halves:
        return False
    length = 2 ** int(np.log2(max(b - a for a, b in halves)))
    while length > SHORTEST and sum(max(2 * (b - a) // length - 1, 0) for a, b in halves) < SEGMENTS:
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
