"""Processor time of other programs: of processes that this one has not started, neither itself nor through others.

Each process is counted, so that children of a benchmark are its own also while they run, and after their parents have ended.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import psutil

#: A process: its number and the time of its start.
Key = tuple[int, float]
#: The process that inherits those whose parent has ended, and waits for them, own ones among them.
INIT = 1


@dataclass(frozen=True, kw_only=True)
class Process:
    """A process at one moment.

    Parameters
    ----------
    parent
        Number of the process that started it, or that has inherited it.
    own, children
        Its user time, and that of its children that have ended and that it has waited for, in s.
    name
        Its command.
    """

    parent: int
    own: float
    children: float
    name: str = ""


def processes() -> dict[Key, Process]:
    """All processes whose times may be read."""
    found = {}
    for each in psutil.process_iter():
        try:
            with each.oneshot():
                times = each.cpu_times()
                key = each.pid, each.create_time()
                found[key] = Process(parent=each.ppid(), own=times.user, children=times.children_user, name=each.name())
        except psutil.Error:
            # It has ended, or belongs to another user of a system that hides its times.
            continue
    return found


def started_by(root: int, now: Mapping[Key, Process], known: Collection[Key] = ()) -> set[Key]:
    """A process, and those that it has started, also through others; `known` remain its own after their parents have ended."""
    children: dict[int, list[Key]] = {}
    for key, each in now.items():
        children.setdefault(each.parent, []).append(key)
    waiting = [key for key in now if key[0] == root or key in known]
    found: set[Key] = set()
    while waiting:
        key = waiting.pop()
        if key not in found:
            found.add(key)
            waiting += children.get(key[0], [])
    return found


def used_between(before: Mapping[Key, Process], now: Mapping[Key, Process]) -> dict[Key, float]:
    """User time of each process between two moments in s, with that of its children that came and ended meanwhile."""
    # What has ended, by the nearest process above it that has not: it counts the time of those that it has waited for.
    parents = {key[0]: each.parent for key, each in before.items() if key not in now}
    ended: dict[int, float] = {}
    for key in before.keys() - now.keys():
        above = before[key].parent
        while above in parents:
            above = parents[above]
        ended[above] = ended.get(above, 0.0) + before[key].own + before[key].children
    used = {}
    for key, each in now.items():
        earlier = before.get(key, Process(parent=each.parent, own=0.0, children=0.0))
        # A child that has ended brings what it had used before as well.
        meanwhile = each.children - earlier.children - ended.get(key[0], 0.0) if key[0] != INIT else 0.0
        used[key] = each.own - earlier.own + max(meanwhile, 0.0)
    return used


class OtherPrograms:
    """User time that other programs use from now on.

    Parameters
    ----------
    hypervisor
        Whether the time counts that a hypervisor gives to other computers: it does not change measured processor time.
    """

    def __init__(self, *, hypervisor: bool = True) -> None:
        self._hypervisor = hypervisor
        self._last, self._taken = processes(), _taken()
        self._own = started_by(os.getpid(), self._last)
        #: Seconds by name.
        self.used: dict[str, float] = {}

    def look(self) -> float:
        """Seconds of a processor so far; to be called every few seconds, because what ends meanwhile may not be seen."""
        now, taken = processes(), _taken()
        self._own = started_by(os.getpid(), now, self._own)
        used = [(now[key].name, seconds) for key, seconds in used_between(self._last, now).items() if key not in self._own]
        for name, seconds in [*used, *([("a hypervisor", taken - self._taken)] if self._hypervisor else [])]:
            self.used[name] = self.used.get(name, 0.0) + seconds
        self._last, self._taken = now, taken
        return sum(self.used.values())

    def is_own(self, number: int) -> bool:
        """Whether a process belonged to this program at the last look."""
        return any(key[0] == number for key in self._own)

    @property
    def most(self) -> str:
        """The name of the program that has used most."""
        return max(self.used, key=lambda name: self.used[name], default="none")


def _taken() -> float:
    return float(getattr(psutil.cpu_times(), "steal", 0.0))
