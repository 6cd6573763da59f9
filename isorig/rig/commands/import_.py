"""Converts files of other formats to a recording."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from isorig.rig.exchange.formats import FORMATS
from isorig.rig.options import Flag, Output


def import_(
    files: Annotated[list[Path], Parameter(negative=())], /, *, output: Output, data: Path | None = None, draft: Flag = False
) -> None:
    """Import files of other programs according to a mapping, as one recording.

    Files can be imported that end in {extensions}.
    Let --draft propose the mapping from the files, correct it, then import. For a rig other than the wire bonder, a description
    is proposed as well, which rig describe shows.

    Example: rig import --draft run1.mat run2.mat -o mapping.toml, then: rig import mapping.toml -o campaign.h5

    Parameters
    ----------
    files
        The mapping; with --draft the measured files.
    output
        The recording to write; with --draft the mapping.
    data
        The folder of the files named in the mapping; by default the mapping's own.
    draft
        Propose a mapping from the files.
    """
    from isorig.analysis.spectra.quality import clipped_or_dead
    from isorig.rig.acquire.run_check import incoherences
    from isorig.rig.errors import PlanError
    from isorig.rig.exchange.draft import draft_mapping
    from isorig.rig.exchange.importing import import_campaign, other_quantities, shortcomings
    from isorig.rig.exchange.mapping import read_mapping
    from isorig.rig.exchange.reading import read_foreign
    from isorig.rig.files.inputs import import_first
    from isorig.rig.files.output import write_text
    from isorig.rig.files.recording import open_recording
    from isorig.rig.files.rigfile import references_of
    from isorig.rig.frf.transfer import faults_in
    from isorig.rig.model.baseline import CHECK_FIRST, doubts_in

    said: list[str] = []
    if draft:
        rig_file = output.with_name(f"{output.stem}-rig.toml")
        mapping, description = draft_mapping([read_foreign(path) for path in files], output.parent, rig_file.name)
        write_text(output, mapping)
        if description and rig_file.exists():
            print(f"{rig_file} exists and is kept as the rig's description.")
        elif description:
            write_text(rig_file, description)
            print(f"{rig_file} is proposed as the rig's description; correct it, or let rig describe --new ask for one.")
    elif len(files) > 1 or files[0].suffix.lower() != ".toml":
        raise PlanError(f"{files[0]} is not a mapping; {import_first(files[0])}")
    else:
        campaign = import_campaign(files[0], output, data=data)
        units = {name: channel.unit for name, channel in read_mapping(files[0]).channels.items()}
        for channel in campaign.runs[0].channels.values():
            if channel.name not in units:
                print(f"no column is the drive {channel.name!r}, and all runs are free: a drive of 0 {channel.unit} is recorded")
        for run in campaign.runs:
            if run.gaps:
                lost = sum(gap.count for gap in run.gaps)
                print(
                    f"run {run.id!r}: samples without a value in the file: {lost}, in gaps: {len(run.gaps)}; they count as lost"
                )
            if run.repeat_of is not None:
                print(f"run {run.id!r} has the drive of run {run.repeat_of!r} and is stored as its repeat")
        # The recording orders its runs; rig check reports the same one of them.
        with open_recording(output) as written:
            reasons = incoherences(written, references_of(written))
        # What follows from a clipped or dead record is not repeated in other words.
        broken = {fault.channel: fault.kind for fault in faults_in(campaign, references_of(campaign)[0], clipped_or_dead)}
        said = shortcomings(campaign)
        said += [reason.text for reason in reasons if reason.response not in broken]
        doubts = () if "dead" in broken.values() else doubts_in(campaign, units)
        said += [f"{CHECK_FIRST} {doubt.text}" for doubt in doubts] or other_quantities(campaign)
    print(*said, output, sep="\n")


import_.__doc__ = str(import_.__doc__).format(extensions=", ".join(FORMATS))
