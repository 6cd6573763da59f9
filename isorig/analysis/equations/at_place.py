"""The equations of a partly measured rig whose cause is at one place: what no sensor records follows from the force there."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import msgspec
import numpy as np

from isorig.analysis.campaign import Campaign, Channel, ComplexArray, FloatArray, Run
from isorig.analysis.equations.motion import Combinations, estimate_of
from isorig.analysis.equations.system import CausePlace, Equations
from isorig.analysis.equations.unknown_force import Located, UnknownForce, response_to_force, tells
from isorig.analysis.fitting.preparation import zero_errors
from isorig.analysis.fitting.trials import Trial, expected
from isorig.analysis.model.linear import linear_response
from isorig.analysis.model.rig_model import RigModel, Sensor, weights_of
from isorig.analysis.simulate import simulate
from isorig.analysis.spectra.noise import noise_of_runs

#: Share of a place's largest response below which a frequency bin does not tell the force there. Chosen: below, what little the
#: description misses becomes larger than the force.
FAINT = 1e-3
#: Share of noise in the power of the force up to which a bin shows it. Chosen: five times as large as its noise.
NOISY = 0.04
#: Frequency bins whose responses are computed at once: a hundred MB.
PART = 1 << 14


def equations_at(located: Located, campaign: Campaign, trials: Sequence[Trial]) -> Equations:
    """The equations of a partly measured rig whose cause is at one place, which test causes there only.

    What no sensor records follows from the fitted values, the drives, and the force at this place that explains most of the
    misfit: of a link its elongation and force, otherwise the motion of all bodies without sensors.
    """
    model = located.model
    added = _added_sensors(model, located.place)
    kept = () if located.place.kind == "link" else model.sensors
    drives = tuple(drive.channel for drive in model.drives)
    levels = dict(zip((run.id for run in campaign.runs), noise_of_runs(campaign, drives), strict=True))
    runs, noise = [], []
    for trial in trials:
        if tells(model, trial):
            records, level = _estimated(located, trial, added)
            runs.append(_with_records(trial.run, records))
            noise.append({**levels[trial.run.id], **level})
    free = tuple(
        path for path in model.free if kept or not path.startswith("sensors.")
    )  # without these sensors, their gains are no parameters
    extended = msgspec.structs.replace(model, sensors=(*kept, *added), free=free)
    return Equations(replace(campaign, runs=tuple(runs)), extended, noise, zero_errors(campaign, model), only=located.place)


def _added_sensors(model: RigModel, place: CausePlace) -> tuple[Sensor, ...]:
    # Those that would record what the equations need.
    if place.kind == "link":
        link = model.link(place.name)
        motion = Sensor(channel=f"elongation of {link.name}", body=link.a, relative_to=link.b, arms=link.arms)
        return motion, Sensor(channel=f"force in {link.name}", force_in=f"links.{link.name}", quantity="force")
    bodies = [body.name for body in model.bodies if body.name not in Combinations(model).measured]
    if place.kind == "sensor":  # what it records is known from the others alone
        bodies += [sensor.body for sensor in model.sensors if sensor.channel == place.name and sensor.body not in bodies]
    return tuple(Sensor(channel=estimate_of(body), body=body) for body in bodies)


def _with_records(run: Run, records: Mapping[str, FloatArray]) -> Run:
    # A run with further channels, zero where their records are shorter.
    more = {name: Channel(name=name, samples=np.pad(values, (0, len(run) - len(values)))) for name, values in records.items()}
    return replace(run, channels={**run.channels, **more})


def _estimated(
    located: Located, trial: Trial, sensors: Sequence[Sensor]
) -> tuple[dict[str, FloatArray], dict[str, float]]:  # fmt: skip
    # What sensors would record in a run, by channel, and the standard deviation of its noise.
    model, n = located.model, trial.samples
    sound = simulate(
        msgspec.structs.replace(model.without_faults, sensors=tuple(sensors)), trial.excitation,
        configuration=trial.run.configuration, start_time=trial.start_time, samples=n,
    ).channels  # fmt: skip
    # As long again: what follows the last sample is not known, and must not reach the first ones.
    frequency = np.fft.rfftfreq(2 * n, 1.0 / trial.sample_rate)
    used = np.flatnonzero((frequency > 0.0) & (frequency <= min(trial.usable, 0.5 * trial.sample_rate)))
    misfit = np.fft.rfft(trial.measured - expected(model, trial), 2 * n)[:, used].T / trial.noise
    omega = np.asarray(2.0 * np.pi * frequency[used], dtype=np.float64)
    force = _force_in_parts(located, trial, omega)
    values = force.estimated(misfit)
    # Wiener's filter: between the lines of a drive and outside its band the force is noise.
    share = np.divide(force.weight, np.abs(values) ** 2, out=np.ones(len(used)), where=values != 0.0)
    by_force = np.stack([_recorded(model, sensor, force.moved, omega) for sensor in sensors])
    added = np.zeros((len(sensors), len(frequency)), dtype=complex)
    added[:, used] = by_force * values * np.maximum(1.0 - share, 0.0)
    # Noise is white in the equations: as in most of the bins that show the force.
    shown = share < NOISY
    gain = np.median((np.abs(by_force) ** 2 * force.weight)[:, shown], axis=1) if shown.any() else np.zeros(len(sensors))
    names = [sensor.channel for sensor in sensors]
    levels = dict(zip(names, np.sqrt(gain).tolist(), strict=True))
    corrections = np.fft.irfft(added, 2 * n)[:, :n]
    return {name: sound[name] + more for name, more in zip(names, corrections, strict=True)}, levels


def _force_in_parts(located: Located, trial: Trial, omega: FloatArray) -> UnknownForce:
    # The unknown force at a place at many frequencies, whose matrices would need much memory at once.
    records, moved = [], []
    for part in np.array_split(omega, len(omega) // PART + 1):
        response = linear_response(located.model, trial.run.configuration, part)
        response = replace(response, seen=response.seen / trial.noise[:, None])
        of_sensors, of_bodies = response_to_force(located.place, located.model, response)
        records.append(of_sensors)
        moved.append(of_bodies)
    return UnknownForce.with_records(np.concatenate(records), np.concatenate(moved), FAINT)


def _recorded(model: RigModel, sensor: Sensor, moved: ComplexArray, omega: FloatArray) -> ComplexArray:
    # The record of a sensor by a unit of the unknown force, which displaces the bodies by `moved`, shape (bins, bodies): an
    # acceleration, or the force that a link resists its elongation with, which is less by the unknown one.
    if sensor.force_in is None:
        return np.asarray(-(omega**2) * (moved @ weights_of(model, sensor)))
    link = model.link(sensor.force_in.partition(".")[2])
    return np.asarray((link.stiffness + 1j * omega * link.damping) * (moved @ weights_of(model, link)) - 1.0)
