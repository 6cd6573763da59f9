"""The drivers by the names that plans use."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager

from analysis.rigs import wire_bonder
from drivers.dataq import DataqInstrument
from drivers.framed import FramedInstrument
from drivers.hp35670a import Hp35670aInstrument
from drivers.instrument import Records, Stream
from drivers.mti600 import MtiInstrument
from drivers.shows import Shows
from drivers.sr785 import Sr785Instrument
from rig.acquire.plan import Plan
from rig.acquire.plant import playing


@contextmanager
def opened(plan: Plan, port: str) -> Iterator[Stream]:
    """The plan's streaming instrument, its wire held open; the port "virtual" is a simulated one with the thesis's rig."""
    if port == "virtual" and plan.instrument.kind == "framed":
        with playing(wire_bonder()) as simulated, opened(plan, simulated) as instrument:
            yield instrument
        return
    with closing(_stream(plan, port)) as instrument:
        yield instrument


@contextmanager
def opened_analyzer(plan: Plan, port: str) -> Iterator[Records]:
    """The plan's analyzer, its wire held open."""
    shows = [
        Shows(trace=s.trace, kind="time" if s.kind == "time" else "spectrum", unit=s.unit) for s in plan.instrument.shows
    ]  # fmt: skip
    kind = Sr785Instrument if plan.instrument.kind == "sr785" else Hp35670aInstrument
    with closing(kind(port, shows)) as instrument:
        yield instrument


def _stream(plan: Plan, port: str) -> Stream:
    about = plan.instrument
    if about.kind == "di1100":
        assert about.full_scale is not None  # the plan was checked
        return DataqInstrument(port, full_scale=about.full_scale)
    if about.kind == "mti600":
        return MtiInstrument(port, bus=about.bus)
    return FramedInstrument(port, baud_rate=about.baud_rate)
