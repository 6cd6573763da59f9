"""What blocks say beside their samples, in sentences: losses inside the instrument, faults, counter and clock that disagree."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from isorig.drivers.block import Block, Status
from isorig.drivers.instrument import Noticing, Stream

#: What speaks against keeping a run, by the block's status; {n} blocks, the first at {s} s.
AGAINST = {
    Status.LOST: "The instrument lost samples inside in {n} blocks from {s} s on; give it a lower rate, or take the run again.",
    Status.FAULT: "The instrument reported a fault in {n} blocks from {s} s on; check it and take the run again.",
    Status.DISAGREES: (
        "Counter, frame numbers and clock of the instrument disagreed {n} times from {s} s on; the time axis is the majority's."
    ),
    Status.RESYNCED: (
        "Bytes were lost {n} times from {s} s on; what could not be told apart is left out, and the number of missing samples is "
        "sure to one each time."
    ),
    Status.CLOCKED: (
        "This machine's clock alone tells of lost samples, {n} times from {s} s on; their number is sure to some 10 ms."
    ),
}
#: What is told and is no fault of the run.
TOLD = {
    Status.UNSURE: "A byte or word lost from {s} s on would not be seen; leave the digital inputs open, or wire one to 5 V.",
}
#: Clauses of a driver that are told; more of the same kind say nothing new.
CLAUSES = 3


@dataclass
class Remarks:
    """Counts what is told of blocks.

    Parameters
    ----------
    rate
        Samples a second, Hz.
    """

    rate: float
    counts: dict[Status, int] = field(default_factory=dict)
    first: dict[Status, float] = field(default_factory=dict)
    clauses: list[str] = field(default_factory=list)
    returned: int = 0

    def add(self, block: Block) -> None:
        """Take note of a block."""
        for status in (*AGAINST, *TOLD):
            if block.status & status:
                self.counts[status] = self.counts.get(status, 0) + 1
                self.first.setdefault(status, block.first_tick / self.rate)

    def end(self, instrument: Stream, returned: int) -> None:
        """Take note of what the driver noticed, and how often the wire was away."""
        self.clauses += instrument.noticed if isinstance(instrument, Noticing) else ()
        self.returned = returned

    def against(self) -> Sequence[str]:
        """What speaks against keeping the run."""
        return tuple(self._against())

    def told(self) -> Sequence[str]:
        """What is worth knowing all the same."""
        return tuple(self._sentences(TOLD))

    def _against(self) -> Iterator[str]:
        yield from self._sentences(AGAINST)
        if self.returned:
            yield f"The wire was away {self.returned} times and was taken up again; what was lost meanwhile is counted."
        for clause in self.clauses[:CLAUSES]:
            yield f"The driver noticed: {clause}."
        if len(self.clauses) > CLAUSES:
            yield f"The driver noticed {len(self.clauses) - CLAUSES} more of that kind."

    def _sentences(self, table: dict[Status, str]) -> Iterator[str]:
        for status, sentence in table.items():
            if status in self.counts:
                yield sentence.format(n=self.counts[status], s=f"{self.first[status]:.3g}")
