"""The look at a run right after it was taken, where the run is longer than what is held in memory of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from isorig.analysis.campaign import Channel, Run
from isorig.rig.acquire.recover import Recovered
from isorig.rig.acquire.run_check import PART, check_run
from isorig.rig.wire_bonder.description import wire_bonder


class Counted:
    """Samples that tell how many of them were asked for at once."""

    def __init__(self, values: NDArray[Any]) -> None:
        self._values, self.shape, self.longest = values, values.shape, 0

    def __getitem__(self, key: slice, /) -> NDArray[Any]:
        part = self._values[key]
        self.longest = max(self.longest, len(part))
        return part


def test_a_long_run_is_checked_in_parts() -> None:
    generator, n = np.random.default_rng(1), 2 * PART + 12345
    head = generator.normal(3.0, 1.0, n)
    # What each part differs by from the next counts, too.
    drift = np.repeat([0.0, 5.0, -2.0], PART)[:n]
    values = {"head": head, "motor": head + drift, "table": head + drift + generator.normal(0.0, 0.1, n)}
    values["heatblock"] = 1e-5 * head
    values["gain"] = np.where(np.arange(n) == PART + 7, 69.0, 70.0)
    values["motor"][[3, PART + 4, n - 1]] = 20.0
    samples = {name: Counted(each) for name, each in values.items()}
    run = Run(
        id="a", configuration="unlocked", sample_rate=51200.0, gain=70.0, excitation="random", band=(10.0, 5000.0),
        channels={
            name: Channel(name=name, samples=each, full_scale=20.0 if name == "motor" else None)
            if name != "gain"
            else Channel(name=name, samples=each, quantity="gain", unit="1")
            for name, each in samples.items()
        },
    )  # fmt: skip
    found = Recovered(
        id="a", finished=True, begun=True, run=run, stored=n, lost=0, planned=n, overloads=0, planned_gain=70.0, drift=None
    )
    verdict = check_run(found, rig=wire_bonder())
    assert verdict.sliding == pytest.approx((values["motor"] - values["table"]).std() / values["motor"].std(), rel=1e-9)
    told = " ".join(verdict.advice)
    assert "motor clipped 3 times" in told
    assert f"heatblock hardly moves ({values['heatblock'].std():.2g} m/s^2 rms)" in told
    assert "The gain changed from 69 to 70 during the run" in told
    assert max(each.longest for each in samples.values()) <= PART


@pytest.mark.parametrize(("share", "stuck"), [(0.19, True), (0.21, False)])
def test_friction_that_holds_a_body_is_reported(share: float, stuck: bool) -> None:
    """Relative motion below a fifth of the motor's own."""
    n = 4096
    head, apart = np.random.default_rng(2).normal(size=(2, n))
    motor = head / head.std()
    apart -= motor * (apart @ motor) / (motor @ motor)
    values = {"head": head, "motor": motor, "table": motor - share * apart / apart.std(), "heatblock": head}
    run = Run(
        id="a", configuration="unlocked", sample_rate=1024.0, gain=7.0, excitation="random", band=(1.0, 400.0),
        channels={name: Channel(name=name, samples=each) for name, each in values.items()},
    )  # fmt: skip
    found = Recovered(
        id="a", finished=True, begun=True, run=run, stored=n, lost=0, planned=n, overloads=0, planned_gain=7.0, drift=None
    )
    verdict = check_run(found, rig=wire_bonder())
    assert verdict.sliding == pytest.approx(share, rel=0.01)
    assert any("friction was not overcome" in line for line in verdict.advice) is stuck
