"""The stages of an investigation as they are saved: questions, runs and answers."""

from __future__ import annotations

from typing import Literal

import msgspec

from isorig.rig.acquire.plan import RunPlan
from isorig.rig.model.baseline import Baseline
from isorig.rig.next.page import Picture


class StageRun(msgspec.Struct, frozen=True, kw_only=True):
    """A run of a stage: its plan, and the reason for it."""

    plan: RunPlan
    description: str
    why: list[str]
    pictures: list[Picture] = []
    promised: float | None = None


class Stage(msgspec.Struct, frozen=True, kw_only=True):
    """A stage: its question, its runs, and the result.

    `step` is its progress; `verdict`, `named`, `open` and `answer` are from the diagnosis after its runs.
    """

    number: int
    kind: str
    asked: list[str]
    runs: list[StageRun]
    step: Literal["proposed", "measured", "diagnosed"] = "proposed"
    verdict: str = ""
    named: list[tuple[str, str]] = []
    open: list[list[tuple[str, str]]] = []
    answer: list[str] = []


class Course(msgspec.Struct, frozen=True, kw_only=True):
    """The whole investigation; `ended` is the reason for its end, empty while it continues."""

    plan: str
    baseline: Baseline
    tolerance: float
    stages: list[Stage] = []
    declined: list[str] = []
    ended: str = ""
    format: Literal["rig-investigation"] = "rig-investigation"
    format_version: Literal[1] = 1

    @property
    def runs(self) -> list[RunPlan]:
        """All runs of all stages."""
        return [run.plan for stage in self.stages for run in stage.runs]

    @property
    def seconds(self) -> float:
        """Seconds of measuring so far."""
        return sum(run.plan.seconds for stage in self.stages if stage.step != "proposed" for run in stage.runs)


def diagnosis_folder(stage: Stage) -> str:
    """Name of the folder with the diagnosis after a stage."""
    return f"diagnosis-{stage.number}"
