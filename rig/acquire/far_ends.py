"""The virtual rig behind simulated instruments that play no drive of ours: the rig is shaken by a random drive of its own."""

from __future__ import annotations

from typing import Literal

import numpy as np

from analysis.excitation import random
from analysis.measured import Channel, FloatArray, Run
from analysis.model import RigModel
from analysis.spectra import estimate
from drivers.block import Raw
from drivers.mti600 import PER_COUNT
from drivers.simulated.analyzers import Simulated35670a, SimulatedSr785
from drivers.simulated.faults import Faults
from drivers.simulated.served import Peer
from drivers.simulated.streams import SimulatedDataq, SimulatedSlcan
from rig.acquire.plant import FULL_SCALE, SENSITIVITY, VirtualPlant
from rig.virtual import HEAD_PER_GAIN

Kind = Literal["di1100", "mti600", "sr785", "35670a"]
GAIN, BAND = 70.0, (0.5, 20.0)
#: Rate of a simulated MTi-600, Hz; points and rate of an analyzer's time record.
MTI_RATE = 400.0
RECORD, RECORD_RATE = 2048, 256.0


class Shaken:
    """Plays a rig under a random drive."""

    def __init__(self, plant: VirtualPlant, seed: int) -> None:
        self._plant, self._seed = plant, seed

    def channels(self, samples: int, rate: float) -> dict[str, FloatArray]:
        """m/s^2 by channel, each shape (samples,)."""
        drive = random(samples=samples, sample_rate=rate, rms=HEAD_PER_GAIN, band=BAND, seed=self._seed)
        counts = self._plant.play(drive, sample_rate=rate, gain=GAIN, configuration="unlocked")
        return {name: counts[:, k] * self._plant.inputs[2] / SENSITIVITY for k, name in enumerate(self._plant.names)}

    def words(self, samples: int, rate: float) -> Raw:
        """Counts of 16 bits of all inputs at +-10 V, shape (samples, inputs)."""
        volts = np.stack(list(self.channels(samples, rate).values()), axis=1) * SENSITIVITY
        return np.clip(np.round(volts / FULL_SCALE * 32768), -32768, 32767).astype(np.int16)

    def axes(self, samples: int, rate: float) -> Raw:
        """Counts of an accelerometer on the motor, its y along the drive, shape (samples, 3)."""
        motor = self.channels(samples, rate)["motor"]
        flat = np.zeros_like(motor)
        return np.round(np.stack([flat, motor, flat + 9.81], axis=1) / PER_COUNT).astype(np.int16)


def far_end(
    kind: Kind, model: RigModel, *, noise: float, seed: int, speed: float, seconds: float, faults: Faults | None = None
) -> Peer:
    """A simulated instrument of that kind with a rig behind it.

    The displays of an analyzer: a coherence of motor and head, and a time record of the motor, in V.

    Raises
    ------
    SettingError
        Where a fault is asked for that this kind cannot have.
    """
    faults = faults or Faults(seed=seed)
    shaken = Shaken(VirtualPlant(model, noise=noise, seed=seed), seed)
    # Whatever is compiled on first use is compiled now, so that the instrument answers at once.
    shaken.words(256, RECORD_RATE)
    if kind == "di1100":
        return SimulatedDataq(shaken.words, seconds=seconds, speed=speed, faults=faults)
    if kind == "mti600":
        return SimulatedSlcan(shaken.axes, rate=MTI_RATE, seconds=seconds, speed=speed, faults=faults)
    faults.only(("overload",) if kind == "sr785" else (), f"a {kind}")
    record = shaken.channels(16 * RECORD, RECORD_RATE)
    run = Run(
        id="x", configuration="unlocked", sample_rate=RECORD_RATE, gain=GAIN, excitation="random", band=BAND,
        channels={name: Channel(name=name, samples=values) for name, values in record.items()},
    )  # fmt: skip
    found = estimate([run], references=["head"], resolution=0.25)
    coherence = found.frequency, found.frf("motor", "head").coherence
    time_record = np.arange(RECORD) / RECORD_RATE, record["motor"][:RECORD] * SENSITIVITY
    if kind == "sr785":
        return SimulatedSr785({0: coherence, 1: time_record}, overload=faults.overload > 0.0)
    return Simulated35670a({"XFR:POW:COH 1,2": coherence, "XTIM:VOLT 1": time_record})
