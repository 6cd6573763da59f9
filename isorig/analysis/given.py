"""Checks of what a user gives: each value of another type is refused in one sentence, where it enters."""

from collections.abc import Iterable, Mapping
from math import isfinite
from numbers import Integral, Real
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from isorig.analysis.errors import ArgumentError, DataError

T = TypeVar("T")


def of_type(given: object, kind: type[T], what: str, allowed: str) -> T:
    """The same value, if it is of that type.

    `what` and `allowed` are subject and end of the refusal, e.g. "the rig" and "an iso.Rig; give one". Raises ArgumentError if it
    is of another type.
    """
    if not isinstance(given, kind):
        raise _other_type(given, what, allowed)
    return given


def _other_type(given: object, what: str, allowed: str) -> ArgumentError:
    return ArgumentError(f"{what} is of type {type(given).__name__}, but must be {allowed}")


def given_mapping(given: object, what: str, allowed: str) -> Mapping[Any, Any]:
    """The same mapping, if it is one; parameters as for `of_type`. Raises ArgumentError if it is of another type."""
    mapping: Mapping[Any, Any] = of_type(given, Mapping, what, allowed)  # type: ignore[type-abstract]
    return mapping


def all_of_type(given: object, kind: type[T], what: str, allowed: str) -> tuple[T, ...]:
    """The values of a sequence, if all are of that type; a text or a mapping is no sequence.

    `what` and `allowed` as for `of_type`, e.g. "the argument runs" and "a sequence of iso.Run; give campaign.runs". Raises
    ArgumentError if it is no sequence, or one of the values is of another type.
    """
    if isinstance(given, str | bytes | Mapping) or not isinstance(given, Iterable):
        raise _other_type(given, what, allowed)
    values = tuple(given)
    for k, value in enumerate(values):
        if not isinstance(value, kind):
            raise ArgumentError(f"{what} has a {type(value).__name__} at place {k + 1}, but must be {allowed}")
    return values


def channel_names(given: object, what: str) -> tuple[str, ...]:
    """A sequence of names of channels. Raises ArgumentError if it is of another type, or a single name."""
    return all_of_type(given, str, what, 'a sequence of channel names; give one, for example ["table"]')


def text(given: object, what: str, example: str) -> str:
    """A text; the refusal has the example. Raises ArgumentError if it is of another type."""
    return of_type(given, str, what, f'a text; give it in quotes, for example "{example}"')


def flag(given: object, what: str) -> bool:
    """True or False. Raises ArgumentError if it is of another type."""
    if not isinstance(given, bool | np.bool_):
        raise _other_type(given, what, "True or False; give one of them")
    return bool(given)


def callback(given: object, what: str) -> None:
    """Refuse what cannot be called with a line of text. Raises ArgumentError if it cannot be called."""
    if not callable(given):
        raise _other_type(given, what, "a function that takes a line of text; give for example print")


def number(given: object, what: str) -> float:
    """A number, which may be infinite. Raises ArgumentError if it is a text or of another type."""
    if type(given) is float:  # in fits thousands of times: an abstract type takes longer
        return given
    if isinstance(given, bool) or not isinstance(given, Real):
        raise _other_type(given, what, "a number; give it without quotes or brackets")
    return float(given)


def finite(given: object, what: str) -> float:
    """A finite number. Raises ArgumentError if it is of another type, DataError if it is infinite or not a number."""
    value = number(given, what)
    if not isfinite(value):
        raise DataError(f"{what} is {value:g}, but must be finite; give a finite number")
    return value


def whole(given: object, what: str, least: int, most: int | None = None) -> int:
    """A whole number. Raises ArgumentError if it is of another type, DataError if it is less than `least` or more than `most`."""
    value = index(given, what)
    if value < least:
        raise DataError(f"{what} is {value}, but must be at least {least}; correct it")
    if most is not None and value > most:
        raise DataError(f"{what} is {value:.6g}, but must be at most {most}; correct it")
    return value


def index(given: object, what: str) -> int:
    """A whole number, which may be negative: counted from the end. Raises ArgumentError if it is of another type."""
    if isinstance(given, bool) or not isinstance(given, Integral):
        raise _other_type(given, what, "a whole number; give one without a decimal point")
    return int(given)


def one_of(given: object, allowed: Iterable[str], what: str) -> None:
    """Refuse anything that is none of these texts. Raises ArgumentError if it is no text, DataError if it is none of them."""
    names = tuple(allowed)
    if of_type(given, str, what, f"one of {', '.join(names)}; give one of these") not in names:
        raise DataError(f"{what} is {given!r}, but must be one of {', '.join(names)}; give one of these")


def positive(given: object, what: str, unit: str = "") -> float:
    """A finite number above zero; errors as for `finite`, `unit` is for the message."""
    value = finite(given, what)
    if value <= 0.0:
        raise DataError(f"{what} is {value:g}{unit}, but must be positive; correct it")
    return value


def interval(given: object, what: str) -> tuple[float, float]:
    """Two finite numbers, the lower one first. Raises ArgumentError if it is of another type, DataError if it is no interval."""
    allowed = "two numbers, the lower one first; give them, for example 5.0 and 60.0"
    ends = all_of_type(given, object, what, allowed)
    values = [finite(each, what) for each in ends]
    if len(values) != 2 or not values[0] < values[1]:
        raise DataError(f"{what} is {values}, but must be {allowed}")
    return values[0], values[1]


def numbers(given: object, what: str) -> NDArray[np.float64]:
    """An array of numbers, of any shape. Raises ArgumentError if it is of another type."""
    allowed = "an array of numbers; give one, for example run.read(CHANNEL)"
    try:
        values = np.asarray(given)
    except ValueError:
        raise _other_type(given, what, allowed) from None
    if values.dtype.kind not in "iufb":
        raise _other_type(given, what, allowed)
    return np.asarray(values, dtype=np.float64)


def given_guesses(given: object) -> tuple[tuple[float, float], ...]:
    """Pairs of a frequency in Hz and a damping ratio. Raises ArgumentError if they are of another type; DataError if one has more
    or fewer numbers than two, or one that is not positive."""
    what, allowed = "the argument guesses", "pairs of a frequency in Hz and a damping ratio; give for example [(5.0, 0.02)]"
    found = []
    for pair in all_of_type(given, object, what, allowed):
        values = [positive(each, what) for each in all_of_type(pair, object, what, allowed)]
        if len(values) != 2:
            raise DataError(f"{what} has {values}, but must be {allowed}")
        found.append((values[0], values[1]))
    return tuple(found)


def given_path(given: object, what: str) -> Path:
    """A path. Raises ArgumentError if it is neither a text nor a path, DataError if it has a character that no path has."""
    if not isinstance(given, str | Path):
        raise _other_type(given, what, 'a path; give one, for example "campaign.h5"')
    if "\0" in str(given):
        raise DataError(f"{what} is {str(given)!r}, but a path has no character zero; correct it")
    return Path(given)
