"""Detection of bad data: clipped, dead, stuck, swapped or noisy channels, short records, early motion, gaps in the drive.

Each is detected from the records only, by comparison within a run, with the other runs, and with the behaviour of three masses in
a line. Faults are reported, and those that would spoil an average are excluded from it (`sound`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from isorig.analysis.campaign import Campaign, FloatArray, Measured, Run, broad, given_campaign, once
from isorig.analysis.errors import DataError
from isorig.analysis.given import of_type
from isorig.analysis.parallel import side_by_side
from isorig.analysis.spectra.hits import looks_hit
from isorig.analysis.spectra.noise import ENOUGH, noise_level
from isorig.analysis.spectra.overload import LONGEST, extents, extremes, plateaus
from isorig.analysis.spectra.welch import Spectra, common_bins, estimate, stretches
from isorig.analysis.wording import capitalized

FaultKind = Literal["clipped", "dead", "stuck", "swapped", "noisy", "too short", "not at rest", "no drive", "spike"]
#: Kinds that spoil an average of transfer functions; motion before the start spoils only free-run simulations.
SPOILING: tuple[FaultKind, ...] = ("clipped", "dead", "stuck", "swapped", "noisy")
#: Number of flat tops at a record's extreme that indicates a limit.
ROWS = 3
#: A channel below this share of the strongest of its kind is dead.
DEAD = 1e-4
#: Share of its rms by which another channel must move while one has a constant value.
MOVING = 0.01
#: A spike leaves what its neighbours suggest by this multiple of the largest other such distance of the channel and by this one
#: of the rms, at this number of samples at most, while no other channel leaves it by this multiple of its 99.9 % quantile.
#: Chosen: the largest of stops, friction and hammer hits are alike, and show in several channels.
SPIKE, SPIKY, SPIKE_SAMPLES, AGREED = 3.0, 5.0, 4, 5.0
#: Samples before and after it in which the channel moves, and the ratio of both from which nothing begins there.
AROUND, BEGINS = 60, 0.2
#: Minimum number of samples for such a quantile, and the weights of four neighbours in a cubic interpolation between them.
QUANTILE, MOMENTS, NEIGHBOURS = 2000, 0.999, (-1.0 / 6.0, 4.0 / 6.0, 0.0, 4.0 / 6.0, -1.0 / 6.0)
#: Noise above this multiple of the usual level, and above this share of the channel's own rms, is too much.
NOISY, NOISE_SHARE = 10.0, 0.1
#: Resolution for checking runs, Hz, and averages needed for a transfer function.
RESOLUTION, AVERAGES = 0.5, 8.0
#: Exchanging two channels must reduce a run's distance from the others by this factor, from at least this distance (mean |log| of
#: ratios).
NEARER, FAR = 4.0, 0.3
#: The power of the error in the first second exceeds the largest later one by this factor, and this share of the signal's power.
START, START_SHARE = 2.0, 0.02
#: Motion in the first second of a record, relative to that of the whole, up to which it begins at rest. Chosen: a position that
#: ends elsewhere differs from its mean at the start as if it had moved; as an amplitude, the share above is three times as large.
STILL = 0.05
#: Resolution for an impulse response, Hz, if the run has this many segments.
FINE, SEGMENTS = 0.125, 3.0
#: A drive density below this share of its median is a gap; gaps wider than this share of the band are reported.
HOLE, WIDE = 1e-3, 0.1


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A fault of a record; `channel` is empty for the whole run, and two names joined by "/" for two channels."""

    run: str
    channel: str
    kind: FaultKind
    text: str


def fault_sentences(faults: Sequence[Fault]) -> list[str]:
    """The sentences of faults in records; what applies to several runs is stated once."""
    alike: dict[str, list[Fault]] = {}
    for fault in faults:
        alike.setdefault(fault.text.replace(repr(fault.run), "", 1), []).append(fault)
    said = []
    for first, *others in alike.values():
        runs = " and ".join(repr(each.run) for each in others)
        also = f" The same applies to run{'s' if len(others) > 1 else ''} {runs}." if others else ""
        said.append(f"{capitalized(first.text)}{also}")
    return said


def faults(campaign: Measured, *, reference: str) -> tuple[Fault, ...]:
    """All faults of a campaign's records.

    Parameters
    ----------
    campaign
        The measurement, or the path of its recording.
    reference
        The drive channel.

    Raises
    ------
    ArgumentError
        An argument is of another type.

    Examples
    --------
    >>> from dataclasses import replace
    >>> import numpy as np
    >>> import isorig as iso
    >>> campaign = iso.read("campaign.h5")
    >>> iso.faults(campaign, reference="head")
    ()
    >>> run = campaign.runs[0]
    >>> dead = replace(run.channels["motor"], samples=np.zeros(len(run)))
    >>> spoilt = iso.Campaign(runs=(replace(run, channels={**run.channels, "motor": dead}), *campaign.runs[1:]))
    >>> [(fault.run, fault.channel, fault.kind) for fault in iso.faults(spoilt, reference="head")]
    [('u70', 'motor', 'dead')]
    """
    of_type(reference, str, "the reference", 'the name of a channel; give one, for example "head"')
    return _faults(given_campaign(campaign), reference)


@once
def _faults(campaign: Campaign, reference: str) -> tuple[Fault, ...]:
    released = _released(campaign, reference)
    found = clipped_or_dead(campaign, reference=reference)
    # A hammer's run lasts as long as the rig rings.
    found += [fault for run in campaign.runs for fault in _short(run) if not looks_hit(run, reference)]
    found += [fault for run in campaign.runs for fault in _spikes(run, reference)]
    hurt = released | {(fault.run, fault.channel) for fault in found if fault.kind == "dead"}
    found += [fault for run in campaign.runs for fault in _stuck(run, reference) if (run.id, fault.channel) not in hurt]
    found += _noisy(campaign, hurt)
    spectra_by_run = {run.id: spectra_of_start(run, reference) for run in broad(campaign.runs) if (run.id, reference) not in hurt}
    for run in broad(campaign.runs):
        spectra = spectra_by_run.get(run.id)
        if spectra is not None:
            found += [*_holes(run, spectra, reference), *_restless(run, reference, hurt)]
    found += _swapped(campaign, {name: one for name, one in spectra_by_run.items() if one is not None}, reference, hurt)
    return tuple(found)


def clipped_or_dead(campaign: Campaign, *, reference: str) -> list[Fault]:
    """The faults that each record shows alone, in one pass over it: clipped and dead channels."""
    released = _released(campaign, reference)
    if long := [channel for run in campaign.runs if len(run) > LONGEST for channel in run.sensors.values()]:
        side_by_side(extents, long)
    found = [fault for run in campaign.runs for fault in (*_clipped(run), *_dead(run, reference))]
    return [fault for fault in found if fault.kind != "dead" or (fault.run, fault.channel) not in released]


def _released(campaign: Campaign, reference: str) -> set[tuple[str, str]]:
    # Nothing drives a released run: the record of its drive is silent, and says nothing about a sensor.
    return {(run.id, reference) for run in campaign.runs if run.excitation == "free"}


def sound(runs: Sequence[Run], found: Sequence[Fault], channels: Sequence[str], *, from_rest: bool = False) -> list[Run]:
    """The runs whose channels can be used for an average, or for a simulation `from_rest`; all of them if there are none."""
    kinds = (*SPOILING, "not at rest") if from_rest else SPOILING
    spoilt = {(fault.run, name) for fault in found if fault.kind in kinds for name in fault.channel.split("/")}
    return [run for run in runs if not any((run.id, name) in spoilt for name in (*channels, ""))] or list(runs)


def _clipped(run: Run) -> Iterator[Fault]:
    for name in run.sensors:
        channel = run.channels[name]
        top, unit = channel.full_scale, channel.unit
        if full := sum(each.full for each in extents(channel)):
            text = f"run {run.id!r}: {name} clipped, {full} samples at the end of its range of ±{top:g} {unit}"
        elif (count := plateaus(channel)) >= ROWS:
            text = f"run {run.id!r}: {name} seems clipped, {count} times at its extreme value"
        else:
            continue
        yield Fault(
            run=run.id, channel=name, kind="clipped", text=f"{text}; choose a larger range or a lower gain and measure again."
        )


def _dead(run: Run, reference: str) -> Iterator[Fault]:
    sizes = {name: max(each.std for each in extents(run.channels[name])) for name in run.sensors}
    for name, size in sizes.items():
        kind, unit = run.channels[name].quantity, run.channels[name].unit
        strongest = max(s for other, s in sizes.items() if run.channels[other].quantity == kind)
        low, high = extremes(run.channels[name])
        if low == high or size <= DEAD * strongest:
            # The sum makes -0.0 zero.
            has = f"constant {low + 0.0:.4g} {unit}" if low == high else f"{size:.2g} {unit} rms, the strongest {strongest:.2g}"
            free = ', or state excitation = "free" if nothing drove the rig' if name == reference and low == high else ""
            yield Fault(
                run=run.id, channel=name, kind="dead",
                text=f"run {run.id!r}: {name} is dead ({has}); check its cable and its supply{free}.",
            )  # fmt: skip


def _stuck(run: Run, reference: str) -> Iterator[Fault]:
    # A drive may pause; a sensor on a moving rig cannot. A value at the record's extreme is clipped.
    names = _accelerations(run)
    sizes = {name: max(each.std for each in extents(run.channels[name])) for name in names}
    for name in names:
        if name == reference:
            continue
        ends = extremes(run.channels[name])
        lasting = []
        for row in (row for each in extents(run.channels[name]) for row in each.rows if row.value not in ends):
            stop = row.first + row.length
            others = (run.channels[other].read(row.first, stop).std() / max(sizes[other], 1e-300) for other in names)
            if max(others) > MOVING:
                lasting.append(row.length)
        if lasting:
            yield Fault(
                run=run.id, channel=name, kind="stuck",
                text=f"run {run.id!r}: {name} has a constant value {len(lasting)} times for up to "
                f"{max(lasting) / run.sample_rate:.2g} s while others move; check its connector and its cable and measure again.",
            )  # fmt: skip


def _spikes(run: Run, reference: str) -> Iterator[Fault]:
    if len(run) < QUANTILE:
        return
    for name in run.sensors:
        values, left = _from_neighbours(run, name)
        at, rms = int(np.argmax(left)), float(values.std())
        near = slice(max(at - SPIKE_SAMPLES, 0), at + SPIKE_SAMPLES + 1)
        if name == reference or near.start < AROUND or near.stop > len(values) - AROUND:
            continue
        size, largest = float(left[at]), float(max(left[: near.start].max(), left[near.stop :].max()))
        if size <= max(SPIKE * largest, SPIKY * rms) or np.count_nonzero(left > 0.5 * size) > SPIKE_SAMPLES:
            continue
        before, after = (np.std(part) for part in (values[near.start - AROUND : near.start], values[near.stop :][:AROUND]))
        others = (_from_neighbours(run, other)[1] for other in run.sensors if other != name)
        if before > BEGINS * after and all(other[near].max() <= AGREED * np.quantile(other, MOMENTS) for other in others):
            yield Fault(
                run=run.id, channel=name, kind="spike",
                text=f"run {run.id!r}: {name} has a spike of {size / rms:.2g} times its rms at {at / run.sample_rate:.4g} s that "
                "no other channel shows; check its connector and its cable, and measure again or leave that moment out.",
            )  # fmt: skip


def _from_neighbours(run: Run, name: str) -> tuple[FloatArray, FloatArray]:
    # The values of a channel, and how far each one is from what its neighbours suggest.
    values = run.channels[name].read(0, LONGEST)
    left = np.abs(values - np.convolve(values, NEIGHBOURS, mode="same"))
    left[:2] = left[-2:] = 0.0
    return values, left


def _noisy(campaign: Campaign, hurt: set[tuple[str, str]]) -> Iterator[Fault]:
    # Friction reverses in steps with a broad spectrum; so a channel's floor counts only if another run distinguishes it from
    # friction.
    # The noise of a record, and the record's own rms.
    floors = {
        (run.id, name): (level, extents(run.channels[name])[0].std) for run in campaign.runs for name in _accelerations(run)
        if (run.id, name) not in hurt and (level := noise_level(run, name, longest=ENOUGH)) is not None
    }  # fmt: skip
    names = dict.fromkeys(name for _, name in floors)
    least = {name: min(f for (_, other), (f, _) in floors.items() if other == name) for name in names}
    for run in campaign.runs:
        alike = campaign.select(configuration=run.configuration, gain=run.gain)
        for name in names:
            if (run.id, name) not in floors:
                continue
            floor, size = floors[run.id, name]
            rest = [f for other, f in least.items() if other != name]
            always = len(rest) >= 2 and least[name] > NOISY * float(np.median(rest)) and floor > NOISE_SHARE * size
            same = [floors[r.id, name][0] for r in alike if r.id != run.id and (r.id, name) in floors]
            once = bool(same) and floor > NOISY * min(same) and floor > NOISE_SHARE * size
            usual = min(same) if once else float(np.median(rest)) if rest else floor
            if always or once:
                yield Fault(
                    run=run.id, channel=name, kind="noisy",
                    text=f"run {run.id!r}: {name} is noisy, {floor:.2g} m/s^2 rms where {usual:.2g} is usual "
                    f"({100 * floor / size:.0f} % of its signal); check its cable, its grounding and its range.",
                )  # fmt: skip


def _accelerations(run: Run) -> list[str]:
    return [name for name, channel in run.channels.items() if channel.quantity == "acceleration"]


def _short(run: Run) -> Iterator[Fault]:
    if not broad([run]):
        return
    longest = max((stop - start for start, stop in stretches(run)), default=0) / run.sample_rate
    # Half-overlapping Hann segments of 1 / RESOLUTION seconds.
    averages = max(2.0 * longest * RESOLUTION - 1.0, 0.0)
    if averages < AVERAGES:
        yield Fault(
            run=run.id, channel="", kind="too short",
            text=f"run {run.id!r} is too short: its longest interval without a gap has {longest:.3g} s, {averages:.0f} averages "
            f"with a resolution of {RESOLUTION:g} Hz; measure {(AVERAGES + 1.0) / (2.0 * RESOLUTION):g} s or longer.",
        )  # fmt: skip


@once
def spectra_of_start(run: Run, reference: str, resolution: float = RESOLUTION) -> Spectra | None:
    """The spectra of all sensors over the first `LONGEST` samples of a run; None if it has no such reference or is too short."""
    return _spectra_of(run, reference, resolution)


def _spectra_of(run: Run, reference: str, resolution: float) -> Spectra | None:
    if reference not in run.channels:
        return None
    try:
        return estimate(
            [run], references=[reference], channels=list(run.sensors), resolution=resolution, jackknife=False, longest=LONGEST
        )
    except DataError:
        return None


def _band(run: Run, spectra: Spectra) -> tuple[float, float]:
    low, high = run.band or (4.0 * RESOLUTION, run.sample_rate / 4.0)
    return max(low, 4.0 * spectra.resolution), high


def _holes(run: Run, spectra: Spectra, reference: str) -> Iterator[Fault]:
    low, high = _band(run, spectra)
    if run.band is None:  # what lies beyond the drive is no hole in it
        first, last = spectra.extent(reference)
        low, high = max(low, first), min(high, last)
    kept = (spectra.frequency >= low) & (spectra.frequency <= high)
    if kept.sum() < 10:
        return
    f, density = spectra.frequency[kept], spectra.density(reference)[kept]
    empty = density < HOLE * np.median(density[density >= 1e-3 * density.max()])
    edges = np.flatnonzero(np.diff(empty, prepend=False, append=False))
    if run.band is None:
        of, cure = "; the recording gives no band", "give the band of the run"
    else:
        of, cure = f" of its band ({low:g} to {high:g} Hz)", "excite the whole band or correct the band"
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        if last - first >= WIDE * len(f):
            yield Fault(
                run=run.id, channel=reference, kind="no drive",
                text=f"run {run.id!r}: the drive has no power from {f[first]:.4g} to {f[last - 1]:.4g} Hz{of}, so nothing is "
                f"known there; {cure}.",
            )  # fmt: skip


def _restless(run: Run, reference: str, hurt: set[tuple[str, str]]) -> Iterator[Fault]:
    # The response explained by the drive through the run's own impulse response, from rest; motion from before the start remains.
    # The first second of a sweep has frequencies that come never again, and so another error; a record of whole periods is cut
    # out of a steady motion.
    if run.excitation == "sweep" or run.period is not None:
        return
    spectra = _spectra_of(run, reference, max(FINE, SEGMENTS / run.duration))
    if spectra is None:
        return
    second, drive = round(run.sample_rate), run.channels[reference].read(0, LONGEST)
    if len(drive) < 6 * second:
        return
    names = [name for name in run.sensors if name != reference and (run.id, name) not in hurt]
    worst: list[tuple[float, str]] = []
    low, high = _band(run, spectra)
    kept = (spectra.frequency >= low) & (spectra.frequency <= high)
    drive -= drive.mean()
    ahead = (len(spectra.frequency) - 1) // 4
    for name in names:
        values = run.channels[name].read(0, LONGEST)
        if np.std(values[:second]) <= STILL * np.std(values):
            continue
        values -= values.mean()
        taps = np.roll(np.fft.irfft(np.where(kept, spectra.frf(name, reference).value, 0.0)), ahead)
        ratio = 0.0
        # The start of the record excludes most channels in less time.
        for length in (4 * second, len(values)):
            left = values[:length] - _convolved(drive[: length + ahead], taps[: length + ahead])[ahead : ahead + length]
            powers = np.mean(left[: length // second * second].reshape(-1, second) ** 2, axis=1)
            # Edge effects at the end are as large as at the start.
            ratio = float(powers[0] / max(powers[2:-1].max(), np.finfo(float).tiny))
            if ratio <= START or powers[0] <= START_SHARE * np.mean(values**2):
                break
        else:
            worst.append((ratio, name))
    # A single channel may have slid once; motion from before the start appears in several.
    if len(worst) >= min(2, len(names)) > 0:
        ratio, name = max(worst)
        yield Fault(
            run=run.id, channel="", kind="not at rest",
            text=f"run {run.id!r} did not start at rest: in its first second {name} has {np.sqrt(ratio):.1f} times more motion "
            "not caused by the drive than ever later; start the record before the drive, or let the rig come to rest.",
        )  # fmt: skip


def _convolved(drive: FloatArray, taps: FloatArray) -> FloatArray:
    # A length with small factors, for a quick transform.
    padded = -(-(len(drive) + len(taps)) // 4096) * 4096
    return np.asarray(np.fft.irfft(np.fft.rfft(drive, padded) * np.fft.rfft(taps, padded), padded))


def _swapped(
    campaign: Campaign, spectra_by_run: dict[str, Spectra], reference: str, hurt: set[tuple[str, str]]
) -> Iterator[Fault]:
    runs = [run for run in campaign.runs if run.id in spectra_by_run]
    for run in runs:
        names = [name for name in run.sensors if (run.id, name) not in hurt]
        others = [
            other for other in runs if other.id != run.id and other.configuration == run.configuration
            and set(names) <= set(other.sensors) and not any((other.id, name) in hurt for name in names)
        ]  # fmt: skip
        pairs = [(a, b) for k, a in enumerate(names) for b in names[k + 1 :]]
        found = [pair for pair in pairs if _nearer(run, others, spectra_by_run, pair, reference)] if len(others) >= 2 else []
        found = found or [pair for pair in pairs if _upside_down(run, campaign, spectra_by_run[run.id], pair)]
        for a, b in found[:1]:
            yield Fault(
                run=run.id, channel=f"{a}/{b}", kind="swapped",
                text=f"run {run.id!r}: {a} and {b} seem swapped, the run agrees with the others and with the rig only with both "
                "exchanged; check the cables or rename the channels.",
            )  # fmt: skip


def _nearer(run: Run, others: Sequence[Run], spectra_by_run: dict[str, Spectra], pair: tuple[str, str], reference: str) -> bool:
    # Whether the run is close to the others (most of them) with two channels exchanged, and far from them as it is.
    as_is: list[float] = []
    exchanged: list[float] = []
    for other in others:
        low = max(_band(run, spectra_by_run[run.id])[0], _band(other, spectra_by_run[other.id])[0])
        high = min(_band(run, spectra_by_run[run.id])[1], _band(other, spectra_by_run[other.id])[1])
        lines, _ = common_bins((spectra_by_run[run.id], spectra_by_run[other.id]))
        lines = lines[(lines >= low) & (lines <= high)]
        if len(lines) < 8:
            continue
        names = list(run.sensors)
        turned = {pair[0]: pair[1], pair[1]: pair[0]}
        own, theirs = (
            np.stack([np.interp(lines, one.frequency, np.log(one.density(n) + 1e-300)) for n in names])
            for one in (spectra_by_run[run.id], spectra_by_run[other.id])
        )
        mixed = own[[names.index(turned.get(n, n)) for n in names]]
        base = names.index(reference)
        for store, rows in ((as_is, own), (exchanged, mixed)):
            store.append(float(np.mean(np.abs((rows - rows[base]) - (theirs - theirs[base])))))
    if len(as_is) < 2:
        return False
    far, near = float(np.median(as_is)), float(np.median(exchanged))
    return far > FAR and near * NEARER < far


def _upside_down(run: Run, campaign: Campaign, spectra: Spectra, pair: tuple[str, str]) -> bool:
    # Three masses in a line: the heatblock moves more than the table around its own resonance, never less throughout.
    if set(pair) != {"table", "heatblock"}:
        return False
    guess = campaign.known.get("heatblock_frequency")
    if guess is None or run.band is None or run.band[1] < 1.3 * guess:
        return False
    near = (spectra.frequency > 0.75 * guess) & (spectra.frequency < 1.3 * guess)
    ratio = 0.5 * np.log(spectra.density("heatblock")[near] / np.maximum(spectra.density("table")[near], 1e-300))
    return bool(-ratio.min() > np.log(3.0) and ratio.max() < 0.3 * -ratio.min())


def without(campaign: Campaign, found: Sequence[Fault], channels: Sequence[str], *, from_rest: bool = False) -> Campaign:
    """The campaign without its faulty runs (see `sound`); a configuration without other runs keeps them."""
    kept: list[Run] = []
    for configuration in dict.fromkeys(run.configuration for run in campaign.runs):
        kept += sound(campaign.select(configuration=configuration), found, channels, from_rest=from_rest)
    return replace(campaign, runs=tuple(run for run in campaign.runs if run in kept))
