"""Small errors of all channels together: delays, sensitivities and crosstalk within what good instruments have.

Each alone explains little of a small misfit, so that none of them is a cause that a search finds.
"""

from collections.abc import Sequence

import numpy as np

from isorig.analysis.diagnose.causes.measurement_chain import chain_of, sensor_channels, with_chain
from isorig.analysis.diagnose.policy import POLICY
from isorig.analysis.errors import FitError
from isorig.analysis.fitting.residuals import Problem
from isorig.analysis.fitting.solve import Fit, Free, fit
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.wording import in_per_cent, sized

#: Largest errors: a delay in samples, a sensitivity's relative error, and the share of another channel, both as recorded, in rms.
#: Chosen: calibrated sensors are within 2 %, inputs of one converter within a sample and 3 % crosstalk; what is more is a fault.
DELAY, SENSITIVITY, CROSSTALK = 1.0, 0.02, 0.03
#: Weight of a value's distance from zero, in hundreds of finite differences: so small that it only holds what the data do not
#: determine.
TETHER = 1e-3
#: Share of these errors from which one is listed. Chosen: a calibration tells no more.
LISTED = 0.1
STEPS = 8  #: Jacobians of the fit. Chosen: small errors are nearly linear.


def with_chain_errors(known: Fit, trials: Sequence[Trial]) -> Fit | None:
    """A model fitted again together with small errors of all sensors' channels; None where a rig is judged by its drive.

    Raises OutOfTimeError if the time limit ends the fit.
    """
    if any(trial.motion is not None for trial in trials):
        return None
    size = _levels(known.model, trials)
    model, free = known.model, list(known.free)
    taken = {each.path for each in free}
    for channel in (name for name in sensor_channels(model) if size[name] > 0.0):
        chain, path = chain_of(model, channel)
        sources = [name for name in size if name != channel and size[name] > 0.0 and name not in chain.crosstalk]
        model = with_chain(model, channel, crosstalk=chain.crosstalk | dict.fromkeys(sources, 0.0))
        late = DELAY / trials[0].sample_rate
        errors = [
            Free(path=f"{path}.delay", low=chain.delay - late, high=chain.delay + late, log=False, step=0.02 * late),
            Free(path=f"{path}.gain", low=chain.gain / (1.0 + SENSITIVITY), high=chain.gain * (1.0 + SENSITIVITY)),
        ]
        for source in sources:
            most = CROSSTALK * size[channel] / size[source]
            errors.append(Free(path=f"{path}.crosstalk.{source}", low=-most, high=most, log=False, step=0.02 * most))
        free += [each for each in errors if each.path not in taken]
    try:
        return fit(model, free, Problem(trials), iterations=STEPS, tolerance=1e-3, tether=TETHER)
    except FitError:
        return None


def in_words(known: Fit, fitted: Fit, trials: Sequence[Trial]) -> list[str]:
    """The errors that are larger than their uncertainty and than a calibration tells, one phrase each."""
    size, late, said = _levels(known.model, trials), DELAY / trials[0].sample_rate, []
    for path, value in fitted.values.items():
        _, channel, *rest = path.split(".")
        if path in known.values or rest[:1] != ["chain"]:
            continue
        before = 0.0 if rest[1] == "crosstalk" else known.model.get(path)
        if abs(value - before) <= POLICY.zero * fitted.std[path]:
            continue
        match rest[1:]:
            case ["delay"] if abs(value - before) >= LISTED * late:
                said.append(f"{channel} is {sized(abs(value - before), 's')} {'late' if value > before else 'early'}")
            case ["gain"] if abs(error := value / before - 1.0) >= LISTED * SENSITIVITY:
                said.append(f"{channel} reads {in_per_cent(abs(error))} {'more' if error > 0.0 else 'less'}")
            case ["crosstalk", source] if (share := abs(value) * size[source] / size[channel]) >= LISTED * CROSSTALK:
                said.append(f"{channel} contains {in_per_cent(share)} of {source}")
    return said


def _levels(model: RigModel, trials: Sequence[Trial]) -> dict[str, float]:
    # Rms of each channel over all runs.
    rows = {model.drive.channel: [trial.excitation.recorded for trial in trials]}
    for k, name in enumerate(trials[0].channels):
        rows[name] = [trial.measured[k] for trial in trials]
    return {name: float(np.sqrt(np.mean([np.mean(values**2) for values in each]))) for name, each in rows.items()}
