"""Restores the data of a killed session."""

from pathlib import Path

from isorig.rig.options import Output


def recover(working: Path, *, output: Output) -> None:
    """Make a recording of the working file left by an interrupted session, and report what was saved and lost.

    Example: rig recover campaign.h5.partial -o recovered.h5

    Parameters
    ----------
    working
        The working file; its name ends in .partial. It is not changed.
    output
        The recording to write.
    """
    from isorig.rig.acquire.notes import settle_notes
    from isorig.rig.acquire.store import keep_recovered

    print(*(item.text for item in keep_recovered(working, output)), sep="\n")
    settle_notes(output, session=working.with_name(working.name.removesuffix(".partial")))
    print(output)
