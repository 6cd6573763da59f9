"""The best values of chosen parameters of any rig: the smallest target within the limits, by simulation of a given drive."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import DataError, ModelError, SimulationError
from isorig.analysis.model.limits import Limits
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.model.spring import uncoupled_frequency, with_frequency
from isorig.analysis.parallel import side_by_side
from isorig.analysis.simulate import Excitation, simulate
from isorig.analysis.simulate.free_run import true_drives
from isorig.analysis.simulate.gauges import DEFLECTION, gauged

#: Last part of a varied parameter `links.NAME.frequency`: the link's stiffness and damping change together.
FREQUENCY = "frequency"
#: Weight of a limit that is exceeded, in the logarithm of the target: an exact penalty, so that the search ends at the limit.
PENALTY = 100.0
#: Relative accuracy of the best values, and maximum number of simulated designs in the refinement for each varied parameter.
ACCURACY, STEPS = 1e-4, 120
#: Share of the range, on its logarithmic scale, within which a best value counts as being at the bound.
AT_BOUND = 1e-3


class Varied(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A parameter that may vary, between two positive bounds.

    `parameter` is its path in the description; `links.NAME.frequency` is sqrt(k / m) / 2 pi of the link's body `a`, Hz, with
    unchanged damping ratio.
    """

    parameter: str
    low: float
    high: float

    def at(self, share: FloatArray | float) -> FloatArray:
        """Values at shares 0 to 1 of the range, on a logarithmic scale."""
        return np.asarray(self.low * (self.high / self.low) ** np.asarray(share))


@dataclass(frozen=True, kw_only=True)
class Target:
    """What is to be as small as possible, within a band (Hz) and under a given drive."""

    #: "transmissibility": rms of `response` divided by the rms of `reference`; "ratio": rms of `response` in the first
    #: configuration divided by that in the second; "rms": rms of `response`.
    what: Literal["transmissibility", "ratio", "rms"]
    #: Channels of the rig.
    response: str
    reference: str
    configurations: tuple[str, ...]  #: One configuration; two for a ratio.
    band: tuple[float, float]  #: Lowest and highest frequency, Hz.


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """A simulated design: its target, and the largest magnitude divided by the allowed one by limit; infinite if it diverges."""

    value: float
    used: Mapping[str, float]

    @property
    def inside(self) -> bool:
        """Whether it stays within all limits."""
        return bool(np.isfinite(self.value)) and all(share <= 1.0 for share in self.used.values())

    @property
    def cost(self) -> float:
        """Logarithm of the target, with a penalty for exceeded limits."""
        if not np.isfinite(self.value):
            return float("inf")
        return float(np.log(max(self.value, 1e-300)) + PENALTY * np.log(max([1.0, *self.used.values()])))


@dataclass(frozen=True, kw_only=True)
class Optimum:
    """The result of a search."""

    values: Mapping[str, float]  #: The best values by parameter.
    model: RigModel  #: The rig with these values.
    #: Outcomes of the given rig and of the best one; the best one exceeds a limit if no simulated design keeps all.
    present: Outcome
    best: Outcome
    at_bound: tuple[str, ...]  #: Parameters whose best value is at a bound: a wider range may contain a better one.
    designs: int  #: Number of simulated designs.


def value_of(model: RigModel, parameter: str) -> float:
    """The present value of a varied parameter."""
    link = _link_of(parameter)
    return model.get(parameter) if link is None else uncoupled_frequency(model, link)


def with_values(model: RigModel, values: Mapping[str, float]) -> RigModel:
    """The rig with other values of varied parameters; masses first, because a frequency refers to its body's mass."""
    frequencies = {link: value for name, value in values.items() if (link := _link_of(name)) is not None}
    plain = {name: value for name, value in values.items() if _link_of(name) is None}
    model = model.replace({name: value for name, value in plain.items() if name.startswith("bodies.")})
    free = model.free
    for link, value in frequencies.items():
        model = with_frequency(model, link, value)
    return msgspec.structs.replace(model, free=free).replace(plain)


def _link_of(parameter: str) -> str | None:
    # The link whose frequency varies; None if another parameter does.
    match parameter.split("."):
        case "links", link, last if last == FREQUENCY:
            return link
    return None


def outcome(model: RigModel, target: Target, limits: Limits, drive: Excitation) -> Outcome:
    """Simulate a rig in the target's configurations, and evaluate target and limits.

    The limits' strokes and channels limit the true motion in every simulated configuration.
    """
    names = {f"the deflection of {name}": (DEFLECTION + name, most) for name, most in limits.stroke.items()}
    names |= {f"the record of {name}": (name, most) for name, most in limits.channels.items()}
    sizes, used = [], dict.fromkeys(names, 0.0)
    try:
        for configuration in target.configurations:
            rig = gauged(model, configuration)
            seen = simulate(rig, drive, configuration=configuration).channels | true_drives(model, drive)
            sizes.append(_rms(seen[target.response], drive.sample_rate, target.band))
            if target.what == "transmissibility":
                sizes.append(_rms(seen[target.reference], drive.sample_rate, target.band))
            for name, (channel, most) in names.items():
                # A locked link has no deflection.
                peak = float(np.abs(seen[channel]).max(initial=0.0)) if channel in seen else 0.0
                used[name] = max(used[name], peak / most)
    except (SimulationError, ModelError):
        return Outcome(value=float("inf"), used=dict.fromkeys(names, float("inf")))
    above, below = sizes if len(sizes) == 2 else (sizes[0], 1.0)
    if below <= 0.0:
        raise DataError(
            f"the denominator of the target does not move between {target.band[0]:g} and {target.band[1]:g} Hz; give a band that "
            "the drive excites"
        )
    return Outcome(value=above / below, used=used)


def _rms(values: FloatArray, rate: float, band: tuple[float, float]) -> float:
    # Parseval: rms of the part of a record within the band.
    n = len(values)
    frequency = np.fft.rfftfreq(n, 1.0 / rate)
    kept = (frequency >= band[0]) & (frequency <= band[1])
    return float(np.sqrt(2.0 * np.sum(np.abs(np.fft.rfft(values)[kept]) ** 2)) / n)


def outcomes(models: Sequence[RigModel], target: Target, limits: Limits, drive: Excitation) -> list[Outcome]:
    """The outcomes of several rigs, simulated in parallel."""
    return side_by_side(lambda model: outcome(model, target, limits, drive), models)


def optimum(
    model: RigModel, varied: Sequence[Varied], target: Target, limits: Limits, drive: Excitation, *, points: int,
    seed: int,
) -> Optimum:  # fmt: skip
    """Search the values with the smallest target within the limits.

    At least `points` designs of a Sobol sequence fill the ranges on a logarithmic scale (on an even grid for one parameter); the
    best of them is refined by the method of Nelder and Mead (1965). Raises DataError if no design can be simulated, or the target
    is not defined.
    """
    from scipy.optimize import minimize
    from scipy.stats import qmc

    count = len(varied)
    if count == 1:
        shares = np.linspace(0.0, 1.0, points)[:, None]
    else:
        shares = qmc.Sobol(count, rng=seed).random_base2(int(np.ceil(np.log2(points))))

    def built(share: FloatArray) -> RigModel:
        return with_values(model, {v.parameter: float(v.at(s)) for v, s in zip(varied, share, strict=True)})

    present = outcome(model, target, limits, drive)
    tried = outcomes([built(share) for share in shares], target, limits, drive)
    costs = np.array([each.cost for each in tried])
    first = int(np.argmin(costs))
    if not np.isfinite(costs[first]):
        raise DataError("no design within the bounds can be simulated: its motion grows without bound; give other bounds")
    # The first simplex has the distance between neighbouring designs.
    step = 1.0 / len(shares) ** (1.0 / count)
    corners = np.vstack([shares[first], *(shares[first] + step * row for row in np.eye(count))])
    corners = np.where(corners > 1.0, shares[first] - step, corners)

    def cost(share: FloatArray) -> float:
        return outcome(built(share), target, limits, drive).cost

    refined = minimize(
        cost, shares[first], method="Nelder-Mead",
        bounds=[(0.0, 1.0)] * count,
        options={"initial_simplex": np.clip(corners, 0.0, 1.0), "xatol": ACCURACY, "fatol": ACCURACY, "maxfev": STEPS * count},
    )  # fmt: skip
    share = refined.x if refined.fun < costs[first] else shares[first]
    values = {v.parameter: float(v.at(s)) for v, s in zip(varied, share, strict=True)}
    best = with_values(model, values)
    return Optimum(
        values=values, model=best, present=present, best=outcome(best, target, limits, drive),
        at_bound=tuple(v.parameter for v, s in zip(varied, share, strict=True) if min(s, 1.0 - s) < AT_BOUND),
        designs=len(shares) + int(refined.nfev),
    )  # fmt: skip
