"""The open questions of a diagnosis, for planning the next run: rivals.json, with every remaining cause as a fitted model."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from isorig.analysis.campaign import Campaign, FloatArray, Run, broad
from isorig.analysis.diagnose.diagnosis import Diagnosis
from isorig.analysis.diagnose.step import Entry
from isorig.analysis.errors import DataError, ModelError
from isorig.analysis.fitting.excess import excess
from isorig.analysis.fitting.solve import Fit, Free
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.proposals.prediction import Variant
from isorig.analysis.spectra.noise import noise_levels
from isorig.analysis.spectra.welch import estimate
from isorig.rig.errors import PlanError
from isorig.rig.files.findings import AGAIN, read_answer
from isorig.rig.files.output import write_json
from isorig.rig.files.rigfile import free_of, free_tree

NAME = "rivals.json"
#: Number of causes compared if none is named: the best ones, at most one of each kind and place.
UNDECIDED = 3


class ExistingRun(msgspec.Struct, frozen=True, kw_only=True):
    """An existing run, as far as its drive can be generated again: `drive_rms` and `drive_peak` are of the recorded channel."""

    id: str
    configuration: str
    excitation: str
    gain: float
    seconds: float
    start_time: float
    drive_rms: float
    drive_peak: float
    band: tuple[float, float] | None = None
    period: float | None = None
    repeat_of: str | None = None

    @property
    def driven(self) -> bool:
        """Whether a drive is recorded."""
        return self.excitation != "free" and self.drive_rms > 0.0


class FittedModel(msgspec.Struct, frozen=True, kw_only=True):
    """A cause as a fitted model; cause and location are empty for the model without one."""

    cause: str
    location: str
    model: RigModel
    free: list[dict[str, Any]]
    covariance: list[list[float]]

    @property
    def key(self) -> tuple[str, str]:
        """Cause and location."""
        return self.cause, self.location

    def variant(self) -> Variant:
        """The same as an object in memory."""
        return Variant(
            cause=self.cause, location=self.location, model=self.model,
            free=tuple(free_of(tree) for tree in self.free), covariance=np.array(self.covariance).reshape(len(self.free), -1),
        )  # fmt: skip


class OpenSet(msgspec.Struct, frozen=True, kw_only=True):
    """Causes that are still possible.

    `why` is "indistinguishable" if the diagnosis says so and "undecided" if none was named. `twins` have the same equations as
    one of the models, so that no run of this rig distinguishes them: pairs of cause and location. `unfitted` were not fitted in
    full, so that no run can be proposed for them.
    """

    why: Literal["indistinguishable", "undecided"]
    models: list[FittedModel]
    twins: list[tuple[str, str]] = []
    unfitted: list[tuple[str, str]] = []


class Rivals(msgspec.Struct, frozen=True, kw_only=True):
    """Everything that a proposal needs from a diagnosis."""

    campaign: str
    verdict: str
    baseline: str
    sample_rate: float
    noise: Mapping[str, float]
    known: dict[str, float | str]
    runs: list[ExistingRun]
    explains: FittedModel
    open: list[OpenSet]
    named: list[tuple[str, str]]
    ruled_out: list[tuple[str, str]]
    worst: str = ""
    format: Literal["rig-rivals"] = "rig-rivals"
    format_version: Literal[1] = 1


def write_rivals(folder: Path, diagnosis: Diagnosis, campaign: Campaign, origin: Mapping[str, str]) -> Path:
    """Write rivals.json next to the findings."""
    model = diagnosis.extended.model
    drive = model.drive.channel
    content = Rivals(
        campaign=origin["recording"], verdict=diagnosis.verdict, baseline=origin["baseline"],
        sample_rate=campaign.runs[0].sample_rate, noise=noise_levels(campaign, model.drive_channels),
        known={**campaign.known, **({} if campaign.description is None else {"description": campaign.description})},
        runs=[_existing_run(campaign, run, drive) for run in campaign.runs], explains=_model("", "", diagnosis.extended),
        open=_open(diagnosis), named=[(step.cause, step.location) for step in diagnosis.steps],
        ruled_out=[(item.cause, item.location) for item in diagnosis.considered if item.standing == "ruled out"],
        worst=max(diagnosis.discrepancies, key=lambda d: d.size).run if diagnosis.discrepancies else "",
    )  # fmt: skip
    return write_json(folder / NAME, content)


def read_rivals(folder: Path) -> Rivals:
    """Read the rivals.json of a diagnosis. Raises PlanError if the folder contains no diagnosis, or one of an older version."""
    found = read_answer(folder, NAME, Rivals)
    try:
        for each in (found.explains, *(model for one in found.open for model in one.models)):
            each.variant()
    except (msgspec.MsgspecError, ModelError, TypeError, ValueError, RecursionError) as error:
        raise PlanError(f"{folder / NAME} is damaged or of another version ({error}); {AGAIN}") from None
    return found


def _existing_run(campaign: Campaign, run: Run, drive: str) -> ExistingRun:
    values = run.read(drive)
    return ExistingRun(
        id=run.id, configuration=run.configuration, excitation=run.excitation, gain=run.gain, seconds=run.duration,
        start_time=campaign.seconds_since_start(run), drive_rms=float(values.std()), drive_peak=float(np.abs(values).max()),
        band=run.band or _extent(run, drive), period=None if run.period is None else run.period / run.sample_rate,
        repeat_of=run.repeat_of,
    )  # fmt: skip


def _extent(run: Run, drive: str) -> tuple[float, float] | None:
    if not broad([run]) or not run.read(drive).any():
        return None
    try:
        return estimate([run], references=[drive], channels=[drive], resolution=max(0.25, 8.0 / run.duration)).extent(drive)
    except DataError:  # too short
        return None


def _open(diagnosis: Diagnosis) -> list[OpenSet]:
    found = []
    last = -1
    for step in diagnosis.steps:
        own = (step.cause, step.location)
        having = (k for k, (_, entries) in enumerate(diagnosis.searched) if own in (each.candidate.key for each in entries))
        last = max(having, default=last)
        entries = sorted(diagnosis.searched[last][1], key=lambda entry: entry.score.figure)
        keys = {own, *step.indistinguishable}
        best = _first_of_each(entries, lambda entry: entry.candidate.key)
        models = [_model(*entry.candidate.key, entry.fit) for entry in best if entry.candidate.key in keys]
        fitted = {model.key for model in models}
        equal = {entry.candidate.twin for entry in entries if entry.candidate.key in fitted}
        twins, unfitted = sorted((keys - fitted) & equal), sorted(keys - fitted - equal)
        if len(keys) > 1 and models:
            found.append(OpenSet(why="indistinguishable", models=models, twins=twins, unfitted=unfitted))
    if diagnosis.verdict in ("unexplained", "partly explained") and last < len(diagnosis.searched) - 1:
        score, tried = diagnosis.searched[-1]
        ranked = sorted(tried, key=lambda entry: excess(entry.score.error, 0.0 * score.error))
        best = _first_of_each(ranked, lambda entry: entry.place)
        models = [_model(*entry.candidate.key, entry.fit) for entry in best[:UNDECIDED]]
        if len(models) > 1:
            found.append(OpenSet(why="undecided", models=models))
    return found


def _first_of_each(entries: Sequence[Entry], key: Callable[[Entry], tuple[str, str]]) -> list[Entry]:
    found: dict[tuple[str, str], Entry] = {}
    for entry in entries:
        found.setdefault(key(entry), entry)
    return list(found.values())


def _model(cause: str, location: str, fitted: Fit) -> FittedModel:
    return fitted_model(cause, location, fitted.model, fitted.free, fitted.covariance)


def fitted_model(cause: str, location: str, model: RigModel, free: Sequence[Free], covariance: FloatArray) -> FittedModel:
    """A fitted model as stored in the file."""
    return FittedModel(
        cause=cause, location=location, model=model, free=[free_tree(each) for each in free],
        covariance=np.nan_to_num(covariance).tolist(),
    )  # fmt: skip
