"""Whether a reference drives the rig in the pauses between its pulses.

A hammer's force is noise there, and no response depends on it. A drive with noise may begin with the transient of a filter or of
an amplifier that is switched on: a pulse as of a hammer, but followed by a force to which the rig responds.
"""

from __future__ import annotations

import numpy as np

from isorig.analysis.campaign import MOTION, ComplexArray, FloatArray, IntArray, Run

#: Samples that decide whether a reference is a hammer's force, at most.
FIRST = 2**20
#: Longest and shortest segment in samples, and the least number of segments: coherence without a relation is then a tenth.
LONGEST, SHORTEST, SEGMENTS = 1024, 64, 8
#: The share of the frequency bins that is compared, those in which the force is largest: more than mains hum has.
COMPARED = 0.1
#: Coherence, as the median of these bins, from which the force drives: as much of the response follows from it as does not.
COHERENT = 0.5
#: A force in the pauses below this share of the highest pulse is none: converters do not resolve it.
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
    values = run.channel(reference).read(0, FIRST)
    responses = [
        channel.read(0, FIRST)
        for name, channel in run.sensors.items()
        if name != reference and channel.quantity in MOTION and len(channel) == len(run.channel(reference))
    ]
    # A pulse begins about its own width before it crosses the trigger level.
    stops = np.minimum(np.append(begin[1:] - (end - begin)[1:], len(values)), len(values))
    halves = [(int(a), int(b)) for a, b in zip((end + stops) // 2, stops, strict=True) if b - a >= SHORTEST]
    if not responses or not halves:
        return False
    length = min(LONGEST, 2 ** int(np.log2(np.median([b - a for a, b in halves]))))
    first = [a + k for a, b in halves for k in range(0, b - a - length + 1, length // 2)]
    if len(first) < SEGMENTS:
        return False
    force = _transformed(values, first, length)
    power = (np.abs(force) ** 2).sum(axis=0)
    if power.sum() <= len(first) * (RESOLVED * length * float(np.abs(values).max())) ** 2:
        return False
    largest = np.argsort(power)[-max(int(COMPARED * len(power)), 1) :]
    return any(_coherence(force[:, largest], _transformed(each, first, length)[:, largest]) >= COHERENT for each in responses)


def _coherence(force: ComplexArray, response: ComplexArray) -> float:
    # Median over frequency bins, of shape (segments, bins).
    cross = np.abs((force.conj() * response).sum(axis=0)) ** 2
    powers = (np.abs(force) ** 2).sum(axis=0) * (np.abs(response) ** 2).sum(axis=0)
    return float(np.median(cross / np.maximum(powers, np.finfo(float).tiny)))


def _transformed(values: FloatArray, first: list[int], length: int) -> ComplexArray:
    rows = np.stack([values[k : k + length] for k in first])
    return np.asarray(np.fft.rfft((rows - rows.mean(axis=1, keepdims=True)) * np.hanning(length), axis=1)[:, 1:-1])
