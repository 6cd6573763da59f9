"""A rig in a configuration as arrays for the kernel: linear system, exit conditions and step matrices for each mode.

A mode is one combination of the elements' states: which contacts stick, in which direction others slide, which stops touch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import product
from math import prod
from threading import Lock

import numpy as np

from isorig.analysis.campaign import FloatArray, IntArray
from isorig.analysis.errors import ModelError
from isorig.analysis.laws.base import NO_LINK
from isorig.analysis.laws.elements import Element, Exit
from isorig.analysis.model.linear import accelerations
from isorig.analysis.model.rig_model import RigModel, weights_of
from isorig.analysis.simulate.curves import code_of
from isorig.analysis.simulate.holding import implied, patterns, shared
from isorig.analysis.simulate.workspace import LEAP, Rig, cache_lines

#: Maximum number of modes of a rig: six contacts, or four end stops.
MODES = 729
#: Maximum phase in rad of the fastest motion in one step, so that its Taylor series converges and its roots are found.
TURN = 1.2
#: The same for a curved force at its steepest, so that the fixed-point passes converge.
STEEP_TURN = 0.1
#: Maximum number of parts into which a step is divided for that.
CUTS = 4096
#: Size of the first term of a Taylor series that is left out: rounding of its sum is as large.
LEFT_OUT = 1e-16
#: Role of an element when contacts change state at one instant: none; dry friction, which sticks at zero speed; Karnopp's law,
#: which sticks at any speed within its band.
ALONE, SETTLING, BANDED = 0, 1, 2
# Threads that simulate one rig under several drives compile it once.
_COMPILING = Lock()


@dataclass(frozen=True, kw_only=True)
class Compiled:
    """A rig compiled for steps of h / `cuts`."""

    rig: Rig  #: The arrays for the kernel.
    basis: FloatArray  #: Full coordinates from the free ones, shape (bodies, n).
    cuts: int  #: Number of parts into which a fine step is divided.
    resistance: FloatArray  #: Each element's resistance as a row on y, shape (modes, elements, M).
    holds: IntArray  #: Whether each element sticks, shape (modes, elements).
    memories: int  #: Maximum number of state variables of a law.
    #: The elements' names, whether they are contacts, and their directions on the coordinates, shape (elements, n).
    elements: tuple[str, ...]
    rubs: tuple[bool, ...]
    across: FloatArray


def compile_rig(model: RigModel, configuration: str, h: float, finer: int = 1) -> Compiled:
    """Arrays of a rig for fine steps of `h` seconds, divided into `finer` times the required number of parts.

    The results of the last rigs are cached. Raises ModelError if the rig has no such configuration, more than `MODES` modes, or
    motions too fast for the step.
    """
    moving = _Moving(model=model, parts=model.moving_parts)
    with _COMPILING:
        return _compiled(moving, configuration, h, finer)


@dataclass(frozen=True, kw_only=True)
class _Moving:
    # Cache key of a rig: its moving parts, without sensors and channel faults.
    model: RigModel = field(compare=False)
    parts: bytes


@lru_cache(maxsize=32)
def _compiled(moving: _Moving, configuration: str, h: float, finer: int) -> Compiled:
    systems = _systems(moving, configuration)
    cuts = max(1, int(np.ceil(systems.quickest * h / TURN)), int(np.ceil(systems.steepest * h / STEEP_TURN)))
    if cuts > CUTS:
        raise ModelError(
            f"the rig {moving.model.name!r} moves at up to {systems.quickest:.3g} rad/s, too quick for steps of {h:.3g} s; "
            "lower its stiffest spring or damper, or raise the masses it acts on"
        )
    cuts *= finer
    return systems.compiled(cuts, h / cuts)


@lru_cache(maxsize=32)
def _systems(moving: _Moving, configuration: str) -> _Systems:
    model = moving.model
    basis, inverse, by_state, by_drives = accelerations(model, configuration)
    free = np.column_stack([by_state, np.zeros(len(basis.T)), by_drives])
    loose = np.flatnonzero(np.diag(inverse))
    elements = _elements(model, frozenset(model.configurations[configuration].rigid), basis, loose)
    return _Systems(basis, free, inverse, elements)


def _elements(model: RigModel, blocked: frozenset[str], basis: FloatArray, loose: IntArray) -> list[Element]:
    # Across a closed lock neither laws nor contacts act.
    found: list[Element | None] = []
    for link in model.links:
        if link.name not in blocked:
            w = weights_of(model, link) @ basis
            found += [_placed(law.element(model.constants_of(link)), link.name, w, rubs=False) for law in link.laws]
    for contact in model.contacts:
        if contact.name not in blocked:
            w = weights_of(model, contact) @ basis
            found.append(_placed(contact.law.element(NO_LINK), contact.name, w, rubs=True))
    # An element has no effect if locked links prevent relative motion of its ends, or if both ends are imposed motions.
    elements = [element for element in found if element is not None and np.abs(element.direction[loose]).max(initial=0.0) > 1e-12]
    if prod(len(element.states) for element in elements) > MODES:
        names = ", ".join(element.name for element in elements if len(element.states) > 1)
        raise ModelError(f"the contacts and stops {names} have more than {MODES} states together; leave some out")
    return elements


def _placed(element: Element | None, name: str, w: FloatArray, *, rubs: bool) -> Element | None:
    return None if element is None else replace(element, name=name, direction=w, rubs=rubs)


def _steepness(element: Element, inverse: FloatArray) -> float:
    # Rate in 1/s at which the two ends oscillate or creep on the curved force alone.
    stiffness, damping = element.steepest
    mobility = float(element.direction @ inverse @ element.direction)
    return float(np.sqrt(stiffness * mobility) + damping * mobility)


@dataclass(frozen=True, kw_only=True)
class _Way:
    # An exit of a mode: the margin's row on y, and its entries in `Compiled.exits` and `Compiled.limits`.
    row: FloatArray
    element: int
    target: int
    kind: int
    limit: float


def _kind(element: Element) -> int:
    first = element.states[0]
    return ALONE if not first.holds else SETTLING if first.settles else BANDED


def _grip(element: Element) -> float:
    # Breakaway force: the weight by which contacts that stick together share an indeterminate force.
    forces = [way.const for way in element.states[0].exits if element.states[0].holds]
    return sum(forces) / len(forces) if sum(forces) > 0.0 else 1.0


def _root(inverse: FloatArray) -> FloatArray:
    # Cholesky factor of a matrix whose rows are zero for imposed motions.
    root, loose = np.zeros_like(inverse), np.flatnonzero(np.diag(inverse))
    root[np.ix_(loose, loose)] = np.linalg.cholesky(inverse[np.ix_(loose, loose)])
    return root


class _Systems:
    """The linear system of every mode in physical units, z' = rate y.

    `quickest` is the largest magnitude of an eigenvalue in 1/s with the curved forces at their steepest, `steepest` the largest
    rate of a curved force alone.
    """

    def __init__(self, basis: FloatArray, free: FloatArray, inverse: FloatArray, elements: Sequence[Element]) -> None:
        self.basis = basis
        n = free.shape[0]
        self.m = m = 2 * n
        self.further = free.shape[1] - m - 2
        self.elements = elements
        self.curved = [k for k, element in enumerate(elements) if element.formula]
        self.size = m + 3 + 3 * len(self.curved) + 2 * self.further
        self.modes = list(product(*(range(len(element.states)) for element in elements)))
        modes, count = len(self.modes), len(elements)
        self.resistance = np.zeros((modes, count, self.size))
        self.rate = np.zeros((modes, m, self.size))
        self.rate[:, :n, n:m] = np.eye(n)
        self.settle = np.tile(np.eye(n), (modes, 1, 1))
        self.holds = np.zeros((modes, count), dtype=np.int64)
        w = np.array([element.direction for element in elements]).reshape(count, n)
        self.kinds = [_kind(element) for element in elements]
        # In mass-normalised coordinates.
        self.along = w @ _root(inverse)
        self.grips = np.array([_grip(element) for element in elements])
        self.strides = [prod(len(element.states) for element in elements[k + 1 :]) for k in range(count)]
        # By the contacts that stick: how they break away, which others they hold, how they share a force.
        self.patterns: dict[tuple[int, ...], FloatArray] = {}
        self.forced: dict[tuple[int, ...], list[int]] = {}
        self.shared: dict[tuple[int, ...], FloatArray] = {}
        self.margins: dict[tuple[int, Exit], FloatArray] = {}
        acceleration = np.zeros((n, self.size))
        acceleration[:, : m + 2] = free[:, : m + 2]
        acceleration[:, self.size - 2 * self.further :: 2] = free[:, m + 2 :]
        for mode, states in enumerate(self.modes):
            given = self.resistance[mode]
            for k, element in enumerate(elements):
                state = element.states[states[k]]
                given[k, :n], given[k, n:m], given[k, m] = state.d * w[k], state.v * w[k], state.const
            for place, k in enumerate(self.curved):
                given[k, m + 3 + 3 * place] = elements[k].states[states[k]].curve
            moved = acceleration - inverse @ w.T @ given
            self.holds[mode] = [element.states[s].holds for element, s in zip(elements, states, strict=True)]
            held = [k for k in range(count) if self.holds[mode, k]]
            if held:
                # The force that keeps the relative acceleration at zero.
                force = self._shared(held) @ w[held] @ moved
                given[held] += force
                moved = moved - inverse @ w[held].T @ force
            settled = [k for k in held if elements[k].states[states[k]].settles]
            if settled:
                self.settle[mode] -= inverse @ w[settled].T @ self._shared(settled) @ w[settled]
            self.rate[mode, n:] = moved
        self.w = w
        self.quickest = float(np.abs(np.linalg.eigvals(self._square())).max(initial=0.0))
        self.steepest = max((_steepness(element, inverse) for element in elements), default=0.0)

    def _shared(self, held: list[int]) -> FloatArray:
        key = tuple(held)
        if key not in self.shared:
            self.shared[key] = shared(self.along[held], self.grips[held])
        return self.shared[key]

    def _square(self) -> FloatArray:
        """System matrices of the modes, with the curved forces linearised at their steepest."""
        m = self.m
        square = np.zeros((len(self.modes), m, m))
        square[:] = self.rate[:, :, :m]
        for place, k in enumerate(self.curved):
            stiffness, damping = self.elements[k].steepest
            steep = np.concatenate([stiffness * self.w[k], damping * self.w[k]])
            square += self.rate[:, :, m + 3 + 3 * place, None] * steep
        return square

    def _margin(self, mode: int, k: int, way: Exit) -> FloatArray:
        if (k, way) not in self.margins:
            # Of all modes at once.
            n, m = self.m // 2, self.m
            rows: FloatArray = way.hold * self.resistance[:, k] + way.a * (self.w[k] @ self.rate[:, n:])
            rows[:, :n] += way.d * self.w[k]
            rows[:, n:m] += way.v * self.w[k]
            rows[:, m] += way.const
            if way.curve:
                rows[:, m + 3 + 3 * self.curved.index(k)] += way.curve
            self.margins[k, way] = rows
        return np.asarray(self.margins[k, way][mode])

    def _ways(self, mode: int) -> list[_Way]:
        """Exits of a mode."""
        states, found = self.modes[mode], []
        for k, element in enumerate(self.elements):
            state = element.states[states[k]]
            for way in state.exits:
                if not state.holds:
                    target = mode + (way.to - states[k]) * self.strides[k]
                    kind = 0 if self.kinds[k] == ALONE else 1
                    if self.kinds[k] == SETTLING and way.to == 0:
                        target = self._landed(mode, k)
                    found.append(_Way(row=self._margin(mode, k, way), element=k, target=target, kind=kind, limit=1.0))
        held = tuple(k for k in range(len(states)) if self.holds[mode, k])
        if held and held not in self.patterns:
            self.patterns[held] = patterns(self.along[list(held)])
        for pattern in self.patterns.get(held, ()):
            moving = [(k, c) for k, c in zip(held, pattern, strict=True) if c]
            for sign in (1.0, -1.0):
                row, limit, target = np.zeros(self.size), 0.0, mode
                for k, c in moving:
                    forward, backward = self.elements[k].states[0].exits
                    way = forward if sign * c > 0.0 else backward
                    row += abs(c) * self._margin(mode, k, way)
                    limit += abs(c) * way.const
                    target += way.to * self.strides[k]
                found.append(_Way(row=row, element=moving[0][0], target=target, kind=2, limit=limit or 1.0))
        return found

    def _settled(self, mode: int) -> list[int]:
        return [k for k in range(len(self.kinds)) if self.kinds[k] == SETTLING and self.holds[mode, k]]

    def _forced(self, settled: list[int]) -> list[int]:
        # Contacts that cannot slide while these stick.
        key = tuple(settled)
        if key not in self.forced:
            others = [k for k, kind in enumerate(self.kinds) if kind == SETTLING and k not in settled]
            self.forced[key] = implied(self.along, settled, others)
        return self.forced[key]

    def _landed(self, mode: int, k: int) -> int:
        settled = [*self._settled(mode), k]
        for other in (k, *self._forced(settled)):
            mode -= self.modes[mode][other] * self.strides[other]
        return mode

    def _scale(self, step: float) -> FloatArray:
        # y in units of a step: speeds and first derivatives times its length, second derivatives times its square.
        scale = np.ones(self.size)
        scale[self.m // 2 : self.m] = step
        scale[self.m + 2] = step
        for place in range(self.m + 3, self.m + 3 + 3 * len(self.curved), 3):
            scale[place + 1], scale[place + 2] = step, step**2
        scale[self.size - 2 * self.further + 1 :: 2] = step
        return scale

    def _outputs(self, scale: FloatArray, step: float) -> tuple[IntArray, FloatArray, FloatArray]:
        # The exits' entries in `Compiled.exits` and `Compiled.limits`; rows on y: elongations and speeds, coordinates, margins.
        m, n, modes = self.m, self.m // 2, len(self.modes)
        ways = [self._ways(mode) for mode in range(modes)]
        exits = max(1, *(len(found) for found in ways))
        table, limits = np.full((modes, exits, 3), -1, dtype=np.int64), np.ones((modes, exits))
        bent = 2 * len(self.curved)
        rows = np.zeros((modes, bent + m + exits, self.size))
        rows[:, 0:bent:2, :n] = self.w[self.curved]
        rows[:, 1:bent:2, n:m] = self.w[self.curved] / step
        rows[:, bent : bent + m, :m] = np.eye(m)
        for mode, found in enumerate(ways):
            for place, way in enumerate(found):
                rows[mode, bent + m + place] = way.row / scale
                table[mode, place] = way.element, way.target, way.kind
                limits[mode, place] = way.limit
        return table, limits, rows

    def _series(self, rows: FloatArray, scale: FloatArray, step: float) -> FloatArray:
        # Taylor coefficients of the rows over a step, shape (modes, terms, rows, M).
        m, rates = self.m, np.arange(self.size - 2 * self.further + 1, self.size, 2)
        system = np.zeros((len(rows), self.size, self.size))
        system[:, :m] = self.rate * step * scale[:m, None] / scale
        system[:, m + 1, m + 2] = 1.0
        system[:, rates - 1, rates] = 1.0
        for first in range(m + 3, m + 3 + 3 * len(self.curved), 3):
            system[:, first, first + 1] = system[:, first + 1, first + 2] = 1.0
        # The first term left out is below rounding.
        series, left_out = [rows], self.quickest * step
        while (len(series) < 6 or left_out > LEFT_OUT) and len(series) < 30:
            series.append(series[-1] @ system / len(series))
            left_out *= self.quickest * step / len(series)
        return np.stack(series, axis=1)

    def compiled(self, cuts: int, step: float) -> Compiled:
        """The arrays for the kernel, in units of a step of `step` seconds."""
        m, size, modes, elements = self.m, self.size, len(self.modes), self.elements
        n, bent = m // 2, 2 * len(self.curved)
        scale = self._scale(step)
        table, limits, rows = self._outputs(scale, step)
        taylor = self._series(rows, scale, step)
        power = np.arange(taylor.shape[1])
        # In the middle, at the end, and the slope at the end.
        half, moved, slopes = np.tensordot(np.array([0.5**power, power**0, power]), taylor, axes=(1, 1))
        met = np.stack([part[:, :bent].reshape(modes, -1, 2, size) for part in (half, moved)], axis=2).reshape(modes, -1, size)
        margins = np.stack([part[:, bent + m :] for part in (moved, slopes)], axis=2).reshape(modes, -1, size)
        no_leap = np.zeros((modes, 0, 1))
        width = max((len(elements[k].params) for k in self.curved), default=0)
        params = [[*elements[k].params, *[0.0] * (width - len(elements[k].params))] for k in self.curved]
        gates = {k: elements[k].gates or (1.0,) * len(elements[k].states) for k in self.curved}
        widest = max((len(element.states) for element in elements), default=1)
        return Compiled(
            rig=Rig(
                step=step,
                n=n,
                whole=_columns(np.concatenate([met, moved[:, bent : bent + m], margins], axis=1)),
                blocks=-(-(met.shape[1] + m + 2 * (table[:, :, 0] >= 0).sum(axis=1)) // 8),
                leap=_columns(_leap(moved[:, bent : bent + m], margins, self.further) if cuts == 1 and not bent else no_leap),
                series=_columns(taylor),
                terms=taylor.shape[1],
                exits=table,
                limits=limits,
                settle=self.settle,
                possible=np.array([not self._forced(self._settled(mode)) for mode in range(modes)], dtype=np.int64),
                kinds=np.array(self.kinds, dtype=np.int64),
                strides=np.array(self.strides, dtype=np.int64),
                states=np.array(self.modes, dtype=np.int64).reshape(modes, len(elements)),
                curve_of=np.array(self.curved, dtype=np.int64),
                codes=np.array([code_of(elements[k].formula) for k in self.curved], dtype=np.int64),
                params=np.array(params).reshape(len(self.curved), width),
                directions=self.w[self.curved].reshape(len(self.curved), n),
                gates=np.array([[*gates[k], *[0.0] * (widest - len(gates[k]))] for k in self.curved]).reshape(len(gates), widest),
            ),
            basis=self.basis,
            cuts=cuts,
            resistance=self.resistance / scale,
            holds=self.holds,
            memories=max((elements[k].memories for k in self.curved), default=0) or 1,
            elements=tuple(element.name for element in elements),
            rubs=tuple(element.rubs for element in elements),
            across=self.w,
        )


def _leap(moved: FloatArray, margins: FloatArray, further: int) -> FloatArray:
    """Rows of `Rig.leap` from those of z and of the margins after one step, (modes, rows, M), for `further` additional drives."""
    modes, m, size = moved.shape
    columns = m + 1 + (1 + further) * (LEAP + 1)
    # The vector of every step from the leap's input.
    y = np.zeros((modes, size, columns))
    y[:, :m, :m] = np.eye(m)
    y[:, m, m] = 1.0
    drives = [m + 1, *range(size - 2 * further, size, 2)]
    states, left = [], []
    for k in range(LEAP):
        for at, place in enumerate(drives):
            now = m + 1 + at * (LEAP + 1) + k
            y[:, place : place + 2, m + 1 :] = 0.0
            y[:, place, now], y[:, place + 1, now : now + 2] = 1.0, (-1.0, 1.0)
        left.append((margins @ y).reshape(modes, -1, 2, columns))
        states.append(moved @ y)
        y[:, :m] = states[-1]
    exits = np.stack(left, axis=2).reshape(modes, -1, columns)
    return np.concatenate([states[-1], *states[:-1], exits], axis=1)


def _columns(rows: FloatArray) -> FloatArray:
    """Rows (modes, ..., rows, M) in groups of eight by columns, (modes, ... * groups, M, 8), each column in one cache line."""
    *outer, count, size = rows.shape
    groups = -(-count // 8)
    padded = np.zeros((*outer, groups * 8, size))
    padded[..., :count, :] = rows
    columns = padded.reshape(outer[0], -1, 8, size).swapaxes(2, 3)
    aligned = cache_lines(columns.size // 8).reshape(columns.shape)
    aligned[:] = columns
    return aligned
