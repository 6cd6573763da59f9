"""The state of a rig at the start of a run that begins in motion, beside scipy's integration of the same rig."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import msgspec
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim

from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.diagnose.evidence import record_signs
from isorig.analysis.errors import SimulationError
from isorig.analysis.fitting import initial_state, motion_at_start, preparation
from isorig.analysis.fitting.division import ends
from isorig.analysis.fitting.motion_at_start import begins_in_motion, moving_start
from isorig.analysis.fitting.preparation import DECAYS, prepare
from isorig.analysis.fitting.residuals import Problem
from isorig.analysis.fitting.screen import shortened
from isorig.analysis.fitting.solve import Free, jacobian_of
from isorig.analysis.fitting.trials import Trial, expected
from isorig.analysis.laws import Cubic
from isorig.analysis.model.rig_model import Body, Configuration, Drive, Link, RigModel, Sensor
from isorig.analysis.simulate import Excitation, simulate

RATE, SECONDS, CUT = 256.0, 24.0, 8.0
MASS, STIFFNESS, DAMPING, CUBIC = 4.0, 4e3, 4.0, 4e7
#: Frequencies (Hz) and phases of the drive, 8 N each.
TONES = np.random.default_rng(3).uniform(1.0, 12.0, 12), np.random.default_rng(4).uniform(0.0, 2.0 * np.pi, 12)
RIG = RigModel(
    name="a mass on a spring",
    bodies=(Body(name="m", mass=MASS),),
    links=(Link(name="l", a="m", stiffness=STIFFNESS, damping=DAMPING, laws=(Cubic(cubic_stiffness=CUBIC),)),),
    configurations={"free": Configuration()},
    drive=Drive(channel="force", pushes={"m": 1.0}),
    sensors=(Sensor(channel="x", body="m", quantity="displacement"),),
)
LINEAR = msgspec.structs.replace(RIG, links=(msgspec.structs.replace(RIG.links[0], laws=()),))


def force(t: FloatArray) -> FloatArray:
    return np.asarray(8.0 * np.sin(2.0 * np.pi * np.multiply.outer(t, TONES[0]) + TONES[1]).sum(axis=-1))


@lru_cache
def motion() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Force, position and velocity by scipy, from rest."""

    def rates(t: float, state: FloatArray) -> list[float]:
        x, v = state
        return [v, float(force(np.asarray(t)) - STIFFNESS * x - DAMPING * v - CUBIC * x**3) / MASS]

    t = np.arange(round(SECONDS * RATE)) / RATE
    found = solve_ivp(rates, (0.0, SECONDS), (0.0, 0.0), t_eval=t, rtol=1e-7, atol=1e-10, method="DOP853")
    return force(t), found.y[0], found.y[1]


def campaign(first: int) -> Campaign:
    drive, x, _ = motion()
    noisy = x + np.random.default_rng(1).normal(0.0, 1e-3 * x.std(), len(x))
    channels = {
        "force": Channel(name="force", samples=drive[first:], quantity="force", unit="N"),
        "x": Channel(name="x", samples=noisy[first:], quantity="displacement", unit="m"),
    }
    return Campaign(runs=(Run(id="r", configuration="free", sample_rate=RATE, gain=1.0, channels=channels),), source="scipy")


def test_the_state_at_the_start_is_that_of_another_integrator() -> None:
    first = round(CUT * RATE)
    (trial,) = prepare(campaign(first), LINEAR)
    _, x, v = motion()
    position, velocity = trial.start_of(RIG)["m"]
    assert abs(position - x[first]) < 0.01 * x.std()
    assert abs(velocity - v[first]) < 0.01 * v.std()


def test_a_prediction_of_a_run_that_begins_in_motion_is_right_from_its_start() -> None:
    (trial,) = prepare(campaign(round(CUT * RATE)), LINEAR)
    second = round(RATE)

    def error(moving: bool) -> float:
        left = expected(RIG, trial if moving else replace(trial, moving=None)) - trial.measured
        return float(left[0, :second].std() / trial.measured.std())

    assert error(moving=False) > 0.3
    assert error(moving=True) < 0.01


def test_the_start_of_many_bodies_with_few_sensors_and_a_high_lowest_mode_is_found() -> None:
    """A period of the lowest mode has fewer records than the state and the sensors' offsets need."""
    count, stiffness, damping = 5, 3.1e4, 4.0
    rig = RigModel(
        name="chain", bodies=tuple(Body(name=f"m{k}", mass=1.0) for k in range(count)),
        links=tuple(
            Link(name=f"l{k}", a=f"m{k}", b=f"m{k - 1}" if k else "ground", stiffness=stiffness, damping=damping)
            for k in range(count)
        ),
        configurations={"free": Configuration()}, drive=Drive(channel="force", pushes={f"m{count - 1}": 1.0}),
        sensors=tuple(Sensor(channel=f"x{k}", body=f"m{k}", quantity="displacement") for k in (1, 4)),
    )  # fmt: skip
    joined = 2.0 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1)
    joined[-1, -1] = 1.0
    whole = np.block([[np.zeros((count, count)), np.eye(count)], [-stiffness * joined, -damping * joined]])
    fine = np.arange(round(12.0 * RATE) * 16) / (16.0 * RATE)
    push = np.sin(2.0 * np.pi * np.multiply.outer(fine, 4.0 * TONES[0]) + TONES[1]).sum(axis=1)
    _, states, _ = lsim((whole, np.eye(2 * count)[:, -1:], np.eye(2 * count), np.zeros((2 * count, 1))), push, fine)
    first = round(CUT * RATE)
    records = {"force": push, "x1": states[:, 1], "x4": states[:, 4]}
    channels = {
        name: Channel(
            name=name, samples=values[::16][first:], quantity="force" if name == "force" else "displacement",
            unit="N" if name == "force" else "m",
        )
        for name, values in records.items()
    }  # fmt: skip
    run = Run(id="r", configuration="free", sample_rate=RATE, gain=1.0, channels=channels)
    (trial,) = prepare(Campaign(runs=(run,), source="scipy"), rig)
    left = trial.measured - expected(rig, trial)
    assert np.all(left.std(axis=1) < 0.01 * trial.measured.std(axis=1))


def test_derivatives_of_a_fit_follow_the_state_at_the_start() -> None:
    """By one linear step for each parameter; anew for each they are the same and take ten times as long."""
    (trial,) = prepare(campaign(round(CUT * RATE)), LINEAR)
    problem, path = Problem([trial]), "links.l.stiffness"
    free = Free(path=path)

    def at(coordinates: FloatArray) -> RigModel:
        return RIG.replace({path: free.decode(coordinates[0])})

    here = np.array([free.encode(STIFFNESS)])
    ahead, middle = problem.residuals([at(here + free.step), at(here)])
    anew = (ahead - middle) / free.step
    jacobian = jacobian_of(problem, at, here, [free], middle)[:, 0]
    assert np.linalg.norm(jacobian - anew) < 0.05 * np.linalg.norm(anew)


def test_a_run_from_rest_is_simulated_from_rest() -> None:
    (trial,) = prepare(campaign(0), LINEAR)
    assert trial.moving is None
    assert trial.start_of(RIG) == {}


def run_of(measured: FloatArray, noise: float = 1e-9) -> Trial:
    channels = {"x": Channel(name="x", samples=measured, quantity="displacement", unit="m")}
    return Trial(
        run=Run(id="r", configuration="free", sample_rate=RATE, gain=1.0, channels=channels), start_time=0.0,
        excitation=Excitation.prepare(motion()[0], RATE), channels=("x",), measured=measured[None], noise=np.array([noise]),
        fitted=len(measured), ceiling=RATE / 2.0,
    )  # fmt: skip


def from_rest() -> FloatArray:
    return simulate(LINEAR, Excitation.prepare(motion()[0], RATE)).channels["x"]


def jumped(height: float) -> FloatArray:
    """A record without mean whose first value is that many of its rms away from rest, and the next ones on the other side."""
    values = np.tile([height, -height], len(motion()[0]) // 2)
    values[8:] = np.resize([1.0, -1.0], len(values) - 8)
    return values / values.std()


@pytest.mark.parametrize(("ratio", "moves"), [(0.97, False), (1.03, True)])
def test_a_start_counts_from_three_tenths_of_the_motion(ratio: float, moves: bool) -> None:
    assert begins_in_motion(LINEAR, run_of(jumped(ratio * motion_at_start.MOVING))) is moves
    assert motion_at_start.MOVING == 0.3


@pytest.mark.parametrize(("ratio", "moves"), [(0.97, False), (1.03, True)])
def test_a_start_counts_above_six_standard_deviations_of_the_noise(ratio: float, moves: bool) -> None:
    assert begins_in_motion(LINEAR, run_of(jumped(0.6), noise=0.6 / (ratio * 6.0))) is moves


@pytest.mark.parametrize(("factor", "moves"), [(0.0, False), (2.9, False), (4.0, True)])
def test_a_rig_that_moves_up_to_three_times_as_much_as_described_began_at_rest(factor: float, moves: bool) -> None:
    # The first moments are lifted to the size of the whole motion, so that a factor shows.
    rest = from_rest()
    rest[:8] *= 0.5 * rest.std() / np.abs(rest[:5]).max()
    lifted = msgspec.structs.replace(LINEAR, drive=Drive(channel="force", pushes={"m": float(rest[4] / from_rest()[4])}))
    measured = rest.copy()
    measured[:8] *= factor
    assert begins_in_motion(lifted, run_of(measured)) is moves


def test_an_offset_is_no_motion() -> None:
    x = motion()[1]
    assert not begins_in_motion(LINEAR, run_of(x + 5.0 * x.std()))


@pytest.mark.parametrize(("moving", "runs", "counts"), [(1, 2, True), (1, 3, False), (2, 4, False), (3, 5, True), (2, 3, True)])
def test_most_runs_of_a_campaign_must_begin_in_motion(moving: int, runs: int, counts: bool) -> None:
    cut, rest = campaign(round(CUT * RATE)).runs[0], campaign(0).runs[0]
    several = [replace(cut if k < moving else rest, id=f"r{k}") for k in range(runs)]
    trials = prepare(Campaign(runs=tuple(several), source="scipy"), LINEAR)
    assert all((trial.moving is not None) is counts for trial in trials)


@pytest.mark.parametrize("cut", [0.0, CUT])
def test_the_evidence_says_that_runs_begin_in_motion(cut: float) -> None:
    records = campaign(round(cut * RATE))
    texts = " ".join(sign.text for sign in record_signs(records, LINEAR, prepare(records, LINEAR)))
    assert ("1 of 1 runs begin in motion" in texts) is (cut > 0.0)


def test_a_run_shorter_than_two_periods_is_simulated_from_rest() -> None:
    run = run_of(motion()[1])
    assert moving_start(LINEAR, run) is not None
    assert moving_start(LINEAR, replace(run, measured=run.measured[:, :120])) is None


def test_a_start_from_which_the_rig_cannot_be_simulated_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    (trial,) = prepare(campaign(round(CUT * RATE)), LINEAR)
    records, position = initial_state.records_from, trial.start_of(RIG)["m"][0]

    def too_fast(*given: Any) -> FloatArray:
        if abs(given[-1]["m"][1]) > 1.2 * motion()[2].std():
            raise SimulationError("too fast")
        return records(*given)

    monkeypatch.setattr(initial_state, "records_from", too_fast)
    assert trial.moving is not None
    assert trial.moving.state(RIG, trial.excitation)["m"][0] == pytest.approx(position, abs=0.02 * motion()[1].std())


def test_a_sensor_that_shows_nothing_does_not_weigh() -> None:
    two = msgspec.structs.replace(RIG, sensors=(*RIG.sensors, Sensor(channel="dead", body="m", quantity="acceleration")))
    records = campaign(round(CUT * RATE))
    run = records.runs[0]
    dead = Channel(name="dead", samples=np.zeros(len(run)), quantity="acceleration", unit="m/s^2")
    (trial,) = prepare(replace(records, runs=(replace(run, channels={**run.channels, "dead": dead}),)), two)
    assert trial.start_of(two)["m"][0] == pytest.approx(motion()[1][round(CUT * RATE)], abs=0.05 * motion()[1].std())


def releases(starts: tuple[float, ...], described: float, seconds: float) -> tuple[Campaign, RigModel]:
    """Free decays from these positions by scipy, each described as `described` times its start."""
    t, runs = np.arange(round(seconds * RATE)) / RATE, []
    for k, start in enumerate(starts):
        found = solve_ivp(
            lambda t, y: [y[1], -(STIFFNESS * y[0] + DAMPING * y[1] + CUBIC * y[0] ** 3) / MASS], (0.0, seconds), (start, 0.0),
            t_eval=t, rtol=1e-10, atol=1e-13, method="DOP853",
        )  # fmt: skip
        x = found.y[0] + np.random.default_rng(k).normal(0.0, 1e-6, len(t))
        channels = {
            "force": Channel(name="force", samples=np.zeros(len(t)), quantity="force", unit="N"),
            "x": Channel(name="x", samples=x, quantity="displacement", unit="m"),
        }
        runs.append(Run(id=f"r{k}", configuration=f"from {k}", sample_rate=RATE, gain=1.0, channels=channels, excitation="free"))
    setups = {f"from {k}": Configuration(initial_position={"m": described * start}) for k, start in enumerate(starts)}
    return Campaign(runs=tuple(runs), source="releases"), msgspec.structs.replace(RIG, configurations=setups)


def test_records_of_a_decay_tell_the_described_state_at_its_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hand pulls three per cent further than described; within a few periods a state and a friction imitate each other."""
    measured, described = releases((5e-3,), 1.0 / 1.03, 12.0)
    (trial,) = prepare(measured, described)
    assert trial.start_of(described)["m"][0] == pytest.approx(5e-3, rel=1e-3)
    # Five of its periods are fewer samples than a run must have.
    monkeypatch.setattr(preparation, "DECAYS", 4.0 * DECAYS)
    limit = 4.0 * DECAYS * 2.0 * np.pi * np.sqrt(MASS / STIFFNESS)
    told = [prepare(*releases((5e-3,), 1.0, share * limit))[0].moving is not None for share in (0.97, 1.03)]
    assert told == [False, True]


def test_a_short_fit_keeps_the_records_that_tell_the_start() -> None:
    campaign, described = releases((5e-3,), 1.0, 12.0)
    (trial,) = prepare(campaign, described)
    assert trial.moving is not None
    (short,) = shortened((trial,), 0.01)
    assert short.fitted < trial.moving.measured.shape[1]
    softer = described.replace({"links.l.stiffness": 0.9 * STIFFNESS})
    assert short.start_of(softer)["m"] == pytest.approx(trial.start_of(softer)["m"])


def test_the_second_strongest_of_several_decays_is_held_out() -> None:
    """The end of a decay is its weakest part; the other decays are fitted, and judged where that is asked, as a whole."""
    prepared = prepare(*releases((4e-3, -6e-3, 2e-3), 1.0, 12.0))
    whole = prepared[0].samples
    assert [trial.fitted for trial in prepared] == [0, whole, whole]
    assert [trial.held_out for trial in prepared] == 3 * [slice(0, whole)]
    assert [trial.run.id for trial in ends(prepared).judged] == ["r0"]
    (alone,) = prepare(*releases((4e-3,), 1.0, 12.0))
    assert 0 < alone.fitted < whole
    assert alone.held_out == slice(alone.fitted, whole)
