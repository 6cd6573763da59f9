"""The connection to an instrument that takes commands: a line, a GPIB adapter, or a VISA resource, with one interface."""

from __future__ import annotations

import re
import time
from typing import Any

from isorig.drivers.answers import WordKind, parse, text, whole
from isorig.drivers.errors import ProtocolError, SettingError
from isorig.drivers.port import WAITING, Port
from isorig.drivers.visa import VisaLink
from isorig.drivers.waits import WAITS, Waits

#: Names of VISA resources, and of a GPIB address at an adapter: GPIB::11@/dev/ttyUSB0.
RESOURCE = re.compile(r"(GPIB|TCPIP|USB|ASRL|PXI|VXI)[^@]*::[^@]+", re.IGNORECASE)
ADAPTED = re.compile(r"GPIB\d*::(\d{1,2})(::INSTR)?@(.+)", re.IGNORECASE)
#: Characters that a Prologix adapter (GPIB-USB, GPIB-ETHERNET, or one that takes the same `++` commands) would take for its own:
#: sent after ESC.
ESCAPE = bytes([27])
SPECIAL = b"\x1b\r\n+"
#: Set-up: controller, not saved, no read without request, LF and EOI at the end of commands, no character added to answers,
#: clear the bus. The adapter gives up a read after 3 s of silence, its maximum: later than the driver does.
SET_UP = ("++savecfg 0", "++mode 1", "++auto 0", "++eos 2", "++eoi 1", "++eot_enable 0", "++read_tmo_ms 3000", "++ifc")
#: Highest primary address of a GPIB device (IEEE 488.1).
HIGHEST = 30
#: Seconds between two queries of the service request line.
POLL = 0.05


def linked(name: str, *, baud_rate: int, waits: Waits = WAITS) -> Port | PrologixLink | VisaLink:
    """Open the link that a name in a plan denotes; every kind has the methods of a `Port` for commands.

    They raise ConnectionLostError if the instrument is gone or late, ProtocolError if it sends what was not requested.

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
        return PrologixLink(name, port=adapted[3], address=int(adapted[1]), waits=waits)
    if RESOURCE.fullmatch(name):
        return VisaLink(name, baud_rate=baud_rate, waits=waits)
    return Port(name, baud_rate=baud_rate, waits=waits)


class PrologixLink:
    """The GPIB device at an address of the Prologix adapter at a port. Raises SettingError if there is no such address or port;
    ConnectionLostError or ProtocolError if the port cannot be opened, or there is no adapter."""

    bus = True

    def __init__(self, name: str, *, port: str, address: int, waits: Waits) -> None:
        if address > HIGHEST:
            raise SettingError(f"{name} has the GPIB address {address}; give 0 to {HIGHEST}")
        self.name = name
        self._port = Port(port, baud_rate=115200, waits=waits)
        self._reading = False
        try:
            self._port.clear()
            if not self._ask("++ver", text(100)):
                raise ProtocolError(f"{name} does not report a version; check that {port} is a Prologix adapter")
            for command in (*SET_UP, f"++addr {address}"):
                self._port.send(command)
        except BaseException:
            self._port.close()
            raise

    def send(self, command: str) -> None:
        escaped = b"".join(ESCAPE + bytes([c]) if c in SPECIAL else bytes([c]) for c in command.encode("ascii"))
        self._port.write(escaped + b"\n")
        self._reading = False

    def line(self) -> bytes:
        self._request()
        return self._port.line()

    def exactly(self, count: int) -> bytes:
        self._request()
        return self._port.exactly(count)

    def expect_nothing(self) -> None:
        """Check that the adapter sent nothing, and that the instrument has no answer."""
        self._port.expect_nothing()
        if self.status_byte() & WAITING:
            raise ProtocolError(f"{self.name} has an answer that was not requested; check that the plan names its kind")

    def clear(self) -> None:
        self._port.send("++clr")
        self._port.clear()
        self._reading = False

    def status_byte(self) -> int:
        return int(self._ask("++spoll", whole(0, 255)))

    def wait(self, seconds: float) -> None:
        """Wait until the service request line is set."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if self._ask("++srq", whole(0, 1)):
                return
            time.sleep(min(POLL, seconds))

    def close(self) -> None:
        self._port.close()

    def _request(self) -> None:
        # One request reads the answer up to EOI; the rest waits in the port.
        if not self._reading:
            self._port.send("++read eoi")
            self._reading = True

    def _ask(self, command: str, kind: WordKind) -> Any:
        self._port.expect_nothing()
        self._port.send(command)
        answer = self._port.line().strip().decode("ascii", "replace")
        return parse((answer,), (kind,), who=self.name, command=command)[0]
