"""A serial line: whatever pyserial opens, with errors in this layer's words and answers read by line or by length."""

from __future__ import annotations

import time
from collections.abc import Callable

import serial

from drivers.errors import ConnectionLostError, ProtocolError

#: Bytes asked of the port at a time, seconds that an answer may take, the longest line that an instrument may send.
CHUNK = 65536
PATIENCE = 2.0
LONGEST = 1 << 20


class Port:
    """One end of a serial line.

    Parameters
    ----------
    name
        A path such as /dev/ttyACM0, or an URL such as socket://127.0.0.1:4000.
    baud_rate
        Of a real serial line.

    Raises
    ------
    ConnectionLostError
        Where it cannot be opened.
    """

    def __init__(self, name: str, *, baud_rate: int) -> None:
        self.name = name
        self._buffer = bytearray()
        try:
            # A socket does not tell how much is waiting, so it is read until nothing comes for a moment.
            self._counts = "://" not in name
            self._port = serial.serial_for_url(name, baudrate=baud_rate, timeout=0.05 if self._counts else 0.01)
        except (serial.SerialException, OSError, ValueError) as error:
            raise ConnectionLostError(f"the port {name} cannot be opened ({error}); check the cable and the name") from None

    def write(self, data: bytes) -> None:
        """Send bytes."""
        try:
            self._port.write(data)
        except (serial.SerialException, OSError) as error:
            raise ConnectionLostError(f"{self.name} is gone ({error}); plug it in and resume") from None

    def read(self) -> bytes:
        """What arrived, after at most 0.05 s of waiting."""
        try:
            size = min(max(self._port.in_waiting, 1), CHUNK) if self._counts else CHUNK
            data: bytes = self._port.read(size)
        except (serial.SerialException, OSError, TypeError) as error:
            # pyserial trips over its own closed descriptor with a TypeError when the port goes during a read.
            raise ConnectionLostError(f"{self.name} is gone ({error}); plug it in and resume") from None
        if self._buffer:
            data, self._buffer = bytes(self._buffer) + data, bytearray()
        return data

    def line(self, end: bytes = b"\n", *, patience: float = PATIENCE) -> bytes:
        """The next line without its end.

        Raises
        ------
        ConnectionLostError
            Where none comes in time.
        ProtocolError
            Where it does not end.
        """
        self._wait(lambda: end in self._buffer or len(self._buffer) > LONGEST, patience, "a line")
        if end not in self._buffer:
            raise ProtocolError(f"{self.name} sends a line without an end; check that the plan names the right instrument")
        line, _, rest = bytes(self._buffer).partition(end)
        self._buffer = bytearray(rest)
        return line

    def exactly(self, count: int, *, patience: float = PATIENCE) -> bytes:
        """The next `count` bytes; as `line`, the patience begins anew with each arrival."""
        self._wait(lambda: len(self._buffer) >= count, patience, f"{count} bytes")
        data = bytes(self._buffer[:count])
        del self._buffer[:count]
        return data

    def drop_input(self) -> None:
        """Forget what has arrived."""
        while self.read():
            pass

    def close(self) -> None:
        """Let go; may be called twice."""
        self._port.close()

    def _wait(self, enough: Callable[[], bool], patience: float, what: str) -> None:
        heard = time.monotonic()
        while not enough():
            data = self.read()
            now = time.monotonic()
            if data:
                # `read` has emptied the buffer into `data`.
                self._buffer, heard = bytearray(data), now
            elif now - heard > patience:
                raise ConnectionLostError(
                    f"{self.name} did not send {what} within {patience:g} s; check that it is on and that the plan names its kind"
                )
