"""Wrong units, given values, signs and sample rates are found before any fit, on rigs simulated with scipy."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from itertools import combinations
from math import log, pi

import numpy as np
import pytest
from msgspec.structs import replace
from strange_rigs import Law, StrangeRig, campaign, cubic, dry, play

from isorig.analysis.campaign import MOTION, ROTARY, SI_UNIT, Campaign, Channel, Gap, Quantity, Run
from isorig.analysis.fitting.linear_spectra import (
    LinearRig,
    _window,
    dampers,
    given_parameters,
    spectra_of,
    spectrum_of,
)
from isorig.analysis.fitting.plausible import Doubt, _held_back, doubts_of_records
from isorig.analysis.fitting.resonances import Resonance, _peak
from isorig.analysis.fitting.wrong_scale import (
    UNLIKE,
    WrongScale,
    _Compared,
    _confirmed,
    _Explanation,
    _explanations,
    wrong_scale,
)
from isorig.analysis.model.rig_model import RigModel, from_tree, to_tree
from isorig.analysis.units import mistaken

STAGE = StrangeRig(
    masses=(4.0, 2.0), joints=((0, -1, 4e3, 12.0), (1, 0, 3e3, 6.0)),
    sensors=(("low", 0, "displacement"), ("top", 1, "acceleration")),
)  # fmt: skip
ONE = StrangeRig(masses=(5.0,), joints=((0, -1, 8e3, 20.0),), sensors=(("a", 0, "acceleration"),))
THREE = StrangeRig(
    masses=(6.0, 3.0, 2.0), joints=((0, -1, 9e3, 30.0), (1, 0, 5e3, 12.0), (2, 1, 6e3, 9.0)),
    sensors=(("a0", 0, "acceleration"), ("a1", 1, "acceleration"), ("a2", 2, "acceleration")), pushed=2,
)  # fmt: skip
TORSION = StrangeRig(
    masses=(0.02, 0.05), joints=((0, -1, 20.0, 0.02), (1, 0, 45.0, 0.03)), rotary=True, drive="torque", drive_quantity="torque",
    sensors=(("motor", 0, "angle"), ("load", 1, "angular_velocity")),
)  # fmt: skip
PLATFORM = StrangeRig(
    masses=(30.0,), joints=((0, -1, 3e4, 90.0),), base=True, drive="base", drive_quantity="acceleration",
    sensors=(("device", 0, "acceleration"),),
)  # fmt: skip
CARTS = StrangeRig(
    masses=(1.5, 1.1), joints=((0, -1, 410.0, 3.0), (1, 0, 330.0, 0.8)), drive="u", drive_quantity="voltage", factor=4.0,
    sensors=(("x1", 0, "displacement"), ("x2", 1, "displacement")),
)  # fmt: skip
RIGS = {"stage": STAGE, "one": ONE, "three": THREE, "torsion": TORSION, "platform": PLATFORM, "carts": CARTS}
#: Levels of the drives, and the law of an unmodelled cause in the first joint: it changes levels by up to two.
LEVELS = {"stage": 20.0, "one": 20.0, "three": 20.0, "torsion": 0.5, "platform": 1.0, "carts": 1.0}
CAUSES: Mapping[tuple[str, str], Law] = {
    ("stage", "friction"): dry(6.0, 1e-3), ("stage", "play"): play(4e3, 1e-3), ("stage", "cubic"): cubic(3e8),
    ("one", "friction"): dry(6.0, 1e-3), ("three", "play"): play(9e3, 1e-3),
    ("torsion", "friction"): dry(0.15, 1e-2), ("platform", "play"): play(3e4, 2e-4),
}  # fmt: skip
HARDENING = StrangeRig(
    masses=(3.4, 2.2, 0.95), joints=((0, -1, 3600.0, 3.5), (1, 0, 1200.0, 3.4), (2, 1, 1060.0, 2.3)),
    sensors=(("s0", 0, "acceleration"), ("s1", 1, "displacement"), ("s2", 2, "acceleration")), laws={0: cubic(1.2e9)},
)  # fmt: skip
RECORDED: dict[tuple[str, str], Campaign] = {}


def recorded(name: str, cause: str = "", scale: Mapping[str, float] | None = None) -> Campaign:
    """A run of a rig with an unmodelled cause, its records multiplied."""
    if (name, cause) not in RECORDED:
        rig = RIGS[name] if not cause else dataclasses.replace(RIGS[name], laws={0: CAUSES[name, cause]})
        RECORDED[name, cause] = campaign(rig, (LEVELS[name],), seconds=6.0, seed=1)
    measured = RECORDED[name, cause]
    runs = []
    for run in measured.runs:
        scaled = {k: dataclasses.replace(c, scale=c.scale * (scale or {}).get(k, 1.0)) for k, c in run.channels.items()}
        runs.append(dataclasses.replace(run, channels=scaled))
    return dataclasses.replace(measured, runs=tuple(runs))


def guessed(rig: StrangeRig, seed: int) -> dict[str, float]:
    """Errors of a description: masses and stiffnesses up to a quarter, dampings up to two."""
    draw = np.random.default_rng(seed)
    quarter = [f"bodies.m{k}.mass" for k in range(len(rig.masses))] + [f"links.l{k}.stiffness" for k in range(len(rig.joints))]
    errors = {path: float(draw.uniform(0.8, 1.25)) for path in quarter}
    return {**errors, **{f"links.l{k}.damping": float(draw.uniform(0.5, 2.0)) for k in range(len(rig.joints))}}


def told(model: RigModel, measured: Campaign) -> tuple[Doubt, ...]:
    return doubts_of_records(model, measured)


def drawn(seed: int) -> StrangeRig:
    """One to three masses in a chain, driven by a force, a voltage, a torque or a moved base, with any sensors."""
    draw = np.random.default_rng(seed)
    count, kind = int(draw.integers(1, 4)), ("force", "u", "base", "torque")[seed % 4]
    turns = kind == "torque"
    frequency = draw.uniform(3.0, 12.0) * np.cumprod(np.concatenate([[1.0], draw.uniform(1.0, 2.0, count - 1)]))
    mass = (10.0 ** draw.uniform(-3.0, -1.0) if turns else 10.0 ** draw.uniform(-0.5, 1.5)) * draw.uniform(0.3, 1.5, count)
    stiffness = mass * (2.0 * pi * frequency) ** 2
    damping = 2.0 * draw.uniform(0.01, 0.08, count) * np.sqrt(stiffness * mass)
    kinds: tuple[Quantity, ...] = ("displacement", "velocity", "acceleration")
    if kind == "base":
        kinds = ("velocity", "acceleration")  # an absolute position drifts with the base
    if turns:
        kinds = ("angle", "angular_velocity", "angular_acceleration")
    first = 0 if draw.random() < 0.7 else count - 1
    quantities: dict[str, Quantity] = {"force": "force", "u": "voltage", "base": "acceleration", "torque": "torque"}
    return StrangeRig(
        masses=tuple(mass.tolist()),
        joints=tuple((k, k - 1, float(stiffness[k]), float(damping[k])) for k in range(count)),
        sensors=tuple((f"s{k}", k, kinds[int(draw.integers(len(kinds)))]) for k in range(first, count)),
        pushed=int(draw.integers(count)), base=kind == "base", rotary=turns, drive=kind, drive_quantity=quantities[kind],
        factor=3.0 if kind == "u" else 1.0,
    )  # fmt: skip


@pytest.mark.parametrize("first", range(0, 60, 10))
def test_sound_rigs_have_no_doubts(first: int) -> None:
    """60 rigs with descriptions up to a quarter off, and dampings up to a factor of two."""
    for seed in range(first, first + 10):
        rig = drawn(seed)
        model = rig.description(guessed(rig, seed))
        assert not told(model, campaign(rig, (1.0,), seconds=8.0, band=(1.0, 50.0), seed=seed)), seed


@pytest.mark.parametrize(("name", "cause"), list(CAUSES))
def test_sound_rigs_with_a_cause_have_none(name: str, cause: str) -> None:
    for seed in range(3):
        assert not told(RIGS[name].description(guessed(RIGS[name], seed)), recorded(name, cause)), seed


def backwards(measured: Campaign) -> Campaign:
    def reversed_run(run: Run) -> Run:
        channels = {
            name: dataclasses.replace(channel, samples=channel.read()[::-1], scale=1.0) for name, channel in run.channels.items()
        }
        return dataclasses.replace(run, channels=channels)

    return dataclasses.replace(measured, runs=tuple(map(reversed_run, measured.runs)))


def test_records_in_reverse_order() -> None:
    for seed in range(8):
        rig = drawn(seed)
        measured = campaign(rig, (1.0,), seconds=8.0, band=(1.0, 50.0), seed=seed)
        (doubt,) = told(rig.description(guessed(rig, seed)), backwards(measured))
        assert doubt.kind == "reversed", seed


@pytest.mark.parametrize(("name", "cause"), [("stage", "friction"), ("one", "friction"), ("three", "play")])
def test_a_known_small_damping_with_a_cause_is_no_damping_ratio(name: str, cause: str) -> None:
    """Friction that is not described looks like a larger damping."""
    rig = RIGS[name]
    joints = tuple((a, b, stiffness, 0.02) for a, b, stiffness, _ in rig.joints)
    measured = campaign(
        dataclasses.replace(rig, joints=joints, laws={0: CAUSES[name, cause]}), (LEVELS[name],), seconds=6.0, seed=1
    )
    known = dataclasses.replace(rig, joints=joints)
    errors = {path: factor for path, factor in guessed(rig, 3).items() if not path.endswith("damping")}
    assert not told(known.description(errors, tuple(f"links.l{k}.stiffness" for k in range(len(joints)))), measured)


#: Rig, channel, recorded value divided by the true one, and what is reported.
MISTAKES = [
    ("one", "force", 1e-3, "force were in kN read as N"), ("one", "a", 1.0 / 9.80665, "a were in g read as m/s^2"),
    ("stage", "force", 1e-3, "force were in kN read as N"), ("stage", "low", 1e3, "low were in mm read as m"),
    ("stage", "low", 1e6, "low were in um read as m"), ("stage", "low", 1.0 / 0.0254, "low were in in read as m"),
    ("stage", "top", 1.0 / 9.80665, "top were in g read as m/s^2"), ("three", "force", 1e-3, "force were in kN read as N"),
    ("three", "force", 1.0 / 4.44822, "force were in lbf read as N"), ("three", "a1", 9.80665, "a1 were in m/s^2 read as g"),
    ("three", "a2", 10.0, "m/s^2 read as g"), ("three", "a2", 100.0, "no confusion"),
    ("torsion", "motor", 180.0 / pi, "motor were in deg read as rad"),
    ("torsion", "load", 30.0 / pi, "load were in rpm read as rad/s"),
    ("torsion", "torque", 1e3, "torque were in N mm read as N m"), ("carts", "u", 1e3, "u were in mV read as V"),
    ("platform", "device", 1.0 / 9.80665, "in g read as m/s^2"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("mistake", "cause"), [(each, cause) for each in MISTAKES for cause in ("", *(c for name, c in CAUSES if name == each[0]))]
)
def test_channels_in_wrong_units(mistake: tuple[str, str, float, str], cause: str) -> None:
    """On one, two and three response channels, also with an unmodelled cause; descriptions are up to a quarter off."""
    name, channel, factor, said = mistake
    rig = RIGS[name]
    free = ("drive.factor", "links.l0.stiffness", "links.l1.stiffness") if name == "carts" else None
    (doubt,) = told(rig.description(guessed(rig, 3), free), recorded(name, cause, {channel: factor}))
    assert said in doubt.text
    assert channel in doubt.text.split(": check the unit")[1]


@pytest.mark.parametrize(
    ("name", "wrong", "said"),
    [
        ("stage", {"links.l0.stiffness": 1e-3}, "between N/mm and N/m"),
        ("stage", {"links.l0.stiffness": 1e-3, "links.l1.stiffness": 1e-3}, "between N/mm and N/m"),
        ("one", {"links.l0.stiffness": 1e-3}, "between N/mm and N/m"),
        ("three", {f"bodies.m{k}.mass": 1.0 / 0.45359 for k in range(3)}, "between lb and kg"),
        ("three", {f"bodies.m{k}.mass": 1e3 for k in range(3)}, "between g and kg"),
        ("torsion", {f"bodies.m{k}.mass": 1e4 for k in range(2)}, "between kg cm^2 and kg m^2"),
        ("torsion", {"links.l1.stiffness": pi / 180.0}, "between N m/deg and N m/rad"),
        ("torsion", {"links.l0.stiffness": 1e-3, "links.l1.stiffness": 1e-3}, "between kN m/rad and N m/rad"),
    ],
)
def test_given_values_in_wrong_units(name: str, wrong: Mapping[str, float], said: str) -> None:
    rig = RIGS[name]
    errors = guessed(rig, 3)
    (doubt,) = told(rig.description({path: errors[path] * wrong.get(path, 1.0) for path in errors}), recorded(name))
    assert doubt.parameter.split("+") == list(wrong)
    assert said in doubt.text


def test_other_mistakes_must_explain_more_than_the_unknown_factor_of_a_drive() -> None:
    """Factor given as twentyfold, stiffness as a fifth: a tenth of the sample rate explains the levels as well as the factor."""
    rig = dataclasses.replace(
        ONE, masses=(3.1,), joints=((0, -1, 12e3, 22.0),), drive="u", drive_quantity="voltage", factor=3.0
    )  # fmt: skip
    model = rig.description({"drive.factor": 20.0, "links.l0.stiffness": 0.2})
    found, _ = wrong_scale(replace(model, free=(*model.free, "drive.factor")), spectra_of(model, campaign(rig, seconds=6.0)))
    assert found is not None
    assert (found.kind, found.ratio) == ("responses", pytest.approx(1.0 / 20.0, rel=0.5))


@pytest.mark.parametrize("at", [0.02, 0.5, 1.6])
def test_a_hammer_that_hits_after_a_short_wait_shows_the_levels(at: float) -> None:
    """A window that hides the first hundredths of a record would show the ringing alone; `at` is in seconds of four."""
    rate, seconds = 1024.0, 4.0
    rig = dataclasses.replace(THREE, joints=tuple((a, b, k, 0.05 * c) for a, b, k, c in THREE.joints))
    t = np.arange(round(seconds * rate)) / rate - at
    hit = 200.0 * np.sin(pi * t / 0.004) * ((t >= 0.0) & (t < 0.004))
    drawn = np.random.default_rng(6)
    quantities = rig.quantities()
    channels = {
        name: Channel(
            name=name, samples=values + drawn.normal(0.0, 1e-3 * values.std(), len(t)), quantity=quantities[name],
            unit=SI_UNIT[quantities[name]],
        )
        for name, values in rig.recorded(hit, rate).items()
    }  # fmt: skip
    run = Run(id="hit", configuration="unlocked", sample_rate=rate, gain=1.0, channels=channels, excitation="other")
    model = rig.description(guessed(rig, 7))
    assert wrong_scale(model, spectra_of(model, Campaign(runs=(run,), source="hits")))[0] is None


@pytest.mark.parametrize(("share", "hidden"), [(0.99, True), (1.01, False)])
def test_a_window_hides_a_drive_of_which_it_leaves_a_fiftieth(share: float, hidden: bool) -> None:
    """A single pulse, where the squared window is that share."""
    samples = 20000
    pulse = np.zeros(samples)
    pulse[int(np.searchsorted(np.hanning(samples)[: samples // 2] ** 2, share * 0.02))] = 1.0
    window = _window([pulse, np.zeros(samples)], samples)
    assert bool(window[0] == 1.0) is hidden
    np.testing.assert_array_equal(window[samples // 2 :], np.hanning(samples)[samples // 2 :])


def test_inverted_sensors_and_wrong_rates() -> None:
    model = STAGE.description(guessed(STAGE, 2))
    (doubt,) = told(model, recorded("stage", "", {"top": -1.0}))
    assert (doubt.kind, doubt.parameter, doubt.ratio) == ("sign", "sensors.top", -1.0)
    assert "negative sensitivity" in doubt.text
    (doubt,) = told(model, recorded("stage", "friction", {"force": -1.0}))
    assert (doubt.kind, doubt.parameter, doubt.ratio) == ("sign", "drive.force", -1.0)
    (doubt,) = told(ONE.description(guessed(ONE, 2)), recorded("one", "", {"a": -1.0}))
    assert "a has the opposite sign of what the given rig predicts: check the direction of force and of a's sensor" in doubt.text
    measured = recorded("stage")
    for factor in (2.0, 0.5):
        runs = tuple(dataclasses.replace(run, sample_rate=factor * run.sample_rate, band=None) for run in measured.runs)
        found, _ = wrong_scale(model, spectra_of(model, dataclasses.replace(measured, runs=runs)))
        assert found is not None
        assert (found.kind, found.ratio) == ("rate", factor)


@pytest.mark.parametrize(
    ("factor", "found"), [(1.0, False), (2.0, True), (0.5, True), (4.0, True), (0.2, True), (1.7, False), (1.4, False)]
)
def test_a_resonance_confirms_a_wrong_rate(factor: float, found: bool) -> None:
    """With play the levels alone do not decide, but the resonance is recorded at the same multiple of the described one.

    1.4 and 1.7 are no factors by which rates are mistaken."""
    measured, model = recorded("platform", "play"), PLATFORM.description(guessed(PLATFORM, 2))
    runs = tuple(dataclasses.replace(run, sample_rate=factor * run.sample_rate, band=None) for run in measured.runs)
    doubts = told(model, dataclasses.replace(measured, runs=runs))
    assert [doubt.parameter for doubt in doubts] == ["sample_rate"] * found


@pytest.mark.parametrize(("ratio", "confirmed"), [(2.48, True), (2.52, False), (1.62, True), (1.58, False)])
def test_boundary_of_a_confirmed_rate(ratio: float, confirmed: bool) -> None:
    shown = Resonance(channel="a", recorded=ratio, given=1.0)
    assert _confirmed(_Explanation("rate", (), 2.0), shown) is confirmed


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"links.l0.stiffness": 1e-3, "links.l1.stiffness": 1e-3, "links.l2.stiffness": 1e-3}, "between N/mm and N/m"),
        ({f"bodies.m{k}.mass": 1e3 for k in range(3)}, "between g and kg"), ({}, "check the sample rate"),
    ],
)  # fmt: skip
def test_a_wrong_factor_on_a_strongly_nonlinear_rig_is_no_exchange(wrong: Mapping[str, float], said: str) -> None:
    """A spring that hardens leaves no phase that the linear rig predicts; half the rate where no value is wrong."""
    if ("hardening", "cubic") not in RECORDED:
        RECORDED["hardening", "cubic"] = campaign(HARDENING, (0.6, 1.6), seconds=12.0, band=(0.5, 12.0))
    measured = RECORDED["hardening", "cubic"]
    if not wrong:
        runs = tuple(dataclasses.replace(run, sample_rate=0.5 * run.sample_rate) for run in measured.runs)
        measured = dataclasses.replace(measured, runs=runs)
    off = {"links.l0.stiffness": 0.93, "links.l1.stiffness": 1.08, "links.l2.stiffness": 1.2}
    model = HARDENING.description({path: off.get(path, 1.0) * wrong.get(path, 1.0) for path in {**off, **wrong}})
    (doubt,) = told(model, measured)
    assert said in doubt.text


@pytest.mark.parametrize(("name", "cause"), [key for key in CAUSES if len(RIGS[key[0]].sensors) > 1])
def test_exchanged_responses_are_found_with_a_cause(name: str, cause: str) -> None:
    rig, measured = RIGS[name], recorded(name, cause)
    for a, b in combinations([channel for channel, _, _ in rig.sensors], 2):
        runs = tuple(
            dataclasses.replace(run, channels={**run.channels, a: run.channels[b], b: run.channels[a]}) for run in measured.runs
        )
        doubts = told(rig.description(guessed(rig, 1)), dataclasses.replace(measured, runs=runs))
        assert [(doubt.kind, doubt.parameter) for doubt in doubts] == [("swapped", f"channels.{a}/{b}")]


def drafted(rig: StrangeRig) -> RigModel:
    """Its description with a draft's values."""
    model = rig.description()
    masses = {f"bodies.m{k}.mass": 1.0 for k in range(len(rig.masses))}
    return model.replace({**masses, **{f"links.{x.name}.{key}": v for x in model.links for key, v in DRAFT.items()}})


DRAFT = {"stiffness": 1000.0, "damping": 1.0}


@pytest.mark.parametrize("name", ["stage", "one", "three", "torsion", "carts"])
def test_drafted_values_are_said_to_be_drafted(name: str) -> None:
    """With the ratio of the lowest natural frequency, recorded by drafted; a sound description has no such sentence."""
    rig = RIGS[name]
    (doubt,) = told(drafted(rig), recorded(name))
    assert doubt.kind == "drafted"
    assert "the drafted values of m0" in doubt.text

    def lowest(masses: list[float], stiffness: list[float]) -> float:
        rows = [[(k == a) - (k == b) for k in range(len(masses))] for a, b, _, _ in rig.joints]
        matrix = np.array(rows).T @ np.diag(stiffness) @ np.array(rows)
        return float(np.sqrt(np.linalg.eigvals(np.diag(1.0 / np.array(masses)) @ matrix).real.min()))

    ones = [1.0] * len(rig.masses)
    true = lowest(list(rig.masses), [joint[2] for joint in rig.joints]) / lowest(ones, [1000.0] * len(rig.joints))
    # Six seconds resolve a tenth of the lowest frequency.
    assert doubt.ratio == pytest.approx(true, rel=0.1)
    assert f"{doubt.ratio:.2g} times" in doubt.text


def test_values_that_are_partly_drafted() -> None:
    """The other values may be wrong, too; a link that is only as stiff as a draft's is not drafted."""
    model = STAGE.description(guessed(STAGE, 2)).replace({f"links.l1.{key}": value for key, value in DRAFT.items()})
    first, second = told(model, recorded("stage", "", {"low": 1e3}))
    assert "the drafted values of l1:" in first.text
    assert "low were in mm read as m" in second.text
    (alone,) = told(model.replace({"links.l1.damping": 5.0}), recorded("stage", "", {"low": 1e3}))
    assert alone.kind == "unit"


@pytest.mark.parametrize(("damping", "shown"), [(0.24, True), (0.27, False)])
def test_a_resonance_doubles_the_response(damping: float, shown: bool) -> None:
    omega = np.geomspace(0.01, 100.0, 4000)
    response = np.abs(1j * omega / (1.0 - omega**2 + 2j * damping * omega))
    found = _peak(omega, response, 1)
    assert (found is not None) is shown
    assert found is None or found == pytest.approx(np.sqrt(1.0 - 2.0 * damping**2) / (2.0 * pi), rel=0.005)


def test_a_wrong_rate_is_said_with_the_ratio_of_the_resonances() -> None:
    measured = recorded("stage")
    runs = tuple(dataclasses.replace(run, sample_rate=2.0 * run.sample_rate, band=None) for run in measured.runs)
    (doubt,) = told(STAGE.description(), dataclasses.replace(measured, runs=runs))
    assert "is recorded at 7.6" in doubt.text
    assert "2 times the 3.7" in doubt.text


@pytest.mark.parametrize("factor", [1e3, 1.0 / 9.80665, 2.0, 0.45])
def test_boundary_of_a_ratio(factor: float) -> None:
    """A factor of two is an unmodelled cause, not a unit."""
    assert bool(told(THREE.description(), recorded("three", "play", {"force": factor}))) == (not 1.0 / 3.0 < factor < 3.0)


@pytest.mark.filterwarnings("ignore:Badly conditioned filter coefficients")
def test_linear_spectra_agree_with_scipy() -> None:
    """Responses of the linear part, against the frequency response of scipy's state space."""
    from scipy.signal import freqresp

    model = STAGE.description()
    m, c, k = np.diag([4.0, 2.0]), np.array([[18.0, -6.0], [-6.0, 6.0]]), np.array([[7e3, -3e3], [-3e3, 3e3]])
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(m, k), -np.linalg.solve(m, c)]])
    b = np.vstack([np.zeros((2, 1)), np.linalg.solve(m, [[1.0], [0.0]])])
    omega = np.array([1.0, 20.0, 31.0, 77.0, 300.0])
    _, low = freqresp((a, b, np.eye(1, 4), np.zeros((1, 1))), omega)
    _, top = freqresp((a, b, np.eye(1, 4, 1), np.zeros((1, 1))), omega)
    found = LinearRig(model, "unlocked").responses(omega, given_parameters(model))[:, 0, 0]
    np.testing.assert_allclose(found, np.stack([low, -(omega**2) * top]), rtol=1e-7)


def test_friction_as_a_damper() -> None:
    """The damper takes what Gaussian dry friction takes on average: its power at that speed is F times the mean |v|."""
    tree = to_tree(ONE.description())
    tree["contacts"] = [{"name": "rail", "a": "m0", "law": {"law": "coulomb", "friction_force": 3.0}}]
    model = from_tree(tree)
    spectrum = spectrum_of(model, recorded("one").runs[0], {})
    assert spectrum is not None
    rig, values = LinearRig(model, "unlocked"), given_parameters(model)
    found = dampers(rig.free_motion(spectrum.omega, values), values, spectrum, np.array([[3.0]]), np.ones((1, 1)))
    v = rig.motion(spectrum.omega, dataclasses.replace(values, friction=found))[0, 0, 0] * 1j * spectrum.omega
    speed, damper = np.sqrt(np.sum(np.abs(v) ** 2 * spectrum.drives[0, 0].real) * spectrum.square), found[0, 0]
    assert damper * speed**2 == pytest.approx(3.0 * np.sqrt(2.0 / np.pi) * speed, rel=0.02)


def test_a_run_that_begins_with_a_gap_has_no_spectrum() -> None:
    run = dataclasses.replace(recorded("one").runs[0], gaps=(Gap(first_tick=0, count=3),))
    assert spectrum_of(from_tree(to_tree(ONE.description())), run, {}) is None


def test_pairs_of_units() -> None:
    """The ratio of recorded to true value: 1 m read as mm is a thousandth, and inches may be read as millimetres."""
    pairs = mistaken("displacement")
    assert pairs["mm read as m"] == pytest.approx(1e3)
    assert pairs["m read as mm"] == pytest.approx(1e-3)
    assert log(pairs["in read as mm"]) == pytest.approx(-log(25.4))


@pytest.mark.parametrize(("ratio", "held"), [(2.4e-3, True), (0.3, True), (1e-3, False), (3.3, False)])
def test_undescribed_friction_holds_a_body_without_a_spring_back(ratio: float, held: bool) -> None:
    """By any factor, but by none of units; a spring limits it."""
    free = dataclasses.replace(ONE, joints=((0, -1, 0.0, 20.0),)).description()
    less = WrongScale(kind="responses", names=("a",), ratio=ratio)
    assert _held_back(free, less) == held
    assert not _held_back(ONE.description(), less)


@pytest.mark.parametrize(("base", "small"), [(True, False), (False, True)])
def test_a_small_factor_of_a_given_value_takes_a_known_force(base: bool, small: bool) -> None:
    """On a moved base, a stiffness that hysteresis doubles is a mass in lb read as kg."""
    rig = dataclasses.replace(ONE, base=base, drive_quantity="acceleration" if base else "force")
    factors = [each.factor for each in _explanations(rig.description()) if each.kind == "mass" and each.factor]
    assert min(max(factor, 1.0 / factor) for factor in factors) == pytest.approx(2.2046 if small else 1000.0, rel=1e-3)


def test_a_rig_without_a_spring_does_not_show_a_wrong_rate() -> None:
    free = dataclasses.replace(ONE, joints=((0, -1, 0.0, 20.0),)).description()
    kinds = [{each.kind for each in _explanations(rig)} for rig in (free, ONE.description())]
    assert ["rate" in each for each in kinds] == [False, True]


def described_as(model: RigModel, channel: str, quantity: str) -> RigModel:
    """The rig with another quantity of a channel in its description."""
    tree = to_tree(model)
    for part in (tree["drive"], *tree["sensors"]):
        part["quantity"] = quantity if part["channel"] == channel else part["quantity"]
    return from_tree(tree)


def other_derivatives(model: RigModel) -> list[tuple[str, Quantity, Quantity]]:
    """Channel, quantity and another derivative of it, of all motions that the rig records."""
    motions = [(sensor.channel, sensor.quantity) for sensor in model.sensors]
    motions += [(drive.channel, drive.quantity) for drive in model.drives if drive.imposes is not None]
    return [
        (channel, quantity, other)
        for channel, quantity in motions
        for other in MOTION
        if quantity in MOTION and other != quantity and (other in ROTARY) == (quantity in ROTARY)
    ]


def is_told(doubt: Doubt, channel: str, quantity: str, other: str) -> bool:
    """Whether a doubt says that a channel is a quantity where the description has another."""
    is_, but = (f"an? {one.replace('_', ' ')}" for one in (quantity, other))
    said = rf"\b{channel}\b.* (varies|vary) with frequency like {is_}, but the description has {but}\b"
    return doubt.kind == "derivative" and re.search(said, doubt.text) is not None


@pytest.mark.parametrize(("name", "cause"), [*((name, "") for name in RIGS), *CAUSES])
def test_another_derivative_than_described(name: str, cause: str) -> None:
    """Of each sensor and of an imposed motion, also with an unmodelled cause; descriptions are up to a quarter off."""
    model = RIGS[name].description(guessed(RIGS[name], 3))
    for channel, quantity, other in other_derivatives(model):
        (doubt,) = told(described_as(model, channel, other), recorded(name, cause))
        assert is_told(doubt, channel, quantity, other), (channel, other, doubt.text)
        # The recording has the true quantity, so the description is wrong.
        assert doubt.text.endswith("correct the quantity in the description, since the recording has that.")


@pytest.mark.parametrize("first", range(0, 40, 10))
def test_another_derivative_on_rigs_drawn_at_random(first: int) -> None:
    for seed in range(first, first + 10):
        rig = drawn(seed)
        model, measured = rig.description(guessed(rig, seed)), campaign(rig, (1.0,), seconds=8.0, band=(1.0, 50.0), seed=seed)
        wrong = other_derivatives(model)
        channel, quantity, other = wrong[seed % len(wrong)]
        (doubt,) = told(described_as(model, channel, other), measured)
        assert is_told(doubt, channel, quantity, other), (seed, channel, other, doubt.text)


def test_all_sensors_of_one_quantity_have_another_derivative() -> None:
    """They were mapped alike, and the mapping and the description agree; relative to a force, the drive is not doubtful."""
    model = THREE.description(guessed(THREE, 3))
    for name in ("a0", "a1", "a2"):
        model = described_as(model, name, "velocity")
    runs = [
        dataclasses.replace(run, channels={k: dataclasses.replace(c, quantity="velocity") for k, c in run.channels.items()})
        for run in recorded("three").runs
    ]
    (doubt,) = told(model, dataclasses.replace(recorded("three"), runs=tuple(runs)))
    assert doubt.parameter == "sensors.a0+sensors.a1+sensors.a2"
    assert "a0 and a1 and a2 vary with frequency like an acceleration, but the description has a velocity" in doubt.text
    assert doubt.text.endswith("check the unit in the mapping and the quantity in the description.")


def test_the_only_response_and_its_base_cannot_be_distinguished() -> None:
    (run,) = recorded("platform").runs
    plain = {name: dataclasses.replace(channel, quantity="force") for name, channel in run.channels.items()}
    measured = dataclasses.replace(recorded("platform"), runs=(dataclasses.replace(run, channels=plain),))
    (doubt,) = told(described_as(PLATFORM.description(), "base", "displacement"), measured)
    assert doubt.parameter == "sensors.device+drive.base"
    assert "device varies with frequency like a displacement, but the description has an acceleration, or base" in doubt.text


@pytest.mark.parametrize(("correlation", "named"), [(0.51, True), (0.49, False)])
def test_another_derivative_must_agree_with_the_phases(correlation: float, named: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_Compared, "correlation", lambda *given: np.array([correlation, 0.9]))
    monkeypatch.setattr(_Compared, "agree", lambda *given: True)
    found, _ = wrong_scale(
        described_as(STAGE.description(), "low", "velocity"), spectra_of(STAGE.description(), recorded("stage"))
    )
    assert (found is not None and found.kind == "derivative") is named


def on_another_body(model: RigModel, channel: str, body: str) -> RigModel:
    """The rig with a sensor on another body in its description."""
    tree = to_tree(model)
    for sensor in tree["sensors"]:
        sensor["body"] = body if sensor["channel"] == channel else sensor["body"]
    return from_tree(tree)


def with_exchanged_masses(model: RigModel, one: str, other: str) -> RigModel:
    """The rig with the masses of two bodies exchanged in its description."""
    paths = f"bodies.{one}.mass", f"bodies.{other}.mass"
    return model.replace(dict(zip(paths, map(model.get, reversed(paths)), strict=True)))


@pytest.mark.parametrize(
    ("name", "cause"),
    [*((name, "") for name in ("stage", "three", "torsion", "carts")), ("stage", "friction"), ("stage", "play")],
)
def test_a_sensor_on_another_body_than_described(name: str, cause: str) -> None:
    """Also with an unmodelled cause; descriptions are up to a quarter off."""
    model = RIGS[name].description(guessed(RIGS[name], 3))
    for sensor in model.sensors:
        for body in model.bodies:
            if body.name != sensor.body:
                (doubt,) = told(on_another_body(model, sensor.channel, body.name), recorded(name, cause))
                assert (doubt.kind, doubt.parameter) == ("place", f"sensors.{sensor.channel}")
                assert doubt.text.startswith(f"{sensor.channel} seems to be on {sensor.body} instead of {body.name}: there, the")


def pushed(model: RigModel, body: str) -> RigModel:
    """The rig with a drive that acts on another body in its description."""
    tree = to_tree(model)
    tree["drive"]["pushes"] = {body: 1.0}
    return from_tree(tree)


@pytest.mark.parametrize(
    ("name", "cause"),
    [
        *((name, "") for name in ("stage", "three", "torsion", "carts")),
        ("stage", "friction"), ("stage", "play"), ("torsion", "friction"),
    ],
)  # fmt: skip
def test_a_drive_on_another_body_than_described(name: str, cause: str) -> None:
    model = RIGS[name].description(guessed(RIGS[name], 3))
    (own,) = model.drive.pushes
    for body in model.bodies:
        if body.name != own:
            (doubt,) = told(pushed(model, body.name), recorded(name, cause))
            assert (doubt.kind, doubt.parameter) == ("place", f"drive.{model.drive.channel}")
            assert doubt.text.startswith(f"{model.drive.channel} seems to act on {own} instead of {body.name}: there, the linear")


@pytest.mark.parametrize(("name", "cause"), [("stage", ""), ("stage", "friction"), ("stage", "play"), ("torsion", "friction")])
def test_two_sensors_on_each_other_s_body(name: str, cause: str) -> None:
    model = RIGS[name].description(guessed(RIGS[name], 3))
    one, other = model.sensors
    assert one.quantity != other.quantity
    wrong = on_another_body(on_another_body(model, one.channel, str(other.body)), other.channel, str(one.body))
    (doubt,) = told(wrong, recorded(name, cause))
    assert (doubt.kind, doubt.parameter) == ("place", f"sensors.{one.channel}+sensors.{other.channel}")


@pytest.mark.parametrize("first", range(0, 20, 10))
def test_drives_on_rigs_drawn_at_random(first: int) -> None:
    """A drive on another body is named with its body, or the rig moves much as described; nothing else is.

    The response of one body to a force on another is that of the other to a force on the one: a single sensor cannot tell them
    apart.
    """
    count = 0
    for seed in range(first, first + 10):
        rig = drawn(seed)
        model, measured = rig.description(guessed(rig, seed)), campaign(rig, (1.0,), seconds=8.0, band=(1.0, 50.0), seed=seed)
        others = [body.name for body in model.bodies if model.drive.pushes and body.name not in model.drive.pushes]
        if others:
            found = told(pushed(model, others[seed % len(others)]), measured)
            count += len(found)
            for doubt in found:
                if len(model.sensors) == 1:
                    assert "check the places of sensor and drive" in doubt.text
                    continue
                assert doubt.parameter == f"drive.{model.drive.channel}", (seed, doubt.text)
                assert next(iter(model.drive.pushes)) in doubt.text.split(" instead of ")[0], (seed, doubt.text)
    assert count >= 4


@pytest.mark.parametrize(
    ("name", "cause", "pair"),
    [
        ("stage", "", ("m0", "m1")), ("stage", "friction", ("m0", "m1")), ("three", "", ("m0", "m1")),
        ("three", "", ("m0", "m2")), ("torsion", "friction", ("m0", "m1")),
    ],
)  # fmt: skip
def test_the_masses_of_two_bodies_are_exchanged(name: str, cause: str, pair: tuple[str, str]) -> None:
    model = with_exchanged_masses(RIGS[name].description(guessed(RIGS[name], 3)), *pair)
    (doubt,) = told(model, recorded(name, cause))
    assert (doubt.kind, doubt.parameter) == ("swapped", f"bodies.{pair[0]}.mass+bodies.{pair[1]}.mass")
    values = f"({model.body(pair[0]).mass:.4g} and {model.body(pair[1]).mass:.4g} {'kg m^2' if name == 'torsion' else 'kg'})"
    assert doubt.text.startswith(f"The given masses of {pair[0]} and {pair[1]} {values} seem exchanged: with them exchanged, the")


@pytest.mark.parametrize(("ratio", "offered"), [(UNLIKE * 1.01, True), (UNLIKE * 0.99, False), (1.0 / UNLIKE / 1.01, True)])
def test_masses_that_are_nearly_alike_are_not_exchanged(ratio: float, offered: bool) -> None:
    model = STAGE.description().replace({"bodies.m0.mass": 2.0 * ratio, "bodies.m1.mass": 2.0})
    assert any(each.kind == "exchange" for each in _explanations(model)) is offered


def test_bodies_that_move_alike_are_both_named() -> None:
    """Two masses with a stiff joint between them, on a soft mount: the sensor is not on the ground's side of it."""
    stiff = dataclasses.replace(
        THREE, masses=(6.0, 3.0, 2.0), joints=((0, -1, 9e3, 30.0), (1, 0, 5e3, 12.0), (2, 1, 4e6, 60.0)),
        sensors=(("a0", 0, "acceleration"), ("a1", 1, "acceleration")), pushed=0,
    )  # fmt: skip
    (doubt,) = told(on_another_body(stiff.description(), "a1", "m0"), campaign(stiff, (20.0,), seconds=6.0, seed=1))
    assert doubt.kind == "place"
    assert set(re.findall(r"m\d", doubt.text.split(" instead of ")[0])) == {"m1", "m2"}


@pytest.mark.parametrize("first", range(0, 20, 10))
def test_sensors_on_rigs_drawn_at_random(first: int) -> None:
    """A sensor on another body is named with its body, or it moves much as described; nothing else is."""
    count = 0
    for seed in range(first, first + 10):
        rig = drawn(seed)
        model, measured = rig.description(guessed(rig, seed)), campaign(rig, (1.0,), seconds=8.0, band=(1.0, 50.0), seed=seed)
        bodies = [body.name for body in model.bodies if body.name not in model.imposed]
        sensor = model.sensors[seed % len(model.sensors)]
        others = [body for body in bodies if body != sensor.body]
        if others:
            found = told(on_another_body(model, sensor.channel, others[seed % len(others)]), measured)
            count += len(found)
            for doubt in found:
                assert doubt.kind == "place", (seed, doubt.text)
                assert sensor.body in doubt.text.split(" instead of ")[0], (seed, doubt.text)
    assert count >= 4


@pytest.mark.parametrize(("left", "far", "named"), [(0.3, False, True), (0.35, False, False), (0.35, True, True)])
def test_another_body_must_leave_little_of_what_the_described_one_leaves(
    left: float, far: bool, named: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = STAGE.description()
    compared = _Compared(model, spectra_of(model, recorded("stage")))
    sound, place = _Explanation("sound"), _Explanation("place", (0,), bodies=(1,))
    correlations = {sound: np.array([0.0, 0.9]), place: np.array([np.sqrt(1.0 - left), 0.9])}
    monkeypatch.setattr(_Compared, "correlation", lambda of, explanation, theta: correlations[explanation])
    assert compared.repairs(place, np.zeros(0), (sound, np.zeros(0)), far=far) is named
    correlations[place] = np.array([0.69, 0.9])
    assert not compared.repairs(place, np.zeros(0), (sound, np.zeros(0)), far=True)
