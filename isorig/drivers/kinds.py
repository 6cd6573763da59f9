"""The available instruments: each file of this package with a `KIND`, so adding an instrument means adding its file."""

import importlib
import pkgutil
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Literal, Protocol

import msgspec

from isorig import drivers
from isorig.drivers.block import FloatArray
from isorig.drivers.instrument import Records, Stream
from isorig.drivers.simulated.commanded import Simulation
from isorig.drivers.simulated.framed import Plant
from isorig.drivers.simulated.served import Peer
from isorig.drivers.waits import Waits


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The settings of an instrument in a plan other than kind, port and rate; each kind derives its own class and validates it.

    A ValueError from `__post_init__` is shown unchanged: what was found, what is allowed.
    """


class DrivenRig(Plant, Protocol):
    """A rig, as measured by a simulated instrument: under the drive that this plays, or under a random one."""

    @property
    def names(self) -> tuple[str, ...]:
        """The channels, in the order of the instrument's inputs; the drive is the first."""

    def channels(self, samples: int, rate: float) -> Mapping[str, FloatArray]:
        """Accelerations in m/s^2 by channel, each shape (samples,); `rate` in Hz."""

    def volts(self, samples: int, rate: float) -> FloatArray:
        """Voltages of the accelerometers at the inputs, V, shape (samples, inputs)."""

    def coherence(self, samples: int, rate: float) -> tuple[FloatArray, FloatArray]:
        """Frequency in Hz and coherence of the last channel with the drive, each shape (bins,)."""


#: Longest name of a device that is printed.
NAME = 80
#: How an instrument is connected.
Bus = Literal["serial", "visa", "can", "ni", "sound"]
#: Channels of the examples of instruments that measure voltages, with those of the simulated rig.
CHANNELS = """
[channels.head]
input = 0
sensitivity = 0.2
[channels.motor]
input = 3
sensitivity = 0.2
"""
#: Creates the simulated counterpart of an instrument, connected to a rig.
FarEnd = Callable[[DrivenRig, Simulation], Peer]


@dataclass(frozen=True, kw_only=True)
class InstrumentKind:
    """A kind of instrument."""

    name: str  #: Its name in plans.
    example: str = ""  #: Example of its entries in a plan, TOML: the rest of the table `instrument`, and the channels.
    settings: type[Settings] = Settings  #: The class of its settings.
    #: Creates its simulated counterpart, for `--port virtual` and `rig virtual instrument`; None if there is none.
    far_end: FarEnd | None = None
    buses: tuple[Bus, ...] = ("serial",)  #: How it is connected.
    #: Pattern of its name or its USB number in the system's list of devices; empty if it has none of its own.
    recognized: str = ""


@dataclass(frozen=True, kw_only=True)
class StreamKind(InstrumentKind):
    """An instrument that streams samples: `open` at a port, with its settings and timeouts; whether it `plays` a drive."""

    open: Callable[[str, Any, Waits], Stream]
    plays: bool = False


@dataclass(frozen=True, kw_only=True)
class RecordsKind(InstrumentKind):
    """An instrument that returns records: `open` at a port, with the names of its traces and timeouts.

    `trace` is the pattern of the traces' names, and an example.
    """

    open: Callable[[str, Sequence[str], Waits], Records]
    trace: tuple[str, str]
    buses: tuple[Bus, ...] = ("serial", "visa")


@cache
def kinds() -> Mapping[str, StreamKind | RecordsKind]:
    """All kinds by name."""
    names = [module.name for module in pkgutil.iter_modules(drivers.__path__) if not module.ispkg]
    found = [getattr(importlib.import_module(f"isorig.drivers.{name}"), "KIND", None) for name in names]
    return {kind.name: kind for kind in found if kind is not None}


@dataclass(frozen=True, kw_only=True)
class Connected:
    """Something connected: its port in plans, its description by the system, and settings of a plan that it determines."""

    bus: Bus
    port: str
    name: str
    settings: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        shown = "".join(letter for letter in " ".join(self.name.split()) if letter.isprintable())
        object.__setattr__(self, "name", shown[:NAME])

    @property
    def recognized(self) -> tuple[str, ...]:
        """The kinds of instruments whose name or USB number its description contains."""
        return tuple(
            kind.name
            for kind in self._possible()
            if kind.recognized and re.search(kind.recognized, f"{self.name} {self.port}", re.IGNORECASE)
        )

    @property
    def possible(self) -> tuple[str, ...]:
        """The kinds of instruments that are reached in the same way."""
        return tuple(kind.name for kind in self._possible())

    def _possible(self) -> Iterator[StreamKind | RecordsKind]:
        return (kind for kind in kinds().values() if self.bus in kind.buses)
