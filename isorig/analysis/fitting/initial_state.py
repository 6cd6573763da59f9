"""The state of a rig at the start of a run that begins in motion, from the run's first records and the model.

A shaker that runs on while records are cut out of its motion leaves a free vibration in each record that the recorded drive does
not explain. A simulation from rest has this error until it has decayed: for many periods, and for good where impacts make two
motions differ. So positions and velocities at the first sample are determined for every model by least squares from the records
of the first period, and a weak prior: they are like those of the run. An offset of each sensor, up to the mean of its record, is
determined with them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from isorig.analysis.campaign import MOTION, FloatArray
from isorig.analysis.errors import SimulationError
from isorig.analysis.model.linear import free_part
from isorig.analysis.model.rig_model import RigModel, weights_of
from isorig.analysis.simulate import Excitation, record, simulate
from isorig.analysis.simulate.free_run import true_drives
from isorig.analysis.simulate.sampling import TAPS

#: Position (m, rad) and velocity (m/s, rad/s) of each body.
State = Mapping[str, tuple[float, float]]
#: Least squares end where a step reduces the squared error by less than this share, and after this number of steps.
ENDS, EVALUATIONS = 1e-4, 12
#: Least number of samples of the records for each unknown value.
SAMPLES = 4
#: Shares of these records that determine it one after the other: a nonlinear rig soon leaves the motion of its linear part.
GROWING = (0.25, 0.5, 1.0)
#: Finite differences as a share of the motion.
DIFFERENCE = 0.01
#: Weighted error where a motion grows without bound or is too fast for any step.
LOST = 1e6
#: Motion (m, m/s) of a simulated rig below which friction holds it.
HELD = 1e-9
#: Standard deviation of the prior as a multiple of the rms of the motion: so weak that it only holds what no record shows.
PRIOR = 10.0


@dataclass(frozen=True, kw_only=True)
class MovingStart:
    """The start of a run that begins in motion."""

    #: Of the run; seconds since the start of the campaign.
    configuration: str
    start_time: float
    #: The first records, shape (channels, n); the first `TAPS` of them are not compared: they depend on the motion before.
    measured: FloatArray
    #: Allowed error of each channel and magnitude of its mean over the run, shape (channels,).
    sigma: FloatArray
    offset: FloatArray
    #: Rms of position and velocity of each body in this run; of a described state its standard deviations over `PRIOR`.
    sizes: State
    given: State = field(default_factory=dict)  #: The described state; empty for rest.
    near: State = field(default_factory=dict)  #: The state with the linear part of the rig as described.
    #: Coordinates and speeds at the start and offsets of the sensors with one model, and the inverse of their derivatives, for
    #: models close to it; empty otherwise.
    values: FloatArray = field(default_factory=lambda: np.zeros(0))
    inverse: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def state(self, model: RigModel, excitation: Excitation) -> State:
        """The state at the first sample with this model.

        Parameters
        ----------
        model
            The rig with the faults of its measurement chain.
        excitation
            The recorded drive.

        Raises
        ------
        SimulationError
            If the motion grows without bound.
        """
        return self._whole(model, excitation).state_of(self._values(model, excitation))

    def about(self, model: RigModel, excitation: Excitation) -> MovingStart:
        """The same start for models close to one: their states follow from its state by one linear step, with its derivatives.

        The state of a model close to that of this start is found from there.
        """
        values = self._values(model, excitation)
        whole = self._whole(model, excitation)
        if len(self.values):
            values = self._refined(whole, values)
        return replace(self, values=values, inverse=np.asarray(np.linalg.pinv(whole.slopes(values))))

    def _whole(self, model: RigModel, excitation: Excitation) -> _Errors:
        return _Errors(self, model, excitation, self.measured.shape[1])

    def _values(self, model: RigModel, excitation: Excitation) -> FloatArray:
        # Coordinates and speeds at the start, and offsets of the sensors.
        whole = self._whole(model, excitation)
        if self.values.shape == (whole.unknowns,):
            return np.asarray(self.values - self.inverse @ whole.left(self.values))
        values = whole.values_of(self.near)
        for part in GROWING if whole.nonlinear else GROWING[-1:]:
            n = TAPS + round(part * (self.measured.shape[1] - TAPS))
            if n - TAPS >= SAMPLES * whole.unknowns:
                values = self._refined(_Errors(self, model, excitation, n), values)
        return np.asarray(values)

    def _refined(self, errors: _Errors, values: FloatArray) -> FloatArray:
        # The least-squares values, from values close to them.
        from scipy.optimize import least_squares

        scale = np.concatenate([errors.scale, self.sigma])
        found = least_squares(errors.left, values, jac=errors.slopes, x_scale=scale, ftol=ENDS, max_nfev=EVALUATIONS)
        return np.asarray(found.x)


class _Errors:
    # Weighted errors of the first `n` records with a model, for coordinates and speeds at the start and offsets of the sensors,
    # and below them the prior.

    def __init__(self, start: MovingStart, model: RigModel, excitation: Excitation, n: int) -> None:
        self._start, self._model, self._begin, self._n = start, model, excitation.beginning(n), n
        self._names, self._basis = [body.name for body in model.bodies], free_part(model, start.configuration)[0]
        self._width, self._count = self._basis.shape[1], len(start.measured)
        most = np.maximum(np.max([list(size) for size in start.sizes.values()], axis=0), HELD)
        sizes = np.maximum(np.array([start.sizes.get(name, tuple(most)) for name in self._names]).T, 1e-3 * most[:, None])
        self._center = self.values_of(start.given)[: 2 * self._width]
        self._prior = np.vstack([np.kron(np.eye(2)[k], self._basis / (PRIOR * sizes[k][:, None])) for k in range(2)])
        # The offsets are linear: their columns below those of the state.
        constant = np.kron(np.diag(1.0 / start.sigma), np.ones((n - TAPS, 1)))
        weak = np.diag(1.0 / np.maximum(start.offset, start.sigma))
        self._offsets = np.vstack([constant, np.zeros((len(self._prior), self._count)), weak])
        self.scale = np.repeat(sizes.max(axis=1), self._width)
        forces = any(sensor.force_in is not None for sensor in model.sensors)
        self.nonlinear = forces or bool(model.contacts) or any(link.laws for link in model.links)

    @property
    def unknowns(self) -> int:
        return len(self.scale) + self._count

    def values_of(self, state: State) -> FloatArray:
        rows = np.array([state.get(name, (0.0, 0.0)) for name in self._names])
        return np.concatenate([np.linalg.lstsq(self._basis, rows, rcond=None)[0].T.ravel(), np.zeros(self._count)])

    def state_of(self, values: FloatArray) -> State:
        position, velocity = (self._basis @ half for half in np.split(values[: 2 * self._width], 2))
        return {name: (float(x), float(v)) for name, x, v in zip(self._names, position, velocity, strict=True)}

    def left(self, values: FloatArray) -> FloatArray:
        start, state = self._start, values[: 2 * self._width]
        try:
            predicted = records_from(
                self._model, self._begin, start.configuration, start.start_time, self._n, self.state_of(values)
            )
        except SimulationError:  # least squares take a shorter step
            return np.full(len(self._offsets), LOST)
        errors = ((predicted - start.measured[:, : self._n]) / start.sigma[:, None])[:, TAPS:].ravel()
        rows = np.concatenate([errors, self._prior @ (state - self._center), np.zeros(self._count)])
        return np.asarray(rows + self._offsets @ values[2 * self._width :])

    def slopes(self, values: FloatArray) -> FloatArray:
        start, width = self._start, self._width
        if not self.nonlinear:
            decay = _free_decay(self._model, start.configuration, self._begin.sample_rate, self._n)[:, TAPS:]
            linear = (decay / start.sigma[:, None, None]).reshape(-1, 2 * width)
            return np.hstack([np.vstack([linear, self._prior, np.zeros((self._count, 2 * width))]), self._offsets])
        middle = self.left(values)
        moved = np.pad(np.diag(DIFFERENCE * self.scale), ((0, 0), (0, self._count)))
        return np.column_stack([*((self.left(values + row) - middle) / row.sum() for row in moved), self._offsets])


def _free_decay(model: RigModel, configuration: str, rate: float, n: int) -> FloatArray:
    # Records of the linear rig's free vibration from each position and velocity of one, shape (channels, n, 2 coordinates).
    from scipy.linalg import expm

    basis, rates = free_part(model, configuration)
    width = basis.shape[1]
    step = expm(rates / rate)
    states = [np.eye(2 * width)]
    for _ in range(n - 1):
        states.append(step @ states[-1])
    rows = []
    for sensor in model.sensors:
        across = weights_of(model, sensor) @ basis
        order = MOTION[sensor.quantity]
        row = np.concatenate([across, np.zeros(width)])
        rows.append(sensor.chain.gain * row @ np.linalg.matrix_power(rates, order))
    return np.asarray(np.einsum("cs,nst->cnt", np.stack(rows), np.stack(states)))


def records_from(
    model: RigModel, excitation: Excitation, configuration: str, start_time: float, n: int, start: State
) -> FloatArray:  # fmt: skip
    """The first `n` records of a rig's sensors from a state, shape (channels, n); `start_time` is as in `simulate`. Raises
    SimulationError if the motion grows without bound."""
    motion = simulate(model, excitation, configuration=configuration, start_time=start_time, samples=n, start=start).channels
    recorded = record(model, {**true_drives(model, excitation, n), **motion}, excitation.sample_rate)
    return np.stack([recorded[sensor.channel] for sensor in model.sensors])
