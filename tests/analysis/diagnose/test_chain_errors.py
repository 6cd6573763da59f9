"""Small errors of several channels together are no cause of their own, and what remains with them may be a disturbance."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from small_rigs import chain, guessed, played, with_law
from test_disturbed import disturbed

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign
from isorig.analysis.diagnose.chain_errors import in_words, with_chain_errors
from isorig.analysis.diagnose.diagnosis import Diagnosis, diagnose
from isorig.analysis.fitting.ladder import baseline_fit
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.model.rig_model import Chain, RigModel

SEED = 8400
RATE = 400.0


def with_chains(model: RigModel, **chains: Chain) -> RigModel:
    sensors = (msgspec.structs.replace(one, chain=chains.get(one.channel, one.chain)) for one in model.sensors)
    return msgspec.structs.replace(model, sensors=tuple(sensors))


def soiled(model: RigModel) -> Campaign:
    """One channel is late by a third of a sample, two contain a hundredth of another, and the floor shakes all."""
    wrong = with_chains(
        model, a0=Chain(delay=0.35 / RATE), a1=Chain(crosstalk={"a2": 0.012}, gain=1.006), a2=Chain(crosstalk={"a0": -0.01})
    )
    return disturbed(played(wrong, seed=SEED, longer=0.5), 0.02)


def found(truth: RigModel) -> Diagnosis:
    return diagnose(soiled(truth), guessed(chain(), SEED))


def test_a_sound_rig_with_small_errors_of_its_channels_is_adequate() -> None:
    answer = found(chain())
    assert answer.verdict == "adequate"
    (said,) = (sign.text for sign in answer.signs if "several channels together" in sign.text)
    assert "a0 is 0.8" in said
    assert "ms late" in said


def test_a_cause_beside_them_is_named() -> None:
    answer = found(with_law(chain(), "l1", laws.Cubic(cubic_stiffness=2e7)))
    assert ("hardening_stiffness", "l1") in [(step.cause, step.location) for step in answer.steps]


@pytest.mark.parametrize(
    ("wrong", "path", "bound"),
    [
        (Chain(delay=1.2 / RATE), "sensors.a0.chain.delay", 1.0 / RATE),
        (Chain(gain=1.024), "sensors.a0.chain.gain", 1.02),
    ],
)
def test_an_error_beyond_what_good_instruments_have_is_not_fitted(wrong: Chain, path: str, bound: float) -> None:
    truth = with_chains(chain(), a0=wrong)
    trials = prepare(played(truth, seed=SEED), chain())
    known = baseline_fit([chain()], trials)
    fitted = with_chain_errors(known, trials)
    assert fitted is not None
    assert fitted.values[path] == pytest.approx(bound, rel=0.003)


@pytest.mark.parametrize(("share", "listed"), [(0.9, False), (1.1, True)])
def test_an_error_is_listed_from_what_a_calibration_tells(share: float, listed: bool) -> None:
    size, campaign = 0.1 * share, played(chain(), seed=SEED)
    trials = prepare(campaign, chain())
    known = baseline_fit([chain()], trials)
    fitted = with_chain_errors(known, trials)
    assert fitted is not None
    level = {name: float(np.sqrt(np.mean([np.mean(r.read(name) ** 2) for r in campaign.runs]))) for name in ("a0", "a2")}
    errors = {
        "sensors.a0.chain.delay": size / RATE, "sensors.a1.chain.gain": 1.0 + 0.02 * size,
        "sensors.a2.chain.crosstalk.a0": 0.03 * size * level["a2"] / level["a0"],
    }  # fmt: skip
    sure = replace(fitted, model=fitted.model.replace(errors), covariance=np.zeros_like(fitted.covariance), known=None)
    said = " ".join(in_words(known, sure, trials))
    for phrase in ("a0 is", "a1 reads", "a2 contains"):
        assert (phrase in said) is listed


def test_runs_judged_by_their_drive_have_none() -> None:
    trials = prepare(played(chain(), seed=SEED), chain())
    judged = tuple(replace(trial, motion=object()) for trial in trials)  # type: ignore[arg-type]
    assert with_chain_errors(baseline_fit([chain()], trials), judged) is None
