"""How long a session waits: one object, handed to the session."""

from __future__ import annotations

from dataclasses import dataclass

from isorig.drivers.waits import WAITS, Waits


@dataclass(frozen=True, kw_only=True)
class SessionWaits:
    """Timeouts of a session in seconds, chosen."""

    silence: float = 2.0  #: Without a sample, after which an instrument that counts is asked for its count.
    #: For which a connection may be lost or silent and then be continued; between two attempts.
    reconnection: float = 15.0
    retry: float = 0.2
    transit: float = 5.0  #: Within which a stopped instrument must have sent all data in transit.
    missing: float = 1.0  #: Of samples that may be missing at the end of a run without being waited for.
    #: Of samples that may wait for a slow disk; without progress, after which the disk counts as stuck.
    queue: float = 5.0
    disk: float = 10.0
    drivers: Waits = WAITS  #: Those of the drivers.


SESSION_WAITS = SessionWaits()
