"""Two channels with one record: what lies between them does not move, and no equation of it is solved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from small_rigs import chain, played, rubbing, with_law

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign
from isorig.analysis.diagnose.link_force import link_force
from isorig.analysis.diagnose.observe import swings
from isorig.analysis.equations.ranking import ranking
from isorig.analysis.equations.spectral import Spectra
from isorig.analysis.equations.system import equations_of
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.spectra.noise import noise_level


@pytest.fixture(scope="module")
def copied() -> Campaign:
    """The record of the first body in the channel of the second, too."""
    campaign = played(rubbing(chain(), "l0", 2.0), seed=3)
    runs = (replace(run, channels={**run.channels, "a1": replace(run.channels["a0"], name="a1")}) for run in campaign.runs)
    return replace(campaign, runs=tuple(runs))


@pytest.mark.parametrize(
    "model",
    [
        rubbing(chain(), "l1", 1.0),
        with_law(chain(), "l1", laws.ElastoSlip(spring_stiffness=1e3, slip_force=1.0)),
    ],
)
def test_equations_of_a_link_that_does_not_move(copied: Campaign, model: RigModel) -> None:
    equations = equations_of(copied, model)
    assert all(sliding.swing > 0.0 for sliding, _ in equations.sliding.values())
    assert all(np.isfinite(run.power).all() for run in equations.spectra.runs)
    ranking(equations)


def test_force_and_deflection_of_a_link_that_does_not_move(copied: Campaign) -> None:
    model = chain()
    deflection, _ = swings(model, prepare(copied, model))
    assert deflection["l1"] > 0.0
    assert link_force(model, model.link("l1"), copied.runs[0], 1e-3 * np.linspace(-1.0, 1.0, 49)) is None


def test_a_band_without_frequency_bins() -> None:
    spectra = Spectra(100.0, 256, 60.0, 50.0, [("a", 0)], {"a": 0})
    spectra.add(0, {("a", 0): np.ones(1000)}, {"a": 1.0})
    assert spectra.runs[0].power.shape == (0, 1, 1)


def test_noise_in_a_band_of_few_frequency_bins(copied: Campaign) -> None:
    level = noise_level(replace(copied.runs[0], usable_to=2.0), "a0")
    assert level is not None
    assert np.isfinite(level)
