"""The generator of foreign campaigns: its motion agrees with closed formulas, its converter is sharp, its files can be read."""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

sys.path.insert(0, str(Path(__file__).parent))

import motion
from effects import EFFECTS
from foreign_campaign import Setting, draw
from instrument import CONVERTERS, converted
from motion import Elongation, Law, Rub, Seen, Spring

from isorig.analysis.campaign import MOTION, ROTARY
from isorig.analysis.fitting.excess import SIMULATION_LIMIT
from isorig.analysis.fitting.plausible import doubts_of_records
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.score import adequate, noise_floors, score
from isorig.analysis.spectra.quality import faults
from isorig.rig.cli import main
from isorig.rig.files.recording import read
from isorig.rig.files.rigfile import rig_of

ONE = Elongation(bodies=(0,), weights=(1.0,))
STEP = 1.0 / 32768.0


def moved(force: np.ndarray, *, c: float = 0.8, laws: tuple[Law, ...] = (), rubs: tuple[Rub, ...] = ()) -> np.ndarray:
    """Displacement of 1.5 kg on 400 N/m, shape (n,)."""
    spring = Spring(along=ONE, stiffness=400.0, damping=c, floor=False)
    return motion.run([1.5], [spring], laws, rubs, [Seen(along=ONE, order=0)], np.ones(1), force, 0.0 * force, STEP)[0]


def test_free_vibration_decays_as_its_closed_form() -> None:
    force = np.zeros(3 * 32768)
    force[0] = 1.0 / STEP
    t = STEP * np.arange(len(force))
    omega = np.sqrt(400.0 / 1.5)
    zeta = 0.8 / (2 * np.sqrt(400.0 * 1.5))
    closed = np.exp(-zeta * omega * t) * np.sin(omega * np.sqrt(1 - zeta**2) * t) / (1.5 * omega * np.sqrt(1 - zeta**2))
    assert np.abs(moved(force) - closed).max() < 1e-4 * closed.max()


def test_dry_friction_takes_four_times_its_force_over_the_stiffness_in_each_period() -> None:
    # A mass that is released decays by 2 F / k in each half period (Den Hartog, Mechanical Vibrations, section 2.6).
    force = np.where(np.arange(4 * 32768) < 32768, 8.0, 0.0)
    rub = Rub(name="coulomb", along=ONE, parameters=(0.4,))
    x = moved(force, c=0.0, rubs=(rub,))[32768:]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(x))) != 0)[:5]
    np.testing.assert_allclose(np.abs(np.diff(np.abs(x[turns + 1]))), 2 * 0.4 / 400.0, rtol=2e-3)


def test_a_relaxing_spring_has_its_complex_stiffness() -> None:
    k1, tau = 300.0, 0.02
    t = STEP * np.arange(6 * 32768)
    f = 7.0
    force = np.sin(2 * np.pi * f * t)
    x = moved(force, c=4.0, laws=(Law(name="maxwell", spring=0, parameters=(k1, tau)),))[-2 * 32768 :]
    wave = np.exp(-2j * np.pi * f * t[-2 * 32768 :])
    jw = 2j * np.pi * f
    compliance = 1.0 / (400.0 + 4.0 * jw + 1.5 * jw**2 + k1 * jw * tau / (1 + jw * tau))
    measured = np.sum(x * wave) / np.sum(force[-2 * 32768 :] * wave)
    assert abs(measured - compliance) < 1e-3 * abs(compliance)


@pytest.mark.parametrize("name", CONVERTERS)
def test_a_converter_is_flat_to_its_band_and_has_nothing_above_half_the_rate(name: str) -> None:
    rate, over, n = 1024.0, 32, 4096
    t = np.arange(n * over) / (rate * over)
    inside = converted(np.sin(2 * np.pi * 0.45 * rate * t)[None], over, name, n)[0, 1024:3072]
    np.testing.assert_allclose(np.sqrt(2 * np.mean(inside**2)), 1.0, atol=0.003)
    for f in (0.505, 0.7, 1.6, 5.3):
        outside = converted(np.sin(2 * np.pi * f * rate * t)[None], over, name, n)[0, 1024:3072]
        assert np.abs(outside).max() < 2e-3


def test_a_campaign_is_read_and_says_nothing_of_its_answer(clear: tuple[Path, Path]) -> None:
    campaign, answer = read(clear[0]), json.loads(clear[1].read_text())
    model = rig_of(campaign)
    for run in campaign.runs:
        assert {model.drive.channel, *(sensor.channel for sensor in model.sensors)} == set(run.channels)
        assert run.configuration in model.configurations
    assert [one["effect"] in EFFECTS for one in answer["effects"]] == [True]


def test_a_seed_gives_the_same_campaign_again(
    campaign_of: Callable[..., tuple[Path, Path]], tmp_path: Path
) -> None:  # fmt: skip
    records = []
    again = draw("torsion", 5, Setting(severity=1.0, soiled=True, effects=("one",)), tmp_path)
    assert again is not None
    for made in (campaign_of("torsion", "one", 5, soiled=True), again):
        assert json.loads(made[1].read_text())["disturbances"]
        records.append([run.read(name) for run in read(made[0]).runs for name in run.channels])
    for first, again in zip(*records, strict=True):
        np.testing.assert_array_equal(first, again)


@pytest.mark.parametrize("family", [pytest.param("wire_bonder", marks=pytest.mark.study), "base"])
def test_a_sound_rig_behind_a_sharp_filter_is_adequate_with_its_true_values(
    family: str, campaign_of: Callable[[str, str, int], tuple[Path, Path]]
) -> None:
    recording, told = campaign_of(family, "none", 5)
    campaign, answer = read(recording), json.loads(told.read_text())
    assert answer["converter"] in CONVERTERS
    true = rig_of(campaign).replace(answer["values"])
    trials = prepare(campaign, true, oversample=8)
    floors = np.hypot(noise_floors(true, trials)[0], SIMULATION_LIMIT)
    assert adequate(score(true, trials), floors)
    assert [fault.text for fault in faults(campaign, reference=true.drive.channel) if fault.kind == "noisy"] == []


@pytest.mark.study
@pytest.mark.timeout(900)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_sound_wire_bonder_behind_a_sharp_filter_is_called_adequate(seed: int, tmp_path: Path) -> None:
    made = draw("wire_bonder", seed, Setting(soiled=False, effects=("none",)), tmp_path)
    assert made is not None
    assert main(["diagnose", str(made[0]), "-o", str(tmp_path / "d")]) == 0
    findings = json.loads((tmp_path / "d" / "findings.json").read_text())
    assert (findings["verdict"], findings["steps"]) == ("adequate", [])


@pytest.mark.parametrize(
    ("family", "effects"),
    [
        ("torsion", "one"), ("base", "none"),
        *(
            pytest.param(family, effect, marks=pytest.mark.study)
            for family, effect in (("base", "one"), ("partial", "one"), ("torsion", "none"), ("partial", "none"))
        ),
    ],
)  # fmt: skip
def test_a_channel_of_another_derivative_is_said_with_and_without_a_cause(
    family: str, effects: str, campaign_of: Callable[..., tuple[Path, Path]]
) -> None:
    campaign = read(campaign_of(family, effects, 5, soiled=True)[0])
    model = rig_of(campaign)
    assert not doubts_of_records(model, campaign)
    for sensor in model.sensors:
        for other in MOTION:
            if other != sensor.quantity and (other in ROTARY) == (sensor.quantity in ROTARY):
                wrong = tuple(structs.replace(each, quantity=other) if each is sensor else each for each in model.sensors)
                (doubt,) = doubts_of_records(structs.replace(model, sensors=wrong), campaign)
                assert doubt.kind == "derivative"
                assert doubt.parameter == f"sensors.{sensor.channel}"
