"""Electronic data sheets of sensors (IEEE 1451.4): serial number, sensitivity and calibration date from the memory's bytes.

Read are the Basic TEDS (64 bits) and template 25 of accelerometers with constant-current supply (IEPE). Force sensors use the
same template, but the layout of their fields is not published: of these the Basic TEDS is read here, and the sensitivity by the
instrument's own library (`Describing.force_sensitivity`). Of accelerometers with extended functions only the Basic TEDS is read.
"""

import math
from dataclasses import dataclass, replace
from datetime import date, timedelta

from isorig.drivers.errors import ProtocolError

#: Dates count days from here; a field of ones holds no value.
EPOCH = date(1998, 1, 1)
#: Bits of the Basic TEDS, and the largest memory that is read, bytes.
BASIC, LARGEST = 64, 4096
TEMPLATE = 25


@dataclass(frozen=True, kw_only=True)
class Teds:
    """What a sensor's memory states."""

    serial_number: int
    quantity: str = ""  #: acceleration or force by template 25; empty for other templates.
    sensitivity: float | None = None  #: V per m/s^2; None if the template is not read.
    #: Dates of the calibration and of the next one; None if they are not given.
    calibrated: date | None = None
    due: date | None = None


class _Bits:
    """Fields of a memory, each with its lowest bit first."""

    def __init__(self, data: bytes) -> None:
        self._left, self._count = int.from_bytes(data, "little"), 8 * len(data)

    def read(self, count: int) -> int:
        if count > self._count:
            raise ProtocolError("the sensor's memory ends within its data sheet; read it again, or give its values by hand")
        value = self._left & ((1 << count) - 1)
        self._left >>= count
        self._count -= count
        return value

    def relative(self, count: int, start: float, tolerance: float) -> float:
        """A value with constant relative resolution: start (1 + 2 tolerance)^n (IEEE 1451.4, ConRelRes)."""
        return start * math.pow(1.0 + 2.0 * tolerance, self.read(count))


def decode(data: bytes) -> Teds:
    """The data sheet in a sensor's memory, which is given without checksums, lowest bit first. Raises ProtocolError if it holds
    none."""
    if len(data) > LARGEST or 8 * len(data) < BASIC or not any(data) or set(data) == {0xFF}:
        raise ProtocolError(f"the sensor's memory of {len(data)} bytes holds no data sheet; give the sensor's values by hand")
    bits = _Bits(data)
    # Numbers of the manufacturer and of the model, letter and number of the version.
    bits.read(14 + 15 + 5 + 6)
    basic = Teds(serial_number=bits.read(24))
    if 8 * len(data) < BASIC + 12 or bits.read(2) != 0 or bits.read(8) != TEMPLATE:
        return basic
    basic = replace(basic, quantity="force" if bits.read(1) else "acceleration")
    if basic.quantity == "force" or bits.read(1):
        return basic
    sensitivity = bits.relative(16, 5e-7, 0.00015)
    # Lower corner frequency, direction, weight, polarity.
    bits.read(8 + 2 + 6 + 1)
    if bits.read(1):
        # Transfer function: upper corner, resonance, its quality, slope, temperature coefficient.
        bits.read(7 + 9 + 9 + 7 + 6)
    # Reference frequency and temperature.
    bits.read(8 + 5)
    day = bits.read(16)
    bits.read(15)
    period = bits.read(12)
    calibrated = None if day in (0, (1 << 16) - 1) else EPOCH + timedelta(days=day)
    due = None if calibrated is None or period in (0, (1 << 12) - 1) else calibrated + timedelta(days=period)
    return replace(basic, sensitivity=sensitivity, calibrated=calibrated, due=due)
