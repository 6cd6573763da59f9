"""The blocks of a run from the instrument, with handling of silence, lost connections, and a stream that does not end."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from isorig.drivers.block import Block
from isorig.drivers.errors import ConnectionLostError, InstrumentError
from isorig.drivers.instrument import Counting, Holding, Rejoining, Stream

#: Seconds without a sample after which an instrument that counts is asked for its count.
SILENCE = 2.0
#: Seconds of samples that may be missing at the end of a run without being waited for.
TAIL = 1.0
#: Seconds for which a connection may be lost or silent and then be continued, and seconds between two attempts.
AWAY = 15.0
PAUSE = 0.2
#: Seconds within which a stopped instrument must have sent all data in transit.
REST = 5.0


class Incoming:
    """Reads one run.

    Parameters
    ----------
    instrument
        The instrument, which is streaming.
    ticks
        Number of ticks to read.
    rate
        Sample rate, Hz.
    away
        Seconds for which nothing may arrive; `AWAY` if None.
    stopped
        Called continuously, also without blocks; True ends the run.
    """

    def __init__(
        self,
        instrument: Stream,
        ticks: int,
        rate: float,
        *,
        away: float | None = None,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        self._instrument, self._ticks, self._rate, self._stopped = instrument, ticks, rate, stopped
        self._away = AWAY if away is None else away
        self._end = 0
        self._counted: int | None = None
        #: Number of times the connection was lost and restored.
        self.returned = 0

    def blocks(self) -> Iterator[Block]:
        """Blocks until all ticks were read, the run was stopped, or nothing arrives any more.

        Raises
        ------
        DriverError
            The connection remains lost, or the instrument cannot continue.
        """
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
            if now - asked > SILENCE:
                asked = now
                if self._is_over():
                    return
            if now - moved > self._away:
                return

    def rest(self) -> Iterator[Block]:
        """Blocks in transit when the instrument was stopped.

        Raises
        ------
        InstrumentError
            The instrument keeps sending.
        """
        end = time.monotonic() + REST
        while (block := self._instrument.read(0.1)) is not None:
            yield block
            if time.monotonic() > end:
                raise InstrumentError(
                    f"{self._instrument.identity} keeps sending {REST:g} s after the stop command; switch it off and on"
                )

    def _held(self) -> int:
        return self._instrument.held if isinstance(self._instrument, Holding) else 0

    def _is_over(self) -> bool:
        # An instrument that counts knows whether more samples will come.
        if not isinstance(self._instrument, Counting):
            return False
        before = self._counted
        try:
            self._counted = self._instrument.count()
        except ConnectionLostError:
            return False
        # All ticks were counted, and almost none is missing: the end was lost. If many are missing they may still arrive.
        whole = self._counted is not None and self._counted >= self._ticks and self._ticks - self._end <= TAIL * self._rate
        return self._counted is None or whole or self._counted == before

    def _rejoin(self, lost: ConnectionLostError) -> None:
        if not isinstance(self._instrument, Rejoining):
            raise lost
        end = time.monotonic() + self._away
        while time.monotonic() < end:
            time.sleep(PAUSE)
            try:
                self._instrument.rejoin()
            except ConnectionLostError:
                continue
            self.returned += 1
            return
        raise lost
