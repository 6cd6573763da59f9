"""What the equations of motion blame, at the boundaries of its thresholds, and what follows for names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from small_rigs import guessed, played, stage, with_law

from isorig.analysis import laws
from isorig.analysis.diagnose import search
from isorig.analysis.diagnose import suspects as suspects_module
from isorig.analysis.diagnose.causes.base import Kind
from isorig.analysis.diagnose.diagnosis import diagnose
from isorig.analysis.diagnose.observe import observe
from isorig.analysis.diagnose.policy import POLICY
from isorig.analysis.diagnose.search import UNSEEN, Job, Screened, Suspected
from isorig.analysis.diagnose.step import Entry
from isorig.analysis.diagnose.suspects import (
    APART,
    BROKEN,
    CONTRIBUTES,
    LEAST_SCORE,
    NEARLY,
    ONLY,
    OWN,
    REPAIRED,
    SHOWN,
    Suspects,
    suspects,
)
from isorig.analysis.equations.columns import OVER_POSITION
from isorig.analysis.equations.forms import ElementForce
from isorig.analysis.equations.ranking import Explanation, Ranking
from isorig.analysis.equations.system import CausePlace, Equations
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.ladder import Starts
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.score import Score
from isorig.analysis.fitting.solve import Fit, Free
from isorig.analysis.model.rig_model import RigModel

POSSIBLE = SimpleNamespace(
    possible=(SimpleNamespace(place=CausePlace("link", "rail"), left=1.0),), includes=lambda place: place == "rail"
)


def blaming(
    *scores: tuple[str, str, float], worst: float = 20.0, after: float = 2.0, crossing: Sequence[str] = ("rail", "belt"),
    exact: bool = False,
) -> Suspects:  # fmt: skip
    """Suspects of explanations (kind, place, score) of an equation with the residual `worst`, `after` with the best.

    `crossing` are the links whose force is in the equation; `exact` is whether all its motions are measured.
    """
    explanations = tuple(
        Explanation(kind=kind, place=place, what="force over deflection", score=score, residuals={"table": after}, values={})
        for kind, place, score in scores
    )
    ranking = Ranking(residuals={"table": worst}, explanations=explanations)
    elements = [(SimpleNamespace(name=name), 1.0) for name in crossing]
    balances = [SimpleNamespace(name=name, crossing=elements) for name in ("table", "load")]
    equations = SimpleNamespace(
        balances=balances, with_estimates=frozenset(() if exact else ("table", "load")), unscaled=frozenset({"load"}),
        elements=lambda: [], model=SimpleNamespace(links=(), contacts=()),
    )  # fmt: skip
    return Suspects(ranking=ranking, chosen=explanations, places={}, equations=cast(Equations, equations))


@pytest.mark.parametrize(("share", "blamed"), [(NEARLY + 1e-9, True), (NEARLY - 1e-9, False)])
def test_a_kind_is_blamed_if_it_explains_nearly_as_much_as_the_best(share: float, blamed: bool) -> None:
    found = blaming(("spring_shape", "rail", 0.7), ("memory", "rail", 0.7 * share))
    assert found.blamed("hardening_stiffness", "rail")
    assert found.blamed("relaxation", "rail") == blamed
    assert not found.blamed("hardening_stiffness", "belt")


@pytest.mark.parametrize(("share", "another"), [(NEARLY + 1e-9, False), (NEARLY - 1e-9, True)])
def test_equations_that_show_a_channel_contradict_no_fault_of_it_that_is_nearly_as_good(share: float, another: bool) -> None:
    """A drive that acts late and one that lags differ by little."""
    late, lagging, other = (
        Explanation(kind="sensor", place=place, what=what, score=score, residuals={"table": after}, values={})
        for place, what, score, after in (("u", "delay", 1.2, 1.0), ("u", "lag", share * 1.2, 1.5), ("x", "gain", 0.1, 18.0))
    )
    found = blaming(("sensor", "u", 1.2), exact=True)
    found = replace(found, chosen=(late, lagging), ranking=replace(found.ranking, explanations=(late, lagging, other)))
    assert not found.show_another("channel_delay", "u")
    assert found.show_another("drive_lag", "u") is another
    assert found.show_another("clipping", "u")


@pytest.mark.parametrize(
    ("best", "other", "crossing", "told"),
    [
        (0.2, 0.99 / ONLY, ("rail",), True),
        (0.2, 1.01 / ONLY, ("rail",), False),
        (0.2, 0.1, ("rail", "belt"), False),  # its link may be either
        (0.2, 0.1, ("belt",), False),
        (0.9 * LEAST_SCORE, 0.0, ("rail",), False),
    ],
)
def test_the_only_broken_equation_shows_the_place(best: float, other: float, crossing: tuple[str, ...], told: bool) -> None:
    found = blaming(("spring_shape", "rail", best), ("memory", "rail", other * best), after=15.0, crossing=crossing)
    assert found.clear == (("spring_shape", "rail") if told else None)
    assert not (told and found.spread)


def test_the_next_suspects_are_of_another_kind_or_place() -> None:
    found = blaming(("drift", "rail", 0.7), ("drift", "belt", 0.6), ("spring_shape", "rail", 0.2), ("memory", "rail", 0.1))
    first = replace(found, chosen=found.chosen[:1])
    others = first.others
    assert others is not None
    assert [(item.kind, item.place) for item in others.chosen] == [("drift", "belt")]
    rest = replace(found, chosen=found.chosen[:2]).others
    assert rest is not None
    assert [item.kind for item in rest.chosen] == ["spring_shape", "memory"]
    assert rest.blamed("hardening_stiffness", "rail")
    assert found.others is None
    assert replace(first, tentative=True).others is None


def two_broken(own: float, other: float) -> Suspects:
    """A spring and a resonator that repair one of two broken equations each; `other` is what the latter leaves of the first."""
    spring, resonator = (
        Explanation(kind=kind, place=place, what="slip", score=score, residuals=residuals, values={})
        for kind, place, score, residuals in (
            ("spring_shape", "rail", 0.35, {"rail": own, "belt": 11.0}),
            ("added_motion", "cart", 0.3, {"rail": other, "belt": 1.0}),
        )
    )
    ranking = Ranking(residuals={"rail": 11.0, "belt": 11.0}, explanations=(spring, resonator))
    return Suspects(ranking=ranking, chosen=(spring, resonator), places={}, equations=cast(Equations, None))


@pytest.mark.parametrize(("share", "shown"), [(0.9, True), (1.15, False)])
def test_a_broken_equation_shows_the_only_explanation_that_repairs_it(share: float, shown: bool) -> None:
    """Half of its excess must be gone, and any other explanation must leave twice as much."""
    assert two_broken(1.0 + share * 10.0 ** (1.0 - SHOWN), 11.0).shown("spring_shape", "rail") == shown
    assert two_broken(1.0 + share * 10.0 ** (0.7 - APART), 1.0 + 10.0**0.7).shown("spring_shape", "rail") == shown


@pytest.mark.parametrize(
    ("worst", "left", "cause", "allowed"),
    [
        (BROKEN, 1.0, "hardening_stiffness", True),
        (BROKEN, 1.0, "stiffness_drift", False),
        (BROKEN, 0.4, "stiffness_drift", False),
        (BROKEN - 1e-9, 1.0, "stiffness_drift", True),
        (BROKEN - 1e-9, 0.4, "hardening_stiffness", False),
    ],
)
def test_a_form_that_leaves_an_error_is_named_only_where_the_equations_blame_it(
    worst: float, left: float, cause: str, allowed: bool
) -> None:
    found = blaming(("spring_shape", "rail", 0.7), ("drift", "rail", 0.3), worst=worst)
    source = Suspected(job=cast(Job, SimpleNamespace(left=left)), found=found)
    assert source.allows(tried(cause, "rail")) == allowed


@pytest.mark.parametrize(
    ("place", "left", "helps", "allowed"),
    [("load", 1.0, True, True), ("load", 1.0, False, False), ("load", 0.4, True, False), ("table", 1.0, True, False)],
)
def test_a_mass_that_no_equation_tests_is_allowed_as_a_first_cause_that_removes_most(
    place: str, left: float, helps: bool, allowed: bool
) -> None:
    job = SimpleNamespace(left=left, helps=lambda entries: helps)
    source = Suspected(job=cast(Job, job), found=blaming(("spring_shape", "rail", 0.7)))
    assert source.allows(tried("wrong_mass", place)) == allowed


def test_a_form_of_a_nearly_as_good_explanation_is_one_otherwise() -> None:
    for score, nearly in ((NEARLY, True), (NEARLY - 1e-9, False)):
        found = blaming(("memory", "rail", 1.0), ("friction_shape", "rail", score))
        assert found.otherwise("coulomb_friction", "rail") is nearly
        assert not found.otherwise("hysteresis", "rail")


def tried(cause: str, place: str) -> Entry:
    """A fitted candidate of which only its name counts."""
    return cast(Entry, SimpleNamespace(candidate=SimpleNamespace(cause=cause, location=place, key=(cause, place))))


@pytest.mark.parametrize(
    ("strict", "kinds", "left", "helps", "allowed"),
    [
        (True, UNSEEN, 1.0, True, True),
        (True, UNSEEN, 1.0, False, False),  # merely closer
        (True, None, 1.0, True, False),  # all equations hold
        (True, UNSEEN, 0.3, True, False),  # a second cause of what the equations do not see
        (False, UNSEEN, 0.3, True, False),
        (False, None, 0.3, False, True),
    ],
)
def test_without_reason_by_the_equations_only_the_main_share_of_the_error_allows_a_first_cause_that_they_miss(
    strict: bool, kinds: frozenset[Kind] | None, left: float, helps: bool, allowed: bool
) -> None:
    job = cast("Job", SimpleNamespace(left=left, helps=lambda entries: helps, rubbing=""))
    entry = cast(Entry, SimpleNamespace(place=("spring_shape", "rail")))
    assert Screened(job=job, strict=strict, kinds=kinds).allows(entry) == allowed


@pytest.mark.parametrize(
    ("place", "factor", "allowed"),
    [("rail", 1.01, True), ("rail", 0.99, False), ("joint", 1.01, False)],
)
def test_another_law_of_a_friction_that_was_found_must_come_much_closer(place: str, factor: float, allowed: bool) -> None:
    floors, now = np.full((2, 1), 1e-3), 0.03
    score = SimpleNamespace(error=np.full((2, 1), now / (factor * POLICY.form_close)))
    entry = cast(Entry, SimpleNamespace(place=("friction_shape", place), score=score))
    before = SimpleNamespace(error=np.full((2, 1), now))
    job = SimpleNamespace(left=0.1, helps=lambda entries: True, rubbing="rail", now=before, floors=floors)
    assert Screened(job=cast("Job", job), strict=True, kinds=UNSEEN).allows(entry) == allowed


@pytest.mark.parametrize(
    ("removed", "left", "explains"), [(0.801, 1.0, True), (0.799, 1.0, False), (0.9, 0.5, False), (1.0, 0.5, True)]
)
def test_a_form_explains_by_eight_tenths_of_the_whole_error_or_all_of_the_rest(
    removed: float, left: float, explains: bool
) -> None:
    def scored(share: float) -> Score:
        return Score(error=np.full((2, 2), np.hypot(0.1 * np.sqrt(share), 0.004)), blocks=np.ones(1), power=np.ones(1))

    job = SimpleNamespace(left=left, now=scored(1.0), floors=np.full((2, 2), 0.004))
    job.removes_most = partial(Job.removes_most, cast(Job, job))
    entry = cast(Entry, SimpleNamespace(score=scored(1.0 - removed)))
    assert Job.explains(cast(Job, job), entry) == explains
    assert job.removes_most(entry) == (removed > 0.8)


def test_what_the_equations_show_and_no_simulation_confirms_is_a_sentence() -> None:
    clear = blaming(("sensor", "motor", SHOWN + 0.1))
    assert (
        clear.clearly
        == "force over deflection (motor) reduces the largest residual, that of table, from 20 to 2 times the noise."
    )
    assert clear.clear == ("sensor", "motor")
    best = replace(clear.chosen[0], residuals={"lock": 1.5, "table": 19.0})
    partly = replace(
        clear, chosen=(best,), ranking=replace(clear.ranking, residuals={"lock": 15.0, "table": 20.0}, explanations=(best,))
    )
    assert partly.clearly == "force over deflection (motor) reduces the residual of lock, from 15 to 1.5 times the noise."
    assert blaming(("sensor", "motor", SHOWN - 1e-9), after=19.0).clearly == ""
    assert blaming(("sensor", "motor", SHOWN - 1e-9), after=19.0).clear is None
    assert blaming(("sensor", "motor", 0.6), ("memory", "rail", 0.5)).clearly == ""
    assert blaming(("sensor", "motor", 0.6), worst=BROKEN - 1e-9).clearly == ""


@pytest.mark.parametrize(("worst", "left", "suspected"), [
    (BROKEN, 0.6, False), (BROKEN - 1e-9, 0.63, False), (BROKEN - 1e-9, 0.62, True), (10.0 * BROKEN, 0.6, False),
    (10.0 * BROKEN, 0.1, True),
])  # fmt: skip
def test_a_further_cause_repairs_a_broken_equation(
    worst: float, left: float, suspected: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    ranked = blaming(("sensor", "motor", 0.6), ("memory", "rail", 0.6), worst=worst, after=left * worst).ranking
    found = further(ranked, monkeypatch)
    assert (found is not None and not found.tentative) == suspected


@pytest.mark.parametrize(("worst", "score", "kinds", "tried"), [
    (BROKEN, LEAST_SCORE, ("sensor", "memory", "lock"), ["sensor", "lock"]), (BROKEN, 0.99 * LEAST_SCORE, ("sensor",), []),
    (0.99 * BROKEN, LEAST_SCORE, ("sensor",), []), (BROKEN, LEAST_SCORE, 5 * ("sensor",), 3 * ["sensor"]),
])  # fmt: skip
def test_one_that_repairs_no_equation_is_tried_with_the_causes_so_far(
    worst: float, score: float, kinds: tuple[str, ...], tried: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    explanations = tuple(
        Explanation(kind=kind, place=f"p{k}", what="slip", score=score, residuals={"table": 0.9 * worst}, values={})
        for k, kind in enumerate(kinds)
    )
    found = further(Ranking(residuals={"table": worst}, explanations=explanations), monkeypatch)
    assert [item.kind for item in found.chosen if found.tentative] == tried if found is not None else not tried
    if found is not None:
        assert not found.shown("sensor", "p0")


def further(ranked: Ranking, monkeypatch: pytest.MonkeyPatch) -> Suspects | None:
    """The suspects of a further cause by this ranking."""
    monkeypatch.setattr("isorig.analysis.diagnose.suspects.ranking", lambda _: ranked)
    return suspects(cast(Equations, SimpleNamespace(residuals=lambda: ranked.residuals, elements=tuple)), further=True)


@pytest.mark.parametrize(("own", "other", "kind", "suspected"), [
    (1.01 * OWN, 0.0, "memory", True), (0.99 * OWN, 0.0, "memory", False), (0.4, 0.99 * REPAIRED * 0.4, "memory", True),
    (0.4, 1.01 * REPAIRED * 0.4, "memory", False), (0.4, 0.39, "damping_shape", True),
])  # fmt: skip
def test_a_further_cause_of_a_soiled_rig_removes_much_that_no_other_one_removes(
    own: float, other: float, kind: str, suspected: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Disturbances keep the equation broken; friction and damping over velocity count as one kind."""
    before = 10.0
    explanations = tuple(
        Explanation(
            kind=each,
            place="rail",
            what="slip",
            score=0.1 + share,
            residuals={"table": before - share * (before - 1.0)},
            values={},
        )
        for each, share in (("friction_shape", own), (kind, other))
    )
    found = further(Ranking(residuals={"table": before}, explanations=explanations), monkeypatch)
    assert (found is not None and not found.tentative) == suspected


@pytest.mark.study
def test_several_sliders_are_memory_and_no_spring_is_named_for_them() -> None:
    truth = stage()
    for give in (0.1, 0.2, 0.3, 0.4):
        truth = with_law(truth, "rail", laws.ElastoSlip(spring_stiffness=700.0, slip_force=14.0 * give))
    found = diagnose(played(truth, seed=4200), guessed(stage(), 4200))
    assert [(step.kind, step.location) for step in found.steps] == [("memory", "rail")]
    assert found.verdict == "explained"


def test_the_best_explanation_of_a_place_gives_its_motion() -> None:
    """A weaker explanation there fits another slow part of the deflection, which would bound a stop's stroke wrongly."""
    found = blaming(("spring_shape", "l0", 1.4), ("memory", "l0", 0.2))

    def force(deflection: float) -> ElementForce:
        d = deflection * np.linspace(-1.0, 1.0, 5)
        return ElementForce(deflection=d, velocity=d, time=d, force=d, left=d, motions=(), rate=1.0)

    found = replace(found, places={"l0": frozenset({"l0"})})
    found._values.update({item: ({}, force(d)) for item, d in zip(found.chosen, (0.03, 0.01), strict=True)})
    campaign, guess = played(stage(), seed=7), guessed(stage(), 7)
    seen = observe(campaign, guess, prepare(campaign, guess), guess, guess)
    assert found.located(seen).deflection["l0"] == 0.03


@pytest.mark.parametrize(
    ("share", "worst", "score", "said"),
    [
        (CONTRIBUTES + 1e-9, 21.0, SHOWN - 1e-9, "the largest contributions: force over deflection (motor) 10 %."),
        (CONTRIBUTES - 1e-9, 21.0, SHOWN - 1e-9, ""),
        (CONTRIBUTES + 1e-9, BROKEN - 1e-9, SHOWN - 1e-9, ""),
        (CONTRIBUTES + 1e-9, 21.0, SHOWN, ""),
    ],
)
def test_the_largest_contributions_are_told_where_no_cause_stands_out(
    share: float, worst: float, score: float, said: str
) -> None:
    found = blaming(("sensor", "motor", score), worst=worst, after=1.0 + (1.0 - share) * (worst - 1.0))
    assert found.spread.endswith(said)
    assert bool(found.spread) == bool(said)


def test_a_second_cause_at_the_same_place_is_of_a_kind_that_the_equations_distinguish() -> None:
    found = replace(blaming(("spring_shape", "rail", 0.7)), places={"rail": frozenset({"rail", "bearing"})})
    assert found.alike(("quadratic_damping", "rail"), ("coulomb_friction", "rail"))
    assert not found.alike(("quadratic_damping", "rail"), ("coulomb_friction", "belt"))
    assert not found.alike(("hardening_stiffness", "rail"), ("coulomb_friction", "rail"))


@pytest.mark.parametrize(
    ("curved", "hidden", "elsewhere", "goes_on"),
    [
        (("memory", "rail"), False, False, False),
        (None, False, False, True),
        (("memory", "rail"), True, False, True),
        (("memory", "rail"), False, True, True),
    ],
)
def test_what_a_free_shape_leaves_at_its_place_is_not_searched_for_again(
    curved: tuple[Kind, str] | None, hidden: bool, elsewhere: bool, goes_on: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second force with a memory beside the free shape of one, unless the equations rest on estimates or show another place."""
    found = blaming(("memory", "rail", 0.5), *([("memory", "belt", 0.4)] if elsewhere else []))
    monkeypatch.setattr(search, "compared_places", lambda model, trials, starts: POSSIBLE)
    monkeypatch.setattr(search, "equations_at", lambda located, campaign, trials: None)
    monkeypatch.setattr(search, "suspects", lambda equations: None)
    job = SimpleNamespace(
        progress=lambda text: None, left=0.2, curved=curved, campaign=None, guess=None, suspects=found, by_estimates=found,
        judged_by_drive=False, trials=(),
        current=SimpleNamespace(model=stage()), equations=SimpleNamespace(hidden=hidden),
    )  # fmt: skip
    assert (next(search.sources(cast(Job, job)), None) is not None) == goes_on


@pytest.mark.parametrize(
    ("exact", "place", "after", "leads"),
    [
        (True, "rail", REPAIRED * 20.0, True),
        (True, "rail", 1.01 * REPAIRED * 20.0, False),
        (False, "rail", 1.0, False),
        (True, "belt", 1.0, False),
    ],
)
def test_a_measured_equation_leads_in_a_partly_measured_rig(
    exact: bool, place: str, after: float, leads: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If it is repaired at a place from which the misfit of all records can come."""
    found = blaming(("spring_shape", place, 0.5), after=after, exact=exact)
    monkeypatch.setattr(search, "compared_places", lambda model, trials, starts: POSSIBLE)
    monkeypatch.setattr(search, "equations_at", lambda located, campaign, trials: None)
    monkeypatch.setattr(search, "suspects", lambda equations: None)
    job = SimpleNamespace(
        progress=lambda text: None, left=1.0, curved=None, campaign=None, guess=None, suspects=found, by_estimates=found,
        judged_by_drive=False, trials=(),
        current=SimpleNamespace(model=stage()), equations=SimpleNamespace(hidden=True),
    )  # fmt: skip
    first = next(search.sources(cast(Job, job)))
    assert isinstance(first, search.Suspected if leads else search.InTransferFunctions)


@pytest.mark.parametrize(
    ("hidden", "measured", "ranked"), [(True, 0.99 * BROKEN, False), (True, BROKEN, True), (False, 0.99 * BROKEN, True)]
)
def test_estimated_motions_alone_are_no_reason_to_rank_every_cause(hidden: bool, measured: float, ranked: bool) -> None:
    """With the places of a partly measured rig this took most of the time of a diagnosis."""
    equations = SimpleNamespace(
        hidden=hidden, residuals=lambda: {"all": measured, "last": 30.0 if hidden else 1.0}, with_estimates={"last"}
    )
    job = SimpleNamespace(equations=equations, by_estimates=blaming(("memory", "rail", 0.5)))
    assert (search.Job.suspects.func(cast(Job, job)) is not None) == ranked


def test_a_free_shape_does_not_cover_another_kind_at_its_place() -> None:
    assert blaming(("memory", "rail", 0.5)).only("memory", "rail")
    assert not blaming(("memory", "rail", 0.5), ("spring_shape", "rail", 0.4)).only("memory", "rail")


@pytest.mark.parametrize(("what", "alike"), [("dry friction", True), (OVER_POSITION, False)])
def test_a_friction_that_depends_on_the_position_is_no_damping(what: str, alike: bool) -> None:
    found = blaming(("friction_shape", "rail", 0.7))
    chosen = tuple(replace(item, what=what) for item in found.chosen)
    found = replace(found, chosen=chosen, ranking=replace(found.ranking, explanations=chosen))
    assert found.includes("asymmetric_friction", "rail")
    assert found.includes("quadratic_damping", "rail") == alike


def test_a_form_at_a_place_with_an_unknown_force_starts_from_its_own_values_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """The estimated force biases its values; the rest of the rig keeps those with which the force was estimated."""
    begun: list[RigModel] = []

    def verified(starts: Starts, rung: object, progress: object, **how: object) -> list[tuple[Candidate, object]]:
        begun.append(starts[0][2])
        return [(starts[0][0], SimpleNamespace(cost=10.0 - len(begun), converged=True))]

    monkeypatch.setattr(search, "verified", verified)
    start, stiffness, mass = stage(), "links.rail.stiffness", "bodies.table.mass"
    known = start.replace({stiffness: 1.5 * start.get(stiffness), mass: 3.0 * start.get(mass)})
    free = (Free(path=stiffness, low=1.0, high=1e9), Free(path=mass, low=1e-3, high=1e9))
    candidate = cast(Candidate, SimpleNamespace(cause="end_stop", starts=(start,), free=(), shape=None))
    job = SimpleNamespace(
        left=1.0, rungs=[None], unseen=None, progress=lambda text: None, with_values_before_fit=list, keeps_the_motion=False
    )
    for only, costs in ((None, [9.0]), (CausePlace("body", "table"), [8.0, 9.0])):
        begun.clear()
        found = SimpleNamespace(tentative=False, shows=True, equations=SimpleNamespace(only=only, model=known))
        run = search.Suspected(job=cast(Job, job), found=cast(Suspects, found))._fitted([(candidate, free, known)])
        assert [done.cost for _, done in run] == costs
    assert begun[1].get(stiffness) == known.get(stiffness)
    assert begun[1].get(mass) == start.get(mass)


@pytest.mark.parametrize(("cause", "added"), [("channel_delay", True), ("end_stop", False)])
def test_a_fault_of_a_channel_starts_from_the_fitted_model_too(cause: str, added: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """It bends the equations, and a fit without it follows the records closely."""
    begun: list[RigModel] = []

    def verified(starts: Starts, rung: object, progress: object, **how: object) -> list[tuple[Candidate, object]]:
        begun.extend(model for _, _, model in starts)
        return []

    monkeypatch.setattr(search, "verified", verified)
    start = stage()
    bent = start.replace({"links.rail.stiffness": 1.5 * start.get("links.rail.stiffness")})
    candidate = cast(Candidate, SimpleNamespace(cause=cause, starts=(start,), free=(), shape=None))
    job = SimpleNamespace(left=1.0, rungs=[None], unseen=None, progress=lambda text: None, with_values_before_fit=list)
    found = SimpleNamespace(tentative=False, shows=True, equations=SimpleNamespace(only=None))
    search.Suspected(job=cast(Job, job), found=cast(Suspects, found))._fitted([(candidate, (), bent)])
    assert begun == [bent, start][: 1 + added]


@pytest.mark.parametrize(("residual", "own", "holds"), [(1.29, 1, True), (1.31, 1, False), (1.29, 2, False)])
def test_a_level_of_dry_friction_stands_where_an_equation_holds_with_it(
    residual: float, own: int, holds: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    level = "contacts.rail.law.friction_force"
    monkeypatch.setattr(suspects_module, "solved_values", lambda equations, explanation: {level: 3.0})
    element = SimpleNamespace(name="rail", names=frozenset({"rail"}))
    fitted = (SimpleNamespace(residual=lambda fit: residual), None)
    equations = SimpleNamespace(balances=[SimpleNamespace(crossing=[(element, 1.0)])], in_time=lambda *_, sliding: fitted)
    explanation = Explanation(kind="friction_shape", place="rail", what="dry friction", score=1.0, residuals={}, values={})
    found = Suspects(
        ranking=Ranking(residuals={}, explanations=(explanation,)), chosen=(explanation,), places={},
        equations=cast(Equations, equations),
    )  # fmt: skip
    free = tuple(Free(path=path) for path in (level, "contacts.rail.law.bristle_stiffness")[:own])
    candidate = Candidate(cause="coulomb_friction", location="rail", family="friction", starts=(), free=free, reported=())
    assert found._is_level(candidate) == holds


@pytest.mark.parametrize(("worst", "shown"), [(2.0, True), (1.99, False)])
def test_equations_that_hold_show_nothing(worst: float, shown: bool) -> None:
    """However much of their noise an explanation removes."""
    found = blaming(("memory", "rail", 1.5), ("spring_shape", "belt", 0.1), worst=worst, after=1.0)
    assert found.shown("memory", "rail") is shown


@pytest.mark.parametrize(("allowed", "kept"), [(0.99, False), (1.01, True)])
def test_forms_are_not_compared_by_a_force_that_noise_may_leave(allowed: float, kept: bool) -> None:
    """Without a cause 1 N is left, a form of dry friction leaves 0.9 N, and the curve over the velocity 0.1 N."""
    found = blaming(("friction_shape", "rail", 0.5))
    (one,) = found.chosen
    still = np.zeros(3)
    force = ElementForce(
        deflection=still, velocity=still, time=still, force=still, left=still, motions=(), rate=1.0, allowed=allowed
    )  # fmt: skip
    found._values[one] = {}, force
    model = stage()
    current = Fit(model=model, free=(), covariance=np.zeros((0, 0)), cost=1.0, evaluations=0)
    found._without[one, model.encoded] = 1.0
    friction = Candidate(cause="coulomb_friction", location="rail", family="friction", starts=(model,), free=(), reported=())
    key = *friction.key, (), friction.shape, model.encoded
    found._fits[key] = suspects_module._Begun(models=[(0.9, model)], explanation=one)
    assert found._comparable([friction], current, {one: 0.1}) == ([friction] if kept else [])
