"""Evidence from the records before any cause is fitted: over frequency, gain and time, and in the force of the isolation.

Every quantity is determined twice, from the record and from the fitted baseline's simulation with the same drive: estimation
errors cancel, and only a difference is a sign.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from isorig.analysis.campaign import BROAD, Campaign, FloatArray
from isorig.analysis.diagnose.causes import supported
from isorig.analysis.diagnose.causes.base import SignKind
from isorig.analysis.diagnose.estimate_pairs import Double, Doubles, Group, Lines
from isorig.analysis.diagnose.observe import flat_tops, mains, peaks_of
from isorig.analysis.diagnose.surface import Surface, surface_of
from isorig.analysis.errors import DataError
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.model.rig_model import GROUND, RigModel
from isorig.analysis.spectra.periodic import periodic
from isorig.analysis.spectra.quality import faults
from isorig.analysis.spectra.welch import estimate
from isorig.analysis.wording import MULTIPLE, as_difference, of_signal, with_article, with_std

#: Standard errors above which a quantity is a sign, and the share below which it is too small to be one.
SURE, SMALL = 4.0, 0.004
#: Required difference of two transfer functions in multiples of the random error.
APART = 2.0
#: Factor by which a difference at one frequency must exceed that elsewhere to indicate a mode. Chosen.
NARROW = 5.0
#: Relative difference of two transfer functions that is reported: three times the smallest sign.
LEAST = 3 * SMALL
#: Agreement is only meaningful if a difference of this size would be detected. Chosen: relevant nonlinear causes change the ratio
#: measured/simulated by more.
RESOLVED = 0.1
#: Ratio of the whole misfit to its drive-related part above which most of it is nonlinear or noise.
MOSTLY = 2.0
#: Shortest delay that is a sign, s: a hundredth of a sample at 1 kHz. Chosen.
BRIEFEST = 1e-5
#: Coherence above which two channels move as one rigid body, and frequency bins needed for such a comparison. Chosen.
RIGID, FEW_LINES = 0.9, 5
#: Allowed variation of a constant ratio, as a share of its distance from 1; share of the phase's power that a linear phase must
#: explain. Chosen: a wrong sensitivity or a delay has the same effect at every frequency, a wrong mass or spring does not.
UNEVEN, STRAIGHT = 0.3, 0.7
#: Frequency bins needed to detect a narrow difference. Chosen.
MANY_LINES = 20
#: Ratio of the errors of two configurations above which the cause is in what only one of them moves. Chosen.
ONE_SIDED = 3.0
#: Change of stiffness over the swing, and of friction as a share of the sliding force, that is reported. Chosen.
RISE, UNLIKE = 0.02, 0.03
#: Ratio of distortion to noise that is a sign of a nonlinearity. Chosen.
DISTORTED = 3.0
Groups = Mapping[tuple[str, float], Group]


@dataclass(frozen=True, kw_only=True)
class Sign:
    """One sign in the records."""

    text: str  #: A sentence with numbers.
    #: Supported causes, each at a place ("" if the sign does not determine the place).
    supported: tuple[tuple[str, str], ...] = ()

    def supports(self, cause: str, location: str) -> bool:
        """Whether it supports this cause at this place."""
        return any(name == cause and place in ("", location) for name, place in self.supported)


def signs(campaign: Campaign, model: RigModel, trials: Sequence[Trial], compared: Doubles) -> tuple[Sign, ...]:
    """All signs of a campaign compared with a fitted model; for a rig that is judged by its drive, those of the records alone."""
    pairs, groups = compared.pairs, compared.groups
    return (
        *record_signs(campaign, model, trials), *_rigid_bodies(model, pairs), *_chains(model, groups), *poles(model, groups),
        *_configurations(model, pairs), *_gains(model, groups), *_time(model, groups), *_surfaces(model, compared),
        *_periods(model, pairs),
    )  # fmt: skip


def record_signs(campaign: Campaign, model: RigModel, trials: Sequence[Trial]) -> tuple[Sign, ...]:
    """The signs of the records alone: bad data, starts in motion, flat tops, hum."""
    moving = sum(trial.moving is not None for trial in trials)
    starts = [
        Sign(
            text=f"Start: {moving} of {len(trials)} runs begin in motion (their first records do not follow from the drive), so "
            "the simulation begins in the state that their first period shows."
        )
    ]
    flat = [
        Sign(
            text=f"Flat tops: {with_article(name)} is cut off at its largest magnitude, {limit:.4g}, like a clipped record.",
            supported=supported("flat tops", name),
        )
        for name, limit in flat_tops(campaign, peaks_of(campaign)).items()
    ]
    hums = [
        Sign(
            text=f"Spectral peaks: in most runs the residual of {with_article(name)} has peaks at {frequency:g} Hz and its "
            "multiples.",
            supported=supported("hum", name),
        )
        for name, frequency in mains(model, trials).items()
    ]
    bad = [Sign(text=fault.text) for fault in faults(campaign, reference=model.drive.channel) if fault.kind != "clipped"]
    return (*bad, *(starts if moving else ()), *flat, *hums)


def _mean(values: FloatArray, std: FloatArray) -> tuple[float, float]:
    # Weighted mean with a standard deviation that increases if the values disagree by more than their own.
    weight = 1.0 / np.maximum(std, 1e-6) ** 2
    mean = float(np.average(values, weights=weight))
    chi = float(np.average((values - mean) ** 2, weights=weight) * weight.mean())
    return mean, float(np.sqrt(max(chi, 1.0) / weight.sum()))


def _slope(f: FloatArray, phase: FloatArray, std: FloatArray) -> tuple[float, float, float]:
    # Delay in s from a phase proportional to frequency, its standard deviation, and the share of the phase's power it explains.
    omega = 2 * np.pi * f
    weight = 1.0 / np.maximum(std, 1e-6) ** 2
    power = float((weight * omega**2).sum())
    delay = -float((weight * omega * phase).sum()) / power
    left = phase + omega * delay
    chi = float(np.mean(weight * left**2))
    explained = 1.0 - float((weight * left**2).sum()) / max(float((weight * phase**2).sum()), 1e-300)
    return delay, float(np.sqrt(max(chi, 1.0) / power)), explained


def _rigid_bodies(model: RigModel, pairs: Sequence[Double]) -> list[Sign]:
    # Bodies connected by a lock must agree in amplitude and phase, for any model.
    found = []
    at = {s.body: s.channel for s in model.sensors if s.relative_to == GROUND and s.quantity == "acceleration"}
    for name, setup in model.configurations.items():
        runs = [p.measured for p in pairs if p.trial.run.configuration == name and p.trial.run.excitation in BROAD]
        for link in (model.link(rigid) for rigid in setup.rigid if any(x.name == rigid for x in model.links)):
            if not runs or link.a not in at or link.b not in at:
                continue
            one, other = at[link.a], at[link.b]
            values, stds, phases, fs = [], [], [], []
            for run in runs:
                frf = estimate([run], references=[other], channels=[one], resolution=1.0, jackknife=False).frf(one, other)
                low, high = run.band or (1.0, run.sample_rate / 2.56)
                kept = (frf.coherence > RIGID) & (frf.frequency >= low) & (frf.frequency <= high)
                values.append(np.abs(frf.value[kept]))
                stds.append(frf.phase_std[kept])
                phases.append(np.angle(frf.value[kept]))
                fs.append(frf.frequency[kept])
            value, std, phase, f = (np.concatenate(parts) for parts in (values, stds, phases, fs))
            if len(f) < FEW_LINES:
                continue
            ratio, error = _mean(value, std)
            delay, late, _ = _slope(f, phase, std)
            share = np.abs(value - ratio).mean()
            off, shifted = abs(ratio - 1.0) > max(SURE * error, SMALL), abs(delay) > max(SURE * late, BRIEFEST)
            text = (
                f"Rigid bodies: {name}, {one} and {other} must move as one; amplitude ratio {with_std(ratio, error)}, "
                f"{_late(one, delay, late)}"
            )
            if not off and not shifted and share < LEAST:
                found.append(Sign(text=text + ": they agree."))
                continue
            causes = supported("lock", "lock")
            causes += supported("ratio of rigid bodies", one, other) if off else ()
            causes += supported("delay", one, other) if shifted else ()
            found.append(Sign(text=text + ": one of the sensors, or the lock, is faulty.", supported=causes))
    return found


def _chains(model: RigModel, groups: Groups) -> list[Sign]:
    # A sensor fault is the same in every run: a constant ratio, or a linear phase.
    found = []
    for sensor in model.sensors:
        each = [x for group in groups.values() if (x := group.lines(sensor.channel))]
        if not each:
            continue
        levels = np.array([_mean(np.abs(x.ratio), np.hypot(x.std, SMALL)) for x in each])
        level, error = _mean(levels[:, 0], np.maximum(levels[:, 1], 1e-5))
        bent = max(float(np.abs(np.abs(x.ratio) - level).mean()) for x in each)
        if abs(level - 1.0) > max(SURE * error, SMALL) and bent < UNEVEN * abs(level - 1.0):
            found.append(
                Sign(
                    text=f"Constant ratio: the recorded {sensor.channel} is {with_std(level, error)} times the simulated one, "
                    "the same in all runs and frequency bins.",
                    supported=supported("constant ratio", sensor.channel),
                )
            )
        ratios = np.concatenate([x.ratio for x in each])
        stds = np.concatenate([np.hypot(x.std, SMALL) for x in each])
        f = np.concatenate([x.frequency for x in each])
        delay, late, explained = _slope(f, np.angle(ratios), stds)
        if abs(delay) > max(SURE * late, BRIEFEST) and explained > STRAIGHT:
            found.append(
                Sign(
                    text=f"Linear phase: the phase of {sensor.channel} relative to the simulation is proportional to frequency, "
                    f"{_late(sensor.channel, delay, late)}.",
                    supported=supported("delay", sensor.channel, model.drive.channel),
                )
            )
    return found


def _late(channel: str, delay: float, std: float) -> str:
    # A delay in s and its standard deviation.
    return f"{channel} {with_std(abs(delay) * 1e3, std * 1e3)} ms {'late' if delay >= 0.0 else 'early'}"


def poles(model: RigModel, groups: Groups) -> list[Sign]:
    """A further mode appears as a difference between measured and simulated near one frequency and little elsewhere."""
    found = []
    bodies = {s.channel: s.body for s in model.sensors}
    for sensor in model.sensors:
        best: tuple[float, float, float] | None = None
        for group in groups.values():
            seen = group.lines(sensor.channel)
            if seen is None or len(seen.frequency) < MANY_LINES:
                continue
            # Relative to the larger of the two: the simulated one may be close to zero between two modes.
            share = np.abs(seen.measured - seen.simulated) / np.maximum(np.abs(seen.measured), np.abs(seen.simulated))
            off = share / np.hypot(seen.std, SMALL)
            k = int(np.argmax(np.convolve(off, np.ones(3) / 3.0, mode="same")))
            size, rest = float(share[k]), float(np.median(share))
            if off[k] > 2 * SURE and size > max(NARROW * rest, LEAST) and (best is None or size > best[1]):
                best = float(seen.frequency[k]), size, rest
        if best is not None:
            place = bodies[sensor.channel]
            found.append(
                Sign(
                    text=f"Poles: near {best[0]:.4g} Hz the measured and simulated transfer functions of "
                    f"{with_article(sensor.channel)} "
                    f"differ by {100 * best[1]:.0f} % of the larger one, elsewhere by {100 * best[2]:.2g} %: a mode that the "
                    "model lacks or has at another frequency.",
                    supported=supported("mode", place),
                )
            )
    return found


def _misfit(pairs: Sequence[Double]) -> float:
    # rms of the simulation's error over rms of the signal, the median over runs and channels.
    shares = [
        np.std(p.simulated.read(n) - p.measured.read(n)) / max(float(np.std(p.measured.read(n))), 1e-30)
        for p in pairs
        for n in p.trial.channels
    ]
    return float(np.median(shares))


def _configurations(model: RigModel, pairs: Sequence[Double]) -> list[Sign]:
    names = list(dict.fromkeys(p.trial.run.configuration for p in pairs))
    if len(names) < 2:
        return []
    error = {name: _misfit([p for p in pairs if p.trial.run.configuration == name]) for name in names}
    shares = ", ".join(f"{name} {of_signal(e)}" for name, e in error.items())
    text = f"Configurations: error of the fitted baseline {shares}"
    blocks = {name: set(model.configurations[name].rigid) for name in names}
    pair = next(((free, held) for free in names for held in names if blocks[free] < blocks[held]), None)
    if pair is None or max(error[name] for name in pair) < LEAST:
        return [Sign(text=text + ".")]
    free, held = pair
    if error[free] > ONE_SIDED * error[held]:
        causes = supported("blocked by the lock", *sorted(blocks[held] - blocks[free]))
        return [Sign(text=text + f": the error is in a part that moves only when {free}.", supported=causes)]
    if error[held] > ONE_SIDED * error[free]:
        return [Sign(text=text + f": the error is larger when {held}.", supported=supported("lock", "lock"))]
    return [Sign(text=text + ": the error is present in both.")]


def _apart(one: Lines | None, other: Lines | None) -> float:
    # Distance of two ratios to the simulation, rms over their common frequency bins; NaN if they have none.
    if one is None or other is None:
        return np.nan
    f, i, j = np.intersect1d(np.round(one.frequency, 6), np.round(other.frequency, 6), return_indices=True)
    if len(f) < 3:
        return np.nan
    weight = 1.0 / np.maximum(np.hypot(one.std[i], other.std[j]), SMALL) ** 2
    return float(np.sqrt(np.average(np.abs(one.ratio[i] - other.ratio[j]) ** 2, weights=weight)))


def _compared(one: Group, other: Group, response: str) -> tuple[float, float] | None:
    # Distance of two groups of runs relative to the simulation, and its random error; None if that is unknown.
    apart = _apart(one.lines(response), other.lines(response))
    by_half = ([half.lines(response) for half in group.halves] for group in (one, other))
    noise = float(np.linalg.norm([_apart(first, second) / 2.0 for first, second in by_half]))
    return (apart, noise) if np.isfinite(apart) and np.isfinite(noise) else None


def _differ(apart: float, noise: float) -> bool:
    return apart > max(APART * noise, LEAST)


def _gains(model: RigModel, groups: Groups) -> list[Sign]:
    found = []
    for name in dict.fromkeys(configuration for configuration, _ in groups):
        gains = sorted((g for c, g in groups if c == name), reverse=True)
        if len(gains) < 2:
            continue
        seen = [
            (f"{sensor.channel} between gains {high:g} and {low:g} by {as_difference(pair[0])}", *pair)
            for high, low in pairwise(gains)
            for sensor in model.sensors
            if (pair := _compared(groups[name, high], groups[name, low], sensor.channel)) is not None
        ]
        own = [group for (c, _), group in groups.items() if c == name]
        found.append(homogeneity(name, gains, seen, _misfit([p for group in own for p in group.pairs]), _linear(model, own)))
    # An amplitude dependence within one configuration is nonlinear, even if others show none.
    changes = any(sign.supported == supported("amplitude") for sign in found)
    linear = supported("independent of amplitude")
    return [Sign(text=sign.text) if changes and sign.supported == linear else sign for sign in found]


def _linear(model: RigModel, groups: Sequence[Group]) -> float:
    # The drive-related part of the misfit, as a share of the signal: the median over groups and channels.
    seen = [lines for group in groups for sensor in model.sensors if (lines := group.lines(sensor.channel)) is not None]
    shares = [float(np.linalg.norm(x.simulated - x.measured) / np.linalg.norm(x.measured)) for x in seen]
    return float(np.median(shares)) if shares else 0.0


def homogeneity(
    name: str, gains: Sequence[float], seen: Sequence[tuple[str, float, float]], misfit: float, linear: float
) -> Sign:
    """Conclusion from the comparison of transfer functions at several gains in a configuration.

    Parameters
    ----------
    name
        The configuration.
    gains
        Its drive gains.
    seen
        For each channel and pair of gains that could be compared: the difference in words, its size (measured/simulated, as a
        share), and its random error.
    misfit, linear
        The simulation's whole error, and its drive-related part, as shares of the signal.
    """
    levels = ", ".join(f"{gain:g}" for gain in gains)
    moved = [words for words, apart, noise in seen if _differ(apart, noise)]
    if moved:
        text = (
            f"the ratio measured/simulated changes with the drive gain ({'; '.join(moved[:3])}): the misfit depends on amplitude."
        )
        return Sign(text=f"Homogeneity: {name}, {text}", supported=supported("amplitude"))
    within = max((max(apart, APART * noise) for _, apart, noise in seen), default=np.inf)
    if not within <= RESOLVED:
        known = "no common frequency bins" if not seen else f"a difference below {as_difference(within)} would not be detected"
        text = f"gains {levels} cannot be compared ({known}), so whether the misfit depends on the amplitude is not known."
        return Sign(text=f"Homogeneity: {name}, {text}")
    text = (
        f"the ratio measured/simulated agrees at gains {levels} to within {100 * within:.2g} %: in the drive-related frequency "
        "bins the misfit does not depend on the amplitude"
    )
    if misfit > MOSTLY * max(linear, LEAST):
        return Sign(text=f"Homogeneity: {name}, {text}; but most of the misfit is not related to the drive, so it is not linear.")
    text += "."
    return Sign(text=f"Homogeneity: {name}, {text}", supported=supported("independent of amplitude"))


def _time(model: RigModel, groups: Groups) -> list[Sign]:
    found = []
    for (name, gain), group in groups.items():
        if len(group.pairs) < 2:
            continue
        first, last = group.pairs[0], group.pairs[-1]
        minutes = (last.trial.start_time - first.trial.start_time) / 60.0
        differences, within = [], 0.0
        for sensor in model.sensors:
            off = _compared(Group((first,)), Group((last,)), sensor.channel)
            if off is None:
                continue
            within = max(within, off[0], APART * off[1])
            if _differ(*off):
                differences.append(f"{sensor.channel} {as_difference(off[0])} (random error {as_difference(off[1])})")
        where = f"Repeatability: {name} at gain {gain:g}, {first.trial.run.id} and {last.trial.run.id}, {minutes:.3g} min apart,"
        if differences:
            text = (
                f"{where} differ by more than the random error ({', '.join(differences)}): the rig has changed in between, or "
                "its response does not repeat."
            )
            found.append(Sign(text=text, supported=supported("time")))
        elif 0.0 < within <= RESOLVED:
            found.append(Sign(text=f"{where} agree to within {100 * within:.2g} %: no change of the rig was detected."))
        elif 0.0 < within < MULTIPLE:
            text = f"a change of the rig below {as_difference(within)} would not be detected"
            found.append(Sign(text=f"{where} agree within the random error; {text}."))
    return found


def _surfaces(model: RigModel, compared: Doubles) -> list[Sign]:
    return [sign for surface in surfaces(model, compared) for sign in (*_bends(surface), *_rubs(surface))]


def surfaces(model: RigModel, compared: Doubles) -> tuple[Surface, ...]:
    """The restoring-force surface of every observable link: from its run at the highest gain with motion near its frequency."""
    found = []
    for link in model.links:
        mass = min(model.body(end).mass for end in (link.a, link.b) if end != GROUND)
        own = np.sqrt(max(link.stiffness, 0.0) / mass) / (2 * np.pi)
        for (name, _), group in sorted(compared.groups.items(), key=lambda item: -item[0][1]):
            low, high = group.pairs[0].trial.run.band or (0.0, np.inf)
            if link.name not in model.configurations[name].rigid and low <= own <= high:
                surface = surface_of(model, link, group.pairs[0])
                if surface is not None:
                    found.append(surface)
                break
    return tuple(found)


def _bends(surface: Surface) -> list[Sign]:
    rise, error = surface.stiffening
    where = f"{surface.link} spring"
    ends = f"{surface.stiffness[1]:.4g} N/m near the middle and {surface.stiffness[-1]:.4g} N/m at ±{1e3 * surface.swing:.2g} mm"
    if not abs(rise) > max(SURE * error, RISE):
        return []
    verb: SignKind = "stiffens" if rise > 0.0 else "softens"
    return [
        Sign(
            text=f"Restoring force: the {where} {verb} with its swing by {with_std(100 * abs(rise), 100 * error)} % beyond the "
            f"baseline ({ends}).",
            supported=supported(verb, surface.link),
        )
    ]


def _rubs(surface: Surface) -> list[Sign]:
    found = []
    (ways, ways_std), (bend, bend_std) = surface.direction, surface.bending
    least = UNLIKE * max(abs(surface.friction), 1e-9)
    if abs(ways) > max(SURE * ways_std, least):
        found.append(
            Sign(
                text=f"Friction force: at the {surface.link} the force at high velocity is {with_std(abs(ways), ways_std)} N "
                "larger in one direction than in the other, beyond the baseline.",
                supported=supported("uneven directions", surface.link),
            )
        )
    if abs(bend) > max(SURE * bend_std, least):
        more = "larger" if bend > 0.0 else "smaller"
        kind: SignKind = "more at low and high velocity" if bend > 0.0 else "less at low and high velocity"
        found.append(
            Sign(
                text=f"Friction force: at the {surface.link} friction is {with_std(abs(bend), bend_std)} N {more} at low and "
                "high than at medium velocity, beyond the baseline.",
                supported=supported(kind, surface.link),
            )
        )
    return found


def _periods(model: RigModel, pairs: Sequence[Double]) -> list[Sign]:
    runs = [p.measured for p in pairs if p.trial.run.period is not None]
    if not runs:
        if pairs and all(p.trial.run.excitation == "free" for p in pairs):
            return []
        return [
            Sign(
                text="Periods: no run has a periodic drive, so distortion cannot be separated from noise; the cause is "
                "identified from gains, configurations and held-out segments only."
            )
        ]
    found = []
    for gain in sorted({run.gain for run in runs}, reverse=True):
        group = [run for run in runs if run.gain == gain and run.configuration == runs[0].configuration]
        for sensor in model.sensors:
            try:
                frf = periodic(group, response=sensor.channel, reference=model.drive.channel)
            except DataError:
                continue
            size = float(np.median(np.abs(frf.value)))
            noise, known = float(np.median(frf.noise)) / size, frf.distortion[np.isfinite(frf.distortion)]
            if len(known):  # needs more than one realization
                bent = float(np.median(known)) / size
                found.append(
                    Sign(
                        text=f"Periods: {group[0].configuration} at gain {gain:g} the distortion of "
                        f"{with_article(sensor.channel)} is "
                        f"{100 * bent:.2g} % of the signal, its noise {100 * noise:.2g} %.",
                        supported=supported("amplitude") if bent > DISTORTED * noise else (),
                    )
                )
    return found
