"""The drivers by the names that plans use."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager

from analysis.rigs import wire_bonder
from drivers.framed import FramedInstrument
from drivers.instrument import Stream
from rig.acquire.plan import Plan
from rig.acquire.plant import playing


@contextmanager
def opened(plan: Plan, port: str) -> Iterator[Stream]:
    """The plan's instrument, its wire held open; the port "virtual" is a simulated one with the thesis's rig behind it."""
    if port == "virtual":
        with playing(wire_bonder()) as simulated, opened(plan, simulated) as instrument:
            yield instrument
        return
    with closing(FramedInstrument(port, baud_rate=plan.instrument.baud_rate)) as instrument:
        yield instrument
