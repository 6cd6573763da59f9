"""How long drivers wait: one object, handed to whoever opens an instrument."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Waits:
    """Timeouts in seconds, chosen unless a source is given.

    Parameters
    ----------
    answer
        Until an answer starts, and between two parts of it.
    sending
        For sending a piece: a piece at 9600 baud takes 4.3 s.
    silence
        Within which a stopped instrument must be silent.
    start
        Between the start command of a framed instrument, which may have to load its drive, and its answer.
    adapter
        After the port of a serial CAN adapter is opened: many restart then.
    poll, fetch
        Between two questions whether an analyzer has finished; between two searches of a library's buffer for samples.
    sound_start, sound
        Until a sound interface delivers samples regularly; without a sample, after which it is gone.
    """

    answer: float = 2.0
    sending: float = 10.0
    silence: float = 2.0
    start: float = 60.0
    adapter: float = 2.0
    poll: float = 0.2
    fetch: float = 0.005
    sound_start: float = 6.0
    sound: float = 2.0


WAITS = Waits()
