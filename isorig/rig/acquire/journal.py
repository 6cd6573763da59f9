"""An append-only log of checksummed blocks: the state after a killed writer or a power loss can be distinguished from damage.

Each block contains its offset, its number and the identifier of its file, with a checksum; a second checksum covers its content.
A reader accepts a block only if both are correct, continues after a damaged one, and knows from the numbers how many are missing.
"""

import os
import shutil
import struct
import threading
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from isorig.rig.errors import OutputError, RecordingError
from isorig.rig.files.output import reason

#: First bytes of each block, and therefore of the file.
MARK = b"\xabIJ1"
#: Mark, kind, run, take, number, length of the content, file, offset of the block; then the checksum of these.
HEADER = struct.Struct("<4sHHIIIIQ")
CHECKSUM = struct.Struct("<I")
HEAD = HEADER.size + CHECKSUM.size
#: Maximum size of a block in bytes: a reader never allocates more.
LONGEST = 16 << 20
#: Bytes read at once while searching for a mark.
STRIDE = 1 << 20
#: Seconds between two syncs: the maximum loss in a power failure.
SYNC = 1.0

_sync_data = getattr(os, "fdatasync", os.fsync)


@dataclass(frozen=True, slots=True)
class JournalBlock:
    """A valid block: its header, and the offset of its content."""

    kind: int
    run: int
    take: int
    number: int
    place: int
    content: bytes


def _block(file: int, offset: int, number: int, kind: int, run: int, take: int, content: bytes) -> bytes:
    head = HEADER.pack(MARK, kind, run, take, number, len(content), file, offset)
    checksum = zlib.crc32(head)
    # The content's checksum continues that of the header, so a content is never accepted with another header.
    return b"".join((head, CHECKSUM.pack(checksum), content, CHECKSUM.pack(zlib.crc32(content, checksum))))


class Journal:
    """Appends blocks to a file made by `create`, and syncs it to disk (fsync) at intervals in seconds from a separate thread.

    With an interval of 0 every block is synced before `append` returns. Raises OutputError if the file cannot be opened.
    """

    def __init__(self, path: Path, *, sync: float) -> None:
        try:
            self._file: BinaryIO = path.open("r+b", buffering=0)
        except OSError as error:
            raise OutputError(f"{path} cannot be written ({reason(error)}); choose another place with -o") from None
        self.path = path
        self._end = self._file.seek(0, os.SEEK_END)
        self._file.seek(0)
        self._number, self._id = 1, HEADER.unpack(self._file.read(HEADER.size))[6]
        self._every, self._dirty = sync, False
        self._failed: OSError | None = None
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        if sync > 0.0:
            self._thread = threading.Thread(target=self._keep_synced, name="sync", daemon=True)
            self._thread.start()

    @staticmethod
    def create(path: Path, kind: int, content: bytes) -> None:
        """Create a file with its first block, synced to disk; the path must be free or replaceable."""
        with path.open("wb") as file:
            file.write(_block(int.from_bytes(os.urandom(4), "little"), 0, 0, kind, 0, 0, content))
            file.flush()
            os.fsync(file.fileno())

    def append(self, kind: int, run: int, take: int, content: bytes) -> None:
        """Append a block. Raises OSError if the disk refuses, or an earlier sync failed; the file then ends with its last
        complete block."""
        if self._failed is not None:
            raise self._failed
        block = memoryview(_block(self._id, self._end, self._number, kind, run, take, content))
        written = 0
        try:
            self._file.seek(self._end)
            while written < len(block):
                written += self._file.write(block[written:])
        except OSError:
            self._file.truncate(self._end)
            raise
        self._end += len(block)
        self._number += 1
        self._dirty = True
        if self._every == 0.0:
            self.sync()

    def sync(self) -> None:
        """Return when all appended data are synced to disk."""
        self._dirty = False
        _sync_data(self._file.fileno())

    def put_back(self) -> bool:
        """Write the file again if its name was removed or replaced; returns whether that was so. Raises OSError if it cannot be
        written again."""
        ours = os.fstat(self._file.fileno())
        try:
            there = self.path.stat()
        except FileNotFoundError:
            there = None
        if there is not None:
            if (there.st_dev, there.st_ino) == (ours.st_dev, ours.st_ino):
                return False
            self.path = self.path.with_name(f"{self.path.name}.saved")
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("xb") as copy:
            self._file.seek(0)
            shutil.copyfileobj(self._file, copy, STRIDE)
            copy.flush()
            os.fsync(copy.fileno())
        return True

    def close(self) -> None:
        """Sync and close the file."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join()
        try:
            if self._failed is None:
                self.sync()
        finally:
            self._file.close()

    def _keep_synced(self) -> None:
        while not self._closing.wait(self._every):
            if self._dirty:
                try:
                    self.sync()
                except OSError as error:
                    self._failed = error
                    return


class Reader:
    """Returns the complete blocks of a log, also of one that is still being written. Raises RecordingError if the file does not
    exist, or is not a log."""

    def __init__(self, path: Path) -> None:
        try:
            # Anything but a regular file (a pipe, for example) might block forever.
            if not path.is_file():
                raise RecordingError(
                    f"{path} {'is not a file' if path.exists() else 'does not exist'}; give a session's working file (its name "
                    "ends in .partial)"
                )
            self._file: BinaryIO = path.open("rb", buffering=0)
        except OSError as error:
            raise RecordingError(f"{path} cannot be read ({reason(error)}); change its permissions or copy it") from None
        self.path = path
        self._lock = threading.Lock()
        self._next = 0
        self._id: int | None = None

    def replaced(self) -> bool:
        """Whether the file's name now belongs to another file, or to none."""
        try:
            there, ours = self.path.stat(), os.fstat(self._file.fileno())
        except OSError:
            return True
        return (there.st_dev, there.st_ino) != (ours.st_dev, ours.st_ino)

    def read(self, place: int, count: int) -> bytes:
        """Bytes of the file; may be called from several threads. Raises RecordingError if the file has become shorter."""
        with self._lock:
            self._file.seek(place)
            parts, left = [], count
            while left > 0 and (part := self._file.read(left)):
                parts.append(part)
                left -= len(part)
        if left:
            raise RecordingError(f"{self.path} became shorter while it was read; copy it again from its source")
        return parts[0] if len(parts) == 1 else b"".join(parts)

    def rewind(self) -> None:
        """Return all blocks again from the start."""
        self._next = 0

    def blocks(self) -> Iterator[JournalBlock]:
        """The complete blocks after those already returned, in the order of the file."""
        while (head := self._head()) is not None:
            kind, run, take, number, length, checksum = head
            place = self._next + HEAD
            if place + length + CHECKSUM.size > self._size():
                # It is being written, or was when the writer ended.
                return
            content = self.read(place, length)
            self._next = place + length + CHECKSUM.size
            if CHECKSUM.unpack(self.read(place + length, CHECKSUM.size))[0] == zlib.crc32(content, checksum):
                yield JournalBlock(kind, run, take, number, place, content)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _size(self) -> int:
        return os.fstat(self._file.fileno()).st_size

    def _head(self) -> tuple[int, int, int, int, int, int] | None:
        # The next valid header at its stated offset; None if there is none yet.
        while (size := self._size()) >= self._next + HEAD:
            raw = self.read(self._next, HEAD)
            mark, kind, run, take, number, length, file, offset = HEADER.unpack_from(raw)
            checksum = zlib.crc32(raw[: HEADER.size])
            sound = mark == MARK and offset == self._next and CHECKSUM.unpack_from(raw, HEADER.size)[0] == checksum
            if sound and length <= LONGEST and self._id in (None, file):
                self._id = file
                return kind, run, take, number, length, checksum
            found = self._mark(self._next + 1, size)
            if found is None:
                # A mark may cross the end of the available data.
                self._next = max(size - len(MARK) + 1, self._next)
                return None
            self._next = found
        return None

    def _mark(self, start: int, size: int) -> int | None:
        while start + len(MARK) <= size:
            stretch = self.read(start, min(STRIDE, size - start))
            at = stretch.find(MARK)
            if at >= 0:
                return start + at
            start += len(stretch) - len(MARK) + 1
        return None
