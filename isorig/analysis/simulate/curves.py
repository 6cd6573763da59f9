"""Curved laws in the kernel: the formulas of all laws, selected by number.

They are compiled separately from the engine that calls them, so that a new or changed law does not compile the engine.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.jit import inlined_by_numba, kernel, load, separate_kernel, uncached
from isorig.analysis.laws import FORMULAS
from isorig.analysis.laws.elements import Formula

#: Codes from this one on are of laws with memory (state variables): the same for any number of laws.
MEMORY = 1_000_000
PLAIN = [formula for formula in FORMULAS if formula.carry is None]
WITH_MEMORY = [formula for formula in FORMULAS if formula.carry is not None]
CODES = {formula: code for first, formulas in ((0, PLAIN), (MEMORY, WITH_MEMORY)) for code, formula in enumerate(formulas, first)}
#: The compiler's names of a number's and an array's type.
WHOLE, NUMBER, ROW, ROWS = "int64", "float64", "float64[::1]", "float64[:, ::1]"


def _signature(result: str, *arguments: str) -> str:
    return f"{result}({', '.join(arguments)})"


TWO = f"UniTuple({NUMBER}, 2)"


def code_of(formula: Formula | None) -> int:
    """Number of a formula in the kernel."""
    return -1 if formula is None else CODES[formula]


def _chosen(kernels: Sequence[Callable[..., Any]], first: int) -> Callable[..., Any]:
    """A kernel that selects one of several, numbered from `first` on, by bisection."""
    if len(kernels) == 1:
        return kernels[0]
    middle = len(kernels) // 2
    border, low, high = first + middle, _chosen(kernels[:middle], first), _chosen(kernels[middle:], first + middle)

    @uncached
    def either(code: int, *given: Any) -> Any:
        if code < border:
            return low(code, *given)
        return high(code, *given)

    return either


def _numbered(law: Callable[..., Any]) -> Callable[..., Any]:
    """The kernel of a law as one that is selected by a number."""

    @uncached
    def numbered(code: int, *given: Any) -> Any:
        return law(*given)

    return numbered


def _at_two_points(law: Callable[..., float]) -> Callable[..., tuple[float, float]]:
    @uncached
    def at_two_points(
        code: int, p: FloatArray, gate: float, dm: float, vm: float, tm: float, d1: float, v1: float, t1: float
    ) -> tuple[float, float]:
        return law(p, gate, dm, vm, tm), law(p, gate, d1, v1, t1)

    return at_two_points


@uncached
def no_kink(p: FloatArray, memory: FloatArray, d: float, sign: float) -> float:
    """Of a law whose force has kinks only where the velocity changes sign."""
    return np.inf


# For the laws without memory, and for those with memory.
_plain = _chosen([_at_two_points(formula.resist) for formula in PLAIN], 0)
_recall = _chosen([_numbered(formula.resist) for formula in WITH_MEMORY], MEMORY)
_carry = _chosen([_numbered(formula.carry) for formula in FORMULAS if formula.carry], MEMORY)
_to_kink = _chosen([_numbered(formula.to_kink or no_kink) for formula in WITH_MEMORY], MEMORY)


@separate_kernel(_signature(TWO, WHOLE, ROW, *7 * (NUMBER,)))
def plain(
    code: int, p: FloatArray, gate: float, dm: float, vm: float, tm: float, d1: float, v1: float, t1: float
) -> tuple[float, float]:
    """Resistance of a law without memory at two elongations (m), speeds (m/s) and times (s): selecting it takes as long as it."""
    return _plain(code, p, gate, dm, vm, tm, d1, v1, t1)


@separate_kernel(_signature(TWO, WHOLE, ROW, NUMBER, ROWS, ROW, ROWS, WHOLE, *8 * (NUMBER,)))
def carried(
    code: int, p: FloatArray, gate: float, inner: FloatArray, half: FloatArray, after: FloatArray, c: int, d0: float, v0: float,
    dm: float, vm: float, d1: float, v1: float, h: float, t: float,
) -> tuple[float, float]:  # fmt: skip
    """The same at the middle and the end of `h` seconds from t on for a law with memory; state from inner[c] to after[c]."""
    memory, end = inner[c], after[c]
    _carry(code, p, memory, half, d0, dm, v0, vm, v1, 0.0, 0.5, h)
    _carry(code, p, half, end, dm, d1, v0, vm, v1, 0.5, 1.0, h)
    return _recall(code, p, gate, half, dm, vm, t + 0.5 * h), _recall(code, p, gate, end, d1, v1, t + h)


@separate_kernel(_signature(NUMBER, WHOLE, ROW, NUMBER, ROWS, WHOLE, *3 * (NUMBER,)))
def resist(code: int, p: FloatArray, gate: float, inner: FloatArray, c: int, d: float, v: float, t: float) -> float:
    """Resistance of curved element c with the state variables inner[c]."""
    if code < MEMORY:
        return plain(code, p, gate, d, v, t, d, v, t)[0]
    return _recall(code, p, gate, inner[c], d, v, t)


@separate_kernel(_signature(NUMBER, WHOLE, ROW, ROWS, WHOLE, *2 * (NUMBER,)))
def to_kink(code: int, p: FloatArray, inner: FloatArray, c: int, d: float, sign: float) -> float:
    """Distance in m to the next kink of a law with memory that moves with this sign, with the state variables inner[c]."""
    return _to_kink(code, p, inner[c], d, sign)


def load_laws() -> None:
    """Compile the laws, or load them from the cache, before a rig with curved forces is simulated."""
    load(plain, carried, resist, to_kink)


@inlined_by_numba
def advance(
    code: int, p: FloatArray, gate: float, inner: FloatArray, half: FloatArray, after: FloatArray, c: int, d0: float, v0: float,
    dm: float, vm: float, d1: float, v1: float, h: float, t: float,
) -> tuple[float, float]:  # fmt: skip
    """Resistance at the middle and the end of `h` seconds from t on; the state variables at the end are stored in after[c]."""
    if code < MEMORY:
        return plain(code, p, gate, dm, vm, t + 0.5 * h, d1, v1, t + h)
    return carried(code, p, gate, inner, half, after, c, d0, v0, dm, vm, d1, v1, h, t)


@kernel
def step_on(
    code: int, p: FloatArray, gate: float, inner: FloatArray, half: FloatArray, after: FloatArray, c: int, d0: float, v0: float,
    dm: float, vm: float, d1: float, v1: float, h: float, t: float,
) -> tuple[float, float]:  # fmt: skip
    """As `advance`, but not inlined, for parts of steps: this keeps rarely executed code short."""
    return advance(code, p, gate, inner, half, after, c, d0, v0, dm, vm, d1, v1, h, t)


@kernel
def remember(code: int, inner: FloatArray, after: FloatArray, c: int) -> None:
    """Take over an element's state variables at the end of a step."""
    if code >= MEMORY:
        for i in range(inner.shape[1]):
            inner[c, i] = after[c, i]
