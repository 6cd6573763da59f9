"""Spectra against scipy.signal, error bars against the scatter of repeats, gaps, runs, periods."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from isorig.analysis.campaign import Channel, FloatArray, Gap, Run
from isorig.analysis.errors import DataError
from isorig.analysis.parallel import side_by_side
from isorig.analysis.spectra import welch
from isorig.analysis.spectra.periodic import periodic
from isorig.analysis.spectra.welch import SHARE, RunningSpectra, averages_in, estimate, merged

RATE = 512.0


def run_of(gaps: tuple[Gap, ...] = (), period: int | None = None, rate: float = RATE, **samples: FloatArray) -> Run:
    channels = {name: Channel(name=name, samples=values) for name, values in samples.items()}
    return Run(id="r", configuration="unlocked", sample_rate=rate, gain=1.0, channels=channels, gaps=gaps, period=period)


def pair(seed: int, n: int = 20000, noise: float = 0.3) -> tuple[FloatArray, FloatArray]:
    generator = np.random.default_rng(seed)
    x = generator.standard_normal(n)
    y = scipy.signal.lfilter([1.0], [1.0, -1.2, 0.5], x) + noise * generator.standard_normal(n)
    return x, np.asarray(y)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 1000), half=st.integers(16, 300), n=st.integers(1300, 9000), scale=st.floats(1e-3, 1e3),
    mean=st.floats(-5.0, 5.0),
)  # fmt: skip
def test_agrees_with_scipy(seed: int, half: int, n: int, scale: float, mean: float) -> None:
    x, y = pair(seed, n)
    x, y, length = scale * x + mean, y + mean, 2 * half
    found = estimate([run_of(x=x, y=y)], references=["x"], resolution=RATE / length)
    same = {"fs": RATE, "window": "hann", "nperseg": length, "noverlap": half, "detrend": "constant"}
    f, sxx = scipy.signal.welch(x, **same)
    _, syy = scipy.signal.welch(y, **same)
    _, sxy = scipy.signal.csd(x, y, **same)
    _, coherence = scipy.signal.coherence(x, y, **same)
    frf = found.frf("y", "x")
    inside = slice(2, -1)  # at zero the mean is gone, and with it all that could be compared
    np.testing.assert_allclose(found.frequency, f)
    np.testing.assert_allclose(found.density("x")[inside], sxx[inside], rtol=1e-12)
    np.testing.assert_allclose(found.density("y")[inside], syy[inside], rtol=1e-12)
    # A line without coherence is a difference of large numbers: its error is seen against what was added up.
    assert (np.abs(found.cross["x"][1] - sxy)[inside] <= 1e-12 * np.sqrt(sxx * syy)[inside]).all()
    assert (np.abs(frf.value - sxy / sxx)[inside] <= 2e-12 * np.sqrt(syy / sxx)[inside]).all()
    assert (np.abs(frf.coherence - coherence)[inside] <= 4e-12).all()


def test_spectra_without_groups_are_those_with_them() -> None:
    x, y = pair(3)
    grouped, whole = (estimate([run_of(x=x, y=y)], references=["x"], resolution=2.0, jackknife=kept) for kept in (True, False))
    assert grouped.groups is not None
    assert whole.groups is None
    np.testing.assert_allclose(whole.frf("y", "x").value, grouped.frf("y", "x").value, rtol=1e-12)
    np.testing.assert_allclose(whole.density("y"), grouped.density("y"), rtol=1e-12)


def test_estimators_lie_between_their_noises() -> None:
    x, y = pair(0)
    found = estimate([run_of(x=x, y=y)], references=["x"], resolution=4.0)
    h1, hv, h2 = (np.abs(found.frf("y", "x", name).value)[1:-1] for name in ("H1", "Hv", "H2"))
    assert (h1 <= hv * (1 + 1e-9)).all()
    assert (hv <= h2 * (1 + 1e-9)).all()
    np.testing.assert_allclose(h1, h2 * found.frf("y", "x").coherence[1:-1], rtol=1e-9)


def test_stated_deviations_are_the_scatter_of_repeats() -> None:
    frfs = [
        estimate([run_of(x=x, y=y)], references=["x"], resolution=8.0).frf("y", "x")
        for x, y in (pair(seed, 8192) for seed in range(300))
    ]
    inside = slice(2, -2)
    values = np.array([frf.value[inside] for frf in frfs])
    size = np.abs(values).std(axis=0) / np.sqrt(np.mean([frf.magnitude_std[inside] ** 2 for frf in frfs], axis=0))
    turn = np.angle(values / values.mean(axis=0)).std(axis=0) / np.sqrt(np.mean([f.phase_std[inside] ** 2 for f in frfs], axis=0))
    assert 0.95 < size.mean() < 1.05
    assert 0.95 < turn.mean() < 1.05


@pytest.mark.parametrize(("responses", "threads"), [(2 * SHARE - 1, []), (2 * SHARE, [2]), (4 * SHARE, [3])])
def test_many_responses_are_shared_by_threads(responses: int, threads: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    counted: list[int] = []

    def count(function: Callable[[object], None], shares: list[object]) -> None:
        counted.append(len(shares))
        side_by_side(function, shares)

    monkeypatch.setattr(welch, "cores", lambda: 3)
    monkeypatch.setattr(welch, "side_by_side", count)
    x, y = pair(2, 3000)
    names = [f"y{k}" for k in range(responses)]
    channels = {name: Channel(name=name, samples=np.roll(y, k)) for k, name in enumerate(names)}
    run = replace(run_of(x=x), channels={"x": Channel(name="x", samples=x), **channels})
    found = estimate([run], references=["x"], resolution=2.0, jackknife=False)
    assert counted == threads
    for k, name in enumerate(names):
        alone = estimate([run], references=["x"], channels=[name], resolution=2.0, jackknife=False)
        np.testing.assert_array_equal(found.auto[k + 1], alone.auto[1])
        np.testing.assert_array_equal(found.cross["x"][k + 1], alone.cross["x"][1])


def test_no_segment_reaches_across_a_gap() -> None:
    x, y = pair(3)
    whole = estimate([run_of(x=x[:8000], y=y[:8000]), run_of(x=x[8000:], y=y[8000:])], references=["x"], resolution=2.0)
    broken = estimate([run_of(x=x, y=y, gaps=(Gap(first_tick=8000, count=500),))], references=["x"], resolution=2.0)
    assert broken.segments == whole.segments
    np.testing.assert_array_equal(broken.auto, whole.auto)


def test_refusals_say_what_to_do() -> None:
    x, y = pair(0, 1000)
    with pytest.raises(DataError, match="coarser resolution"):
        estimate([run_of(x=x, y=y)], references=["x"], resolution=0.25)
    with pytest.raises(DataError, match="only x, y"):
        estimate([run_of(x=x, y=y)], references=["head"], resolution=8.0)
    with pytest.raises(DataError, match="no run"):
        estimate([], references=["x"])


class Streamed:
    """Samples that are made up as they are asked for, like a dataset too long for memory."""

    def __init__(self, n: int) -> None:
        self.shape = (n,)

    def __getitem__(self, key: slice) -> FloatArray:
        return np.sin(np.arange(key.start, min(key.stop, self.shape[0])) ** 1.5)


def test_memory_does_not_grow_with_the_record() -> None:
    def peak(n: int) -> int:
        channels = {name: Channel(name=name, samples=Streamed(n)) for name in "xy"}
        run = Run(id="r", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels)
        tracemalloc.start()
        estimate([run], references=["x"], resolution=0.25)
        top = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return top

    peak(40_000)
    assert peak(2_000_000) < 1.1 * peak(200_000) < 32e6


def test_periods_distinguish_noise_from_distortion() -> None:
    period, periods, noise, cubic = 1024, 12, 0.02, 0.02
    lines = np.arange(1, 200, 2)
    runs, clean = [], []
    for seed in range(8):
        generator = np.random.default_rng(seed)
        spectrum = np.zeros(period // 2 + 1, dtype=complex)
        spectrum[lines] = np.exp(2j * np.pi * generator.random(len(lines)))
        x = np.fft.irfft(spectrum, period)
        x = np.tile(x / x.std(), periods)
        y = scipy.signal.lfilter([1.0], [1.0, -0.5], x)
        clean.append(y)
        y = y + cubic * y**3 + noise * generator.standard_normal(len(y))
        runs.append(run_of(x=x, y=y, period=period))
    found = periodic(runs, response="y", reference="x")
    np.testing.assert_array_equal(found.frequency, lines * RATE / period)
    assert (found.periods, found.realizations) == (11, 8)
    # White noise of a variance s^2 over P periods of N samples: N s^2 / P a line of the mean.
    driven = np.mean(np.abs(np.fft.rfft(runs[0].read("x")[:period]))[lines])
    expected = noise * np.sqrt(period / found.periods) / driven
    assert np.median(found.noise) == pytest.approx(expected, rel=0.1)
    assert np.median(found.distortion) > 5.0 * np.median(found.noise)
    linear = periodic(
        [run_of(x=r.read("x"), y=c, period=period) for r, c in zip(runs, clean, strict=True)], response="y", reference="x"
    )
    assert np.median(linear.distortion) < 1e-3 * np.median(found.distortion)
    # One realization alone shows its distortion where nothing was driven; here all odd lines were, so it stays unknown.
    assert np.isnan(periodic(runs[:1], response="y", reference="x").distortion).all()


def test_periods_that_do_not_fit_are_refused() -> None:
    x, y = pair(0, 3000)
    with pytest.raises(DataError, match="no period"):
        periodic([run_of(x=x, y=y)], response="y", reference="x")
    with pytest.raises(DataError, match="at least 3 whole periods"):
        periodic([run_of(x=x, y=y, period=1400)], response="y", reference="x")


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 1000), half=st.integers(16, 200), n=st.integers(600, 6000),
    cuts=st.lists(st.integers(1, 6000), max_size=8), gap=st.integers(0, 6000), highest=st.floats(20.0, 300.0),
)  # fmt: skip
def test_a_growing_run_gives_at_its_end_what_the_whole_gives(
    seed: int, half: int, n: int, cuts: list[int], gap: int, highest: float
) -> None:
    x, y = pair(seed, n)
    gaps = (Gap(first_tick=gap, count=7),) if gap < n else ()
    resolution = RATE / (2 * half)

    def until(stop: int) -> Run:
        return run_of(x=x[:stop], y=y[:stop], gaps=tuple(item for item in gaps if item.first_tick < stop))

    running = RunningSpectra(until(1), references=["x"], resolution=resolution, highest=highest)
    for stop in [*sorted(cut for cut in cuts if cut < n), n]:
        running.add(until(stop))
    try:
        whole = estimate([until(n)], references=["x"], resolution=resolution)
    except DataError:
        assert running.segments == 0
        return
    found = running.spectra()
    lines = len(found.frequency)
    assert found.frequency[-1] <= highest or lines == half + 1
    assert lines == half + 1 or whole.frequency[lines] > highest
    assert (found.segments, found.averages) == (whole.segments, whole.averages)
    np.testing.assert_allclose(found.auto, whole.auto[:, :lines], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.cross["x"], whole.cross["x"][:, :lines], rtol=1e-9, atol=1e-9)
    if not gaps:
        assert averages_in(n, 2 * half) == whole.averages


def test_merged_spectra_are_those_of_both_runs() -> None:
    runs = [run_of(**dict(zip("xy", pair(seed, n), strict=True))) for seed, n in ((1, 5000), (2, 9000))]
    both = estimate(runs, references=["x"], resolution=4.0)
    found = merged([estimate([run], references=["x"], resolution=4.0) for run in runs])
    np.testing.assert_allclose(found.auto, both.auto, rtol=1e-12)
    np.testing.assert_allclose(found.frf("y", "x").value, both.frf("y", "x").value, rtol=1e-9)
    assert found.segments == both.segments
    assert found.averages == pytest.approx(both.averages, rel=0.01)
    with pytest.raises(DataError, match="different channels or frequency bins"):
        merged([both, estimate(runs, references=["x"], resolution=8.0)])


@pytest.mark.parametrize("kind", [np.int16, np.int32, np.float32, np.float64])
def test_samples_read_into_an_array_are_those_that_are_read(kind: type[np.generic]) -> None:
    samples = np.random.default_rng(0).integers(-1000, 1000, 100).astype(kind)
    channel = Channel(name="a", samples=samples, scale=1e-3, offset=0.1)
    values = np.full(30, np.nan)
    channel.read_into(values[5:25], 40)
    np.testing.assert_array_equal(values[5:25], channel.read(40, 60))
    assert np.isnan(values[[4, 25]]).all()
