"""Blocks between instrument and disk: a queue bounded by its number of samples, for any size of blocks."""

from __future__ import annotations

import threading
from collections import deque

from isorig.drivers.block import Block


class BlockQueue:
    """One thread puts items, another takes all of them; at most `most` samples wait."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._blocks: deque[Block] = deque()
        self._samples = 0
        self._ended = False
        self._changed = threading.Condition()

    def put(self, block: Block, timeout: float) -> bool:
        """Add a block; False if there was no room within `timeout` seconds."""
        with self._changed:
            room = self._changed.wait_for(lambda: self._samples < self._most, timeout)
            if room:
                self._blocks.append(block)
                self._samples += len(block.samples)
                if len(self._blocks) == 1 or self._samples > self._most // 2:
                    self._changed.notify_all()
            return room

    def get_all(self, gather: float) -> list[Block] | None:
        """All blocks that arrived within `gather` seconds, earlier if the queue is half full; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._blocks or self._ended)
            self._changed.wait_for(lambda: self._samples > self._most // 2 or self._ended, gather)
            blocks, self._samples = list(self._blocks), 0
            self._blocks.clear()
            self._changed.notify_all()
            return blocks or None

    def end(self) -> None:
        """Declare that nothing more will be added."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()
