"""Floors and scores of held-out data with the simulation replaced by records made by hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.equations.ranking import ranking
from isorig.analysis.equations.system import equations_of
from isorig.analysis.errors import DataError, SimulationError
from isorig.analysis.fitting import held_out, preparation, trials
from isorig.analysis.fitting import score as scores
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.laws import BoundedSoftening, Coulomb, Cubic, Stribeck
from isorig.analysis.model.rig_model import Body, Chain, Configuration, Contact, Drive, Link, RigModel, Sensor
from isorig.analysis.simulate import Excitation
from isorig.analysis.simulate.inverse import DECIMATIONS, EDGE, driven_groups, motion_from, required_drive
from isorig.analysis.spectra.windows import HANN

GROUNDED = Link(name="base", a="base", b="ground", stiffness=0.0, damping=1.0)
N, RATE = 4096, 512.0
RIG = RigModel(
    name="one", bodies=(Body(name="m", mass=2.0),), drive=Drive(channel="head", factor=1.0, pushes={"m": 1.0}),
    links=(Link(name="m", a="m", b="ground", stiffness=1.0, damping=1.0),),
)  # fmt: skip
SIGNAL = np.sin(np.arange(N) * 0.1)


def trial_of(measured: FloatArray, noise: float) -> Trial:
    run = Run(id="r", configuration="unlocked", sample_rate=RATE, gain=1.0, channels={"m": Channel(name="m", samples=measured)})
    return Trial(
        run=run, start_time=0.0, excitation=Excitation.prepare(np.zeros(N), RATE, oversample=1), channels=("m",),
        measured=measured[None], noise=np.array([noise]), fitted=N // 2, ceiling=RATE / 2,
    )  # fmt: skip


def test_blocks_are_square_errors_over_noise_and_three_permille_of_the_signal(monkeypatch: pytest.MonkeyPatch) -> None:
    trial = trial_of(SIGNAL, 1e-3)
    monkeypatch.setattr(scores, "expected", lambda model, trial: trial.measured + 0.01)
    found = scores.score(RIG, [trial])
    size = float(np.sqrt(np.mean(SIGNAL[N // 2 :] ** 2)))
    assert found.error[0, 0] == pytest.approx(0.01 / size)
    np.testing.assert_allclose(found.blocks, 0.01**2 / (1e-3**2 + (0.003 * size) ** 2))
    np.testing.assert_allclose(found.power, 0.01**2 / size**2)


def moved(at: Sequence[float], rest: float = 0.0) -> FloatArray:
    # Ten seconds at 100 Hz: a position that rings for a second from each of these moments on, and stays `rest` off.
    time = np.arange(1000) / 100.0
    return sum((np.where(time < t, 0.0, rest + np.exp(-4.0 * (time - t).clip(0)) * np.sin(30.0 * (time - t))) for t in at),
               np.zeros(1000))  # fmt: skip


@pytest.mark.parametrize(
    ("at", "low", "high"),
    [
        ((0.5, 7.0), 600, 600),  # a move in the last 40 %
        ((0.5, 2.0, 3.5), 350, 350),  # at rest from then on: the last move is held out
        ((0.5, 3.0), 300, 300),
        ((1.0,), 101, 200),  # one move: its end
    ],
)
def test_a_run_that_comes_to_rest_is_divided_between_its_moves(at: tuple[float, ...], low: int, high: int) -> None:
    assert low <= held_out.fit_samples(np.stack([moved(at), moved(at, rest=0.2)])) <= high


def test_a_steady_run_is_divided_in_time() -> None:
    noise = np.random.default_rng(3).normal(0.0, 1.0, (2, 5000))
    assert held_out.fit_samples(noise) == 3000


def test_a_run_in_which_nothing_moves_is_divided_by_time() -> None:
    """Dry friction may hold a body throughout a run, and a converter then records zero."""
    assert held_out.fit_samples(np.zeros((2, 5000))) == round(held_out.FIT_SHARE * 5000)


def simulated(scales: list[float]) -> Callable[..., Any]:
    # A rig whose answer to the k-th shaken drive is off by that much; the first call of each set is the clean one.
    calls: list[int] = []

    def simulate(model: RigModel, excitation: Excitation, **more: object) -> SimpleNamespace:
        clean = not np.any(excitation.recorded)
        calls.append(0 if clean else 1)
        off = 0.0 if clean else scales[sum(calls) - 1]
        channels: Mapping[str, FloatArray] = {"m": SIGNAL + off}
        return SimpleNamespace(channels=channels)

    return simulate


def test_draws_that_disagree_are_followed_by_more_and_the_largest_is_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    trial, size = trial_of(SIGNAL, 0.0), float(np.sqrt(np.mean(SIGNAL[N // 2 :] ** 2)))
    # Powers of two draws that differ by less than 1.3, and by more.
    monkeypatch.setattr(trials, "simulate", simulated([0.010, 0.0113, 9.0]))
    assert scores.noise_floors(RIG, [replace(trial, drive_noise=1.0)])[0, 0, 0] == pytest.approx(0.0113 / size)
    monkeypatch.setattr(trials, "simulate", simulated([0.010, 0.0115, 0.02, 0.03, 0.01, 0.01, 0.01, 0.05]))
    assert scores.noise_floors(RIG, [replace(trial, drive_noise=1.0)])[0, 0, 0] == pytest.approx(0.05 / size)


def stepped(jump: float, beside: float, distance: int) -> FloatArray:
    # A drive with a range of one that jumps between samples 50 and 51, rises by `beside` between two samples nearby, and rises
    # slowly to its range before.
    drive = np.concatenate([np.linspace(0.0, 1.0, 20), np.linspace(1.0, 0.0, 20), np.zeros(60)])
    drive[51:] += jump
    drive[51 + distance :] += beside
    return drive


@pytest.mark.parametrize(
    ("jump", "beside", "distance", "moves"),
    [
        (0.19, 0.0, 1, False),
        (0.21, 0.0, 1, True),
        (0.5, 0.014, 1, True),
        (0.5, 0.016, 1, False),
        (0.5, 0.016, 3, False),
        (0.5, 0.016, 4, True),
    ],
)
def test_a_drive_that_jumps_between_two_samples(jump: float, beside: float, distance: int, moves: bool) -> None:
    later, earlier = scores.moved_jumps(stepped(jump, beside, distance))
    expected = np.zeros((2, 100))
    if moves:
        # Half of the jump is missing in the sample after it, or is there in the one before.
        expected[0, 51], expected[1, 50] = -0.5 * jump, 0.5 * jump
    np.testing.assert_allclose([later, earlier], expected)


def test_a_jump_between_two_samples_adds_to_the_floor(monkeypatch: pytest.MonkeyPatch) -> None:
    drive = np.where(np.arange(N) < 3000, 1.0, 0.0)
    channels = ("m", "late", "early")
    trial = replace(
        trial_of(SIGNAL, 0.0), excitation=Excitation.prepare(drive, RATE, oversample=1), channels=channels,
        measured=np.stack([SIGNAL] * 3), noise=np.zeros(3),
    )  # fmt: skip
    # One channel follows the drive after the jump three times as much, another one before it.
    late, early = (np.where(np.arange(N) == at, 3.0, 1.0) for at in (3000, 2999))

    def simulate(model: RigModel, excitation: Excitation, **more: object) -> SimpleNamespace:
        records = np.stack([np.ones(N), late, early]) * excitation.recorded
        return SimpleNamespace(channels=dict(zip(channels, records, strict=True)))

    monkeypatch.setattr(trials, "simulate", simulate)
    half = 0.5 / np.sqrt(N - N // 2)
    size = float(np.sqrt(np.mean(SIGNAL[N // 2 :] ** 2)))
    np.testing.assert_allclose(scores.noise_floors(RIG, [trial])[0, 0], half / size * np.array([1.0, 3.0, 3.0]))
    held = replace(trial, excitation=replace(trial.excitation, held=True))
    assert scores.noise_floors(RIG, [held])[0, 0, 0] == pytest.approx(0.0, abs=1e-9)


def test_half_overlapping_hann_segments_share_a_sixth() -> None:
    window = HANN.samples(4096)
    assert pytest.approx(float(window[:2048] @ window[2048:] / (window @ window)), rel=1e-6) == HANN.autocorrelation(0.5)


@pytest.mark.parametrize("swapped", [False, True])
def test_the_drive_that_a_motion_takes_is_newtons_law(swapped: bool) -> None:
    omega, time = 2.0 * np.pi * 2.0, np.arange(8192) / 1024.0
    x, base = 3e-3 * np.sin(omega * time), 1e-3 * np.cos(omega * time)
    ends = ("base", "m") if swapped else ("m", "base")
    rig = RigModel(
        name="carried", bodies=(Body(name="m", mass=2.0), Body(name="base", mass=5.0)),
        drive=Drive(channel="force", factor=1.0, pushes={"m": 1.0}),
        links=(Link(name="k", a=ends[0], b=ends[1], stiffness=400.0, damping=3.0, laws=(Cubic(cubic_stiffness=1e6),)), GROUNDED),
        contacts=(Contact(name="k", a=ends[0], b=ends[1], law=Coulomb(friction_force=0.5)),),
        sensors=tuple(Sensor(channel=body, body=body, quantity="displacement") for body in ("m", "base")),
    )  # fmt: skip
    d, v = x - base, omega * (3e-3 * np.cos(omega * time) + 1e-3 * np.sin(omega * time))
    force = -2.0 * omega**2 * x + 400.0 * d + 3.0 * v + 1e6 * d**3 + 0.5 * np.sign(v)
    # Together both bodies feel only the ground: what joins them cancels.
    both = (
        -(omega**2) * (2.0 * x + 5.0 * base) + GROUNDED.stiffness * base - GROUNDED.damping * omega * 1e-3 * np.sin(omega * time)
    )
    groups = driven_groups(rig)
    assert groups == (("m",), ("m", "base"))
    motion = replace(motion_from({"m": x, "base": base}, 1024.0, np.zeros(len(time))), groups=groups)
    kept = slice(EDGE * DECIMATIONS[0], -EDGE * DECIMATIONS[0], DECIMATIONS[0])
    # The decimation rounds friction's jumps: compare where the sign is steady.
    steady = np.abs(v[kept]) > 0.5 * np.abs(v).max()
    for found, expected in zip(required_drive(rig, motion), (force, both), strict=True):
        difference = (found[: len(force[kept])] - expected[kept])[steady]
        assert np.abs(difference).max() < 0.05 * np.abs(expected).max()


@pytest.mark.parametrize("decimation", DECIMATIONS)
def test_a_lower_corner_leaves_a_slow_motion_as_it_is(decimation: int) -> None:
    omega, time = 2.0 * np.pi * 0.2, np.arange(65536) / 1024.0
    x = 3e-3 * np.sin(omega * time)
    rig = RigModel(
        name="slow", bodies=(Body(name="m", mass=2.0),), drive=Drive(channel="force", factor=1.0, pushes={"m": 1.0}),
        links=(Link(name="bearing", a="m", b="ground", damping=3.0),),
        sensors=(Sensor(channel="m", body="m", quantity="displacement"),),
    )  # fmt: skip
    force = 3.0 * omega * 3e-3 * np.cos(omega * time) - 2.0 * omega**2 * x
    (found,) = required_drive(rig, motion_from({"m": x}, 1024.0, np.zeros(len(time)), decimation))
    expected = force[::decimation][EDGE : EDGE + len(found)]
    inside = slice(EDGE, -EDGE) if decimation < DECIMATIONS[-1] else slice(5, -5)
    # Each stage of the decimation ripples by 1 %.
    np.testing.assert_allclose(found[inside], expected[inside], atol=0.05 * float(np.abs(force).max()))


def test_errors_are_rms_and_only_what_was_held_out_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    trial = trial_of(SIGNAL, 1e-3)
    off = np.where(np.arange(N) % 4 == 0, 0.04, 0.0)
    off[: N // 2] = 5.0
    monkeypatch.setattr(scores, "expected", lambda model, trial: trial.measured + off)
    found = scores.score(RIG, [trial])
    size = float(np.sqrt(np.mean(SIGNAL[N // 2 :] ** 2)))
    assert found.error[0, 0] == pytest.approx(0.02 / size)
    np.testing.assert_allclose(found.power, 0.02**2 / size**2)


def test_a_model_that_cannot_be_simulated_has_lost_the_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(model: RigModel, trial: Trial) -> FloatArray:
        raise SimulationError("it grows")

    monkeypatch.setattr(scores, "expected", fails)
    found = scores.score(RIG, [trial_of(SIGNAL, 1e-3)])
    assert found.error[0, 0] > 1e5
    assert found.blocks.shape == (1, 1, scores.BLOCKS)


def test_one_channel_that_disagrees_is_enough_for_more_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    one = trial_of(SIGNAL, 0.0)
    names = ("m", "n", "o")
    three = replace(one, channels=names, measured=np.stack([SIGNAL] * 3), noise=np.array([0.0, 0.3, 0.0]))
    calls: list[int] = []

    def simulate(model: RigModel, excitation: Excitation, **more: object) -> SimpleNamespace:
        clean = not np.any(excitation.recorded)
        calls.append(0 if clean else 1)
        k = sum(calls) - 1
        uneven = np.where(np.arange(N) % 4 == 0, 1.0, 0.0)
        first = 0.0 if clean else (0.02, 0.04, 0.06, 0.01, 0.01, 0.01, 0.01, 0.01)[k % 8]
        last = 0.0 if clean else 0.01
        return SimpleNamespace(channels={"m": SIGNAL + first * uneven, "n": SIGNAL + last, "o": SIGNAL + 2.0 * last})

    monkeypatch.setattr(trials, "simulate", simulate)
    size = float(np.sqrt(np.mean(SIGNAL[N // 2 :] ** 2)))
    found = scores.noise_floors(RIG, [replace(three, drive_noise=1.0)])[0, 0]
    # A quarter of the samples off by 0.06 is 0.03 rms; sensor noise adds in square.
    np.testing.assert_allclose(found, [0.03 / size, np.hypot(0.01, 0.3) / size, 0.02 / size], rtol=1e-6)
    assert sum(calls) == 8
    # The same draws typically cause less.
    found = scores.noise_floors(RIG, [replace(three, drive_noise=1.0)])[1, 0]
    np.testing.assert_allclose(found, [0.005 / size, np.hypot(0.01, 0.3) / size, 0.02 / size], rtol=1e-6)


def test_the_noise_added_to_the_drive_has_no_mean_and_the_given_deviation(monkeypatch: pytest.MonkeyPatch) -> None:
    drives: list[FloatArray] = []

    def simulate(model: RigModel, excitation: Excitation, **more: object) -> SimpleNamespace:
        drives.append(excitation.recorded)
        return SimpleNamespace(channels={"m": SIGNAL})

    monkeypatch.setattr(trials, "simulate", simulate)
    scores.noise_floors(RIG, [replace(trial_of(SIGNAL, 1e-3), drive_noise=0.2)])
    clean, *noisy = drives
    assert not clean.any()
    assert len(noisy) == 2
    for drive in noisy:
        assert abs(drive.mean()) < 4.0 * 0.2 / np.sqrt(N)
        assert drive.std() == pytest.approx(0.2, rel=0.05)


@pytest.mark.parametrize("blur", [0.0, 1e-3])
def test_a_contact_that_sticks_carries_what_the_drive_demands(blur: float) -> None:
    """Where the velocity is not resolved, any drive within the friction is right, and one beyond it is not."""
    time = np.arange(8192) / 1024.0
    x = np.random.default_rng(1).normal(0.0, 1e-8, len(time))  # at rest, up to the noise of the position
    rubs = Contact(name="k", a="m", b="ground", law=Stribeck(friction_force=0.5, static_force=0.9, stribeck_velocity=1.0))
    rig = RigModel(
        name="held", bodies=(Body(name="m", mass=2.0),), drive=Drive(channel="force", factor=1.0, pushes={"m": 1.0}),
        contacts=(rubs,), sensors=(Sensor(channel="m", body="m", quantity="displacement"),),
    )  # fmt: skip
    for push, left in ((0.8, 0.0), (-0.8, 0.0), (1.2, 0.3)):
        drive = np.full(len(time), push)
        found = required_drive(rig, replace(motion_from({"m": x}, 1024.0, drive), blur={"m": blur}))
        error = np.abs(found - push).max()
        assert error == pytest.approx(left, abs=2e-2) if blur else error > 0.5


@pytest.mark.parametrize(("above", "sticks"), [(0.99, True), (1.01, False)])
def test_a_velocity_is_resolved_from_three_standard_deviations_of_its_noise_on(above: float, sticks: bool) -> None:
    time, blur = np.arange(8192) / 1024.0, 1e-3
    rubs = Contact(name="k", a="m", b="ground", law=Coulomb(friction_force=0.5))
    rig = RigModel(
        name="slow", bodies=(Body(name="m", mass=2.0),), drive=Drive(channel="force", factor=1.0, pushes={"m": 1.0}),
        contacts=(rubs,), sensors=(Sensor(channel="m", body="m", quantity="displacement"),),
    )  # fmt: skip
    motion = motion_from({"m": 3.0 * above * blur * time}, 1024.0, np.full(len(time), -0.2))
    # A contact that slides forward takes its friction, one that may stick what the record has; the decimation ripples by 1 %.
    assert required_drive(rig, replace(motion, blur={"m": blur}))[0, 50:-50] == pytest.approx(-0.2 if sticks else 0.5, rel=0.02)


def test_friction_follows_the_sign_of_a_velocity_that_oscillates_above_the_corner_of_its_force() -> None:
    """The acceleration is noisy and needs a low-pass of 20 Hz; below that the velocity turns far more seldom than it does."""
    rate, mass, level = 500.0, 0.02, 0.5
    time, slow, fast = np.arange(15000) / rate, 2.0 * np.pi * 0.3, 2.0 * np.pi * 30.0
    speed = 4.0 * np.sin(slow * time) + 3.0 * np.sin(fast * time)
    force = mass * (4.0 * slow * np.cos(slow * time) + 3.0 * fast * np.cos(fast * time)) + level * np.sign(speed)
    rig = RigModel(
        name="turning", bodies=(Body(name="m", mass=mass),), drive=Drive(channel="force", factor=1.0, pushes={"m": 1.0}),
        contacts=(Contact(name="k", a="m", b="ground", law=Coulomb(friction_force=level)),),
        sensors=(Sensor(channel="m", body="m", quantity="velocity"),),
    )  # fmt: skip
    records = {
        "m": (speed + np.random.default_rng(2).normal(0.0, 0.08, len(time)), "velocity", "m/s"),
        "force": (force, "force", "N"),
    }
    channels = {name: Channel(name=name, samples=of[0], quantity=of[1], unit=of[2]) for name, of in records.items()}
    run = Run(id="r", configuration="unlocked", sample_rate=rate, gain=1.0, channels=channels)
    (trial,) = preparation.prepare(Campaign(runs=(run,), source="turning"), rig)
    assert trial.motion is not None
    assert trial.motion.decimation > DECIMATIONS[0]
    off = trials.expected(rig, trial) - trial.measured
    assert np.sqrt(np.mean(off**2)) < 0.05 * np.std(trial.measured)


@pytest.mark.parametrize("joint", ["absolute", "relative"])
def test_the_motion_of_a_body_may_be_recorded_relative_to_another(joint: str) -> None:
    """An encoder between two arms; the first arm's own position is recorded."""
    time = np.arange(4000) / 500.0
    hub, arm = 0.5 * np.sin(2.0 * np.pi * 0.7 * time), 0.5 * np.sin(2.0 * np.pi * 0.7 * time + 0.3)
    records = {"hub": hub, "arm": arm - hub if joint == "relative" else arm, "u": np.cos(2.0 * np.pi * 0.7 * time)}
    draw, channels = np.random.default_rng(8), {}
    for name, values in records.items():
        quantity, unit = ("torque", "N m") if name == "u" else ("angle", "rad")
        noisy = values + draw.normal(0.0, 1e-4, len(time))
        channels[name] = Channel(name=name, samples=noisy, quantity=quantity, unit=unit)
    rig = RigModel(
        name="joint", drive=Drive(channel="u", quantity="torque", factor=1.0, pushes={"hub": 1.0}),
        bodies=(Body(name="hub", mass=0.002, motion="rotation"), Body(name="arm", mass=0.004, motion="rotation")),
        links=(
            Link(name="joint", a="arm", b="hub", stiffness=1.3, damping=0.01), Link(name="bearing", a="hub", damping=0.001),
        ),
        sensors=(
            Sensor(channel="arm", body="arm", quantity="angle", relative_to="hub" if joint == "relative" else "ground"),
            Sensor(channel="hub", body="hub", quantity="angle"),
        ),
    )  # fmt: skip
    run = Run(id="r", configuration="unlocked", sample_rate=500.0, gain=1.0, channels=channels)
    (trial,) = preparation.prepare(Campaign(runs=(run,), source="joint"), rig)
    assert trial.motion is not None
    assert np.std(trial.motion.position["arm"] - arm) < 1e-3 * np.std(arm)
    alone = msgspec.structs.replace(rig, sensors=rig.sensors[:1])
    with pytest.raises(DataError, match="absolute or relative to one whose own is measured"):
        preparation.prepare(Campaign(runs=(run,), source="joint"), alone)


@pytest.mark.parametrize("zero", [0.0, 180.0])
def test_the_zero_of_a_load_cell_says_nothing_of_a_damper(zero: float) -> None:
    """A gas force preloads the cell; the end of an imposed motion, whose velocity is not known, has no part in that zero."""
    time = np.arange(1400) / 500.0
    stroke, speed = 0.05 * np.sin(2.0 * np.pi * time), 0.1 * np.pi * np.cos(2.0 * np.pi * time)
    channels = {
        "s": Channel(name="s", samples=stroke, quantity="displacement", unit="m"),
        "F": Channel(name="F", samples=1500.0 * speed + zero, quantity="force", unit="N"),
    }
    rig = RigModel(
        name="damper", bodies=(Body(name="rod", mass=1e-6),), links=(Link(name="oil", a="rod", damping=1500.0),),
        drive=Drive(channel="s", quantity="displacement", factor=1.0, pushes={}, imposes="rod"),
        sensors=(Sensor(channel="F", quantity="force", force_in="drive.s"),),
    )  # fmt: skip
    run = Run(id="r", configuration="unlocked", sample_rate=500.0, gain=1.0, channels=channels)
    (trial,) = preparation.prepare(Campaign(runs=(run,), source="damper"), rig)
    assert trial.uncertain_end > 0
    off = trials.expected(rig, trial) - trial.measured
    assert np.abs(off[:, 100:-100]).max() < 1.0


def test_a_run_down_is_simulated_from_its_described_start() -> None:
    """Nothing drives a rotor that runs down: there is no force of a drive to compare."""
    time = np.arange(2000) / 50.0
    speed = Channel(name="n", samples=300.0 * np.exp(-time / 15.0), quantity="angular_velocity", unit="rad/s")
    still = Channel(name="u", samples=np.zeros(len(time)), quantity="torque", unit="N m")
    run = Run(id="r", configuration="unlocked", sample_rate=50.0, gain=1.0, channels={"n": speed, "u": still})
    rig = RigModel(
        name="rotor", bodies=(Body(name="rotor", mass=0.03, motion="rotation"),),
        links=(Link(name="bearing", a="rotor", damping=0.002),),
        drive=Drive(channel="u", quantity="torque", factor=1.0, pushes={"rotor": 1.0}),
        sensors=(Sensor(channel="n", body="rotor", quantity="angular_velocity"),),
    )  # fmt: skip
    with pytest.raises(DataError, match="nothing drives run 'r', and the description gives no start"):
        preparation.prepare(Campaign(runs=(run,), source="rotor"), rig)
    begun = msgspec.structs.replace(rig, configurations={"unlocked": Configuration(initial_velocity={"rotor": 300.0})})
    (trial,) = preparation.prepare(Campaign(runs=(run,), source="rotor"), begun)
    assert trial.motion is None
    off = trials.expected(begun, trial) - trial.measured
    assert np.std(off) < 1e-3 * np.std(trial.measured)


def two_inertias(softening: float, zero: float) -> tuple[Campaign, RigModel]:
    """A motor and a load on a shaft that a sum of sines twists, with tachometers, that of the load with an error of its zero."""
    rate, motor, load, stiffness, rubs = 1000.0, 0.005, 0.012, 50.0, 0.002
    time, draw = np.arange(20000) / rate, np.random.default_rng(4)
    waves = [(0.06, 0.4), (0.03, 1.7), (0.02, 6.3), (0.01, 11.0)]
    twist = sum((size * np.sin(2.0 * np.pi * hertz * time + hertz) for size, hertz in waves), np.zeros(len(time)))
    torque = stiffness * ((1.0 - softening) * twist + softening * 0.1 * np.tanh(twist / 0.1))
    of_load = cumulative_trapezoid(torque - torque.mean(), dx=1.0 / rate, initial=0.0) / load
    of_motor = of_load + np.gradient(twist, time)
    drive = motor * np.gradient(of_motor, time) + torque - torque.mean() + rubs * of_motor
    records = {"u": drive, "motor": of_motor, "load": of_load + zero}
    channels = {}
    for name, values in records.items():
        noisy = values + draw.normal(0.0, 2e-3 * float(np.std(values)), len(time))
        quantity, unit = ("torque", "N m") if name == "u" else ("angular_velocity", "rad/s")
        channels[name] = Channel(name=name, samples=noisy, quantity=quantity, unit=unit)
    run = Run(id="r", configuration="unlocked", sample_rate=rate, gain=1.0, channels=channels)
    law = (BoundedSoftening(softening=softening, scale=0.1),) if softening else ()
    model = RigModel(
        name="drive", drive=Drive(channel="u", quantity="torque", factor=1.0, pushes={"motor": 1.0}, chain=Chain(offset=0.0)),
        bodies=(Body(name="motor", mass=motor, motion="rotation"), Body(name="load", mass=load, motion="rotation")),
        links=(
            Link(name="shaft", a="motor", b="load", stiffness=stiffness, laws=law), Link(name="bearing", a="motor", damping=rubs),
        ),
        sensors=tuple(Sensor(channel=name, body=name, quantity="angular_velocity") for name in ("motor", "load")),
        free=("bodies.load.mass", "links.shaft.stiffness", "links.shaft.damping"),
    )  # fmt: skip
    return Campaign(runs=(run,), source="drive"), model


@pytest.mark.parametrize("softening", [0.0, 0.6])
@pytest.mark.parametrize("zero", [0.0, 0.05])
def test_the_zero_of_a_velocity_is_no_twist_of_a_shaft(softening: float, zero: float) -> None:
    """The zero integrates to a rad, ten times the twist; the equations and the required drive show the shaft nonetheless."""
    campaign, model = two_inertias(softening, zero)
    (trial,) = preparation.prepare(campaign, model)
    assert trial.motion is not None
    assert trial.motion.groups == (("motor",), ("motor", "load"))
    off = np.std(trials.expected(model, trial) - trial.measured, axis=1) / np.std(trial.measured, axis=1)
    assert np.all(off < 0.03)
    plain = msgspec.structs.replace(model, links=(msgspec.structs.replace(model.links[0], laws=()), model.links[1]))
    best = ranking(equations_of(campaign, plain)).explanations[:1]
    assert [(item.kind, item.place) for item in best if item.score > 0.5] == ([("spring_shape", "shaft")] if softening else [])


def test_a_rig_scored_by_its_drive_gets_the_noise_of_its_positions(monkeypatch: pytest.MonkeyPatch) -> None:
    time = np.arange(8192) / 1024.0
    clean = {"m": 3e-3 * np.sin(12.0 * time)}
    shaken = {"m": clean["m"] + np.random.default_rng(1).normal(0.0, 1e-5, len(time))}
    motion, other = (motion_from(positions, 1024.0, np.zeros(len(time))) for positions in (clean, shaken))
    (force,) = required_drive(RIG, motion)
    trial = replace(
        trial_of(np.zeros(N), 0.0), measured=force[None], channels=("head",), fitted=len(force) // 2, motion=motion, noisy=other
    )
    part = slice(len(force) // 2, len(force))
    expected = np.sqrt(np.mean((required_drive(RIG, other)[0] - force)[part] ** 2) / np.mean(force**2))
    assert scores.noise_floors(RIG, [trial])[0, 0, 0] == pytest.approx(expected)
