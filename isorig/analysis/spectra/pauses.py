"""Whether a reference drives the rig in the pauses between its pulses.

A hammer's force is noise there, and no response depends on it. A drive with noise may begin with the transient of a filter or of
an amplifier that is switched on: a pulse as of a hammer, but followed by a force to which the rig responds.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from isorig.analysis.campaign import MOTION, IntArray, Run
from isorig.analysis.spectra.welch import estimate

#: Samples that decide whether a reference is a hammer's force, at most.
FIRST = 2**20
#: Longest and shortest segment in samples, and the least number of segments: coherence without a relation is then a tenth.
LONGEST, SHORTEST, SEGMENTS = 1024, 64, 8
#: The share of the frequency bins that is compared, those in which the force is largest: more than mains hum has.
COMPARED = 0.1
#: Coherence, as the median of these bins, from which the force drives: as much of the response follows from it as does not.
COHERENT = 0.5
#: A force whose rms in the pauses is below this share of the highest pulse is none: converters do not resolve it.
RESOLVED = 1e-6


def drives_in_pauses(run: Run, reference: str, begin: IntArray, end: IntArray) -> bool:
    """Whether a response of the rig follows the reference in the second half of the pauses, where vibrations have decayed.

    False where the pauses are too short, the reference is zero there, or the run has no response that is a motion.

    Parameters
    ----------
    run, reference
        The run, and the channel with pulses.
    begin, end
        First sample of each pulse and first sample after it, shape (pulses,).
    """
    size = len(run.channel(reference))
    names = [
        name for name, channel in run.sensors.items()
        if name != reference and channel.quantity in MOTION and len(channel) == size
    ]  # fmt: skip
    records = {name: run.channel(name).read(0, FIRST) for name in (reference, *names)}
    highest = float(np.abs(records[reference]).max())
    # A pulse begins about its own width before it crosses the trigger level.
    stops = np.minimum(np.append(begin[1:] - (end - begin)[1:], size), len(records[reference]))
    halves = [(int(a), int(b)) for a, b in zip((end + stops) // 2, stops, strict=True) if b - a >= SHORTEST]
    if not names or not halves:
        return False
    length = min(LONGEST, 2 ** int(np.log2(np.median([b - a for a, b in halves]))))
    parts = [
        replace(run, gaps=(), channels={
            name: replace(run.channel(name), samples=values[a:b], scale=1.0, offset=0.0) for name, values in records.items()
        }) for a, b in halves
    ]  # fmt: skip
    spectra = estimate(parts, references=[reference], resolution=run.sample_rate / length, jackknife=False)
    force = spectra.density(reference)[1:-1]
    if spectra.segments < SEGMENTS or force.sum() * spectra.resolution <= (RESOLVED * highest) ** 2:
        return False
    largest = 1 + np.argsort(force)[-max(int(COMPARED * len(force)), 1) :]
    return any(np.median(spectra.frf(name, reference).coherence[largest]) >= COHERENT for name in names)
