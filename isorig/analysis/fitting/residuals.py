"""The residuals of models over the runs of a fit: each frequency bin of a record, weighted by its allowed error."""

from collections.abc import Sequence
from contextlib import suppress
from copy import copy
from typing import Self

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.deadline import ask_time, count_samples
from isorig.analysis.errors import FitError, ModelError, SimulationError
from isorig.analysis.fitting.trials import SIGNAL_SHARE, Trial, expected, true_motion
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.parallel import side_by_side
from isorig.analysis.simulate.compiled import compile_rig

#: A channel's allowed error is at least this share of its largest rms in any run.
QUIET = 1e-4
#: Parts into which a step of the simulation may be divided for a model on the way of a fit, unless the first one needs more.
#: Chosen: fits that ended well passed models with up to 130; a curve with slopes beyond what records show needs thousands.
FINEST = 256


class Waveform:
    """Every frequency bin of a record, weighted by noise, the run's disturbance and the accuracy of the simulation.

    Without a disturbance, an orthonormal transform of the residual in time, so least squares is equivalent, up to the trial's
    ceiling.
    """

    def __init__(self, trial: Trial, share: float, least: FloatArray) -> None:
        n = trial.fitted
        self._lines = int(min(trial.ceiling, trial.usable) / trial.sample_rate * n) + 1
        measured = trial.measured[:, :n]
        sigma = np.maximum(np.sqrt(trial.noise**2 + (share * trial.signal[:, :n].std(axis=1)) ** 2), least)[:, None]
        if trial.disturbance is not None:
            sigma = np.hypot(sigma, trial.disturbance.at(np.arange(self._lines) * trial.sample_rate / n))
        self._weights = np.sqrt(2.0 / n) / sigma
        self._measured = measured
        self.size = 2 * self._lines * len(measured)

    def write_residual(self, predicted: FloatArray, out: FloatArray) -> None:
        """Write the weighted residual of predicted channels to `out`, shape (size,)."""
        error = np.fft.rfft(predicted - self._measured, axis=1)[:, : self._lines]
        parts = out.reshape(2, *error.shape)
        np.multiply(error.real, self._weights, out=parts[0])
        np.multiply(error.imag, self._weights, out=parts[1])


class Problem:
    """The residuals of models over a set of trials, as one weighted vector.

    Parameters
    ----------
    trials
        The prepared runs.
    share
        Share of a channel's rms that counts as noise in the weights.
    among
        The runs whose largest level of a channel bounds its allowed error; `trials` if None.
    """

    def __init__(
        self, trials: Sequence[Trial], *, share: float = SIGNAL_SHARE, among: Sequence[Trial] | None = None
    ) -> None:  # fmt: skip
        fitted = [trial for trial in trials if trial.fitted > 0]
        if not fitted:
            raise FitError("every run is held out, so there is nothing to fit; mark at least one run for fitting")
        self.trials = tuple(fitted)
        # A body held by friction may have a record without any noise.
        sizes = np.max([trial.signal.std(axis=1) for trial in among or trials], axis=0)
        least = np.where(sizes > 0.0, QUIET * sizes, 1.0)
        self._gauges = [Waveform(trial, share, least) for trial in self.trials]
        self.sizes = tuple(gauge.size for gauge in self._gauges)
        self.size = sum(self.sizes)
        # Of the trials that are simulated, the configurations and fine steps; one judged by its drive is not.
        simulated = ((t.run.configuration, t.excitation) for t in self.trials if t.motion is None)
        self._steps = {(name, drive.step) for name, drive in simulated}
        # The last model that was simulated alone: a parameter without effect in a run leaves its residual there.
        self._last: dict[int, tuple[bytes, FloatArray]] = {}
        self._near = b""

    def about(self, model: RigModel) -> Self:
        """The same residuals for models close to one; see `Trial.about`."""
        if all(trial.moving is None for trial in self.trials) or self._near == model.encoded:
            return self
        near = copy(self)
        near.trials, near._last, near._near = tuple(trial.about(model) for trial in self.trials), {}, model.encoded
        return near

    def parts_of_step(self, model: RigModel) -> int:
        """Maximum number of parts into which the simulation of a model divides a fine step, 1 if no trial is simulated.

        The time of the simulation is proportional to it.
        """
        return max((compile_rig(model, configuration, step).cuts for configuration, step in self._steps), default=1)

    def most_parts(self, start: RigModel) -> int:
        """Maximum number of parts for the models of a fit from a starting point (`FINEST`)."""
        with suppress(ModelError):  # one that cannot be simulated has none
            return max(FINEST, self.parts_of_step(start))
        return FINEST

    def residuals(self, models: Sequence[RigModel]) -> FloatArray:
        """Weighted residuals of several models in parallel, shape (models, size); NaN if a model diverged.

        Raises OutOfTimeError if the time limit was reached before; none is simulated then.
        """
        ask_time()
        ends = np.cumsum([gauge.size for gauge in self._gauges])
        out = np.empty((len(models), ends[-1]))

        def one(job: tuple[int, int]) -> None:
            which, index = job
            part = out[which, ends[index] - self._gauges[index].size : ends[index]]
            trial = self.trials[index]
            seen = trial.seen_of(models[which])
            if index in self._last and self._last[index][0] == seen:
                part[:] = self._last[index][1]
                return
            try:
                predicted = expected(models[which], trial, true_motion(models[which], trial, trial.fitted))
                self._gauges[index].write_residual(predicted, part)
            except (SimulationError, ModelError):  # it grows without bound, or moves too fast for any step
                part[:] = np.nan
            if len(models) == 1:
                self._last[index] = seen, part.copy()

        count_samples(len(models) * sum(trial.fitted * trial.excitation.oversample for trial in self.trials))
        side_by_side(one, [(which, index) for which in range(len(models)) for index in range(len(self.trials))])
        return out
