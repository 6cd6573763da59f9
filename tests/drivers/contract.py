"""How the test of an instrument states its far end, for the contract that every driver keeps to (`test_contract.py`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from far import Far


@dataclass(frozen=True, kw_only=True)
class Situation:
    """What happens at the far end: a loss, an overload from a tick on, its true rate over the nominal one, silence."""

    lose: tuple[int, int] | None = None
    overload_at: int | None = None
    clock: float = 1.0
    silent: bool = False
    mute_after: int | None = None

    def lost(self, tick: int) -> bool:
        """Whether a tick is lost."""
        return self.lose is not None and self.lose[0] <= tick < sum(self.lose)

    def overloaded(self, tick: int) -> bool:
        """Whether an input is overloaded."""
        return self.overload_at is not None and tick >= self.overload_at


@dataclass
class Served:
    """A far end that is served: the port, whether it drives the rig, and its end."""

    port: str
    driving: Callable[[], bool] = lambda: False
    unplug: Callable[[], None] = lambda: None


@dataclass(frozen=True, kw_only=True)
class Case:
    """A kind of instrument with its far end.

    Parameters
    ----------
    kind
        Its name in plans.
    serve
        Serves the far end in a situation.
    rate, speed
        Hz, signal seconds per second.
    lose, within
        A loss that is tried, and the ticks by which its place and count may be wrong.
    reports
        Whether it can report an overload; if not, its page says so.
    """

    kind: str
    serve: Callable[[Situation], AbstractContextManager[Served]]
    rate: float
    speed: float = 10.0
    lose: tuple[int, int] = (500, 100)
    within: int = 0
    reports: bool = True


@contextmanager
def far_served(far: Far, situation: Situation, driving: Callable[[], bool] = lambda: False) -> Iterator[Served]:
    """A far end at a pseudo-terminal; a silent one takes everything and says nothing."""
    if situation.silent:
        far = Far()
    with far:
        yield Served(far.port, driving, far.unplug)


def stated() -> dict[str, Case]:
    """By kind: the `CASES` of the tests of this folder."""
    files = sorted(path for path in Path(__file__).parent.glob("test_*.py") if "\nCASES = (" in path.read_text(encoding="utf-8"))
    return {case.kind: case for path in files for case in import_module(path.stem).CASES}
