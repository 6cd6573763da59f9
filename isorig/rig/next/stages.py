"""The stages of an investigation as they are saved: questions, runs and answers."""

from __future__ import annotations

from typing import Literal

import msgspec

from isorig.rig.acquire.plan import RunPlan
from isorig.rig.choices import Baseline


class Picture(msgspec.Struct, frozen=True, kw_only=True):
    """The predictions of two causes for a run around their largest difference, for plotting or storing."""

    truth: str
    rival: str
    channel: str
    sample_rate: float
    first: int
    of_truth: list[float]
    of_rival: list[float]
    allowed: float
    distance: float
    unit: str = ""


class InvestigationRun(msgspec.Struct, frozen=True, kw_only=True):
    """A run of a stage: its plan, and the reason for it."""

    plan: RunPlan
    description: str
    why: list[str]
    pictures: list[Picture] = []
    promised: float | None = None


class InvestigationStage(msgspec.Struct, frozen=True, kw_only=True):
    """A stage: its question, its runs, and the result.

    `step` is its progress; `verdict`, `named`, `open` and `answer` are from the diagnosis after its runs.
    """

    number: int
    kind: str
    asked: list[str]
    runs: list[InvestigationRun]
    step: Literal["proposed", "measured", "diagnosed"] = "proposed"
    verdict: str = ""
    named: list[tuple[str, str]] = []
    open: list[list[tuple[str, str]]] = []
    answer: list[str] = []


class Investigation(msgspec.Struct, frozen=True, kw_only=True):
    """The whole investigation; `ended` is the reason for its end, empty while it continues."""

    plan: str
    baseline: Baseline
    tolerance: float
    stages: list[InvestigationStage] = []
    declined: list[str] = []
    ended: str = ""
    format: Literal["rig-investigation"] = "rig-investigation"
    format_version: Literal[1] = 1

    @property
    def runs(self) -> list[RunPlan]:
        """All runs of all stages."""
        return [run.plan for stage in self.stages for run in stage.runs]

    @property
    def diagnosed(self) -> list[InvestigationStage]:
        """The stages with a verdict."""
        return [stage for stage in self.stages if stage.verdict]

    def with_last(self, stage: InvestigationStage) -> Investigation:
        """The same with another last stage."""
        return msgspec.structs.replace(self, stages=[*self.stages[:-1], stage])

    @property
    def seconds(self) -> float:
        """Seconds of measuring so far."""
        return sum(run.plan.seconds for stage in self.stages if stage.step != "proposed" for run in stage.runs)


def diagnosis_folder(stage: InvestigationStage) -> str:
    """Name of the folder with the diagnosis after a stage."""
    return f"diagnosis-{stage.number}"
