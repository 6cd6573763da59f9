"""The linear part of a rig as a state-space model, for control design and other packages."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from isorig.analysis.campaign import MOTION, SI_UNIT, FloatArray
from isorig.analysis.errors import ModelError
from isorig.analysis.model.linear import accelerations
from isorig.analysis.model.rig_model import RigModel, given_configuration, weights_of
from isorig.analysis.views import call, shows
from isorig.analysis.wording import words


@dataclass(frozen=True, kw_only=True)
class StateSpace:
    """x' = a x + b u, y = c x + d u.

    Parameters
    ----------
    a, b, c, d
        Matrices, shapes (states, states), (states, inputs), (outputs, states), (outputs, inputs).
    states
        Names: "x" and "v" with the body's name, for displacement and velocity, in SI units.
    inputs, outputs
        The drives' channels and the sensors' channels.
    units
        SI unit of each input and output.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: dict[str, str]

    def __repr__(self) -> str:
        return f"StateSpace({len(self.states)} states, {', '.join(self.inputs)} -> {', '.join(self.outputs)})"

    def to_scipy(self) -> Any:
        """The same as scipy.signal.StateSpace."""
        return call(self, "to_scipy")

    def to_control(self) -> Any:
        """The same as control.StateSpace of python-control, with the names of states, inputs and outputs."""
        return call(self, "to_control")


@shows(RigModel, "state_space")
def state_space(model: RigModel, configuration: str | None = None) -> StateSpace:
    """The springs, dampers, masses, drives and sensors of a rig in a configuration; without friction, laws and chain faults.
    Raises ArgumentError if the configuration is no text; ModelError if the configuration is unknown, a motion is imposed by other
    than its acceleration, or a sensor records a force."""
    name = given_configuration(model, configuration)
    basis, _, of_state, of_input = accelerations(model, name)
    other = next((drive for drive in model.drives if drive.imposes is not None and MOTION.get(drive.quantity) != 2), None)
    if other is not None:
        raise ModelError(
            f"the drive {other.channel!r} imposes a {words(other.quantity)}, and the force of its inertia needs two "
            "derivatives of it; a state-space model needs its acceleration, so change the drive's quantity"
        )
    force = next((sensor for sensor in model.sensors if sensor.force_in is not None), None)
    if force is not None:
        raise ModelError(f"the sensor {force.channel!r} records a force, which is no state; leave it out of the model")
    n = basis.shape[1]
    a = np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), of_state])
    b = np.vstack([np.zeros_like(of_input), of_input])
    rows, through = [], []
    for sensor in model.sensors:
        weights = weights_of(model, sensor) @ basis
        order = MOTION[sensor.quantity]
        place = np.hstack([weights, np.zeros(n)]) if order == 0 else np.hstack([np.zeros(n), weights])
        rows.append(weights @ of_state if order == 2 else place)
        through.append(weights @ of_input if order == 2 else np.zeros(len(model.drives)))
    kept = [model.bodies[int(np.argmax(np.abs(column)))].name for column in basis.T]
    inputs, outputs = model.drive_channels, tuple(sensor.channel for sensor in model.sensors)
    units = {channel: SI_UNIT[quantity] for channel, quantity in model.quantities.items()}
    return StateSpace(
        a=a, b=b, c=np.array(rows).reshape(-1, 2 * n), d=np.array(through).reshape(-1, len(inputs)),
        states=(*(f"x {body}" for body in kept), *(f"v {body}" for body in kept)), inputs=inputs, outputs=outputs, units=units,
    )  # fmt: skip
