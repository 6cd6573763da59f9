"""A process that checks HDF5 files from other programs, so that crashes and endless loops do not affect the caller.

`hdf` forks or starts it; it imports nothing of this package. A JSON line on standard input names a kind, a file, and the seconds
of a processor within which progress is expected, after which the system ends this process; a JSON line on standard output is the
answer, preceded by dots that show progress. Files of MATLAB's version 5 are read here for the same reason.
"""

import json
import math
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import h5py
from h5py import h5a, h5d, h5i, h5l, h5o

#: Bytes that a file may declare per byte of its size, in addition to SPARE: data that compress further are not measurements.
EXPANSION, SPARE = 100, 64 << 20
#: Maximum size of a chunk, and of an attribute, bytes.
CHUNK_MOST, ATTRIBUTE_MOST = 64 << 20, 1 << 20
#: Maximum number of links in a group, attributes of an object, links to one object, objects in a file.
LINKS_MOST, ATTRIBUTES_MOST, REPEATS_MOST, OBJECTS_MOST = 20_000, 1000, 16, 200_000
#: Bytes read at once, and additional memory that the process may use.
STRIDE, MEMORY = 4 << 20, 4 << 30
TOO_LARGE = f"reading it needs more than {MEMORY >> 30} GiB; write it again without compression"
#: Read errors of the library where a filter is not installed: nothing was read, and the actual reader reports the channel.
NOT_INSTALLED = ("can't open directory", "is not registered")


#: Seconds of a processor for the next progress.
_patience = [math.inf]


class RefusedError(Exception):
    """Content that is not allowed; one sentence without the file's name."""


class Walk:
    """One file: all objects reached by hard links, their attributes, and their samples if stored in chunks."""

    def __init__(self, file: h5py.File, size: int) -> None:
        self._size = size
        self._declared = 0
        # Number of links to each object by its address, and the objects that hard links have reached.
        self._links: dict[int, int] = {}
        self._found: set[int] = set()
        self._waiting: list[tuple[str, Any]] = [("/", file["/"].id)]

    def run(self) -> None:
        """Check the file. Raises RefusedError at the first object that is not allowed."""
        while self._waiting:
            self._group(*self._waiting.pop())

    def _group(self, where: str, group: Any) -> None:
        self._attributes(where, group)
        links = group.links
        count = group.get_num_objs()
        if count > LINKS_MOST:
            raise RefusedError(f"{where!r} contains {count} objects; at most {LINKS_MOST} are read, so split the file")
        names: list[bytes] = []
        links.iterate(names.append)
        for name in names:
            here = where.rstrip("/") + "/" + name.decode("utf-8", "replace")
            if name.decode("utf-8", "ignore").encode() != name:
                raise RefusedError(f"the name {here!r} is not UTF-8; write the file again with names in UTF-8")
            kind = links.get_info(name).type
            if kind == h5l.TYPE_EXTERNAL:
                raise RefusedError(f"{here!r} is a link to another file; copy its target into this one")
            if kind == h5l.TYPE_SOFT:
                # It ends within this file, which has no external links, or nowhere; what it names is read once for each link.
                with suppress(KeyError):
                    self._linked(here, h5o.get_info(h5o.open(group, name)).addr)
                continue
            if kind != h5l.TYPE_HARD:
                raise RefusedError(f"{here!r} is a user-defined link; copy its target into this file")
            self._object(here, group, name)

    def _object(self, here: str, group: Any, name: bytes) -> None:
        item = h5o.open(group, name)
        address = h5o.get_info(item).addr
        again = address in self._found
        self._linked(here, address)
        self._found.add(address)
        if len(self._found) > OBJECTS_MOST:
            raise RefusedError(f"the file contains more than {OBJECTS_MOST} objects; split it")
        kind = h5i.get_type(item)
        if kind == h5i.GROUP:
            if not again:
                self._waiting.append((here, item))
        elif kind == h5i.DATASET:
            self._dataset(here, item, again=again)

    def _linked(self, here: str, address: int) -> None:
        self._links[address] = self._links.get(address, 0) + 1
        if self._links[address] > REPEATS_MOST:
            raise RefusedError(f"{here!r} is linked more than {REPEATS_MOST} times; write what was measured once for each run")

    def _attributes(self, where: str, item: Any) -> None:
        values = h5py.Dataset(item).attrs if isinstance(item, h5d.DatasetID) else h5py.Group(item).attrs
        count = h5a.get_num_attrs(item)
        if count > ATTRIBUTES_MOST:
            raise RefusedError(f"{where!r} has {count} attributes; at most {ATTRIBUTES_MOST} are read, so remove some")
        for k in range(count):
            attribute = h5a.open(item, index=k)
            declared = math.prod(attribute.shape) * max(attribute.get_type().get_size(), 1)
            if declared > ATTRIBUTE_MOST:
                name = attribute.name.decode("utf-8", "replace")
                raise RefusedError(f"{where!r} has an attribute {name!r} of {declared} bytes; at most {ATTRIBUTE_MOST} are read")
            _tried(lambda: values[attribute.name], where)  # noqa: B023
        _beat()

    def _dataset(self, here: str, dataset: Any, *, again: bool) -> None:
        if not again:
            self._attributes(here, dataset)
        plan, shape = dataset.get_create_plist(), dataset.shape or ()
        if plan.get_external_count():
            raise RefusedError(f"{here!r} is stored in another file; copy its values into this file")
        if plan.get_layout() == h5d.VIRTUAL:
            raise RefusedError(f"{here!r} is a virtual dataset; copy its values into the file")
        declared = math.prod(shape) * dataset.get_type().get_size()
        self._declared += declared
        if self._declared > EXPANSION * self._size + SPARE:
            raise RefusedError(
                f"{here!r} makes {self._declared >> 20} MiB that are declared in {self._size} bytes; at most {EXPANSION} times "
                "the stored size is read, so write the file again without compression"
            )
        if not declared:
            return
        if plan.get_layout() == h5d.CHUNKED:
            self._chunked(here, dataset, plan.get_chunk(), again=again)
        elif plan.get_layout() == h5d.CONTIGUOUS:
            offset = dataset.get_offset()
            if offset is None or offset + declared > self._size:
                raise RefusedError(f"{here!r} declares {declared} bytes that are not stored; copy the file again from its source")

    def _chunked(self, here: str, dataset: Any, chunk: tuple[int, ...], *, again: bool) -> None:
        shape, width = dataset.shape, dataset.get_type().get_size()
        size = math.prod(chunk) * width
        if size > CHUNK_MOST:
            raise RefusedError(
                f"{here!r} has chunks of {size >> 20} MiB; at most {CHUNK_MOST >> 20} are read, so write smaller ones"
            )
        wanted = math.prod(-(-n // c) for n, c in zip(shape, chunk, strict=True))
        stored = dataset.get_num_chunks()
        if stored != wanted:
            raise RefusedError(f"{here!r} declares {wanted} chunks but {stored} are stored; copy the file again from its source")
        if again:
            return
        values = h5py.Dataset(dataset)
        if values.dtype.hasobject:
            return
        if len(shape) == 1:
            rows = max(STRIDE // max(size, 1), 1) * chunk[0]
            places: Any = ((slice(start, start + rows),) for start in range(0, shape[0], rows))
        else:
            places = values.iter_chunks()
        for place in places:
            _tried(lambda: values[place], here)  # noqa: B023
            _beat()


def _tried(read: Callable[[], object], where: str) -> None:
    # What fails within the limits of this process may end the actual reader's process, which has none.
    try:
        read()
    except MemoryError:
        raise RefusedError(TOO_LARGE) from None
    except TypeError:
        # A type of values that h5py does not know.
        return
    except Exception as error:
        text = (str(error).splitlines() or [type(error).__name__])[0]
        if not any(missing in text for missing in NOT_INSTALLED):
            raise RefusedError(f"{where!r} cannot be read ({text}); copy the file again from its source") from None


def _beat() -> None:
    sys.stdout.write(".\n")
    sys.stdout.flush()
    _allow(_patience[0])


def _allow(seconds: float) -> None:
    # The system ends this process if it then has neither answered nor shown progress.
    try:
        import resource
    except ImportError:  # Windows: only the clock of the caller
        return
    _, most = resource.getrlimit(resource.RLIMIT_CPU)
    until = math.ceil(time.process_time() + seconds)
    resource.setrlimit(resource.RLIMIT_CPU, (until if most == resource.RLIM_INFINITY else min(until, most), most))


def answer(path: str) -> dict[str, str]:
    """The result for a file: empty, why it may not be read, or why it cannot be opened."""
    try:
        with open(path, "rb") as stream:  # noqa: PTH123
            size = stream.seek(0, 2)
        file = h5py.File(path, "r")
    except OSError as error:
        return {"closed": (str(error).splitlines() or [""])[0]}
    try:
        with file:
            Walk(file, size).run()
    except RefusedError as refused:
        return {"refused": str(refused)}
    except MemoryError:
        return {"refused": TOO_LARGE}
    except Exception as error:
        return {"damaged": (str(error).splitlines() or [type(error).__name__])[0]}
    return {}


def answer_matlab(path: str) -> dict[str, str]:
    """The result for a file of MATLAB's version 5: other faults are reported by the actual reader."""
    from scipy.io import loadmat

    _beat()
    try:
        loadmat(path, simplify_cells=True)
    except MemoryError:
        return {"refused": TOO_LARGE}
    except Exception:
        return {}
    return {}


def _limit() -> None:
    try:
        import resource
        from pathlib import Path

        begun = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (begun + MEMORY, begun + MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    except (ImportError, OSError, ValueError):
        # Not on this system: chunks and attributes are limited anyway.
        pass


def main() -> None:
    """Answer until standard input ends."""
    _limit()
    print(json.dumps({"ready": True}), flush=True)
    for line in sys.stdin:
        kind, path, _patience[0] = json.loads(line)
        _allow(_patience[0])
        print(json.dumps(answer_matlab(path) if kind == "matlab" else answer(path)), flush=True)


if __name__ == "__main__":
    main()
