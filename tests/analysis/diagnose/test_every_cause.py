"""Every cause of the catalogue: unique, documented, and the same size for proposals and for the virtual rig."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, TypeVar, get_args

import msgspec
import numpy as np
import pytest

from isorig.analysis.diagnose.causes import CATALOGUE
from isorig.analysis.diagnose.causes.at_link import LinkCause, LinkInRuns
from isorig.analysis.diagnose.causes.base import (
    SMALLEST,
    Cause,
    Evidence,
    Kind,
    RandomSizes,
    RigWithCause,
    Sizes,
    WeakestSizes,
)  # fmt: skip
from isorig.analysis.diagnose.causes.measurement_chain import DriveCause
from isorig.analysis.diagnose.causes.play_and_friction import PlayAndFriction
from isorig.analysis.diagnose.free_shapes import free_shapes
from isorig.analysis.fitting.solve import Free, base_parameters
from isorig.analysis.laws import ElastoSlip, Periodic, QuadraticDamping
from isorig.analysis.model.rig_model import Body, Drive, Link, RigModel, Sensor
from isorig.rig.wire_bonder.description import wire_bonder
from isorig.rig.wire_bonder.effects import KINDS, OUTSIDE, PAIRS, generator_of, hidden_in

T = TypeVar("T")
ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "diagnosing.md").read_text(encoding="utf-8")
CHANNELS = ("head", "motor", "table", "heatblock")
EVIDENCE = Evidence(
    deflection={"table": 1e-3, "heatblock": 1e-5, "isolation": 5e-3}, speed={"table": 0.1, "heatblock": 0.01, "isolation": 0.3},
    peak=dict.fromkeys(CHANNELS, 4.0), sample_rate=1024.0, end_time=720.0, flat_tops=dict.fromkeys(CHANNELS, 3.0),
    mains=dict.fromkeys(CHANNELS, 50.0), misfit_frequencies=(30.0,), forces={}, push=25.0,
    configurations=frozenset({"locked", "unlocked"}), described=wire_bonder(), guess=wire_bonder(),
    pitches={"table": 5e-4, "heatblock": 5e-6, "isolation": 2e-3},
)  # fmt: skip


def name_of(cause: Cause) -> str:
    return cause.name


def rig_without(cause: Cause) -> RigModel:
    """A wire bonder that has a place for it; for a drive that differs from its command, driven by a recorded current."""
    bonder = wire_bonder(friction=cause.name != "coulomb_friction")
    if isinstance(cause, DriveCause):
        bonder = msgspec.structs.replace(bonder, drive=msgspec.structs.replace(bonder.drive, quantity="current"))
    given = ("links.table.stiffness",) if cause.name == "wrong_stiffness" else ()
    return msgspec.structs.replace(bonder, free=tuple(path for path in bonder.free if path not in given))


every_cause = pytest.mark.parametrize("cause", CATALOGUE, ids=name_of)


def test_names_are_unique_and_differ_from_the_kinds() -> None:
    names = Counter(map(name_of, CATALOGUE))
    assert [name for name, times in names.items() if times > 1] == []
    assert set(names) & set(get_args(Kind)) == set()
    assert all(re.fullmatch("[a-z]+(_[a-z]+)*", name) for name in names), "findings and reports show it in words"


@every_cause
def test_its_row_in_the_documentation_is_its_docstring(cause: Cause) -> None:
    first = (type(cause).__doc__ or "").partition("\n")[0].rstrip(".")
    assert f"| `{cause.name}` | `{cause.kind}` | {first[:1].lower()}{first[1:]} |" in PAGE


def test_the_documentation_has_no_other_causes() -> None:
    assert set(re.findall(r"^\| `(\w+)` \| `\w+` \|", PAGE, re.MULTILINE)) == set(map(name_of, CATALOGUE))


@every_cause
def test_a_candidates_parameters_exist_in_its_models(cause: Cause) -> None:
    candidates = cause.candidates(rig_without(cause), EVIDENCE)
    assert {candidate.location for candidate in candidates} == set(cause.places(rig_without(cause)))
    for candidate in candidates:
        for start in candidate.starts:
            assert all(free.low <= start.get(free.path) <= free.high for free in candidate.free)
            assert all(np.isfinite(reported.of(start)) for reported in candidate.reported)


@every_cause
def test_a_report_says_its_parameters_in_words(cause: Cause) -> None:
    derived = {"place", "play", "clearance_alone", "change", "shifted", "at_end"}
    reported = {r.name for candidate in cause.candidates(rig_without(cause), EVIDENCE) for r in candidate.reported}
    assert set(re.findall(r"\{(\w+)\}", cause.phrase)) <= reported | derived


@every_cause
def test_the_smallest_cause_changes_the_rig_less_than_a_hidden_one(cause: Cause) -> None:
    """The size of what a virtual rig hides under the same relative size is at least that of the smallest."""
    model = rig_without(cause)
    for place in cause.supposed_places(model):
        for smallest in cause.smallest(model, EVIDENCE, place):
            assert smallest.model != model or smallest.hum is not None
            assert not_beyond_the_smallest(cause, model, place, smallest) == []


class DrawnSizes(RandomSizes):
    """At random, but always the first option: an effect of either sign is of the same size."""

    def one_of(self, options: Sequence[T]) -> T:
        return options[0]


def not_beyond_the_smallest(cause: Cause, model: RigModel, place: str, smallest: RigWithCause) -> list[str]:
    """The parameters of the smallest cause that a hidden one of the same relative size does not always exceed.

    A parameter determines the size if it changes with the relative size; the direction of this change is that of larger effects.
    """
    once, twice = (cause.sized(model, EVIDENCE, place, size * SMALLEST, WeakestSizes()).parameters for size in (1.0, 2.0))
    towards = {name: np.sign(twice[name] - once[name]) for name in once if twice[name] != once[name]}
    assert towards, "a cause has a parameter that grows or decreases with its size"
    hidden = [
        cause.sized(model, EVIDENCE, place, SMALLEST, DrawnSizes(generator_of(seed, "any"))).parameters for seed in range(9)
    ]
    assert all(set(one) == set(smallest.parameters) for one in hidden)
    return [name for name, sign in towards.items() if any(sign * (one[name] - smallest.parameters[name]) < 0.0 for one in hidden)]


class Drags(LinkCause):
    """A cause with a parameter that no other cause has, of a size in the wrong order or drawn as one that does not matter."""

    kind = "damping_shape"
    family = "damping"
    law = QuadraticDamping
    names: ClassVar = {"quadratic_damping": "drag"}

    def __init__(self, number: Callable[[Sizes], float]) -> None:
        self.number = number

    def free(self, link: LinkInRuns) -> Iterable[Free]:
        return (Free(path="quadratic_damping", low=1e-3, high=1e3),)

    def sized_law(self, link: LinkInRuns, size: float, sizes: Sizes) -> QuadraticDamping:
        return QuadraticDamping(quadratic_damping=size * self.number(sizes))


@pytest.mark.parametrize(
    ("number", "found"),
    [
        (lambda sizes: sizes.weak_to_strong(1.0, 2.0), []),
        (lambda sizes: sizes.weak_to_strong(2.0, 1.0), ["drag"]),
        (lambda sizes: sizes.between(1.0, 2.0), ["drag"]),
    ],
    ids=["weak to strong", "strong to weak", "between"],
)  # fmt: skip
def test_a_size_of_any_name_is_compared(number: Callable[[Sizes], float], found: list[str]) -> None:
    cause, model = Drags(number), wire_bonder()
    (smallest,) = cause.smallest(model, EVIDENCE, "isolation")
    assert not_beyond_the_smallest(cause, model, "isolation", smallest) == found


def test_an_effects_random_numbers_follow_from_its_name() -> None:
    """A new cause must not change what a seed hides under the others' names: these are the numbers that the names give."""
    assert generator_of(3, "end_stop").uniform() == pytest.approx(0.158149683)
    assert generator_of(3, "quadratic_damping").uniform() == pytest.approx(0.095356169)
    assert len({generator_of(3, kind).uniform() for kind in KINDS}) == len(KINDS)


def test_every_kind_of_effect_can_be_hidden() -> None:
    assert {*(cause for pair in PAIRS for cause in pair), *(f"outside: {name}" for name in OUTSIDE), "none", "two"} <= set(KINDS)
    for kind in KINDS:
        hidden = hidden_in(wire_bonder(), kind, 1.0, 5)
        assert {name for name, _ in hidden.truth} <= ({kind} if kind != "two" else set(KINDS))


def test_the_page_on_causes_lists_every_family() -> None:
    page = (ROOT / "docs" / "add-cause.md").read_text(encoding="utf-8")
    listed = page.split("*Which family?*")[1].split("\n-")[0]
    assert set(re.findall("`([a-z]+)`", listed)) == {cause.family for cause in CATALOGUE}


def test_play_and_friction_have_a_size_in_a_link_with_a_law_alone() -> None:
    """The gravity of an arm is a periodic law of a link without spring and damper, whose friction has no usual size."""
    gravity = Link(name="gravity", a="arm", laws=(Periodic(periodic_force=2.0, pitch=6.283),))
    rig = RigModel(
        name="arm", bodies=(Body(name="arm", mass=0.1, motion="rotation"),), links=(gravity,),
        drive=Drive(channel="torque", pushes={"arm": 1.0}, quantity="torque"),
        sensors=(Sensor(channel="angle", body="arm", quantity="angle"),),
    )  # fmt: skip
    runs = replace(EVIDENCE, deflection={"gravity": 2.0}, speed={"gravity": 1.0})
    starts = [*PlayAndFriction().starts(LinkInRuns(rig, runs, "gravity"), runs)]
    laws = [law for start in starts for law in start.link("gravity").laws if isinstance(law, ElastoSlip)]
    assert len(laws) == len(starts) > 0


def test_an_offset_that_absorbed_a_friction_starts_as_described() -> None:
    """Half the difference of two levels is a constant force; one that a baseline had fitted would falsify both."""
    path = "drive.chain.offset"
    model = wire_bonder().replace({path: 0.7})
    cause = next(each for each in CATALOGUE if each.name == "asymmetric_friction")
    forms = [candidate for place in cause.places(model) for candidate in cause.proposed(model, EVIDENCE, place)]
    curves = [shape for shape in free_shapes(model, EVIDENCE) if shape.shape is not None and shape.shape.over == "speed"]
    frictions = [shape for shape in curves if shape.cause == "friction_shape"]
    assert forms
    assert frictions
    assert {start.get(path) for candidate in (*forms, *frictions) for start in candidate.starts} == {0.0}


def test_two_viscosities_take_the_place_of_a_damping_that_is_free() -> None:
    """A damping beside them is one parameter too many: no data determine all three."""
    damping, law = "links.isolation.damping", "contacts.isolation.law"
    cause = next(each for each in CATALOGUE if each.name == "asymmetric_friction")
    free = msgspec.structs.replace(wire_bonder().replace({damping: 3.0}), free=(damping,))
    (candidate,) = cause.proposed(free, EVIDENCE, "isolation")
    for start in candidate.starts:
        assert [start.get(path) for path in (damping, f"{law}.forward_viscosity", f"{law}.backward_viscosity")] == [0.0, 3.0, 3.0]
    assert [each.path for each in candidate.parameters(free, base_parameters(free)) if each.path == damping] == []
    (candidate,) = cause.proposed(msgspec.structs.replace(free, free=()), EVIDENCE, "isolation")
    assert {start.get(damping) for start in candidate.starts} == {3.0}


def test_a_force_over_velocity_is_in_the_damper_of_parallel_links() -> None:
    rig = RigModel(
        name="shock absorber", bodies=(Body(name="rod", mass=2.0),),
        links=(Link(name="gas", a="rod", stiffness=2000.0), Link(name="valves", a="rod", damping=1200.0)),
        drive=Drive(channel="force", pushes={"rod": 1.0}, quantity="force"),
        sensors=(Sensor(channel="x", body="rod", quantity="displacement"),),
    )  # fmt: skip
    runs = replace(EVIDENCE, deflection=dict.fromkeys(("gas", "valves"), 0.02), speed=dict.fromkeys(("gas", "valves"), 0.3))
    shapes = {(each.cause, each.location) for each in free_shapes(rig, runs)}
    quadratic = next(each for each in CATALOGUE if each.name == "quadratic_damping")
    assert ("damping_shape", "valves") in shapes
    assert ("damping_shape", "gas") not in shapes
    assert quadratic.places(rig) == ("valves",)
    alone = msgspec.structs.replace(rig, links=rig.links[:1])
    assert ("damping_shape", "gas") in {(each.cause, each.location) for each in free_shapes(alone, runs)}
    assert quadratic.places(alone) == ("gas",)
