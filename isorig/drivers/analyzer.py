"""What analyzers with commands have in common: validated answers, data that are read twice, and a source that is read back."""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, ClassVar, TypeVar

import numpy as np

from isorig.drivers.answers import WordKind, parse
from isorig.drivers.errors import DriverError, InstrumentError, ProtocolError, SettingError
from isorig.drivers.kinds import CHANNELS, DrivenRig
from isorig.drivers.link import linked
from isorig.drivers.simulated.analyzers import Curve
from isorig.drivers.waits import WAITS, Waits

T = TypeVar("T")
K = TypeVar("K")
#: Points and rate (Hz) of a simulated time record, and number of averages of a coherence.
RECORD, RECORD_RATE, RECORDS = 2048, 256.0, 16
#: Maximum level of the source, V, and allowed relative difference of the level read back.
LOUDEST, STEP = 5.0, 0.01


class Analyzer:
    """An analyzer at a link, with its names of the traces that are read; each kind adds its own commands."""

    #: Valid answers to each query, and the command that switches the source off.
    ANSWERS: ClassVar[Mapping[str, WordKind]]
    SOURCE_OFF: ClassVar[str]

    def __init__(self, port: str, traces: Sequence[str], waits: Waits = WAITS) -> None:
        self._link, self._waits = linked(port, baud_rate=9600, waits=waits), waits
        self._traces = tuple(traces)
        self._sourcing = False
        try:
            self._link.clear()
            self._set_up()
            self._check()
        except BaseException:
            self._link.close()
            raise

    def set_source(self, level: float) -> None:
        """Set the level of its source (V, peak), switch it on, and read both back."""
        if not 0.0 < level <= LOUDEST:
            raise SettingError(f"the source of {self._link.name} cannot play {level:g} V; give up to {LOUDEST:g} V")
        answer, plays = self._play(level)
        if not abs(answer - level) <= STEP * level or not plays:
            raise SettingError(
                f"the source of {self._link.name} was set to {level:g} V and answers {answer:g} V; set it on its panel"
            )

    def close(self) -> None:
        """Switch its source off if this driver switched it on, and close the port."""
        if self._sourcing:
            self._sourcing = False
            # The connection may be lost.
            with suppress(DriverError):
                self._link.send(self.SOURCE_OFF)
        self._link.close()

    def _set_up(self) -> None:
        raise NotImplementedError

    def _check(self) -> None:
        # Raises what the analyzer reports.
        raise NotImplementedError

    def _play(self, level: float) -> tuple[float, bool]:
        # Switches the source on; returns its level as it answers, V, and whether it plays.
        raise NotImplementedError

    def _wait_until(self, finished: Callable[[], bool], timeout: float) -> None:
        end = time.monotonic() + timeout
        while not finished():
            if time.monotonic() > end:
                raise InstrumentError(f"{self._link.name} did not finish within {timeout:g} s; give the run more seconds")
            self._link.wait(self._waits.poll)

    def _send(self, command: str) -> None:
        self._link.expect_nothing()
        self._link.send(command)

    def _ask(self, command: str, kind: str = "") -> Any:
        # The answer to a query; `kind` is its valid answer where this does not follow from the command.
        self._send(command)
        answer = self._link.line().strip().decode("ascii", "replace")
        allowed = self.ANSWERS[kind or command.partition("?")[0]]
        return parse((answer,), (allowed,), who=self._link.name, command=command)[0]

    def _twice(self, command: str, read: Callable[[str], T]) -> T:
        first, second = read(command), read(command)
        if first != second:
            raise ProtocolError(f"{self._link.name} gave two different answers to {command}; check the cable, measure again")
        return first


def displayed(rig: DrivenRig, coherence: K, record: K) -> dict[K, Curve]:
    """Traces of a simulated analyzer by name: a coherence of the last channel with the drive, and a time record of it in V."""
    volts = rig.volts(RECORD, RECORD_RATE)[:, -1]
    return {coherence: rig.coherence(RECORDS * RECORD, RECORD_RATE), record: (np.arange(RECORD) / RECORD_RATE, volts)}


def example(coherence: str, record: str) -> str:
    """Example of entries in a plan that show what `displayed` gives, by the names of the two traces."""
    return f"""
sample_rate = {RECORD_RATE}
[[instrument.shows]]
trace = "{coherence}"
kind = "coherence"
channel = "motor"
reference = "head"
[[instrument.shows]]
trace = "{record}"
kind = "time"
channel = "motor"
unit = "V"
{CHANNELS}"""
