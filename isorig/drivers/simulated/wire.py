"""Connections between a simulated instrument and a driver."""

from __future__ import annotations

import os
import select
import sys
import tempfile
from pathlib import Path

from isorig.drivers.errors import SettingError


class PtyWire:
    """The instrument's end of a pseudo-terminal; `port` is a link to the other end, which pyserial opens.

    The system gives the number of a closed pseudo-terminal to the next one that is opened. The link goes first, so a driver that
    opens its port again after an unplug never reaches somebody else's terminal.
    """

    def __init__(self) -> None:
        if sys.platform == "win32":
            raise SettingError("Windows has no pseudo-terminals; run the simulated instrument on Linux or macOS")
        import pty
        import tty

        self._own, self._other = pty.openpty()
        tty.setraw(self._other)
        os.set_blocking(self._own, False)
        self._folder = tempfile.TemporaryDirectory(prefix="rig-pty-")
        link = Path(self._folder.name) / "port"
        link.symlink_to(os.ttyname(self._other))
        self.port = str(link)

    def read(self, timeout: float) -> bytes:
        """Bytes that arrived within `timeout` seconds, or empty."""
        try:
            return os.read(self._own, 65536) if select.select([self._own], [], [], timeout)[0] else b""
        except (OSError, ValueError):
            return b""

    def write(self, data: bytes, timeout: float) -> int:
        """Send what fits within `timeout` seconds; returns the number of bytes sent."""
        try:
            return os.write(self._own, data) if select.select([], [self._own], [], timeout)[1] else 0
        except (OSError, ValueError):
            return 0

    def close(self) -> None:
        """Disconnect."""
        self._folder.cleanup()
        for end in (self._own, self._other):
            if end >= 0:
                os.close(end)
        self._own = self._other = -1
