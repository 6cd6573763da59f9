"""One uncertainty and one floor: the page's values are those of characterize, and differences between runs count."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
import pytest
from strange_rigs import StrangeRig, campaign

import isorig as iso
from isorig.analysis.errors import ModelError
from isorig.analysis.fitting import uncertainty
from isorig.analysis.fitting.drive_noise import DriveNoise
from isorig.analysis.fitting.influence import normalised
from isorig.analysis.fitting.score import Score
from isorig.analysis.fitting.solve import Fit, Free
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.fitting.uncertainty import Known
from isorig.analysis.model.rig_model import RigModel
from isorig.rig.cli import main
from isorig.rig.files.rigfile import description_text, read_rig
from isorig.rig.virtual.simulated_recording import described_campaign
from isorig.rig.wire_bonder.description import wire_bonder

ONE = np.ones(1)


def known(
    *,
    bins: float,
    noise: float = 0.0,
    runs: float = 0.0,
    ratio: float = 4.0,
    step: float = 0.0,
    bias: float = 0.0,
    given: float = 0.0,
    filters: float = 0.0,
) -> Known:
    """Of one value, from a thousand bins."""
    moves = np.full((1000, 1), bins / np.sqrt(1000.0))
    square = np.zeros((1, 1))
    return Known(
        moves=moves,
        held=square,
        noise=square + noise**2,
        runs=square + runs**2,
        ratio=ratio,
        step=ONE * step,
        bias=ONE * bias,
        given=square + given,
        filters=ONE * filters,
    )


@pytest.mark.parametrize(
    ("parts", "whole"),
    [
        ({"bins": 2.0}, 2.0),
        ({"bins": 2.0, "noise": 3.0}, 3.0),
        ({"bins": 2.0, "noise": 1.0}, 2.0),
        ({"bins": 2.0, "runs": 3.99}, 2.0),  # such differences between runs are chance
        ({"bins": 2.0, "runs": 4.01}, 4.01),
        ({"bins": 3.0, "step": 4.0}, 5.0),
        ({"bins": 3.0, "bias": 4.0}, 5.0),
        ({"bins": 3.0, "given": 4.0}, 5.0),
    ],
)
def test_the_largest_part_counts(parts: dict[str, float], whole: float) -> None:
    each = known(**parts)
    assert each.deviation(ONE) == pytest.approx(whole, rel=2e-3)
    fit = Fit(
        model=wire_bonder(),
        free=(Free(path="bodies.table.mass"),),
        covariance=each.covariance,
        cost=1.0,
        evaluations=1,
        known=each,
    )
    assert fit.std["bodies.table.mass"] == pytest.approx(whole, rel=2e-3)
    # Draws of a fit share the errors of the known values.
    drawn = whole if "given" not in parts else parts["bins"]
    assert np.sqrt(each.covariance[0, 0]) == pytest.approx(drawn, rel=2e-3)


@pytest.mark.parametrize(("ratio", "kept"), [(1.09, True), (1.11, False)])
def test_a_correction_that_makes_the_errors_larger_is_dropped(ratio: float, kept: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    path, bias = "bodies.motor.mass", 0.5
    free = Free(path=path, low=1e-3, high=1e3, log=True, step=1e-4)
    done = Fit(model=wire_bonder(), free=(free,), covariance=np.eye(1), cost=1.0, evaluations=0)
    mass = done.model.get(path)

    def judged(model: RigModel, trials: Sequence[Trial]) -> Score:
        error = np.full((1, 1), 0.01 if model.get(path) == mass else 0.01 * ratio)
        return Score(error=error, blocks=error[..., None], power=error[..., None])

    monkeypatch.setattr(uncertainty, "score", judged)
    fitted, scored = uncertainty._corrected(done, judged(done.model, []), DriveNoise(np.array([bias]), np.eye(1)), [])
    assert fitted.model.get(path) == pytest.approx(mass - bias if kept else mass)
    assert scored.figure == pytest.approx(0.01 * ratio if kept else 0.01)


def test_the_sampling_filter_counts_for_values() -> None:
    each = known(bins=3.0, filters=4.0)
    assert each.std == pytest.approx([5.0], rel=2e-3)
    assert each.deviation(ONE) == pytest.approx(3.0, rel=2e-3)


def test_the_page_and_characterize_agree(tmp_path: Path) -> None:
    from dataclasses import replace

    rig = StrangeRig(masses=(2.0, 3.0), joints=((0, -1, 6e3, 15.0), (1, 0, 9e3, 20.0)),
                     sensors=(("x", 0, "acceleration"), ("y", 1, "acceleration")))  # fmt: skip
    made = replace(
        campaign(rig, (10.0, 20.0), seconds=12.0), description=description_text(rig.description({"links.l0.stiffness": 1.2}), {})
    )
    iso.write(tmp_path / "a.h5", made)
    # Tolerated, so that no cause is searched for.
    assert main(["diagnose", str(tmp_path / "a.h5"), "--tolerance", "0.05", "-o", str(tmp_path / "d")]) == 0
    model = str(tmp_path / "d" / "model.json")
    assert main(["characterize", str(tmp_path / "a.h5"), "--model", model, "-o", str(tmp_path / "c")]) == 0
    assert main(["characterize", str(tmp_path / "a.h5"), "-o", str(tmp_path / "p")]) == 0
    found = json.loads((tmp_path / "d" / "findings.json").read_text())
    for folder in ("c", "p"):
        table = json.loads((tmp_path / folder / "parameters.json").read_text())
        for path, row in found["extended"]["parameters"].items():
            other = table["parameters"][path]
            assert row["std"] == pytest.approx(other["std"], rel=0.25), path
            assert abs(row["value"] - other["value"]) < 0.2 * row["std"], path


def test_the_stated_uncertainty_of_a_mass_is_in_all_values_that_scale_with_it() -> None:
    """Only the first mass is given: forces, stiffnesses and the other mass scale with it, natural frequencies do not."""
    share, given = 0.05, read_rig("two-carts")
    first, *others = given.model.bodies
    made = described_campaign(given, seed=1, seconds=6.0)
    stated = msgspec.structs.replace(given.model, bodies=(msgspec.structs.replace(first, mass_std=share * first.mass), *others))
    exact, uncertain = (iso.characterize(made, model).table for model in (given.model, stated))
    assert uncertain["bodies.first.mass"].std == share * first.mass
    for path in given.model.free:
        whole = np.hypot(exact[path].std or 0.0, share * given.model.get(path))
        assert uncertain[path].std == pytest.approx(whole, rel=0.05), path
    for name in ("mode1.frequency", "mode2.damping"):
        row = uncertain[name]
        assert row.std is not None
        assert row.value is not None
        assert row.std < 0.02 * share * row.value, name


def test_an_uncertainty_as_large_as_its_value_is_refused() -> None:
    with pytest.raises(ModelError, match="body 'table' has mass_std 300; give the standard uncertainty of its mass 250"):
        wire_bonder().replace({"bodies.table.mass": 250.0, "bodies.table.mass_std": 300.0})


def test_a_value_without_any_effect_has_a_finite_uncertainty() -> None:
    """Student's distribution takes the fourth power of what a frequency bin changes."""
    path, other = "bodies.motor.mass", "bodies.table.mass"
    free = tuple(Free(path=each, low=1e-3, high=1e3, log=True, step=1e-4) for each in (path, other))
    jacobian = np.stack([np.ones(8), np.full(8, 1e-310)], axis=1)
    done = Fit(
        model=wire_bonder(),
        free=free,
        covariance=np.eye(2),
        cost=1.0,
        evaluations=0,
        jacobian=jacobian,
        residual=np.ones(8),
        sizes=(8,),
    )
    scale, columns, bread = normalised(done)
    changes = columns @ bread / scale
    assert np.all(np.isfinite(changes**4))
    assert changes[:, 0] == pytest.approx(0.125)
