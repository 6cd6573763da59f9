"""Wires between a simulated instrument and a driver."""

from __future__ import annotations

import os
import select
import sys
from typing import Protocol

from isorig.drivers.errors import SettingError


class Wire(Protocol):
    """Where bytes go and come from."""

    def read(self, timeout: float) -> bytes:
        """What arrived within `timeout` seconds."""
        ...

    def write(self, data: bytes, timeout: float) -> int:
        """Send what fits within `timeout` seconds; the number of bytes taken."""
        ...

    def close(self) -> None:
        """Unplug."""
        ...


class PtyWire:
    """The instrument's end of a pseudo-terminal; `port` is the path of the other end, which pyserial opens."""

    def __init__(self) -> None:
        if sys.platform == "win32":
            raise SettingError("there are no pseudo-terminals on Windows; run the simulated instrument on Linux or macOS")
        import pty
        import tty

        self._own, self._other = pty.openpty()
        tty.setraw(self._other)
        os.set_blocking(self._own, False)
        self.port = os.ttyname(self._other)

    def read(self, timeout: float) -> bytes:
        """What arrived within `timeout` seconds, empty where nothing did."""
        try:
            ready, _, _ = select.select([self._own], [], [], timeout)
            if not ready:
                return b""
            return os.read(self._own, 65536)
        except (OSError, ValueError):
            return b""

    def write(self, data: bytes, timeout: float) -> int:
        """Send what fits within `timeout` seconds; the number of bytes taken."""
        try:
            _, ready, _ = select.select([], [self._own], [], timeout)
            if not ready:
                return 0
            return os.write(self._own, data)
        except (OSError, ValueError):
            return 0

    def close(self) -> None:
        """Unplug."""
        for end in (self._own, self._other):
            if end >= 0:
                os.close(end)
        self._own = self._other = -1
