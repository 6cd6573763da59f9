"""Many rigs side by side against the same rigs one by one."""

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.linalg import expm

from isorig.analysis import laws
from isorig.analysis.diagnose.causes.at_link import added
from isorig.analysis.errors import SimulationError
from isorig.analysis.model.rig_model import Configuration, RigModel
from isorig.analysis.simulate import Excitation, scan, simulate
from isorig.analysis.simulate.batch import exponentials
from isorig.analysis.simulate.excitation import moves, random
from isorig.rig.wire_bonder.description import THESIS, wire_bonder

RATE = 2048.0


def records(models: list[RigModel], excitation: Excitation, **chosen: str) -> dict[str, np.ndarray]:
    """The records of all rigs by channel, each shape (rigs, n)."""
    names = [sensor.channel for sensor in models[0].sensors]
    whole = scan(models, excitation, lambda seen: np.stack([seen[name] for name in names], axis=1), **chosen)
    return {name: whole[:, k] for k, name in enumerate(names)}


@pytest.mark.parametrize(("force", "limit"), [(60.0, 0.012), (25.0, 0.02)])
def test_side_by_side_is_one_by_one(force: float, limit: float) -> None:
    drive = random(samples=20480, sample_rate=RATE, rms=force / THESIS["head_mass"], band=(1.0, 250.0), seed=1)
    excitation = Excitation.prepare(drive, RATE, oversample=1)
    models = [wire_bonder({**THESIS, "motor_frequency": f}) for f in np.linspace(3.0, 7.0, 70)]
    batch = records(models, excitation)
    for index in (0, 33, 69):
        want = simulate(models[index], excitation).channels
        for name in ("motor", "table"):
            error = np.std(batch[name][index] - want[name]) / np.std(want[name])
            assert error < limit, (name, index)


@pytest.mark.parametrize("configuration", ["unlocked", "locked"])
def test_without_friction_single_precision_is_all_that_differs(configuration: str) -> None:
    drive = moves(samples=4096, sample_rate=RATE)
    excitation = Excitation.prepare(drive, RATE, oversample=2)
    models = [wire_bonder({**THESIS, "table_mass": m}, friction=False) for m in (60.0, 80.0, 250.0)]
    batch = records(models, excitation, configuration=configuration)
    for index, model in enumerate(models):
        want = simulate(model, excitation, configuration=configuration).channels
        for name, values in want.items():
            assert np.std(batch[name][index] - values) < 1e-3 * np.std(values)


def test_rigs_that_share_no_structure_are_simulated_one_by_one() -> None:
    plain = wire_bonder()
    bent = added(plain, plain.link("isolation"), laws.Cubic(cubic_stiffness=1e8))
    excitation = Excitation.prepare(moves(samples=1024, sample_rate=RATE), RATE, oversample=1)
    batch = records([plain, bent], excitation)
    for index, model in enumerate((plain, bent)):
        assert np.array_equal(batch["motor"][index], simulate(model, excitation).channels["motor"])


@pytest.mark.parametrize("bent", [False, True])
def test_a_scan_is_the_figure_of_the_records(bent: bool) -> None:
    """Rooms are used again, the last one is not full, and rigs of different structure are taken too."""
    excitation = Excitation.prepare(moves(samples=1024, sample_rate=RATE), RATE, oversample=1)
    models = [wire_bonder({**THESIS, "motor_frequency": f}) for f in np.linspace(3.0, 7.0, 300)]
    if bent:
        models = [*models[:3], added(models[0], models[0].link("isolation"), laws.Cubic(cubic_stiffness=1e8))]
    found = scan(models, excitation, lambda seen: np.ptp(seen["motor"], axis=1))
    assert np.array_equal(found, np.ptp(records(models, excitation)["motor"], axis=1))


def test_exponentials_of_a_stack() -> None:
    stack = np.random.default_rng(0).normal(size=(5, 6, 6)) * np.array([1e-6, 1e-2, 1.0, 5.0, 20.0])[:, None, None]
    for matrix, got in zip(stack, exponentials(stack), strict=True):
        want = expm(matrix)
        assert np.abs(got - want).max() <= 1e-12 * np.abs(want).max()


def test_a_rig_that_grows_is_refused() -> None:
    excitation = Excitation.prepare(np.ones(40960), RATE, oversample=1)
    # A lock that pushes what it should hold.
    pushing = Configuration(rigid=("isolation",), lock_stiffness=-1e6)
    with pytest.raises(SimulationError, match="grows"):
        records([replace(wire_bonder(friction=False), configurations={"locked": pushing})], excitation, configuration="locked")
