"""Simulated hours of a fleet that watches a folder, in which files arrive half written, are renamed, deleted and restored.

    python tests/attack/fleet_day.py HOURS SEED

The waiting time between two readings of the folder is simulated: something happens in it instead. In the end every file in the
folder must have one answer, that of its content. Prints one line; exit status 1 if one lacks it, or if anything failed.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "rig"))

from fuzzing import campaign

from isorig.rig.files.recording import write
from isorig.rig.fleet import update as watching
from isorig.rig.fleet.catalogue import Catalogue

#: Simulated seconds between two readings, and probability that something happens between two.
EVERY, BUSY = 10.0, 0.05
#: Simulated seconds without events at the end, so that the last files settle.
QUIET = 100.0


class Day:
    """The simulated clock and the people who use the folder: `sleep` lets time pass and something happen."""

    def __init__(self, folder: Path, seconds: float, seed: int) -> None:
        self.folder, self.now, self._end = folder, 0.0, seconds
        self._random = np.random.default_rng(seed)
        self._half: dict[Path, bytes] = {}
        self._removed: list[tuple[Path, bytes]] = []
        self.happened: Counter[str] = Counter()
        write(folder.parent / "sound.h5", campaign())
        self._sound = (folder.parent / "sound.h5").read_bytes()
        self._made = 0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        for path in list(self._half):
            # The rest of a file arrives in parts, some of them late.
            if self._random.random() < 0.5 or self.now > self._end - QUIET:
                self._grow(path)
        if self.now < self._end - QUIET and self._random.random() < BUSY:
            name = str(self._random.choice(["arrive", "copy", "rename", "delete", "restore", "replace", "damage", "pipe"]))
            getattr(self, f"_{name}")()

    def _content(self) -> bytes:
        # A file of its own: HDF5 permits bytes after its end.
        self._made += 1
        return self._sound + self._made.to_bytes(8, "little")

    def _place(self) -> Path:
        rig = self.folder / f"rig-{self._random.integers(4)}"
        rig.mkdir(exist_ok=True)
        return rig / f"w{self._made:05d}.h5"

    def _any(self) -> Path | None:
        files = sorted(path for path in self.folder.rglob("*.h5") if path.is_file() and path not in self._half)
        return files[int(self._random.integers(len(files)))] if files else None

    def _arrive(self) -> None:
        content = self._content()
        self._place().write_bytes(content)
        self.happened["arrived"] += 1

    def _half_of(self, path: Path, content: bytes) -> None:
        at = int(self._random.integers(0, len(content)))
        path.write_bytes(content[:at])
        self._half[path] = content

    def _grow(self, path: Path) -> None:
        content = self._half[path]
        size = path.stat().st_size + 1 + int(self._random.integers(0, len(content)))
        with path.open("ab") as file:
            file.write(content[path.stat().st_size : size])
        if size >= len(content):
            del self._half[path]

    def _copy(self) -> None:
        content = self._content()
        self._half_of(self._place(), content)
        self.happened["half written"] += 1

    def _rename(self) -> None:
        path = self._any()
        if path is not None:
            target = self._place().with_name(f"renamed-{self._made}-{path.name}")
            self._made += 1
            path.rename(target)
            self.happened["renamed"] += 1

    def _delete(self) -> None:
        path = self._any()
        if path is not None:
            self._removed.append((path, path.read_bytes()))
            path.unlink()
            self.happened["deleted"] += 1

    def _restore(self) -> None:
        if self._removed:
            path, content = self._removed.pop(int(self._random.integers(len(self._removed))))
            if not path.exists():
                self._half_of(path, content)
                self.happened["restored"] += 1

    def _replace(self) -> None:
        path = self._any()
        if path is not None:
            other = path.with_name(f".{path.name}")
            other.write_bytes(self._content())
            other.replace(path)
            self.happened["replaced"] += 1

    def _damage(self) -> None:
        path = self._place()
        self._made += 1
        content = bytearray(self._content())
        for at in self._random.integers(0, len(content), 40):
            content[at] ^= 1 << int(self._random.integers(8))
        path.write_bytes(bytes(content))
        self.happened["damaged"] += 1

    def _pipe(self) -> None:
        path = self._place().with_name(f"pipe-{self._made}.h5")
        self._made += 1
        if self._random.random() < 0.5:
            os.mkfifo(path)
        else:
            path.symlink_to("/dev/zero")
        self.happened["pipes and devices"] += 1


def main(hours: float, seed: int) -> int:
    """Watch the folder; 1 if a file lacks its answer, or anything failed."""
    with tempfile.TemporaryDirectory(prefix="fleet-") as place:
        folder = Path(place) / "measurements"
        folder.mkdir()
        seconds = 3600.0 * hours
        day, told = Day(folder, seconds, seed), list[str]()
        watching.time = SimpleNamespace(monotonic=day.monotonic, sleep=day.sleep)  # type: ignore[assignment]
        catalogue = Catalogue(Path(place) / "catalogue")
        catalogue.add_folder(folder, None)
        watching.watch(catalogue, {folder: None}, "linear", limit=1.0, every=EVERY, seconds=seconds, tell=told.append)
        answers = catalogue.answers()
        of = answers[answers.verdict != "superseded"].groupby("content").path.first().to_dict()
        files = sorted(path for path in folder.rglob("*.h5") if path.is_file())
        contents = {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
        lacking = [path for path, content in contents.items() if content not in of]
        failed = [line for line in told if "the program failed" in line]
        events = ", ".join(f"{count} {name}" for name, count in sorted(day.happened.items()))
        print(
            f"{hours:g} simulated hours of a watched folder, {round(seconds / EVERY)} readings ({events}): {len(files)} files at "
            f"the end, {len(lacking)} of them without the answer of their content, {len(of)} answers, {len(failed)} failures of "
            "the program."
        )
        print(*lacking, *failed, sep="\n", file=sys.stderr, end="")
        return int(bool(lacking or failed))


if __name__ == "__main__":
    sys.exit(main(float(sys.argv[1]), int(sys.argv[2])))
