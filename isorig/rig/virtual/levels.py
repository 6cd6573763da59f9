"""Levels of a virtual rig: its sensors and converter, its drive at a gain, and the time of its first sample."""

from datetime import UTC, datetime

#: Full scale of a virtual accelerometer's input, m/s^2, and the bits of its converter.
FULL_SCALE = 50.0
BITS = 24
#: rms of the head's acceleration per unit of gain under random drive, m/s^2 (3.8 m/s^2 at gain 70).
HEAD_PER_GAIN = 3.8 / 70.0
#: Peak acceleration of the head in moves per unit of gain, m/s^2.
MOVE_PER_GAIN = 12.5 / 70.0
#: Sample rate of designed moves, Hz: at least fifteen samples in a move of a hundredth of a second.
MOVE_RATE = 2048.0
#: Description of a virtual rig's sensors.
VIRTUAL = {"sensor": "virtual accelerometer"}
BEGIN = datetime(2011, 11, 7, 9, 0, tzinfo=UTC)
