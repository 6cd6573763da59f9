"""Whether an allowed run distinguishes two causes, compared with a full refit of every allowed candidate by another library."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.optimize import least_squares
from small_rivals import STIFFNESS, one_mass, prospect, variant

from isorig.analysis import laws
from isorig.analysis.campaign import FloatArray
from isorig.analysis.model.limits import Limits
from isorig.analysis.proposals.choice import Comparison, Question
from isorig.analysis.proposals.policy import POLICY
from isorig.analysis.proposals.prediction import Predicted, Prospect, Variant
from isorig.analysis.simulate import simulate

NOISE = {"body": 1e-3, "force": 1e-3}
STOP = variant(
    one_mass(link_laws=(laws.EndStop(stroke=0.004, contact_stiffness=0.5 * STIFFNESS),)), "end_stop",
    "links.spring.laws.0.contact_stiffness",
)  # fmt: skip
CUBIC = variant(
    one_mass(link_laws=(laws.Cubic(cubic_stiffness=0.3 * STIFFNESS / 0.01**2),)), "hardening_stiffness",
    "links.spring.laws.0.cubic_stiffness",
)  # fmt: skip


def record(model: Variant, run: Prospect, theta: FloatArray | None = None) -> FloatArray:
    rig = model.model
    if theta is not None:
        rig = rig.replace({f.path: rig.get(f.path) * float(np.exp(t)) for f, t in zip(model.free, theta, strict=True)})
    return np.asarray(simulate(rig, run.excitation()).channels["body"])


def refitted(truth: Variant, rival: Variant, in_hand: Prospect, run: Prospect) -> float:
    """How far the rival stays from the truth in a run after a full refit to it and the run in hand, in allowed errors."""
    allowed = [Predicted(one, NOISE, rival.model).allowed[0] for one in (in_hand, run)]
    # In the run in hand both were fitted to the same record.
    wanted = [record(rival, in_hand), record(truth, run)]

    def residual(theta: FloatArray) -> FloatArray:
        rows = [(record(rival, one, theta) - want) / a for one, want, a in zip((in_hand, run), wanted, allowed, strict=True)]
        return np.concatenate(rows)

    starts = [np.zeros(len(rival.free)), np.array([*np.zeros(len(rival.free) - 1), -1.0])]
    best = min((least_squares(residual, start, diff_step=1e-4, max_nfev=30) for start in starts), key=lambda fit: fit.cost)
    return float(np.sqrt(np.mean(residual(best.x)[len(wanted[0]) :] ** 2)))


@pytest.mark.parametrize(("stroke", "apart"), [(0.0008, False), (0.03, True)])
def test_an_inseparable_pair_is_inseparable_by_brute_force(stroke: float, apart: bool) -> None:
    in_hand = prospect(2.0, seed=9)
    question = Question(truths=(STOP, CUBIC), rivals=(STOP, CUBIC))
    comparison = Comparison(question, NOISE, [in_hand])
    runs = [prospect(rms, band, seed=k) for k, (rms, band) in enumerate(product((0.5, 3.0, 30.0), ((0.5, 20.0),)), 1)]
    seen = comparison.seen(runs, Limits(stroke={"spring": stroke}), lambda text: None)
    allowed = [one for one, _ in seen.pairs]
    assert allowed
    said = max(pair.distance for _, pairs in seen.pairs for pair in comparison.distances([pairs]))
    found = max(refitted(*pair, in_hand, one) for one in allowed for pair in ((STOP, CUBIC), (CUBIC, STOP)))
    if apart:
        assert said >= POLICY.distinguishable
        assert found >= POLICY.distinguishable
    else:
        assert len(allowed) < len(runs)
        assert said < POLICY.indistinguishable
        assert found < POLICY.indistinguishable
