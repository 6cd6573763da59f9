"""A plan's instrument, its wire held open."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager

from analysis.rigs import wire_bonder
from drivers.instrument import Records, Stream
from drivers.kinds import RecordsKind, StreamKind
from drivers.shows import Shows
from rig.acquire.plan import Plan
from rig.acquire.plant import playing


@contextmanager
def opened(plan: Plan, port: str) -> Iterator[Stream]:
    """The plan's streaming instrument; the port "virtual" is a simulated one with the thesis's rig."""
    kind = plan.instrument.about
    assert isinstance(kind, StreamKind)  # the session has looked
    if port == "virtual" and kind.name == "framed":
        with playing(wire_bonder()) as simulated, opened(plan, simulated) as instrument:
            yield instrument
        return
    with closing(kind.open(port, plan.instrument.settings)) as instrument:
        yield instrument


@contextmanager
def opened_analyzer(plan: Plan, port: str) -> Iterator[Records]:
    """The plan's analyzer."""
    kind = plan.instrument.about
    assert isinstance(kind, RecordsKind)  # the session has looked
    shows = [
        Shows(trace=s.trace, kind="time" if s.kind == "time" else "spectrum", unit=s.unit) for s in plan.instrument.shows
    ]  # fmt: skip
    with closing(kind.open(port, shows)) as instrument:
        yield instrument
