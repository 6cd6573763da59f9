"""The run that reduces the uncertainty of a parameter to a required value: optimal design for precision.

The information of runs on the fitted values adds up, and the uncertainty of a parameter follows from the sum (c-optimality,
Atkinson, Donev and Tobias 2007, ch. 10). For parameters determined by masses, stiffness and damping, the information is computed
from the run's transfer functions, weighted with their error bars: friction reduces the coherence, which widens the error bars.
For all others it is computed from the waveforms. In both cases it is scaled to the uncertainty obtained from the existing runs.
"""

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import DataError, ModelError
from isorig.analysis.excitations import PLAYED_BROAD
from isorig.analysis.model.limits import Limits
from isorig.analysis.model.linear import transfer
from isorig.analysis.model.parameter_units import unit_of
from isorig.analysis.model.rig_model import RigModel, single_drive
from isorig.analysis.model.spring import uncoupled_frequency
from isorig.analysis.proposals.limits import LargestMotions
from isorig.analysis.proposals.menu import cost
from isorig.analysis.proposals.policy import POLICY
from isorig.analysis.proposals.prediction import Predicted, Prospect, Variant, prior_precision
from isorig.analysis.simulate import simulate
from isorig.analysis.spectra.welch import estimate

ParameterValue = Callable[[RigModel], float]


def parameter_by_name(model: RigModel, name: str) -> ParameterValue:
    """A parameter by its name in the parameter table, or by its path in the model.

    `<body>_mass` in kg; `<body>_frequency` = sqrt(k / m) / 2 pi in Hz and `<body>_damping` = c / (2 sqrt(k m)) of the link that
    supports the body; `friction_force` of the rig's only contact, N. Raises ModelError if the rig has no such parameter; the
    message lists the available ones.
    """
    if "." in name:
        model.get(name)
        return lambda rig: rig.get(name)
    known = named_parameters(model)
    if name not in known:
        raise ModelError(f"the rig has no parameter {name!r}; it has {', '.join(known)}, and {', '.join(model.free)} by path")
    return known[name]


def named_parameters(model: RigModel) -> dict[str, ParameterValue]:
    """All parameters of the parameter table by name."""
    found: dict[str, ParameterValue] = {}
    for body in model.bodies:
        link = next((link.name for link in model.links if link.a == body.name and link.stiffness > 0.0), None)
        found[f"{body.name}_mass"] = lambda rig, b=body.name: rig.body(b).mass  # type: ignore[misc]
        if link is not None:
            found[f"{body.name}_frequency"] = lambda rig, n=link: uncoupled_frequency(rig, n)  # type: ignore[misc]
            found[f"{body.name}_damping"] = lambda rig, b=body.name, n=link: (  # type: ignore[misc]
                rig.link(n).damping / (2.0 * sqrt(rig.link(n).stiffness * rig.body(b).mass))
            )
    path = [f"contacts.{c.name}.law.friction_force" for c in model.contacts if hasattr(c.law, "friction_force")]
    if len(path) == 1:
        found["friction_force"] = lambda rig: rig.get(path[0])
    return found


def unit_of_parameter(name: str, model: RigModel) -> str:
    """The unit of a parameter of `named_parameters`."""
    body, _, kind = name.rpartition("_")
    if kind == "mass":
        return unit_of(f"bodies.{body}.mass", model)
    if name == "friction_force":
        return next(unit_of(f"contacts.{c.name}.law.{name}", model) for c in model.contacts if hasattr(c.law, name))
    return "Hz" if kind == "frequency" else "1"


@dataclass(frozen=True, kw_only=True)
class PreciseRun:
    """A run for a parameter, no longer than necessary: its relative standard uncertainty after it, and the peaks of the model and
    of others drawn from its covariance, in it."""

    prospect: Prospect
    std: float
    peaks: LargestMotions


class KnownPrecision:
    """Information of the existing runs on a model's fitted values, and therefore on the parameter of interest; the noise is its
    standard deviation by channel."""

    def __init__(
        self, variant: Variant, parameter: ParameterValue, noise: Mapping[str, float], in_hand: Sequence[Prospect]
    ) -> None:
        self._variant, self._noise = variant, noise
        self.value = parameter(variant.model)
        slope = _slopes(variant, parameter)
        touched = [f.path for f, s in zip(variant.free, slope, strict=True) if s != 0.0]
        if not touched:
            raise DataError("the parameter does not depend on any fitted value: it is given, so no run can improve it")
        self.linear = all(path.startswith(("bodies.", "links.")) and ".laws." not in path for path in touched)
        self._slope = slope
        known = np.diag(prior_precision(variant.free))
        self.now = known + sum((self.information(run) for run in in_hand), np.zeros(known.shape))
        measured = std_of_parameter(variant, parameter)
        #: Measured divided by predicted standard uncertainty for the existing runs.
        self._scale = measured / sqrt(self._variance(self.now)) if measured > 0.0 else 1.0

    def std(self, information: FloatArray) -> float:
        """The parameter's relative standard uncertainty with this total information on the fitted values."""
        return self._scale * sqrt(self._variance(information)) / abs(self.value)

    def information(self, prospect: Prospect) -> FloatArray:
        """Information of a run on the search coordinates of the fitted values, the inverse of a covariance, shape (k, k)."""
        if self.linear and prospect.run.excitation in PLAYED_BROAD:
            return self._by_transfer(prospect)
        seen = Predicted(prospect, self._noise, self._variant.model)
        return np.asarray(seen.weight * np.nan_to_num(seen.slopes(self._variant).normal.sum(axis=0)))

    def _variance(self, information: FloatArray) -> float:
        return float(self._slope @ np.linalg.solve(information, self._slope))

    def _by_transfer(self, prospect: Prospect) -> FloatArray:
        # Error bars of the run's predicted transfer functions, and their derivatives with respect to the fitted values.
        model, configuration = self._variant.model, prospect.run.configuration
        single_drive(model, "a design of runs")
        excitation, rate = prospect.excitation(), prospect.sample_rate
        seen = simulate(model, excitation, configuration=configuration, start_time=prospect.start_time).channels
        generator = np.random.default_rng(9)
        records = {model.drive.channel: excitation.recorded, **seen}
        noisy = {name: v + generator.normal(0.0, self._noise.get(name, 0.0), len(v)) for name, v in records.items()}
        spectra = estimate([prospect.measured(noisy)], references=[model.drive.channel], resolution=POLICY.resolution)
        theta = self._variant.coordinates
        here = transfer(self._variant.at(theta), configuration, spectra.frequency[1:])
        columns = []
        for f, along in zip(self._variant.free, np.eye(len(theta)), strict=True):
            step = 1e-4 if f.log else f.step
            moved = self._variant.at(theta + step * along)
            columns.append((transfer(moved, configuration, spectra.frequency[1:]) - here) / step)
        rows = np.stack(columns, axis=-1)
        low, high = prospect.run.band or (0.0, rate / 2.0)
        inside = (spectra.frequency[1:] >= low) & (spectra.frequency[1:] <= high)
        whole = np.zeros((len(theta),) * 2)
        for k, sensor in enumerate(model.sensors):
            frf = spectra.frf(sensor.channel, model.drive.channel)
            good = inside & (frf.coherence[1:] > POLICY.least_coherence) & (frf.magnitude_std[1:] > 0.0)
            own = rows[k][good] / frf.magnitude_std[1:][good, None]
            whole += np.real(own.conj().T @ own)
        return np.asarray(whole * prospect.run.seconds * rate / len(excitation.recorded) / POLICY.correlated_bins)


def runs_for_uncertainty(
    known: KnownPrecision, candidates: Sequence[tuple[Prospect, FloatArray]], limits: Limits,
    kept: Callable[[Prospect], LargestMotions], *, wish: float, configuration: str, budget: float,
    most: int = POLICY.most_runs,
) -> list[PreciseRun]:  # fmt: skip
    """The cheapest runs that reduce a parameter's relative uncertainty to the required value, in order; or the most precise ones.

    `candidates` have their longest drive, and their information on the k fitted values, shape (k, k). `wish` is the required
    relative standard uncertainty; `kept`, `configuration` and `budget` are as in `choose`.
    """
    now = known.now
    runs: list[PreciseRun] = []
    left = list(candidates)
    while known.std(now) > wish and len(runs) < most and budget >= POLICY.shortest_run and left:
        shortest = [_shortest(known, now, wish, prospect, own, budget) for prospect, own in left]
        # Runs that reach the required value first, the cheapest of them; then the most precise others.
        _, prospect, own = min(
            shortest, key=lambda one: (not one[0], cost(one[1].run, configuration, limits) if one[0] else known.std(now + one[2]))
        )
        peaks = kept(prospect)
        if peaks.beyond(limits):
            left = [item for item in left if item[0].run.seed != prospect.run.seed]
            continue
        before = known.std(now)
        now = now + own
        if known.std(now) > POLICY.remaining_uncertainty * before:
            break
        runs.append(PreciseRun(prospect=prospect, std=known.std(now), peaks=peaks))
        configuration, budget = prospect.run.configuration, budget - prospect.run.seconds
    return runs


def _shortest(
    known: KnownPrecision, now: FloatArray, wish: float, prospect: Prospect, own: FloatArray, budget: float
) -> tuple[bool, Prospect, FloatArray]:
    # Whether a run reaches the required value; the run, no longer than necessary for it, and its information.
    whole = prospect.run.seconds
    longest = min(whole, budget)
    seconds = longest
    reached = known.std(now + own * longest / whole) <= wish
    if reached and prospect.run.excitation != "sweep":
        # The smallest number of whole seconds that reaches it.
        lengths = range(int(np.ceil(min(POLICY.shortest_run, longest))), int(np.ceil(longest)))
        seconds = float(lengths.start + bisect_left(lengths, True, key=lambda s: known.std(now + own * s / whole) <= wish))
    seconds = min(max(seconds, POLICY.shortest_run), longest)
    return reached, prospect.shortened(seconds), own * seconds / whole


def std_of_parameter(variant: Variant, parameter: ParameterValue) -> float:
    """A parameter's standard uncertainty by the model's own covariance, in its unit."""
    slope = _slopes(variant, parameter)
    return sqrt(max(float(slope @ variant.covariance_of_coordinates @ slope), 0.0))


def _slopes(variant: Variant, parameter: ParameterValue) -> FloatArray:
    # Derivatives of the parameter with respect to the search coordinates of the fitted values.
    theta = variant.coordinates
    steps = np.diag([1e-5 if f.log else f.step for f in variant.free])
    ends = [[parameter(variant.at(theta + way * step)) for way in (1.0, -1.0)] for step in steps]
    return np.array([above - below for above, below in ends]) / (2.0 * np.diag(steps))
