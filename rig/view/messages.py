"""What session, screen and page say to one another. All of it is JSON with fixed fields; anything else is refused."""

from __future__ import annotations

from typing import Literal

import msgspec

from isorig.rig.acquire.notes import Note
from isorig.rig.view.run_list import Planned

#: What an operator may ask of a session.
Wish = Literal["stop", "again", "next", "note"]


class Message(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Anything that is said."""


class Begin(Message, frozen=True):
    """What a session's screen is about: the recording, and the runs of the plan."""

    output: str
    planned: tuple[Planned, ...]


class Asked(Message, frozen=True, tag="asked", tag_field="say"):
    """A button was pressed: what for, on which run the page showed it, and a note's text."""

    do: Wish
    run: str
    text: str = ""


class Drawn(Message, frozen=True, tag="drawn", tag_field="say"):
    """The page has drawn a frame: its number, and how many values it held."""

    frame: int
    values: int


class Judgement(Message, frozen=True):
    """How the session judged a run right after it was taken."""

    good: bool
    advice: tuple[str, ...]


class Standing(Message, frozen=True):
    """How a session stands.

    Parameters
    ----------
    phase
        "begins", "asks" (it waits for the operator before a run), "looks" (the look before a run), "measures", "finishes" (all
        runs are taken and it waits for the operator), or "over".
    run
        The run that lasts or is asked for; the last one where all are taken.
    last
        The run that was taken last.
    may
        What the operator may ask for now.
    text
        What it waits for, or why it is over.
    judged
        How each run that was taken was judged.
    stopped
        Runs that the operator stopped.
    seconds
        How long the present run has lasted.
    overloads, damaged
        Blocks of the present run that came with an overload, frames that were damaged on the way.
    notes
        What was noted.
    """

    phase: Literal["begins", "asks", "looks", "measures", "finishes", "over"] = "begins"
    run: str = ""
    last: str = ""
    may: tuple[Wish, ...] = ()
    text: str = ""
    judged: dict[str, Judgement] = {}
    stopped: tuple[str, ...] = ()
    seconds: float = 0.0
    overloads: int = 0
    damaged: int = 0
    notes: tuple[Note, ...] = ()
