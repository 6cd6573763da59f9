"""Files with the channels of one run: which belong together, by their names."""

from __future__ import annotations

import re
from collections.abc import Hashable, Mapping, Sequence, Set
from pathlib import Path

#: Words of a file name that denote a channel, also with a number.
CHANNEL = re.compile(
    r"(?:ch|chan|channel|kanal|voie|sensor|ai|in|input|out|output|mic|acc|accel|acceleration|beschleunigung|vib|laser|disp|pos|vel|speed)"
    r"\d*|[xyz]",
    re.IGNORECASE,
)


def runs_of(
    paths: Sequence[Path], records: Sequence[Set[Hashable]], quantities: Sequence[str]
) -> Mapping[str, Mapping[str, int]]:
    """The runs of files with different channels: by run, the index of each file by its word. Empty if they are no such files.

    The names, with their folders, have as many words. One of these denotes the channels: it is a word for a channel, or contains
    one of those for `quantities`; or, if no word does, files with another word have none of the same `records`, the name and
    unit of each column.
    """
    if len(paths) < 2:
        return {}
    whole = [path.absolute().with_suffix("").parts for path in paths]
    common = next((k for k, parts in enumerate(zip(*whole, strict=False)) if len({*parts}) > 1), 0)
    names = [tuple(re.split(r"[\s_./-]+", "/".join(parts[common:]))) for parts in whole]
    if len({*map(len, names)}) > 1:
        return {}
    varied = [place for place, words in enumerate(zip(*names, strict=True)) if len({*words}) > 1]
    said = [place for place in varied if all(_denotes_channel(name[place], quantities) for name in names)]
    for place in said or varied:
        runs: dict[tuple[str, ...], dict[str, int]] = {}
        meant: dict[str, set[frozenset[Hashable]]] = {}
        for at, (name, record) in enumerate(zip(names, records, strict=True)):
            runs.setdefault((*name[:place], *name[place + 1 :]), {})[name[place]] = at
            meant.setdefault(name[place], set()).add(frozenset(record))
        one_each = sum(map(len, runs.values())) == len(paths) and all(len(each) == 1 for each in meant.values())
        sets = [record for (record, *_) in meant.values()]
        if one_each and (said or len(frozenset().union(*sets)) == sum(map(len, sets))):
            return {"_".join(rest) or "run": files for rest, files in runs.items()}
    return {}


def _denotes_channel(word: str, quantities: Sequence[str]) -> bool:
    return CHANNEL.fullmatch(word) is not None or any(each in word.lower() for each in quantities)
