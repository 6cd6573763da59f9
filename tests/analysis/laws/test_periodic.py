"""A force that repeats with the position: its energy, its period, and the equilibrium of a spring."""

import numpy as np
import pytest

from isorig.analysis.errors import ModelError
from isorig.analysis.laws import Periodic
from isorig.analysis.laws.base import NO_LINK, LinkConstants

D = np.linspace(-0.05, 0.05, 20_001)


def force(law: Periodic, link: LinkConstants, d: np.ndarray = D) -> np.ndarray:
    still = np.zeros(len(d))
    return law.force(d, still, still, still[None], link)


def test_its_force_is_the_slope_of_its_energy() -> None:
    law = Periodic(periodic_force=3.0, pitch=0.02, phase=0.7)
    energy = -3.0 * 0.02 / (2.0 * np.pi) * np.cos(2.0 * np.pi * D / 0.02 + 0.7)
    np.testing.assert_allclose(force(law, NO_LINK)[1:-1], np.gradient(energy, D)[1:-1], atol=1e-5)


def test_it_repeats_with_the_pitch() -> None:
    law = Periodic(periodic_force=3.0, pitch=0.02, phase=0.7)
    np.testing.assert_allclose(force(law, NO_LINK, D + 0.02), force(law, NO_LINK), atol=1e-12)


def test_a_spring_is_at_equilibrium_at_zero_and_a_link_without_one_is_not() -> None:
    law, zero = Periodic(periodic_force=3.0, pitch=0.02, phase=0.7), np.zeros(1)
    assert force(law, LinkConstants(stiffness=1.0), zero)[0] == 0.0
    assert force(law, NO_LINK, zero)[0] == pytest.approx(3.0 * np.sin(0.7))


def test_it_refuses_a_negative_force_and_no_pitch() -> None:
    with pytest.raises(ModelError, match="periodic_force"):
        Periodic(periodic_force=-1.0, pitch=0.02)
    with pytest.raises(ModelError, match="pitch"):
        Periodic(periodic_force=1.0, pitch=0.0)
