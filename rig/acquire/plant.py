"""The virtual rig as the plant behind a simulated instrument: a drive in, counts of its inputs out."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import msgspec
import numpy as np

from analysis.measured import FloatArray
from analysis.model import Chain, RigModel
from analysis.simulate import Excitation, record, simulate
from drivers.block import Raw
from drivers.simulated.faults import Faults
from drivers.simulated.framed import SimulatedFramed
from drivers.simulated.wire import PtyWire
from rig.virtual import BITS

#: Volts of full scale and the sensors' sensitivity, V per m/s^2.
FULL_SCALE = 10.0
SENSITIVITY = 0.2


class VirtualPlant:
    """A rig with accelerometers of 0.2 V per m/s^2 on a 24-bit instrument of +-10 V.

    Its inputs are the drive's channel and then the model's sensors in order.

    Parameters
    ----------
    model
        The rig.
    noise
        Standard deviation of every sensor's noise, m/s^2.
    seed
        Of the noise.
    """

    def __init__(self, model: RigModel, *, noise: float = 1e-3, seed: int = 0) -> None:
        self._model, self._noise = model, noise
        self._sound = msgspec.structs.replace(
            model,
            drive=msgspec.structs.replace(model.drive, chain=Chain()),
            sensors=tuple(msgspec.structs.replace(sensor, chain=Chain()) for sensor in model.sensors),
        )
        self._random = np.random.default_rng(seed)
        self.names = (model.drive.channel, *(sensor.channel for sensor in model.sensors))
        self.identity = f"virtual {model.name}"
        self.inputs = (len(self.names), "V", FULL_SCALE / 2 ** (BITS - 1), FULL_SCALE)

    def play(self, drive: FloatArray, *, sample_rate: float, gain: float, configuration: str) -> Raw:
        """The counts of all inputs under a drive given at gain 1, int32, shape (n, inputs)."""
        head = gain * drive
        excitation = Excitation.prepare(head, sample_rate, oversample=16)
        response = simulate(self._sound, excitation, configuration=configuration)
        recorded = record(self._model, {self._model.drive.channel: head, **response.channels}, sample_rate)
        top = 2 ** (BITS - 1)
        volts = np.stack([recorded[name] for name in self.names], axis=1) * SENSITIVITY
        volts += self._random.normal(0.0, self._noise * SENSITIVITY, volts.shape)
        return np.asarray(np.clip(np.round(volts / FULL_SCALE * top), -top, top - 1).astype(np.int32))


@contextmanager
def playing(
    model: RigModel, *, noise: float = 1e-3, seed: int = 0, speed: float | None = None, faults: Faults | None = None
) -> Iterator[str]:
    """A simulated framed instrument with a rig behind it in a thread of this process; the path of its port."""
    wire = PtyWire()
    instrument = SimulatedFramed(wire, VirtualPlant(model, noise=noise, seed=seed), faults=faults, speed=speed)
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
