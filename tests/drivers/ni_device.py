"""An NI device in place of NI's library: the interpreter of the vendor's package, with a chassis that acquires in real time.

The package's own classes (Task, readers, writers, attributes) run on it unchanged. Every call is recorded; a call of the library
that is not answered here fails.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from filelock import FileLock
from nidaqmx import utils
from nidaqmx._base_interpreter import BaseInterpreter
from nidaqmx.errors import DaqError, DaqReadError

#: Attributes of NI's library by number, as the vendor's package uses them.
RATE, POSITION, OVERLOADED, OPEN_NAMES, IDLE = 0x1344, 0x1221, 0x2174, 0x3101, 0x2240
PRODUCT, CHASSIS, INPUTS, OUTPUTS = 0x631, 0x29B7, 0x231E, 0x231F
#: The modules of the chassis: product, direction and number of channels.
MODULES = {"cDAQ1Mod1": ("NI 9234", "ai", 4), "cDAQ1Mod2": ("NI 9234", "ai", 4), "cDAQ1Mod3": ("NI 9263", "ao", 4)}
RELATIVE, NEWEST, CHANNELS, OFFSET = 0x190A, 10428, 0x217B, 0x190B
TERMINAL, SENSITIVITY, SENSITIVITY_UNIT = 0x18C7, 0x2F81, 0x2F82


@dataclass
class Device:
    """A chassis.

    Parameters
    ----------
    speed, clock
        Signal seconds per second; true rate relative to the requested one.
    coerced
        The rate that it sets in place of the requested one.
    buffer
        Samples that it keeps for the host.
    stall
        Given a tick, whether samples from there on are withheld from the host for a while.
    """

    speed: float = 10.0
    clock: float = 1.0
    coerced: float | None = None
    buffer: int | None = None
    overload_from: int | None = None
    open_from: int | None = None
    unsupported: bool = False
    gone_after: int | None = None
    #: Ticks that it overwrites before the host can fetch them, from one on, and how many; the tick after which it is silent.
    lost: tuple[int, int] | None = None
    mute_after: int | None = None
    #: The sensors' memories by physical channel.
    memories: dict[str, bytes] = field(default_factory=dict)
    #: What the library reads from the memories of force sensors: value, and the number of its unit.
    forces: dict[str, tuple[float, int]] = field(default_factory=dict)
    #: Pulses of the tachometer up to each tick.
    pulses: Callable[[np.ndarray], np.ndarray] = lambda ticks: ticks // 5
    #: Given the name of a call of the library, raises what it raises then.
    fault: Callable[[str], None] = lambda name: None
    silent: bool = False
    calls: list[tuple[str, tuple[Any, ...]]] = field(default_factory=list)
    #: What the output held last, and all that was written to it with the clock.
    level: float = 0.0
    played: list[float] = field(default_factory=list)
    tasks: dict[str, dict[str, Any]] = field(default_factory=dict)

    def names(self) -> list[str]:
        """The calls so far."""
        return [name for name, _ in self.calls]

    def acquired(self, task: dict[str, Any]) -> int:
        """Samples since the start."""
        if self.silent or not task.get("began"):
            return 0
        due = int((time.monotonic() - task["began"]) * task["rate"] * self.speed * self.clock)
        if self.gone_after is not None and due > self.gone_after:
            raise DaqError("Device cannot be accessed. It was removed.", -201003)
        return due if self.mute_after is None else min(due, self.mute_after)


def column(ticks: np.ndarray, k: int) -> np.ndarray:
    """What input k measures: the first counts ticks."""
    return ticks.astype(float) if k == 0 else 3.0 * ticks + k


class Interpreter:
    """Answers of the library."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._skipped = 0

    def create_task(self, name: str) -> tuple[str, bool]:
        handle = f"task{len(self._device.tasks)}"
        self._device.tasks[handle] = {"inputs": [], "outputs": [], "position": 0, "written": 0, "attributes": {}}
        return handle, True

    def _task(self, handle: str) -> dict[str, Any]:
        return self._device.tasks[handle]

    def get_task_attribute_string(self, handle: str, number: int) -> str:
        return handle

    def internal_get_last_created_chan(self) -> str:
        raise NotImplementedError

    def create_ai_voltage_chan(self, handle: str, name: str, *_: Any) -> None:
        if not name.startswith("cDAQ1Mod"):
            raise DaqError(f"Physical channel specified does not exist on this device.\n\nPhysical: {name}", -200170)
        self._task(handle)["inputs"].append(name)

    def create_ao_voltage_chan(self, handle: str, name: str, *_: Any) -> None:
        self._task(handle)["outputs"].append(name)

    def set_chan_attribute_int32(self, handle: str, channel: str, number: int, value: int) -> None:
        if number == IDLE and self._device.unsupported:
            raise DaqError("Attribute is not supported", -200452)
        self._task(handle)["attributes"][channel, number] = value

    def set_chan_attribute_double(self, handle: str, channel: str, number: int, value: float) -> None:
        self._task(handle)["attributes"][channel, number] = value

    def set_chan_attribute_string(self, handle: str, channel: str, number: int, value: str) -> None:
        self._task(handle)["attributes"][channel, number] = value

    def get_chan_attribute_double(self, handle: str, channel: str, number: int) -> float:
        assert number == SENSITIVITY
        return self._device.forces[channel][0]

    def get_chan_attribute_int32(self, handle: str, channel: str, number: int) -> int:
        assert number == SENSITIVITY_UNIT
        return self._device.forces[channel][1]

    def configure_teds(self, name: str, path: str) -> None:
        if name not in self._device.memories:
            raise DaqError("TEDS sensor was not detected.", -200709)

    def create_tedsai_force_iepe_chan(self, handle: str, name: str, *_: Any) -> None:
        if name not in self._device.forces:
            raise DaqError("TEDS sensor cannot be used by this channel.", -200754)

    def create_ci_count_edges_chan(self, handle: str, counter: str, *_: Any) -> None:
        self._task(handle)["counter"] = counter

    def cfg_samp_clk_timing(self, handle: str, rate: float, source: str, edge: int, mode: int, count: int) -> None:
        self._task(handle).update(rate=self._device.coerced or rate, source=source, buffer=self._device.buffer or count)

    def cfg_dig_edge_start_trig(self, handle: str, source: str, edge: int) -> None:
        self._task(handle)["trigger"] = source

    def get_timing_attribute_double(self, handle: str, number: int) -> float:
        assert number == RATE
        return float(self._task(handle)["rate"])

    def get_timing_attribute_string(self, handle: str, number: int) -> str:
        return "/cDAQ1/ai/SampleClock"

    def set_read_attribute_int32(self, handle: str, number: int, value: int) -> None:
        self._task(handle)[number] = value

    def start_task(self, handle: str) -> None:
        self._task(handle).update(began=time.monotonic(), position=0)

    def stop_task(self, handle: str) -> None:
        self._task(handle)["began"] = None

    def clear_task(self, handle: str) -> None:
        self._task(handle)["cleared"] = True

    def get_read_attribute_uint64(self, handle: str, number: int) -> int:
        task = self._task(handle)
        return int(task["position"]) if number == POSITION else self._device.acquired(task)

    def get_read_attribute_uint32(self, handle: str, number: int) -> int:
        task = self._task(handle)
        if number == CHANNELS:
            return len(task["inputs"])
        return self._device.acquired(task) - int(task["position"])

    def get_read_attribute_bool(self, handle: str, number: int) -> bool:
        if self._device.unsupported:
            raise DaqError("Attribute is not supported", -200452)
        since = self._device.overload_from if number == OVERLOADED else self._device.open_from
        return since is not None and self._task(handle)["position"] > since

    def get_read_attribute_string(self, handle: str, number: int, *_: Any) -> str:
        return "cDAQ1Mod1/ai1" if number == OPEN_NAMES else ", ".join(self._task(handle)["inputs"])

    def read_analog_f64(self, handle: str, count: int, timeout: float, mode: int, out: np.ndarray) -> tuple[np.ndarray, int]:
        task = self._task(handle)
        acquired = self._device.acquired(task)
        if task.get(RELATIVE) == NEWEST:
            task["position"] = (self._skipped or acquired) - count
        elif acquired - task["position"] > task["buffer"]:
            raise DaqReadError("The application is not able to keep up with the hardware acquisition.", -200279, 0)
        elif self._device.lost is not None and task["position"] + count > self._device.lost[0]:
            first, lost = self._device.lost
            if task["position"] < first:
                count = first - task["position"]
            else:
                self._device.lost, self._skipped = None, first + lost
                raise DaqReadError("The application is not able to keep up with the hardware acquisition.", -200279, 0)
        ticks = np.arange(task["position"], task["position"] + count)
        for k, row in enumerate(out):
            row[:count] = column(ticks, k)
        task["position"] += count
        return out, count

    def read_counter_u32_ex(self, handle: str, count: int, timeout: float, mode: int, out: np.ndarray) -> tuple[np.ndarray, int]:
        task = self._task(handle)
        inputs = next(one for one in self._device.tasks.values() if one["inputs"] and one.get("began"))
        # It counts from its start on, and is clocked by the inputs.
        assert task["began"] <= inputs["began"]
        first = task["position"] + task.get(OFFSET, 0)
        assert 0 <= first <= first + count <= self._device.acquired(inputs)
        out[:count] = (self._device.pulses(np.arange(first, first + count)) % (1 << 32)).astype(np.uint32)
        task["position"] = first + count
        return out, count

    def get_write_attribute_uint32(self, handle: str, number: int) -> int:
        task = self._task(handle)
        return int(task["buffer"] - (task["written"] - self._generated(task)))

    def get_write_attribute_uint64(self, handle: str, number: int) -> int:
        return self._generated(self._task(handle))

    def _generated(self, task: dict[str, Any]) -> int:
        clock = next((one for one in self._device.tasks.values() if one["inputs"] and one.get("began")), None)
        return min(self._device.acquired(clock), task["written"]) if clock else 0

    def set_write_attribute_int32(self, handle: str, number: int, value: int) -> None:
        self._task(handle)[number] = value

    def write_analog_f64(self, handle: str, count: int, auto: bool, timeout: float, mode: int, values: np.ndarray) -> int:
        task = self._task(handle)
        task["written"] += count
        self._device.played += values.tolist()
        self._device.level = float(values[-1])
        return count

    def write_analog_scalar_f64(self, handle: str, auto: bool, timeout: float, value: float) -> None:
        self._device.level = value

    def get_system_info_attribute_string(self, number: int) -> str:
        return ", ".join(["cDAQ1", *MODULES])

    def get_physical_chan_attribute_bytes(self, name: str, number: int) -> list[int]:
        memory = self._device.memories.get(name)
        if memory is None:
            raise DaqError("TEDS sensor was not detected.", -200709)
        return list(memory)

    def get_device_attribute_string(self, device: str, number: int) -> str:
        if device not in ("cDAQ1", *MODULES):
            raise DaqError("Device identifier is invalid.", -200220)
        if number == PRODUCT:
            return MODULES[device][0] if device in MODULES else "cDAQ-9178"
        if number == CHASSIS:
            if device == "cDAQ1":
                raise DaqError("Property is not supported.", -200197)
            return "cDAQ1"
        direction = {INPUTS: "ai", OUTPUTS: "ao"}[number]
        kind, count = (MODULES[device][1:]) if device in MODULES else ("", 0)
        return ", ".join(f"{device}/{direction}{k}" for k in range(count)) if kind == direction else ""


#: The calls of the library that are answered here.
ANSWERED = frozenset(name for name in vars(Interpreter) if not name.startswith("_"))


def _unknown(name: str) -> Callable[..., Any]:
    def call(self: object, *given: object, **named: object) -> Any:
        raise AssertionError(f"the device here has no {name}{given}")

    return call


def interpreter(device: Device) -> BaseInterpreter:
    """The device as an interpreter of the vendor's package."""

    def recorded(name: str) -> Callable[..., Any]:
        def call(self: Any, *given: Any, **named: Any) -> Any:
            device.calls.append((name, given))
            device.fault(name)
            return getattr(Interpreter, name)(self, *given, **named)

        return call

    own = {name: recorded(name) for name in ANSWERED}
    missing = {name: _unknown(name) for name in BaseInterpreter.__abstractmethods__ if name not in own}
    kind = type("RecordedInterpreter", (Interpreter, BaseInterpreter), {**missing, **own})
    return kind(device)  # type: ignore[no-any-return]


@contextmanager
def chassis(device: Device | None = None) -> Iterator[Device]:
    """While this lasts, the vendor's package talks to the device; there is one, and tests that run side by side take turns."""
    device = device or Device()
    made = interpreter(device)
    turn = FileLock(Path(tempfile.gettempdir(), "rig-tests-chassis.lock"), timeout=300.0)
    with turn, mock.patch.object(utils, "_select_interpreter", return_value=made):
        yield device
