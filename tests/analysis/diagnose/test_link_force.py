"""A link's force from the records, compared with the law that was simulated; the filter for differentiated displacements."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace
from small_rigs import carts, chain, guessed, played, rubbing, with_law

from isorig.analysis import laws
from isorig.analysis.diagnose.link_force import LinkForce, link_force, link_record
from isorig.analysis.lowpass import low_passed, signal_edge
from isorig.analysis.model.rig_model import Contact, RigModel


def force_of(truth: RigModel, known: RigModel, link: str, seed: int) -> LinkForce | None:
    """From the strongest run, over its swing."""
    run = played(truth, seed=seed).runs[-1]
    seen = link_record(truth, truth.link(link), run)
    assert seen is not None
    return link_force(known, known.link(link), run, np.abs(seen.deflection).max() * np.linspace(-1.0, 1.0, 31))


def test_a_curve_inside_a_chain_follows_from_accelerations() -> None:
    at = np.linspace(-0.02, 0.02, 41)
    law = laws.Curve(over="deflection", at=tuple(at), values=tuple(30.0 * (at / 0.01) ** 5))
    found = force_of(with_law(chain(), "l1", law), guessed(chain(), 5), "l1", 21)
    assert found is not None
    true = 2900.0 * found.at + 30.0 * (found.at / 0.01) ** 5
    assert np.abs(found.values - true)[3:-3].max() < 0.06 * np.abs(true).max()
    assert found.damping == pytest.approx(3.0, rel=0.3)


def test_a_link_drawn_the_other_way_has_the_same_force() -> None:
    """The deflection changes its sign with the order of a link's ends, and the force with it."""
    links = tuple(replace(link, a=link.b, b=link.a) if link.name == "l1" else link for link in chain().links)
    turned = replace(chain(), links=links)
    one, other = (force_of(model, model, "l1", 21) for model in (chain(), turned))
    assert one is not None
    assert other is not None
    for found in (one, other):
        assert np.polyfit(found.at, found.values, 1)[0] == pytest.approx(2900.0, rel=0.02)
        assert found.damping == pytest.approx(3.0, rel=0.3)


def test_an_unknown_mass_is_fitted_along_with_measured_accelerations() -> None:
    known = replace(chain(), free=("bodies.m1.mass",)).replace({"bodies.m1.mass": 1.0})
    found = force_of(chain(), known, "l1", 22)
    assert found is not None
    assert found.others["bodies.m1.mass"] == pytest.approx(1.3, rel=0.05)  # noise makes it smaller


def test_positions_with_noise_give_the_force_without_their_noise() -> None:
    at = np.linspace(-0.1, 0.1, 41)
    law = laws.Curve(over="deflection", at=tuple(at), values=tuple(5.0 * (at / 0.03) ** 3))
    found = force_of(with_law(carts(), "wall", law), carts(), "wall", 23)
    assert found is not None
    assert found.others == {}
    true = 410.0 * found.at + 5.0 * (found.at / 0.03) ** 3
    assert np.abs(found.values - true)[3:-3].max() < 0.1 * np.abs(true).max()


def test_friction_is_the_force_that_reverses_with_the_velocity() -> None:
    found = force_of(rubbing(carts(), "wall", 1.5), carts(), "wall", 24)
    assert found is not None
    assert found.friction == pytest.approx(1.5, rel=0.2)


def test_a_contact_elsewhere_makes_the_force_unknown() -> None:
    loose = Contact(name="rail", a="m2", b="ground", law=laws.Coulomb(friction_force=1.0))
    assert force_of(chain(), replace(chain(), contacts=(loose,)), "l1", 25) is None
    # Beyond the last link nothing else acts.
    beside = replace(chain(), contacts=(Contact(name="foot", a="m0", b="ground", law=laws.Coulomb(friction_force=1.0)),))
    assert force_of(chain(), beside, "l2", 25) is not None


def test_the_edge_of_a_signal_lies_between_its_frequencies_and_the_noise() -> None:
    rate, n = 200.0, 4000
    time = np.arange(n) / rate
    clean = np.sin(2 * np.pi * 3.0 * time) + 0.3 * np.sin(2 * np.pi * 11.0 * time)
    noisy = clean + 0.01 * np.random.default_rng(3).normal(size=n)
    edge = signal_edge(noisy, rate)
    assert 11.0 < edge < 13.0
    # What passes at the edge is filtered alike in all records; the noise above it is gone.
    left = (low_passed(noisy, rate, edge) - low_passed(clean, rate, edge))[200:-200]
    assert np.std(left) < 0.01 * np.sqrt(1.2 * edge / (rate / 2.0))
    assert np.std((low_passed(clean, rate, edge) - clean)[200:-200]) < 0.15
    assert low_passed(noisy, rate, np.inf) is noisy
    assert signal_edge(np.random.default_rng(4).normal(size=n), rate) == np.inf
