"""The restoring-force surface of a link: transmitted force over relative displacement and velocity.

Masri and Caughey (1979). The force follows from the free body: F = push - sum of m a, over the bodies beyond the link.
"""

from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import FloatArray, Run
from isorig.analysis.diagnose.estimate_pairs import Double
from isorig.analysis.diagnose.link_force import FEWEST, link_record
from isorig.analysis.model.rig_model import Link, RigModel

#: Bins of the swing, and intervals of a run whose spread gives the standard deviations.
BINS, STRETCHES = 6, 8
#: Share of the force that a spring, a damper, nonlinear ones and friction must explain; otherwise noise dominates.
CLEAR = 0.8
#: Limits of slow, medium and fast sliding: shares of the largest velocity.
PACES = ((0.05, 0.15), (0.25, 0.45), (0.6, 0.9))
#: Points stored for a plot.
SHOWN = 1200


@dataclass(frozen=True, kw_only=True)
class Surface:
    """A link's force, measured and simulated."""

    #: Names.
    link: str
    run: str
    #: Samples of the measured record for a plot, m, m/s, N, shape (points,).
    displacement: FloatArray
    velocity: FloatArray
    force: FloatArray
    simulated: FloatArray  #: The force of the simulated record at the same times, N, shape (points,).
    swing: float  #: Deflection at the outermost bin, m.
    stiffness: FloatArray  #: Secant stiffness by deflection from the middle outwards, N/m, shape (bins,).
    friction: float  #: Mean of the force that reverses with the velocity, N.
    #: (value, standard deviation) in addition to the simulated record's: relative increase of the stiffness from the middle to
    #: the ends; difference of the damping between the two directions at full velocity, N; additional friction of slow and fast
    #: sliding relative to medium velocities, N.
    stiffening: tuple[float, float]
    direction: tuple[float, float]
    bending: tuple[float, float]


def passed(model: RigModel, link: Link, run: Run) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Deflection (m), velocity (m/s) and force (N) of a link in a run, each of shape (samples,), without the record's edges.

    None if the bodies beyond the link are not all measured.
    """
    seen = link_record(model, link, run)
    if seen is None:
        return None
    inertia = sum(model.body(name).mass * values for name, values in seen.acceleration.items())
    return seen.deflection, seen.velocity, seen.sign * (model.drive.factor * seen.push - inertia)


def surface_of(model: RigModel, link: Link, pair: Double) -> Surface | None:
    """The surface of a link in a run; None if no body with an accelerometer has this link only, or noise dominates."""
    measured, simulated = (passed(model, link, run) for run in (pair.measured, pair.simulated))
    if measured is None or simulated is None:
        return None
    if len(measured[0]) < 64 * STRETCHES or float(np.std(measured[0])) == 0.0:
        return None
    swing, speed = (float(np.quantile(np.abs(x), 0.98)) for x in measured[:2])
    n = len(measured[0])
    whole = [_figures(*part, swing, speed) for part in (measured, simulated)]
    if whole[0].explained < CLEAR:
        return None
    stretches = []
    for k in range(STRETCHES):
        part = slice(n * k // STRETCHES, n * (k + 1) // STRETCHES)
        measured_part, simulated_part = ((d[part], v[part], force[part]) for d, v, force in (measured, simulated))
        stretches.append(_figures(*measured_part, swing, speed).signs - _figures(*simulated_part, swing, speed).signs)
    value = whole[0].signs - whole[1].signs
    # An interval that never reaches the ends of the swing is not used for them.
    simulated_part = np.isfinite(stretches).sum(axis=0)
    error = (
        np.nanstd(stretches, axis=0, ddof=1) / np.sqrt(simulated_part)
        if simulated_part.min() > 1
        else np.full(len(value), np.inf)
    )
    pairs = [(float(v), float(e)) for v, e in zip(value, error, strict=True)]
    chosen = slice(None, None, max(1, n // SHOWN))
    return Surface(
        link=link.name, run=pair.trial.run.id, displacement=measured[0][chosen], velocity=measured[1][chosen],
        force=measured[2][chosen], simulated=simulated[2][chosen], swing=swing,
        stiffness=whole[0].stiffness, friction=whole[0].friction,
        stiffening=pairs[0], direction=pairs[1], bending=pairs[2],
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class _Figures:
    # Stiffness by deflection, mean friction, and (stiffening, direction, bending).
    stiffness: FloatArray
    friction: float
    signs: FloatArray
    explained: float


def _figures(d: FloatArray, v: FloatArray, force: FloatArray, swing: float, speed: float) -> _Figures:
    basis = np.column_stack([d, v, np.sign(v)])
    k, c, rubbing = weights = np.linalg.lstsq(basis, force, rcond=None)[0]
    curved = np.column_stack([basis, d**3, v * np.abs(v)])
    left = force - curved @ np.linalg.lstsq(curved, force, rcond=None)[0]
    explained = 1.0 - float(np.var(left) / max(float(np.var(force)), 1e-300))
    spring = force - c * v - rubbing * np.sign(v)
    place = np.minimum((BINS * np.abs(d) / swing).astype(int), BINS - 1)
    power = np.bincount(place, d**2, minlength=BINS)
    stiffness = np.bincount(place, spring * d, minlength=BINS) / np.maximum(power, 1e-300)
    along = (force - k * d) * np.sign(v)
    pace = np.abs(v) / speed
    slow, between, fast = (along[(pace > low) & (pace <= high)] for low, high in PACES)
    enough = min(len(slow), len(between), len(fast)) > 0
    # An accelerometer does not measure constant forces: of the difference between directions, use only the velocity-dependent
    # part.
    even = pace - pace.mean()
    direction = float((force - basis @ weights) @ even / (even @ even))
    # Viscous damping is a straight line through the three.
    at = [np.mean([low, high]) for low, high in PACES]
    share = (at[1] - at[0]) / (at[2] - at[0])
    bending = float((1 - share) * slow.mean() + share * fast.mean() - between.mean()) if enough else np.nan
    # The innermost bin would divide by nearly zero.
    enough = np.bincount(place, minlength=BINS)[[1, -1]].min() >= FEWEST
    growth = float(stiffness[-1] / stiffness[1] - 1.0) if enough else np.nan
    return _Figures(
        stiffness=stiffness, friction=float(rubbing), signs=np.array([growth, direction, bending]), explained=explained
    )
