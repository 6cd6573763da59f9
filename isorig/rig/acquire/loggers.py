"""Slow loggers that run along with the instrument, e.g. of temperatures: each is read in its own thread, by the host's clock."""

import threading
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.drivers.block import Block
from isorig.drivers.errors import DriverError
from isorig.drivers.instrument import Stream
from isorig.rig.acquire.plan import LoggerPlan, Plan

#: Seconds of a read, after which the end of the run is noticed.
TURN = 0.1


class RunLoggers:
    """The plan's loggers, prepared, during one run.

    `put` receives the number of the logger and rows, shape (n, 1 + channels): arrival by the host's clock in s, and values; it is
    called from several threads.
    """

    def __init__(self, plan: Plan, loggers: Mapping[str, Stream], put: Callable[[int, FloatArray], None]) -> None:
        self._put, self._over = put, threading.Event()
        self._ended: dict[str, str] = {}
        self._rows = dict.fromkeys(loggers, 0)
        self._threads = [
            threading.Thread(
                target=self._read, args=(number, name, plan.loggers[name], stream), name=f"logger {name}", daemon=True
            )
            for number, (name, stream) in enumerate(loggers.items())
        ]

    def start(self) -> None:
        """Start all loggers."""
        for thread in self._threads:
            thread.start()

    def stop(self) -> Sequence[str]:
        """Stop all loggers; returns a sentence for each that ended before or stored nothing."""
        self._over.set()
        for thread in self._threads:
            thread.join()
        return [
            f"The logger {name} stored {rows} rows and ended: {self._ended[name]}." if name in self._ended
            else f"The logger {name} sent nothing; check its connection and its settings."
            for name, rows in self._rows.items()
            if name in self._ended or not rows
        ]  # fmt: skip

    def _read(self, number: int, name: str, logger: LoggerPlan, stream: Stream) -> None:
        try:
            stream.start()
            while not self._over.is_set():
                self._store(number, name, logger, stream, stream.read(TURN))
            stream.stop()
            while (block := stream.read(TURN)) is not None:
                self._store(number, name, logger, stream, block)
        except DriverError as error:
            # The run goes on: the logger is not what is measured.
            self._ended[name] = str(error)

    def _store(self, number: int, name: str, logger: LoggerPlan, stream: Stream, block: Block | None) -> None:
        if block is None or not len(block.samples):
            return
        count = len(block.samples)
        rows = np.empty((count, 1 + len(logger.channels)))
        rows[:, 0] = block.host_time - np.arange(count)[::-1] / logger.sample_rate
        for k, channel in enumerate(logger.channels.values(), 1):
            source = stream.inputs[channel.input]
            rows[:, k] = source.physical(block.samples[:, channel.input]) / channel.sensitivity
        self._rows[name] += count
        self._put(number, rows)
