"""The instruments there are: each file of this package that has a `KIND`, so adding one means adding its file."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Protocol

import msgspec

from isorig import drivers
from isorig.drivers.block import FloatArray
from isorig.drivers.instrument import Records, Stream
from isorig.drivers.shows import Shows

if TYPE_CHECKING:
    from isorig.drivers.simulated.faults import Faults
    from isorig.drivers.simulated.served import Peer


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a plan says of an instrument beside its kind, port and rate; each kind derives its own and checks it.

    A ValueError from `__post_init__` is told as it stands: what was found, what is allowed.
    """


class Shaken(Protocol):
    """A rig under a random drive of its own, as a simulated instrument measures it."""

    @property
    def names(self) -> tuple[str, ...]:
        """The channels, in the order of the instrument's inputs; the drive's comes first."""
        ...

    def channels(self, samples: int, rate: float) -> Mapping[str, FloatArray]:
        """Accelerations in m/s^2 by channel, each shape (samples,); `rate` in Hz."""
        ...

    def volts(self, samples: int, rate: float) -> FloatArray:
        """What the accelerometers put out at the inputs, V, shape (samples, inputs)."""
        ...

    def coherence(self, samples: int, rate: float) -> tuple[FloatArray, FloatArray]:
        """Frequency in Hz and coherence of the last channel with the drive, each shape (lines,)."""
        ...


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """What is asked of a far end.

    Parameters
    ----------
    speed
        Signal seconds per second.
    seconds
        Length of the signal, which is played again and again.
    faults
        What goes wrong; a far end refuses those that it does not have (`Faults.only`).
    """

    speed: float
    seconds: float
    faults: Faults


#: Makes an instrument's simulated far end with a rig behind it.
FarEnd = Callable[[Shaken, Simulation], "Peer"]


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
    far_end
        Makes its simulated far end, for `--port virtual` and `rig virtual instrument`; None where there is none.
    """

    name: str
    open: Callable[[str, Any], Stream]
    settings: type[Settings] = Settings
    far_end: FarEnd | None = None


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
    settings, far_end
        As of a stream.
    """

    name: str
    open: Callable[[str, Sequence[Shows]], Records]
    trace: tuple[str, str]
    settings: type[Settings] = Settings
    far_end: FarEnd | None = None


@cache
def kinds() -> Mapping[str, StreamKind | RecordsKind]:
    """Every kind by its name."""
    names = [module.name for module in pkgutil.iter_modules(drivers.__path__) if not module.ispkg]
    found = [getattr(importlib.import_module(f"isorig.drivers.{name}"), "KIND", None) for name in names]
    return {kind.name: kind for kind in found if kind is not None}
