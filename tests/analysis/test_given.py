"""What is taken as known, and how well: calibration and weighed masses in the deviations, a head that nobody has weighed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from isorig.analysis.campaign import Campaign
from isorig.analysis.fitting.influence import changes_with_given_values
from isorig.analysis.fitting.uncertainty import HEAD
from isorig.analysis.parameters.joint_fit import Characterization, characterize
from isorig.rig.model.baseline import baseline_model
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.session import VirtualRun, virtual_campaign

TAKES = (
    VirtualRun(id="u70", configuration="unlocked", gain=70.0, seconds=15.0, start=0.0),
    VirtualRun(id="u7", configuration="unlocked", gain=7.0, seconds=8.0, start=40.0, band=(0.5, 400.0)),
    VirtualRun(id="l70", configuration="locked", gain=70.0, seconds=8.0, start=80.0),
)


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    return virtual_campaign(wire_bonder(), TAKES, seed=4)


def of(campaign: Campaign, **known: float) -> Characterization:
    stated = replace(campaign, known={**campaign.known, **known})
    return characterize(stated, baseline_model(stated))


@pytest.fixture(scope="module")
def bare(campaign: Campaign) -> Characterization:
    """The fit with nothing stated but the recording's masses."""
    return of(campaign)


def test_calibration_is_carried_through_the_fit(campaign: Campaign, bare: Characterization) -> None:
    stated = of(campaign, calibration_std=0.01, head_mass_std=0.05)
    assert not bare.calibrated
    assert stated.calibrated
    for name in ("table_mass", "friction_force", "table_damping"):
        narrow, wide = bare.table[name], stated.table[name]
        assert narrow.value == pytest.approx(wide.value)
        assert wide.std > 10.0 * narrow.std  # type: ignore[operator]
    # A force is the head's mass times its acceleration: one per cent of the sensor and 0.8 % of the mass go in full.
    friction = stated.table["friction_force"]
    assert friction.std == pytest.approx(20.0 * np.hypot(0.01, 0.05 / 6.5), rel=0.1)


def test_a_linear_step_equals_a_refit(campaign: Campaign, bare: Characterization) -> None:
    """A sensor that reads one per cent more, fitted anew, moves the values as the derivatives say."""
    (moves,) = changes_with_given_values(bare.fit, bare.trials, {"sensors.table.chain.gain": 0.01})
    runs = []
    for run in campaign.runs:
        table = run.channels["table"]
        runs.append(replace(run, channels={**run.channels, "table": replace(table, scale=1.01 * table.scale)}))
    anew = of(replace(campaign, runs=tuple(runs)))
    for k, free in enumerate(bare.fit.free):
        value = bare.fit.model.get(free.path)
        moved = anew.fit.model.get(free.path) - value
        # The sensor's gain in the model and in the data go opposite ways.
        assert moved == pytest.approx(-moves[k], abs=0.1 * abs(moves[k]) + 2e-4 * value), free.path


def test_a_head_that_nobody_weighed_is_fitted(campaign: Campaign, bare: Characterization) -> None:
    known = {name: value for name, value in campaign.known.items() if name != "head_mass"}
    unweighed = replace(campaign, known={**known, "motor_mass_std": 0.164})
    found = characterize(unweighed, baseline_model(unweighed))
    assert found.head_mass.method == "joint fit"
    assert found.head_mass.value == pytest.approx(THESIS["head_mass"], rel=1e-3)
    # All masses are known only as well as the one that was weighed.
    assert found.head_mass.std == pytest.approx(0.01 * THESIS["head_mass"], rel=0.1)
    assert found.table["table_mass"].std == pytest.approx(0.01 * 80.0, rel=0.2)
    assert HEAD in found.fit.values
    assert bare.head_mass.method == "given"
    assert HEAD not in bare.fit.values


def test_a_mass_that_is_not_in_the_recording_is_not_called_weighed(campaign: Campaign) -> None:
    known = {name: value for name, value in campaign.known.items() if name != "heatblock_mass"}
    assumed = replace(campaign, known=known)
    found = characterize(assumed, baseline_model(assumed))
    assert "assumed" in found.table["heatblock_mass"].note
    assert found.table["motor_mass"].note == "weighed"
