"""Masses, natural frequencies, damping ratios, friction."""

from collections import Counter
from pathlib import Path
from typing import Any

from isorig.rig.options import OutputFolder


def characterize(campaign: Path, *, output: OutputFolder, model: str | None = None) -> None:
    """Fit a rig's free parameters to all runs, and write the parameter table with standard uncertainties.

    For the wire bonder these are masses, frequencies, damping ratios and friction, and the values from the thesis's method for
    each set-up. For another rig they are the parameters of its description, and the frequency and damping ratio of its modes.

    Example: rig characterize campaign.h5 -o parameters

    Example: rig characterize campaign.h5 --model diagnosis/model.json -o corrected

    Parameters
    ----------
    campaign
        A recording; for the wire bonder with locked and unlocked runs.
    output
        The folder for parameters.json, parameters.csv, the fitted model.json, fits.html with every fit and its data, and for
        the wire bonder set-ups.png and error-surface.png.
    model
        The model to fit instead of the recording's own rig: the model.json of rig diagnose, whose corrected values and causes
        are fitted again and listed by their paths, or a description.
    """
    from rich.console import Console

    from isorig.analysis.spectra.quality import fault_sentences
    from isorig.analysis.wording import of_signal, sized
    from isorig.rig.files.output import write_text
    from isorig.rig.files.parameter_table import characterize_campaign, drive_levels, write_characterization
    from isorig.rig.files.recording import read
    from isorig.rig.files.rigfile import read_rig
    from isorig.rig.model.baseline import CHECK_FIRST
    from isorig.rig.process.terminal import show_table
    from isorig.rig.report.measurement import fits_page
    from isorig.rig.report.sections import with_unit
    from isorig.rig.wire_bonder.set_ups_page import set_ups_content, write_set_ups

    measured = read(campaign)
    given = None if model is None else read_rig(model)
    with Console(stderr=True).status("reading") as status:
        found = characterize_campaign(measured, status.update, given)
        if found.head_mass is None or given is not None:
            write_text(output / "fits.html", fits_page(measured, found))
            more: dict[str, Any] = {} if model is None else {"model": model}
        else:
            status.update("evaluating the set-ups separately")
            more = {"set_ups": set_ups_content(write_set_ups(output, measured, found))}
    path = write_characterization(output, measured, found, more)
    table = ({} if found.head_mass is None else {"head_mass": found.head_mass}) | found.table
    # A note that applies to several values is printed once.
    common = next((note for note, count in Counter(e.note for e in table.values() if e.note).most_common(1) if count > 1), "")
    rows = [
        (name, with_unit(e.value, e.unit, e.uncertainty), e.method, "*" if e.note and e.note == common else e.note)
        for name, e in table.items()
    ]
    for doubt in found.doubts:
        print(f"{CHECK_FIRST} {doubt.text}")
    title = f"{campaign.name}: held-out error {of_signal(found.error)}, noise alone {found.noise_alone}"
    show_table(title, ("parameter", "value ± std", "method", "note"), rows)
    if common:
        print(f"* {common}")
    for level in drive_levels(measured, found.fit.model.drive.channel):
        size = sized(level.value, level.unit, level.std)
        print(f"drive at gain {level.gain:g}, {level.excitation}: {level.measure} {size}")
    if not found.calibrated:
        print("The recording has no calibration_std, so the uncertainties do not include the calibration of the sensors.")
    print(*filter(None, [found.noise, *fault_sentences(found.faults), path]), sep="\n")
