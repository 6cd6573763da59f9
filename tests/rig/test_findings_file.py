"""findings.json: its keys are those of the contract, what is not available is null, and other files are refused."""

from __future__ import annotations

import json
import math
from pathlib import Path

import msgspec
import pytest
from some_findings import findings, named

from isorig.rig.errors import PlanError
from isorig.rig.files.findings import Findings, as_read, read_findings, write_findings

#: Keys that other programs read, by their place in the file.
CONTRACT = {
    (): "format format_version verdict baseline discrepancies steps indistinguishable holdout budget candidates",
    ("baseline",): "name parameters",
    ("steps", 0): "cause location kind form closest_form level share curve parameters confidence rivals evidence "
    "holdout_error_before holdout_error_after",
    ("steps", 0, "closest_form"): "cause share",
    ("steps", 0, "share"): "value low high",
    ("steps", 0, "curve"): "over unit points value_unit reached",
    ("steps", 0, "parameters", "clearance"): "value std unit",
    ("steps", 0, "rivals", 0): "cause location holdout_error",
    ("discrepancies", 0): "channel configuration gain band_hz what size noise text",
    ("indistinguishable", 0, 0): "cause location",
    ("holdout",): "baseline extended noise_floor how",
    ("budget",): "baseline extended",
    ("budget", "extended"): "noise disturbance linear amplitude time unassigned how",
    ("candidates", 0): "cause kind location holdout_error share standing why",
}


def whole() -> Findings:
    """Findings with something at every key."""
    curve = {"over": "deflection", "unit": "m", "value_unit": "N", "points": [[0.0, 1.0, math.nan]], "reached": [-1e-3, 1e-3]}
    step = named(
        curve=curve,
        closest_form={"cause": "end_stop", "share": 0.7},
        rivals=[{"cause": "end_stop", "location": "coupling", "holdout_error": 0.3}],
    )
    wrong = {
        "channel": "x1", "configuration": "unlocked", "gain": 1.0, "run": "a", "band_hz": [4.0, 6.0], "what": "frf",
        "size": 0.4, "noise": 0.01, "text": "The x1 is wrong.",
    }  # fmt: skip
    places = [{"cause": cause, "location": "coupling"} for cause in ("backlash", "end_stop")]
    return findings(steps=[step], discrepancies=[wrong], indistinguishable=[places])


def test_the_file_has_the_keys_that_other_programs_read(tmp_path: Path) -> None:
    content = json.loads(write_findings(tmp_path, whole()).read_text())
    assert (content["format"], content["format_version"]) == ("rig-findings", 2)
    for place, keys in CONTRACT.items():
        part = content
        for key in place:
            part = part[key]
        assert set(keys.split()) <= set(part), place
    assert content["steps"][0]["curve"]["points"] == [[0.0, 1.0, None]]


def test_a_step_without_a_free_shape_has_no_curve(tmp_path: Path) -> None:
    content = json.loads(write_findings(tmp_path, findings()).read_text())
    assert "curve" not in content["steps"][0]
    assert content["steps"][0]["closest_form"] is None


def test_a_reader_gets_what_was_written(tmp_path: Path) -> None:
    write_findings(tmp_path, whole())
    assert read_findings(tmp_path) == as_read(whole())
    content = json.loads((tmp_path / "findings.json").read_text())
    (tmp_path / "findings.json").write_text(json.dumps({**content, "a_later_key": 1}))
    assert read_findings(tmp_path) == as_read(whole())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"format_version": 1}, "of another version"),
        ({"format": "rig-rivals"}, "rig-rivals"),
        ({"verdict": "perhaps"}, "verdict"),
        ({"steps": [{}]}, "steps[0]"),
        ({"holdout": None}, "holdout"),
    ],
)
def test_other_files_are_refused_in_a_sentence(tmp_path: Path, change: dict[str, object], said: str) -> None:
    content = json.loads(write_findings(tmp_path, findings()).read_text())
    (tmp_path / "findings.json").write_text(json.dumps({**content, **change}))
    with pytest.raises(PlanError, match="damaged or of another version") as refusal:
        read_findings(tmp_path)
    assert said in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_folder_without_findings_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PlanError, match="contains no diagnosis"):
        read_findings(tmp_path)
    (tmp_path / "findings.json").write_text("{")
    with pytest.raises(PlanError, match="damaged"):
        read_findings(tmp_path)


def test_a_value_that_the_format_does_not_have_is_not_written() -> None:
    with pytest.raises(msgspec.ValidationError):
        as_read(msgspec.structs.replace(findings(), verdict="perhaps"))
