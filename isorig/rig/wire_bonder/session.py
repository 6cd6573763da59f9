"""The virtual wire bonder: a session is simulated and recorded as an instrument would, with sensor noise and a converter."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import timedelta

import msgspec
import numpy as np

from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run, Use
from isorig.analysis.errors import DataError
from isorig.analysis.given import all_of_type, finite, interval, positive, whole
from isorig.analysis.model.rig_model import Chain, RigModel, given_rig
from isorig.analysis.simulate import Excitation, record, simulate
from isorig.analysis.simulate.excitation import moves, random
from isorig.analysis.simulate.sampling import STEPS_MOST
from isorig.rig.virtual.levels import BEGIN, BITS, FULL_SCALE, HEAD_PER_GAIN, VIRTUAL

#: Samples of the longest virtual run: a day at 10 kHz.
LONGEST = 1e9


@dataclass(frozen=True, kw_only=True)
class VirtualRun:
    """One run to be simulated: configuration, drive, duration.

    Parameters
    ----------
    id, configuration, gain, excitation, use
        As in the recording format; excitation is "random" or "moves".
    seconds
        Length of the run, s.
    start
        Seconds after the campaign's first sample.
    band
        Band of a random drive, Hz.
    per_gain
        rms of the head's acceleration per unit of gain under a random drive, m/s^2.

    Examples
    --------
    >>> import isorig as iso
    >>> iso.VirtualRun(id="l7", configuration="locked", gain=7.0, seconds=60.0, start=570.0, band=(0.5, 400.0)).per_gain > 0.0
    True
    """

    id: str
    configuration: str
    gain: float
    seconds: float
    start: float
    excitation: str = "random"
    band: tuple[float, float] = (0.5, 20.0)
    use: Use = "fit"
    per_gain: float = HEAD_PER_GAIN

    def __post_init__(self) -> None:
        positive(self.seconds, f"the length of run {self.id!r}", " s")
        for key in ("gain", "start", "per_gain"):
            finite(getattr(self, key), f"the {key} of run {self.id!r}")
        interval(self.band, f"the band of run {self.id!r}")


#: A typical lab session: three gains unlocked (the first repeated), two locked, a series of moves.
SESSION = (
    VirtualRun(id="u70a", configuration="unlocked", gain=70.0, seconds=100.0, start=0.0),
    VirtualRun(id="u70b", configuration="unlocked", gain=70.0, seconds=100.0, start=130.0),
    VirtualRun(id="u35", configuration="unlocked", gain=35.0, seconds=100.0, start=260.0),
    VirtualRun(id="u7", configuration="unlocked", gain=7.0, seconds=60.0, start=390.0, band=(0.5, 400.0)),
    VirtualRun(id="l70", configuration="locked", gain=70.0, seconds=60.0, start=480.0),
    VirtualRun(id="l7", configuration="locked", gain=7.0, seconds=60.0, start=570.0, band=(0.5, 400.0)),
    VirtualRun(id="umove", configuration="unlocked", gain=70.0, seconds=30.0, start=660.0, excitation="moves"),
)

#: Additional runs on the same rig, to score predictions.
LATER = (
    VirtualRun(id="x70", configuration="unlocked", gain=70.0, seconds=60.0, start=720.0),
    VirtualRun(id="x50", configuration="unlocked", gain=50.0, seconds=60.0, start=810.0, band=(0.5, 30.0)),
    VirtualRun(id="x7", configuration="unlocked", gain=7.0, seconds=40.0, start=900.0, band=(0.5, 400.0)),
    VirtualRun(id="xmove", configuration="unlocked", gain=70.0, seconds=20.0, start=970.0, excitation="moves"),
    VirtualRun(id="xlock", configuration="locked", gain=70.0, seconds=40.0, start=1020.0, band=(0.5, 60.0)),
)


def head_of(take: VirtualRun, sample_rate: float, seed: int) -> FloatArray:
    """The head's true acceleration in a take, shape (n,), m/s^2."""
    n = round(take.seconds * sample_rate)
    if take.excitation == "moves":
        return moves(samples=n, sample_rate=sample_rate)
    return random(samples=n, sample_rate=sample_rate, rms=take.per_gain * take.gain, band=take.band, seed=seed)


def virtual_campaign(
    model: RigModel, takes: Sequence[VirtualRun] = SESSION, *, noise: float = 1e-3, seed: int = 0, sample_rate: float = 1024.0,
    oversample: int = 16,
) -> Campaign:  # fmt: skip
    """A whole session on a virtual rig.

    Parameters
    ----------
    model
        The rig, including faults of its measurement chain.
    takes
        The runs.
    noise
        Standard deviation of each sensor's noise, m/s^2.
    seed
        Random seed of drives and noise.
    sample_rate
        Hz.
    oversample
        Simulation steps per sample.

    Raises
    ------
    ArgumentError
        An argument is of another type.
    DataError
        One of them is out of its range.

    Examples
    --------
    >>> import isorig as iso
    >>> takes = [iso.VirtualRun(id="u70", configuration="unlocked", gain=70.0, seconds=2.0, start=0.0)]
    >>> campaign = iso.virtual_campaign(iso.wire_bonder(), takes, seed=1)
    >>> sorted(campaign.runs[0].channels)
    ['head', 'heatblock', 'motor', 'table']
    """
    model = given_rig(model)
    takes = all_of_type(takes, VirtualRun, "the argument takes", "a sequence of iso.VirtualRun; give for example [run]")
    sample_rate, noise = positive(sample_rate, "the sample rate", " Hz"), finite(noise, "the noise")
    if noise < 0.0:
        raise DataError(f"the noise is {noise:g} m/s^2, but must be zero or more; correct it")
    seed, oversample = whole(seed, "the random seed", 0), whole(oversample, "the number of steps per sample", 1, STEPS_MOST)
    generator = np.random.default_rng(seed)
    runs = []
    for take in takes:
        if take.seconds * sample_rate > LONGEST:
            raise DataError(
                f"run {take.id!r} would have {take.seconds * sample_rate:.3g} samples, but may have {LONGEST:g}; shorten it, or "
                "lower the sample rate"
            )
        head = head_of(take, sample_rate, int(generator.integers(2**31)))
        recorded = records_of(model, head, sample_rate, take.configuration, take.start, oversample=oversample)
        scale, top = 2.0 * FULL_SCALE / 2**BITS, 2 ** (BITS - 1)
        channels = {}
        for name, values in recorded.items():
            counts = np.round((values + generator.normal(0.0, noise, len(values))) / scale)
            samples = np.clip(counts, -top, top - 1).astype(np.int32)
            channels[name] = Channel(name=name, samples=samples, scale=scale, full_scale=FULL_SCALE, about=VIRTUAL)
        runs.append(
            Run(
                id=take.id, configuration=take.configuration, sample_rate=sample_rate, gain=take.gain, channels=channels,
                excitation=take.excitation, started=BEGIN + timedelta(seconds=take.start),
                band=None if take.excitation == "moves" else take.band, use=take.use,
            )
        )  # fmt: skip
    return Campaign(runs=tuple(runs), known=known_of(model), source="virtual rig")


def records_of(
    model: RigModel, drive: FloatArray, sample_rate: float, configuration: str, start_time: float, *, oversample: int = 16
) -> dict[str, FloatArray]:
    """All channels as recorded by a rig that starts from rest, by channel, each shape (n,).

    `drive` are the true values of the drive, shape (n,), at the sample rate (Hz); `start_time` is in seconds since the first run.
    """
    sound = msgspec.structs.replace(model, drive=msgspec.structs.replace(model.drive, chain=Chain())).without_faults
    excitation = Excitation.prepare(drive, sample_rate, oversample=oversample)
    seen = simulate(sound, excitation, configuration=configuration, start_time=start_time).channels
    return record(model, {model.drive.channel: drive, **seen}, sample_rate)


def known_of(model: RigModel) -> dict[str, float]:
    """Known values of a wire bonder in a lab: weighed masses, the table's actual mass, approximate frequencies."""
    return {
        "head_mass": model.drive.factor, "motor_mass": model.body("motor").mass,
        "heatblock_mass": model.body("heatblock").mass, "table_mass": 250.0, "table_frequency": 11.0,
        "heatblock_frequency": 165.0, "motor_frequency": 5.0, "friction_force": 20.0,
    }  # fmt: skip
