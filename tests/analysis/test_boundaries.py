"""Thresholds of fits, equations and checks of data, each just below and just above its value, which is written here again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest
from small_rigs import rubbing, stage, with_law

from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.diagnose import search
from isorig.analysis.diagnose.search import Suspected
from isorig.analysis.equations.sliding import Sliding
from isorig.analysis.fitting import ladder, solve, uncertainty
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.held_out import decays, fit_samples
from isorig.analysis.fitting.solve import Fit, Free, fit
from isorig.analysis.laws import BoucWen, ElastoSlip
from isorig.analysis.model.rig_model import Contact
from isorig.analysis.spectra.noise import noise_level
from isorig.analysis.spectra.quality import faults


def blocks(*powers: tuple[int, float]) -> FloatArray:
    """A response of a hundred blocks of a hundred samples with these powers, given as (number of blocks, power), then rest."""
    power = np.concatenate([np.full(count, value) for count, value in powers])
    power = np.concatenate([power, np.zeros(100 - len(power))])
    return np.kron(np.sqrt(power), np.tile([1.0, -1.0], 50))[None]


@pytest.mark.parametrize(("power", "samples"), [(0.0099, 4500), (0.0101, 3600)])
def test_a_run_is_calm_between_two_moves_up_to_a_hundredth_of_the_largest_motion(power: float, samples: int) -> None:
    # Calm: the second move is held out. Otherwise it is one motion, divided by its duration of sixty blocks.
    assert fit_samples(blocks((40, 1.0), (5, power), (15, 1.0))) == samples


@pytest.mark.parametrize(("last", "alone"), [(14, True), (16, False)])
def test_a_run_decays_if_its_last_part_moves_less_than_half_of_its_share(last: int, alone: bool) -> None:
    """Of a hundred equal blocks 40 are the last part: a fifth of the motion is half of that."""
    assert decays(blocks((60, 1.0), (last, 1.0))) == alone
    assert not decays(blocks((40, 1.0), (5, 0.0), (15, 1.0)))
    assert not decays(np.zeros((1, 5000)))


@pytest.mark.parametrize(("power", "samples"), [(0.00101, 1800), (0.00099, 600)])
def test_a_motion_lasts_until_it_is_a_thousandth_of_the_largest(power: float, samples: int) -> None:
    assert fit_samples(blocks((10, 1.0), (20, power))) == samples


@pytest.mark.parametrize(("resting", "moved"), [(249, False), (251, True)])
def test_an_element_that_rests_for_a_quarter_of_the_time_is_moved(resting: int, moved: bool) -> None:
    run = SimpleNamespace(velocity=np.where(np.arange(1000) < resting, 0.0, 1.0))
    sliding = cast(Any, object.__new__(Sliding))
    sliding.runs, sliding.integrated, sliding.speed = (run,), False, 1.0
    assert sliding.rests is moved


@pytest.mark.parametrize(("share", "sound"), [(0.49, True), (0.51, False)])
def test_a_block_is_sound_of_which_a_shape_removes_half(share: float, sound: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    # Four blocks have the usual residual; one has a hundred times as much, which is this share of that without the shape.
    powers, before = (1.0, 1.0, 1.0, 1.0, 100.0), (1.0, 1.0, 1.0, 1.0, 100.0 / share)
    sliding = cast(Any, object.__new__(Sliding))
    sliding.integrated, sliding.drifts, sliding.noise, sliding.power, sliding.parts, sliding.runs = (
        False,
        False,
        1.0,
        0.0,
        0.0,
        (),
    )
    sliding.blocks = sliding.active = [
        SimpleNamespace(held_out=k == 0, base=base, power=power, spline=np.zeros(1))
        for k, (power, base) in enumerate(zip(powers, before, strict=True))
    ]

    def reduced(self: Sliding, block: SimpleNamespace, *_: object) -> SimpleNamespace:
        return SimpleNamespace(block=block, normal=np.eye(2), back=np.zeros((1, 2)), count=1, power=block.power)

    monkeypatch.setattr(Sliding, "_reduced", reduced)
    fitted = Sliding.fit(sliding, cast(Any, None), np.zeros(1), 1)
    assert (4 in fitted.sound) is sound


@pytest.mark.parametrize(("constant", "stuck"), [(15, False), (16, True)])
def test_a_channel_is_stuck_after_eight_times_its_usual_number_of_equal_samples(constant: int, stuck: bool) -> None:
    # Each sample comes twice.
    draw = np.random.default_rng(1)
    values = np.repeat(draw.normal(size=4096), 2)
    values[4000 : 4000 + constant] = 0.1
    run = Run(
        id="a", configuration="unlocked", sample_rate=1024.0, gain=1.0,
        channels={
            "head": Channel(name="head", samples=draw.normal(size=8192), quantity="acceleration", unit="m/s^2"),
            "table": Channel(name="table", samples=values, quantity="acceleration", unit="m/s^2"),
        },
    )  # fmt: skip
    found = faults(Campaign(runs=(run,)), reference="head")
    assert any(fault.kind == "stuck" and fault.channel == "table" for fault in found) is stuck


@pytest.mark.parametrize(("error", "steps"), [(0.0199, uncertainty.STEPS), (0.0201, 1)])
def test_a_fit_that_is_biased_by_two_percent_is_not_refined(error: float, steps: int, monkeypatch: pytest.MonkeyPatch) -> None:
    refined: list[int] = []

    def at_minimum(done: Fit, trials: object, steps: int) -> Fit:
        refined.append(steps)
        raise StopIteration

    monkeypatch.setattr(uncertainty, "score", lambda *_: SimpleNamespace(error=np.full((2, 3), error)))
    monkeypatch.setattr(uncertainty, "_noisy", lambda *_: False)
    monkeypatch.setattr(uncertainty, "at_minimum", at_minimum)
    done = Fit(model=stage(), free=(), covariance=np.zeros((0, 0)), cost=1.0, evaluations=1)
    with pytest.raises(StopIteration):
        uncertainty.assessed(done, (), {}, np.zeros((2, 3)))
    assert refined == [steps]


@pytest.mark.parametrize("fails", [False, True])
@pytest.mark.parametrize(("distance", "count"), [(0.95, 1), (1.05, 2)])
def test_coarse_derivatives_end_a_fit_where_a_step_no_longer_reduces_its_cost(
    distance: float, count: int, fails: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A line with derivatives that are 2 % larger in the coarse simulations: the second step reduces the cost of 25 by this share
    # of the tolerance, or is predicted to and fails; and only where it is larger are exact derivatives asked for.
    model, free = stage(), Free(path="drive.factor", low=-np.inf, log=False)
    end, tolerance = 3.0, 1e-6
    start = end + np.sqrt(distance * 25.0 * tolerance) / (1.0 - 1.0 / (1.02 * 1.001))
    seen, asked = list[float](), list[int]()

    class Line:
        size, sizes = 2, (2,)

        def about(self, _: object) -> Any:
            return self

        def parts_of_step(self, _: object) -> int:
            return 1

        def most_parts(self, _: object) -> int:
            return 1

        def residuals(self, models: list[Any]) -> FloatArray:
            asked.append(len(models))
            away = 1.0 if fails and len(asked) == 4 else 0.0
            return np.array([[free.encode(one.get(free.path)) - end + away, 5.0] for one in models])

    def derivatives(problem: object, build: object, theta: FloatArray, *_: object) -> FloatArray:
        seen.append(float(theta[0]))
        return np.array([[1.0 if problem is exact else 1.02], [0.0]])

    exact, coarse = cast(Any, Line()), cast(Any, Line())
    monkeypatch.setattr(solve, "jacobian_of", derivatives)
    fit(model.replace({free.path: free.decode(start)}), [free], exact, coarse=coarse, tolerance=tolerance)
    assert len(seen) == count


def suspected(found: Any = None, **job: Any) -> Suspected:
    return Suspected(
        job=cast(Any, SimpleNamespace(**{"progress": print, "rungs": [SimpleNamespace()], "current": None} | job)), found=found
    )


def with_cost(cost: float, cause: str = "end_stop") -> tuple[Candidate, Fit]:
    candidate = Candidate(cause=cause, location="l0", family=cause, starts=(), free=(), reported=())
    return candidate, Fit(model=stage(), free=(), covariance=np.zeros((0, 0)), cost=cost, evaluations=1)


@pytest.mark.parametrize(
    ("cost", "lengths", "bare", "lost"),
    [(24.9, 2, 100.0, False), (25.1, 2, 100.0, True), (25.1, 1, 100.0, False), (25.1, 2, 2505.0, True), (25.1, 2, 2515.0, False)],
)
def test_a_fit_that_errs_by_a_twentieth_of_the_signal_is_repeated_on_growing_lengths(
    cost: float, lengths: int, bare: float, lost: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    # An allowed error is a hundredth of the signal: a twentieth has a cost of 25. One length alone does not grow. A fit that
    # leaves less than a hundredth of the misfit follows the motion.
    begun, again = [with_cost(cost)], [with_cost(1.0)]
    monkeypatch.setattr(search, "verified", lambda *_, **__: begun)
    monkeypatch.setattr(search, "followed", lambda *_, **__: again)
    rungs = [SimpleNamespace()] * lengths
    fitted = cast(Any, SimpleNamespace(stays=lambda run: True, bare=bare))
    one = suspected(
        SimpleNamespace(shows=0, equations=SimpleNamespace(only=None)), left=1.0, follows=partial(search.Job.follows, fitted),
        promising=0.5, rungs=rungs, unseen=None, stays=lambda run: True, with_values_before_fit=list, keeps_the_motion=False,
    )  # fmt: skip
    assert one._fitted([]) == (again if lost else begun)


@pytest.mark.parametrize(("cost", "lost"), [(2999.0, False), (3001.0, True)])
def test_a_kept_motion_is_lost_only_by_fits_that_leave_more(cost: float, lost: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every candidate contains the current model, which leaves 3000 here."""
    one, other = with_cost(2000.0), with_cost(cost, "backlash")
    repeated: list[str] = []

    def followed(starts: Sequence[Any], *_: object) -> list[tuple[Candidate, Fit]]:
        repeated.extend(start[0].cause for start in starts)
        return [with_cost(1000.0, "backlash")]

    monkeypatch.setattr(search, "verified", lambda *_, **__: [one, other])
    monkeypatch.setattr(search, "followed", followed)
    found = suspected(
        SimpleNamespace(shows=0, equations=SimpleNamespace(only=None)), left=1.0, follows=lambda run: False, bare=3000.0,
        promising=0.5, rungs=[SimpleNamespace()] * 2, unseen=None, current=None, progress=None, keeps_the_motion=True,
        with_values_before_fit=list,
    )._fitted([(one[0], (), stage()), (other[0], (), stage())])  # fmt: skip
    assert repeated == ["backlash"] * lost
    assert [done.cost for _, done in found] == ([1000.0, 2000.0] if lost else [2000.0, cost])


@pytest.mark.parametrize(
    ("converged", "cost", "after", "plausible", "result"),
    [
        (False, 1.01, 0.5, True, 0.5),
        (True, 1.01, 0.5, True, 1.01),
        (False, 0.99, 0.5, True, 0.99),  # agrees with the data
        (False, 5.0, 6.0, True, 5.0),
        (False, 5.0, 0.5, False, 5.0),
    ],
)
def test_a_fit_that_ended_by_its_steps_is_continued(
    converged: bool, cost: float, after: float, plausible: bool, result: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    candidate, done = with_cost(cost)
    steps: list[int] = []

    def tried(start: object, free: object, rung: ladder.Rung) -> Fit:
        steps.append(rung.steps)
        return replace(done, cost=after)

    monkeypatch.setattr(ladder, "tried", tried)
    rung = ladder.Rung(problem=cast(Any, None), steps=8, seconds=10.0)
    begun = [(replace(candidate, plausible=lambda model: plausible), replace(done, converged=converged))]
    assert [fit.cost for _, fit in ladder.continued(begun, rung)] == [result]
    assert steps in ([], [24])


@pytest.mark.parametrize(("figure", "hidden", "kept"), [(0.499, True, True), (0.501, True, False), (0.499, False, False)])
def test_a_partly_measured_rig_keeps_the_motion_up_to_half_the_signal(figure: float, hidden: bool, kept: bool) -> None:
    job = SimpleNamespace(equations=SimpleNamespace(hidden=hidden), now=SimpleNamespace(figure=figure))
    assert search.Job.keeps_the_motion.fget(cast(Any, job)) is kept  # type: ignore[attr-defined]


@pytest.mark.parametrize(("ratio", "kept"), [(1.49, True), (1.51, False)])
def test_a_form_replaces_the_curve_of_a_pair_up_to_one_and_a_half_times_its_error(
    ratio: float, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    form, (curve, fitted) = with_cost(4.0 * ratio**2), with_cost(4.0, "spring_shape")
    shape, other = replace(curve, shape=cast(Any, object())), replace(curve, cause="sensor_gain", starts=(stage(),))
    monkeypatch.setattr(Suspected, "_after", lambda *_, **__: ([(form[0], (), None)], None))
    monkeypatch.setattr(search, "verified", lambda *_, **__: [form])
    one = suspected(current=fitted)
    # Whichever of the two is the curve.
    for second, first in ((shape, other), (other, shape)):
        found = one._forms_for((second, fitted), (first, (), stage()))
        assert (found is not None) is kept
        assert found is None or (found[0], found[1][0]) == ([form], other)
    assert one._forms_for((other, fitted), (other, (), stage())) is None, "no curve"


def test_a_form_for_the_curve_of_a_pair_has_no_part_of_the_curve_and_leaves_the_other_cause(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The curve is a row of sliders in a link, the other cause dry friction beside it; hysteresis would replace that."""
    slid = with_law(stage(), "rail", ElastoSlip(slip_force=8.0, spring_stiffness=3e3))
    slips, dry, built = (
        Free(path=path)
        for path in (
            "links.rail.laws.0.slip_force", "contacts.rail.law.friction_force", "contacts.rail.law.initial_stiffness"
        )
    )  # fmt: skip
    both = Fit(model=rubbing(slid, "rail", 5.0), free=(slips, dry), covariance=np.eye(2), cost=4.0, evaluations=1)
    shape = Candidate(
        cause="memory", location="rail", family="", starts=(slid,), free=(slips,), reported=(), shape=cast(Any, object())
    )
    other = Candidate(cause="coulomb_friction", location="rail", family="", starts=(both.model,), free=(dry,), reported=())
    law = BoucWen(friction_force=5.0, initial_stiffness=7e3)
    bent = msgspec.structs.replace(stage(), contacts=(Contact(name="rail", a="table", law=law),))
    hysteresis = Candidate(cause="hysteresis", location="rail", family="", starts=(bent,), free=(dry, built), reported=())
    elsewhere = replace(hysteresis, free=(built,))
    alone = Fit(model=bent, free=(dry, built), covariance=np.eye(2), cost=1.0, evaluations=1)
    begun: list[Any] = []
    monkeypatch.setattr(Suspected, "_after", lambda self, start, **_: (begun.append(start) or [], None))
    monkeypatch.setattr(Suspected, "forms", [(hysteresis, alone), (elsewhere, alone)])
    monkeypatch.setattr(search, "verified", lambda starts, *_: [(start[0], alone) for start in starts])
    current = replace(alone, model=stage(), free=())
    found = suspected(current=current)._forms_for((other, both), (shape, (slips,), slid))
    assert found is not None
    assert [candidate for candidate, _ in found[0]] == [elsewhere]
    ((candidate, free, model),) = begun
    assert (candidate, free) == (other, (dry,))
    assert model.link("rail").laws == ()
    assert model.get(dry.path) == 5.0


def test_noise_is_the_level_of_the_calmest_quarter_of_the_time() -> None:
    # Events of a sample's length, which have power at all frequencies, reach all but this share of the record.
    for calm, low in ((0.3, True), (0.2, False)):
        draw = np.random.default_rng(2)
        values = draw.normal(0.0, np.where(np.arange(8192) < calm * 8192, 1.0, 100.0))
        channels = {"a": Channel(name="a", samples=values)}
        run = Run(id="r", configuration="unlocked", sample_rate=1024.0, gain=1.0, channels=channels)
        level = noise_level(run, "a")
        assert level is not None
        assert (level < 10.0) is low
