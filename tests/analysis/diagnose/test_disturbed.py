"""What is related to neither the drive nor the motion is a disturbance: it hides no cause and asks for none."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from scipy.signal import butter, sosfilt
from small_rigs import chain, guessed, played, with_law

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign, Channel, FloatArray
from isorig.analysis.diagnose import diagnosis
from isorig.analysis.diagnose.diagnosis import Diagnosis, _Search, diagnose
from isorig.analysis.diagnose.suspects import SHOWN
from isorig.analysis.fitting.ladder import baseline_fit
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.residual_analysis import DETECTABLE, _chance, depends_on_drive
from isorig.analysis.fitting.uncertainty import MOST_NOISE
from isorig.analysis.model.rig_model import RigModel

SEED = 8300


def disturbed(campaign: Campaign, share: float, *, tone: bool = False) -> Campaign:
    """The accelerometers also see the floor, each its own, or a fan: a share of the first run's rms in all runs."""
    draw, runs = np.random.default_rng(SEED), []

    def floor(n: int, rate: float) -> FloatArray:
        if tone:
            return np.asarray(np.sqrt(2.0) * np.sin(2.0 * np.pi * (17.0 * np.arange(n) / rate + draw.uniform())))
        noise = sosfilt(butter(2, [4.0, 25.0], "band", fs=rate, output="sos"), draw.normal(0.0, 1.0, n))
        return np.asarray(noise / noise.std())

    for run in campaign.runs:
        channels = dict(run.channels)
        for name in (name for name in channels if name.startswith("a")):
            values, size = run.read(name), share * float(np.std(campaign.runs[0].read(name)))
            channels[name] = Channel(
                name=name, samples=values + size * floor(len(values), run.sample_rate), quantity="acceleration", unit="m/s^2"
            )  # fmt: skip
        runs.append(replace(run, channels=channels))
    return Campaign(runs=tuple(runs), source="disturbed")


def found(truth: RigModel, share: float, *, longer: float = 1.0) -> Diagnosis:
    return diagnose(disturbed(played(truth, seed=SEED, longer=longer), share), guessed(chain(), SEED))


def test_a_sound_rig_on_a_shaking_floor_is_adequate() -> None:
    answer = found(chain(), 0.03)
    assert answer.verdict == "adequate"
    assert any("related to neither the drive nor the motion" in sign.text for sign in answer.signs)
    assert answer.budgets[0].shares["unassigned"][0] == 0.0
    assert answer.budgets[0].shares["disturbance"][0] > 0.9


def test_a_cause_on_a_shaking_floor_is_named_alone() -> None:
    answer = found(with_law(chain(), "l1", laws.Cubic(cubic_stiffness=2e7)), 0.03, longer=0.5)
    assert [(step.cause, step.location) for step in answer.steps] == [("hardening_stiffness", "l1")]
    assert answer.verdict == "explained"


@pytest.mark.parametrize("hidden", [False, True])
@pytest.mark.parametrize(
    ("figure", "score", "what", "channels", "searched", "only"),
    [
        (0.99 * MOST_NOISE, 0.0, "mass", 0, False, True),
        (MOST_NOISE, 0.0, "mass", 0, False, False),
        (0.01, 0.99 * SHOWN, "mass", 0, True, True),
        (0.01, SHOWN, "mass", 0, True, False),
        (0.01, SHOWN, "hum", 1, False, False),
        (0.01, SHOWN, "hum", 2, False, True),
        (0.01, SHOWN, "hum", 1, True, True),
    ],
)
def test_a_disturbance_is_small_and_nothing_explains_it(
    figure: float, score: float, what: str, channels: int, searched: bool, only: bool, hidden: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    explanation = SimpleNamespace(what=what, score=score)
    monkeypatch.setattr(diagnosis, "ranking", lambda equations: SimpleNamespace(explanations=[explanation]))
    monkeypatch.setattr(diagnosis, "depends_on_drive", lambda model, trials: False)
    search = _Search(None, None, None, None, [], lambda text: None, 0.0, 1)
    job = SimpleNamespace(
        now=SimpleNamespace(figure=figure), evidence=SimpleNamespace(mains=dict.fromkeys(map(str, range(channels)), 50.0)),
        equations=SimpleNamespace(hidden=hidden), current=SimpleNamespace(model=SimpleNamespace(encoded=b"")),
    )  # fmt: skip
    assert search._only_disturbed(job, searched=searched) is only


def test_a_tone_counts_as_related() -> None:
    """The few frequency bins that it is in would not show a relation."""
    campaign = played(chain(), seed=SEED)
    for tone, expected in ((False, False), (True, True)):
        shaken = disturbed(campaign, 0.03, tone=tone)
        trials = prepare(shaken, chain())
        assert depends_on_drive(baseline_fit([chain()], trials).model, trials) is expected


@pytest.mark.parametrize("bins", [1, 2, 30])
def test_the_coherence_that_must_show_has_the_probability_of_a_gamma_distribution(bins: int) -> None:
    draw, averages = np.random.default_rng(SEED), 15.0
    left, values = draw.normal(size=(2, 23, bins)) + 1j * draw.normal(size=(2, 23, bins))
    power = (np.abs(left) ** 2).sum(axis=0)
    shape = 0.5 * power.sum() ** 2 / (power**2).sum()
    chance, _, detectable = _chance(left, values, 1.0, averages)
    assert detectable == pytest.approx(stats.gamma.sf(averages * DETECTABLE, shape, scale=1.0 / shape))
    assert chance > 1e-3
