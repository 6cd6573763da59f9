"""The instrument of a plan, with an open connection."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress

from isorig.drivers.block import Shows
from isorig.drivers.errors import DriverError
from isorig.drivers.instrument import Records, Stream
from isorig.drivers.kinds import RecordsKind, StreamKind
from isorig.drivers.waits import WAITS, Waits
from isorig.rig.acquire.plan import Plan
from isorig.rig.acquire.simulated_instruments import reached_port


@contextmanager
def opened(plan: Plan, port: str, waits: Waits = WAITS) -> Iterator[Stream]:
    """The plan's streaming instrument; for the port "virtual" see `reached_port`."""
    kind = plan.instrument.about
    assert isinstance(kind, StreamKind)  # checked by the session
    with reached_port(kind.name, port) as end, closing(kind.open(end, plan.instrument.settings, waits)) as instrument:
        try:
            yield instrument
        finally:
            # The drive stops at every end of a session; the connection may be lost.
            with suppress(DriverError):
                instrument.stop()


@contextmanager
def opened_analyzer(plan: Plan, port: str, waits: Waits = WAITS) -> Iterator[Records]:
    """The plan's analyzer; for the port "virtual" see `reached_port`."""
    kind = plan.instrument.about
    assert isinstance(kind, RecordsKind)  # checked by the session
    shows = [Shows(trace=s.trace, kind="time" if s.kind == "time" else "spectrum", unit=s.unit) for s in plan.instrument.shows]
    with reached_port(kind.name, port) as end, closing(kind.open(end, shows, waits)) as instrument:
        yield instrument
