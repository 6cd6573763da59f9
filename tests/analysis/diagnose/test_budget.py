"""What an error consists of, on small rigs whose disturbance, noise and misfit are known because they were put in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from small_rigs import SESSION, Take, chain, played, rubbing

from isorig.analysis.campaign import Campaign
from isorig.analysis.diagnose.budget import NATURES, budget
from isorig.analysis.fitting.division import ends
from isorig.analysis.fitting.ladder import misfit
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.repeats import disturbance, repeated, with_disturbance
from isorig.analysis.fitting.residuals import Problem
from isorig.analysis.fitting.score import noise_floors
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.model.rig_model import RigModel

SEED = 20411


def judged(campaign: Campaign, model: RigModel) -> tuple[Trial, ...]:
    return ends(prepare(campaign, model)).judged


def shares(campaign: Campaign, model: RigModel) -> dict[str, float]:
    trials = judged(campaign, model)
    noise = noise_floors(model, trials)[0]
    found = budget(model, trials, noise)
    assert sum(share for share, _, _ in found.shares.values()) == pytest.approx(1.0)
    assert all((low <= share + 1e-9 and share <= high + 1e-9) or share < 1e-6 for share, low, high in found.shares.values())
    assert tuple(found.shares) == NATURES
    assert found.repeated == bool(repeated(trials))
    assert found.repeated != ("not measured, because no drive was repeated" in found.how)
    return {name: share for name, (share, _, _) in found.shares.items()}


def shaken(campaign: Campaign, share: float, *, follows: bool = False) -> Campaign:
    """The campaign with motion of the floor on every response, alike in all runs: a share of the first record's rms.

    With `follows`, the share is that of every record's own rms.
    """
    from scipy.signal import butter, sosfilt

    draw = np.random.default_rng(5)
    low = butter(4, 60.0, fs=campaign.runs[0].sample_rate, output="sos")
    runs = []
    for run in campaign.runs:
        channels = dict(run.channels)
        for name in ("a0", "a1", "a2"):
            values, usual = run.read(name), float(np.std((run if follows else campaign.runs[0]).read(name)))
            floor = sosfilt(low, draw.normal(0.0, 1.0, len(values)))
            channels[name] = replace(channels[name], samples=values + share * usual / np.std(floor) * floor)
        runs.append(replace(run, channels=channels))
    return replace(campaign, runs=tuple(runs))


def test_a_perfect_model_leaves_noise() -> None:
    assert shares(played(chain(), seed=SEED, takes=SESSION), chain())["noise"] > 0.9


def test_a_shaking_floor_is_a_disturbance_of_its_size() -> None:
    campaign = shaken(played(chain(), seed=SEED, takes=SESSION), 0.02)
    found = shares(campaign, chain())
    # 2 % of the signal beside 0.2 % of noise: the error's power is 99 % disturbance.
    assert found["disturbance"] == pytest.approx(0.99, abs=0.1)
    measured = disturbance(chain(), judged(campaign, chain()))
    assert np.median(measured) == pytest.approx(0.02, rel=0.25)


@pytest.mark.parametrize(("follows", "in_weak_run"), [(False, 0.04), (True, 0.02)])
@pytest.mark.parametrize("gain", [1.0, 1.1])
def test_a_disturbance_from_outside_has_the_same_power_in_a_run_of_half_the_level(
    follows: bool, in_weak_run: float, gain: float
) -> None:  # fmt: skip
    campaign = shaken(played(chain(), seed=SEED, takes=SESSION, longer=5.0), 0.02, follows=follows)
    scaled = [
        replace(run, channels={**run.channels, "a0": replace(run.channels["a0"], scale=gain)}) for run in campaign.runs
    ]  # fmt: skip
    measured = disturbance(chain(), judged(replace(campaign, runs=tuple(scaled)), chain()))
    assert np.median(measured, axis=1) == pytest.approx([0.02, 0.02, in_weak_run, 0.01], rel=0.25)


def test_a_perfect_model_of_a_shaken_rig_agrees_with_the_data_once_the_disturbance_is_known() -> None:
    trials = ends(prepare(shaken(played(chain(), seed=SEED, takes=SESSION, longer=5.0), 0.05), chain())).fits
    known = with_disturbance(chain(), trials)
    assert misfit(chain(), Problem(trials)) > 10.0
    assert misfit(chain(), Problem(known, share=0.0)) == pytest.approx(1.0, rel=0.25)
    for trial, sound in zip(known, played(chain(), seed=SEED, takes=SESSION, longer=5.0).runs, strict=True):
        assert trial.disturbance is not None
        put_in = np.stack([trial.run.read(name) - sound.read(name) for name in trial.channels])
        low, high = (trial.disturbance.at(np.array([frequency]))[:, 0] for frequency in (30.0, 150.0))
        assert low == pytest.approx(put_in.std(axis=1) * np.sqrt(200.0 / 60.0), rel=0.3)
        assert np.all(high < 0.2 * low)


def test_a_rig_that_changes_between_repeated_runs_is_not_disturbed() -> None:
    campaign = played(chain(), seed=SEED, takes=SESSION, longer=5.0)
    first, second, *others = campaign.runs
    louder = {**second.channels, "a0": replace(second.channels["a0"], scale=1.1)}
    changed = replace(campaign, runs=(first, replace(second, channels=louder), *others))
    trials = ends(prepare(changed, chain())).fits
    frequency = np.linspace(0.0, 200.0, 2001)
    for trial in with_disturbance(chain(), trials)[:2]:
        assert trial.disturbance is not None
        power = np.mean(trial.disturbance.at(frequency)[0] ** 2)
        assert power < 0.2 * 0.5 * np.var(0.1 * trial.measured[0])


def test_repeats_alike_to_the_accuracy_of_fits_leave_the_runs_as_they_are() -> None:
    trials = ends(prepare(shaken(played(chain(), seed=SEED, takes=SESSION), 0.003), chain())).fits
    assert all(one is other for one, other in zip(with_disturbance(chain(), trials), trials, strict=True))


def test_a_sensors_wrong_gain_is_linear() -> None:
    # Long enough that segments resolve the resonances.
    campaign = played(chain(), seed=SEED, takes=SESSION, longer=5.0)
    runs = tuple(replace(run, channels={**run.channels, "a0": replace(run.channels["a0"], scale=1.1)}) for run in campaign.runs)
    found = shares(replace(campaign, runs=runs), chain())
    assert found["linear"] > 0.75
    assert found["disturbance"] < 0.05


@pytest.mark.parametrize(("floor", "gain"), [(0.01, 1.04), (0.02, 1.04), (0.01, 1.08)])
def test_shares_of_a_mixture_are_within_a_quarter_of_what_was_put_in(floor: float, gain: float) -> None:
    clean = played(chain(), seed=SEED, takes=SESSION, longer=5.0)
    campaign = shaken(clean, floor)
    runs = tuple(replace(run, channels={**run.channels, "a0": replace(run.channels["a0"], scale=gain)}) for run in campaign.runs)
    mixed = replace(campaign, runs=runs)
    put_in = {"disturbance": 0.0, "linear": 0.0}
    for trial, before, after in zip(judged(mixed, chain()), clean.runs, mixed.runs, strict=True):
        for name in trial.channels:
            pure, seen = (run.read(name)[trial.fitted :] for run in (before, after))
            size = float(np.mean(seen**2))
            linear = (after.channels[name].scale - 1.0) * pure
            put_in["linear"] += float(np.mean(linear**2)) / size
            put_in["disturbance"] += float(np.mean((seen - pure - linear) ** 2)) / size
    found = shares(mixed, chain())
    rest = 1.0 - found["noise"]
    for nature, share in put_in.items():
        assert found[nature] == pytest.approx(rest * share / sum(put_in.values()), rel=0.25), nature


def test_friction_depends_on_the_amplitude() -> None:
    found = shares(played(rubbing(chain(), "l1", 1.0), seed=SEED, takes=SESSION), chain())
    assert found["amplitude"] > 0.5
    assert found["disturbance"] < 0.05


def test_without_a_repeat_nothing_is_called_a_disturbance() -> None:
    takes = tuple(Take(take.level, 10 + k) for k, take in enumerate(SESSION))
    campaign = shaken(played(chain(), seed=SEED, takes=takes), 0.02)
    found = shares(campaign, chain())
    assert found["disturbance"] == 0.0
    assert found["unassigned"] > 0.7
    assert not disturbance(chain(), judged(campaign, chain())).any()


def test_one_drive_played_twice_is_seen_or_said() -> None:
    campaign = played(chain(), seed=SEED, takes=SESSION)
    assert repeated(judged(campaign, chain())) == [(0, 1)]
    # What the recording says counts, whatever the records look like.
    runs = (*campaign.runs[:3], replace(campaign.runs[3], repeat_of="r2"))
    assert repeated(judged(replace(campaign, runs=runs), chain())) == [(0, 1), (2, 3)]
