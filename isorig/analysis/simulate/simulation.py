"""Free-run simulation: the sensors' response of a rig to a drive."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from isorig.analysis.errors import ModelError
from isorig.analysis.given import all_of_type, finite, flag, given_mapping, number, of_type, whole
from isorig.analysis.model.rig_model import RigModel, given_configuration, given_rig
from isorig.analysis.simulate.compiled import compile_rig
from isorig.analysis.simulate.free_run import NOWHERE, Response, imposed_start, response_of, run_rig, sense_of, true_fine
from isorig.analysis.simulate.sampling import TAPS, Excitation
from isorig.analysis.simulate.trace import with_forces


def simulate(
    model: RigModel,
    excitation: Excitation,
    *,
    configuration: str | None = None,
    start_time: float = 0.0,
    as_recorded: bool = False,
    samples: int | None = None,
    start: Mapping[str, tuple[float, float]] = NOWHERE,
) -> Response:
    """Simulate the rig from rest, or from an initial state.

    Parameters
    ----------
    model
        The rig.
    excitation
        The drive channel as recorded; offset, gain and delay of its chain are corrected.
    configuration
        Configuration of the rig; its first one if None.
    start_time
        Seconds since the start of the campaign, for a stiffness that drifts.
    as_recorded
        Whether the faults of the sensors' chains are included.
    samples
        Number of samples; all if None.
    start
        Initial position (m) and velocity (m/s) of bodies, instead of the initial state of the configuration.

    Raises
    ------
    ArgumentError
        An argument is of another type.
    SimulationError
        If the motion grows without bound.

    Examples
    --------
    >>> import numpy as np
    >>> import isorig as iso
    >>> drive = iso.Excitation.prepare(3.0 * np.random.default_rng(0).normal(size=2048), 1024.0)
    >>> response = iso.simulate(iso.wire_bonder(), drive, configuration="locked")
    >>> sorted(response.channels), response.channels["table"].shape
    (['heatblock', 'motor', 'table'], (2048,))
    """
    model = given_rig(model)
    of_type(excitation, Excitation, "the drive", "an iso.Excitation; give iso.Excitation.prepare(VALUES, SAMPLE_RATE)")
    configuration = given_configuration(model, configuration)
    start_time, as_recorded = finite(start_time, "the start time"), flag(as_recorded, "the argument as_recorded")
    samples = None if samples is None else whole(samples, "the number of samples", 0, len(excitation.recorded))
    _check_start(model, start)
    rate, over = excitation.sample_rate, excitation.oversample
    n = len(excitation.recorded) if samples is None else samples
    total = min((n + 2 * TAPS) * over, len(excitation.fine))
    h = 1.0 / (rate * over)
    sense = sense_of(model, compile_rig(model, configuration, h))
    if any(sensor.force_in is not None for sensor in model.sensors):
        return with_forces(
            model, excitation, configuration=configuration, start_time=start_time, as_recorded=as_recorded, samples=n,
            steps=total, start=start,
        )  # fmt: skip
    motion = np.empty((len(model.sensors), total))
    fine, begun = true_fine(model, excitation)[:, :total], {**start, **imposed_start(model, excitation)}
    run_rig(model, configuration, fine, h, start_time, sense, motion, begun=begun)
    return response_of(model, excitation, motion, n, as_recorded=as_recorded)


def _check_start(model: RigModel, start: Mapping[str, tuple[float, float]]) -> None:
    allowed = "a mapping of bodies to (position, velocity); give for example {BODY: (1e-3, 0.0)}"
    for name, state in given_mapping(start, "the argument start", allowed).items():
        model.body(name)
        values = [
            number(each, f"the initial state of {name!r}") for each in all_of_type(state, object, "the argument start", allowed)
        ]
        if len(values) != 2:
            raise ModelError(
                f"the initial state of {name!r} has {len(values)} numbers, but a position and a velocity; correct it"
            )
