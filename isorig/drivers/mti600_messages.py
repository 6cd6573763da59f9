"""The CAN messages of an MTi-600: identifiers, lengths and units."""

ERROR, SAMPLE_TIME, GROUP_COUNTER, STATUS_WORD, ACCELERATION = 0x001, 0x005, 0x006, 0x011, 0x034
#: Bytes of each message that is read.
LENGTHS = {ERROR: 1, SAMPLE_TIME: 4, GROUP_COUNTER: 2, STATUS_WORD: 4, ACCELERATION: 6}
PER_COUNT = 2.0**-8
CLIPPED = 0x700
WRAP = 1 << 16
