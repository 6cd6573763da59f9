"""Several drives at once, and windows and overlaps other than Hann with a half: against scipy, pyFRF and closed formulas."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.signal

from isorig.analysis.campaign import Channel, ComplexArray, FloatArray, Run
from isorig.analysis.errors import DataError
from isorig.analysis.spectra.modal_fit import fit_modes
from isorig.analysis.spectra.welch import effective_averages, estimate
from isorig.analysis.spectra.windows import WINDOWS, Window, window_named

RATE, SECONDS = 256.0, 200.0
#: Frequency (Hz), damping ratio, shape at the two responses and at the two drives.
MODES = ((20.0, 0.02, (1.0, 0.5), (1.0, 0.7)), (33.0, 0.015, (1.0, -0.8), (0.6, -1.0)))


def accelerances(f: FloatArray) -> ComplexArray:
    """Closed form, shape (responses, drives, lines)."""
    s = 2j * np.pi * f
    total = np.zeros((2, 2, len(f)), dtype=complex)
    for f0, zeta, shape, push in MODES:
        w = 2.0 * np.pi * f0
        total += np.multiply.outer(np.outer(shape, push), s**2 / (s**2 + 2.0 * zeta * w * s + w**2))
    return total


def driven_at_two(seed: int, shared: float = 0.0, seconds: float = SECONDS, noise: float = 0.01) -> Run:
    generator = np.random.default_rng(seed)
    n = round(seconds * RATE)
    x = generator.standard_normal((2, n))
    x[1] = shared * x[0] + np.sqrt(1.0 - shared**2) * x[1]
    lines = np.einsum("ijf,jf->if", accelerances(np.fft.rfftfreq(n, 1.0 / RATE)), np.fft.rfft(x))
    y = np.fft.irfft(lines, n)
    y = y + noise * y.std(axis=1, keepdims=True) * generator.standard_normal(y.shape)
    rows = dict(zip(("a", "b", "p", "q"), (*x, *y), strict=True))
    channels = {
        name: Channel(name=name, samples=row, quantity="force" if name in "ab" else "acceleration",
                      unit="N" if name in "ab" else "m/s^2")
        for name, row in rows.items()
    }  # fmt: skip
    return Run(id=f"r{seed}", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels)


@pytest.mark.parametrize("shared", [0.0, 0.6])
def test_two_drives_agree_with_pyfrf_and_with_the_truth(shared: float) -> None:
    peer = pytest.importorskip("pyFRF", reason="pyFRF comes with the extra bench")
    run, length = driven_at_two(0, shared), 2048
    spectra = estimate([run], references=["a", "b"], resolution=RATE / length)
    kept = (spectra.frequency > 5.0) & (spectra.frequency < 100.0)
    true = accelerances(spectra.frequency)
    rows = {name: run.read(name) for name in "abpq"}
    other = peer.FRF(
        sampling_freq=int(RATE), exc=np.array([[rows["a"], rows["b"]]]), resp=np.array([[rows["p"], rows["q"]]]), window="hann",
        nperseg=length, fft_len=length, noverlap=length // 2, exc_type="f", resp_type="a",
    ).get_FRF(frf_estimator="H1", frf_form="accelerance")  # fmt: skip
    errors = []
    for i, response in enumerate("pq"):
        for j, frf in enumerate(spectra.frfs(response, ("a", "b"))):
            size = np.abs(true[i, j])[kept]
            ours, theirs = (np.abs(value - true[i, j])[kept] / size for value in (frf.value, other[i, j]))
            errors.append((np.median(ours), np.median(theirs)))
            assert np.median(np.abs(frf.value - other[i, j])[kept] / size) < 1e-3
            assert frf.units == ("m/s^2", "N")
    ours_all, theirs_all = np.array(errors).T
    np.testing.assert_allclose(ours_all, theirs_all, rtol=0.02)
    alone = np.abs(spectra.frf("p", "b").value - true[0, 1])[kept] / np.abs(true[0, 1])[kept]
    assert np.median(alone) > 5.0 * ours_all[1]  # what the other drive adds is no noise that averages out


def test_with_two_drives_the_stated_deviations_are_the_scatter_of_repeats() -> None:
    found = [
        estimate([driven_at_two(seed, 0.5, 60.0, 0.3)], references=["a", "b"], resolution=1.0).frfs("p", ("a", "b"))
        for seed in range(40)
    ]
    kept = (found[0][0].frequency > 40.0) & (found[0][0].frequency < 120.0)  # off the peaks, so that noise is all that scatters
    for j in range(2):
        values = np.array([frfs[j].value[kept] for frfs in found])
        stated = np.sqrt(np.mean([frfs[j].magnitude_std[kept] ** 2 for frfs in found], axis=0))
        assert 0.93 < (np.abs(values).std(axis=0) / stated).mean() < 1.07
        multiple, partial = found[0][j].multiple_coherence, found[0][j].coherence
        assert multiple is not None
        assert (multiple[kept] >= partial[kept] - 1e-12).all()


def test_total_least_squares_has_no_bias_where_all_channels_are_noisy() -> None:
    generator = np.random.default_rng(3)
    n = 100_000
    x = generator.standard_normal((2, n))
    y = 2.0 * x[0] - 0.5 * x[1]
    rows = {"a": x[0], "b": x[1], "p": y}
    channels = {
        name: Channel(name=name, samples=row + 0.5 * generator.standard_normal(n)) for name, row in rows.items()
    }  # fmt: skip
    run = Run(id="r", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels)
    spectra = estimate([run], references=["a", "b"], resolution=4.0)
    for estimator, expected in (("H1", (1.6, -0.4)), ("Hv", (2.0, -0.5))):
        means = [frf.value[4:-4].mean().real for frf in spectra.frfs("p", ("a", "b"), estimator)]  # type: ignore[arg-type]
        np.testing.assert_allclose(means, expected, atol=0.02)


def test_drives_that_cannot_be_separated_are_refused() -> None:
    run = driven_at_two(0, 1.0, 60.0)
    with pytest.raises(DataError, match="is correlated with"):
        estimate([run], references=["a", "b"], resolution=1.0).frfs("p", ("a", "b"))
    together, apart = driven_at_two(0, 0.99, 60.0), driven_at_two(0, 0.0, 60.0)
    nearly, free = (estimate([each], references=["a", "b"], resolution=1.0) for each in (together, apart))
    wide, narrow = (spectra.frfs("p", ("a", "b"))[0].magnitude_std for spectra in (nearly, free))
    # The noise is a share of each run's own response.
    noise = together.read("p").std() / apart.read("p").std()
    assert np.median(wide / narrow) == pytest.approx(noise / np.sqrt(1.0 - 0.99**2), rel=0.2)
    short = estimate([driven_at_two(0, 0.0, 3.0)], references=["a", "b"], resolution=0.5)
    with pytest.raises(DataError, match="cannot separate"):
        short.frfs("p", ("a", "b"))
    with pytest.raises(DataError, match="H2"):
        nearly.frfs("p", ("a", "b"), "H2")


@pytest.mark.parametrize("name", list(WINDOWS))
@pytest.mark.parametrize("overlap", [0.0, 0.5, 0.75])
def test_every_window_and_overlap_agrees_with_scipy(name: str, overlap: float) -> None:
    run, length = driven_at_two(1, seconds=30.0), 512
    found = estimate([run], references=["a"], resolution=RATE / length, window=window_named(name), overlap=overlap)
    same = {
        "fs": RATE, "window": "boxcar" if name == "rectangular" else name, "nperseg": length,
        "noverlap": round(overlap * length), "detrend": "constant",
    }  # fmt: skip
    inside = slice(6, -2)
    _, syy = scipy.signal.welch(run.read("p"), **same)
    _, sxy = scipy.signal.csd(run.read("a"), run.read("p"), **same)
    np.testing.assert_allclose(found.density("p")[inside], syy[inside], rtol=1e-9)
    np.testing.assert_allclose(found.cross["a"][found.channels.index("p")][inside], sxy[inside], rtol=1e-6, atol=1e-9 * syy.max())


@pytest.mark.parametrize("window", list(WINDOWS.values()), ids=list(WINDOWS))
def test_closed_forms_of_windows_are_their_sums(window: Window) -> None:
    samples = window.samples(4096)
    for shift in (0.0, 0.1, 0.5, 0.9):
        k = round(shift * 4096)
        direct = (samples[: 4096 - k] * samples[k:]).sum() / (samples**2).sum()
        assert window.autocorrelation(k / 4096) == pytest.approx(direct, abs=2e-3)
    assert window.segments_per_average(0.75) == pytest.approx(1e6 / effective_averages(samples, 10**6, 1024), rel=2e-3)


@pytest.mark.parametrize(("name", "overlap"), [("blackman", 0.75), ("flattop", 0.5), ("rectangular", 0.0)])
def test_modes_have_no_bias_through_other_windows(name: str, overlap: float) -> None:
    spectra = estimate(
        [driven_at_two(5)], references=["a", "b"], resolution=0.4, window=window_named(name), overlap=overlap
    )  # fmt: skip
    fit = fit_modes(spectra.frfs("p", ("a", "b"))[0], (14.0, 45.0), guesses=[(20.1, 0.025), (33.1, 0.02)], residuals=1)
    for mode, (f, zeta, _, _) in zip(fit.modes, MODES, strict=True):
        assert mode.frequency == pytest.approx(f, abs=4.0 * mode.frequency_std)
        assert mode.damping == pytest.approx(zeta, abs=4.0 * mode.damping_std)
        assert mode.damping_std < 0.05 * zeta


def test_a_window_or_an_overlap_that_there_is_not_is_refused() -> None:
    with pytest.raises(DataError, match="hann, hamming"):
        window_named("kaiser")
    with pytest.raises(DataError, match=r"0 to 0\.95"):
        estimate([driven_at_two(0, seconds=10.0)], references=["a"], resolution=1.0, overlap=1.0)
