"""rig diagnose: what the simulation gets wrong, and the cause by name."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from rich.status import Status


def _tell(status: Status, name: str, text: str) -> None:
    status.update(f"{name}: {text}")


def diagnose(
    *campaigns: Path,
    output: Annotated[Path, Parameter(name=["-o", "--output"])],
    baseline: Literal["coulomb", "linear"] = "coulomb",
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
    """
    from rich.console import Console

    from analysis.diagnose.diagnosis import diagnose as run_diagnosis
    from rig.baseline import baseline_model
    from rig.errors import RecordingError
    from rig.findings import write_findings
    from rig.output import write_text
    from rig.recording import read

    files = [f for given in campaigns for f in (sorted(given.glob("*.h5")) if given.is_dir() else [given])]
    if not files:
        raise RecordingError("no recording was given; name a file or a folder that holds .h5 files")
    console = Console(stderr=True)
    lines = ["campaign,verdict,causes,locations,holdout_baseline,holdout_extended,noise_floor"]
    for file in files:
        campaign = read(file)
        folder = output / file.stem if len(files) > 1 or campaigns[0].is_dir() else output
        with console.status(f"{file.name}: reading") as status:
            found = run_diagnosis(
                campaign,
                baseline_model(campaign, baseline),
                progress=partial(_tell, status, file.name),
            )
            status.update(f"{file.name}: writing the report")
            write_findings(folder, found, campaign, baseline)
        named = ", ".join(f"{s.cause} at {s.location}" for s in found.steps) or "no cause named"
        print(
            f"{file.name}: {found.verdict}; {named}; held-out error {found.baseline_error:.3g} -> "
            f"{found.extended_error:.3g} (noise floor {found.floor:.3g})"
        )
        print(f"  {folder / 'report.html'}")
        lines.append(
            f"{file.stem},{found.verdict},{'+'.join(s.cause for s in found.steps)},"
            f"{'+'.join(s.location for s in found.steps)},{found.baseline_error:.6g},{found.extended_error:.6g},{found.floor:.6g}"
        )
    if len(files) > 1 or campaigns[0].is_dir():
        print(write_text(output / "summary.csv", "\n".join(lines) + "\n"))
