"""How far links swing: what was measured where that is clear, else no more than the model does."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from isorig.analysis.diagnose import observe
from isorig.analysis.diagnose.observe import _simulated_swings, swings
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.model.rig_model import Chain, RigModel
from isorig.analysis.spectra.motion import motion_of
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.session import VirtualRun, virtual_campaign

RIG = wire_bonder({**THESIS, "friction_force": 4.0})
TAKES = (VirtualRun(id="u70", configuration="unlocked", gain=70.0, seconds=20.0, start=0.0),)
TRIALS = prepare(virtual_campaign(RIG, TAKES, seed=5), RIG)


def truly(link: str) -> float:
    return _simulated_swings(RIG, TRIALS[0])[link][1]


def test_a_model_that_hardly_moves_does_not_hide_the_measured_swing() -> None:
    stuck = RIG.replace({"contacts.isolation.law.friction_force": 400.0})
    assert _simulated_swings(stuck, TRIALS[0])["isolation"][1] < 0.01 * truly("isolation")
    deflection, speed = swings(stuck, TRIALS)
    # Motion below the drive's band is not in the measured figure.
    assert deflection["isolation"] == pytest.approx(truly("isolation"), rel=0.15)
    assert speed["isolation"] == pytest.approx(_simulated_swings(RIG, TRIALS[0])["isolation"][0], rel=0.1)


def test_calibration_errors_of_sensors_that_move_together_are_no_swing() -> None:
    def misread(model: RigModel) -> RigModel:
        sensors = tuple(
            msgspec.structs.replace(s, chain=Chain(gain=1.05)) if s.channel == "heatblock" else s for s in model.sensors
        )
        return msgspec.structs.replace(model, sensors=sensors)

    trials = prepare(virtual_campaign(misread(RIG), TAKES, seed=5), RIG)
    table = _simulated_swings(RIG, trials[0])["table"][1]
    assert truly("heatblock") < 0.01 * table
    assert swings(RIG, trials)[0]["heatblock"] == pytest.approx(truly("heatblock"), rel=1e-6)


def test_a_swing_is_clear_from_the_thresholds_on(monkeypatch: pytest.MonkeyPatch) -> None:
    trial, link = TRIALS[0], RIG.link("isolation")
    rows = [trial.channels.index(channel) for channel in ("motor", "table")]
    own = [motion_of(trial.measured[row], "acceleration", trial.sample_rate, trial.run.band)[1] for row in rows]

    def clear(noise: float, share: float) -> bool:
        monkeypatch.setattr(observe, "CLEAR_OF_NOISE", noise)
        monkeypatch.setattr(observe, "OWN", share)
        found = observe._measured_swing(RIG, link, trial)
        assert found is not None
        return found.clear

    share = float(np.abs(own[0] - own[1]).max()) / max(float(np.abs(motion).max()) for motion in own)
    assert clear(0.0, 0.999 * share)
    assert not clear(0.0, 1.001 * share)
    # White noise of accelerations, integrated twice above the lowest frequency, peaks at three to five deviations.
    lowest = max(1.0, 1.5 * trial.run.band[0]) if trial.run.band else 1.0
    spread = sum(trial.noise[row] for row in rows) * np.sqrt(2.0 / trial.sample_rate / (3.0 * (2.0 * np.pi) ** 4 * lowest**3))
    swing = float(np.abs(own[0] - own[1]).max())
    assert clear(swing / (6.0 * spread), 0.0)
    assert not clear(swing / (2.0 * spread), 0.0)
