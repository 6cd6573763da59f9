"""Far ends of our own for wires: they share no code with the drivers nor with the simulators, and go wrong as they are told.

Bytes are made here from the descriptions of the protocols; samples tell the tick at which they were taken.
"""

from __future__ import annotations

import os
import select
import socket
import struct
import tempfile
import threading
import time
import tty
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np


class Far:
    """The instrument's end of a pseudo-terminal, in a thread; `heard` is all that came."""

    def __init__(self) -> None:
        self._own, self._other = os.openpty()
        tty.setraw(self._other)
        os.set_blocking(self._own, False)
        # A link that goes before the terminal does: its number is given to the next that is opened, in whichever process.
        self._folder = tempfile.TemporaryDirectory(prefix="far-")
        link = Path(self._folder.name) / "port"
        link.symlink_to(os.ttyname(self._other))
        self.port = str(link)
        self.heard = b""
        self.over = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> Far:
        self._thread.start()
        return self

    def __exit__(self, *ended: object) -> None:
        self.unplug()

    def unplug(self) -> None:
        """The terminal goes; a second call does nothing, for its descriptors may be somebody else's by then."""
        self.over.set()
        self._thread.join(5.0)
        self._folder.cleanup()
        ends, self._own, self._other = (self._own, self._other), -1, -1
        for end in ends:
            if end >= 0:
                os.close(end)

    def _serve(self) -> None:
        while not self.over.is_set():
            ready, _, _ = select.select([self._own], [], [], 0.002)
            data = b""
            if ready:
                with suppress(OSError):
                    data = os.read(self._own, 65536)
                if not data:
                    # The other end is closed.
                    time.sleep(0.002)
            self.heard += data
            if data:
                self.hear(data)
            self.work()

    def say(self, data: bytes) -> None:
        """Send, as fast as the other end takes it."""
        left = memoryview(data)
        while left and not self.over.is_set():
            _, ready, _ = select.select([], [self._own], [], 0.05)
            if ready:
                with suppress(OSError):
                    left = left[os.write(self._own, left) :]

    def hear(self, data: bytes) -> None:
        """Take what came."""

    def work(self) -> None:
        """Called again and again."""


class Tcp(Far):
    """The same at a TCP port of the loopback interface, for one connection: mixed in as the last class."""

    def __init__(self) -> None:
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.number = self._listening.getsockname()[1]
        self.port = f"socket://127.0.0.1:{self.number}"
        self.resource = f"TCPIP0::127.0.0.1::{self.number}::SOCKET"
        self._own, self._other = -1, -1
        self._folder = tempfile.TemporaryDirectory(prefix="far-")
        self.heard = b""
        self.over = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def _serve(self) -> None:
        while not self.over.is_set() and not select.select([self._listening], [], [], 0.002)[0]:
            pass
        if not self.over.is_set():
            link, _ = self._listening.accept()
            link.setblocking(False)
            self._own = link.detach()
            super()._serve()
        self._listening.close()


def text_frame(text: bytes) -> bytes:
    """An answer of the framed protocol."""
    return frame(text, kind=0, columns=1, rows=len(text), sequence=0, tick=0, clock=0, gain=0.0, status=0)


def frame(
    payload: bytes, *, kind: int, columns: int, rows: int, sequence: int, tick: int, clock: int, gain: float, status: int
) -> bytes:
    """A frame of the framed protocol, byte by byte as its page says."""
    head = (
        b"ISOR"
        + bytes([kind, columns])
        + struct.pack("<HIIIfI", rows, sequence % 2**32, tick % 2**32, clock % 2**32, gain, status)
    )
    return head + struct.pack("<I", zlib.crc32(head)) + payload + struct.pack("<I", zlib.crc32(payload))


class FramedFar(Far):
    """An instrument of the framed protocol with two inputs, the first of which counts the true ticks.

    Parameters
    ----------
    frames
        How many it sends after START; it counts their ticks.
    spoil
        Given the fields of each frame (see `Fields`), what is sent of it.
    answer
        Given a command's word, bytes that are sent instead of the right answer; None where it is answered rightly.
    rate, rows, speed
        Samples a second, of a frame, signal seconds per second.
    virtual
        Whether it says that it is simulated; by default where it is faster than real time.
    """

    def __init__(
        self, *, frames: int = 30, spoil: Callable[[dict], bytes] | None = None,
        answer: Callable[[str], bytes | None] = lambda word: None, rate: float = 1000.0, rows: int = 50, speed: float = 10.0,
        virtual: bool | None = None,
    ) -> None:  # fmt: skip
        super().__init__()
        self.frames, self.spoil, self.answer = frames, spoil or right, answer
        self.rate, self.rows, self.speed = rate, rows, speed
        self.name = "virtual far" if (speed > 1.0 if virtual is None else virtual) else "far"
        self.running = False
        self.sent = 0
        self.stopped = 0
        self._line = b""
        self._skip = 0
        self._began = 0.0

    def hear(self, data: bytes) -> None:
        """Commands."""
        self._line += data
        while True:
            if self._skip:
                taken = min(self._skip, len(self._line))
                self._line, self._skip = self._line[taken:], self._skip - taken
            if self._skip or b"\n" not in self._line:
                return
            line, _, self._line = self._line.partition(b"\n")
            words = line.decode("ascii", "replace").split()
            if not words:
                continue
            word = words[0].rstrip("?")
            if word == "DRIVE":
                self._skip = 4 * int(words[1]) + 4
            self.obey(word, words)

    def obey(self, word: str, words: list[str]) -> None:
        """Do it, and answer."""
        if word == "START" and not self.running:
            self.running, self.sent, self._began = True, 0, time.monotonic()
        if word == "STOP":
            self.stopped += self.running
            self.running = False
        told = {
            "ID": f"ID isorig-framed/1 {self.name}", "INPUTS": "INPUTS 2 int32 V 1e-3 100", "RATE": f"RATE {self.rate:g}",
            "START": "START 0", "STOP": f"COUNT {self.sent * self.rows}", "COUNT": f"COUNT {self.sent * self.rows}",
        }.get(word, " ".join(words))  # fmt: skip
        wrong = self.answer(word)
        self.say(text_frame(told.encode()) if wrong is None else wrong)

    def work(self) -> None:
        """The frames that are due."""
        while self.running and self.sent < self.frames and not self.over.is_set():
            due = (time.monotonic() - self._began) * self.speed * self.rate
            if (self.sent + 1) * self.rows > due:
                return
            tick = self.sent * self.rows
            true = np.arange(tick, tick + self.rows, dtype="<i4")
            fields = {
                "payload": np.stack([true, true * 3 + 1], axis=1).tobytes(), "kind": 2, "columns": 2, "rows": self.rows,
                "sequence": self.sent, "tick": tick, "clock": round(1e6 * tick / self.rate), "gain": 1.0, "status": 0,
            }  # fmt: skip
            self.sent += 1
            self.say(self.spoil(fields))


def right(fields: dict) -> bytes:
    """A frame as it should be."""
    return frame(**fields)


class LinesFar(Far):
    """Answers lines that end in LF by a table; an answer may be bytes or made from the line."""

    def __init__(self, answers: dict[str, bytes | Callable[[str], bytes]]) -> None:
        super().__init__()
        self.answers = answers
        self.lines: list[str] = []
        self._line = b""

    def hear(self, data: bytes) -> None:
        """Commands, matched by the longest beginning."""
        self._line += data
        while b"\n" in self._line:
            line, _, self._line = self._line.partition(b"\n")
            command = line.decode("ascii", "replace").strip()
            self.lines.append(command)
            fitting = [key for key in self.answers if command.startswith(key)]
            if fitting:
                answer = self.answers[max(fitting, key=len)]
                self.say(answer(command) if callable(answer) else answer)


class TcpLines(LinesFar, Tcp):
    """The same over TCP."""


class PrologixFar(LinesFar):
    """A Prologix adapter with an instrument at an address: what it answers is sent when it is read, as far as EOI.

    Parameters
    ----------
    answers
        As for `LinesFar`: those of the instrument.
    address
        Its GPIB address.
    status
        Gives its status byte.
    adapter
        Answers of the adapter that are sent instead of the right ones.
    """

    def __init__(
        self, answers: dict[str, bytes | Callable[[str], bytes]], *, address: int = 11, status: Callable[[], int] = lambda: 0,
        adapter: dict[str, bytes] | None = None,
    ) -> None:  # fmt: skip
        super().__init__(answers)
        self.address, self.status = address, status
        self.adapter = {"++ver": b"Prologix GPIB-USB Controller version 6.107\r\n"} | (adapter or {})
        self.commands: list[str] = []
        self.settings: dict[str, str] = {}
        self._answer = b""
        self._escaped = False
        self._command = b""

    def hear(self, data: bytes) -> None:
        """Commands of the adapter, and escaped ones of the instrument."""
        for byte in data:
            if self._escaped:
                self._command, self._escaped = self._command + bytes([byte]), False
            elif byte == 27:
                self._escaped = True
            elif byte in b"\r\n":
                line, self._command = self._command, b""
                self._take(line)
            else:
                self._command += bytes([byte])

    def _take(self, line: bytes) -> None:
        if not line.startswith(b"++"):
            if self.settings.get("addr") == str(self.address):
                self._answer = b""
                super().hear(line + b"\n")
            return
        command = line.decode()
        self.commands.append(command)
        word, _, value = command[2:].partition(" ")
        self.settings[word] = value
        if command in self.adapter:
            super().say(self.adapter[command])
        elif word == "read":
            answer, self._answer = self._answer, b""
            super().say(answer)
        elif word == "clr":
            self._answer = b""
        elif word == "spoll":
            super().say(b"%d\r\n" % (self.status() | 16 * bool(self._answer)))
        elif word == "srq":
            super().say(b"%d\r\n" % bool(self.status() & 32))

    def say(self, data: bytes) -> None:
        """An answer waits until it is read."""
        self._answer += data


class TcpPrologix(PrologixFar, Tcp):
    """The same over TCP, as GPIB-ETHERNET."""


class DataqFar(Far):
    """A DI-1100 whose first input counts scans in steps of 16, the second backwards; nothing is wired to its digital inputs.

    Parameters
    ----------
    stream
        Given the scans from one place up to another, the bytes that are sent for them.
    rate, speed, scans
        Scans a second, signal seconds per second, scans until it stops by itself.
    """

    def __init__(
        self, *, stream: Callable[[int, int], bytes] | None = None, rate: float = 2000.0, inputs: int = 2, scans: int = 10**9,
        clock: float = 1.0,
    ) -> None:  # fmt: skip
        super().__init__()
        self.rate, self.inputs, self.scans, self.clock = rate, inputs, scans, clock
        self.stream = stream or (lambda first, last: scan_bytes(first, last, inputs))
        self.scanning = False
        self.taken = 0
        self._line = b""
        self._began = 0.0

    def hear(self, data: bytes) -> None:
        """Commands, echoed while it does not scan."""
        self._line += data
        while b"\r" in self._line:
            line, _, self._line = self._line.partition(b"\r")
            command = line.decode("ascii", "replace").strip()
            if command == "start":
                self.scanning, self.taken, self._began = True, 0, time.monotonic()
            elif command == "stop":
                self.scanning = False
            if not self.scanning:
                self.say(line + b"\r")

    def work(self) -> None:
        """The scans that are due."""
        if not self.scanning:
            return
        due = min(int((time.monotonic() - self._began) * self.rate * self.clock), self.scans)
        if due - self.taken >= 10:
            self.say(self.stream(self.taken, due))
            self.taken = due

    @property
    def ended(self) -> bool:
        """Whether it has sent its last scans, ten or more at a time."""
        return self.scans - self.taken < 10


def scan_bytes(first: int, last: int, inputs: int = 2, digital: int = 3) -> bytes:
    """Scans of 12 bits: input k has the scan's number times 16 plus a third of the range for each k."""
    ticks = np.arange(first, last)[:, None]
    words = ((ticks + 1365 * np.arange(inputs)[None, :]) % 4096 * 16).astype(np.uint16)
    words[:, 0] |= digital
    return words.astype("<u2").tobytes()


def scan_number(samples: np.ndarray, near: np.ndarray) -> np.ndarray:
    """The scan that each row of samples was, nearest to a guess; -1 where its inputs do not belong together."""
    words = samples.astype(np.int64) // 16 % 4096
    own = (words[:, :1] - words[:, 1:]) % 4096
    whole = np.all(own == (-1365 * np.arange(1, samples.shape[1])) % 4096, axis=1)
    number = near + (words[:, 0] - near + 2048) % 4096 - 2048
    return np.where(whole, number, -1)


class SlcanFar(Far):
    """A serial CAN adapter with an MTi-600: x counts ticks modulo 30000, y how often that went round."""

    def __init__(
        self, *, spoil: Callable[[int, list[bytes]], bytes] | None = None, group: Callable[[int], tuple[int, int]] | None = None,
        rate: float = 400.0, speed: float = 10.0, groups: int = 10**9,
    ) -> None:  # fmt: skip
        super().__init__()
        self.rate, self.speed, self.groups = rate, speed, groups
        self.spoil = spoil or (lambda tick, frames: b"".join(frames))
        self.group = group or (lambda tick: (tick, round(1e6 * tick / rate)))
        self.sent = 0
        self._began: float | None = None
        self._line = b""

    def hear(self, data: bytes) -> None:
        """The adapter's commands."""
        self._line += data
        while b"\r" in self._line:
            line, _, self._line = self._line.partition(b"\r")
            if line == b"O" and self._began is None:
                self._began = time.monotonic()
            self.say(b"\r")

    def work(self) -> None:
        """The groups that are due."""
        if self._began is None:
            return
        due = min(int((time.monotonic() - self._began) * self.rate * self.speed), self.groups)
        while self.sent < due and not self.over.is_set():
            tick, self.sent = self.sent, self.sent + 1
            counter, clock = self.group(tick)
            told = [
                (0x006, struct.pack(">H", counter % 65536)), (0x005, struct.pack(">I", clock % 2**32)),
                (0x034, struct.pack(">hhh", tick % 30000, tick // 30000, tick % 7)), (0x011, bytes(4)),
            ]  # fmt: skip
            self.say(self.spoil(tick, [f"t{identifier:03X}{len(b)}{b.hex().upper()}\r".encode() for identifier, b in told]))


class CsvFar(Far):
    """A device that sends lines "count,milliseconds,tick,3 tick" between go and halt, all the time, or one for each READ?.

    Parameters
    ----------
    spoil
        Given a tick and its line without LF, the bytes that are sent.
    columns
        Given a tick, the words of its line.
    rate, speed, lines
        Lines a second, signal seconds per second, lines until it stops by itself.
    free
        Sends from the beginning, whatever it is told.
    asked
        Sends a line for each of these commands only.
    """

    def __init__(
        self, *, spoil: Callable[[int, bytes], bytes] = lambda tick, line: line + b"\n",
        columns: Callable[[int], list[str]] | None = None, rate: float = 100.0, speed: float = 10.0, lines: int = 10**9,
        free: bool = False, asked: str = "",
    ) -> None:  # fmt: skip
        super().__init__()
        self.spoil, self.rate, self.speed, self.lines, self.asked = spoil, rate, speed, lines, asked
        self.columns = columns or (lambda tick: [str(tick % 65536), str(round(1e3 * tick / rate)), str(tick), str(3 * tick)])
        self.sent = 0
        self.running = free
        self.free = free
        self.told: list[str] = []
        self._line = b""
        self._began = time.monotonic()

    def hear(self, data: bytes) -> None:
        """Commands."""
        self._line += data
        while b"\n" in self._line:
            line, _, self._line = self._line.partition(b"\n")
            command = line.decode("ascii", "replace").strip()
            self.told.append(command)
            if command == "go":
                self.running, self.sent, self._began = True, 0, time.monotonic()
            elif command == "halt":
                self.running = self.free
            elif self.asked and command == self.asked:
                self.send()

    def work(self) -> None:
        """The lines that are due."""
        while self.running and not self.asked and self.sent < self.lines and not self.over.is_set():
            if self.sent > (time.monotonic() - self._began) * self.speed * self.rate:
                return
            self.send()

    def send(self) -> None:
        """The next line."""
        tick, self.sent = self.sent, self.sent + 1
        self.say(self.spoil(tick, ",".join(self.columns(tick)).encode()))


#: How many times as long as on an idle computer the same may take on a busy one.
BUSY = 4.0


@contextmanager
def within(seconds: float) -> Iterator[None]:
    """Fails where the block takes longer than so many seconds of an idle computer."""
    began = time.monotonic()
    yield
    assert (took := time.monotonic() - began) < BUSY * seconds, f"it took {took:.1f} s"
