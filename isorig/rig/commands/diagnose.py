"""What the simulation gets wrong, and the identified cause."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from isorig.rig.choices import TIME_LIMIT, Baseline
from isorig.rig.options import OutputFolder

if TYPE_CHECKING:
    from isorig.rig.diagnose.many import CampaignOutcome


def diagnose(
    *campaigns: Path,
    output: OutputFolder,
    baseline: Baseline = "coulomb",
    tolerance: float = 0.0,
    seconds: float = TIME_LIMIT,
    scheduler: str | None = None,
    again: bool = False,
) -> None:
    """Show what the baseline's simulation gets wrong, identify the cause, extend the model and measure the improvement.

    Example: rig diagnose campaign.h5 -o diagnosis

    Parameters
    ----------
    campaigns
        Recordings, or one folder of them.
    output
        The folder for findings.json, baseline.json, model.json and report.html; several recordings get one folder each in it, and
        summary.csv lists all of them.
    baseline
        The wire bonder with Coulomb friction, or without any.
    tolerance
        Error, as a share of the signal, that counts as adequate: with 0.05, a baseline with an error below 5 % is adequate.
    seconds
        Limit of processor time for one recording: the search for causes then ends with a partial answer; inf for no limit.
    scheduler
        For several recordings: the Dask scheduler that distributes them, by its address or the file that it writes; its workers
        must see the same files.
    again
        For several recordings: diagnose also those that already have an answer.
    """
    from rich.console import Console

    from isorig.rig.diagnose.many import diagnose_file, diagnose_files, recordings_in, summary, time_limit, tolerated
    from isorig.rig.errors import RecordingError
    from isorig.rig.files.output import write_text

    tolerance, limit = tolerated(tolerance), time_limit(seconds)
    files = recordings_in(campaigns)
    console = Console(stderr=True)
    if len(files) == 1 and not campaigns[0].is_dir():
        with console.status(f"{files[0].name}: reading") as status:
            outcome = diagnose_file(
                files[0], output, baseline, lambda text: status.update(f"{files[0].name}: {text}"),
                tolerance=tolerance, limit=limit,
            )  # fmt: skip
        _print_answer(outcome, output)
        return
    outcomes: list[CampaignOutcome] = []
    with console.status(f"0 of {len(files)} recordings diagnosed") as status:
        jobs = [(f, output / f.stem) for f in files]
        for outcome in diagnose_files(jobs, baseline, scheduler=scheduler, again=again, tolerance=tolerance, limit=limit):
            outcomes.append(outcome)
            status.update(f"{len(outcomes)} of {len(files)} recordings diagnosed")
            _print_outcome(outcome, output / outcome.campaign)
            write_text(output / "summary.csv", summary(outcomes))
    print(output / "summary.csv")
    refused = [o for o in outcomes if o.refusal]
    if refused:
        raise RecordingError(f"{len(refused)} of {len(files)} recordings could not be used; first: {refused[0].refusal}")


def _print_outcome(outcome: CampaignOutcome, folder: Path) -> None:
    from isorig.rig.model.baseline import CHECK_FIRST

    if outcome.refusal:
        print(f"{outcome.campaign}: refused; {outcome.refusal}")
        return
    if outcome.doubts:
        print(f"{outcome.campaign}: {CHECK_FIRST} {outcome.doubts}")
    print(f"{outcome.campaign}: {outcome.answer}")
    print(f"  {folder / 'report.html'}")


def _print_answer(outcome: CampaignOutcome, folder: Path) -> None:
    from isorig.rig.files.findings import read_findings
    from isorig.rig.report.conclusion import conclude

    found = read_findings(folder)
    said = conclude(found, str(folder))
    _print_outcome(outcome, folder)
    print(*filter(None, [said.ruled_out, *found.remarks, said.next]), sep="\n")
