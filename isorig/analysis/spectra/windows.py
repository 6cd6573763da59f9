"""Windows of Welch's method: sums of cosines, so that their transforms and autocorrelations have closed forms."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal, get_args

import numpy as np

from isorig.analysis.campaign import ComplexArray, FloatArray
from isorig.analysis.errors import DataError

WindowName = Literal["hann", "hamming", "blackman", "flattop", "rectangular"]


@dataclass(frozen=True, kw_only=True)
class Window:
    """A window w(u) = sum of (-1)^j a_j cos(2 pi j u) over 0 <= u < 1."""

    name: WindowName  #: Its name for users.
    #: a_0, a_1, ... (Harris 1978; the flat top of D'Antona and Ferrero 2006, as in scipy.signal.windows).
    cosines: tuple[float, ...]

    @property
    def harmonics(self) -> tuple[tuple[int, float], ...]:
        """Pairs (m, c_m) of the same window written as the sum of c_m exp(2 pi i m u), m of both signs."""
        return tuple(
            (sign * j, (-1.0) ** j * (a if j == 0 else 0.5 * a))
            for j, a in enumerate(self.cosines)
            for sign in ((1,) if j == 0 else (-1, 1))
        )

    def samples(self, length: int) -> FloatArray:
        """The periodic window, shape (length,)."""
        u = np.arange(length) / length
        return np.asarray(sum((-1.0) ** j * a * np.cos(2.0 * np.pi * j * u) for j, a in enumerate(self.cosines)))

    def transform(self, lines: FloatArray) -> FloatArray:
        """The Fourier transform at an offset in frequency bins, without its phase exp(-pi i lines); real, of the same shape."""
        return np.asarray(sum(c * (-1.0) ** m * np.sinc(lines - m) for m, c in self.harmonics))

    def autocorrelation(self, shift: float) -> float:
        """The correlation of the window with itself shifted by `shift` of its length, 1 at 0 and 0 from 1 on."""
        if shift >= 1.0:
            return 0.0
        ramps, flats = self.lag_terms
        total = sum(a * (1.0 - shift) * np.exp(2j * np.pi * m * shift) for m, a in ramps)
        return float((total + sum(b * np.exp(2j * np.pi * m * shift) for m, b in flats)).real)

    @cached_property
    def lag_terms(self) -> tuple[tuple[tuple[int, float], ...], tuple[tuple[int, complex], ...]]:
        """The autocorrelation as a sum of a_m (1 - u) exp(2 pi i m u) and of b_m exp(2 pi i m u): pairs (m, a_m) and (m, b_m).

        From the integral of w(v) w(v + u) over v, harmonic by harmonic.
        """
        power = sum(c**2 for _, c in self.harmonics)
        ramps = tuple((m, c**2 / power) for m, c in self.harmonics)
        flats = tuple(
            (m, sum(c * other / (np.pi * 1j * (n - m)) for n, other in self.harmonics if n != m) / power)
            for m, c in self.harmonics
        )
        return ramps, tuple((m, complex(b)) for m, b in flats if b != 0.0)

    def segments_per_average(self, overlap: float) -> float:
        """Segments per independent average with this relative overlap: 1 + 2 sum rho_j^2 (Welch 1967)."""
        hop, total, shift = 1.0 - overlap, 1.0, 1.0 - overlap
        while shift < 1.0:
            total += 2.0 * self.autocorrelation(shift) ** 2
            shift += hop
        return total


HANN = Window(name="hann", cosines=(0.5, 0.5))
WINDOWS = {
    window.name: window
    for window in (
        HANN,
        Window(name="hamming", cosines=(0.54, 0.46)),
        Window(name="blackman", cosines=(0.42, 0.5, 0.08)),
        Window(name="flattop", cosines=(0.21557895, 0.41663158, 0.277263158, 0.083578947, 0.006947368)),
        Window(name="rectangular", cosines=(1.0,)),
    )
}
#: Maximum relative overlap of segments: more takes time and gives no information.
OVERLAP_MOST = 0.95


def window_named(name: str) -> Window:
    """The window of that name. Raises DataError if there is none."""
    if name not in WINDOWS:
        raise DataError(f"there is no window {name!r}; there are {', '.join(get_args(WindowName))}, so give one of these")
    return WINDOWS[name]


@lru_cache(maxsize=4)
def hanning(length: int) -> FloatArray:
    """The symmetric Hann window, shape (length,), read-only: the records of a campaign have few lengths."""
    window = np.hanning(length)
    window.flags.writeable = False
    return window


def segment_spectra(values: FloatArray, window: FloatArray, hop: int) -> ComplexArray:
    """Spectra of a record's segments, as long as the window and `hop` samples apart, shape (segments, frequency bins)."""
    segments = np.lib.stride_tricks.sliding_window_view(values, len(window))[::hop]
    return np.asarray(np.fft.rfft(segments * window, axis=-1))


def vertex(size: FloatArray, top: int) -> tuple[float, float]:
    """Distance of a peak from its largest bin, in bins, and its height: by a parabola through the logarithms of three bins."""
    a, b, c = np.log(np.maximum(size[top - 1 : top + 2], np.finfo(float).tiny))
    bend = a - 2.0 * b + c
    shift = 0.5 * (a - c) / bend if bend < 0.0 else 0.0
    return float(shift), float(np.exp(b - 0.25 * (a - c) * shift))
