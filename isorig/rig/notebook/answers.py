"""Whole analyses of a campaign with its own rig: the numbers and sentences of the commands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from isorig.analysis.campaign import Campaign, Measured, given_campaign
from isorig.analysis.deadline import Deadline
from isorig.analysis.diagnose import diagnosis as analysis
from isorig.analysis.diagnose.diagnosis import Diagnosis
from isorig.analysis.given import callback, finite
from isorig.analysis.model.rig_model import RigModel, given_rig
from isorig.analysis.parameters.joint_fit import Characterization
from isorig.analysis.views import Viewed, shows
from isorig.rig.choices import TIME_LIMIT
from isorig.rig.diagnose.answer import findings_of, write_answer
from isorig.rig.errors import RigError
from isorig.rig.files.findings import Findings
from isorig.rig.files.parameter_table import characterize_campaign
from isorig.rig.files.rigfile import GivenRig
from isorig.rig.model.baseline import with_sensors
from isorig.rig.notebook.plots import second_figure
from isorig.rig.report.conclusion import Conclusion, conclude
from isorig.rig.report.misfit import both_simulated, worst_second
from isorig.rig.report.place import marks
from isorig.rig.report.sketch import picture

if TYPE_CHECKING:
    import pandas as pd

    from isorig.rig.frf.figures import Figure


@dataclass(frozen=True, kw_only=True)
class Answer(Diagnosis, Viewed):
    """A diagnosis with the campaign that it is of."""

    campaign: Campaign  #: The measurement.

    def __repr__(self) -> str:
        return f"Answer({self.conclusion.answer})"

    @property
    def findings(self) -> Findings:
        """The content of findings.json."""
        return findings_of(self, self.campaign, self._origin)

    @property
    def conclusion(self) -> Conclusion:
        """The answer in sentences."""
        return conclude(self.findings)

    def write(self, folder: str | Path) -> Path:
        """Write findings.json, both models and report.html into a folder; returns the path of the page."""
        write_answer(Path(folder), self, self.campaign, self._origin)
        return Path(folder) / "report.html"

    @property
    def _origin(self) -> dict[str, str]:
        return {"baseline": self.baseline.model.name, "recording": Path(self.campaign.source).name}


def diagnose(
    campaign: Measured, model: RigModel | None = None, *, tolerance: float = 0.0, seconds: float | None = TIME_LIMIT,
    progress: Callable[[str], None] = lambda text: None,
) -> Answer:  # fmt: skip
    """Fit the baseline, show its misfit, and identify the cause.

    Parameters
    ----------
    campaign
        The measurement, or the path of its recording.
    model
        The baseline with starting values; its `free` parameters are fitted. The campaign's own rig if None.
    tolerance
        Error, as a share of the signal, that counts as adequate.
    seconds
        Time limit, s: the search for causes then ends with a partial answer; None for no limit.
    progress
        Called with a line for each stage.

    Raises
    ------
    ArgumentError
        An argument is of another type.
    PlanError
        The model has no sensor.

    Examples
    --------
    >>> import isorig as iso
    >>> found = iso.diagnose(iso.read("campaign.h5"))
    >>> found.verdict, found.steps
    ('adequate', ())
    """
    campaign = given_campaign(campaign)
    tolerance, seconds = (
        finite(tolerance, "the tolerance"),
        None if seconds is None else finite(seconds, "the time limit"),
    )
    callback(progress, "the argument progress")
    baseline = campaign.rig if model is None else with_sensors(given_rig(model), "the model")
    with Deadline(seconds):
        found = analysis.diagnose(campaign, baseline, tolerance=tolerance, progress=progress)
    return Answer(campaign=campaign, **{item.name: getattr(found, item.name) for item in fields(Diagnosis)})


def characterize(
    campaign: Measured, model: RigModel | GivenRig | None = None, *, progress: Callable[[str], None] = lambda text: None
) -> Characterization:
    """Fit all free parameters to all runs at once, with standard uncertainties: the numbers of `rig characterize`.

    Parameters
    ----------
    campaign
        The measurement, or the path of its recording.
    model
        The rig with starting values, or what `iso.read_rig` gives of the model.json of a diagnosis, whose fitted parameters are
        fitted again. The campaign's own rig if None.
    progress
        Called with a line for each stage.

    Raises
    ------
    ArgumentError
        An argument is of another type.

    Examples
    --------
    >>> import isorig as iso
    >>> found = iso.characterize(iso.read("campaign.h5"))
    >>> entry = found.table["motor_frequency"]
    >>> print(f"{entry.value:.2f} {entry.unit}")
    5.06 Hz
    """
    callback(progress, "the argument progress")
    given = model if model is None or isinstance(model, GivenRig) else GivenRig(model=given_rig(model))
    return characterize_campaign(given_campaign(campaign), progress, given)


@shows(Answer, "html")
def of_answer(answer: Answer) -> str:
    """The sentences, and the rig with the faulty place marked."""
    lines = "".join(f"<p>{escape(line)}</p>" for line in answer.conclusion.lines)
    return f"<div>{lines}{picture(answer.baseline.model, marks(answer.baseline.model, answer.steps))}</div>"


@shows(Answer, "plot")
def plot(answer: Answer) -> Figure:
    """Measurement and both models in the second of held-out data in which the baseline's error is largest, with residuals. Raises
    RigError if the held-out data are shorter than that."""
    record = worst_second(answer.trials, answer.division.judged, both_simulated(answer))
    if record is None:
        raise RigError("the held-out data are too short for a figure; record longer runs")
    return second_figure(record)


@shows(Answer, "to_pandas")
def to_pandas(answer: Answer) -> pd.DataFrame:
    """All considered causes."""
    import pandas as pd

    return pd.DataFrame(
        [(c.cause, c.location, c.holdout_error, c.share, c.standing) for c in answer.considered],
        columns=["cause", "location", "holdout_error", "share", "standing"],
    )
