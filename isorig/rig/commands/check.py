"""Lists the runs of recordings and rejects damaged files."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from isorig.analysis.campaign import Campaign, Channel, Run

#: Maximum number of channels in one table on the terminal.
SIDE_BY_SIDE = 5


def check(*files: Path) -> None:
    """List the runs of recordings, and reject damaged files.

    For each run: duration, sample rate, rms of every channel in its unit, and number of samples at or beyond the range. Messages
    below the table report what prevents other commands from using a run.

    Example: rig check campaign.h5

    Parameters
    ----------
    files
        Recordings to check, sample by sample.
    """
    from isorig.rig.errors import RecordingError
    from isorig.rig.files.hdf import start_checks

    if not files:
        raise RecordingError("no file was given; give at least one recording")
    start_checks()
    # Meanwhile this process imports, also what it needs after the check.
    from isorig.rig.files.output import displayable
    from isorig.rig.files.recording import open_recording
    from isorig.rig.process.terminal import show_table

    for later in ("isorig.rig.acquire.run_check", "isorig.rig.model.baseline", "rich.table"):
        import_module(later)
    for file in files:
        with open_recording(file) as campaign:
            names = list(dict.fromkeys(name for run in campaign.runs for name in run.sensors))
            several = len({run.configuration for run in campaign.runs}) > 1 or campaign.description is None
            rows = [_row(run, names, set_up=several) for run in campaign.runs]
            ids = [run.id for run in campaign.runs]
            remarks = _remarks(campaign)
        about = ("run", "set-up", "gain", "s", "Hz")
        if len(names) <= SIDE_BY_SIDE:
            show_table(f"{file}: rms of each channel", (*about, *names, "clip", "lost"), rows)
        else:
            # Too many channels for a line: each gets its own line.
            first, last = len(about), len(about) + len(names)
            show_table(str(file), (*about, "clip", "lost"), [row[:first] + row[last:] for row in rows])
            levels = [[name, *(row[first + k] for row in rows)] for k, name in enumerate(names)]
            show_table("rms of each channel", ("channel", *ids), levels)
        for remark in remarks:
            print(displayable(remark))


def _remarks(campaign: Campaign) -> list[str]:
    # The file is valid, but some commands cannot use it.
    from isorig.analysis.spectra.stated_drives import wrong_bands, wrong_excitations
    from isorig.analysis.spectra.zero_errors import zero_errors
    from isorig.rig.acquire.run_check import incoherences
    from isorig.rig.errors import PlanError
    from isorig.rig.files.rigfile import rig_of
    from isorig.rig.model.baseline import CHECK_FIRST, doubts_in

    try:
        model = rig_of(campaign)
    except PlanError as error:
        return [f"The rig's description cannot be used: {error}"]
    sentences = [f"{CHECK_FIRST} {doubt.text}" for doubt in doubts_in(campaign)]
    sentences += zero_errors(campaign).values()
    sentences += [*wrong_bands(campaign, model.drive.channel), *wrong_excitations(campaign, model.drive.channel)]
    sentences += [reason.text for reason in incoherences(campaign, model.drive_channels)]
    for run in campaign.runs:
        if run.configuration not in model.configurations:
            known = ", ".join(model.configurations)
            sentences.append(f"Run {run.id!r} has the configuration {run.configuration!r}; the rig has {known}, so correct it.")
        if model.drive.channel not in run.channels:
            sentences.append(f"Run {run.id!r} has no drive channel {model.drive.channel!r}; transfer functions need it.")
    return sentences


def _row(run: Run, names: Sequence[str], *, set_up: bool) -> list[str]:
    rms, clipped = [], []
    for name in names:
        size, beyond = _rms_and_clipped(run.channels[name]) if name in run.channels else ("–", None)
        rms.append(size)
        if beyond:
            clipped.append(f"{name} {beyond}")
    unknown = all(channel.full_scale is None for channel in run.channels.values())
    text = ", ".join(clipped) or ("unknown" if unknown else "no")
    lost = sum(gap.count for gap in run.gaps)
    about = (f"{run.configuration} " if set_up else "") + run.excitation + (" held out" if run.use == "holdout" else "")
    return [run.id, about, _gain(run), f"{run.duration:.1f}", f"{run.sample_rate:.10g}", *rms, text, str(lost)]


def _gain(run: Run) -> str:
    # The gain of the run, or the range of a streamed gain.
    from isorig.analysis.spectra.gain_levels import GAIN, changes

    if not changes(run):
        return f"{run.gain:g}"
    gain = run.read(GAIN)
    return f"{gain.min():.3g} to {gain.max():.3g}"


def _rms_and_clipped(channel: Channel) -> tuple[str, int]:
    import numpy as np

    from isorig.analysis.spectra.overload import blocks
    from isorig.analysis.wording import sized

    power, clipped = 0.0, 0
    limit = np.inf if channel.full_scale is None else channel.full_scale * (1.0 - 1e-6)
    for values in blocks(channel):
        power += float(values @ values)
        if max(values.max(), -values.min()) >= limit:
            clipped += int((np.abs(values) >= limit).sum())
    return sized(float(np.sqrt(power / len(channel))), channel.unit), clipped
