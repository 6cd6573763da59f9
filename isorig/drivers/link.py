"""The connection to an instrument that takes commands: a line, a GPIB adapter, or a VISA resource, with one interface."""

from __future__ import annotations

import re
import time
from typing import Protocol

from isorig.drivers.port import Port
from isorig.drivers.waits import WAITS, Waits

#: Names of VISA resources, and of a GPIB address at an adapter: GPIB::11@/dev/ttyUSB0.
RESOURCE = re.compile(r"(GPIB|TCPIP|USB|ASRL|PXI|VXI)[^@]*::[^@]+", re.IGNORECASE)
ADAPTED = re.compile(r"GPIB\d*::(\d{1,2})(::INSTR)?@(.+)", re.IGNORECASE)


class CommandLink(Protocol):
    """A connection for commands and their answers.

    Its methods raise ConnectionLostError if the instrument is gone or late, ProtocolError if it sends what was not requested.
    """

    @property
    def name(self) -> str:
        """Its name in plans."""

    @property
    def bus(self) -> bool:
        """Whether it transfers messages with an end, as GPIB does; False for a line of bytes."""

    def send(self, command: str) -> None:
        """Send a command; the link adds its end."""

    def line(self) -> bytes:
        """The next line of an answer, without LF."""

    def exactly(self, count: int) -> bytes:
        """The next `count` bytes of an answer."""

    def expect_nothing(self) -> None:
        """Check that no unexpected answer is waiting, so that no answer is assigned to the wrong command."""

    def clear(self) -> None:
        """Device clear: the instrument forgets unfinished commands and unread answers; a line is read until it is silent."""

    def status_byte(self) -> int | None:
        """The status byte by serial poll; None if this link has none, then `*STB?` asks for it."""

    def wait(self, seconds: float) -> None:
        """Wait until the instrument requests service, at most for `seconds`; a link without service requests just waits."""

    def close(self) -> None:
        """Close the connection; may be called twice."""


class LineLink(Port):
    """A line: any port that pyserial opens."""

    bus = False

    def send(self, command: str) -> None:
        """Send a command with LF."""
        self.write(command.encode("ascii") + b"\n")

    def clear(self) -> None:
        """Discard input until nothing more arrives."""
        self.drop_input()

    def status_byte(self) -> int | None:
        """A line has no serial poll."""
        return None

    def wait(self, seconds: float) -> None:
        """Wait."""
        time.sleep(seconds)


def linked(name: str, *, baud_rate: int, waits: Waits = WAITS) -> CommandLink:
    """Open the link that a name in a plan denotes.

    Parameters
    ----------
    name
        A path or URL of `isorig.drivers.port`, a VISA resource (GPIB0::11::INSTR), or a GPIB address at a Prologix adapter
        (GPIB::11@/dev/ttyUSB0, GPIB::11@socket://192.168.1.5:1234).
    baud_rate
        Baud rate of a real serial line.
    waits
        Its timeouts.

    Raises
    ------
    SettingError
        The name denotes no port, or the package for VISA is missing.
    ConnectionLostError
        The connection cannot be opened.
    """
    adapted = ADAPTED.fullmatch(name)
    if adapted:
        from isorig.drivers.prologix import PrologixLink

        return PrologixLink(name, port=adapted[3], address=int(adapted[1]), waits=waits)
    if RESOURCE.fullmatch(name):
        from isorig.drivers.visa import VisaLink

        return VisaLink(name, baud_rate=baud_rate, waits=waits)
    return LineLink(name, baud_rate=baud_rate, waits=waits)
