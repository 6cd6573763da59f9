"""An unknown force at each place of rigs whose middle has no sensors: what no force there explains tells the place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import msgspec
import numpy as np
import pytest
from scipy.signal import chirp
from strange_rigs import StrangeRig

from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.analysis.equations import unknown_force
from isorig.analysis.equations.at_place import equations_at
from isorig.analysis.equations.ranking import ranking
from isorig.analysis.equations.system import CausePlace
from isorig.analysis.equations.unknown_force import (
    EXCLUDED,
    EXPLAINS,
    Located,
    Places,
    compared_places,
    is_linear,
    is_own,
    tells,
)
from isorig.analysis.errors import ModelError, SimulationError
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.trials import Trial
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


def given(off: float = 1.0) -> RigModel:
    """The described chain with every spring this factor off, and free springs and dampers."""
    described = CHAIN.description()
    links = tuple(msgspec.structs.replace(link, stiffness=off * link.stiffness) for link in described.links)
    free = tuple(f"links.{link.name}.{what}" for link in links for what in ("stiffness", "damping"))
    return msgspec.structs.replace(described, links=links, free=free)


def campaign(truth: RigModel, gains: dict[str, float] | None = None, *, swept: bool = False) -> Campaign:
    """Two levels of a random force, or of a `swept` one, with noise of 0.1 % of each record."""
    draw, runs, time = np.random.default_rng(1), [], np.arange(8192) / RATE
    for k, level in enumerate((10.0, 30.0)):
        force = random(samples=4096, sample_rate=RATE, rms=level, band=(1.0, 30.0), seed=k)
        if swept:
            force = level * chirp(time, 2.0, time[-1], 60.0, method="logarithmic") * np.minimum(time, 1.0)
        shown = simulate(truth, Excitation.prepare(force, RATE), configuration="unlocked").channels
        records = {name: values * (gains or {}).get(name, 1.0) for name, values in {"force": force, **shown}.items()}
        channels = {
            name: Channel(name=name, samples=values + draw.normal(0.0, 1e-3 * values.std(), len(values)),
                          quantity="force" if name == "force" else "acceleration")
            for name, values in records.items()
        }  # fmt: skip
        runs.append(Run(id=f"r{k}", configuration="unlocked", sample_rate=RATE, gain=level, channels=channels,
                        excitation="other" if swept else "random", band=None if swept else (1.0, 30.0)))  # fmt: skip
    return replace(Campaign(runs=tuple(runs), source="chain"), description=description_text(CHAIN.description(), {}))


def with_cubic(link: str, factor: float) -> RigModel:
    """The chain with a hardening spring in a link."""
    laws = {link: (Cubic(cubic_stiffness=factor),)}
    links = tuple(msgspec.structs.replace(each, laws=laws.get(each.name, ())) for each in CHAIN.description().links)
    return msgspec.structs.replace(CHAIN.description(), links=links)


@cache
def hardened(link: str) -> tuple[Campaign, Sequence[Trial], Places]:
    """Recorded with a hardening link, the runs as fitted with springs a tenth off, and what each place leaves."""
    model, measured = given(0.9), campaign(with_cubic(link, 3e9))
    trials = prepare(measured, model)
    places = compared_places(model, trials)
    assert places is not None
    return measured, trials, places


@pytest.mark.parametrize("link", ["l0", "l2", pytest.param("l4", marks=pytest.mark.study)])
def test_the_link_that_hardens_leaves_least_of_all_links_though_all_springs_are_off(link: str) -> None:
    measured, trials, places = hardened(link)
    links = [one for one in places.located if one.place.kind == "link"]
    assert links[0].place.name == link
    assert links[0].left < 4.0  # windows of 16 s spread what is left over neighbouring bins
    assert links[1].left > EXCLUDED * links[0].left
    assert places.includes(link)
    assert places.includes("lock")
    assert not places.includes({"l0": "l4", "l2": "l4", "l4": "l0"}[link])
    # The rest of the rig is known then.
    others = [f"links.l{k}.stiffness" for k in range(5) if f"l{k}" != link]
    assert [links[0].model.get(path) for path in others] == pytest.approx(
        [CHAIN.description().get(path) for path in others], rel=0.05
    )
    # The equation of the link alone shows the kind.
    equations = equations_at(links[0], measured, trials)
    ranked = ranking(equations)
    assert ranked.worst > 10.0
    assert {item.place for item in ranked.explanations} == {link}
    assert ranked.explanations[0].what == "force over deflection"


def test_a_gain_that_is_fitted_is_none_of_the_equation_of_a_link_alone() -> None:
    """The equation has the estimated motion and force of the link, and no sensor of the rig."""
    gain, (measured, trials, places) = "sensors.a2.chain.gain", hardened("l2")
    place = next(one for one in places.located if one.place == CausePlace("link", "l2"))
    fitted = replace(place, model=msgspec.structs.replace(place.model, free=(*place.model.free, gain)))
    assert equations_at(fitted, measured, trials).model.free == place.model.free
    of_sensor = replace(fitted, place=CausePlace("sensor", "a2"))
    assert gain in equations_at(of_sensor, measured, trials).model.free


def test_a_sweep_tells_of_its_resonance_though_the_allowed_errors_are_largest_there() -> None:
    """Above its end the records are small, so that a force there would count a hundred times as much."""
    model, measured = given(0.95), campaign(with_cubic("l2", 3e9), swept=True)
    places = compared_places(model, prepare(measured, model))
    assert places is not None
    assert places.located[0].place == CausePlace("link", "l2")
    assert places.located[0].left < 2.0


def test_a_channel_with_a_wrong_gain_leaves_least() -> None:
    model, measured = given(), campaign(CHAIN.description(), {"a2": 1.1})
    trials = prepare(measured, model)
    places = compared_places(model, trials)
    assert places is not None
    assert places.located[0].place == CausePlace("sensor", "a2")
    ranked = ranking(equations_at(places.located[0], measured, trials))
    best = ranked.explanations[0]
    assert (best.kind, best.place, best.what) == ("sensor", "a2", "gain")
    assert best.values["value"] == pytest.approx(1.1, abs=0.01)


def test_a_sound_rig_with_wrong_springs_excludes_nothing() -> None:
    model = given(0.9)
    places = compared_places(model, prepare(campaign(CHAIN.description()), model))
    assert places is not None
    assert places.bare < 4.0
    assert not places.possible


def test_a_run_without_a_drive_is_not_compared() -> None:
    model = given()
    trials = prepare(campaign(CHAIN.description()), model)
    still = [replace(trial, excitation=Excitation.prepare(np.zeros(4096), RATE)) for trial in trials]
    assert all(tells(model, trial) for trial in trials)
    assert not any(tells(model, trial) for trial in still)
    assert compared_places(model, still) is None
    assert compared_places(model, trials[:1]) is not None


def located(*left: float) -> tuple[Located, ...]:
    """Links that leave so much."""
    return tuple(Located(place=CausePlace("link", f"l{k}"), left=value, model=given()) for k, value in enumerate(left))


@pytest.mark.parametrize(("left", "tells"), [(0.99 * EXPLAINS, True), (1.01 * EXPLAINS, False)])
def test_a_place_tells_from_half_of_the_misfit(left: float, tells: bool) -> None:
    assert bool(Places(bare=1.0, located=located(left, 1.0)).possible) is tells


@pytest.mark.parametrize(("left", "possible"), [(0.99 * EXCLUDED, True), (1.01 * EXCLUDED, False)])
def test_a_place_is_excluded_from_twice_the_best(left: float, possible: bool) -> None:
    assert Places(bare=10.0, located=located(1.0, left)).includes("l1") is possible


@pytest.mark.parametrize(
    ("path", "linear", "own"),
    [
        ("links.l1.stiffness", True, True), ("links.l1.damping", True, True), ("links.l2.damping", True, False),
        ("bodies.m1.mass", True, False), ("drive.factor", True, False), ("links.l1.laws.0.cubic_stiffness", False, True),
        ("sensors.a0.chain.gain", False, False),
    ],
)  # fmt: skip
def test_which_values_are_fitted_along_and_which_are_a_part_of_the_force(path: str, linear: bool, own: bool) -> None:
    assert is_linear(path) is linear
    assert is_own(path, CausePlace("link", "l1")) is own
    assert not is_own(path, CausePlace("sensor", "a0"))


@pytest.mark.parametrize("error", [ModelError("too quick"), SimulationError("without bound")])
def test_values_that_cannot_be_simulated_end_a_fit(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    """A linear step may lead to an extreme damper; what was fitted before it counts."""

    def failing(self: object, *given: object) -> None:
        raise error

    monkeypatch.setattr(unknown_force._Rig, "__init__", failing)
    before = unknown_force._Fitted(2.0, given())
    assert before.settled(None, []) == before
