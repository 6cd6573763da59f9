"""rig characterize: the rig's parameters with standard deviations."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def characterize(campaign: Path, *, output: Annotated[Path, Parameter(name=["-o", "--output"])]) -> None:
    """Fit masses, frequencies, damping ratios and friction to all runs, and write the parameter table.

    Example: rig characterize campaign.h5 -o parameters

    Parameters
    ----------
    campaign
        A recording of the wire bonder, locked and unlocked.
    output
        The folder for parameters.json and parameters.csv.
    """
    import msgspec
    from rich.console import Console
    from rich.table import Table

    from analysis.characterize import characterize as estimate
    from rig.baseline import baseline_model
    from rig.errors import RecordingError
    from rig.output import write_json, write_text
    from rig.recording import read

    measured = read(campaign)
    if measured.description is not None:
        raise RecordingError(f"{campaign} is of another rig; rig characterize knows the wire bonder, use rig diagnose")
    with Console(stderr=True).status("reading") as status:
        found = estimate(measured, baseline_model(measured), progress=status.update)
    table = {name: msgspec.to_builtins(entry) for name, entry in found.table.items()}
    write_json(output / "parameters.json", {"format": "rig-parameters", "format_version": 1, "parameters": table})
    lines = ["name,value,std,unit,method,note"]
    shown = Table(title=f"{campaign.name}: held-out error {100 * found.error:.2g} % of the signal", title_justify="left")
    for column in ("parameter", "value", "std", "unit", "method", "note"):
        shown.add_column(column)
    for name, entry in found.table.items():
        value, std = ("" if x is None else f"{x:.8g}" for x in (entry.value, entry.std))
        lines.append(f'{name},{value},{std},{entry.unit},{entry.method},"{entry.note}"')
        short = "" if entry.value is None else f"{entry.value:.6g}"
        shown.add_row(name, short, "" if entry.std is None else f"{entry.std:.2g}", entry.unit, entry.method, entry.note)
    write_text(output / "parameters.csv", "\n".join(lines) + "\n")
    Console().print(shown)
    print(output / "parameters.json")
