"""Shows a session or a recording in the browser."""

from pathlib import Path


def view(
    campaign: Path, *, plan: Path | None = None, replay: bool = False, speed: float = 1.0, seconds: float | None = None
) -> None:
    """Show a session that runs in another terminal, or a recording, on a page in the browser of this computer.

    The page is served on the loopback interface only, at the printed address. It is read-only: the buttons that control a session
    are on the session's own page, served by rig acquire --view.

    Example: rig view campaign.h5 --replay

    Parameters
    ----------
    campaign
        The recording given to rig acquire -o, or any recording.
    plan
        The session's plan: the page then shows the number of runs and their duration.
    replay
        Play the recording back as it was measured.
    speed
        Speed of the playback relative to real time.
    seconds
        Seconds for which the page is served; by default until Ctrl-C.
    """
    import math
    import sys
    import time

    from isorig.rig.acquire.notes import notes_in, separate_notes
    from isorig.rig.acquire.plan_check import read_plan
    from isorig.rig.acquire.recorder import working_file
    from isorig.rig.errors import PlanError, RecordingError
    from isorig.rig.files.recording import open_recording
    from isorig.rig.view.messages import planned_as, planned_by
    from isorig.rig.view.server import ScreenServer
    from isorig.rig.view.sources import replayed, watched
    from isorig.rig.view.state import Subject

    if not (math.isfinite(speed) and speed > 0.0):
        raise PlanError(f"--speed is {speed:g}; give a number above 0")
    if seconds is not None and not seconds > 0.0:
        raise PlanError(f"--seconds is {seconds:g}; give a number above 0")
    if not campaign.exists() and (replay or not working_file(campaign).exists()):
        raise RecordingError(f"{campaign} does not exist and no session writes it; give the -o of a session or a recording")
    planned = () if plan is None else planned_by(read_plan(plan))
    if campaign.exists():
        with open_recording(campaign) as recorded:
            if replay:
                planned = planned_as(recorded.runs)
    readings = replayed(campaign, speed) if replay else watched(campaign, lambda: False)
    notes = tuple(dict.fromkeys([*notes_in(campaign), *separate_notes(campaign)]))
    subject = Subject(title=campaign.name, mode="replay" if replay else "watch", planned=planned, notes=notes)
    end = math.inf if seconds is None else time.monotonic() + seconds
    try:
        drawn = ScreenServer(subject, readings).run(lambda: time.monotonic() > end, lambda address: print(address, flush=True))
    except KeyboardInterrupt:
        return
    shown = f"{drawn.frames} frames with {drawn.values} values were drawn" if drawn.frames else "no browser had the page open"
    print(shown, file=sys.stderr)
