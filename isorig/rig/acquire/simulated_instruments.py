"""The virtual rig connected to simulated instruments of any kind, for `--port virtual` and `rig virtual instrument`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from isorig.analysis.campaign import Channel, FloatArray, Run
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.simulate.excitation import random
from isorig.analysis.spectra.welch import estimate
from isorig.drivers.errors import SettingError
from isorig.drivers.kinds import Simulation, kinds
from isorig.drivers.simulated.faults import Faults
from isorig.drivers.simulated.served import Peer, served
from isorig.rig.acquire.plant import SENSITIVITY, VirtualPlant, playing
from isorig.rig.virtual.levels import HEAD_PER_GAIN
from isorig.rig.wire_bonder.description import wire_bonder

GAIN, BAND = 70.0, (0.5, 20.0)
#: Length of the repeated signal of a virtual port, s: it is simulated while the session waits for a sample.
REPEATED = 10.0
#: The kind that plays the given drive, so its rig is not a `DrivenRig`.
PLAYS = "framed"


class VirtualDrivenRig:
    """A rig under a random drive, see `isorig.drivers.kinds.DrivenRig`."""

    def __init__(self, plant: VirtualPlant, seed: int) -> None:
        self._plant, self._seed = plant, seed
        self.names = plant.names

    def channels(self, samples: int, rate: float) -> dict[str, FloatArray]:
        """m/s^2 by channel, each shape (samples,)."""
        drive = random(samples=samples, sample_rate=rate, rms=HEAD_PER_GAIN, band=BAND, seed=self._seed)
        counts = self._plant.play(drive, sample_rate=rate, gain=GAIN, configuration="unlocked")
        return {name: counts[:, k] * self._plant.inputs[2] / SENSITIVITY for k, name in enumerate(self.names)}

    def volts(self, samples: int, rate: float) -> FloatArray:
        """V at the inputs, shape (samples, inputs)."""
        return np.stack(list(self.channels(samples, rate).values()), axis=1) * SENSITIVITY

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
    return tuple(name for name, kind in kinds().items() if name == PLAYS or kind.far_end is not None)


def far_end(
    kind: str, model: RigModel, *, noise: float, seed: int, speed: float, seconds: float, faults: Faults | None = None
) -> Peer:
    """A simulated instrument of that kind, connected to a rig.

    Raises
    ------
    SettingError
        The kind has no simulated counterpart, or a requested fault is not supported.
    """
    making = kinds()[kind].far_end if kind in kinds() else None
    if making is None:
        raise SettingError(f"the kind {kind!r} cannot be simulated; available are {', '.join(simulated_kinds())}")
    rig = VirtualDrivenRig(VirtualPlant(model, noise=noise, seed=seed), seed)
    # Compile now what is compiled at first use, so that the instrument answers without delay.
    rig.volts(256, 256.0)
    return making(rig, Simulation(speed=speed, seconds=seconds, faults=faults or Faults(seed=seed)))


@contextmanager
def reached_port(kind: str, port: str) -> Iterator[str]:
    """The port to open; "virtual" is a simulated instrument of that kind in a thread of this process, connected to the thesis's
    rig."""
    if port != "virtual":
        yield port
    elif kind == PLAYS:
        with playing(wire_bonder()) as simulated:
            yield simulated
    else:
        with served(far_end(kind, wire_bonder(), noise=1e-3, seed=0, speed=1.0, seconds=REPEATED)) as simulated:
            yield simulated
