"""The writer for each export format, by file name extension."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from isorig.analysis.campaign import Campaign
from isorig.rig.errors import PlanError
from isorig.rig.exchange import exporting
from isorig.rig.files.recording import open_recording
from isorig.rig.files.rigfile import references_of
from isorig.rig.frf.transfer import transfer_functions

ENDINGS = (".mat", ".uff", ".csv", ".parquet")


def export_campaign(
    source: Path,
    output: Path,
    *,
    what: Literal["samples", "frf"],
    runs: Sequence[str] = (),
    reference: str | None = None,
    resolution: float = 0.25,
    binary: bool = True,
) -> list[Path]:
    """Export a recording; returns the paths written.

    Raises
    ------
    PlanError
        The output's extension or a run's name is unknown.
    """
    ending = _ending(output, ENDINGS)
    with open_recording(source) as whole:
        campaign = _chosen(whole, runs)
        if what == "samples":
            return _samples(campaign, output, ending, binary=binary)
        found = transfer_functions(campaign, reference=reference or references_of(campaign), resolution=resolution)
    if ending == ".mat":
        exporting.write_matlab(exporting.frf_tree(found), output)
    elif ending == ".uff":
        exporting.write_uff(exporting.frf_sets(found, campaign), output)
    else:
        exporting.write_frame(exporting.frf_frame(found), output)
    return [output]


def _samples(campaign: Campaign, output: Path, ending: str, *, binary: bool) -> list[Path]:
    if ending == ".mat":
        exporting.write_matlab(exporting.samples_tree(campaign), output)
    elif ending == ".uff":
        exporting.write_uff(exporting.samples_sets(campaign, binary=binary), output)
    else:
        several = len(campaign.runs) > 1
        paths = [output.with_name(f"{output.stem}-{run.id}{output.suffix}") if several else output for run in campaign.runs]
        for run, path in zip(campaign.runs, paths, strict=True):
            exporting.write_frame(exporting.samples_frame(run), path)
        return paths
    return [output]


def export_parameters(source: Path, output: Path) -> list[Path]:
    """Export the parameter table of a parameters.json or findings.json; returns the paths written."""
    ending = _ending(output, (".mat", ".csv", ".parquet"))
    frame = exporting.parameters_frame(source)
    if ending == ".mat":
        exporting.write_matlab(exporting.frame_tree(frame), output)
    else:
        exporting.write_frame(frame, output)
    return [output]


def _ending(output: Path, allowed: Sequence[str]) -> str:
    ending = output.suffix.lower()
    if ending not in allowed:
        raise PlanError(f"{output} ends in {ending or 'nothing'}; allowed are {', '.join(allowed)}")
    return ending


def _chosen(campaign: Campaign, runs: Sequence[str]) -> Campaign:
    known = [run.id for run in campaign.runs]
    unknown = next((name for name in runs if name not in known), None)
    if unknown is not None:
        raise PlanError(f"{campaign.source} has no run {unknown!r}; it has {', '.join(known)}")
    return replace(campaign, runs=tuple(run for run in campaign.runs if not runs or run.id in runs))
