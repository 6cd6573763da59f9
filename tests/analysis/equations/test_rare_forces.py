"""What acts in a few moments only, and a drive that does not act at all."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace
from small_rigs import carts, played, with_law

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.analysis.diagnose.observe import observe
from isorig.analysis.diagnose.suspects import suspects
from isorig.analysis.equations.columns import RARE_STOP
from isorig.analysis.equations.ranking import ranking
from isorig.analysis.equations.system import equations_of
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.solve import Fit, base_parameters
from isorig.analysis.model.rig_model import Configuration
from isorig.analysis.simulate.sampling import Excitation
from isorig.analysis.simulate.simulation import simulate

SEED = 4200


def test_a_stop_that_is_reached_a_few_times_ranks_first_and_gives_its_values() -> None:
    sound = played(carts(), seed=SEED)
    largest = max(float(np.abs(run.channel("x0").read()).max()) for run in sound.runs)
    truth = with_law(carts(), "wall", laws.EndStop(stroke=0.9 * largest, contact_stiffness=4e3, contact_damping=1.0))
    campaign = played(truth, seed=SEED)
    touched = np.mean([np.mean(np.abs(run.channel("x0").read()) > 0.9 * largest) for run in campaign.runs])
    assert 0.0 < touched < 0.01
    equations = equations_of(campaign, carts())
    best = ranking(equations).explanations[0]
    assert (best.kind, best.place, best.what) == ("spring_shape", "wall", RARE_STOP.name)
    found = suspects(equations)
    assert found is not None
    assert found.rare
    # The fitted values of the rig stay as they are, and the stop begins at the recorded force.
    free = base_parameters(carts())
    fit = Fit(model=carts(), free=free, covariance=np.eye(len(free)), cost=1.0, evaluations=1)
    evidence = observe(campaign, carts(), prepare(campaign, carts()), carts(), carts())
    stop = next(c for c in found.candidates(fit, evidence) if c.cause == "end_stop")
    started = found.started(stop, free)[0]
    assert started.links[0].stiffness == carts().links[0].stiffness
    assert started.links[0].laws[0].stroke == pytest.approx(0.9 * largest, rel=0.1)


@pytest.mark.parametrize("pushed", [0.0, 1e-3])
def test_a_drive_at_rest_does_not_scale_the_masses(pushed: float) -> None:
    """Two carts are let go: an unknown mass that only a resting drive pushes would be solved by zero, with its forces."""
    start = Configuration(initial_position={"first": 0.02, "second": 0.03})
    rig = replace(carts(), configurations={"unlocked": start}, free=("bodies.second.mass", "links.between.stiffness"))
    rig = replace(rig, drive=replace(rig.drive, quantity="force", channel="push", pushes={"second": 1.0}))
    draw = np.random.default_rng(SEED)
    drive = pushed * draw.normal(0.0, 1.0, 4000)
    seen = simulate(rig, Excitation.prepare(np.zeros(4000), 200.0, oversample=4), as_recorded=True).channels
    records = {"push": drive, **{name: values + draw.normal(0.0, 1e-5, 4000) for name, values in seen.items() if name != "push"}}
    channels = {
        name: Channel(
            name=name, samples=values, quantity="force" if name == "push" else "displacement", unit="N" if name == "push" else "m"
        )
        for name, values in records.items()
    }
    run = Run(id="r", configuration="unlocked", sample_rate=200.0, gain=1.0, channels=channels, excitation="free")
    equations = equations_of(Campaign(runs=(run,), source="released"), rig)
    assert all(not balance.pushes for balance in equations.balances)
    own = next(balance for balance in equations.balances if balance.bodies == ("second",))
    assert equations.unknown_masses(own) == ()
