"""Data structures of the simulation kernels: the rig, the state of the motion, the record."""

from typing import NamedTuple

import numpy as np

from isorig.analysis.campaign import FloatArray, IntArray
from isorig.analysis.jit import allocating_kernel, inlined, kernel

#: Number of steps that a rig without curved forces takes at once; `leaps` in the kernel records so many by name.
LEAP = 4
#: Places within a part of a step at which rows are evaluated, see `Motion.points`.
END, MIDDLE, QUARTER = 0, 1, 2


class Rig(NamedTuple):
    """The rig for one step length.

    The kernel's vector is y = (z, 1, u, u', f, f', f'' of every curved element, u, u' of every further drive): z the n
    coordinates and their speeds, u the drives, linear within a step, f the curved forces, parabolas within a step; its length is
    M. For an imposed motion the drive is the acceleration of its coordinate, independent of the forces. Quantities are in units
    of a step: derivatives in y are multiplied by the step's length (and f'' by its square).
    """

    step: float  #: Step length, s.
    n: int  #: Number of coordinates.
    #: Matrix from y to the values after a step, in groups of eight rows by columns: for each curved element its elongation and
    #: speed (m, m/s) in the middle and at the end, then z, then for each exit its margin and the margin's slope, (modes, groups,
    #: M, 8).
    whole: FloatArray
    blocks: IntArray  #: Groups of eight rows of `whole` that a mode needs, shape (modes,).
    #: Matrix from (z, 1, then for every drive its values at the next `LEAP` + 1 steps) to z after `LEAP` steps, then z after each
    #: step before, then for each exit its margin and the margin's slope after each step, in the same groups, (modes, groups,
    #: columns, 8). Without groups if the rig has curved forces or its steps are parts of the drive's.
    leap: FloatArray
    #: Taylor coefficients in time, in the same groups term by term: for each curved element its elongation and speed, then z,
    #: then each exit's margin, (modes, terms * groups, M, 8).
    series: FloatArray
    terms: int  #: Number of terms.
    #: For each exit, the element whose state ends, the next mode, and the kind: 0 no contact, 1 a sliding contact changes state,
    #: 2 sticking contacts break away; shape (modes, exits, 3), element -1 if a mode has fewer exits.
    exits: IntArray
    limits: FloatArray  #: Reference of each exit's margin: the breakaway force, shape (modes, exits).
    #: Projection of the coordinates' speeds that sets the speeds of sticking contacts exactly to zero, shape (modes, n, n).
    settle: FloatArray
    possible: IntArray  #: Whether the contacts that slide in a mode are free to slide while the others stick, shape (modes,).
    kinds: IntArray  #: Role of each element when contacts change state at one instant, see `SETTLING` in `compiled`.
    #: mode = sum of stride * state; the states of each mode's elements, shape (modes, elements).
    strides: IntArray
    states: IntArray
    #: For the curved elements: index of the element, law, parameters, direction, sign by state (padded with 0).
    curve_of: IntArray
    codes: IntArray
    params: FloatArray
    directions: FloatArray
    gates: FloatArray


class Motion(NamedTuple):
    """The state of the motion, and memory for the intermediate results of a step."""

    y: FloatArray  #: The kernel's vector, see `Rig`.
    #: By curved element: sign in its present state, recent magnitude of its force, magnitude below which it need not be exact.
    gate: FloatArray
    largest: FloatArray
    floor: FloatArray
    #: By curved element: elongation (m) and speed (m/s) at the start of the step, force at its end.
    d0: FloatArray
    v0: FloatArray
    ends: FloatArray
    #: State variables of the laws, shape (curves, memories): at the start of the step, in the middle for one law (memories,), at
    #: its end, and at the end of trial parts.
    inner: FloatArray
    half: FloatArray
    after: FloatArray
    spare: FloatArray
    ratio: FloatArray  #: Last observed convergence ratio of the passes for the curved forces; one number.
    #: Results of a whole step in groups of eight rows: the part without the curved forces, and the total; `reached` is the flat
    #: view of `ahead`.
    base: FloatArray
    ahead: FloatArray
    reached: FloatArray
    #: Input of `Rig.leap`, its results in groups of eight rows and their flat view, and zeros of that shape.
    known_drives: FloatArray
    leaped: FloatArray
    landed: FloatArray
    nothing: FloatArray
    #: Taylor coefficients in groups of eight rows: zeros, the part without the curved forces, the total; `columns` is the view of
    #: `taylor` by term, shape (terms, rows).
    still: FloatArray
    known: FloatArray
    taylor: FloatArray
    columns: FloatArray
    #: The rows at the end, the middle and a quarter of a part of a step in groups of eight, and the flat view of each.
    points: FloatArray
    end: FloatArray
    middle: FloatArray
    quarter: FloatArray
    p: FloatArray  #: Taylor coefficients of a margin.
    speeds: FloatArray  #: Speeds of the coordinates.
    rests: IntArray  #: Contacts that may stick or slide from now on.


class Record(NamedTuple):
    """The recorded part of the motion; see `run` for `out`, `curved`, `modes` and `log`."""

    #: By sensor: its non-zero weights and their places in the vector, shape (sensors, m), and their number, shape (sensors,).
    weights: FloatArray
    places: IntArray
    filled: IntArray
    out: FloatArray
    curved: FloatArray
    modes: IntArray
    log: FloatArray


@allocating_kernel
def cache_lines(groups: int) -> FloatArray:
    """Zeros in groups of eight, each in one line of the processor's cache, shape (groups, 8).

    Other arrays are aligned to 16 bytes only: with each group in two lines, a simulation takes up to 10 % longer.
    """
    memory = np.zeros(8 * groups + 8)
    first = -(memory.ctypes.data // 8) % 8
    return memory[first : first + 8 * groups].reshape((groups, 8))


@allocating_kernel
def room(rig: Rig, memories: int) -> Motion:
    """Allocate the motion of a rig whose laws have up to `memories` state variables; all zeros."""
    curves, blocks, groups = len(rig.codes), rig.whole.shape[1], rig.series.shape[1]
    taylor, ahead, leaped = cache_lines(groups), cache_lines(blocks), cache_lines(rig.leap.shape[1])
    points = cache_lines(3 * (groups // rig.terms)).reshape((3, groups // rig.terms, 8))
    return Motion(
        y=np.zeros(rig.whole.shape[2]), gate=np.zeros(curves), largest=np.zeros(curves), floor=np.zeros(curves),
        d0=np.zeros(curves), v0=np.zeros(curves), ends=np.zeros(curves), inner=np.zeros((curves, memories)),
        half=np.zeros(memories), after=np.zeros((curves, memories)), spare=np.zeros((curves, memories)), ratio=np.zeros(1),
        base=cache_lines(blocks), ahead=ahead, reached=ahead.reshape(-1), known_drives=np.zeros(rig.leap.shape[2]),
        leaped=leaped, landed=leaped.reshape(-1), nothing=cache_lines(rig.leap.shape[1]), still=cache_lines(groups),
        known=cache_lines(groups), taylor=taylor, columns=taylor.reshape(rig.terms, -1), points=points,
        end=points[END].reshape(-1), middle=points[MIDDLE].reshape(-1), quarter=points[QUARTER].reshape(-1),
        p=np.zeros(rig.terms), speeds=np.zeros(rig.n), rests=np.zeros(len(rig.kinds), dtype=np.int64),
    )  # fmt: skip


@kernel
def force_at(n: int, c: int) -> int:
    """Place in the vector of curved element c's force; its two rates follow."""
    return 2 * n + 3 + 3 * c


@inlined
def first_margin(rig: Rig) -> int:
    """Row of the first exit's margin among the Taylor coefficients: after the curved elements' and the coordinates' rows."""
    return 2 * len(rig.codes) + 2 * rig.n
