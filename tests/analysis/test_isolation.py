"""The isolation ratio and the heatblock's peaks against closed forms, with and without friction."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from scipy.stats import norm

from isorig.analysis.campaign import Campaign, ComplexArray, FloatArray
from isorig.analysis.errors import DataError
from isorig.analysis.isolation.ratio import (
    ABOVE,
    Isolated,
    IsolationRatio,
    Peaks,
    Piece,
    _step,
    friction_bound,
    isolated_share,
    isolation_frequency,
    isolation_ratio,
    stuck_share,
)
from isorig.analysis.model.linear import constraint_basis
from isorig.analysis.model.rig_model import Configuration, RigModel, matrices
from isorig.analysis.spectra.welch import Frf
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.four_set_ups import error_surface, evaluated_set_ups
from isorig.rig.wire_bonder.peak_offset import loaded_frequencies, peak_offset
from isorig.rig.wire_bonder.session import VirtualRun, virtual_campaign

WIDE = (0.5, 400.0)
TAKES = (
    VirtualRun(id="u70", configuration="unlocked", gain=70.0, seconds=120.0, start=0.0),
    VirtualRun(id="u7", configuration="unlocked", gain=7.0, seconds=120.0, start=130.0, band=WIDE),
    VirtualRun(id="l70", configuration="locked", gain=70.0, seconds=120.0, start=260.0),
    VirtualRun(id="l7", configuration="locked", gain=7.0, seconds=120.0, start=390.0, band=WIDE),
)
FREE = {**THESIS, "motor_damping": 0.2, "table_damping": 0.08}


@pytest.fixture(scope="module")
def smooth() -> tuple[RigModel, Campaign]:
    model = wire_bonder(FREE, friction=False)
    return model, virtual_campaign(model, TAKES, seed=1)


@pytest.fixture(scope="module")
def rubbing() -> tuple[RigModel, Campaign]:
    model = wire_bonder({**FREE, "friction_force": 6.0})
    return model, virtual_campaign(model, TAKES, seed=1)


def closed_form(model: RigModel, frequency: FloatArray) -> FloatArray:
    """|heatblock / head| unlocked over locked of the linear rig."""
    size = []
    for rigid in ((), ("isolation",)):
        basis = constraint_basis(model, [model.link(name) for name in rigid])
        m, c, k = (basis.T @ matrix @ basis for matrix in matrices(model))
        push = basis.T @ np.array([0.0, 0.0, -model.drive.factor])
        s = 2j * np.pi * frequency[:, None, None]
        motion = np.linalg.solve(s**2 * m + s * c + k, np.broadcast_to(push, (len(frequency), len(push)))[..., None])
        size.append(np.abs((s[:, 0] ** 2) * (motion[..., 0] @ basis[1])[:, None])[:, 0])
    return np.asarray(size[0] / size[1])


def test_without_friction_the_ratio_is_the_closed_form(smooth: tuple[RigModel, Campaign]) -> None:
    model, campaign = smooth
    found = isolation_ratio(campaign, resolution=0.25)
    want = closed_form(model, found.frequency)
    kept = (found.frequency > 2.0) & (found.frequency < 300.0) & (np.abs(found.frequency - 165.0) > 8.0)
    off = (found.ratio - want)[kept] / found.std[kept]
    assert np.median(np.abs(found.ratio / want - 1.0)[kept & (found.gain == 70.0)]) < 0.01
    # The median of a normal variable's size is 0.67 of its deviation.
    assert 0.55 < np.median(np.abs(off)) < 0.8
    (step, std) = found.steps[0]
    assert abs(step - 1.0) < 0.02
    assert std < 0.02


def hann_segments(rng: np.random.Generator, segments: int, bins: int) -> ComplexArray:
    """Spectra of white noise of power 1 through a Hann window: weights -1/4, 1/2, -1/4 over the bins (Harris 1978)."""
    noise = (rng.normal(size=(segments, bins + 2)) + 1j * rng.normal(size=(segments, bins + 2))) / np.sqrt(2.0)
    return np.asarray((0.5 * noise[:, 1:-1] - 0.25 * (noise[:, :-2] + noise[:, 2:])) / np.sqrt(0.375))


def estimated(rng: np.random.Generator, size: float, error: float, bins: int = 400, segments: int = 40) -> Frf:
    """H1 estimate of a flat transfer function from segments with noise in the response."""
    x, noise = hann_segments(rng, segments, bins), size * error * hann_segments(rng, segments, bins)
    power = (np.abs(x) ** 2).sum(axis=0)
    value = (np.conj(x) * (size * x + noise)).sum(axis=0) / power
    std = np.full(bins, size * error / np.sqrt(2.0 * segments))
    return Frf(
        response="heatblock", reference="head", frequency=10.0 + 0.25 * np.arange(bins), value=value, magnitude_std=std,
        phase_std=std / size, coherence=np.ones(bins), averages=float(segments), resolution=0.25, estimator="H1",
    )  # fmt: skip


def at_one_gain(unlocked: Frf, locked: Frf, band: tuple[float, float]) -> IsolationRatio:
    """The ratio of two transfer functions, measured at one gain."""
    ratio = np.abs(unlocked.value) / np.abs(locked.value)
    piece = Piece(gain=70.0, band=band, unlocked=unlocked, locked=locked, ratio=ratio, std=0.05 * ratio)
    return IsolationRatio(
        frequency=unlocked.frequency, ratio=ratio, std=0.05 * ratio, gain=np.full(len(ratio), 70.0), pieces=(piece,), stitches=(),
        steps=(), peaks=Peaks(*[np.nan] * 5),
    )  # fmt: skip


def test_the_uncertainty_of_the_isolation_is_its_scatter_over_repeated_estimates() -> None:
    rng = np.random.default_rng(5)
    found = []
    for _ in range(300):
        stitched = at_one_gain(estimated(rng, 0.2, 0.3), estimated(rng, 1.0, 0.3), (10.0, 200.0))
        found.append(isolated_share(stitched, above=10.0))
    assert np.mean([each.share for each in found]) == pytest.approx(0.8, abs=0.001)
    assert np.mean([each.std for each in found]) == pytest.approx(np.std([each.share for each in found]), rel=0.15)


def test_the_isolation_needs_two_frequency_bins() -> None:
    rng = np.random.default_rng(6)
    both = estimated(rng, 0.2, 0.3), estimated(rng, 1.0, 0.3)
    assert isolated_share(at_one_gain(*both, (10.0, 10.25)), above=10.0).band == (10.0, 10.25)
    with pytest.raises(DataError, match="extend its band"):
        isolated_share(at_one_gain(*both, (10.0, 10.2)), above=10.0)


def test_the_interval_of_the_isolation_is_that_of_a_normal_variable() -> None:
    low, high = Isolated(share=0.8, std=0.01, band=(10.0, 20.0), gain=70.0).interval
    assert (low, high) == pytest.approx(norm.interval(0.95, 0.8, 0.01), abs=1e-6)


def test_the_isolation_is_effective_where_the_transmissibility_is_one() -> None:
    assert 1.0 / abs(1.0 - ABOVE**2) == pytest.approx(1.0)
    # Free and undamped, the motor on its spring alone vibrates at this frequency.
    model = wire_bonder(FREE, friction=False)
    link = model.link("isolation")
    assert (2.0 * np.pi * isolation_frequency(model)) ** 2 * model.body(link.a).mass == pytest.approx(link.stiffness)
    for setups in ({"normal": Configuration()}, {"locked": Configuration()}):
        assert isolation_frequency(msgspec.structs.replace(model, configurations=setups)) == 0.0


def test_the_stitch_is_where_it_is_asked(rubbing: tuple[RigModel, Campaign]) -> None:
    _, campaign = rubbing
    found = isolation_ratio(campaign, stitch=12.0)
    assert found.stitches == (12.0,)
    assert set(found.gain[found.frequency <= 12.0]) == {70.0}
    assert set(found.gain[found.frequency > 12.0]) == {7.0}
    # A quarter of the stitching frequency on both sides counts, each bin by its inverse variance.
    near = np.abs(found.pieces[0].unlocked.frequency - 12.0) <= 3.0
    high, low = (piece.ratio[near] for piece in found.pieces)
    variance = sum((piece.std[near] / piece.ratio[near]) ** 2 for piece in found.pieces)
    step, std = found.steps[0]
    assert std < 0.1 * step
    assert step == pytest.approx(np.exp((np.log(high / low) / variance).sum() / (1.0 / variance).sum()))
    assert std == pytest.approx(step / np.sqrt((1.0 / variance).sum()))
    # Friction holds the motor at gain 7, so the two gains do not meet.
    assert abs(step - 1.0) > 5.0 * std
    assert (high / low).min() < step < (high / low).max()


def test_lines_that_friction_holds_are_marked(rubbing: tuple[RigModel, Campaign]) -> None:
    model, campaign = rubbing
    found = isolation_ratio(campaign)
    shares = {run.gain: stuck_share(model, run) for run in campaign.select(configuration="unlocked")}
    assert shares[7.0] > 0.9
    assert shares[70.0] < 0.3
    marked = friction_bound(found, shares)
    np.testing.assert_array_equal(marked, found.gain == 7.0)
    assert np.median(np.abs(found.ratio[marked & (found.frequency < 100.0)] - 1.0)) < 0.02


def test_peaks_at_their_own_places(smooth: tuple[RigModel, Campaign]) -> None:
    model, campaign = smooth
    peaks = isolation_ratio(campaign, resolution=0.25).peaks
    locked, rise = loaded_frequencies(model, "heatblock")
    assert peaks.locked == pytest.approx(locked, abs=0.5)
    assert peaks.unlocked == pytest.approx(locked + rise, abs=0.5)
    # On the falling slope of the locked peak the ratio line by line is more than that of the peaks.
    assert peaks.by_line > peaks.ratio + 3.0 * peaks.std


def test_a_gain_that_was_not_measured_both_ways_is_refused(smooth: tuple[RigModel, Campaign]) -> None:
    _, campaign = smooth
    with pytest.raises(DataError, match="measure the missing one"):
        isolation_ratio(Campaign(runs=campaign.runs[:2], source="half.h5"))


def test_a_gain_counts_where_all_its_runs_were_driven(smooth: tuple[RigModel, Campaign]) -> None:
    _, campaign = smooth
    unlocked, locked = campaign.runs[1], campaign.runs[3]
    found = isolation_ratio(Campaign(runs=(replace(unlocked, band=(2.0, 300.0)), replace(locked, band=(1.0, 250.0)))))
    assert found.stitches == ()
    assert (found.frequency[0], found.frequency[-1]) == (2.0, 250.0)
    # Without a stated band from one resolution to the usable frequency, which the recording format gives as 1/2.56 of the rate.
    unstated = isolation_ratio(Campaign(runs=(replace(unlocked, band=None), replace(locked, band=None))), resolution=0.5)
    assert unstated.frequency[0] == 0.5
    assert unstated.frequency[-1] == pytest.approx(unlocked.sample_rate / 2.56, abs=0.5)


def test_peaks_need_three_frequency_bins(smooth: tuple[RigModel, Campaign]) -> None:
    _, campaign = smooth
    three, two = (isolation_ratio(campaign, around_peak=(164.0, top)).peaks for top in (164.5, 164.4))
    assert 164.0 <= three.unlocked <= 164.5
    assert np.isnan(two).all()


def test_a_step_between_gains_needs_two_frequency_bins() -> None:
    """At 18 Hz, from bins 0.25 Hz apart: one gain is used from 15 Hz on, the other one up to this frequency."""
    rng = np.random.default_rng(7)
    both = estimated(rng, 0.2, 0.3), estimated(rng, 1.0, 0.3)
    (low,) = at_one_gain(*both, (15.0, 200.0)).pieces
    for top, bins in ((15.0, 1), (15.25, 2)):
        (high,) = at_one_gain(*both, (10.0, top)).pieces
        # The ratios of one estimate are equal, and each has a relative standard uncertainty of 5 % at either gain.
        expected = (1.0, np.hypot(0.05, 0.05) / np.sqrt(2.0)) if bins == 2 else (np.nan, np.nan)
        assert _step(high, low, 18.0) == pytest.approx(expected, nan_ok=True)


def test_the_thesis_stitches_at_15_hz(smooth: tuple[RigModel, Campaign]) -> None:
    assert isolation_ratio(smooth[1]).stitches == (15.0,)


def test_without_friction_the_offset_is_mass_loading(smooth: tuple[RigModel, Campaign]) -> None:
    model, campaign = smooth
    found = peak_offset(campaign, model)
    # The modal masses in closed form: the table's share of the motion grows by what rides on it.
    assert found.mass_loading == pytest.approx(1.0, abs=0.3)
    (pair,) = found.pairs
    assert abs(pair.offset - found.mass_loading) < 4.0 * pair.std
    assert pair.std < 0.05
    assert "agrees with mass loading alone" in found.verdict
    assert "no nonlinearity is needed" in found.verdict
    assert "only one gain" in found.verdict


def test_a_held_motor_rides_along(rubbing: tuple[RigModel, Campaign]) -> None:
    model, campaign = rubbing
    found = peak_offset(campaign, model)
    (pair,) = found.pairs
    assert abs(pair.offset) < 0.1 * found.mass_loading
    assert "a nonlinearity and not an effect of mass" in found.verdict


def test_an_offset_that_goes_with_the_gain_supports_both() -> None:
    # Weak friction: a hard drive overcomes it, a soft one does not.
    model = wire_bonder({**FREE, "friction_force": 1.0})
    takes = [
        VirtualRun(id=f"{c}{gain:g}", configuration=c, gain=gain, seconds=90.0, start=100.0 * k, band=(50.0, 400.0))
        for k, (c, gain) in enumerate((c, g) for g in (70.0, 0.7) for c in ("unlocked", "locked"))
    ]
    found = peak_offset(virtual_campaign(model, takes, seed=3, noise=1e-5), model)
    assert [pair.gain for pair in found.pairs] == [70.0, 0.7]
    assert found.change[0] > 3.0 * found.change[1]
    assert found.slope > 3.0 * found.slope_std
    assert "the data support both" in found.verdict


def test_the_error_surface_finds_the_mass_without_friction(smooth: tuple[RigModel, Campaign]) -> None:
    model, campaign = smooth
    read = evaluated_set_ups(campaign, model)
    assert read.surface is not None
    mass, _, error = read.surface.best
    # The set-ups read peaks of the coupled rig, as the thesis does: so it is near, not exact.
    assert mass == pytest.approx(80.0, rel=0.15)
    assert error < 0.15
    assert read.surface.error.min() >= error * 0.999
    block = next(item for item in read.set_ups if item.name == "heatblock")
    assert block.mode is not None
    assert block.mode.frequency == pytest.approx(164.5, abs=4.0 * block.mode.frequency_std + 0.02)
    assert block.mode.damping == pytest.approx(0.009, rel=0.02)
    with pytest.raises(DataError, match="has no mode"):
        error_surface({}, model)
