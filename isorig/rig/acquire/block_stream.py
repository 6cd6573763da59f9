"""The blocks of a run from the instrument, with handling of silence, lost connections, and a stream that does not end."""

import time
from collections.abc import Callable, Iterator

from isorig.drivers.block import Block
from isorig.drivers.errors import ConnectionLostError, InstrumentError
from isorig.drivers.instrument import Counting, Holding, Rejoining, Stream
from isorig.rig.acquire.policy import SessionWaits


class BlockStream:
    """Reads `ticks` of a run at a `rate` in Hz; it ends as soon as `stopped`, called continuously, returns True."""

    def __init__(self, instrument: Stream, ticks: int, rate: float, *, waits: SessionWaits, stopped: Callable[[], bool]) -> None:
        self._instrument, self._ticks, self._rate, self._stopped = instrument, ticks, rate, stopped
        self._waits = waits
        self._end = 0
        self._asked: int | None = None
        #: The ticks that the instrument counted when it was stopped; None if it does not count.
        self.counted: int | None = None
        #: Number of times the connection was lost and restored.
        self.returned = 0

    def run(self, keep: Callable[[Block], None]) -> None:
        """Start the instrument, hand over its blocks until all ticks were read, the run was stopped, or nothing arrives any more,
        and stop it. Raises DriverError if the connection remains lost, the instrument cannot continue, or it keeps sending after
        the stop."""
        self._instrument.start()
        for block in self._blocks():
            keep(block)
        self.counted = self._instrument.stop()
        # What was in transit.
        end = time.monotonic() + self._waits.transit
        while (rest := self._instrument.read(0.1)) is not None:
            keep(rest)
            if time.monotonic() > end:
                raise InstrumentError(
                    f"{self._instrument.identity} keeps sending {self._waits.transit:g} s after the stop command; switch it off "
                    "and on"
                )

    def _blocks(self) -> Iterator[Block]:
        moved = asked = time.monotonic()
        reached = 0
        while reached < self._ticks and not self._stopped():
            try:
                block = self._instrument.read(0.1)
            except ConnectionLostError as lost:
                self._rejoin(lost)
                moved = asked = time.monotonic()
                continue
            if block is not None:
                yield block
                self._end = max(self._end, block.end_tick)
            now, before, reached = time.monotonic(), reached, self._end + self._held()
            if reached > before:
                moved = asked = now
                continue
            # Silence, or a count that does not increase.
            if now - asked > self._waits.silence:
                asked = now
                if self._is_over():
                    return
            if now - moved > self._waits.reconnection:
                return

    def _held(self) -> int:
        return self._instrument.held if isinstance(self._instrument, Holding) else 0

    def _is_over(self) -> bool:
        # An instrument that counts knows whether more samples will come.
        if not isinstance(self._instrument, Counting):
            return False
        before = self._asked
        try:
            self._asked = self._instrument.count()
        except ConnectionLostError:
            return False
        # All ticks were counted, and almost none is missing: the end was lost. If many are missing they may still arrive.
        few = self._ticks - self._end <= self._waits.missing * self._rate
        return self._asked is None or (self._asked >= self._ticks and few) or self._asked == before

    def _rejoin(self, lost: ConnectionLostError) -> None:
        if not isinstance(self._instrument, Rejoining):
            raise lost
        end = time.monotonic() + self._waits.reconnection
        while time.monotonic() < end:
            time.sleep(self._waits.retry)
            try:
                self._instrument.rejoin()
            except ConnectionLostError:
                continue
            self.returned += 1
            return
        raise lost
