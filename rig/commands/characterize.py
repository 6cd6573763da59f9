"""rig characterize: the rig's parameters with standard deviations."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def characterize(campaign: Path, *, output: Annotated[Path, Parameter(name=["-o", "--output"])]) -> None:
    """Fit masses, frequencies, damping ratios and friction to all runs, and write the parameter table.

    The thesis's own readings, set-up by set-up, stand beside the joint fit.

    Example: rig characterize campaign.h5 -o parameters

    Parameters
    ----------
    campaign
        A recording of the wire bonder, locked and unlocked.
    output
        The folder for parameters.json, parameters.csv, the fitted model.json, fits.html with every fit over its data,
        set-ups.png and error-surface.png.
    """
    from rich.console import Console

    from rig.characterized import characterize_campaign, write_characterization
    from rig.recording import read
    from rig.set_ups import about, write_set_ups
    from rig.terminal import show_table

    measured = read(campaign)
    with Console(stderr=True).status("reading") as status:
        found = characterize_campaign(measured, status.update)
        status.update("reading the set-ups one by one")
        read_off = about(write_set_ups(output, measured, found))
    path = write_characterization(output, measured, found, {"set_ups": read_off})
    rows = [
        (name, "–" if e.value is None else f"{e.value:.6g}", "–" if e.std is None else f"{e.std:.2g}", e.unit, e.method, e.note)
        for name, e in found.table.items()
    ]
    title = f"{campaign.name}: held-out error {100 * found.error:.2g} % of the signal, noise alone {100 * found.floor:.2g} %"
    show_table(title, ("parameter", "value", "std", "unit", "method", "note"), rows)
    for fault in found.faults:
        print(fault.text)
    print(path)
