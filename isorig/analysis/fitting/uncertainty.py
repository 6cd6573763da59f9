"""The uncertainty of fitted values and the noise floor, defined once for every command.

The standard uncertainty of a value is the larger of that from the residual, frequency bin by bin (`influence`), and that from
draws of the noise in drive and responses (`drive_noise`). Where runs ask for values that differ by more than this noise, that of
the runs takes its place. A smaller time step is added. A model that misfits biases every value; its error relative to the signal
bounds the bias and is added, too. If the description gives the uncertainty of a mass or of the drive's factor (`mass_std`,
`factor_std`), or the recording that of its sensors' calibration or of the weighed masses (`CALIBRATION`, `MASS_STD`), it is
propagated through the fit; otherwise these are treated as exact.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.fitting.drive_noise import DriveNoise, drive_noise_effect, no_noise, without_bias
from isorig.analysis.fitting.excess import SIMULATION_LIMIT
from isorig.analysis.fitting.influence import (
    STEPS,
    at_minimum,
    change_with_half_step,
    changes_with_given_values,
    changes_without_bins,
    normalised,
)
from isorig.analysis.fitting.repeats import disturbance
from isorig.analysis.fitting.residual_analysis import UNRELATED, depends_on_drive
from isorig.analysis.fitting.score import Score, adequate, noise_floors, score
from isorig.analysis.fitting.solve import Fit, Free, bending, disagreement, slopes_of
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.jackknife import deviation
from isorig.analysis.model.rig_model import RigModel

#: Held-out error, as a share of the signal, above which an error is a misfit and never noise. Chosen: where model and measurement
#: drift apart that far, what is left is no longer coherent with the simulated motion, and sensors are better than a tenth.
MOST_NOISE = 0.1
#: Mean excess error, as a share of the signal, from which a misfit is stated and added to every value.
STATED = 0.01
#: Mean excess error, as a share of the signal, from which a fit is not refined further and noise in the drive not propagated.
#: Chosen: the bias that is added to every value (`STATED`) is then far larger than what noise changes.
BIASED = 0.02
#: Ratio of the errors with and without the correction for noise in the drive from which the correction is dropped. Chosen: the
#: true values err as little as the fitted ones; a correction that does more harm is outside the range of its linear theory.
HARMS = 1.1
#: The drive's factor: the head's mass.
HEAD = "drive.factor"
#: Names in a recording for the uncertainties of known values: masses in kg, and the relative sensitivity of all sensors.
CALIBRATION = "calibration_std"
MASS_STD = {"head_mass_std": HEAD, "motor_mass_std": "bodies.motor.mass", "heatblock_mass_std": "bodies.heatblock.mass"}
#: Relative uncertainty due to the instrument's sampling filter, which the estimate does not include: determined by fits to
#: recordings with filters of 0.75 to 2.5 times the length of ours.
UNSEEN = {"mass": 5e-6, "frequency": 1e-6, "damping": 1.5e-5, "friction": 5e-6}
#: Kind of a value that may be zero or negative (an offset, a point of a curve): its uncertainty may exceed its size.
ANY_SIGN = "any sign"
#: Probability with which differences between runs that are noise count as more.
CHANCE = 0.01


@dataclass(frozen=True, kw_only=True)
class Assessed:
    """A fit at its minimum, without the bias by noise, and what is known of its errors."""

    fit: Fit  #: The fit with its complete covariance.
    score: Score  #: Its errors on held-out data.
    floors: FloatArray  #: The error of a perfect model in each run and channel, shape (runs, channels).
    explained: bool  #: Whether noise explains the errors.
    #: Error above the noise and the accuracy of the simulation, as a share of the signal; zero if it is not stated.
    misfit: float
    noise: str  #: A sentence on noise that is not white or differs between runs, or empty.


def stated_floor(model: RigModel, trials: Sequence[Trial]) -> float:
    """The error that noise and disturbance alone typically cause: the median over runs and channels."""
    return float(np.median(np.hypot(noise_floors(model, trials)[1], disturbance(model, trials))))


def uncertain_values(known: Mapping[str, float], fitted: Fit) -> dict[str, float]:
    """Standard uncertainties of the known values of a recording or a description, by path, without those that are fitted."""
    model = fitted.model
    stated = {HEAD: model.drive.factor_std, **{f"bodies.{body.name}.mass": body.mass_std for body in model.bodies}}
    stated |= {f"more_drives.{drive.channel}.factor": drive.factor_std for drive in model.more_drives}
    stated |= {path: known[name] for name, path in MASS_STD.items() if name in known and path in stated}
    found = {path: std for path, std in stated.items() if path not in fitted.values}
    if CALIBRATION in known:
        paths = ("drive.chain.gain", *(f"sensors.{sensor.channel}.chain.gain" for sensor in model.sensors))
        found |= dict.fromkeys(paths, known[CALIBRATION])
    return {path: std for path, std in found.items() if std > 0.0}


def value_kind(free: Free) -> str:
    """The kind of a fitted value, by which `UNSEEN` has its uncertainty due to the sampling filter."""
    last = free.path.rsplit(".", maxsplit=1)[-1]
    if not free.log:
        return ANY_SIGN
    return last if last in UNSEEN else "friction" if free.path.startswith("contacts.") else "damping"


def unseen(value: float, kind: str) -> float:
    """The standard uncertainty of a value of some kind due to the instrument's sampling filter, in its unit."""
    return UNSEEN.get(kind, UNSEEN["damping"]) * abs(value)


def assessed(
    done: Fit, trials: Sequence[Trial], known_values: Mapping[str, float], floors: FloatArray | None = None
) -> Assessed:  # fmt: skip
    """The fit at its minimum with its uncertainty, and its noise floor.

    Parameters
    ----------
    done
        The fit.
    trials
        Its runs, on the grid for judging models.
    known_values
        The known values of the recording.
    floors
        The noise floor of the unrefined fit, whose values differ by less than their uncertainty, shape (runs, channels);
        computed if None.
    """
    if floors is None:  # the noise of the sensors, that of the drive through the model, and what repeated runs do not share
        floors = np.hypot(noise_floors(done.model, trials)[0], disturbance(done.model, trials))
    judged = score(done.model, trials)
    biased = _excess(judged, floors) >= BIASED and not _noisy(done, judged, trials)
    done = at_minimum(done, trials, steps=1 if biased else STEPS)
    judged, of_drive = score(done.model, trials), no_noise(done)
    if not biased:
        of_drive = drive_noise_effect(done, trials)
        done, judged = _corrected(done, judged, of_drive, trials)
    explained = adequate(judged, np.hypot(floors, SIMULATION_LIMIT))
    noise = ""
    if not explained and _noisy(done, judged, trials):
        ratio = float(np.max(judged.error / floors))
        noise = (
            f"What the model leaves is up to {ratio:.2g} times the sensors' white noise, but is {UNRELATED}: it is taken as "
            "noise, with its spectrum and its level in each run."
        )
        floors, explained = np.maximum(floors, judged.error), True
    # A misfit above the accuracy of the simulation biases every parameter; its size relative to the signal bounds the bias.
    misfit = 0.0 if explained else max(0.0, _excess(judged, floors) - 2.0 * SIMULATION_LIMIT)
    misfit = misfit if misfit >= STATED else 0.0
    known = Known(
        moves=changes_without_bins(done, trials), held=_held(done), noise=of_drive.covariance, runs=disagreement(done),
        ratio=_by_chance(trials) if explained else 1.0, step=change_with_half_step(done, trials),
        bias=misfit * np.array([abs(value) for value in done.values.values()]),
        given=changes_with_given_values(done, trials, uncertain_values(known_values, done)),
        filters=np.array([unseen(done.model.get(free.path), value_kind(free)) for free in done.free]),
    )  # fmt: skip
    return Assessed(
        fit=replace(done, covariance=known.covariance, known=known), score=judged, floors=floors, explained=explained,
        misfit=misfit, noise=noise,
    )  # fmt: skip


def _corrected(done: Fit, judged: Score, of_drive: DriveNoise, trials: Sequence[Trial]) -> tuple[Fit, Score]:
    # The fit without its bias by noise in the drive, and its errors; with its bias where the correction makes them larger.
    corrected = without_bias(done, of_drive)
    after = score(corrected.model, trials)
    return (done, judged) if after.figure >= HARMS * judged.figure else (corrected, after)


def _excess(judged: Score, floors: FloatArray) -> float:
    # rms error beyond the noise, as a share of the signal.
    return float(np.sqrt(max(float(np.mean(judged.error**2 - floors**2)), 0.0)))


def _noisy(done: Fit, judged: Score, trials: Sequence[Trial]) -> bool:
    # Whether what the model leaves may be taken as noise.
    return judged.figure < MOST_NOISE and not depends_on_drive(done.model, trials)


@dataclass(frozen=True, kw_only=True)
class Known:
    """What determines the uncertainty of fitted values, in their units."""

    moves: FloatArray  #: Their changes without each frequency bin, shape (bins, k).
    held: FloatArray  #: Covariance of the points of curves by what their smoothness allows, shape (k, k).
    #: Covariance by draws of the noise in drive and responses, and by the differences between runs, shape (k, k).
    noise: FloatArray
    runs: FloatArray
    ratio: float  #: Ratio of the variance by the runs to that by the noise from which the differences between runs count.
    step: FloatArray  #: Their changes with half the time step, shape (k,).
    bias: FloatArray  #: Bound of the bias by a misfit, shape (k,).
    given: FloatArray  #: Their changes with one standard uncertainty of each known value, shape (known values, k).
    filters: FloatArray  #: Their uncertainties due to the instrument's sampling filter, shape (k,).

    @property
    def std(self) -> FloatArray:
        """Standard uncertainties of the values, shape (k,)."""
        return np.hypot([self.deviation(row) for row in np.eye(len(self.bias))], self.filters)

    def deviation(self, slope: FloatArray) -> float:
        """Standard uncertainty of a quantity with derivatives `slope` with respect to the values, shape (k,)."""
        return float(np.hypot(self._of_this_fit(slope), np.linalg.norm(self.given @ slope)))

    def _of_this_fit(self, slope: FloatArray) -> float:
        bins = deviation(self.moves, slope) ** 2 + float(slope @ self.held @ slope)
        variance, runs = max(bins, float(slope @ self.noise @ slope), 0.0), float(slope @ self.runs @ slope)
        variance = runs if runs > self.ratio * variance else variance
        return float(np.sqrt(variance + (self.step @ slope) ** 2 + float(((self.bias * slope) ** 2).sum())))

    @property
    def covariance(self) -> FloatArray:
        """Of the values for draws of them, shape (k, k): by the bins, in the size of their standard uncertainties together.

        Without the known values: what follows from the fit shares their errors.
        """
        bins = self.moves.T @ self.moves + self.held
        plain = np.sqrt(np.maximum(np.diag(bins), 1e-300))
        whole = np.array([self._of_this_fit(row) for row in np.eye(len(plain))])
        stretch = float(np.median(whole / plain)) if len(plain) else 1.0
        return np.asarray(stretch**2 * bins)


def _by_chance(trials: Sequence[Trial]) -> float:
    # The variance between a few runs is itself uncertain: of independent noise it follows a chi-square distribution.
    from scipy.special import chdtri

    degrees = max(sum(trial.fitted > 0 for trial in trials) - 1, 1)
    return float(chdtri(degrees, CHANCE) / degrees)


def _held(done: Fit) -> FloatArray:
    # Points of a curve are also held by their neighbours, to the deviation that their smoothness allows.
    rows, _ = bending(done.model, done.free)
    if not len(rows):
        return np.zeros((len(done.free),) * 2)
    scale, _, bread = normalised(done)
    pulled = (rows / scale) @ bread / scale * slopes_of(done.model, done.free)
    return np.asarray(pulled.T @ pulled)
