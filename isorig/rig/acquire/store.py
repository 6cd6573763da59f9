"""Converts measured data to a recording atomically, including the session's metadata."""

import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from isorig.analysis.campaign import Run
from isorig.drivers.arrivals import BIN, JUMP, SCATTER
from isorig.drivers.block import Status
from isorig.rig.acquire.locks import output_locked
from isorig.rig.acquire.plan import Plan, RunPlan
from isorig.rig.acquire.recorder import RESERVE
from isorig.rig.acquire.recover import Recovered, campaign_of, working
from isorig.rig.errors import OutputError, PlanError
from isorig.rig.files.hdf import CHUNK_CACHE
from isorig.rig.files.output import remove_leftovers
from isorig.rig.files.recording import SENSOR, Extra, Stored, open_recording, write

#: Advice if a working file remains.
GO_ON = "make room and continue with --resume, or save it elsewhere with rig recover"
#: Attributes of a run for the drift of its clock.
DRIFT = ("clock_drift_ppm", "clock_drift_ppm_std")
#: Attributes of a recording: who counted the samples, the longest undetectable loss in seconds, and the number of blocks before
#: which counter and clock disagreed, bytes were lost, or only the host's clock indicated a loss.
AXIS = ("time_axis", "time_axis_unseen", "time_axis_doubts")
DOUBTS = Status.DISAGREES | Status.CLOCKED | Status.RESYNCED
#: Table of a run with the arrival time of each block of the instrument.
TIMING = "timing"
#: Group of a run with a table for each logger that ran along, and the beginning of the attributes with the units of its fields.
LOGS, UNIT = "logs", "unit_"


@dataclass(frozen=True, kw_only=True)
class _Kept:
    """A run, and its metadata."""

    run: Run
    extra: Extra
    finished: bool = True


def keep_session(partial: Path, output: Path, *, add: bool) -> None:
    """Convert a working file to a recording, and remove it when its content is safe.

    If it is to `add` to a recording of an earlier part of the session, the runs there stay unless they were measured again
    completely, or longer than before. Raises OutputError if the disk is full; the working file then stays.
    """
    with working(partial) as (known, found), _earlier(output, add) as earlier:
        runs = dict(earlier)
        for kept in _kept(found):
            before = earlier.get(kept.run.id)
            if before is None or kept.finished or len(kept.run) >= len(before.run):
                runs[kept.run.id] = kept
        if runs:
            size = partial.stat().st_size + (output.stat().st_size if earlier else 0)
            if shutil.disk_usage(partial.parent).free < size + RESERVE:
                raise OutputError(f"the disk is nearly full: the measured data are in {partial}; {GO_ON}")
            try:
                _write(output, known, list(runs.values()))
            except OutputError as error:
                raise OutputError(f"{str(error).split(';')[0]}; the measured data are in {partial}; {GO_ON}") from None
    partial.unlink()


def keep_recovered(working_file: Path, output: Path) -> list[Recovered]:
    """Make a recording of a working file, which is not changed; with the available data of each planned run. Raises
    RecordingError if it is not a working file, or contains no sample; OutputError if the recording cannot be written, or a
    session is writing it."""
    with output_locked(output), working(working_file) as (known, found):
        remove_leftovers(output)
        _write(output, known, _kept(found), str(working_file))
    return found


def keep_measured(output: Path, plan: Plan, run: Run, *, add: bool) -> None:
    """Make a recording of a run in memory, or add it to one."""
    extra = Extra(channels={name: plan.channels[name].description for name in run.channels})
    with _earlier(output, add) as earlier:
        after = _ended(kept.run for kept in earlier.values())
        if after is not None and run.started is not None and run.started < after:
            run = replace(run, started=after)
        _write(output, plan.rig, list({**earlier, run.id: _Kept(run=run, extra=extra)}.values()))


def ended(output: Path) -> datetime | None:
    """End time of the last run of a recording; None if there is no recording or no time."""
    if not output.exists():
        return None
    with open_recording(output) as campaign:
        return _ended(campaign.runs)


def _ended(runs: Iterable[Run]) -> datetime | None:
    ends = (
        run.started + timedelta(seconds=(len(run) + sum(gap.count for gap in run.gaps)) / run.sample_rate)
        for run in runs
        if run.started is not None
    )
    return max(ends, default=None)


def whole_runs(output: Path, plan: Plan) -> frozenset[str]:
    """The runs of a plan that an earlier part of the session has completed. Raises PlanError if a run was measured with settings
    that differ from the plan."""
    if not output.exists():
        return frozenset()
    done = set()
    with open_recording(output) as campaign:
        taken = {run.id: run for run in campaign.runs}
    for run in plan.runs:
        for name in run.ids():
            if name not in taken:
                continue
            _same(taken[name], run, plan, output)
            ticks = len(taken[name]) + sum(gap.count for gap in taken[name].gaps)
            if plan.instrument.analyzer or ticks >= run.ticks(plan.instrument.sample_rate):
                done.add(name)
    return frozenset(done)


def _same(run: Run, planned: RunPlan, plan: Plan, output: Path) -> None:
    pairs = [("configuration", run.configuration, planned.configuration), ("excitation", run.excitation, planned.recorded_as)]
    pairs.append(("repeat_of", run.repeat_of or "none", planned.repeat_of or "none"))
    if not plan.instrument.analyzer:
        pairs.append(("sample_rate", f"{run.sample_rate:g} Hz", f"{plan.instrument.sample_rate:g} Hz"))
    for key, was, asked in pairs:
        if was != asked:
            raise PlanError(
                f"run {run.id!r} in {output} was measured with {key} {was} but the plan has {asked}; give the run another id, or "
                "start another recording"
            )


def _kept(recovered: Sequence[Recovered]) -> list[_Kept]:
    return [_Kept(run=item.run, extra=_extra(item), finished=item.finished) for item in recovered if item.run is not None]


def _extra(item: Recovered) -> Extra:
    # Metadata outside of the format: description of each sensor, arrival of each block, clock drift, reliability of the time
    # axis.
    attributes: dict[str, float | str] = {}
    if item.drift is not None:
        attributes |= zip(DRIFT, (item.drift.ppm, item.drift.std), strict=True)
    if item.run is None or item.timing is None or not item.timing.shape[0]:
        return Extra(attributes=attributes, channels=item.sensors)
    attributes |= _axis(item.timing[:], item.run.sample_rate)
    logs = {f"{LOGS}/{name}": rows for name, rows in item.logs.items()}
    about: dict[str, dict[str, float | str]] = {
        f"{LOGS}/{name}": {
            "sample_rate": log.sample_rate,
            **{UNIT + key: unit for key, unit in {"time": "s", **log.units}.items()},
        }
        for name, log in item.log_layouts.items()
    }
    return Extra(attributes=attributes, channels=item.sensors, tables={TIMING: item.timing, **logs}, about=about)


def _axis(timing: NDArray[Any], rate: float) -> dict[str, str | float | int]:
    # The attributes of a time axis, from the timing of its blocks and the sample rate in Hz.
    # A clock of the instrument shows every loss, as the numbers of the samples do.
    numbered = bool(len(timing)) and bool((timing["status"] & int(Status.NUMBERED)).all())
    counted = numbered or bool(np.isfinite(timing["device_time"]).any())
    doubts = int((timing["status"] & int(DOUBTS)).astype(bool).sum())
    unseen = 0.0 if counted else max(JUMP, SCATTER * _scatter(timing, rate))
    return dict(zip(AXIS, ("instrument" if counted else "host", unseen, doubts), strict=True))


def _scatter(timing: NDArray[Any], rate: float) -> float:
    # The smallest delay of each bin relative to a fitted line, as in `isorig.drivers.arrivals`.
    if len(timing) < 3 or rate <= 0.0:
        return 0.0
    host = timing["host_time"] - timing["host_time"][0]
    late = host - (timing["tick"] - timing["tick"][0]) / rate
    _, bins = np.unique((host / BIN).astype(np.int64), return_inverse=True)
    least = np.full(int(bins.max()) + 1, np.inf)
    np.minimum.at(least, bins, late)
    if len(least) < 3:
        return 0.0
    at = np.arange(len(least))
    least -= np.polyval(np.polyfit(at, least, 1), at)
    return float(np.median(least) - least.min())


@contextmanager
def _earlier(output: Path, wanted: bool) -> Iterator[dict[str, _Kept]]:
    if not (wanted and output.exists()):
        yield {}
        return
    with open_recording(output) as campaign, h5py.File(output, "r", rdcc_nbytes=CHUNK_CACHE) as file:
        yield {run.id: _Kept(run=run, extra=_extra_in(file[f"runs/{run.id}"], run)) for run in campaign.runs}


def _extra_in(group: h5py.Group, run: Run) -> Extra:
    sensors = {name: {key: _plain(group[name].attrs[key]) for key in SENSOR if key in group[name].attrs} for name in run.channels}
    names = [TIMING] if TIMING in group else []
    names += [f"{LOGS}/{name}" for name in group.get(LOGS, ())]
    return Extra(
        attributes={key: _plain(group.attrs[key]) for key in (*DRIFT, *AXIS) if key in group.attrs}, channels=sensors,
        tables={name: Stored(group[name], f"the table {name} of run {run.id!r}") for name in names},
        about={name: {key: _plain(value) for key, value in group[name].attrs.items()} for name in names},
    )  # fmt: skip


def _plain(value: Any) -> Any:
    # Text of fixed length is returned as bytes.
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def _write(output: Path, known: Mapping[str, float | str], kept: Sequence[_Kept], source: str = "") -> None:
    campaign = campaign_of(known, [item.run for item in kept], source or str(output))
    write(output, campaign, {item.run.id: item.extra for item in kept})
