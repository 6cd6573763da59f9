"""How long drivers wait: one object, handed to whoever opens an instrument."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Waits:
    """Timeouts in seconds, chosen unless a source is given."""

    answer: float = 2.0  #: Until an answer starts, and between two parts of it.
    sending: float = 10.0  #: For sending a piece: a piece at 9600 baud takes 4.3 s.
    silence: float = 2.0  #: Within which a stopped instrument must be silent.
    start: float = 60.0  #: Between the start command of a framed instrument, which may have to load its drive, and its answer.
    adapter: float = 2.0  #: After the port of a serial CAN adapter is opened: many restart then.
    #: Between two questions whether an analyzer has finished; between two searches of a library's buffer for samples.
    poll: float = 0.2
    fetch: float = 0.005
    #: Until a sound interface delivers samples regularly; without a sample, after which it is gone.
    sound_start: float = 6.0
    sound: float = 2.0


WAITS = Waits()
