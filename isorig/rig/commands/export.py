"""Writes a recording in other formats."""

from pathlib import Path
from typing import Literal

from isorig.rig.options import Flag, Output


def export(
    source: Path,
    *,
    output: Output,
    what: Literal["samples", "frf"] = "samples",
    run: tuple[str, ...] = (),
    reference: str | None = None,
    resolution: float = 0.25,
    text: Flag = False,
) -> None:
    """Export a recording's samples or transfer functions, or a parameter table, in the format given by the output's extension.

    .mat is MATLAB, .uff the universal file format (58b, or 58 with --text), .csv and .parquet are tables. Samples as a table
    become one file for each run, with the run's id appended to the name if there are several.

    Example: rig export campaign.h5 --what frf -o frf.uff

    Parameters
    ----------
    source
        A recording, or a parameters.json or findings.json with a table to export.
    output
        The file to write.
    what
        Samples in SI units, or transfer functions.
    run
        Only these runs; by default all.
    reference
        Reference channel of transfer functions; by default the first drive of the rig's description.
    resolution
        Frequency resolution of transfer functions, Hz.
    text
        Write universal files as text instead of binary.
    """
    from isorig.rig.exchange.exporting import export_campaign, export_parameters

    if source.suffix.lower() == ".json":
        written = export_parameters(source, output)
    else:
        written = export_campaign(
            source, output, what=what, runs=run, reference=reference, resolution=resolution, binary=not text
        )
    print(*written, sep="\n")
