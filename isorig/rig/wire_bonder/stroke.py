"""The design study: stroke of the isolated motor for softer or stiffer springs, and the resulting isolation."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

import msgspec
import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.diagnose.causes.base import exchange
from isorig.analysis.errors import DataError
from isorig.analysis.model.linear import transfer
from isorig.analysis.model.rig_model import Body, Link, RigModel, Sensor
from isorig.analysis.model.spring import with_frequency
from isorig.analysis.simulate import Excitation, scan, simulate

#: Radius of gyration of the motor, m (its moment of inertia is m r^2), damping ratio of its rocking, and distance of the springs
#: from the centre of gravity, m, which couples rocking to the table; assumed, as the thesis does not give them.
RADIUS, DAMPING_RATIO, HEIGHT = 0.1, 0.03, 0.02


@dataclass(frozen=True, kw_only=True)
class StrokeStudy:
    """Largest displacement of the motor relative to the table, m, over isolation frequency sqrt(k / m) / 2 pi, Hz, shape (n,).

    `draws` is the same for parameters drawn from their uncertainty, shape (draws, n). The stroke is `allowed` up to the limit
    divided by the safety factor, m; above the frequency `lowest` it stays within that, NaN if there is none; `lowest_of_draws` is
    that of each draw, shape (draws,).
    """

    frequency: FloatArray
    stroke: FloatArray
    draws: FloatArray
    allowed: float
    lowest: float
    lowest_of_draws: FloatArray

    @property
    def std(self) -> float:
        """Standard uncertainty of the lowest frequency due to the parameters, Hz."""
        found = self.lowest_of_draws[np.isfinite(self.lowest_of_draws)]
        return float(found.std(ddof=1)) if len(found) > 1 else 0.0

    @property
    def recommended(self) -> float:
        """Frequency for which 95 % of the draws stay within the limit, Hz; `lowest` without draws; NaN if too few do."""
        if len(self.lowest_of_draws) == 0:
            return self.lowest
        return float(np.quantile(np.where(np.isfinite(self.lowest_of_draws), self.lowest_of_draws, np.inf), 0.95))


def frictionless(model: RigModel) -> RigModel:
    """The rig without its contacts."""
    return msgspec.structs.replace(model, contacts=(), free=())


def strokes(models: Sequence[RigModel], frequencies: FloatArray, head: FloatArray, sample_rate: float) -> FloatArray:
    """Largest relative displacement across the isolation of every rig at every frequency, shape (models, frequencies), m."""
    ends = models[0].link("isolation")
    stroke = Sensor(channel="stroke", body=ends.a, relative_to=ends.b, quantity="displacement")
    watched = [msgspec.structs.replace(model, sensors=(stroke,), free=()) for model in models]
    designs = [with_frequency(model, "isolation", float(f)) for model in watched for f in frequencies]
    # The time between samples is short compared with a move: linear interpolation keeps its momentum.
    excitation = Excitation.prepare(head, sample_rate, oversample=1)
    largest = scan(designs, excitation, lambda seen: np.abs(seen["stroke"]).max(axis=1))
    return largest.astype(np.float64).reshape(len(models), len(frequencies))


def lowest_inside(frequency: FloatArray, stroke: FloatArray, allowed: float) -> float:
    """Lowest frequency above which the stroke is at most `allowed`, linearly interpolated between grid points; or NaN."""
    outside = np.flatnonzero(stroke > allowed)
    if len(outside) == 0:
        return float(frequency[0])
    k = int(outside[-1])
    if k == len(frequency) - 1:
        return float("nan")
    share = (stroke[k] - allowed) / (stroke[k] - stroke[k + 1])
    return float(frequency[k] + share * (frequency[k + 1] - frequency[k]))


def stroke_study(
    models: Sequence[RigModel], frequencies: FloatArray, head: FloatArray, sample_rate: float, *, limit: float,
    safety: float = 1.0,
) -> StrokeStudy:  # fmt: skip
    """Stroke over isolation frequency, and the lowest frequency that stays within a limit.

    The present rig comes first, followed by copies with parameters drawn from their uncertainty. The frequencies are ascending,
    Hz; the drive `head` is in m/s^2, shape (n,), at a rate in Hz. The stroke must stay within limit / safety, m. Raises DataError
    if frequencies, limit or safety factor are not allowed.
    """
    frequencies = np.asarray(frequencies, dtype=np.float64)
    if len(frequencies) < 2 or not (np.diff(frequencies) > 0.0).all() or frequencies[0] <= 0.0:
        raise DataError("the frequencies to try must be positive and ascending, at least two")
    if not 0.0 < limit < np.inf or not 1.0 <= safety < np.inf:
        raise DataError(f"a limit of {limit:g} m with a safety factor of {safety:g} is not allowed; give limit > 0, safety >= 1")
    found = strokes(models, frequencies, head, sample_rate)
    allowed = limit / safety
    lowest = np.array([lowest_inside(frequencies, row, allowed) for row in found])
    return StrokeStudy(
        frequency=frequencies, stroke=found[0], draws=found[1:], allowed=allowed, lowest=float(lowest[0]),
        lowest_of_draws=lowest[1:],
    )  # fmt: skip


def histories(model: RigModel, head: FloatArray, sample_rate: float) -> dict[str, FloatArray]:
    """Displacement of every body under a drive by name, each shape (n,), m (rad for an angle)."""
    sensors = tuple(Sensor(channel=body.name, body=body.name, quantity="displacement") for body in model.bodies)
    watched = msgspec.structs.replace(model, sensors=sensors, free=())
    return simulate(watched, Excitation.prepare(head, sample_rate, oversample=1)).channels


def linear_ratio(model: RigModel, frequency: FloatArray) -> FloatArray:
    """Isolation ratio |unlocked| / |locked| at the heatblock of the rig without friction, shape (n,); thesis, Eq. 6."""
    row = [sensor.channel for sensor in model.sensors].index("heatblock")
    unlocked, locked = (np.abs(transfer(model, name, frequency)[row]) for name in ("unlocked", "locked"))
    return np.asarray(unlocked / locked)


def rocking(model: RigModel, offset: float, *, frequency: float, bearing_height: float = HEIGHT) -> RigModel:
    """The rig with a drive offset (m) from the motor's centre of gravity, so that the motor rocks on its bearings (Hz).

    The springs are `bearing_height` from the centre of gravity, m.
    """
    name = model.link("isolation").a
    inertia = model.body(name).mass * RADIUS**2
    omega = 2.0 * pi * frequency
    bearing = Link(name="bearing", a="rocking", stiffness=inertia * omega**2, damping=2.0 * DAMPING_RATIO * inertia * omega)
    arms = {"rocking": bearing_height}
    configurations = {
        key: msgspec.structs.replace(c, rigid=(*c.rigid, "bearing")) if "isolation" in c.rigid else c
        for key, c in model.configurations.items()
    }
    pushes = {**model.drive.pushes, "rocking": offset * model.drive.pushes[name]}
    return msgspec.structs.replace(
        model, bodies=(*model.bodies, Body(name="rocking", mass=inertia)), configurations=configurations, free=(),
        links=(*exchange(model.links, "isolation", arms=arms), bearing),
        contacts=exchange(model.contacts, "isolation", arms=arms), drive=msgspec.structs.replace(model.drive, pushes=pushes),
    )  # fmt: skip
