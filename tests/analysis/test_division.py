"""Which runs are held out, and the grids of fits and of judging: numbers from the documentation of the division."""

from __future__ import annotations

from dataclasses import replace

import pytest

from isorig.analysis.fitting.division import beginnings, coarsened, ends, refined
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.trials import Trial
from isorig.rig.wire_bonder.description import wire_bonder
from isorig.rig.wire_bonder.session import SESSION, virtual_campaign


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    """Two runs of each configuration."""
    takes = [replace(take, seconds=8.0) for take in SESSION if take.id in ("u70a", "u7", "l70", "l7")]
    return list(prepare(virtual_campaign(wire_bonder(), takes, seed=3), wire_bonder()))


def held_out(trials: list[Trial]) -> tuple[set[str], set[str]]:
    """The runs that judge, and those that fits use."""
    division = beginnings(trials)
    return {trial.run.id for trial in division.judged}, {trial.run.id for trial in division.fits}


def test_the_second_strongest_run_of_each_configuration_is_held_out(trials: list[Trial]) -> None:
    assert held_out(trials) == ({"u7", "l7"}, {"u70a", "l70"})
    assert beginnings(trials).beginnings
    assert not ends(trials).beginnings


def test_the_last_two_fifths_of_every_run_are_held_out(trials: list[Trial]) -> None:
    assert ends(trials).how.startswith("the last 40 % of every run (")


def test_runs_that_no_fit_uses_or_that_come_to_rest_are_no_rivals(trials: list[Trial]) -> None:
    everything = {"u70a", "u7", "l70", "l7"}
    for changed in (replace(trials[0], fitted=0), replace(trials[0], motion=(0.0,))):
        judging, fitting = held_out([changed, *trials[1:]])
        rest = {trial.run.id for trial in trials[1:] if trial.run.configuration != changed.run.configuration}
        assert judging < rest
        assert fitting == everything - judging


def test_models_are_judged_at_eight_steps_and_compared_at_half_their_own(trials: list[Trial]) -> None:
    steps = [
        made.excitation.oversample
        for made in (refined(trials[0]), coarsened(trials[0].on_grid(8)), coarsened(trials[0].on_grid(1)))
    ]
    assert steps == [8, 4, 1]
