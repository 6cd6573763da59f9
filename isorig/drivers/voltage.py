"""A drive as the voltage of an output: scaled, limited, with soft start and stop; for all instruments with analog outputs."""

import math

import numpy as np

from isorig.drivers.block import FloatArray
from isorig.drivers.errors import SettingError
from isorig.drivers.instrument import Values
from isorig.drivers.kinds import Settings

#: Values examined at once.
PART = 65536
#: Longest soft start and stop, s.
RAMP_MOST = 10.0


class OutputSettings(Settings, frozen=True):
    """The output that plays the drive."""

    output: str | int | None = None  #: Its channel or number; none without it.
    drive_volts: float = 0.0  #: Volts at the output per m/s^2 of the drive at gain 1, in a run of gain 1.
    limit: float = 1.0  #: Largest voltage at the output, V: a drive that exceeds it is refused.
    ramp: float = 0.1  #: Seconds of the soft start and of the soft stop.

    @property
    def used(self) -> bool:
        """Whether there is an output."""
        return self.output not in (None, "")

    def check_output(self) -> None:
        """Validate the settings of the output; raises a ValueError in one sentence."""
        if not math.isfinite(self.drive_volts) or (self.used and self.drive_volts == 0.0):
            raise ValueError(
                f"drive_volts is {self.drive_volts:g}; give the output's volts per m/s^2 of the drive in a run of gain 1"
            )
        if not 0.0 < self.limit < math.inf:
            raise ValueError(f"limit is {self.limit:g}; give the largest voltage that the amplifier may get, V")
        if not 0.0 <= self.ramp <= RAMP_MOST:
            raise ValueError(f"ramp is {self.ramp:g}; give 0 to {RAMP_MOST:g} s for the soft start and stop")


class AnalogOutput:
    """The drive of an instrument with an analog output, which plays it and does not lock the rig."""

    def __init__(self, name: str, settings: OutputSettings) -> None:
        self._name, self._output_settings = name, settings
        self._rate, self._gain = math.nan, 1.0
        self._drive: Voltage | None = None

    def set_gain(self, gain: float) -> None:
        """The gain of the next run; it scales the drive."""
        self._gain = gain

    def set_configuration(self, name: str) -> bool:
        """The operator locks and unlocks the rig."""
        return False

    def load_drive(self, drive: Values) -> bool:
        """Load the drive; False without an output."""
        own = self._output_settings
        if not own.used:
            return False
        ramp = round(own.ramp * self._rate)
        self._drive = Voltage(drive, factor=own.drive_volts * self._gain, limit=own.limit, ramp=ramp, who=self._name)
        return True


class Voltage:
    """A drive in volts, which fades in from its first value that is not zero and out to its last; zero outside.

    `factor` is in volts per unit of the drive, with the gain of the run; the limit is in V, the ramp in samples. Raises
    SettingError if the drive exceeds the limit, or is not finite.
    """

    def __init__(self, drive: Values, *, factor: float, limit: float, ramp: int, who: str) -> None:
        self._drive, self._factor, self._ramp = drive, factor, ramp
        self._first, self._last, peak = len(drive), 0, 0.0
        for at in range(0, len(drive), PART):
            values = np.asarray(drive[at : at + PART], np.float64)
            used = np.flatnonzero(values)
            if len(used):
                self._first = min(self._first, at + int(used[0]))
                self._last = at + int(used[-1]) + 1
                peak = max(peak, abs(factor) * float(np.abs(values).max()))
            if not np.isfinite(values).all():
                raise SettingError(f"the drive for {who} is not finite; correct the run's excitation in the plan")
        if peak > limit:
            raise SettingError(
                f"the drive reaches {peak:.3g} V at the output of {who}, limited to {limit:g} V; lower the gain of the run, or "
                "set limit if the amplifier allows more"
            )

    def __getitem__(self, part: slice, /) -> FloatArray:
        start, stop = int(part.start), int(part.stop)
        volts = np.zeros(stop - start)
        inside = slice(max(start, self._first), min(stop, self._last))
        if inside.stop <= inside.start:
            return volts
        values = self._factor * np.asarray(self._drive[inside], np.float64)
        if self._ramp:
            ticks = np.arange(inside.start, inside.stop)
            near = np.minimum(ticks - self._first, self._last - 1 - ticks)
            values *= fade(np.clip(near / self._ramp, 0.0, 1.0))
        volts[inside.start - start : inside.stop - start] = values
        return volts


def fade(share: FloatArray) -> FloatArray:
    """Rises from 0 to 1 with zero slope at both ends (half a cosine)."""
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * share))
