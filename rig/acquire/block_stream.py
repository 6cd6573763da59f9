"""A run's blocks from the wire, whatever becomes of it: silence, a cable that is out for a while, an end that does not come."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from isorig.drivers.block import Block
from isorig.drivers.errors import ConnectionLostError, InstrumentError
from isorig.drivers.instrument import Counting, Holding, Rejoining, Stream

#: Seconds without a sample after which an instrument that counts is asked how far it is.
SILENCE = 2.0
#: Seconds of samples that may be missing at the end of a run without being waited for.
TAIL = 1.0
#: Seconds for which a wire may be away or silent and be taken up again, and seconds between two tries.
AWAY = 15.0
PAUSE = 0.2
#: Seconds in which an instrument that was stopped must have sent what was still on its way.
REST = 5.0


class Incoming:
    """Reads one run.

    Parameters
    ----------
    instrument
        Which is streaming.
    ticks
        How many to take.
    rate
        Samples a second, Hz.
    away
        Seconds for which nothing may come.
    stopped
        Asked all the time, whether blocks come or not; True ends the run.
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
        #: How often the wire was away and came back.
        self.returned = 0

    def blocks(self) -> Iterator[Block]:
        """Blocks until all ticks were taken, the run was stopped, or nothing comes any more.

        Raises
        ------
        DriverError
            Where the wire stays away, or the instrument cannot go on.
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
            # Silence, or a count that stands still.
            if now - asked > SILENCE:
                asked = now
                if self._is_over():
                    return
            if now - moved > self._away:
                return

    def rest(self) -> Iterator[Block]:
        """Blocks that were still on their way when the instrument was stopped.

        Raises
        ------
        InstrumentError
            Where it goes on sending.
        """
        end = time.monotonic() + REST
        while (block := self._instrument.read(0.1)) is not None:
            yield block
            if time.monotonic() > end:
                raise InstrumentError(
                    f"{self._instrument.identity} goes on sending {REST:g} s after it was stopped; switch it off and on"
                )

    def _held(self) -> int:
        return self._instrument.held if isinstance(self._instrument, Holding) else 0

    def _is_over(self) -> bool:
        # An instrument that counts says whether there is more to come.
        if not isinstance(self._instrument, Counting):
            return False
        before = self._counted
        try:
            self._counted = self._instrument.count()
        except ConnectionLostError:
            return False
        # All taken, and next to nothing missing: the last of it was lost. Where much is missing it may still come.
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
