"""A VISA resource through PyVISA: GPIB, USB, Ethernet and serial instruments.

The backend is pyvisa-py, or the one that the environment variable PYVISA_LIBRARY names, as for every program with PyVISA.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any, TypeVar

from isorig.drivers.answers import parse, whole
from isorig.drivers.errors import ConnectionLostError, ProtocolError, SettingError, brief
from isorig.drivers.port import BITS, LONGEST, SLOWER, WAITING
from isorig.drivers.waits import Waits

if TYPE_CHECKING:
    from pyvisa import ResourceManager

T = TypeVar("T")
BACKEND = "@py"
#: Timeout of the search for unrequested bytes, milliseconds; and seconds that a bus may take to open a resource.
GLANCE = 1
OPENING = 5.0


def manager() -> ResourceManager:
    """PyVISA's resource manager. Raises SettingError if the package, or the library of its backend, is missing."""
    try:
        import pyvisa
    except ImportError:
        raise SettingError(
            "VISA resources need the package PyVISA, which is missing; install it with pip install 'isorig[visa]'"
        ) from None
    wanted = os.environ.get("PYVISA_LIBRARY", BACKEND)
    try:
        return pyvisa.ResourceManager(wanted)
    except Exception as error:
        # Backends raise what their libraries raise.
        raise SettingError(
            f"PyVISA cannot load its backend {wanted} ({brief(error)}); correct PYVISA_LIBRARY, or install pyvisa-py"
        ) from None


class VisaLink:
    """A VISA resource by its name, e.g. GPIB0::11::INSTR, TCPIP0::192.168.1.5::INSTR, ASRL/dev/ttyUSB0::INSTR. Raises
    SettingError if PyVISA is missing; ConnectionLostError if the resource cannot be opened."""

    def __init__(self, name: str, *, baud_rate: int, waits: Waits) -> None:
        self.name, self._waits = name, waits
        self.bus = not (name.upper().startswith("ASRL") or name.upper().endswith("::SOCKET"))
        self._baud_rate = baud_rate
        self._polls, self._events = True, True
        try:
            resource: Any = manager().open_resource(name, open_timeout=round(1e3 * OPENING))
        except SettingError:
            raise
        except Exception as error:
            raise ConnectionLostError(
                f"the VISA resource {name} cannot be opened ({brief(error)}); check the cable, the name and the backend"
            ) from None
        self._resource = resource
        if name.upper().startswith("ASRL"):
            try:
                self._resource.baud_rate = baud_rate
            except Exception as error:
                self.close()
                raise self._failure(error) from None

    def send(self, command: str) -> None:
        self._resource.timeout = _milliseconds(self._waits.sending)
        self._call(lambda: self._resource.write_raw(command.encode("ascii") + b"\n"))

    def line(self) -> bytes:
        line = self._read(LONGEST + 1, self._waits.answer, lines=True)
        if not line.endswith(b"\n"):
            # The end of a message on a bus is as good as LF.
            if len(line) > LONGEST:
                raise ProtocolError(
                    f"{self.name} sends more than {LONGEST} bytes without an end of line; check that the plan names its kind"
                )
            return line
        return line[:-1]

    def exactly(self, count: int) -> bytes:
        data = self._read(count, self._waits.answer + SLOWER * BITS * count / self._baud_rate, lines=False)
        if len(data) != count:
            raise ProtocolError(
                f"{self.name} ended its answer after {len(data)} of {count} bytes; check the cable, measure again"
            )
        return data

    def expect_nothing(self) -> None:
        """Check that no answer waits: by the status byte on a bus, otherwise by a short read."""
        if self.bus:
            byte = self.status_byte()
            waiting = byte is not None and bool(byte & WAITING)
        else:
            waiting = bool(self._received(1, GLANCE, lines=False))
        if waiting:
            raise ProtocolError(f"{self.name} sent more than was requested; check the cable, then measure again")

    def clear(self) -> None:
        """Device clear on a bus; a line is read until it is silent."""
        if self.bus:
            # Not every backend has it: what was left is then noticed before the first command.
            with suppress(ConnectionLostError):
                self._call(self._resource.clear)
            return
        end = time.monotonic() + self._waits.silence
        while self._received(1, GLANCE, lines=False):
            if time.monotonic() > end:
                raise ProtocolError(f"{self.name} keeps sending; check that the plan names its kind")

    def status_byte(self) -> int | None:
        if not (self.bus and self._polls):
            return None
        try:
            byte = str(int(self._resource.read_stb()))
        except Exception as error:
            if not (isinstance(error, (NotImplementedError, AttributeError)) or _is(error, "error_nonsupported_operation")):
                raise self._failure(error) from None
            self._polls = False
            return None
        # IEEE 488.1: a status byte is a number from 0 to 255.
        return int(parse((byte,), (whole(0, 255),), who=self.name, command="a serial poll")[0])

    def wait(self, seconds: float) -> None:
        """Wait for a service request, where the backend reports them."""
        if not (self.bus and self._events):
            time.sleep(seconds)
            return
        from pyvisa.constants import EventMechanism, EventType

        try:
            self._resource.enable_event(EventType.service_request, EventMechanism.queue)
            self._resource.wait_on_event(EventType.service_request, _milliseconds(seconds), capture_timeout=True)
        except Exception:
            # pyvisa-py and simulated resources have no events: the driver polls.
            self._events = False
            time.sleep(seconds)

    def close(self) -> None:
        with suppress(Exception):
            self._resource.close()

    def _read(self, count: int, seconds: float, *, lines: bool) -> bytes:
        data = self._received(count, _milliseconds(seconds), lines=lines)
        if data is None:
            what = "a line" if lines else f"{count} bytes"
            raise ConnectionLostError(
                f"{self.name} did not send {what} within {seconds:.3g} s; check that it is on and what the plan says"
            )
        return data

    def _received(self, count: int, timeout: int, *, lines: bool) -> bytes | None:
        # None if it takes longer than the timeout, in ms.
        from pyvisa.constants import SerialTermination

        try:
            self._resource.timeout = timeout
            self._resource.read_termination = "\n" if lines else None
            if self.name.upper().startswith("ASRL"):
                self._resource.end_input = SerialTermination.termination_char if lines else SerialTermination.none
            return bytes(self._resource.read_bytes(count, chunk_size=count, break_on_termchar=True))
        except Exception as error:
            if _is(error, "error_timeout"):
                return None
            raise self._failure(error) from None

    def _call(self, action: Callable[[], T]) -> T:
        try:
            return action()
        except Exception as error:
            raise self._failure(error) from None

    def _failure(self, error: Exception) -> Exception:
        return ConnectionLostError(f"{self.name} is gone ({brief(error)}); reconnect it and resume")


def _milliseconds(seconds: float) -> int:
    return max(round(1e3 * seconds), 1)


def _is(error: Exception, name: str) -> bool:
    from pyvisa.constants import StatusCode

    return getattr(error, "error_code", None) == StatusCode[name]
