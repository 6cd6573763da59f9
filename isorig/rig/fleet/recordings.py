"""The recordings of a fleet: found in its folders, identified by content, and assigned to rigs."""

import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec

from isorig.analysis.parallel import cores
from isorig.rig.files.inputs import opened_regular

ENDING = ".h5"


class Recording(msgspec.Struct, frozen=True, kw_only=True):
    """A recording on disk."""

    #: Names of the rig, and of the file without its extension.
    rig: str
    campaign: str
    #: Its path, its size in bytes, and its modification time in ns.
    path: str
    size: int
    modified: int
    content: str = ""  #: SHA-256 of its bytes; empty until it is read.

    @property
    def stamp(self) -> tuple[str, int, int]:
        """Identifies an unchanged file without reading it."""
        return self.path, self.size, self.modified


def recordings_under(folders: Mapping[Path, str | None]) -> Iterator[Recording]:
    """Every recording in the folders and their subfolders, sorted by path, each once.

    The rig of a recording is the one given for the added folder, otherwise the name of the recording's folder. Hidden files and
    folders are ignored.
    """
    seen: set[Path] = set()
    for folder, rig in folders.items():
        for place, below, names in os.walk(folder):
            below[:] = sorted(name for name in below if not name.startswith("."))
            for name in sorted(names):
                path = Path(place) / name
                if not name.endswith(ENDING) or name.startswith(".") or path in seen:
                    continue
                seen.add(path)
                try:
                    stat = path.stat()
                except OSError:  # removed since the folder was listed
                    continue
                own = rig or path.parent.name
                yield Recording(rig=own, campaign=path.stem, path=str(path), size=stat.st_size, modified=stat.st_mtime_ns)


def identified(recordings: Iterable[Recording], known: Mapping[tuple[str, int, int], str]) -> list[Recording]:
    """The recordings with their content: the known one of an unchanged file, otherwise read. It is empty for unreadable files."""

    def one(recording: Recording) -> Recording:
        content = known.get(recording.stamp)
        if content is None:
            try:
                with opened_regular(Path(recording.path)) as stream:
                    content = hashlib.file_digest(stream, "sha256").hexdigest()
            except OSError:
                content = ""
        return msgspec.structs.replace(recording, content=content)

    with ThreadPoolExecutor(cores()) as pool:
        return list(pool.map(one, recordings))
