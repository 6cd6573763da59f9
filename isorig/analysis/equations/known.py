"""What a model explains already: the forces of its laws, and records without the faults that it describes."""

from collections.abc import Mapping

import numpy as np

from isorig.analysis.campaign import FloatArray, IntArray
from isorig.analysis.derivative import derivative
from isorig.analysis.equations.balances import Element
from isorig.analysis.equations.columns import YIELDS
from isorig.analysis.equations.sliding import SlidingRun
from isorig.analysis.equations.slip import slip_operator
from isorig.analysis.laws import ElastoSlip, Maxwell
from isorig.analysis.laws.base import Law
from isorig.analysis.model.rig_model import Chain, RigModel
from isorig.analysis.simulate.free_run import delivered
from isorig.analysis.simulate.sampling import recharged


def law_of(element: Element, k: int) -> str:
    """Name of the signal with a column of an element's laws."""
    return f"law {k} of {element.name}"


def _slips(law: Law) -> bool:
    # Whether a law is one of many springs that slip, at forces that hardly differ: then those of all sizes count.
    return isinstance(law, ElastoSlip) and law.clearance == 0.0


def law_columns(element: Element) -> int:
    """Number of columns for an element's laws: one for all without memory, one for each with memory, and those of slip."""
    if element.link is None or not element.link.laws:
        return 0
    remembering = [law for law in element.link.laws if law.remembers]
    slips = sum(_slips(law) for law in remembering)
    plain = len(remembering) < len(element.link.laws)
    return plain + len(remembering) - slips + (len(YIELDS) if slips else 0)


def law_forces(
    model: RigModel, element: Element, d: FloatArray, v: FloatArray, time: FloatArray, rate: float,
    run: SlidingRun | None = None, place: IntArray | None = None,
) -> FloatArray:  # fmt: skip
    """Forces of an element's laws along its motion, shape (n, columns).

    With `run` and `place`, the motion is given at these samples of a run only; forces with memory follow from the whole run.
    """
    link = element.link
    assert link is not None
    still = np.zeros((1, len(d)))
    constants = model.constants_of(link)
    plain = [law.force(d, v, time, still, constants) for law in link.laws if not law.remembers]
    found = [np.sum(plain, axis=0)] if plain else []
    whole, at = (d, slice(None)) if run is None else (run.deflection, place)
    memory = run.memory if run is not None else {}
    for k, law in enumerate(law for law in link.laws if law.remembers and not _slips(law)):
        key = f"memory {k}"
        if key not in memory:
            if isinstance(law, Maxwell):
                ratio = 2j * np.pi * np.fft.rfftfreq(len(whole), 1.0 / rate) * law.relaxation_time
                memory[key] = np.fft.irfft(np.fft.rfft(whole) * law.relaxation_stiffness * ratio / (1.0 + ratio), len(whole))
            else:
                memory[key] = law.along(whole, v if run is None else run.velocity, rate, constants)
        found.append(memory[key][at])
    if any(_slips(law) for law in link.laws):
        if "slips" not in memory:
            swing = float(np.abs(whole).max())
            memory["slips"] = np.stack([slip_operator(whole, share * swing) for share in YIELDS], axis=1)
        found += list(memory["slips"][at].T)
    return np.column_stack(found)


def true_records(model: RigModel, recorded: Mapping[str, FloatArray], rate: float) -> dict[str, FloatArray]:
    """Records without the faults of the measurement chain that a rig describes.

    These are offset, gain, delay, crosstalk, high-pass, low-pass, and static curve; a drive's record is as it acts.
    """
    chains = {drive.channel: drive.chain for drive in model.drives} | {sensor.channel: sensor.chain for sensor in model.sensors}
    found = {name: np.asarray(values) for name, values in recorded.items()}
    for name, chain in chains.items():
        if chain == Chain() or name not in found:
            continue
        values = found[name] - chain.offset
        if chain.bend:
            at = np.array([x for x, _ in chain.bend])
            values = np.interp(values, at + np.array([y for _, y in chain.bend]), at)
        for source, share in chain.crosstalk.items():
            if source in found:
                values = values - share * found[source]
        values = values / chain.gain
        if chain.corner:
            values = recharged(values, chain.corner, rate)
        if chain.cutoff:
            values = values + derivative(values, rate) / (2.0 * np.pi * chain.cutoff)
        if chain.delay:
            frequency = np.fft.rfftfreq(len(values), 1.0 / rate)
            values = np.fft.irfft(np.fft.rfft(values) * np.exp(2j * np.pi * frequency * chain.delay), len(values))
        found[name] = values
    acting = {d.channel: delivered(d, found[d.channel], rate) for d in model.drives if d.channel in found}
    return found | acting
