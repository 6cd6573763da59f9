"""Many rigs over many campaigns: what changed, when, and why."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from isorig.rig.choices import Baseline
from isorig.rig.options import Output

if TYPE_CHECKING:
    from isorig.rig.fleet.catalogue import StoredAnswer

fleet = App(name="fleet", help="Diagnoses every recording of many rigs once, tracks every parameter, dates each change.")

Where = Annotated[Path, Parameter(name=["-c", "--catalogue"])]
HERE = Path("fleet")


@fleet.command
def add(*folders: Path, rig: str | None = None, catalogue: Where = HERE) -> None:
    """Add folders of recordings; rig fleet update diagnoses the recordings in them and in their subfolders.

    The name of a recording's folder is the name of its rig: measurements/rig-07/2026-03-02.h5 is of rig-07.

    Example: rig fleet add measurements

    Parameters
    ----------
    folders
        Folders of recordings.
    rig
        The rig of all recordings in these folders.
    catalogue
        The folder of the fleet's files.
    """
    from isorig.rig.errors import RigError
    from isorig.rig.fleet.catalogue import Catalogue
    from isorig.rig.fleet.recordings import recordings_under

    if not folders:
        raise RigError("no folder was given; give at least one that contains recordings")
    missing = next((folder for folder in folders if not folder.is_dir()), None)
    if missing is not None:
        raise RigError(f"{missing} is not a folder; give a folder that contains recordings")
    for folder in folders:
        place = folder.resolve()
        Catalogue(catalogue).add_folder(place, rig)
        found = list(recordings_under({place: rig}))
        rigs = len({recording.rig for recording in found})
        print(f"{folder}: {len(found)} recording{'s' * (len(found) != 1)} of {rigs} rig{'s' * (rigs != 1)}")


@fleet.command
def update(
    *,
    catalogue: Where = HERE,
    baseline: Baseline = "coulomb",
    scheduler: str | None = None,
    seconds: float | None = None,
    pages: bool = False,
    again: bool = False,
    reread: bool = False,
    explain: bool = True,
    false_alarms: float | None = None,
) -> None:
    """Diagnose every recording without an answer from this version of the program.

    An update may be interrupted at any time and run twice at once; stored answers are kept. A recording that cannot be used is
    reported, and the others are processed.

    Parameters
    ----------
    catalogue
        The folder of the fleet's files.
    baseline
        The wire bonder with Coulomb friction, or without any.
    scheduler
        Dask scheduler that distributes the work, by its address or the file that it writes; its workers must see the same files.
    seconds
        Time limit for one recording: the search for causes then ends with a partial answer.
    pages
        Write the report.html of each diagnosis too, about 1.5 MB each.
    again
        Repeat those that failed or took too long.
    reread
        Read every file to check for changes, not only those with a new size or modification time.
    explain
        Search for the causes of changes as well.
    false_alarms
        Allowed false alarms per month in the whole fleet; by default one, and one in four years for each rig of a small fleet.
    """
    from rich.console import Console

    from isorig.rig.diagnose.many import time_limit
    from isorig.rig.errors import RecordingError
    from isorig.rig.files.output import displayable
    from isorig.rig.fleet.catalogue import WITHOUT, Catalogue
    from isorig.rig.fleet.change_causes import search_causes
    from isorig.rig.fleet.sentences import answer_words
    from isorig.rig.fleet.update import update, work_of

    limit = time_limit(seconds)
    store = Catalogue(catalogue).existing()
    work = work_of(store, baseline, limit=limit, pages=pages, again=again, reread=reread)
    for note in work.notes:
        print(displayable(note))
    done = 0
    with Console(stderr=True).status(f"0 of {len(work.jobs)} recordings diagnosed") as status:

        def tell(answer: StoredAnswer) -> None:
            nonlocal done
            done += 1
            status.update(f"{done} of {len(work.jobs)} recordings diagnosed")
            print(displayable(answer_words(answer)), flush=True)

        answers = update(store, work.jobs, scheduler=scheduler, tell=tell)
        status.update("searching for changes")
        for line in search_causes(store, baseline, scheduler=scheduler, false_per_month=false_alarms) if explain else ():
            print(displayable(line), flush=True)
    print(f"{work.known} recordings had an answer, {len(answers)} were processed now")
    without = [answer.reason for answer in answers if answer.verdict in WITHOUT]
    if without:
        raise RecordingError(f"{len(without)} of {len(work.jobs)} recordings gave no answer; first: {without[0]}")


@fleet.command
def show(
    *,
    rig: str | None = None,
    parameter: str | None = None,
    catalogue: Where = HERE,
    baseline: Baseline = "coulomb",
    false_alarms: float | None = None,
) -> None:
    """Show the fleet: all rigs, one rig, one parameter of all rigs, or one parameter of one rig campaign by campaign.

    Example: rig fleet show --rig rig-07 --parameter "friction force of isolation"

    Parameters
    ----------
    rig
        One rig.
    parameter
        One parameter, by its path or its displayed name.
    catalogue
        The folder of the fleet's files.
    baseline
        The diagnoses to show.
    false_alarms
        Allowed false alarms per month in the whole fleet; by default one, and one in four years for each rig of a small fleet.
    """
    from isorig.rig.files.output import displayable
    from isorig.rig.fleet.catalogue import Catalogue
    from isorig.rig.fleet.change_causes import name_of
    from isorig.rig.fleet.history import followed
    from isorig.rig.fleet.sentences import incident_words
    from isorig.rig.fleet.show import show_fleet, show_parameter, show_rig

    store = Catalogue(catalogue).existing()
    fleet = followed(store.answers(), baseline, false_per_month=false_alarms)
    if parameter is not None:
        show_parameter(fleet, parameter, rig)
        return
    if rig is not None:
        show_rig(fleet, rig)
    else:
        show_fleet(fleet, lambda line: print(displayable(line)))
    explained = store.changes()
    for incident in fleet.incidents:
        if rig in (None, incident.rig):
            print(displayable(incident_words(fleet, incident, explained.get(name_of(fleet, incident)))))


@fleet.command
def watch(
    folder: Path,
    /,
    *,
    rig: str | None = None,
    catalogue: Where = HERE,
    baseline: Baseline = "coulomb",
    scheduler: str | None = None,
    seconds: float | None = None,
    every: float = 10.0,
    stop_after: float | None = None,
) -> None:
    """Diagnose new recordings in a folder and its subfolders as they arrive, and report each change of a rig.

    A file is used once it has stopped growing. The command runs until it is interrupted.

    Example: rig fleet watch measurements

    Parameters
    ----------
    folder
        Folder of recordings; it is added to the fleet.
    rig
        The rig of all recordings in it.
    catalogue
        The folder of the fleet's files.
    baseline
        The wire bonder with Coulomb friction, or without any.
    scheduler
        Dask scheduler that distributes the work, by its address or the file that it writes.
    seconds
        Time limit for one recording: the search for causes then ends with a partial answer.
    every
        Seconds between two readings of the folder.
    stop_after
        Total duration, seconds.
    """
    from isorig.rig.diagnose.many import time_limit
    from isorig.rig.errors import RigError
    from isorig.rig.files.output import displayable
    from isorig.rig.fleet.catalogue import Catalogue
    from isorig.rig.fleet.update import watch as watched

    if not every > 0.0:
        raise RigError(f"--every is {every:g} s; give a positive time")
    limit = time_limit(seconds)
    add(folder, rig=rig, catalogue=catalogue)
    watched(
        Catalogue(catalogue), {folder.resolve(): rig}, baseline, limit=limit, scheduler=scheduler, every=every,
        seconds=stop_after, tell=lambda line: print(displayable(line), flush=True),
    )  # fmt: skip


@fleet.command
def report(*, output: Output, catalogue: Where = HERE, baseline: Baseline = "coulomb", false_alarms: float | None = None) -> None:
    """Write one page about the fleet that works offline: changes, an overview of all rigs, and a page for each rig.

    Example: rig fleet report -o fleet.html

    Parameters
    ----------
    output
        The HTML file to write.
    catalogue
        The folder of the fleet's files.
    baseline
        The diagnoses to report.
    false_alarms
        Allowed false alarms per month in the whole fleet; by default one, and one in four years for each rig of a small fleet.
    """
    from isorig.rig.files.output import write_text
    from isorig.rig.fleet.catalogue import Catalogue
    from isorig.rig.fleet.history import followed
    from isorig.rig.fleet.report import fleet_page

    store = Catalogue(catalogue).existing()
    fleet = followed(store.answers(), baseline, false_per_month=false_alarms)
    print(write_text(output, fleet_page(fleet, store.changes())))


@fleet.command
def sql(query: str, /, *, catalogue: Where = HERE) -> None:
    """Query the catalogue in SQL and print the rows as CSV; the table is named answers. Needs DuckDB.

    Example: rig fleet sql "select rig, count(distinct content) from answers group by rig"

    Parameters
    ----------
    query
        A query in DuckDB's SQL.
    catalogue
        The folder of the fleet's files.
    """
    from isorig.rig.fleet.catalogue import Catalogue, query_answers

    print(query_answers(Catalogue(catalogue).existing(), query), end="")
