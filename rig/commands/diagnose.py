"""rig diagnose: what the simulation gets wrong, and the cause by name."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

if TYPE_CHECKING:
    from rig.many import Outcome


def diagnose(
    *campaigns: Path,
    output: Annotated[Path, Parameter(name=["-o", "--output"])],
    baseline: Literal["coulomb", "linear"] = "coulomb",
    scheduler: str | None = None,
    again: bool = False,
) -> None:
    """Show what the baseline's simulation gets wrong, name the cause, extend the model and measure the gain.

    Example: rig diagnose campaign.h5 -o diagnosis

    Parameters
    ----------
    campaigns
        Recordings, or one folder of them.
    output
        The folder for findings.json, baseline.json, model.json and report.html; of several recordings each gets
        a folder of its own in it, and summary.csv tells of all.
    baseline
        The wire bonder with Coulomb friction, or without any.
    scheduler
        Of several recordings: the address of a Dask scheduler that shares them out; its workers must see the same files.
    again
        Of several recordings: also those that have an answer already.
    """
    from rich.console import Console

    from rig.errors import RecordingError
    from rig.many import diagnose_file, diagnose_files, recordings_in, summary
    from rig.output import write_text

    files = recordings_in(campaigns)
    console = Console(stderr=True)
    if len(files) == 1 and not campaigns[0].is_dir():
        with console.status(f"{files[0].name}: reading") as status:
            _say(diagnose_file(files[0], output, baseline, lambda text: status.update(f"{files[0].name}: {text}")), output)
        return
    outcomes: list[Outcome] = []
    with console.status(f"0 of {len(files)} recordings diagnosed") as status:
        for outcome in diagnose_files([(f, output / f.stem) for f in files], baseline, scheduler=scheduler, again=again):
            outcomes.append(outcome)
            status.update(f"{len(outcomes)} of {len(files)} recordings diagnosed")
            _say(outcome, output / outcome.campaign)
            write_text(output / "summary.csv", summary(outcomes))
    print(output / "summary.csv")
    refused = [o for o in outcomes if o.refusal]
    if refused:
        raise RecordingError(f"{len(refused)} of {len(files)} recordings could not be used; first: {refused[0].refusal}")


def _say(outcome: Outcome, folder: Path) -> None:
    if outcome.refusal:
        print(f"{outcome.campaign}: refused; {outcome.refusal}")
        return
    pairs = zip(outcome.causes.split("+"), outcome.locations.split("+"), strict=True)
    named = ", ".join(f"{cause} at {place}" for cause, place in pairs if cause) or "no cause named"
    print(
        f"{outcome.campaign}: {outcome.verdict}; {named}; held-out error {outcome.holdout_baseline:.3g} -> "
        f"{outcome.holdout_extended:.3g} (noise floor {outcome.noise_floor:.3g})"
    )
    print(f"  {folder / 'report.html'}")
