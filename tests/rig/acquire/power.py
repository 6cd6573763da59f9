"""What a disk may hold after a power loss: every prefix of a working file, torn blocks, and writes between syncs in any order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from ramps import plan_of, ticks_of

from isorig.drivers.block import Block, Input
from isorig.rig.acquire.journal import Journal
from isorig.rig.acquire.recorder import RunWriter, recording_into
from isorig.rig.acquire.recover import working
from isorig.rig.cli import main
from isorig.rig.errors import RecordingError
from isorig.rig.files.recording import read

SECTOR, PAGE = 512, 4096
ROWS = 24


@dataclass
class Written:
    """A working file as it was written: its bytes, its length after each write, how much was synced by then, and what each holds.

    `held` has for each write of samples the run and the ticks that it holds.
    """

    content: bytes = b""
    ends: list[int] = field(default_factory=list)
    synced: list[int] = field(default_factory=list)
    held: dict[int, tuple[str, range]] = field(default_factory=dict)


def write_session(path: Path, seed: int, *, first: int = 0) -> Written:
    """Write three runs, the last one unfinished, with ticks lost and blocks doubled on the way; syncs come between the writes.

    Input k counts first + tick * 4 + k.
    """
    random = np.random.default_rng(seed)
    plan = plan_of(*({"id": name, "seconds": 2.0} for name in "abc"))
    inputs = [Input(unit="V", per_count=1.0, full_scale=None, dtype="int32")] * 4
    with recording_into(path, plan, inputs, sync=1e9) as file:
        told = Written(ends=[path.stat().st_size], synced=[path.stat().st_size])
        _watch(file.journal, told)
        for name in "abc":
            writer = RunWriter(file, name, period=None)
            tick = 0
            while tick < 2048 and not (name == "c" and tick > 1200):
                blocks = []
                for _ in range(random.integers(1, 5)):
                    if random.random() < 0.05:
                        tick += ROWS * int(random.integers(1, 4))
                    block = _block(tick, first)
                    blocks += [block] * (1 + int(random.random() < 0.1))
                    tick = block.end_tick
                # Straight into the writer: what belongs together does not depend on the clock.
                writer._store(blocks)
                if random.random() < 0.2:
                    file.journal.sync()
            writer.finish(None if name == "c" else tick + int(random.integers(0, 3)))
            if name == "c":
                # It never came to its end.
                told.ends.pop()
                told.synced.pop()
    told.content = path.read_bytes()[: told.ends[-1]]
    return told


def _block(tick: int, first: int) -> Block:
    ticks = np.arange(tick, tick + ROWS, dtype=np.int32)[:, None]
    return Block(first_tick=tick, samples=first + ticks * 4 + np.arange(4, dtype=np.int32), host_time=tick / 1024.0)


def _watch(journal: Journal, told: Written) -> None:
    append, sync = journal.append, journal.sync

    def appending(kind: int, run: int, take: int, content: bytes) -> None:
        append(kind, run, take, content)
        if kind == 3:
            first, rows = (int.from_bytes(content[a:b], "little") for a, b in ((0, 8), (8, 12)))
            told.held[len(told.ends)] = "abc"[run], range(first, first + rows)
        told.ends.append(journal._end)
        told.synced.append(told.synced[-1])

    def syncing() -> None:
        sync()
        told.synced[-1] = told.ends[-1]

    journal.append, journal.sync = appending, syncing  # type: ignore[method-assign]


@dataclass(frozen=True)
class Image:
    """What the disk holds, and how many of the writes were synced before the power went."""

    kind: str
    content: bytes
    safe: int


def images(told: Written, other: Written, random: np.random.Generator, count: int) -> Iterator[Image]:
    """So many images after a power loss (and of bits that flipped on the medium), of each kind as many."""
    kinds = [_prefix, _torn, _reordered, _stale, _flipped]
    for k in range(count):
        yield kinds[k % len(kinds)](told, other, random)


def _safe(told: Written, last: int) -> int:
    return int(np.searchsorted(told.ends, told.synced[last], side="right"))


def _prefix(told: Written, other: Written, random: np.random.Generator) -> Image:
    # The file ends anywhere; what was synced may be cut off, too, so nothing is taken for safe behind the cut.
    cut = int(random.integers(0, len(told.content) + 1))
    return Image("prefix", told.content[:cut], int(np.searchsorted(told.ends, cut, side="right")))


def _moment(told: Written, random: np.random.Generator) -> tuple[int, int, int]:
    last = int(random.integers(1, len(told.ends)))
    return last, told.synced[last], told.ends[last]


def _torn(told: Written, other: Written, random: np.random.Generator) -> Image:
    # All came but the last block, of which some sectors did.
    last, synced, end = _moment(told, random)
    return Image("torn", _mixed(told, max(synced, told.ends[last - 1]), end, SECTOR, random, b""), _safe(told, last))


def _reordered(told: Written, other: Written, random: np.random.Generator) -> Image:
    # Of all that was written since the last sync any pages may have come, or any sectors; the file may be shorter, too.
    last, synced, end = _moment(told, random)
    image = _mixed(told, synced, end, int(random.choice([SECTOR, PAGE])), random, b"")
    return Image(
        "reordered", image[: int(random.integers(synced, end + 1))] if random.random() < 0.3 else image, _safe(told, last)
    )


def _stale(told: Written, other: Written, random: np.random.Generator) -> Image:
    # Where nothing came the disk holds what was there before: noise, an older part of this file, or of another session's.
    last, synced, end = _moment(told, random)
    before = [random.bytes(1 << 14), told.content[: max(synced, 1)], other.content][int(random.integers(3))]
    # Other sessions' blocks at the very places where they once stood, or anything anywhere.
    shift = int(random.integers(0, len(before))) if random.random() < 0.5 else 0
    return Image("stale", _mixed(told, synced, end, SECTOR, random, before[shift:] + before[:shift]), _safe(told, last))


def _flipped(told: Written, other: Written, random: np.random.Generator) -> Image:
    content = bytearray(told.content)
    for _ in range(int(random.integers(1, 4))):
        content[int(random.integers(0, len(content)))] ^= 1 << int(random.integers(8))
    return Image("flipped", bytes(content), len(told.ends))


def _mixed(told: Written, start: int, end: int, unit: int, random: np.random.Generator, before: bytes) -> bytes:
    image = bytearray(told.content[:end])
    share = random.random()
    for sector in range(start // unit * unit, end, unit):
        if random.random() < share:
            # What was synced stands in this sector in either case.
            low, high = max(sector, start), min(sector + unit, end)
            place = low % len(before) if before else 0
            image[low:high] = before[place : place + high - low].ljust(high - low, b"\0") if before else bytes(high - low)
    return bytes(image)


def wrong(found: list[Any], ticks_of: Any) -> list[str]:
    """Runs whose values are not those that were sent at their ticks."""
    bad = []
    for item in found:
        if item.run is None:
            continue
        ticks = ticks_of(item.run)
        for k, channel in enumerate(item.run.channels.values()):
            if not np.array_equal(channel.samples[:], ticks * 4 + k):
                bad.append(f"{item.id}: {channel.name}")
    return bad


def missing(image: Image, told: Written, found: list[Any], ticks_of: Any) -> list[str]:
    """Writes that were synced and whose bytes are in the image as they were, and that are not among what was recovered."""
    there = {item.id: set(ticks_of(item.run).tolist()) for item in found if item.run is not None}
    gone = []
    for write in range(1, image.safe):
        begin, end = told.ends[write - 1], told.ends[write]
        if write in told.held and image.content[begin:end] == told.content[begin:end]:
            name, ticks = told.held[write]
            if not there.get(name, set()).issuperset(ticks):
                gone.append(f"{name}: {ticks}")
    return gone


def look_at(count: int, folder: Path, seed: int) -> Counter[str]:
    """Recover so many images; how many there were of each kind. An assertion fails where anything is wrong."""
    told, other = write_session(folder / "a.partial", seed), write_session(folder / "b.partial", seed, first=1 << 20)
    seen: Counter[str] = Counter()
    path = folder / "image.partial"
    for k, image in enumerate(images(told, other, np.random.default_rng(seed), count)):
        path.write_bytes(image.content)
        seen[image.kind] += 1
        try:
            with working(path) as (_, found):
                assert not wrong(found, ticks_of), (k, image.kind)
                assert not missing(image, told, found, ticks_of), (k, image.kind)
                assert all(item.stored + item.lost == ticks_of(item.run)[-1] + 1 for item in found if not_ended(item))
                saved = sum(item.stored for item in found)
        except RecordingError:
            # Nothing was safe: not even the first block, and no run's beginning, is whole.
            assert image.safe < 1, (k, image.kind)
            seen["without an answer"] += 1
            continue
        if k % 40 == 0 and saved:
            assert main(["recover", str(path), "-o", str(folder / "saved.h5")]) == 0
            campaign = read(folder / "saved.h5")
            assert sum(len(run) for run in campaign.runs) == saved
            for run in campaign.runs:
                np.testing.assert_array_equal(run.channels["table"].samples, ticks_of(run) * 4 + 2)
    return seen


def not_ended(item: object) -> bool:
    run = getattr(item, "run", None)
    return run is not None and not any(gap.first_tick >= ticks_of(run)[-1] + 1 for gap in run.gaps)
