"""A serial line: any port that pyserial opens, with the errors of this package, and a limit on every wait and every answer."""

import os
import time
from collections.abc import Callable
from urllib.parse import urlsplit

import serial

from isorig.drivers.errors import ConnectionLostError, ProtocolError, SettingError
from isorig.drivers.waits import WAITS, Waits

#: Bytes read from the port at a time, and bytes written at a time.
CHUNK = 65536
PIECE = 4096
#: Maximum length of an answer line in bytes.
LONGEST = 256
#: A long answer may take this many times the transmission time of its bytes.
SLOWER = 3.0
#: Bits of a byte on a serial line: start, eight, stop.
BITS = 10
#: Message available: the bit of the status byte while an answer waits at a GPIB device (IEEE 488.2).
WAITING = 1 << 4
#: Allowed URL schemes; pyserial supports more, and some of those write files or load classes.
SCHEMES = ("socket", "rfc2217")


class Port:
    """One end of a serial line: a path like /dev/ttyACM0 with a baud rate, or a URL like socket://127.0.0.1:4000.

    Other links (`isorig.drivers.link`) have the same methods, those for single commands; a `bus` transfers messages with an end.
    Its methods raise ConnectionLostError if the instrument is gone or late, or accepts no bytes; ProtocolError if it sends what
    was not requested. Raises SettingError if the name is not a port; ConnectionLostError if the port cannot be opened.
    """

    bus = False

    def __init__(self, name: str, *, baud_rate: int, waits: Waits = WAITS) -> None:
        check_name(name)
        self.name, self.waits = name, waits
        self._buffer = bytearray()
        self._baud_rate = baud_rate
        # A socket does not report how much is waiting, so it is read until nothing arrives for a moment.
        self._counts = "://" not in name
        self._port = self._opened()

    def reopen(self) -> None:
        """Reopen the port after it was lost; waiting input is discarded."""
        self.close()
        self._buffer.clear()
        self._port = self._opened()

    def write(self, data: bytes) -> None:
        """Send bytes, a piece at a time."""
        try:
            for at in range(0, len(data), PIECE):
                self._port.write(data[at : at + PIECE])
        except serial.SerialTimeoutException:
            raise ConnectionLostError(
                f"{self.name} has accepted no data for {self.waits.sending:g} s; check that the instrument is on, then resume"
            ) from None
        except (serial.SerialException, OSError, TypeError) as error:
            raise self._gone(error) from None

    def send(self, command: str) -> None:
        """Send a command with LF."""
        self.write(command.encode("ascii") + b"\n")

    def read(self) -> bytes:
        """The bytes that arrived, after at most 0.05 s of waiting."""
        try:
            size = min(max(self._port.in_waiting, 1), CHUNK) if self._counts else CHUNK
            data: bytes = self._port.read(size)
        except (serial.SerialException, OSError, TypeError) as error:
            # pyserial raises a TypeError on its own closed descriptor if the port disappears during a read.
            raise self._gone(error) from None
        if self._buffer:
            data, self._buffer = bytes(self._buffer) + data, bytearray()
        return data

    def line(self, end: bytes = b"\n") -> bytes:
        """The next line without its end, of at most `LONGEST` bytes."""
        self._wait(lambda: end in self._buffer or len(self._buffer) > LONGEST, self.waits.answer, "a line")
        at = self._buffer.find(end)
        if not 0 <= at <= LONGEST:
            raise ProtocolError(
                f"{self.name} sends more than {LONGEST} bytes without an end of line; check that the plan names its kind"
            )
        line = bytes(self._buffer[:at])
        del self._buffer[: at + len(end)]
        return line

    def exactly(self, count: int) -> bytes:
        """The next `count` bytes."""
        whole = self.waits.answer + SLOWER * BITS * count / self._baud_rate
        self._wait(lambda: len(self._buffer) >= count, whole, f"{count} bytes")
        data = bytes(self._buffer[:count])
        del self._buffer[:count]
        return data

    def expect_nothing(self) -> None:
        """Check that no unexpected input is waiting, so that no answer is assigned to the wrong command."""
        try:
            waiting = bool(self._buffer) or bool(self._port.in_waiting)
        except (serial.SerialException, OSError, TypeError) as error:
            raise self._gone(error) from None
        if waiting:
            raise ProtocolError(f"{self.name} sent more than was requested; check the cable, then measure again")

    def clear(self) -> None:
        """Device clear: the instrument forgets unfinished commands and unread answers; a line is read until it is silent."""
        end = time.monotonic() + self.waits.silence
        while self.read():
            if time.monotonic() > end:
                raise ProtocolError(
                    f"{self.name} keeps sending after the stop command; switch the instrument off and on, and check "
                    "that the plan names its kind"
                )

    def status_byte(self) -> int | None:
        """The status byte by serial poll; None if this link has none, as a line: then `*STB?` asks for it."""
        return None

    def wait(self, seconds: float) -> None:
        """Wait until the instrument requests service, at most for `seconds`; a line just waits."""
        time.sleep(seconds)

    def close(self) -> None:
        """Close the port; may be called twice."""
        self._port.close()

    def _opened(self) -> serial.Serial:
        try:
            opened: serial.Serial = serial.serial_for_url(
                self.name, baudrate=self._baud_rate, timeout=0.05 if self._counts else 0.01,
                write_timeout=self.waits.sending, exclusive=True,
            )  # fmt: skip
        except (serial.SerialException, OSError, ValueError) as error:
            why = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else error
            raise ConnectionLostError(f"the port {self.name} cannot be opened ({why}); check the cable and the name") from None
        return opened

    def _gone(self, error: Exception) -> ConnectionLostError:
        return ConnectionLostError(f"{self.name} is gone ({error}); reconnect it and resume")

    def _wait(self, enough: Callable[[], bool], whole: float, what: str) -> None:
        began = heard = time.monotonic()
        while not enough():
            before = len(self._buffer)
            # `read` empties the buffer into its return value.
            self._buffer = bytearray(self.read())
            now = time.monotonic()
            if len(self._buffer) > before:
                heard = now
            if enough():
                return
            if now - heard > self.waits.answer or now - began > whole:
                raise ConnectionLostError(
                    f"{self.name} did not send {what} within {min(now - began, whole):.3g} s; check that it is on and that the "
                    "plan names its kind"
                )


def check_name(name: str) -> None:
    """Check a port's name before anything is opened. Raises SettingError if it is neither a path nor a URL with host and port."""
    if not name or not name.isprintable():
        raise SettingError(f"{name!r} is not a port; give a path like /dev/ttyACM0, or socket://127.0.0.1:4000")
    if "://" not in name:
        return
    try:
        parts = urlsplit(name)
        whole = parts.scheme in SCHEMES and bool(parts.hostname) and bool(parts.port)
    except ValueError:
        whole = False
    if not whole:
        raise SettingError(f"{name} is not a port; a URL needs a host and a port, as in socket://127.0.0.1:4000")
