"""A low coherence is noise, a nonlinearity, or undecided; rigs simulated with scipy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from strange_rigs import StrangeRig, campaign, dry

from isorig.analysis.campaign import Run
from isorig.rig.acquire.policy import COHERENT
from isorig.rig.acquire.recover import Recovered
from isorig.rig.acquire.run_check import Verdict, check_run

RIG = StrangeRig(masses=(4.0,), joints=((0, -1, 4e3, 12.0),), sensors=(("x", 0, "displacement"),))
#: Friction that holds the mass most of the time, more at a low level.
RUBBING = replace(RIG, laws={0: dry(30.0, 2e-3)})


@pytest.fixture(scope="module")
def runs() -> tuple[Run, ...]:
    """Two levels of different drives."""
    return campaign(RUBBING, (20.0, 45.0), seconds=12.0, band=(1.0, 60.0), seed=3).runs


def noisier(run: Run, share: float, seed: int) -> Run:
    values = run.read("x")
    draw = np.random.default_rng(seed).normal(0.0, share * values.std(), len(values))
    return replace(run, channels={**run.channels, "x": replace(run.channels["x"], samples=values + draw)})


def checked(run: Run, others: Sequence[Run] = ()) -> Verdict:
    found = Recovered(
        id=run.id, finished=True, begun=True, run=run, stored=len(run), lost=0, planned=len(run), overloads=0,
        planned_gain=run.gain, drift=None,
    )  # fmt: skip
    verdict = check_run(found, rig=RIG.description(), others=others)
    assert verdict.coherence["x"] < COHERENT
    return verdict


def test_a_perfect_record_of_a_nonlinear_rig_is_kept(runs: tuple[Run, ...]) -> None:
    """A repeat of the drive, or another level, shows that the rig is nonlinear; nothing asks for a repetition."""
    repeat = noisier(replace(runs[0], id="again"), 0.002, 1)
    for others, said in (([repeat], "two runs with the same drive agree"), ([runs[1]], "changes with the drive's level")):
        verdict = checked(runs[0], others)
        (text,) = verdict.advice
        assert verdict.good
        assert said in text
        assert "the rig is nonlinear there, and the record is good" in text
        assert "repeat the run" not in text


def test_one_run_decides_nothing(runs: tuple[Run, ...]) -> None:
    verdict = checked(runs[0])
    assert verdict.good
    assert "a run with the same drive (repeat_of) decides it" in verdict.advice[0]


def test_noise_is_noise(runs: tuple[Run, ...]) -> None:
    """White noise of the sensor by the run itself; another source by a repeat that differs."""
    linear = campaign(RIG, (20.0,), seconds=20.0, band=(1.0, 60.0), seed=3).runs[0]
    verdict = checked(noisier(linear, 5.0, 1))
    assert not verdict.good
    assert "because of noise; drive harder" in verdict.advice[0]
    other = campaign(RIG, (40.0,), seconds=20.0, band=(1.0, 60.0), seed=9).runs[0].read("x")
    disturbed = []
    for k in range(2):
        channel = linear.channels["x"]
        shaken = replace(channel, samples=channel.read() + np.roll(other, 1500 * k))
        disturbed.append(replace(linear, id=f"d{k}", channels={**linear.channels, "x": shaken}))
    verdict = checked(disturbed[0], disturbed[1:])
    assert not verdict.good
    assert "look for another source of vibration" in verdict.advice[0]
