"""Places of a fault in rigs whose middle has no sensors: the misfit's direction over the records tells which remain."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from strange_rigs import StrangeRig

from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.analysis.diagnose.places import EXCLUDED, EXPLAINS, Places, compared_places
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.laws import Cubic
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.simulate import Excitation, simulate
from isorig.analysis.simulate.excitation import random
from isorig.rig.files.rigfile import description_text

#: Five masses, ground at one end; the first, the middle and the last have a sensor.
CHAIN = StrangeRig(
    masses=(1.2, 0.9, 1.0, 0.8, 1.1),
    joints=((0, -1, 9e3, 6.0), (1, 0, 2.2e4, 4.0), (2, 1, 1.8e4, 4.0), (3, 2, 2.5e4, 5.0), (4, 3, 1.5e4, 3.0)),
    sensors=(("a0", 0, "acceleration"), ("a2", 2, "acceleration"), ("a4", 4, "acceleration")),
)
RATE = 256.0


def campaign(truth: RigModel, gains: dict[str, float] | None = None) -> Campaign:
    """Two levels of a random force, with noise of 0.1 % of each record."""
    draw, runs = np.random.default_rng(1), []
    for k, level in enumerate((10.0, 30.0)):
        force = random(samples=4096, sample_rate=RATE, rms=level, band=(1.0, 30.0), seed=k)
        shown = simulate(truth, Excitation.prepare(force, RATE), configuration="unlocked").channels
        records = {name: values * (gains or {}).get(name, 1.0) for name, values in {"force": force, **shown}.items()}
        channels = {
            name: Channel(name=name, samples=values + draw.normal(0.0, 1e-3 * values.std(), len(values)),
                          quantity="force" if name == "force" else "acceleration")
            for name, values in records.items()
        }  # fmt: skip
        runs.append(Run(id=f"r{k}", configuration="unlocked", sample_rate=RATE, gain=level, channels=channels,
                        excitation="random", band=(1.0, 30.0)))  # fmt: skip
    return replace(Campaign(runs=tuple(runs), source="chain"), description=description_text(CHAIN.description(), {}))


def with_cubic(link: str, factor: float) -> RigModel:
    """The chain with a hardening spring in a link."""
    given = CHAIN.description()
    laws = {link: (Cubic(cubic_stiffness=factor),)}
    links = tuple(msgspec.structs.replace(each, laws=laws.get(each.name, ())) for each in given.links)
    return msgspec.structs.replace(given, links=links)


@pytest.mark.parametrize("link", ["l0", "l1", "l2", "l3", "l4"])
def test_the_link_that_hardens_remains_and_far_ones_do_not(link: str) -> None:
    given = CHAIN.description()
    places = compared_places(given, prepare(campaign(with_cubic(link, 3e9)), given))
    assert places is not None
    assert link in places.possible
    assert sum(name.startswith("l") for name in places.possible) <= 2
    assert places.includes(link)
    assert places.includes("lock")
    assert not places.includes({"l0": "l4", "l1": "l4", "l2": "l4", "l3": "l0", "l4": "l0"}[link])


def test_a_channel_with_a_wrong_gain_remains_alone_of_the_channels() -> None:
    given = CHAIN.description()
    places = compared_places(given, prepare(campaign(given, {"a2": 1.1}), given))
    assert places is not None
    assert places.possible & {"force", "a0", "a2", "a4"} == {"a2"}


def test_a_sound_rig_excludes_nothing() -> None:
    given = CHAIN.description()
    places = compared_places(given, prepare(campaign(given), given))
    assert places is not None
    assert not places.possible


@pytest.mark.parametrize(("left", "tells"), [(0.99 * EXPLAINS, True), (1.01 * EXPLAINS, False)])
def test_a_place_tells_from_half_of_the_misfit(left: float, tells: bool) -> None:
    assert bool(Places(bare=1.0, left={"a": left, "b": 1.0}).possible) is tells


@pytest.mark.parametrize(("left", "possible"), [(0.99 * EXCLUDED, True), (1.01 * EXCLUDED, False)])
def test_a_place_is_excluded_from_twice_the_best(left: float, possible: bool) -> None:
    assert Places(bare=10.0, left={"a": 1.0, "b": left}).includes("b") is possible
