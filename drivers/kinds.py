"""The instruments there are: each file of this package that has a `KIND`, so adding one means adding its file."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import msgspec

import drivers
from drivers.instrument import Records, Stream
from drivers.shows import Shows


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a plan says of an instrument beside its kind, port and rate; each kind derives its own and checks it.

    A ValueError from `__post_init__` is told as it stands: what was found, what is allowed.
    """


@dataclass(frozen=True, kw_only=True)
class StreamKind:
    """An instrument that streams.

    Parameters
    ----------
    name
        What plans call it.
    open
        Opens it at a port, under its settings.
    settings
        The settings that it has.
    """

    name: str
    open: Callable[[str, Any], Stream]
    settings: type[Settings] = Settings


@dataclass(frozen=True, kw_only=True)
class RecordsKind:
    """An instrument that hands out records.

    Parameters
    ----------
    name
        What plans call it.
    open
        Opens it at a port, told what its traces show.
    trace
        Pattern of its words for a trace, and an example of one.
    """

    name: str
    open: Callable[[str, Sequence[Shows]], Records]
    trace: tuple[str, str]
    settings: type[Settings] = Settings


@cache
def kinds() -> Mapping[str, StreamKind | RecordsKind]:
    """Every kind by its name."""
    names = [module.name for module in pkgutil.iter_modules(drivers.__path__) if not module.ispkg]
    found = [getattr(importlib.import_module(f"drivers.{name}"), "KIND", None) for name in names]
    return {kind.name: kind for kind in found if kind is not None}
