"""What was measured becomes a recording: whole or not at all, with the session's ledger beside the samples."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import h5py

from analysis.measured import Run
from rig.acquire.plan import SENSOR, Plan, RunPlan
from rig.acquire.recorder import RESERVE
from rig.acquire.recover import Drift, Recovered, campaign_of, working
from rig.errors import OutputError, PlanError
from rig.output import replaced
from rig.recording import open_recording, write

#: Attributes of a run that tell how its clock drifted.
DRIFT = ("clock_drift_ppm", "clock_drift_ppm_std")


@dataclass(frozen=True, kw_only=True)
class _Kept:
    """A run, and what is known beside its samples: a group that tells (of a working file, or of a recording), or attributes."""

    run: Run
    ledger: h5py.Group | None = None
    sensors: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    drift: Drift | None = None
    finished: bool = True


def keep_session(partial: Path, output: Path, *, add: bool) -> None:
    """Make the recording of a working file, and remove that once its content is safe.

    Where it is to `add` to a recording of an earlier part of the session, the runs there stay unless they were taken anew to
    their end, or further than before.

    Raises
    ------
    OutputError
        Where the disk has no room for it; the working file stays.
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
                raise OutputError(
                    f"the disk is nearly full: what was measured is in {partial}; make room and go on with --resume, or save it "
                    "elsewhere with rig recover"
                )
            _write(output, known, list(runs.values()))
    partial.unlink()


def keep_recovered(working_file: Path, output: Path) -> list[Recovered]:
    """Make a recording of a working file, which stays as it is; what there is of each planned run.

    Raises
    ------
    RecordingError
        Where it is no working file, or holds no sample.
    """
    with working(working_file) as (known, found):
        _write(output, known, _kept(found), str(working_file))
    return found


def keep_measured(output: Path, plan: Plan, run: Run, *, add: bool) -> None:
    """Make a recording of a run that is in memory, or add it to one."""
    sensors = {name: plan.channels[name].told for name in run.channels}
    with _earlier(output, add) as earlier:
        _write(output, plan.rig, list({**earlier, run.id: _Kept(run=run, sensors=sensors)}.values()))


def whole_runs(output: Path, plan: Plan) -> frozenset[str]:
    """The runs of a plan that an earlier part of the session has taken to their end.

    Raises
    ------
    PlanError
        Where one was taken otherwise than the plan says now.
    """
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
    pairs = [("configuration", run.configuration, planned.configuration), ("excitation", run.excitation, planned.excitation)]
    if not plan.instrument.analyzer:
        pairs.append(("sample_rate", f"{run.sample_rate:g} Hz", f"{plan.instrument.sample_rate:g} Hz"))
    for key, was, asked in pairs:
        if was != asked:
            raise PlanError(
                f"run {run.id!r} in {output} was taken with {key} {was} and the plan says {asked}; give the run another id, or "
                "begin another recording"
            )


def _kept(found: Sequence[Recovered]) -> list[_Kept]:
    return [
        _Kept(run=item.run, ledger=item.ledger, drift=item.drift, finished=item.finished)
        for item in found
        if item.run is not None
    ]


@contextmanager
def _earlier(output: Path, wanted: bool) -> Iterator[dict[str, _Kept]]:
    if not (wanted and output.exists()):
        yield {}
        return
    with open_recording(output) as campaign, h5py.File(output, "r") as file:
        yield {run.id: _Kept(run=run, ledger=file[f"runs/{run.id}"]) for run in campaign.runs}


def _write(output: Path, known: Mapping[str, float | str], kept: Sequence[_Kept], source: str = "") -> None:
    with replaced(output) as temporary:
        write(temporary, campaign_of(known, [item.run for item in kept], source or str(output)))
        with h5py.File(temporary, "r+") as file:
            for item in kept:
                _annotate(file[f"runs/{item.run.id}"], item)


def _annotate(group: h5py.Group, item: _Kept) -> None:
    # What the format leaves open: what each sensor is, when each block arrived, how the clocks drifted.
    if item.drift is not None:
        group.attrs.update(clock_drift_ppm=item.drift.ppm, clock_drift_ppm_std=item.drift.std)
    for name, told in item.sensors.items():
        group[name].attrs.update(told)
    if item.ledger is None:
        return
    group.attrs.update({key: item.ledger.attrs[key] for key in DRIFT if key in item.ledger.attrs})
    for name in item.run.channels:
        told = item.ledger[name].attrs if name in item.ledger else {}
        group[name].attrs.update({key: told[key] for key in SENSOR if key in told})
    if "timing" in item.ledger:
        group.create_dataset("timing", data=item.ledger["timing"][:], fletcher32=True, chunks=True)
