"""A recorder of another hand: sensors with faults and noise, a converter with a sharp filter, and the file that it writes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.signal import firwin, oaconvolve, remez, upfirdn

FloatArray = NDArray[np.float64]
BEGIN = datetime(2024, 3, 4, 8, 0, tzinfo=UTC)
UNITS = {
    "acceleration": "m/s^2", "velocity": "m/s", "displacement": "m", "force": "N", "voltage": "V", "current": "A",
    "angle": "rad", "angular_velocity": "rad/s", "angular_acceleration": "rad/s^2", "torque": "N m",
}  # fmt: skip
BITS = 24

#: Filters of converters at twice the sample rate: flat to 0.45 of the sample rate or beyond, nothing above half of it.
CONVERTERS: Mapping[str, Callable[[], FloatArray]] = {
    "kaiser": lambda: firwin(301, 0.475, window=("kaiser", 10.0)),
    "equiripple": lambda: remez(221, [0.0, 0.225, 0.25, 0.5], [1.0, 0.0], weight=[1.0, 10.0], fs=1.0),
    "blackman": lambda: firwin(481, 0.477, window="blackman"),
    "narrow": lambda: firwin(601, 0.485, window=("kaiser", 10.0)),
}


@dataclass(kw_only=True)
class Chain:
    """Faults of one channel, in the order in which they act."""

    delay: float = 0.0
    gain: float = 1.0
    corner: float = 0.0
    bend: float = 0.0
    peak: float = 1.0
    crosstalk: dict[str, float] = field(default_factory=dict)
    hum: tuple[float, float, float, float] | None = None
    limit: float = np.inf


@lru_cache(maxsize=16)
def _first(factor: int) -> FloatArray:
    # To twice the sample rate: flat to half the sample rate, nothing from 1.5 times it on.
    return firwin(8 * 2 * factor + 1, 1.0 / factor, window=("kaiser", 10.0))


@lru_cache(maxsize=8)
def _converter(name: str) -> FloatArray:
    return np.asarray(CONVERTERS[name]())


def upsampled(x: FloatArray, factor: int) -> FloatArray:
    """Interpolate by a factor, shape (n factor,); the content must lie below a quarter of the sample rate."""
    h = firwin(8 * 2 * factor + 1, 1.0 / factor, window=("kaiser", 10.0)) * factor
    return np.asarray(upfirdn(h, x, up=factor)[8 * factor : 8 * factor + len(x) * factor])


def converted(fine: FloatArray, over: int, name: str | None, n: int) -> FloatArray:
    """Records of fine signals, shape (channels, n); without a converter (an encoder) every `over`-th value.

    Parameters
    ----------
    fine
        Shape (channels, n over).
    over
        Even number of fine steps per sample.
    name
        One of `CONVERTERS`, or None.
    n
        Number of samples.
    """
    if name is None:
        return np.asarray(fine[:, ::over][:, :n])
    factor = over // 2
    h = _first(factor)
    return np.stack([_decimated(upfirdn(h, values, down=factor)[8 : 8 + 2 * n], name) for values in fine])


def _decimated(half: FloatArray, name: str) -> FloatArray:
    # From twice the sample rate.
    g = _converter(name)
    return np.asarray(oaconvolve(half, g)[len(g) // 2 :: 2][: len(half) // 2])


def noise(size: float, name: str | None, n: int, draw: np.random.Generator) -> FloatArray:
    """Noise of a sensor, which passes its converter's filter like the signal, shape (n,); white without a converter."""
    if name is None:
        return size * draw.normal(0.0, 1.0, n)
    return _decimated(np.sqrt(2.0) * size * draw.normal(0.0, 1.0, 2 * n), name)


def late(fine: FloatArray, steps: float) -> FloatArray:
    """A fine signal later by a number of steps, shape (n,); zero before it begins."""
    whole = int(steps)
    share = steps - whole
    out = np.zeros_like(fine)
    out[whole:] = (1.0 - share) * fine[: len(fine) - whole]
    out[whole + 1 :] += share * fine[: len(fine) - whole - 1]
    return out


def faulty(records: Mapping[str, FloatArray], chains: Mapping[str, Chain], rate: float, phase: float) -> dict[str, FloatArray]:
    """Records with the faults of their chains except the delay, by channel, each shape (n,)."""
    from scipy.signal import butter, lfilter

    out = {}
    for name, values in records.items():
        chain = chains.get(name, Chain())
        seen = chain.gain * values
        if chain.corner:
            b, a = butter(1, chain.corner, "highpass", fs=rate)
            seen = lfilter(b, a, seen)
        if chain.bend:
            seen = seen + chain.bend * seen**2 / chain.peak
        for other, share in chain.crosstalk.items():
            seen = seen + share * records[other]
        if chain.hum is not None:
            mains, height, third, turn = chain.hum
            angle = 2 * np.pi * mains * np.arange(len(values)) / rate
            seen = seen + height * (np.sin(angle + phase) + third * np.sin(3 * angle + turn + phase))
        out[name] = np.clip(seen, -chain.limit, chain.limit)
    return out


@dataclass(frozen=True, kw_only=True)
class Input:
    """One input: quantity, noise in its unit, and the size of a count of an encoder (None: 24 bits over the range)."""

    quantity: str
    noise: float
    count: float | None = None
    range: float = 1.0


def write(
    path: Path, runs: Mapping[str, Mapping[str, object]], records: Mapping[str, Mapping[str, FloatArray]],
    inputs: Mapping[str, Input], converter: str | None, known: Mapping[str, float | str], draw: np.random.Generator,
) -> None:  # fmt: skip
    """Add noise, count, and write the recording.

    Parameters
    ----------
    path
        The file.
    runs
        Attributes of each run by id, with `begin` in seconds of the session.
    records
        Records by run and channel, without noise.
    inputs
        The inputs by channel.
    converter
        Name of the converters' filter; None for encoders.
    known
        Attributes of the rig.
    draw
        Random generator of the noise.
    """
    with h5py.File(path, "w") as file:
        file.attrs["format"], file.attrs["format_version"] = "rig-recording", 1
        file.create_group("rig").attrs.update(known)
        for name, attributes in runs.items():
            group = file.create_group(f"runs/{name}")
            about = dict(attributes)
            group.attrs["started"] = (BEGIN + timedelta(seconds=float(about.pop("begin")))).isoformat()  # type: ignore[arg-type]
            group.attrs.update({key: value for key, value in about.items() if value is not None})
            for channel, values in records[name].items():
                one = inputs[channel]
                scale = one.count or 2.0 * one.range / 2**BITS
                top = np.inf if one.count else 2 ** (BITS - 1) - 1
                counts = np.round((values + noise(one.noise, converter, len(values), draw)) / scale)
                item = group.create_dataset(channel, data=np.clip(counts, -top, top).astype(np.int32))
                item.attrs.update({"quantity": one.quantity, "unit": UNITS[one.quantity], "scale": scale, "offset": 0.0})
                if one.count is None:
                    item.attrs["range"] = one.range
