"""Validation of instruments' answers: type and limits of each word."""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from isorig.drivers.errors import ProtocolError

_WHOLE = re.compile(r"[+-]?\d{1,20}")
_NUMBER = re.compile(r"[+-]?(\d{1,40}(\.\d{0,40})?|\.\d{1,40})([eE][+-]?\d{1,3})?")
#: Characters of an answer quoted in a message.
SHOWN = 60


@dataclass(frozen=True)
class WordKind:
    """Valid values of one word of an answer: in words, for the message, and a conversion that returns None if a word is not
    valid."""

    allowed: str
    read: Callable[[str], Any]


def whole(low: int, high: int) -> WordKind:
    """An integer within limits."""

    def read(word: str) -> int | None:
        return value if _WHOLE.fullmatch(word) and low <= (value := int(word)) <= high else None

    return WordKind(f"a whole number from {low} to {high}", read)


def number(low: float = -math.inf, high: float = math.inf) -> WordKind:
    """A finite decimal number within limits."""

    def read(word: str) -> float | None:
        return value if _NUMBER.fullmatch(word) and math.isfinite(value := float(word)) and low <= value <= high else None

    return WordKind("a number" + ("" if math.isinf(low) and math.isinf(high) else f" from {low:g} to {high:g}"), read)


def one_of(*words: str) -> WordKind:
    """One of a few words."""
    return WordKind(" or ".join(words), lambda word: word if word in words else None)


def text(longest: int) -> WordKind:
    """Printable characters."""
    return WordKind(
        f"text of up to {longest} characters", lambda word: word if word.isprintable() and len(word) <= longest else None
    )


def parse(words: Sequence[str], kinds: Sequence[WordKind], *, who: str, command: str) -> tuple[Any, ...]:
    """The values of the words of an answer, of which there must be as many as kinds; messages name the port `who` and the
    command. Raises ProtocolError if a word is missing, superfluous or invalid."""
    values = tuple(kind.read(word) for kind, word in zip(kinds, words, strict=False))
    if len(words) != len(kinds) or any(value is None for value in values):
        received = " ".join(words)
        shown = repr(received if len(received) <= SHOWN else received[:SHOWN] + "...") if received else "nothing"
        allowed = ", then ".join(kind.allowed for kind in kinds)
        raise ProtocolError(
            f"{who} answered {command} with {shown} where {allowed} is allowed; check the cable and that the plan names the "
            "right instrument"
        )
    return values
