"""Runs of several sample rates in one campaign: averages, faults and ratios as if they had one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import scipy.signal

from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.analysis.isolation.ratio import isolation_ratio
from isorig.analysis.spectra.quality import faults
from isorig.analysis.spectra.welch import estimate
from isorig.rig.wire_bonder.description import wire_bonder
from isorig.rig.wire_bonder.session import VirtualRun, virtual_campaign

TAKES = (
    VirtualRun(id="u70a", configuration="unlocked", gain=70.0, seconds=20.0, start=0.0),
    VirtualRun(id="u70b", configuration="unlocked", gain=70.0, seconds=20.0, start=40.0),
    VirtualRun(id="u70c", configuration="unlocked", gain=70.0, seconds=20.0, start=80.0),
    VirtualRun(id="l70", configuration="locked", gain=70.0, seconds=20.0, start=160.0),
)


def oscillator(rate: float, seed: int, seconds: float = 60.0) -> Run:
    """White noise through one mode (20 Hz, 5 %), made at eight times the rate and taken down."""
    fine = 8 * rate
    x = np.random.default_rng(seed).standard_normal(round(seconds * fine))
    s = scipy.signal.lti([(2 * np.pi * 20.0) ** 2], [1.0, 2 * 0.05 * 2 * np.pi * 20.0, (2 * np.pi * 20.0) ** 2])
    y = scipy.signal.lfilter(*scipy.signal.bilinear(s.num, s.den, fine), x)
    down = {name: scipy.signal.decimate(values, 8, ftype="fir") for name, values in (("x", x), ("y", y))}
    channels = {name: Channel(name=name, samples=values) for name, values in down.items()}
    return Run(id=f"r{rate:g}", configuration="unlocked", sample_rate=rate, gain=1.0, channels=channels, excitation="random")


def mixed(takes: Sequence[VirtualRun], slow: set[str], rate: float) -> Campaign:
    fast = virtual_campaign(wire_bonder(), [take for take in takes if take.id not in slow], seed=1)
    rest = virtual_campaign(wire_bonder(), [take for take in takes if take.id in slow], seed=2, sample_rate=rate)
    return replace(fast, runs=fast.runs + rest.runs)


@pytest.mark.parametrize("other", [512.0, 500.0, 1000.0])
def test_an_average_over_rates_is_the_mode(other: float) -> None:
    """Compared with the mode's closed form; at 500 and 1000 samples/s the lines of 0.3 Hz are not those of 512."""
    found = estimate([oscillator(512.0, 1), oscillator(other, 2)], references=["x"], resolution=0.3)
    alone = estimate([oscillator(512.0, 1)], references=["x"], resolution=0.3)
    assert found.frequency[-1] == pytest.approx(min(512.0, other) / 2.0, abs=0.3)
    assert found.segments == pytest.approx(2 * alone.segments, abs=2)
    s = 2j * np.pi * found.frequency
    w = 2 * np.pi * 20.0
    truth = w**2 / (s**2 + 2 * 0.05 * w * s + w**2)
    frf = found.frf("y", "x")
    inside = (found.frequency > 2.0) & (found.frequency < 60.0)
    assert np.abs(frf.value / truth - 1.0)[inside].max() < 0.05
    assert np.median(frf.coherence[inside]) > 0.99


def test_faults_of_rates_side_by_side() -> None:
    """Nothing is wrong with a sound session; in another an exchanged pair is found in a run of another rate."""
    session = mixed(TAKES, {"u70b", "l70"}, 2000.0)
    assert not faults(session, reference="head")
    b = next(run for run in session.runs if run.id == "u70b")
    turned = {**b.channels, "motor": b.channels["heatblock"], "heatblock": b.channels["motor"]}
    wrong = replace(session, runs=tuple(replace(r, channels=turned) if r is b else r for r in session.runs))
    assert {(fault.run, fault.kind) for fault in faults(wrong, reference="head")} == {("u70b", "swapped")}


def test_ratio_of_rates() -> None:
    """Unlocked at one rate, locked at another: the ratio lies within its error of that at one rate."""
    one, two = (isolation_ratio(mixed(TAKES, {"l70"}, rate)) for rate in (1024.0, 2000.0))
    kept = one.frequency > 6.0
    np.testing.assert_allclose(one.frequency, two.frequency)
    np.testing.assert_allclose(two.ratio[kept], one.ratio[kept], atol=float(4.0 * np.hypot(one.std, two.std)[kept].max()))
