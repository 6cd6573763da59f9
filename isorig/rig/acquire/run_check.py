"""The post-run check, while the run can still be repeated: coherence, clipping, dead channels, lost samples."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from isorig.analysis.campaign import Campaign, FloatArray, Run, broad
from isorig.analysis.errors import DataError
from isorig.analysis.spectra.gain_levels import GAIN
from isorig.analysis.spectra.hits import looks_hit
from isorig.analysis.spectra.overload import blocks, channel_std, combined, extents, extremes
from isorig.analysis.spectra.periodic import Detection, detect
from isorig.analysis.spectra.quality import DEAD, RESOLUTION, spectra_of_start
from isorig.analysis.spectra.welch import Spectra, estimate
from isorig.rig.acquire import policy
from isorig.rig.acquire.incoherence import KINDS, Incoherence, driven_bins, incoherence

if TYPE_CHECKING:
    from isorig.analysis.model.rig_model import RigModel
    from isorig.rig.acquire.recover import Recovered


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Whether a run is worth keeping, with advice in sentences."""

    good: bool  #: Whether there is no reason against keeping it.
    coherence: dict[str, float]  #: Median coherence of each response with the drive within its band.
    detections: tuple[Detection, ...]  #: Noise and distortion of each response, if the drive is periodic and omits harmonics.
    #: rms of the relative motion at a contact divided by that of its first body, the smallest of all contacts: near 0 if friction
    #: holds it; None if unknown.
    sliding: float | None
    advice: tuple[str, ...]  #: Advice, including remarks that is not a fault.


def check_run(
    recovered: Recovered, *, rig: RigModel, against: Iterable[str] = (), remarks: Iterable[str] = (), others: Sequence[Run] = ()
) -> Verdict:
    """Check a run after its measurement.

    `against` are reasons to repeat it, `remarks` further sentences. The `others` are runs of the session: repeats and other
    levels decide whether a low coherence is noise or a nonlinearity.
    """
    run, drive = recovered.run, rig.drive.channel
    if run is None:
        return Verdict(
            good=False, coherence={}, detections=(), sliding=None,
            advice=("No sample arrived; check the instrument and repeat the run.", *against),
        )  # fmt: skip
    spectra, detections = _spectra(run, drive), _detections(run, drive)
    sliding = least_sliding(
        rig, run.configuration,
        lambda one, other: zip(blocks(run.channels[one]), blocks(run.channels[other]), strict=True)
        if {one, other} <= set(run.channels) else None,
    )  # fmt: skip
    coherence = {} if spectra is None else _coherence(run, spectra, drive)
    against = [*_losses(recovered), *against, *_channels(run), *_gain(run, recovered.planned_gain)]
    remarks = [*remarks]
    for name, value in coherence.items():
        if value < policy.COHERENT and spectra is not None:
            reason = incoherence(run, spectra, name, drive, others=others, detections=detections)
            (against if reason.kind == "noise" else remarks).append(reason.text)
    remarks += [sentence for item in detections if (sentence := _distortion(item)) is not None]
    if sliding is not None and sliding.share < policy.STICKING:
        remarks.append(f"{sliding.text}: friction was not overcome. Measure a run at a higher gain as well.")
    return Verdict(
        good=not against, coherence=coherence, detections=detections,
        sliding=None if sliding is None else sliding.share, advice=(*against, *remarks)
    )  # fmt: skip


def incoherences(campaign: Campaign, drives: Sequence[str], responses: Sequence[str] | None = None) -> list[Incoherence]:
    """Why responses of a recording are incoherent: one reason for each, a nonlinearity before what is undecided and noise.

    None for several drives, whose coherences with the response are low in any rig, and for hammer tests. Only `responses` are
    checked, all channels if None.
    """
    drive, *more = drives
    if responses is not None and not responses:
        return []
    runs = [run for run in broad(campaign.runs) if not more and drive in run.channels and not looks_hit(run, drive)]
    found: dict[str, Incoherence] = {}
    for run in runs:
        spectra = spectra_of_start(run, drive, _resolution(run))
        coherence = {} if spectra is None else _coherence(run, spectra, drive, responses)
        for name, value in coherence.items():
            if value < policy.COHERENT and spectra is not None and (name not in found or found[name].kind != "nonlinear"):
                others = [other for other in runs if other.id != run.id]
                reason = incoherence(run, spectra, name, drive, others=others, detections=_detections(run, drive))
                earlier = found.get(name)
                if earlier is None or KINDS.index(reason.kind) < KINDS.index(earlier.kind):
                    found[name] = replace(reason, text=f"Run {run.id!r}: {reason.text}")
    return list(found.values())


def _losses(run: Recovered) -> Iterator[str]:
    if run.lost:
        yield f"{run.lost} samples were lost in transmission; repeat the run if the whole run is to be simulated."
    if not run.finished:
        yield f"It ended at {run.stored + run.lost} of {run.planned} samples; check the instrument and repeat the run."
    if run.overloads:
        yield f"The instrument reported {run.overloads} overloads; choose a larger range or a lower gain and repeat the run."
    if run.drift is not None and run.drift.beyond(policy.RATE_REPORTED):
        yield (
            f"Its clock deviates from the host's by {run.drift.percent}, more than crystals do; check sample_rate in the plan "
            "and the instrument's clock, because the time axis is wrong by that factor."
        )


def _channels(run: Run) -> Iterator[str]:
    sizes = {name: channel_std(channel) for name, channel in run.sensors.items()}
    strongest: dict[str, float] = {}
    for name, channel in run.sensors.items():
        strongest[channel.quantity] = max(strongest.get(channel.quantity, 0.0), sizes[name])
    for name, channel in run.sensors.items():
        if clipped := sum(each.full for each in extents(channel)):
            yield f"{name} clipped {clipped} times; choose a larger range or a lower gain and repeat the run."
        if sizes[name] <= DEAD * strongest[channel.quantity]:
            yield f"{name} hardly moves ({sizes[name]:.2g} {channel.unit} rms); check its cable and its supply."


def _gain(run: Run, planned: float) -> Iterator[str]:
    low, high = extremes(run.channels[GAIN]) if GAIN in run.channels else (run.gain, run.gain)
    if high - low > policy.GAIN_DIFFERENCE * abs(run.gain):
        yield f"The gain changed from {low:.4g} to {high:.4g} during the run; repeat it with a constant gain."
    elif abs(run.gain - planned) > policy.GAIN_DIFFERENCE * planned:
        yield f"The gain was {run.gain:.4g} but the plan has {planned:.4g}; set it and repeat the run."


def _distortion(item: Detection) -> str | None:
    size = max(item.odd, item.even)
    if size <= max(policy.DISTORTED, item.noise):
        return None
    return (
        f"{item.response} responds at frequencies that are not driven, with {100 * size:.0f} % of the driven ones (noise "
        f"{100 * item.noise:.2g} %): this is distortion, which averaging does not remove."
    )


@dataclass(frozen=True, kw_only=True)
class ContactSliding:
    """Relative motion at the contact that moves least: its share, and a text that the first body moved with the other."""

    share: float
    text: str


def least_sliding(
    rig: RigModel, configuration: str, parts: Callable[[str, str], Iterable[Sequence[FloatArray]] | None]
) -> ContactSliding | None:
    """The contact of a rig with the smallest relative motion; None if no contact has sensors on both bodies.

    `parts` gives the records of two channels part by part, each of shape (n,); None if one was not recorded.
    """
    if configuration not in rig.configurations:
        return None
    found = []
    for contact, one, other in rig.sensed_contacts(configuration):
        records = parts(one, other)
        if records is not None:
            found.append(ContactSliding(share=_relative_motion(records), text=f"The {contact.a} moved with the {contact.b}"))
    return min(found, key=lambda item: item.share, default=None)


def _relative_motion(parts: Iterable[Sequence[FloatArray]]) -> float:
    # rms of the first body's motion relative to the other divided by that of its own motion.
    own, relative = zip(*((_moments(one), _moments(one - other)) for one, other in parts), strict=True)
    return combined(relative) / max(combined(own), 1e-30)


def _moments(values: FloatArray) -> tuple[int, float, float]:
    return len(values), float(values.mean()), float(values.std())


def _detections(run: Run, drive: str) -> tuple[Detection, ...]:
    if run.period is None or drive not in run.channels:
        return ()
    try:
        return tuple(detect(run, response=name, reference=drive) for name in run.sensors if name != drive)
    except DataError:
        return ()


def _spectra(run: Run, drive: str) -> Spectra | None:
    if drive not in run.channels or not broad([run]):
        return None
    try:
        return estimate([run], references=[drive], resolution=_resolution(run), jackknife=False)
    except DataError:
        return None


def _resolution(run: Run) -> float:
    return max(RESOLUTION, 8.0 / run.duration)


def _coherence(run: Run, spectra: Spectra, drive: str, responses: Sequence[str] | None = None) -> dict[str, float]:
    driven = driven_bins(run, spectra, drive)
    return {
        name: float(np.median(spectra.frf(name, drive).coherence[driven]))
        for name in (spectra.channels if responses is None else responses)
        if name != drive and np.count_nonzero(driven) >= policy.RESOLVED
    }
