"""A diagnosis as the files that other programs read: findings.json, the two models, the report."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from analysis.diagnose.diagnosis import Diagnosis
from analysis.diagnose.step import Step
from analysis.fit import Fit
from analysis.measured import Campaign
from rig.models import write_model
from rig.output import write_json, write_text
from rig.report.diagnosis import diagnosis_page
from rig.units import unit_of


def findings(diagnosis: Diagnosis, origin: Mapping[str, str]) -> dict[str, Any]:
    """The content of findings.json."""
    return {
        "format": "rig-findings",
        "format_version": 1,
        "origin": dict(origin),
        "verdict": diagnosis.verdict,
        "baseline": {"name": origin["baseline"], "parameters": parameters(diagnosis.baseline)},
        "discrepancies": [
            {
                "channel": d.channel, "configuration": d.configuration, "gain": d.gain, "run": d.run,
                "band_hz": list(d.band_hz), "what": d.what, "size": d.size, "noise": d.noise, "text": d.text,
            }
            for d in diagnosis.discrepancies
        ],
        "evidence": [sign.text for sign in diagnosis.signs],
        "adequacy": {
            "worst": diagnosis.worst, "threshold": diagnosis.enough, "baseline_rig": diagnosis.calibration,
            "how": "Largest error of a run and channel over what noise and the simulation's own limit allow; the threshold is "
            "raised to 1.2 times what the baseline's own rig gets, simulated with the data's noise, where that is in doubt.",
        },
        "steps": [_step(step) for step in diagnosis.steps],
        "indistinguishable": [
            [_place(step.cause, step.location), *(_place(*key) for key in step.indistinguishable)]
            for step in diagnosis.steps
            if step.indistinguishable
        ],
        "holdout": {
            "baseline": diagnosis.baseline_error,
            "extended": diagnosis.extended_error,
            "noise_floor": diagnosis.floor,
            "baseline_interval": list(diagnosis.gain.before),
            "extended_interval": list(diagnosis.gain.after),
            "removed": diagnosis.gain.removed if diagnosis.steps else 0.0,
            "removed_interval": list(diagnosis.gain.removed_interval),
            "interval": "95 % of 400 draws of held-out blocks (bootstrap)",
            "how": f"Median over runs and channels of rms(predicted - measured) / rms(measured) over {diagnosis.division.how}.",
        },
    }  # fmt: skip


def parameters(fitted: Fit) -> dict[str, Any]:
    """Fitted values with deviations and units, by path."""
    std = fitted.std
    return {path: {"value": value, "std": std[path], "unit": unit_of(path)} for path, value in fitted.values.items()}


def _step(step: Step) -> dict[str, Any]:
    return {
        "cause": step.cause,
        "location": step.location,
        "parameters": {k: {"value": v, "std": s, "unit": u} for k, (v, s, u) in step.parameters.items()},
        "confidence": step.confidence,
        "rivals": [msgspec.to_builtins(rival) for rival in step.rivals],
        "evidence": list(step.evidence),
        "holdout_error_before": step.before,
        "holdout_error_after": step.after,
    }


def _place(cause: str, location: str) -> dict[str, str]:
    return {"cause": cause, "location": location}


def write_findings(folder: Path, diagnosis: Diagnosis, campaign: Campaign, origin: Mapping[str, str]) -> None:
    """Write the contract's four files into a folder.

    `origin` tells where the findings come from: the baseline's name, the recording's name and hash, this program's version.
    """
    content = findings(diagnosis, origin)
    began = min((run.started for run in campaign.runs if run.started is not None), default=None)
    page = diagnosis_page(diagnosis, campaign, content)
    write_model(folder / "baseline.json", diagnosis.baseline.model, origin=began)
    write_model(folder / "model.json", diagnosis.extended.model, origin=began)
    write_text(folder / "report.html", page)
    write_json(folder / "findings.json", content)
