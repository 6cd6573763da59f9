"""rig fleet: every recording of many rigs diagnosed once, every parameter followed, the day a rig changed named."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter

if TYPE_CHECKING:
    from isorig.rig.fleet.catalogue import Answer

app = App(name="fleet", help="Every recording of many rigs diagnosed once, every parameter followed, each change dated.")

Where = Annotated[Path, Parameter(name=["-c", "--catalogue"])]
Baseline = Literal["coulomb", "linear"]
HERE = Path("fleet")


@app.command
def add(*folders: Path, rig: str | None = None, catalogue: Where = HERE) -> None:
    """Add folders of recordings; rig fleet update diagnoses what is in them and below.

    A recording is of the rig that its folder is named after: measurements/rig-07/2026-03-02.h5 is of rig-07.

    Example: rig fleet add measurements

    Parameters
    ----------
    folders
        Folders of recordings.
    rig
        The rig that all recordings in these folders are of.
    catalogue
        The folder of the fleet's files.
    """
    from isorig.rig.errors import RigError
    from isorig.rig.fleet.catalogue import Catalogue
    from isorig.rig.fleet.recordings import recordings_under

    if not folders:
        raise RigError("no folder was given; name at least one that holds recordings")
    missing = next((folder for folder in folders if not folder.is_dir()), None)
    if missing is not None:
        raise RigError(f"{missing} is no folder; name a folder that holds recordings")
    for folder in folders:
        place = folder.resolve()
        Catalogue(catalogue).add_folder(place, rig)
        found = list(recordings_under({place: rig}))
        print(f"{folder}: {len(found)} recordings of {len({r.rig for r in found})} rigs")


@app.command
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
    false_alarms: float = 1.0,
) -> None:
    """Diagnose every recording that has no answer from this version of the program yet.

    It may be broken off at any time and run twice at once; what is stored stays. A recording that cannot be used is told, and the
    rest goes on.

    Parameters
    ----------
    catalogue
        The folder of the fleet's files.
    baseline
        The wire bonder with Coulomb friction, or without any.
    scheduler
        Dask scheduler that shares the work out, by its address or the file that it writes; its workers must see the same files.
    seconds
        Time limit for one recording: the search for causes ends then, and the answer says that it is partial.
    pages
        Write each diagnosis's report.html too, about 1.5 MB each.
    again
        Try those again that failed or took too long.
    reread
        Read every file to see whether it changed, not only those of another size or time of modification.
    explain
        Look for the causes of changes as well.
    false_alarms
        False alarms that the whole fleet may raise in a month.
    """
    from rich.console import Console

    from isorig.rig.diagnose_many import time_limit
    from isorig.rig.errors import RecordingError
    from isorig.rig.fleet.catalogue import Catalogue
    from isorig.rig.fleet.change_causes import look
    from isorig.rig.fleet.sentences import answer_words
    from isorig.rig.fleet.update import update, work_of

    limit = time_limit(seconds)
    store = Catalogue(catalogue).existing()
    work = work_of(store, baseline, limit=limit, pages=pages, again=again, reread=reread)
    for note in work.notes:
        print(note)
    done = 0
    with Console(stderr=True).status(f"0 of {len(work.jobs)} recordings diagnosed") as status:

        def tell(answer: Answer) -> None:
            nonlocal done
            done += 1
            status.update(f"{done} of {len(work.jobs)} recordings diagnosed")
            print(answer_words(answer), flush=True)

        updated = update(store, work.jobs, scheduler=scheduler, tell=tell)
        status.update("looking for changes")
        for line in look(store, baseline, scheduler=scheduler, false_per_month=false_alarms) if explain else ():
            print(line, flush=True)
    print(f"{work.known} recordings had an answer, {updated.done} were looked at now")
    if updated.without:
        first = updated.without[0].reason
        raise RecordingError(f"{len(updated.without)} of {len(work.jobs)} recordings gave no answer; first: {first}")


@app.command
def show(
    *,
    rig: str | None = None,
    parameter: str | None = None,
    catalogue: Where = HERE,
    baseline: Baseline = "coulomb",
    false_alarms: float = 1.0,
) -> None:
    """Show the fleet: all rigs, one rig, one parameter of all rigs, or one parameter of one rig campaign by campaign.

    Example: rig fleet show --rig rig-07 --parameter "friction force of isolation"

    Parameters
    ----------
    rig
        One rig.
    parameter
        One parameter, by its path or by the words that it is shown with.
    catalogue
        The folder of the fleet's files.
    baseline
        The diagnoses to show.
    false_alarms
        False alarms that the whole fleet may raise in a month.
    """
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
        show_fleet(fleet, print)
    explained = store.changes()
    for incident in fleet.incidents:
        if rig in (None, incident.rig):
            print(incident_words(fleet, incident, explained.get(name_of(fleet, incident))))


@app.command
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
    """Diagnose new recordings in a folder and below as they come, and tell each change of a rig.

    A file is taken once it has stopped growing. It goes on until it is interrupted.

    Example: rig fleet watch measurements

    Parameters
    ----------
    folder
        Folder of recordings; it is added to the fleet.
    rig
        The rig that all recordings in it are of.
    catalogue
        The folder of the fleet's files.
    baseline
        The wire bonder with Coulomb friction, or without any.
    scheduler
        Dask scheduler that shares the work out, by its address or the file that it writes.
    seconds
        Time limit for one recording: the search for causes ends then, and the answer says that it is partial.
    every
        Seconds between looks.
    stop_after
        Seconds after which it ends.
    """
    from functools import partial

    from isorig.rig.diagnose_many import time_limit
    from isorig.rig.errors import RigError
    from isorig.rig.fleet.catalogue import Catalogue
    from isorig.rig.fleet.watch import watch as watched

    if not every > 0.0:
        raise RigError(f"--every is {every:g} s; give a positive time between looks")
    limit = time_limit(seconds)
    add(folder, rig=rig, catalogue=catalogue)
    watched(
        Catalogue(catalogue), {folder.resolve(): rig}, baseline, limit=limit, scheduler=scheduler, every=every,
        seconds=stop_after, tell=partial(print, flush=True),
    )  # fmt: skip


@app.command
def report(
    *,
    output: Annotated[Path, Parameter(name=["-o", "--output"])],
    catalogue: Where = HERE,
    baseline: Baseline = "coulomb",
    false_alarms: float = 1.0,
) -> None:
    """Write one page about the fleet that works offline: what changed, all rigs at a glance, and a page for each rig.

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
        False alarms that the whole fleet may raise in a month.
    """
    from isorig.rig.files.output import write_text
    from isorig.rig.fleet.catalogue import Catalogue
    from isorig.rig.fleet.history import followed
    from isorig.rig.fleet.report import fleet_page

    store = Catalogue(catalogue).existing()
    fleet = followed(store.answers(), baseline, false_per_month=false_alarms)
    print(write_text(output, fleet_page(fleet, store.changes())))


@app.command
def sql(query: str, /, *, catalogue: Where = HERE) -> None:
    """Ask the catalogue in SQL and print the rows as CSV; the table is called answers. Needs DuckDB.

    Example: rig fleet sql "select rig, count(distinct content) from answers group by rig"

    Parameters
    ----------
    query
        A query in DuckDB's SQL.
    catalogue
        The folder of the fleet's files.
    """
    from isorig.rig.fleet.catalogue import Catalogue
    from isorig.rig.fleet.query import asked

    print(asked(Catalogue(catalogue).existing(), query), end="")
