"""Data for the proposal of candidates: swings of the links, properties of the records, frequencies of the misfit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import msgspec
import numpy as np

from isorig.analysis.campaign import Campaign
from isorig.analysis.diagnose.causes.base import Evidence
from isorig.analysis.diagnose.link_force import LinkForce, link_force
from isorig.analysis.fitting.trials import Trial, expected, true_motion
from isorig.analysis.model.rig_model import GROUND, Link, RigModel, weights_by_body
from isorig.analysis.rounding import deviation_by_median
from isorig.analysis.simulate import simulate
from isorig.analysis.simulate.gauges import DEFLECTION, SPEED, link_sensors
from isorig.analysis.spectra.hum import hum, mains_in
from isorig.analysis.spectra.motion import motion_of
from isorig.analysis.spectra.overload import cut_off, noisy_limit

#: A record that is cut off within this share of its largest magnitude this many times, for this many samples in total, has flat
#: tops if that many times more of its magnitudes are there than within the same distance below. Chosen: of the crests of a sine
#: 2.4 times as many are, of the largest values of noise fewer; a body that stops once is at rest, not at a limit.
FLAT_SHARE, FLAT_ROWS, FLAT_SAMPLES, PILE = 2e-4, 3, 12, 5.0
#: A measured swing is a link's own if it exceeds integrated noise by this factor, and this share of its ends' motion: calibration
#: errors of two sensors that move together cause a few per cent of it. Chosen.
CLEAR_OF_NOISE, OWN = 10.0, 0.2
#: Points for a spring's nonlinear force from a record.
SKETCHED = 49
#: Share of a band's signal that counts as noise in the search for peaks of the misfit; frequency bins needed in a band; minimum
#: distance of two peaks in octaves. Chosen.
PEAK_NOISE, PEAK_LINES, PEAKS_APART = 0.02, 4, 0.3
#: Variation of the mains frequency within a session, Hz: the largest steady deviation in the European grid.
WANDERS = 0.2


def observe(
    campaign: Campaign, model: RigModel, trials: Sequence[Trial], described: RigModel, guess: RigModel
) -> Evidence:  # fmt: skip
    """Evidence from the data, compared with the fitted baseline, with the description, and with the rig before the fit."""
    deflection, speed = swings(model, trials)
    rate = trials[0].sample_rate
    last = session_end(trials)
    peaks = peaks_of(campaign)
    return Evidence(
        deflection=deflection, speed=speed, sample_rate=rate, end_time=last, peak=peaks,
        flat_tops=flat_tops(campaign, peaks), mains=mains(model, trials), misfit_frequencies=misfit_frequencies(model, trials),
        forces=forces(model, trials, deflection), push=push_of([model, described, guess], trials, peaks, deflection),
        described=described, guess=guess, configurations=frozenset(t.run.configuration for t in trials),
    )  # fmt: skip


def session_end(trials: Sequence[Trial]) -> float:
    """Seconds from the campaign's first sample to its end: that of the last run, plus the usual pause.

    0 where nothing drives the runs and their start times are not known: in a decay a change in time is one with the amplitude.
    """
    if len({trial.start_time for trial in trials}) < 2 and not any(trial.excitation.recorded.any() for trial in trials):
        return 0.0
    spans = sorted((t.start_time, t.start_time + t.samples / t.sample_rate) for t in trials)
    pauses = [start - end for (_, end), (start, _) in pairwise(spans) if start >= end]
    return spans[-1][1] + (float(np.median(pauses)) if pauses else 0.0)


def peaks_of(campaign: Campaign) -> dict[str, float]:
    """Largest recorded magnitude of each channel."""
    peaks: dict[str, float] = {}
    for run in campaign.runs:
        for name in run.channels:
            peaks[name] = max(peaks.get(name, 0.0), float(np.abs(run.read(name)).max()))
    return peaks


def forces(model: RigModel, trials: Sequence[Trial], swing: Mapping[str, float]) -> dict[str, LinkForce]:
    """Each link's force from the record with the largest motion, if it is known."""
    found: dict[str, LinkForce] = {}
    for link in model.links:
        free = [t for t in trials if link.name not in model.configurations[t.run.configuration].rigid and t.motion is None]
        if not free or link.stiffness <= 0.0:
            continue
        strongest = max(free, key=lambda trial: float(np.mean(trial.measured**2)))
        force = link_force(model, link, strongest.run, swing[link.name] * np.linspace(-1.0, 1.0, SKETCHED))
        if force is not None:
            found[link.name] = force
    return found


def push_of(
    models: Sequence[RigModel], trials: Sequence[Trial], peaks: Mapping[str, float], deflection: Mapping[str, float]
) -> float:
    """Largest force in N of the drive on a body; of a spring where a motion is imposed, or nothing drives the rig.

    A spring at an imposed motion counts with the measured deflection, though that may be the sensors' calibration error, and with
    its largest stiffness: one that was fitted without the force that strains it is too soft. The first model is the rig as
    fitted; the others have other values of its springs.
    """
    model = models[0]
    drive = model.drive
    shares = [abs(share) for share in drive.pushes.values()]
    pushes = abs(drive.factor) * max(shares, default=0.0) * peaks.get(drive.channel, 0.0)
    if pushes > 0.0:
        return pushes
    forces = [link.stiffness * deflection[link.name] for link in model.links]
    for link in (link for link in model.links if {link.a, link.b} & set(model.imposed)):
        stiffness = max(other.stiffness for one in models for other in one.links if other.name == link.name)
        found = (_measured_swing(model, link, trial) for trial in trials)
        forces += [stiffness * swing.most[1] for swing in found if swing is not None]
    return max(forces, default=0.0)


def swings(model: RigModel, trials: Sequence[Trial]) -> tuple[dict[str, float], dict[str, float]]:
    """Largest relative displacement (m) and velocity (m/s) of each link.

    Measured by the sensors at its ends, integrated in the frequency domain above the drive's lowest frequency, if it clearly
    exceeds integrated noise and the sensors' calibration errors. Otherwise the smaller of that and the model's: integrated noise
    is large compared with a stiff link's swing, and a model may swing too far.
    """
    deflection: dict[str, float] = {}
    speed: dict[str, float] = {}
    for trial in trials:
        for link, simulated in _simulated_swings(model, trial).items():
            found = _measured_swing(model, model.link(link), trial)
            for k, most in enumerate((speed, deflection)):
                value = simulated[k] if found is None else found.most[k] if found.clear else min(simulated[k], found.most[k])
                if 0.0 < value < np.inf:  # two records of one motion say nothing about the link, nor does an unmeasured one
                    most[link] = max(most.get(link, 0.0), value)
    largest = max(deflection.values(), default=1e-3), max(speed.values(), default=1e-1)
    for link in (link.name for link in model.links):
        deflection.setdefault(link, largest[0])
        speed.setdefault(link, largest[1])
    return deflection, speed


def _simulated_swings(model: RigModel, trial: Trial) -> dict[str, tuple[float, float]]:
    # Largest velocity and displacement of each link that is free in this run; unbounded if the body's motion was measured.
    free = [link for link in model.links if link.name not in model.configurations[trial.run.configuration].rigid]
    if trial.motion is not None:
        return {link.name: (np.inf, np.inf) for link in free}
    gauges = link_sensors(free)
    seen = simulate(
        msgspec.structs.replace(model, sensors=(*model.sensors, *gauges)), trial.excitation,
        configuration=trial.run.configuration, start_time=trial.start_time, start=trial.start_of(model),
    ).channels  # fmt: skip
    most = {gauge.channel: float(np.abs(seen[gauge.channel]).max()) for gauge in gauges}
    return {link.name: (most[SPEED + link.name], most[DEFLECTION + link.name]) for link in free}


@dataclass(frozen=True)
class _Measured:
    # Largest velocity and displacement between a link's ends, and whether they are the link's own motion.
    most: tuple[float, float]
    clear: bool


def _measured_swing(model: RigModel, link: Link, trial: Trial) -> _Measured | None:
    # From the motion at the link's ends and arms; None if one is not measured.
    weights = weights_by_body(model, link)
    noise = 0.0
    if trial.motion is not None:
        if any(body not in trial.motion.velocity for body in weights):
            return None
        moves = [(w * trial.motion.velocity[body], w * trial.motion.position[body]) for body, w in weights.items()]
    else:
        sensors = {s.body: s for s in model.sensors if s.relative_to == GROUND}
        given = {
            drive.imposes: motion_of(record.recorded, drive.quantity, trial.sample_rate, trial.run.band)
            for drive, record in zip(model.drives, (trial.excitation, *trial.excitation.others), strict=True)
            if drive.imposes is not None
        }
        if any(body not in sensors and body not in given for body in weights):
            return None
        moves = []
        for body, w in weights.items():
            if body in given:
                moves.append((w * given[body][0], w * given[body][1]))
                continue
            sensor = sensors[body]
            row = trial.channels.index(sensor.channel)
            moves.append(motion_of(w * trial.measured[row], sensor.quantity, trial.sample_rate, trial.run.band))
            random = np.random.default_rng(row).normal(0.0, abs(w) * trial.noise[row], trial.samples)
            noise += float(np.abs(motion_of(random, sensor.quantity, trial.sample_rate, trial.run.band)[1]).max())
    v, d = (np.sum(parts, axis=0) for parts in zip(*moves, strict=True))
    swing, largest = float(np.abs(d).max()), max(float(np.abs(move[1]).max()) for move in moves)
    return _Measured((float(np.abs(v).max()), swing), clear=swing > CLEAR_OF_NOISE * noise and swing > OWN * largest)


def flat_tops(campaign: Campaign, peaks: dict[str, float]) -> dict[str, float]:
    """Channels whose motion is cut off at a limit, with that limit."""
    found: dict[str, float] = {}
    for name, peak in peaks.items():
        if peak <= 0.0:
            continue
        records = [run.read(name) for run in campaign.runs if name in run.channels]
        magnitudes = np.abs(np.concatenate(records))
        noise = deviation_by_median(max(records, key=lambda values: float(np.abs(values).max())), 2)
        limit, scatter = noisy_limit(magnitudes) or noisy_limit(magnitudes, noise) or (peak * (1 - FLAT_SHARE / 2), 0.0)
        least = min((1 - FLAT_SHARE) * peak, limit - scatter)
        above, below = (np.count_nonzero(magnitudes > edge) for edge in (least, 2.0 * least - peak))
        rows = np.concatenate([cut_off(values, np.abs(values) > least) for values in records])
        if len(rows) >= FLAT_ROWS and rows.sum() >= FLAT_SAMPLES and above >= PILE * (below - above):
            found[name] = limit
    return found


def mains(model: RigModel, trials: Sequence[Trial]) -> dict[str, float]:
    """Channels whose misfit has a line at one mains frequency in at least half of the runs, with that frequency in Hz.

    Those with the largest share of hum first.
    """
    seen: dict[str, list[float | None]] = {}
    share: dict[str, float] = {}
    for trial in trials:
        if trial.fitted == 0:
            continue
        left = trial.measured[:, : trial.fitted] - expected(model, trial, true_motion(model, trial, trial.fitted))
        for row, name in enumerate(trial.channels):
            frequency = mains_in(left[row], trial.sample_rate)
            seen.setdefault(name, []).append(frequency)
            if frequency is not None:
                size = float(np.std(hum(left[row], trial.sample_rate, frequency)) / max(np.std(trial.measured[row]), 1e-300))
                share[name] = max(share.get(name, 0.0), size)
    found = {name: agreeing([f for f in lines if f is not None]) for name, lines in seen.items()}
    found = {name: f for name, f in found.items() if f and 2 * len(f) >= len(seen[name])}
    return {name: float(np.median(found[name])) for name in sorted(found, key=lambda name: -share[name])}


def agreeing(frequencies: Sequence[float]) -> list[float]:
    """The line frequencies of several runs within `WANDERS` of their median, Hz."""
    middle = float(np.median(frequencies)) if frequencies else 0.0
    return [frequency for frequency in frequencies if abs(frequency - middle) <= WANDERS]


def misfit_frequencies(model: RigModel, trials: Sequence[Trial], most: int = 6) -> tuple[float, ...]:
    """Centres of the sixth-octave bands where a channel's misfit peaks above the noise: each channel's highest, then the next."""
    edges = 2.0 ** np.arange(np.log2(2.0), np.log2(trials[0].sample_rate / 2.2), 1.0 / 6.0)
    excess = np.zeros((len(trials[0].channels), len(edges) - 1))
    for trial in trials:
        n = trial.fitted
        if n == 0:
            continue
        predicted = expected(model, trial, true_motion(model, trial, n))
        frequency = np.fft.rfftfreq(n, 1.0 / trial.sample_rate)
        for row in range(len(trial.channels)):
            error = np.abs(np.fft.rfft(predicted[row] - trial.measured[row, :n])) ** 2 / n
            signal = np.abs(np.fft.rfft(trial.measured[row, :n])) ** 2 / n
            for k in range(excess.shape[1]):
                inside = (frequency >= edges[k]) & (frequency < edges[k + 1])
                if inside.sum() >= PEAK_LINES:
                    allowed = trial.noise[row] ** 2 + PEAK_NOISE**2 * signal[inside].mean()
                    if allowed > 0.0:  # not for a body at rest
                        excess[row, k] = max(excess[row, k], float(error[inside].mean() / allowed))
    # A channel's largest misfit extends over octaves; a mode at another frequency is a separate peak, in any channel.
    padded = np.pad(excess, ((0, 0), (1, 1)))
    peaks = np.where((excess >= padded[:, :-2]) & (excess >= padded[:, 2:]), excess, 0.0)
    highest = np.argsort(-peaks, axis=1)
    chosen: list[float] = []
    for place in range(excess.shape[1]):
        for row in np.argsort([-peaks[r, highest[r, place]] for r in range(len(peaks))]):
            k = highest[row, place]
            centre = float(np.sqrt(edges[k] * edges[k + 1]))
            if peaks[row, k] > 0.0 and all(abs(np.log2(centre / other)) > PEAKS_APART for other in chosen):
                chosen.append(centre)
    return tuple(chosen[:most])
