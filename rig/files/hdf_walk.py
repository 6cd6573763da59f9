"""A process that walks through HDF5 files from others, so that what crashes or never ends there does not happen to the caller.

`hdf` starts it; it imports nothing of this package. A line of JSON on standard input names a kind and a file; another on
standard output answers, dots before it say that it goes on. Files of MATLAB's version 5 are read here for the same reason.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable
from typing import Any

import h5py
from h5py import h5a, h5d, h5i, h5l, h5o

#: Bytes that a file may declare for each byte that it has, beyond SPARE: what compresses further holds no measurement.
EXPANSION, SPARE = 100, 64 << 20
#: Bytes of a chunk, and of an attribute.
CHUNK_MOST, ATTRIBUTE_MOST = 64 << 20, 1 << 20
#: Links of a group, attributes of an object, links that lead to one object, objects of a file.
LINKS_MOST, ATTRIBUTES_MOST, REPEATS_MOST, OBJECTS_MOST = 20_000, 1000, 16, 200_000
#: Bytes that are read at once, and that the process may need beyond what it begins with.
STRIDE, MEMORY = 4 << 20, 4 << 30


class RefusedError(Exception):
    """What the file holds that no file may; one sentence but for the file's name."""


class Walk:
    """One file: every object that hard links lead to, its attributes, and its samples where they are stored in chunks."""

    def __init__(self, file: h5py.File, size: int) -> None:
        self._size = size
        self._declared = 0
        self._links: dict[int, int] = {}
        self._waiting: list[tuple[str, Any]] = [("/", file["/"].id)]

    def run(self) -> None:
        """Walk.

        Raises
        ------
        RefusedError
            At the first object that may not be.
        """
        while self._waiting:
            self._group(*self._waiting.pop())

    def _group(self, where: str, group: Any) -> None:
        self._attributes(where, group)
        links = group.links
        count = group.get_num_objs()
        if count > LINKS_MOST:
            raise RefusedError(f"{where!r} holds {count} objects; at most {LINKS_MOST} are read, so split the file")
        names: list[bytes] = []
        links.iterate(names.append)
        for name in names:
            here = where.rstrip("/") + "/" + name.decode("utf-8", "replace")
            kind = links.get_info(name).type
            if kind == h5l.TYPE_EXTERNAL:
                raise RefusedError(f"{here!r} is a link to another file; copy what it leads to into this one")
            if kind == h5l.TYPE_SOFT:
                # It ends inside this file, which holds no link that leads out, or nowhere.
                continue
            if kind != h5l.TYPE_HARD:
                raise RefusedError(f"{here!r} is a link of a kind of its own; copy what it leads to into this file")
            self._object(here, group, name)

    def _object(self, here: str, group: Any, name: bytes) -> None:
        item = h5o.open(group, name)
        address = h5o.get_info(item).addr
        self._links[address] = self._links.get(address, 0) + 1
        if self._links[address] > REPEATS_MOST:
            raise RefusedError(f"{here!r} is linked more than {REPEATS_MOST} times; write what was measured once for each run")
        if len(self._links) > OBJECTS_MOST:
            raise RefusedError(f"the file holds more than {OBJECTS_MOST} objects; split it")
        kind = h5i.get_type(item)
        if kind == h5i.GROUP:
            if self._links[address] == 1:
                self._waiting.append((here, item))
        elif kind == h5i.DATASET:
            self._dataset(here, item, again=self._links[address] > 1)

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
            _tried(lambda: values[attribute.name])  # noqa: B023
        _beat()

    def _dataset(self, here: str, dataset: Any, *, again: bool) -> None:
        if not again:
            self._attributes(here, dataset)
        plan, shape = dataset.get_create_plist(), dataset.shape or ()
        if plan.get_external_count():
            raise RefusedError(f"{here!r} is stored outside of the file; copy its values into the file")
        if plan.get_layout() == h5d.VIRTUAL:
            raise RefusedError(f"{here!r} is put together from other data; copy its values into the file")
        declared = math.prod(shape) * dataset.get_type().get_size()
        self._declared += declared
        if self._declared > EXPANSION * self._size + SPARE:
            raise RefusedError(
                f"{here!r} makes {self._declared >> 20} MiB that are declared in {self._size} bytes; at most {EXPANSION} times "
                "as much as is stored is read, so write the file anew without compression"
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
            raise RefusedError(f"{here!r} declares {wanted} chunks and {stored} are stored; copy the file again from its source")
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
            _tried(lambda: values[place])  # noqa: B023
            _beat()


def _tried(read: Callable[[], object]) -> None:
    # What cannot be read is told by whoever needs it; here it matters that it ends.
    try:
        read()
    except MemoryError:
        raise RefusedError(f"it needs more than {MEMORY >> 30} GiB to be read; write it anew without compression") from None
    except Exception:
        pass


def _beat() -> None:
    sys.stdout.write(".\n")
    sys.stdout.flush()


def answer(path: str) -> dict[str, str]:
    """What is to be said of a file: nothing, why it may not be read, or why it cannot be opened."""
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
        return {"refused": f"it needs more than {MEMORY >> 30} GiB to be read; write it anew without compression"}
    except Exception as error:
        return {"damaged": (str(error).splitlines() or [type(error).__name__])[0]}
    return {}


def answer_matlab(path: str) -> dict[str, str]:
    """What is to be said of a file of MATLAB's version 5: what is wrong with it otherwise is told by whoever reads it."""
    from scipy.io import loadmat

    try:
        _tried(lambda: loadmat(path, simplify_cells=True))
    except RefusedError as refused:
        return {"refused": str(refused)}
    return {}


def _limit() -> None:
    try:
        import resource
        from pathlib import Path

        begun = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (begun + MEMORY, begun + MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    except (ImportError, OSError, ValueError):
        # Not on this system: chunks and attributes are limited all the same.
        pass


def main() -> None:
    """Answer until standard input ends."""
    _limit()
    print(json.dumps({"ready": True}), flush=True)
    for line in sys.stdin:
        kind, path = json.loads(line)
        print(json.dumps(answer_matlab(path) if kind == "matlab" else answer(path)), flush=True)


if __name__ == "__main__":
    main()
