"""A diagnosis as files for other programs: findings.json, the two models, the report."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from isorig.analysis.campaign import Campaign
from isorig.analysis.diagnose.budget import Budget
from isorig.analysis.diagnose.diagnosis import Diagnosis
from isorig.analysis.diagnose.step import Curve, Step
from isorig.analysis.fitting.solve import Fit
from isorig.analysis.model.parameter_units import physical_parameters, unit_of
from isorig.rig.files.models import write_model
from isorig.rig.files.output import write_json, write_text
from isorig.rig.files.rivals import write_rivals
from isorig.rig.report.coverage import missing
from isorig.rig.report.diagnosis import diagnosis_page


def findings(
    diagnosis: Diagnosis, campaign: Campaign, origin: Mapping[str, str], limit: float | None = None
) -> dict[str, Any]:  # fmt: skip
    """The content of findings.json; `limit` is the given time limit, s.

    The baseline of a rig with its own description is that description, whatever friction it has.
    """
    name = "description" if campaign.description is not None else origin["baseline"]
    return {
        "format": "rig-findings",
        "format_version": 2,
        "origin": dict(origin),
        "doubts": [msgspec.to_builtins(doubt) for doubt in diagnosis.doubts],
        "verdict": diagnosis.verdict,
        "baseline": {"name": name, "parameters": parameters(diagnosis.baseline)},
        "extended": {"parameters": parameters(diagnosis.extended)},
        "discrepancies": [
            {
                "channel": d.channel, "configuration": d.configuration, "gain": d.gain, "run": d.run,
                "band_hz": list(d.band_hz), "what": d.what, "size": d.size, "noise": d.noise, "text": d.text,
            }
            for d in diagnosis.discrepancies
        ],
        "evidence": [sign.text for sign in diagnosis.signs],
        "remarks": missing(campaign, diagnosis.baseline.model),
        "adequacy": {
            "worst": diagnosis.worst, "threshold": diagnosis.enough, "baseline_rig": diagnosis.calibration,
            "how": "Largest ratio, over runs and channels, of the error to that allowed by noise and simulation accuracy; in "
            "cases of doubt the threshold is 1.2 times the largest such ratio of data simulated with the baseline and its noise.",
        },
        "tolerance": diagnosis.tolerance,
        "cut_short": diagnosis.cut_short,
        "time_limit_s": limit,
        "steps": [_step(step, share, diagnosis.extended) for step, share in zip(diagnosis.steps, diagnosis.shares, strict=True)],
        "candidates": [msgspec.to_builtins(candidate) for candidate in diagnosis.considered],
        "budget": {name: _budget(each) for name, each in zip(("baseline", "extended"), diagnosis.budgets, strict=True)},
        "indistinguishable": [
            [_place(step.cause, step.location), *(_place(*key) for key in step.indistinguishable)]
            for step in diagnosis.steps
            if step.indistinguishable
        ],
        "holdout": {
            "baseline": diagnosis.baseline_error,
            "extended": diagnosis.extended_error,
            "noise_floor": diagnosis.floor,
            "baseline_interval": list(diagnosis.improvement.before),
            "extended_interval": list(diagnosis.improvement.after),
            "removed": diagnosis.improvement.removed if diagnosis.steps else 0.0,
            "removed_interval": list(diagnosis.improvement.removed_interval),
            "interval": "95 % of 400 draws of held-out blocks (bootstrap)",
            "how": f"Median over runs and channels of rms(predicted - measured) / rms(measured) over {diagnosis.division.how}.",
        },
    }  # fmt: skip


def parameters(fitted: Fit) -> dict[str, Any]:
    """Fitted values with standard uncertainties and units, by path."""
    std = fitted.std
    return {
        path: {"value": value, "std": std[path], "unit": unit_of(path, fitted.model)} for path, value in fitted.values.items()
    }


def _budget(budget: Budget) -> dict[str, Any]:
    shares = {name: dict(zip(("value", "low", "high"), share, strict=True)) for name, share in budget.shares.items()}
    return {
        **shares,
        "by_channel": {name: dict(shares) for name, shares in budget.by_channel.items()},
        "by_configuration": {name: dict(shares) for name, shares in budget.by_configuration.items()},
        "how": budget.how,
    }


def _curve(curve: Curve) -> dict[str, Any]:
    return {
        "over": curve.over, "unit": curve.unit, "value_unit": curve.value_unit,
        "points": [list(point) for point in curve.points], "reached": list(curve.reached),
    }  # fmt: skip


def held(step: Step, fitted: Fit) -> dict[str, tuple[float, str]]:
    """Values and units of the parameters of a step's law that no fit changes, by name."""
    laws = {r.path.rpartition(".")[0] for r in step.reported if ".law" in r.path}
    fixed = [path for path in physical_parameters(fitted.model) if path.rpartition(".")[0] in laws]
    return {
        path.rpartition(".")[2]: (fitted.model.get(path), unit_of(path, fitted.model))
        for path in fixed
        if path not in fitted.values
    }


def _step(step: Step, share: tuple[float, float, float], fitted: Fit) -> dict[str, Any]:
    return {
        "cause": step.cause,
        "location": step.location,
        "kind": step.kind,
        "form": step.form,
        "closest_form": {"cause": step.closest[0], "share": step.closest[1]} if step.closest else None,
        "level": "form" if step.form else "kind",
        "share": dict(zip(("value", "low", "high"), share, strict=True)),
        **({"curve": _curve(step.curve)} if step.curve else {}),
        "parameters": {k: {"value": v, "std": s, "unit": u} for k, (v, s, u) in step.parameters.items()},
        "held": {name: {"value": value, "unit": u} for name, (value, u) in held(step, fitted).items()},
        "confidence": step.confidence,
        "rivals": [msgspec.to_builtins(rival) for rival in step.rivals],
        "evidence": list(step.evidence),
        "holdout_error_before": step.before,
        "holdout_error_after": step.after,
    }


def _place(cause: str, location: str) -> dict[str, str]:
    return {"cause": cause, "location": location}


def write_findings(
    folder: Path,
    diagnosis: Diagnosis,
    campaign: Campaign,
    origin: Mapping[str, str],
    *,
    limit: float | None = None,
    page: bool = True,
) -> None:
    """Write the contract's four files into a folder, and rivals.json; without report.html if no page is requested.

    `origin` is the source of the findings: the baseline's name, the recording's name and hash, this program's version;
    `limit` is the given time limit, s.
    """
    content = findings(diagnosis, campaign, origin, limit)
    began = min((run.started for run in campaign.runs if run.started is not None), default=None)
    html = diagnosis_page(diagnosis, campaign, content) if page else None
    write_model(folder / "baseline.json", diagnosis.baseline.model, origin=began, fitted=diagnosis.baseline.free)
    write_model(folder / "model.json", diagnosis.extended.model, origin=began, fitted=diagnosis.extended.free)
    write_rivals(folder, diagnosis, campaign, origin)
    if html is not None:
        write_text(folder / "report.html", html)
    write_json(folder / "findings.json", content)
