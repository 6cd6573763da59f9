"""Whether a run begins in motion, or in a described state, and what is known of its start.

A run begins in motion if its first records do not follow from the drive since its first sample.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import msgspec
import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import ModelError, SimulationError
from isorig.analysis.fitting.initial_state import PRIOR, SAMPLES, MovingStart, State, records_from
from isorig.analysis.fitting.trials import SIGNAL_SHARE, Trial
from isorig.analysis.model.linear import free_part
from isorig.analysis.model.rig_model import GROUND, RigModel, Sensor
from isorig.analysis.simulate import simulate
from isorig.analysis.simulate.natural import natural_modes
from isorig.analysis.simulate.sampling import TAPS

#: A run begins in motion if a simulation from rest has an error in its first moments of more than this share of a channel's rms,
#: and of more than this multiple of its noise. Chosen: the free vibration of a smaller one is small.
MOVING, ABOVE_NOISE = 0.3, 6.0
#: How many times the first records may exceed a simulation from rest. Chosen: gains and masses of a description have smaller
#: errors.
SCALE = 3.0
#: These moments, in periods of the highest mode, and their least number of samples: the springs have not acted much yet.
MOMENTS, FEWEST = 0.1, 4
#: Records that determine the state, in periods of the lowest mode; of a rig that no spring holds, as a share of its run. Chosen:
#: a body that coasts is slowed down little in that time.
PERIODS, COASTS = 1.0, 0.05
#: Allowed error of a sensor whose record is constant: it has no weight.
DEAD = 1e12
#: Standard deviation of a described state: of a position as a share of the largest one, of a velocity as a share of what that
#: becomes at the lowest mode. Chosen: a hand pulls, and a trigger starts a record, about as accurately.
DESCRIBED = 0.05


def moving_start(model: RigModel, trial: Trial) -> MovingStart | None:
    """The start of a run, or None where too little is known of it: an overdamped rig, a motion that grows without bound.

    Where no spring holds a rig, its speed changes slowly, as an offset of the sensor does not at all: then none is assumed. In
    addition to its noise, `SIGNAL_SHARE` of a channel's rms is allowed as error.
    """
    configuration = trial.run.configuration
    modes, given = natural_modes(model, configuration), described_state(model, configuration)
    if not modes and (not given or any(link.stiffness for link in model.links)):
        return None
    width = free_part(model, configuration)[0].shape[1]
    rate, samples = trial.excitation.sample_rate, trial.measured.shape[1]
    lowest = modes[0].frequency if modes else rate / samples
    unknowns = 2 * width + len(trial.measured)
    n = TAPS + int(max(PERIODS * rate / lowest if modes else COASTS * samples, SAMPLES * unknowns))
    if n > samples // 2:
        return None
    linear = msgspec.structs.replace(
        model, contacts=(), links=tuple(msgspec.structs.replace(link, laws=()) for link in model.links), free=()
    )
    rms, offset = trial.measured.std(axis=1), np.abs(trial.measured.mean(axis=1))
    sigma = np.hypot(trial.noise, SIGNAL_SHARE * rms)
    try:
        begun = MovingStart(
            configuration=configuration, start_time=trial.start_time, measured=trial.measured[:, :n],
            offset=offset if modes else np.zeros_like(offset),
            sigma=np.where(sigma > 0.0, sigma, DEAD), given=given,
            sizes=_accuracy(given, 2.0 * np.pi * lowest) if given else _sizes(linear, trial),
        )  # fmt: skip
        return replace(begun, near=begun.state(linear, trial.excitation))
    except (SimulationError, ModelError):
        return None


def described_state(model: RigModel, configuration: str) -> State:
    """The described positions and velocities at the start of runs of a configuration; empty if none is described."""
    setup = model.configurations[configuration]
    names = {**setup.initial_position, **setup.initial_velocity}
    return {name: (setup.initial_position.get(name, 0.0), setup.initial_velocity.get(name, 0.0)) for name in names}


def _accuracy(given: State, lowest: float) -> State:
    # The prior's sizes of a described state: all bodies move about as much as the largest.
    most = max(max(abs(position), abs(velocity) / lowest) for position, velocity in given.values())
    size = DESCRIBED / PRIOR * most
    return dict.fromkeys(given, (size, lowest * size))


def begins_in_motion(model: RigModel, trial: Trial) -> bool:
    """Whether a run begins in motion: its first records do not follow from the drive since its first sample.

    From rest, the first records of each sensor are between those of the described rig and those of the same without friction: a
    sum of both simulations with factors from zero to `SCALE`. A friction that the description lacks may hold a link: then
    they are between these and those of the rig with this link blocked. Those of the next moments suffice: where the drive begins
    with a jump, the converter's filter smears the first ones.
    """
    configuration = trial.run.configuration
    modes = natural_modes(model, configuration)
    if not modes:
        return False
    n = max(round(MOMENTS * trial.excitation.sample_rate / modes[-1].frequency), FEWEST)
    begin = trial.excitation.beginning(2 * n)

    def from_rest(rig: RigModel) -> FloatArray:
        return records_from(rig, begin, configuration, trial.start_time, 2 * n, {})

    def explained_by(rests: Sequence[FloatArray]) -> bool:
        # A sensor with an offset shows no motion: about its mean it is at rest, too.
        return any(
            all(
                min(_beyond(row[moments] - offset, *(rest[moments] for rest in each)) for offset in (0.0, row.mean()))
                <= max(MOVING * row.std(), ABOVE_NOISE * noise)
                for row, noise, *each in zip(trial.measured, trial.noise, *rests, strict=True)
            )
            for moments in (slice(0, n), slice(n, 2 * n))
        )

    rigs = (model, msgspec.structs.replace(model, contacts=(), free=())) if model.contacts else (model,)
    try:
        described = [from_rest(rig) for rig in rigs]
    except (SimulationError, ModelError):
        return False
    if explained_by(described):
        return False
    for rig in _held(model, configuration):
        try:
            if explained_by([*described, from_rest(rig)]):
                return False
        except (SimulationError, ModelError):  # this link cannot be blocked
            continue
    return True


def _held(model: RigModel, configuration: str) -> Iterator[RigModel]:
    # The rig with one more link blocked in a configuration, for each link that is not.
    setup = model.configurations[configuration]
    if setup.lock_stiffness is None:
        for link in model.links:
            if link.name not in setup.rigid:
                blocked = msgspec.structs.replace(setup, rigid=(*setup.rigid, link.name))
                yield msgspec.structs.replace(model, configurations={**model.configurations, configuration: blocked})


def _beyond(signal: FloatArray, *rest: FloatArray) -> float:
    # Largest difference of a record from simulations from rest, each with a factor from zero to `SCALE`.
    from scipy.optimize import lsq_linear

    inputs = np.stack(rest, axis=1)
    size = float(np.abs(signal).max())
    if size == 0.0 or not inputs.any():  # at rest, or before the drive acts
        return size
    factors = lsq_linear(inputs / size, signal / size, bounds=(0.0, SCALE)).x
    return float(np.abs(signal - inputs @ factors).max())


def _sizes(model: RigModel, trial: Trial) -> State:
    # Rms of each body's position and velocity in a simulation from rest, relative to an imposed motion: that may drift.
    ground = next(iter(model.imposed), GROUND)
    gauges = [
        Sensor(channel=f"{quantity} {body.name}", body=body.name, relative_to=ground, quantity=quantity)
        for body in model.bodies
        if body.name != ground
        for quantity in ("displacement", "velocity")
    ]
    watched = msgspec.structs.replace(model, sensors=tuple(gauges))
    seen = simulate(watched, trial.excitation, configuration=trial.run.configuration, start_time=trial.start_time).channels
    rms = {name: float(np.sqrt(np.mean(values**2))) for name, values in seen.items()}
    return {
        body.name: (rms[f"displacement {body.name}"], rms[f"velocity {body.name}"])
        for body in model.bodies
        if body.name != ground
    }
