"""Instruments with an open connection: those of a plan, and its loggers."""

from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from typing import Any

from isorig.drivers.errors import DriverError
from isorig.drivers.instrument import Records, Stream
from isorig.drivers.kinds import kinds
from isorig.drivers.simulated.served import served
from isorig.drivers.waits import WAITS, Waits
from isorig.rig.acquire.locks import port_locked
from isorig.rig.acquire.plan import Plan
from isorig.rig.errors import PlanError


@contextmanager
def _reached(kind: str, port: str, about: Any, waits: Waits) -> Iterator[Any]:
    # An instrument of that kind; at the port "virtual" a simulated one in a thread of this process, with the thesis's rig.
    with ExitStack() as stack:
        if port == "virtual":
            # The simulator takes longer to import than the rest of a session.
            from isorig.rig.acquire.simulated_instruments import far_end
            from isorig.rig.wire_bonder.description import wire_bonder

            port = stack.enter_context(served(far_end(kind, wire_bonder())))
        yield stack.enter_context(closing(kinds()[kind].open(port, about, waits)))


@contextmanager
def opened(plan: Plan, port: str, waits: Waits = WAITS) -> Iterator[Stream]:
    """The plan's streaming instrument; the port "virtual" is a simulated one."""
    with _reached(plan.instrument.kind, port, plan.instrument.settings, waits) as instrument:
        try:
            yield instrument
        finally:
            # The drive stops at every end of a session; the connection may be lost.
            with suppress(DriverError):
                instrument.stop()


@contextmanager
def opened_analyzer(plan: Plan, port: str, waits: Waits) -> Iterator[Records]:
    """The plan's analyzer; the port "virtual" is a simulated one."""
    with _reached(plan.instrument.kind, port, [shown.trace for shown in plan.instrument.shows], waits) as instrument:
        yield instrument


@contextmanager
def opened_loggers(plan: Plan, waits: Waits) -> Iterator[Mapping[str, Stream]]:
    """The loggers of a plan by name, prepared; the port "virtual" is a simulated one. Raises DriverError if one of them cannot be
    opened or prepared; PlanError if a channel is not among its inputs."""
    streams: dict[str, Stream] = {}
    with ExitStack() as stack:
        for name, logger in plan.loggers.items():
            stack.enter_context(port_locked(logger.port))
            streams[name] = stack.enter_context(_reached(logger.kind, logger.port, logger.settings, waits))
            inputs = [channel.input for channel in logger.channels.values()]
            prepare(streams[name], logger.sample_rate, inputs, f"the logger {name!r}")
        yield streams


def prepare(stream: Stream, sample_rate: float, inputs: Collection[int], who: str) -> float:
    """Set the rate (Hz) and the inputs of a stream, which messages call `who`; returns the actual rate. Raises DriverError if it
    refuses them; PlanError if an input is not among its own."""
    rate = stream.prepare(sample_rate=sample_rate, channels=list(inputs))
    if max(inputs) >= len(stream.inputs):
        raise PlanError(f"{who} has {len(stream.inputs)} inputs but the plan uses input {max(inputs)}; correct it")
    return rate
