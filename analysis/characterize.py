"""The parameter table of the wire bonder: a joint fit of all runs with friction in the model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi, sqrt

import numpy as np

from analysis.diagnose.fits import fit_baseline
from analysis.diagnose.judge import SIMULATION_LIMIT, Score, adequate, noise_floor, score
from analysis.fit import Fit, disagreement
from analysis.measured import Campaign
from analysis.model import RigModel
from analysis.trials import Trial, noise_levels

BODIES = (("table", "table"), ("heatblock", "heatblock"), ("motor", "isolation"))
#: Relative deviation that the estimate itself cannot see: the sampling filter and the drive's interpolation, found by
#: fitting recordings made with another filter and a finer grid.
UNSEEN = {"mass": 3e-4, "frequency": 1e-4, "damping": 3e-3, "friction": 1e-3}


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A row of the table; `value` is None where the data cannot support a figure, and `note` says why."""

    value: float | None
    std: float | None
    unit: str
    method: str
    note: str


@dataclass(frozen=True, kw_only=True)
class Characterization:
    """The table by name, the fit behind it, the runs, and how it does on what was held out beside the noise floor."""

    table: dict[str, Entry]
    fit: Fit
    trials: tuple[Trial, ...]
    score: Score
    floor: float
    adequate: bool

    @property
    def error(self) -> float:
        """Held-out error: the median over runs and channels."""
        return self.score.figure


def characterize(campaign: Campaign, model: RigModel, *, progress: Callable[[str], None] = lambda text: None) -> Characterization:
    """Fit all free parameters to all runs at once, and say how well each is known.

    Frequencies are the uncoupled sqrt(k / m) / 2 pi, damping ratios c / (2 sqrt(k m)). Deviations come from the residuals
    with their colour (sandwich over spectral lines), from how far the runs disagree, grow with the misfit that the model leaves,
    and include `UNSEEN`.

    Parameters
    ----------
    campaign
        What was measured; needs locked and unlocked runs for all figures.
    model
        The wire bonder with first guesses.
    progress
        Called with one line per stage.
    """
    progress("fitting all runs with friction in the model")
    fitted, fine = fit_baseline(campaign, model)
    fitted = replace(fitted, covariance=fitted.covariance + disagreement(fitted))
    judged = score(fitted.model, fine)
    # A misfit beyond the simulation's limit bends every parameter; its size relative to the signal bounds how far.
    misfit = max(0.0, float(np.sqrt(np.mean(judged.error**2))) - 2.0 * SIMULATION_LIMIT)
    note = "" if misfit < 0.01 else f"the model leaves {100 * misfit:.1f} % of the signal unexplained; see rig diagnose"
    table: dict[str, Entry] = {}
    for body, link in BODIES:
        table |= _rows(fitted, body, link, misfit, note)
    path = "contacts.isolation.law.friction_force"
    if path in fitted.values:
        value, std = fitted.values[path], fitted.std[path]
        table["friction_force"] = _entry(value, std, "N", "friction", misfit, note)
    else:
        table["friction_force"] = Entry(value=None, std=None, unit="N", method="none", note="the model has no friction")
    floors = noise_floor(fitted.model, fine, noise_levels(campaign).get(model.drive.channel, 0.0))
    return Characterization(
        table=table, fit=fitted, trials=fine, score=judged, floor=float(np.median(floors)),
        adequate=adequate(judged, np.hypot(floors, SIMULATION_LIMIT)),
    )  # fmt: skip


def _rows(fitted: Fit, body: str, link: str, misfit: float, note: str) -> dict[str, Entry]:
    paths = [f"bodies.{body}.mass", f"links.{link}.stiffness", f"links.{link}.damping"]
    m, k, c = (fitted.model.get(path) for path in paths)
    order = [free.path for free in fitted.free]
    covariance = np.zeros((3, 3))
    for i, a in enumerate(paths):
        for j, b in enumerate(paths):
            if a in order and b in order:
                covariance[i, j] = fitted.covariance[order.index(a), order.index(b)]
    frequency, damping = sqrt(k / m) / (2 * pi), c / (2 * sqrt(k * m))
    slopes = {
        "frequency": np.array([-0.5 / m, 0.5 / k, 0.0]) * frequency,
        "damping": np.array([-0.5 / m, -0.5 / k, 1.0 / c]) * damping,
    }
    rows = {
        f"{body}_frequency": _entry(
            frequency,
            float(np.sqrt(slopes["frequency"] @ covariance @ slopes["frequency"])),
            "Hz",
            "frequency",
            misfit,
            note,
        ),
        f"{body}_damping": _entry(
            damping,
            float(np.sqrt(slopes["damping"] @ covariance @ slopes["damping"])),
            "1",
            "damping",
            misfit,
            note,
        ),
    }
    if paths[0] in order:
        mass = _entry(m, float(np.sqrt(covariance[0, 0])), "kg", "mass", misfit, note)
    else:
        mass = Entry(value=m, std=0.0, unit="kg", method="given", note="weighed")
    return {f"{body}_mass": mass, **rows}


def _entry(value: float, std: float, unit: str, kind: str, misfit: float, note: str) -> Entry:
    whole = float(np.hypot(std, UNSEEN[kind] * value))
    if misfit >= 0.01:
        whole = float(np.hypot(whole, misfit * value))
    if whole > 0.5 * abs(value):
        return Entry(value=None, std=None, unit=unit, method="joint fit", note=note or "the data do not determine it")
    return Entry(value=value, std=whole, unit=unit, method="joint fit", note=note)
