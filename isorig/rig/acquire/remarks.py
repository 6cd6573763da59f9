"""Status of the blocks of a run, in sentences: losses inside the instrument, faults, disagreement of counter and clock."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from isorig.drivers.alignment import WIRE
from isorig.drivers.arrivals import JUMP
from isorig.drivers.block import Block, Status
from isorig.drivers.instrument import Instrument, Noticing

#: Reasons against keeping a run, by block status; {n} blocks, the first at {s} s.
AGAINST = {
    Status.LOST: "The instrument lost samples internally in {n} blocks from {s} s on; give it a lower rate, or repeat the run.",
    Status.FAULT: "The instrument reported a fault in {n} blocks from {s} s on; check it and repeat the run.",
    Status.DISAGREES: (
        "Counter, frame numbers and clock of the instrument disagree {n} times from {s} s on; the time axis follows the majority."
    ),
    Status.RESYNCED: (
        "Bytes were lost {n} times from {s} s on; ambiguous samples are left out, and the number of missing samples is uncertain "
        "by one each time."
    ),
    Status.CLOCKED: (
        "Only the host's clock indicates lost samples, {n} times from {s} s on; "
        f"their number is uncertain by about {1e3 * JUMP:g} ms."
    ),
}
#: Information that is not a fault of the run.
INFORMATION = {Status.UNSURE: f"A byte or word lost from {{s}} s on would not be detected; {WIRE}."}
#: Maximum number of a driver's clauses that are printed.
CLAUSES = 3


@dataclass
class Remarks:
    """Counts the status flags of blocks; the sample rate is in Hz."""

    rate: float
    counts: dict[Status, int] = field(default_factory=dict)
    first: dict[Status, float] = field(default_factory=dict)
    clauses: list[str] = field(default_factory=list)
    returned: int = 0
    loggers: list[str] = field(default_factory=list)

    def add(self, block: Block) -> None:
        """Count the flags of a block."""
        for status in (*AGAINST, *INFORMATION):
            if block.status & status:
                self.counts[status] = self.counts.get(status, 0) + 1
                self.first.setdefault(status, block.first_tick / self.rate)

    def end(self, instrument: Instrument, returned: int = 0, loggers: Sequence[str] = ()) -> None:
        """Add the driver's notices, the number of reconnections, and what failed of the loggers, in sentences."""
        self.loggers += loggers
        self.clauses += instrument.noticed if isinstance(instrument, Noticing) else ()
        self.returned = returned

    def others(self) -> Iterator[str]:
        """Information that is not a reason against the run."""
        return self._sentences(INFORMATION)

    def against(self) -> Iterator[str]:
        """Reasons against keeping the run."""
        yield from self._sentences(AGAINST)
        if self.returned:
            yield f"The connection was lost and restored {self.returned} times; the samples lost meanwhile are counted."
        yield from self.loggers
        for clause in self.clauses[:CLAUSES]:
            yield f"The driver reports: {clause}."
        if len(self.clauses) > CLAUSES:
            yield f"The driver reports {len(self.clauses) - CLAUSES} more of this kind."

    def _sentences(self, table: dict[Status, str]) -> Iterator[str]:
        for status, sentence in table.items():
            if status in self.counts:
                yield sentence.format(n=self.counts[status], s=f"{self.first[status]:.3g}")
