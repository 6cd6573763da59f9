"""One page about a measurement."""

from pathlib import Path

from isorig.rig.options import OutputFolder


def report(campaign: Path, *, output: OutputFolder, history: tuple[Path, ...] = ()) -> None:
    """Write one page about a recording, for readers who were not present.

    It has the runs, transfer functions with coherence, parameters, measured and simulated records, for the wire bonder the
    isolation ratio, and the errors of the simulation. The page works offline, for example as a mail attachment.

    Example: rig report campaign.h5 -o report

    Parameters
    ----------
    campaign
        A recording.
    output
        The folder for report.html, parameters.json, parameters.csv and model.json.
    history
        The parameters.json of earlier campaigns on this rig, for comparison.
    """
    from rich.console import Console

    from isorig.rig.files.output import write_text
    from isorig.rig.files.parameter_table import characterize_campaign, read_parameters, write_characterization
    from isorig.rig.files.recording import read
    from isorig.rig.report.measurement import measurement_page

    earlier = [read_parameters(path) for path in history]
    measured = read(campaign)
    with Console(stderr=True).status("reading") as status:
        found = characterize_campaign(measured, status.update)
        status.update("writing the report")
        write_characterization(output, measured, found)
        path = write_text(output / "report.html", measurement_page(measured, found, earlier))
    print(path)
