"""The virtual rig connected to simulated instruments of any kind, for `--port virtual` and `rig virtual instrument`."""

import math
import time

import numpy as np

from isorig.analysis.campaign import Channel, FloatArray, Run
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.simulate.excitation import random
from isorig.analysis.spectra.welch import estimate
from isorig.drivers.block import Raw
from isorig.drivers.errors import SettingError
from isorig.drivers.kinds import StreamKind, kinds
from isorig.drivers.simulated.commanded import Faults, Simulation
from isorig.drivers.simulated.served import Peer
from isorig.rig.virtual.levels import BITS, HEAD_PER_GAIN
from isorig.rig.wire_bonder.effects import Hidden

#: Full scale in volts, and sensitivity of the sensors, V per m/s^2.
FULL_SCALE, SENSITIVITY = 10.0, 0.2
#: Gain and band, Hz, of the random drive.
GAIN, BAND = 70.0, (0.5, 20.0)
#: Length of the repeated signal of a virtual port, s: it is simulated while the session waits for a sample.
REPEATED = 10.0


class VirtualRig:
    """A rig with accelerometers of 0.2 V per m/s^2 on a 24-bit instrument of +-10 V, see `isorig.drivers.kinds.DrivenRig`.

    Its inputs are the drive channel and then the model's sensors in order; `noise` is the standard deviation of each, m/s^2.
    """

    def __init__(self, model: RigModel, *, noise: float = 1e-3, seed: int = 0, hidden: Hidden | None = None) -> None:
        self._hidden = hidden or Hidden(model=model)
        self._noise, self._seed = noise, seed
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

    def volts(self, samples: int, rate: float) -> FloatArray:
        """V at the inputs under a random drive, shape (samples, inputs)."""
        drive = random(samples=samples, sample_rate=rate, rms=HEAD_PER_GAIN, band=BAND, seed=self._seed)
        counts = self.play(drive, sample_rate=rate, gain=GAIN, configuration="unlocked")
        return np.asarray(counts * self.inputs[2])

    def channels(self, samples: int, rate: float) -> dict[str, FloatArray]:
        """m/s^2 by channel under a random drive, each shape (samples,)."""
        return dict(zip(self.names, self.volts(samples, rate).T / SENSITIVITY, strict=True))

    def coherence(self, samples: int, rate: float) -> tuple[FloatArray, FloatArray]:
        """Frequency in Hz and coherence of the last channel with the drive."""
        run = Run(
            id="x", configuration="unlocked", sample_rate=rate, gain=GAIN, excitation="random", band=BAND,
            channels={name: Channel(name=name, samples=values) for name, values in self.channels(samples, rate).items()},
        )  # fmt: skip
        found = estimate([run], references=[self.names[0]], resolution=0.25)
        return found.frequency, found.frf(self.names[-1], self.names[0]).coherence


def simulated_kinds() -> tuple[str, ...]:
    """The kinds of instruments that have a simulated counterpart."""
    return tuple(name for name, kind in kinds().items() if kind.far_end is not None)


def far_end(
    kind: str, model: RigModel, *, noise: float = 1e-3, seed: int = 0, speed: float | None = None, seconds: float = REPEATED,
    faults: Faults | None = None, hidden: Hidden | None = None,
) -> Peer:  # fmt: skip
    """A simulated instrument of that kind, connected to a rig.

    Without a speed it measures in real time, or, if it plays a drive, as fast as the connection allows. Raises SettingError if
    the kind has no simulated counterpart, or a requested fault is not supported.
    """
    if kind not in simulated_kinds():
        raise SettingError(f"the kind {kind!r} cannot be simulated; available are {', '.join(simulated_kinds())}")
    about = kinds()[kind]
    assert about.far_end is not None
    if speed is None:
        speed = math.inf if isinstance(about, StreamKind) and about.plays else 1.0
    # Compile now what is compiled at first use, so that the instrument answers without delay.
    VirtualRig(model).volts(256, 256.0)
    rig = VirtualRig(model, noise=noise, seed=seed, hidden=hidden)
    return about.far_end(rig, Simulation(speed=speed, seconds=seconds, faults=faults or Faults(seed=seed)))
