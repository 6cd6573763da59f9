"""The motion of bodies and links from the channels of a run: each channel as displacement, velocity and acceleration."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from hashlib import blake2b

import numpy as np

from isorig.analysis.campaign import MOTION, FloatArray
from isorig.analysis.lowpass import about_line, lowpass_gain, mirrored
from isorig.analysis.model.rig_model import RigModel, weights_of
from isorig.analysis.simulate.inverse import position_from

#: Residual of a body's motion as a combination of sensors above which the sensors do not determine it (rounding).
UNDETERMINED = 1e-9
#: Degree of the polynomial that is taken out of an integrated displacement before its high-pass: constants of integration and a
#: constant error of an accelerometer are of degree two, its drift of three.
SLOW_DEGREE = 3
#: Number of records whose derivatives are kept, and samples of the longest of these: each stage of a diagnosis asks for the same
#: ones. Derived: 0.4 GB.
REMEMBERED, LONGEST = 128, 2**17


@dataclass(frozen=True, kw_only=True)
class Signals:
    """A channel's record as displacement (m), velocity (m/s) and acceleration (m/s^2), each shape (n,); or a force alone (N)."""

    #: The derivatives by order: 0, 1, 2. A channel that is no motion has only the record itself, under order 0.
    orders: Mapping[int, FloatArray]


def derivatives(values: FloatArray, order: int, rate: float, low: float, high: float, *, steady: bool = False) -> Signals:
    """A record of the derivative `order` as displacement, velocity and acceleration.

    Parameters
    ----------
    values
        Shape (n,).
    order
        0 for a displacement, 1 for a velocity, 2 for an acceleration.
    rate
        Hz.
    low
        Frequency in Hz below which integrals have no content: the constants of integration are unknown. 0 for a displacement
        that is counted from the start of the record of a velocity.
    high
        Frequency in Hz above which derivatives have no content: there they are noise. Infinite for no limit.
    steady
        Whether the mean of a velocity is part of the motion, and no error of a sensor: its displacement is one about that mean.
    """
    if len(values) > LONGEST:
        return _derivatives(values, order, rate, low, high, steady=steady)
    return _remembered(_Samples(values), order, rate, low, high, steady=steady)


class _Samples:
    # An array that is a key by its content.

    def __init__(self, values: FloatArray) -> None:
        self.values = values
        self._digest = blake2b(np.ascontiguousarray(values).view(np.uint8).data, digest_size=16).digest()

    def __hash__(self) -> int:
        return hash(self._digest)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Samples) and self._digest == other._digest


@lru_cache(maxsize=REMEMBERED)
def _remembered(samples: _Samples, order: int, rate: float, low: float, high: float, *, steady: bool) -> Signals:
    found = _derivatives(samples.values, order, rate, low, high, steady=steady)
    for values in found.orders.values():
        values.flags.writeable = False
    return found


def _derivatives(values: FloatArray, order: int, rate: float, low: float, high: float, *, steady: bool) -> Signals:
    counted = order == 1 and low == 0.0
    found = {order: values - (values.mean() if order and not counted else 0.0)}
    if counted:
        found[0] = position_from(values, rate)
    for below in range(order - 1, -1, -1) if not counted else ():
        found[below] = _integral(found[below + 1], rate)
    if order and not counted:
        # The constants of integration are a ramp or a parabola. Both ends of the record differ by them, and a filter would spread
        # that over periods of `low`.
        slow, slope = _slow_part(found[0], rate)
        found[0] = _high_passed(found[0] - slow, rate, low, 1.0)
        if order == 2:
            found[1] = _high_passed(found[1] - slope, rate, low, -1.0)
    for above in range(order + 1, 3):
        found[above] = _derivative(found[above - 1], rate, high if above == order + 1 else np.inf)
    if steady and order == 1:
        found[1] = values
    return Signals(orders=found)


def without_slow_part(displacement: FloatArray, rate: float, low: float) -> FloatArray:
    """An integrated displacement without the polynomial of the constants of integration, and without content below `low` Hz."""
    return _high_passed(displacement - _slow_part(displacement, rate)[0], rate, low, 1.0)


def _slow_part(displacement: FloatArray, rate: float) -> tuple[FloatArray, FloatArray]:
    # The polynomial of degree `SLOW_DEGREE` through a displacement, and its derivative, each shape (n,).
    n = len(displacement)
    time = np.linspace(-1.0, 1.0, n)
    slow = np.polynomial.legendre.legfit(time, displacement, SLOW_DEGREE)
    slope = np.polynomial.legendre.legval(time, np.polynomial.legendre.legder(slow)) * 2.0 * rate / (n - 1)
    return np.asarray(np.polynomial.legendre.legval(time, slow)), np.asarray(slope)


def _integral(values: FloatArray, rate: float) -> FloatArray:
    n = len(values)
    spectrum = np.fft.rfft(values)
    spectrum[0] = 0.0
    spectrum[1:] /= 2j * np.pi * np.fft.rfftfreq(n, 1.0 / rate)[1:]
    return np.fft.irfft(spectrum, n)


def _high_passed(values: FloatArray, rate: float, low: float, sign: float) -> FloatArray:
    # A record that continues beyond its ends as its mirror image, times `sign`: -1 for the derivative of such a record.
    n = len(values)
    whole = mirrored(values, sign)
    gain = highpass_gain(np.asarray(np.fft.rfftfreq(len(whole), 1.0 / rate)), low)
    return np.asarray(np.fft.irfft(np.fft.rfft(whole) * gain, len(whole))[:n])


def highpass_gain(frequency: FloatArray, low: float) -> FloatArray:
    """Gain of a zero-phase high-pass: 0 up to half of `low` Hz, 1 from `low` on, with a raised-cosine edge."""
    passed = np.clip((frequency - low / 2.0) / (low / 2.0), 0.0, 1.0)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * passed))


def _derivative(values: FloatArray, rate: float, high: float) -> FloatArray:
    # Mirrored about both ends, so that the record continues without a step or a kink.
    n, (whole, _) = len(values), about_line(values)
    frequency = np.asarray(np.fft.rfftfreq(len(whole), 1.0 / rate), dtype=np.float64)
    spectrum = np.fft.rfft(whole) * 2j * np.pi * frequency * lowpass_gain(frequency, high)
    return np.asarray(np.fft.irfft(spectrum, len(whole))[:n] + (values[-1] - values[0]) / (n - 1) * rate)


class Combinations:
    """How bodies' motions follow from channels: which channels, with which weights, for each derivative.

    Parameters
    ----------
    model
        The rig.
    estimated
        Bodies whose acceleration is estimated from others' (`hidden`): a channel of the name `estimate_of(body)` each.
    """

    def __init__(self, model: RigModel, estimated: Sequence[str] = ()) -> None:
        self.model, self.estimated = model, tuple(estimated)
        names = [body.name for body in model.bodies]
        rows: list[tuple[str, int, FloatArray]] = []
        for sensor in model.sensors:
            if sensor.force_in is None and sensor.quantity in MOTION:
                rows.append((sensor.channel, MOTION[sensor.quantity], weights_of(model, sensor)))
        for drive in model.drives:
            if drive.imposes is not None and drive.quantity in MOTION:
                weights = np.zeros(len(names))
                weights[names.index(drive.imposes)] = 1.0 / drive.factor
                rows.append((drive.channel, MOTION[drive.quantity], weights))
        for body in estimated:
            weights = np.zeros(len(names))
            weights[names.index(body)] = 1.0
            rows.append((estimate_of(body), 2, weights))
        self._rows = rows
        self._known: dict[tuple[bytes, int], dict[str, float] | None] = {}

    @property
    def orders(self) -> dict[str, int]:
        """The measured derivative of each channel that records a motion."""
        return {channel: order for channel, order, _ in self._rows}

    def of(self, weights: FloatArray, order: int) -> dict[str, float] | None:
        """Weights of channels whose derivatives of this order sum up to that of a combination of coordinates; None if unmeasured.

        Sensors that measure a derivative close to it are preferred.

        Parameters
        ----------
        weights
            Of the coordinates, shape (bodies,).
        order
            0, 1 or 2.
        """
        key = weights.tobytes(), order
        if key not in self._known:
            self._known[key] = self._combination(weights, order)
        return self._known[key]

    def _combination(self, weights: FloatArray, order: int) -> dict[str, float] | None:
        if not np.any(weights):
            return {}
        chosen: list[tuple[str, FloatArray]] = []
        for channel, _, row in sorted(self._rows, key=lambda item: abs(item[1] - order)):
            matrix = np.array([r for _, r in chosen])
            if chosen and np.linalg.matrix_rank(np.vstack([matrix, row])) == len(chosen):
                continue  # this motion is measured already
            chosen.append((channel, row))
            if (found := _combined(chosen, weights)) is not None:
                return found
        return None

    @cached_property
    def repeated(self) -> dict[str, dict[str, float]]:
        """Sensors whose motion others record too: the weights of these by channel, by the channel that repeats them."""
        found: dict[str, dict[str, float]] = {}
        chosen: list[tuple[str, FloatArray]] = []
        for channel, _, row in sorted(self._rows, key=lambda item: -item[1]):
            others = _combined(chosen, row) if chosen else None
            if others is None:
                chosen.append((channel, row))
            else:
                found[channel] = others
        return found

    @cached_property
    def measured(self) -> tuple[str, ...]:
        """Bodies whose acceleration follows from the channels."""
        found = []
        for k, body in enumerate(self.model.bodies):
            weights = np.zeros(len(self.model.bodies))
            weights[k] = 1.0
            if self.of(weights, 2) is not None:
                found.append(body.name)
        return tuple(found)


def _combined(chosen: Sequence[tuple[str, FloatArray]], weights: FloatArray) -> dict[str, float] | None:
    # Weights of channels, each with its row on the coordinates, that sum up to a combination of these; None if none do.
    matrix = np.array([row for _, row in chosen])
    solution, *_ = np.linalg.lstsq(matrix.T, weights, rcond=None)
    if float(np.abs(matrix.T @ solution - weights).max()) >= UNDETERMINED * max(1.0, float(np.abs(weights).max())):
        return None
    return {channel: float(s) for (channel, _), s in zip(chosen, solution, strict=True) if abs(s) > UNDETERMINED}


def estimate_of(body: str) -> str:
    """Name of the channel with a body's estimated acceleration."""
    return f"estimate of {body}"
