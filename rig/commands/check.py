"""rig check: is this a sound recording, and what is in it."""

from __future__ import annotations

from pathlib import Path


def check(*files: Path) -> None:
    """List the runs of recordings, and refuse files that are not sound.

    Example: rig check campaign.h5

    Parameters
    ----------
    files
        Recordings to check, sample by sample.
    """
    import numpy as np
    from rich.console import Console
    from rich.table import Table

    from rig.errors import RecordingError
    from rig.recording import read

    if not files:
        raise RecordingError("no file was given; name at least one recording")
    console = Console()
    for file in files:
        campaign = read(file)
        table = Table(title=str(file), title_justify="left")
        for column in (
            "run",
            "configuration",
            "gain",
            "excitation",
            "s",
            "Hz",
            "channel",
            "rms",
            "peak",
            "clipped",
        ):
            table.add_column(column, justify="right" if column in ("gain", "s", "Hz", "rms", "peak") else "left")
        for run in campaign.runs:
            first = True
            for name, channel in run.channels.items():
                values = channel.read()
                peak = float(np.abs(values).max())
                clipped = int((np.abs(values) >= channel.full_scale * (1 - 1e-6)).sum()) if channel.full_scale else None
                lead = (
                    (
                        run.id,
                        run.configuration,
                        f"{run.gain:g}",
                        run.excitation,
                        f"{run.duration:.1f}",
                        f"{run.sample_rate:g}",
                    )
                    if first
                    else ("",) * 6
                )
                told = "unknown" if clipped is None else f"{clipped} samples" if clipped else "no"
                table.add_row(*lead, name, f"{values.std():.4g} {channel.unit}", f"{peak:.4g}", told)
                first = False
            lost = sum(gap.count for gap in run.gaps)
            if lost:
                table.add_row(run.id, "", "", "", "", "", "gaps", f"{lost} samples lost", "", "")
        console.print(table)
