"""Runs of a rig with a body that no spring holds, prepared for fits: judged by the force of its drive."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from isorig.analysis.campaign import MOTION, BoolArray, Campaign, FloatArray, Run, usable_stop
from isorig.analysis.errors import DataError
from isorig.analysis.fitting.held_out import CALM, fit_samples
from isorig.analysis.fitting.linear_spectra import SHORTEST
from isorig.analysis.fitting.trials import Disturbance, Trial
from isorig.analysis.model.rig_model import GROUND, RigModel, Sensor, weights_of
from isorig.analysis.rounding import is_command, sensor_noise
from isorig.analysis.simulate import Excitation
from isorig.analysis.simulate.inverse import (
    DECIMATIONS,
    EDGE,
    Motion,
    decimated,
    driven_groups,
    motion_from,
    position_from,
    required_drive,
)
from isorig.analysis.simulate.sampling import as_held

#: Noise of a drive computed from the motion, as a share of the recorded one, or of a velocity as a share of its rms, up to which
#: no lower corner frequency is tried, and that of a drive up to which a group of bodies is used, besides the best one. Chosen: an
#: equation of more noise shows no parameter.
QUIET, LOUD = 0.02, 0.15
#: Noise of such a drive, as a share of the recorded one, from which on runs are simulated from a known rest instead. Chosen:
#: single pulls and coarse encoders, of which the drive showed nothing, had 0.1 to 0.8; thirteen rigs that it judges up to 0.06.
HARDLY = 0.1
#: Seconds at the start of a run in which a body at rest must not move, and the number of standard deviations of its sensor's
#: noise up to which it does not. Chosen: some tens of samples of white noise reach three.
AT_REST, AWAY = 0.1, 5.0
#: Misfit of the described rig, in multiples of that noise, from which such a group is used nonetheless. Chosen: five simulated
#: rigs without play in the joint reached 1.5 at most, two with it 8 and 32.
TOLD = 5.0
#: Frequency below which the deflection between two recorded velocities is unknown, in multiples of that at which the two bodies
#: oscillate on their link. Chosen: as the slow part of an integrated deflection in the equations of motion (`equations.system`).
UNKNOWN = 0.1
#: Minimum number of samples of the shortest run after a further decimation. Chosen: as many tell a curve of twenty points.
LEFT = 200


def _begins_at_rest(run: Run, sensors: Mapping[str, Sensor], noise: Mapping[str, float]) -> bool:
    # Whether no body moves in the first moment of a run, relative to the largest motion in such a time, and each is where a
    # simulation begins.
    first = min(max(round(AT_REST * run.sample_rate), 1), usable_stop(run) // 2)
    for sensor in sensors.values():
        values = run.channel(sensor.channel).read(0, usable_stop(run))
        most = float(np.abs(values[first:] - values[:-first] if MOTION[sensor.quantity] == 0 else values).max())
        if float(np.abs(values[:first]).max()) > max(CALM * most, AWAY * noise.get(sensor.channel, 0.0)):
            return False
    return True


def trials_by_drive(campaign: Campaign, model: RigModel, levels: Sequence[Mapping[str, float]]) -> tuple[Trial, ...]:
    """The campaign's runs, judged by the force of the drive that their motion requires.

    Empty where the motion hardly tells the drive, and simulations from a known rest tell more. `levels` are the standard
    deviations of the channels' sensor noise in each run. Raises DataError if the motion of a body is not recorded.
    """
    sensors = _motion_sensors(model)
    if len(sensors) != len(model.bodies):
        raise DataError(
            f"the rig {model.name!r} has a body that no spring holds, so it is judged by the force of its drive; "
            "that takes the position or velocity of every body, absolute or relative to one whose own is measured, so measure "
            "those or add the spring to the description"
        )
    runs = [
        (run, usable_stop(run), noise) for run, noise in zip(campaign.runs, levels, strict=True) if usable_stop(run) >= SHORTEST
    ]  # fmt: skip
    if not runs:
        return ()
    shortest = min(stop for _, stop, _ in runs)
    least: tuple[float, list[tuple[Motion, Motion]], BoolArray] | None = None
    for decimation in DECIMATIONS:
        if least is not None and shortest < decimation * (LEFT + 2 * EDGE):
            break
        motions = [_motions(model, sensors, *run, decimation) for run in runs]
        noises, misfits = _shares_of_groups(model, motions)
        if least is None or float(noises.min()) < least[0]:
            least = float(noises.min()), motions, (noises <= max(LOUD, float(noises.min()))) | (misfits > TOLD * noises)
        if least[0] <= QUIET:
            break
    assert least is not None
    noise_share, motions, kept = least
    if noise_share > HARDLY and all(_begins_at_rest(run, sensors, noise) for run, _, noise in runs):
        return ()
    groups = [group for group, keep in zip(driven_groups(model), kept.tolist(), strict=True) if keep]
    names = [model.drive.channel, *(f"{model.drive.channel} of {' + '.join(group)}" for group in groups[1:])]
    found = []
    for (run, _, noise), pair in zip(runs, motions, strict=True):
        moved, noisy = (replace(motion, groups=tuple(groups)) for motion in pair)
        rate = run.sample_rate / moved.decimation
        force = decimated(moved.drive, moved.decimation)
        positions = decimated(np.stack(list(moved.position.values())), moved.decimation)
        level = np.full(len(groups), noise.get(model.drive.channel, 0.0) / np.sqrt(moved.decimation))
        off = np.std(required_drive(model, moved) - required_drive(model, noisy), axis=1)
        found.append(
            Trial(
                run=run, start_time=campaign.seconds_since_start(run), channels=tuple(names),
                measured=np.tile(force, (len(groups), 1)), excitation=Excitation.prepare(force, rate, oversample=1), noise=level,
                fitted=0 if run.use == "holdout" else fit_samples(positions), ceiling=rate / 2.0, motion=moved,
                noisy=noisy, disturbance=Disturbance(frequency=np.array([0.0, rate]), level=np.tile(off[:, None], 2)),
            )
        )  # fmt: skip
    return tuple(found)


def _motion_sensors(model: RigModel) -> dict[str, Sensor]:
    # The sensor of each body's motion, that of the body to which it is relative before it. A position is preferred to a velocity,
    # whose integral counts from the start of the run.
    usable = [s for s in model.sensors if s.force_in is None and MOTION[s.quantity] < 2 and not s.arms]
    ordered, found = sorted(usable, key=lambda s: MOTION[s.quantity]), dict[str, Sensor]()
    while known := [s for s in ordered if s.body not in found and (s.relative_to == GROUND or s.relative_to in found)]:
        found[known[0].body] = known[0]
    return found


def _motions(
    model: RigModel, sensors: Mapping[str, Sensor], run: Run, stop: int, noise: Mapping[str, float], decimation: int
) -> tuple[Motion, Motion]:  # fmt: skip
    # The motion of a run with all groups of bodies, and the same with additional sensor noise.
    rate, generator = run.sample_rate, np.random.default_rng(5)

    def position(sensor: Sensor, values: FloatArray) -> FloatArray:
        return position_from(values, rate) if MOTION[sensor.quantity] else values

    clean, rough = {GROUND: np.zeros(stop)}, {GROUND: np.zeros(stop)}
    for body, sensor in sensors.items():
        values = run.channel(sensor.channel).read(0, stop)
        clean[body] = position(sensor, values) + clean[sensor.relative_to]
        with_noise = values + sensor_noise(values, noise.get(sensor.channel, 0.0), generator)
        rough[body] = position(sensor, with_noise) + rough[sensor.relative_to]
    del clean[GROUND], rough[GROUND]
    drive = run.channel(model.drive.channel).read(0, stop)
    drive = as_held(drive, 1) if is_command(drive) else drive
    # A velocity has less noise than the acceleration. Its own low-pass is as wide as that allows: a dry contact follows the sign
    # of the true velocity, which that of a low-passed one is not where a shaft oscillates above the corner frequency.
    for passed in DECIMATIONS[: DECIMATIONS.index(decimation) + 1]:
        moved, noisy = motion_from(clean, rate, drive, passed), motion_from(rough, rate, drive, passed)
        blur = {body: float(np.std(noisy.velocity[body] - moved.velocity[body])) for body in clean}
        if all(blur[body] <= QUIET * float(np.std(moved.velocity[body])) for body in clean):
            break
    channels = {body: sensor.channel for body, sensor in sensors.items()}
    groups, unknown = driven_groups(model), _unknown(model, {body for body, sensor in sensors.items() if MOTION[sensor.quantity]})
    return (
        replace(moved, blur=blur, channels=channels, groups=groups, decimation=decimation, unknown=unknown),
        replace(noisy, blur=blur, channels=channels, groups=groups, decimation=decimation, unknown=unknown),
    )


def _unknown(model: RigModel, integrated: Collection[str]) -> dict[str, float]:
    # The frequency in Hz below which the deflection of each link between two bodies with integrated velocities is unknown.
    found = {}
    for link in model.links:
        if {link.a, link.b} <= set(integrated) and link.stiffness > 0.0:
            weights = weights_of(model, link)
            of_both = sum(w**2 / body.mass for w, body in zip(weights.tolist(), model.bodies, strict=True))
            found[link.name] = UNKNOWN * float(np.sqrt(link.stiffness * of_both)) / (2.0 * np.pi)
    return found


def _shares_of_groups(model: RigModel, motions: Sequence[tuple[Motion, Motion]]) -> tuple[FloatArray, FloatArray]:
    # Noise and misfit of the drive that is computed from each group of bodies, as shares of the recorded drive.
    noise, misfit, size = 0.0, 0.0, 0.0
    for moved, noisy in motions:
        needed, drive = required_drive(model, moved), decimated(moved.drive, moved.decimation)
        noise = noise + np.mean((needed - required_drive(model, noisy)) ** 2, axis=1)
        misfit = misfit + np.mean((needed - drive) ** 2, axis=1)
        size += float(np.mean(drive**2))
    return np.sqrt(noise / max(size, 1e-300)), np.sqrt(misfit / max(size, 1e-300))
