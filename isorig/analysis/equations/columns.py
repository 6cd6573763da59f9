"""What each kind of cause adds to an equation: columns over deflection, velocity and time of an element.

A kind is represented by a free shape that is linear in its coefficients, so that a regression decides; its forms are fitted
later, on simulation error.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import ComplexArray, FloatArray, IntArray
from isorig.analysis.equations.sliding import bending, spline_columns
from isorig.analysis.equations.slip import slip_operator

#: Intervals of the curves over deflection.
INTERVALS = 32
#: Standard deviation of a curve's second differences as a share of its rms force. Chosen: smoother than the noise of one bin.
CURVATURE = 0.0015
#: Decay velocities of friction that depends on velocity, as shares of the rms velocity.
DECAYS = (0.1, 0.2, 0.4, 0.8)
#: Corner frequencies of relaxation, in multiples of the element's own frequency.
CORNERS = (0.1, 0.2, 0.4, 0.8, 1.6, 3.2)
#: Displacements at which slip elements slide, as shares of the largest deflection.
YIELDS = (0.006, 0.02, 0.04, 0.08, 0.16)
#: Places of stops, as shares of the range of the deflection.
STOPS = (0.6, 0.75, 0.85, 0.92, 0.96)
#: Velocity over which the direction of sliding is smoothed, as a share of the rms velocity, where no contact is expected.
BLUNT = 0.05
#: Name of a force that repeats with the deflection.
PERIODIC = "force periodic in position"
#: Names of a friction whose level depends on the position, and of a damping that depends on the deflection.
OVER_POSITION, OVER_DEFLECTION = "friction over position", "damping over deflection"
#: Score that a coefficient must add to count: of equal explanations the simpler one is preferred.
PER_COEFFICIENT = 0.01


@dataclass(frozen=True, kw_only=True)
class Course:
    """The motion of an element in a run, for the columns of a kind."""

    #: Shape (n,), m, m/s, and seconds since the campaign's start.
    deflection: FloatArray
    velocity: FloatArray
    time: FloatArray
    #: The deflection of the whole run without its slow part, shape (samples,), for filters; `place` are the indices of the n
    #: samples in it.
    whole: FloatArray
    place: IntArray  #: Shape (n,).
    rate: float  #: Hz.
    #: Range of the curves over deflection, m.
    low: float
    high: float
    #: Largest and rms velocity of all runs, m/s.
    fastest: float
    speed: float
    swing: float  #: Largest deflection of all runs, m.
    own: float  #: Frequency of the element's stiffness with the mass that it holds, Hz.
    end: float  #: Seconds from the campaign's start to its end.
    memory: dict[str, FloatArray]  #: Signals computed once for a run, by name.


@dataclass(frozen=True, kw_only=True)
class Shape:
    """The free shape of a kind at an element."""

    kind: str  #: The kind of cause.
    name: str  #: Unique among shapes.
    #: Forces for unit coefficients, shape (n, coefficients), N for a unit chosen for good scaling.
    columns: Callable[[Course], FloatArray]
    charge: int  #: Number of coefficients that the score is charged with: those of a smooth curve are not independent.
    smooth: bool = False  #: Whether neighbouring coefficients are penalized for second differences.
    with_friction: bool = False  #: Whether it modifies a friction force, so that it belongs to contacts.

    def penalty(self, count: int, before: int, power: float, allowed: float) -> FloatArray | None:
        """Quadratic form for `count` coefficients after `before` others, for a force of mean square `power`; None if free."""
        if not self.smooth:
            return None
        whole = np.zeros((before + count, before + count))
        whole[before:, before:] = bending(count) * allowed / (CURVATURE**2 * power)
        return whole


def _spring(course: Course) -> FloatArray:
    return spline_columns(course.deflection, course.low, course.high, INTERVALS)


def _stops(course: Course) -> FloatArray:
    d, middle, half = course.deflection, 0.5 * (course.low + course.high), 0.5 * (course.high - course.low)
    ways = (np.maximum(way * (d - middle) - share * half, 0.0) for share in STOPS for way in (1.0, -1.0))
    return np.column_stack(list(ways)) / half


def _damping(course: Course) -> FloatArray:
    v, most = course.velocity, course.fastest
    return np.column_stack([v * np.abs(v) / most, v**3 / most**2, v**2 / most])


def _damping_by_place(course: Course) -> FloatArray:
    return (course.velocity / course.speed)[:, None] * _spring(course)


def direction_of(velocity: FloatArray, speed: float) -> FloatArray:
    """Direction of sliding, blunted where its sign is uncertain."""
    return np.tanh(velocity / (BLUNT * speed))


def _friction(course: Course) -> FloatArray:
    # Also what it differs by between forward and backward, which shows where the element rests in between.
    way = direction_of(course.velocity, course.speed)
    return np.column_stack([way, way**2])


def _friction_by_direction(course: Course) -> FloatArray:
    # Half the difference of the levels forward and backward; a level that is the same in both is known already.
    return np.abs(np.sign(course.velocity))[:, None]


def _friction_by_velocity(course: Course) -> FloatArray:
    v = course.velocity
    return np.column_stack(
        [np.exp(-np.abs(v) / (share * course.speed)) * (np.sign(v) == way) for share in DECAYS for way in (1.0, -1.0)]
    )


def _friction_by_place(course: Course) -> FloatArray:
    return np.sign(course.velocity)[:, None] * _spring(course)


def relaxing(ratio: ComplexArray, corner: float) -> ComplexArray:
    """Stiffness of a spring and a damper in series over that of the spring, at the frequencies j f / f_own."""
    return np.asarray((ratio / corner) / (1.0 + ratio / corner))


def dissipates(values: FloatArray) -> bool:
    """Whether relaxations with these stiffnesses dissipate energy at the element's own frequency, as passive materials do."""
    return (
        float(np.imag(sum(value * relaxing(np.array([1j]), corner)[0] for value, corner in zip(values, CORNERS, strict=True))))
        > 0
    )


def _relaxation(course: Course) -> FloatArray:
    if "relaxation" not in course.memory:
        n = len(course.whole)
        ratio = np.asarray(1j * np.fft.rfftfreq(n, 1.0 / course.rate) / course.own, dtype=np.complex128)
        spectrum = np.asarray(np.fft.rfft(course.whole), dtype=np.complex128)
        filtered = [np.fft.irfft(spectrum * relaxing(ratio, corner), n) for corner in CORNERS]
        course.memory["relaxation"] = np.stack(filtered, axis=1)
    return np.asarray(course.memory["relaxation"][course.place])


def _slip(course: Course) -> FloatArray:
    if "slip" not in course.memory:
        course.memory["slip"] = np.stack([slip_operator(course.whole, share * course.swing) for share in YIELDS], axis=1)
    return np.asarray(course.memory["slip"][course.place])


def _drift(course: Course) -> FloatArray:
    t = course.time / max(course.end, 1e-9)
    return np.column_stack([course.deflection * t, course.deflection * t**2]) / course.swing


def _damping_drift(course: Course) -> FloatArray:
    t = course.time / max(course.end, 1e-9)
    return np.column_stack([course.velocity * t, course.velocity * t**2]) / course.speed


def _friction_drift(course: Course) -> FloatArray:
    t, way = course.time / max(course.end, 1e-9), direction_of(course.velocity, course.speed)
    return np.column_stack([way * t, way * t**2])


def periodic(pitch: float) -> Shape:
    """A force that repeats with the deflection, with this pitch in m."""

    def columns(course: Course) -> FloatArray:
        angle = 2.0 * np.pi * course.deflection / pitch
        return np.column_stack([np.sin(angle), np.cos(angle), np.ones(len(angle))])

    return Shape(kind="spring_shape", name=PERIODIC, columns=columns, charge=4)


#: A stop that is reached a few times only: a smooth curve over the whole range does not follow it.
RARE_STOP = Shape(kind="spring_shape", name="force beyond a deflection", columns=_stops, charge=4)
#: The level of dry friction, which shows while the element slides.
DRY_FRICTION = Shape(kind="friction_shape", name="dry friction", columns=_friction, charge=2)
#: The shapes at an element, simple ones first.
SHAPES: tuple[Shape, ...] = (
    DRY_FRICTION,
    Shape(
        kind="friction_shape", name="friction by direction", columns=_friction_by_direction, charge=1, with_friction=True,
    ),
    Shape(kind="drift", name="drift of stiffness", columns=_drift, charge=1),
    Shape(kind="drift", name="drift of friction", columns=_friction_drift, charge=1, with_friction=True),
    Shape(kind="drift", name="drift of damping", columns=_damping_drift, charge=1),
    Shape(kind="damping_shape", name="damping over velocity", columns=_damping, charge=1),
    Shape(kind="damping_shape", name=OVER_DEFLECTION, columns=_damping_by_place, charge=3, smooth=True),
    Shape(kind="memory", name="relaxation", columns=_relaxation, charge=2),
    Shape(kind="spring_shape", name="force over deflection", columns=_spring, charge=3, smooth=True),
    Shape(kind="friction_shape", name="friction over velocity", columns=_friction_by_velocity, charge=3, with_friction=True),
    Shape(
        kind="friction_shape", name=OVER_POSITION, columns=_friction_by_place, charge=3, smooth=True,
        with_friction=True,
    ),
    Shape(kind="memory", name="slip", columns=_slip, charge=2, with_friction=True),
)  # fmt: skip
