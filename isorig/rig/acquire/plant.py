"""The virtual rig as the plant of a simulated instrument: takes a drive, returns counts of its inputs."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.model.rig_model import RigModel
from isorig.drivers.block import Raw
from isorig.drivers.simulated.faults import Faults
from isorig.drivers.simulated.framed import SimulatedFramed
from isorig.drivers.simulated.wire import PtyWire
from isorig.rig.virtual.levels import BITS
from isorig.rig.wire_bonder.effects import Hidden

#: Full scale in volts, and sensitivity of the sensors, V per m/s^2.
FULL_SCALE = 10.0
SENSITIVITY = 0.2


class VirtualPlant:
    """A rig with accelerometers of 0.2 V per m/s^2 on a 24-bit instrument of +-10 V.

    Its inputs are the drive channel and then the model's sensors in order.

    Parameters
    ----------
    model
        The rig.
    noise
        Standard deviation of each sensor's noise, m/s^2.
    seed
        Random seed of the noise.
    hidden
        An effect hidden in the rig.
    """

    def __init__(self, model: RigModel, *, noise: float = 1e-3, seed: int = 0, hidden: Hidden | None = None) -> None:
        self._hidden = hidden or Hidden(model=model)
        self._noise = noise
        self._began: float | None = None
        self._runs = 0
        model = self._hidden.model
        self._random = np.random.default_rng(seed)
        self.names = (model.drive.channel, *(sensor.channel for sensor in model.sensors))
        self.identity = f"virtual {model.name}"
        self.inputs = (len(self.names), "V", FULL_SCALE / 2 ** (BITS - 1), FULL_SCALE)

    def play(self, drive: FloatArray, *, sample_rate: float, gain: float, configuration: str) -> Raw:
        """Counts of all inputs for a drive given at gain 1, int32, shape (n, inputs)."""
        # Drifts follow the host's clock, because the start times of the runs do.
        now = time.monotonic()
        self._began = now if self._began is None else self._began
        recorded = self._hidden.records(
            gain * drive, sample_rate, configuration=configuration, gain=gain, start_time=now - self._began, run=f"{self._runs}"
        )
        self._runs += 1
        top = 2 ** (BITS - 1)
        volts = np.stack([recorded[name] for name in self.names], axis=1) * SENSITIVITY
        volts += self._random.normal(0.0, self._noise * SENSITIVITY, volts.shape)
        return np.asarray(np.clip(np.round(volts / FULL_SCALE * top), -top, top - 1).astype(np.int32))


@contextmanager
def playing(
    model: RigModel, *, noise: float = 1e-3, seed: int = 0, speed: float | None = None, faults: Faults | None = None,
    hidden: Hidden | None = None,
) -> Iterator[str]:  # fmt: skip
    """A simulated framed instrument, connected to a rig, in a thread of this process; yields the path of its port."""
    wire = PtyWire()
    instrument = SimulatedFramed(wire, VirtualPlant(model, noise=noise, seed=seed, hidden=hidden), faults=faults, speed=speed)
    over = threading.Event()

    def serve() -> None:
        while not over.is_set() and not instrument.unplugged:
            instrument.step()

    thread = threading.Thread(target=serve, name="simulated instrument", daemon=True)
    thread.start()
    try:
        yield wire.port
    finally:
        over.set()
        thread.join()
        wire.close()
