"""Findings for tests: play in a coupling, with any key replaced."""

from __future__ import annotations

from typing import Any

import msgspec

from isorig.rig.files.findings import Findings


def value(size: float, std: float | None = 1.0, unit: str = "1") -> dict[str, Any]:
    """A value as in the file."""
    return {"value": size, "std": std, "unit": unit}


def named(**more: Any) -> dict[str, Any]:
    """A step of play in a coupling."""
    return {
        "cause": "backlash", "location": "coupling", "kind": "spring_shape", "form": "backlash", "closest_form": None,
        "level": "form", "share": {"value": 0.99, "low": 0.98, "high": 1.0}, "confidence": 1.0, "rivals": [],
        "evidence": ["The force is flat around zero."], "holdout_error_before": 0.35, "holdout_error_after": 0.013,
        "parameters": {"clearance": value(0.00025, 1.5e-7, "m"), "residual": value(0.0, 0.01)}, **more,
    }  # fmt: skip


def findings(**more: Any) -> Findings:
    """The findings of play in a coupling."""
    errors = {"end_stop": 0.3, "hardening_stiffness": 0.12, "softening_stiffness": 0.2, "stiffness_drift": 0.34}
    out = [
        {
            "cause": cause, "kind": "spring_shape", "location": "coupling", "holdout_error": error, "share": 0.1,
            "standing": "ruled out", "why": "Its error is larger.",
        }
        for cause, error in errors.items()
    ]  # fmt: skip
    share = {"value": 0.1, "low": 0.0, "high": 0.2}
    natures = ("noise", "disturbance", "linear", "amplitude", "time", "unassigned")
    budget = {**dict.fromkeys(natures, share), "by_channel": {}, "by_configuration": {}, "how": "Noise: of the sensors."}
    content = {
        "format": "rig-findings", "format_version": 2, "verdict": "explained", "doubts": [], "cut_short": False,
        "time_limit_s": None, "tolerance": 0.0, "steps": [named()], "candidates": out, "indistinguishable": [],
        "origin": {"baseline": "description", "recording": "c.h5"}, "baseline": {"name": "description", "parameters": {}},
        "extended": {"parameters": {}}, "discrepancies": [], "evidence": [], "remarks": [],
        "adequacy": {"worst": 20.0, "threshold": 1.5, "baseline_rig": None, "how": "Largest ratio of errors."},
        "budget": {"baseline": budget, "extended": budget},
        "holdout": {
            "baseline": 0.35, "extended": 0.013, "noise_floor": 0.012, "baseline_interval": [0.34, 0.36],
            "extended_interval": [0.012, 0.014], "removed": 0.99, "removed_interval": [0.98, 1.0], "interval": "95 %",
            "how": "Median over runs and channels.",
        }, **more,
    }  # fmt: skip
    return msgspec.convert(content, Findings)
