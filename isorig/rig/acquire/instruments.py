"""The instrument of a plan, with an open connection."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress

from isorig.drivers.errors import DriverError
from isorig.drivers.instrument import Records, Stream
from isorig.drivers.kinds import RecordsKind, StreamKind
from isorig.drivers.shows import Shows
from isorig.drivers.waits import WAITS, Waits
from isorig.rig.acquire.plan import Plan
from isorig.rig.acquire.simulated_instruments import virtual_port
from isorig.rig.wire_bonder.description import wire_bonder


@contextmanager
def opened(plan: Plan, port: str, waits: Waits = WAITS) -> Iterator[Stream]:
    """The plan's streaming instrument; the port "virtual" is a simulated one of its kind, connected to the thesis's rig."""
    kind = plan.instrument.about
    assert isinstance(kind, StreamKind)  # checked by the session
    if port == "virtual":
        with virtual_port(kind.name, wire_bonder()) as simulated, opened(plan, simulated, waits) as instrument:
            yield instrument
        return
    with closing(kind.open(port, plan.instrument.settings, waits)) as instrument:
        try:
            yield instrument
        finally:
            # The drive stops at every end of a session; the connection may be lost.
            with suppress(DriverError):
                instrument.stop()


@contextmanager
def opened_analyzer(plan: Plan, port: str, waits: Waits = WAITS) -> Iterator[Records]:
    """The plan's analyzer; for the port "virtual" see `opened`."""
    kind = plan.instrument.about
    assert isinstance(kind, RecordsKind)  # checked by the session
    if port == "virtual":
        with virtual_port(kind.name, wire_bonder()) as simulated, opened_analyzer(plan, simulated, waits) as instrument:
            yield instrument
        return
    shows = [
        Shows(trace=s.trace, kind="time" if s.kind == "time" else "spectrum", unit=s.unit) for s in plan.instrument.shows
    ]  # fmt: skip
    with closing(kind.open(port, shows, waits)) as instrument:
        yield instrument
