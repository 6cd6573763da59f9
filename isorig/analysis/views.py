"""How results are shown and converted: methods that the application registers for a type.

Analysis neither plots nor writes: a result that notebooks show derives from `Viewed`, and
`isorig.rig.notebook` registers what its methods do.
"""

from collections.abc import Callable
from typing import Any, TypeVar

from isorig.analysis.errors import AnalysisError
from isorig.analysis.given import all_of_type

F = TypeVar("F", bound=Callable[..., Any])
_REGISTERED: dict[tuple[type, str], Callable[..., Any]] = {}


def shows(kind: type, name: str) -> Callable[[F], F]:
    """Decorator that registers a function as the method `name` of a type."""

    def register(function: F) -> F:
        _REGISTERED[kind, name] = function
        return function

    return register


def call(item: object, name: str, *args: Any, **more: Any) -> Any:
    """The registered method of an object's type or of a base of it. Raises AnalysisError if none is registered."""
    kind = _registered(item, name)
    if kind is None:
        others = sorted(other for each, other in _REGISTERED if isinstance(item, each) and other != "html")
        advice = f"use {' or '.join(others)}" if others else "import isorig as iso, and use what iso returns"
        raise AnalysisError(f"{type(item).__name__} has no {name} here; {advice}")
    return _REGISTERED[kind, name](item, *args, **more)


def _registered(item: object, name: str) -> type | None:
    # The type of an object, or the base of it, for which a method is registered.
    return next((kind for kind in type(item).__mro__ if (kind, name) in _REGISTERED), None)


class Viewed:
    """Base of results that a notebook shows."""

    __slots__ = ()

    def plot(self, *others: Any, **more: Any) -> Any:
        """A matplotlib figure of it, with `others` of the same type overlaid where the type supports this."""
        kind = _registered(self, "plot") or type(self)
        all_of_type(others, kind, "the overlay", f"of type {kind.__name__}; give another one, or name an option")
        return call(self, "plot", *others, **more)

    def to_xarray(self) -> Any:
        """An xarray.Dataset with coordinates; units are in the attributes of its variables."""
        return call(self, "to_xarray")

    def to_pandas(self) -> Any:
        """A pandas.DataFrame; units are in its attribute `attrs["units"]`, by column."""
        return call(self, "to_pandas")

    def _repr_html_(self) -> str:
        return str(call(self, "html"))
