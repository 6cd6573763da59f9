"""Files with one channel each: which of them are of one run, by their names."""

from __future__ import annotations

import os
import re
from collections.abc import Hashable, Mapping, Sequence
from pathlib import Path

#: Words of a file name that denote a channel, also with a number.
CHANNEL = re.compile(
    r"(?:ch|chan|channel|kanal|voie|sensor|ai|in|input|mic|acc|accel|acceleration|beschleunigung|vib|laser|disp|pos|vel|speed)"
    r"\d*|[xyz]",
    re.IGNORECASE,
)


def runs_of(paths: Sequence[Path], records: Sequence[Hashable], quantities: Sequence[str]) -> Mapping[str, Mapping[str, int]]:
    """The runs of files with one channel each: by run, the index of the file of each channel. Empty if they are no such files.

    The names, with their folders, have as many words. One of these denotes the channel: it is a word for a channel, or contains
    one of those for `quantities`; or, if no word does, it is another one for each of the `records`, the name and unit of the
    column in a file.
    """
    if len(paths) < 2:
        return {}
    folder = os.path.commonpath([path.absolute().parent for path in paths])
    stems = [path.absolute().with_suffix("").relative_to(folder).as_posix() for path in paths]
    names = [tuple(re.split(r"[\s_./-]+", stem)) for stem in stems]
    if len({*map(len, names)}) > 1:
        return {}
    varied = [place for place, words in enumerate(zip(*names, strict=True)) if len({*words}) > 1]
    said = [place for place in varied if all(_denotes_channel(name[place], quantities) for name in names)]
    for place in said or varied:
        runs: dict[tuple[str, ...], dict[str, int]] = {}
        meant: dict[str, set[Hashable]] = {}
        for at, (name, record) in enumerate(zip(names, records, strict=True)):
            runs.setdefault((*name[:place], *name[place + 1 :]), {})[name[place]] = at
            meant.setdefault(name[place], set()).add(record)
        one_each = sum(map(len, runs.values())) == len(paths) and all(len(each) == 1 for each in meant.values())
        if one_each and (said or len(set().union(*meant.values())) == len(meant)):
            return {"_".join(rest) or "run": files for rest, files in runs.items()}
    return {}


def _denotes_channel(word: str, quantities: Sequence[str]) -> bool:
    return CHANNEL.fullmatch(word) is not None or any(each in word.lower() for each in quantities)
