"""Rigs as a newcomer has them: simulated with scipy, not with this project, from plain matrices."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from linear_motion import moved
from scipy.integrate import solve_ivp
from scipy.signal import butter, sosfiltfilt

from isorig.analysis.campaign import SI_UNIT, Campaign, Channel, FloatArray, Quantity, Run
from isorig.analysis.model.rig_model import RigModel, from_tree

#: A force in N of an elongation (m) and its rate (m/s), shape (n,) or scalar.
Law = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True, kw_only=True)
class StrangeRig:
    """Masses in a chain or on the ground: joints (a, b or -1, stiffness, damping), a force on one mass or a moved base.

    `laws` are forces in addition, by joint. `sensors` are (name, mass, quantity).
    """

    masses: tuple[float, ...]
    joints: tuple[tuple[int, int, float, float], ...]
    sensors: tuple[tuple[str, int, Quantity], ...]
    drive: str = "force"
    drive_quantity: Quantity = "force"
    pushed: int = 0
    factor: float = 1.0
    base: bool = False
    rotary: bool = False
    laws: Mapping[int, Law] = field(default_factory=dict)

    def description(self, wrong: Mapping[str, float] | None = None, free: tuple[str, ...] | None = None) -> RigModel:
        """Its description; given values are multiplied by `wrong`, by path."""
        bodies = [{"name": f"m{k}", "mass": m} for k, m in enumerate(self.masses)]
        if self.base:
            bodies.append({"name": "base", "mass": 10.0})
        if self.rotary:
            bodies = [{**body, "motion": "rotation"} for body in bodies]
        ground = "base" if self.base else "ground"
        links = [
            {"name": f"l{k}", "a": f"m{a}", "b": ground if b < 0 else f"m{b}", "stiffness": s, "damping": d}
            for k, (a, b, s, d) in enumerate(self.joints)
        ]
        drive = {"channel": self.drive, "quantity": self.drive_quantity}
        drive |= {"imposes": "base"} if self.base else {"factor": self.factor, "pushes": {f"m{self.pushed}": 1.0}}
        springs = [f"links.{link['name']}.{key}" for link in links for key in ("stiffness", "damping")]
        tree = {
            "name": "strange rig", "bodies": bodies, "links": links, "drive": drive,
            "sensors": [{"channel": name, "body": f"m{k}", "quantity": quantity} for name, k, quantity in self.sensors],
            "free": springs if free is None else list(free),
        }  # fmt: skip
        model = from_tree(tree)
        return model.replace({path: model.get(path) * factor for path, factor in (wrong or {}).items()})

    def recorded(self, drive: FloatArray, rate: float) -> dict[str, FloatArray]:
        """Records of drive and sensors, from rest, for a drive at a sample rate."""
        count = len(self.masses)
        rows = [np.array([(k == a) - (k == b) for k in range(count)], dtype=float) for a, b, _, _ in self.joints]
        mass = np.array(self.masses)
        time = np.arange(len(drive)) / rate
        velocity = position = np.zeros_like(drive)
        if self.base:
            velocity = np.concatenate([[0.0], np.cumsum(0.5 * (drive[1:] + drive[:-1]))]) / rate
            position = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]))]) / rate
        signals = np.stack([drive, position, velocity])

        def at(t: float) -> FloatArray:
            place = min(t * rate, len(drive) - 1.001)
            k = int(place)
            return np.asarray(signals[:, k] + (place - k) * (signals[:, k + 1] - signals[:, k]))

        system, inputs = self._linear(rows, mass)

        def slope(y: FloatArray, now: FloatArray) -> FloatArray:
            change = system @ y + inputs @ now
            for k, law in self.laws.items():
                grounded = self.base and self.joints[k][1] < 0
                e, r = rows[k] @ y[:count] - grounded * now[1], rows[k] @ y[count:] - grounded * now[2]
                change[count:] -= np.multiply.outer(rows[k] / mass, law(e, r))
            return np.asarray(change)

        if self.laws:
            states = solve_ivp(
                lambda t, y: slope(y, at(t)), (0.0, time[-1]), np.zeros(2 * count), t_eval=time, method="RK45",
                max_step=0.5 / rate, rtol=1e-5, atol=1e-9,
            ).y  # fmt: skip
        else:
            states = moved(system, inputs, signals, 1.0 / rate)
        return self._sensed(drive, states[:count], states[count:], slope(states, signals)[count:])

    def _linear(self, rows: list[FloatArray], mass: FloatArray) -> tuple[FloatArray, FloatArray]:
        # Rates of positions and velocities by these, and by the drive and its integrals of a base.
        count = len(mass)
        stiffness, damping, inputs = np.zeros((count, count)), np.zeros((count, count)), np.zeros((count, 3))
        if not self.base:
            inputs[self.pushed, 0] = self.factor
        for row, (_, b, k, c) in zip(rows, self.joints, strict=True):
            stiffness += k * np.outer(row, row)
            damping += c * np.outer(row, row)
            if self.base and b < 0:
                inputs += np.outer(row, [0.0, k, c])
        system = np.block([[np.zeros((count, count)), np.eye(count)], [-(stiffness.T / mass).T, -(damping.T / mass).T]])
        return system, np.vstack([np.zeros((count, 3)), (inputs.T / mass).T])

    def _sensed(self, drive: FloatArray, x: FloatArray, v: FloatArray, a: FloatArray) -> dict[str, FloatArray]:
        by = {0: x, 1: v, 2: a}
        order = {"displacement": 0, "angle": 0, "velocity": 1, "angular_velocity": 1}
        return {self.drive: drive, **{name: by[order.get(quantity, 2)][k] for name, k, quantity in self.sensors}}

    def quantities(self) -> dict[str, Quantity]:
        """The quantity of each channel."""
        return {self.drive: self.drive_quantity, **{name: quantity for name, _, quantity in self.sensors}}


def noise(seconds: float, rate: float, level: float, band: tuple[float, float], seed: int) -> FloatArray:
    """Band-limited noise with an rms."""
    wave = np.random.default_rng(seed).normal(size=round(seconds * rate))
    wave = sosfiltfilt(butter(3, band, btype="band", fs=rate, output="sos"), wave)
    return np.asarray(level * wave / wave.std())


def campaign(
    rig: StrangeRig,
    levels: tuple[float, ...] = (1.0,),
    *,
    seconds: float = 8.0,
    rate: float = 256.0,
    band: tuple[float, float] = (0.5, 40.0),
    scale: Mapping[str, float] | None = None,
    seed: int = 0,
) -> Campaign:
    """Runs with band-limited noise of these levels, and sensor noise of half a per cent; records multiplied by `scale`."""
    draw = np.random.default_rng(seed)
    runs = []
    for k, level in enumerate(levels):
        records = rig.recorded(noise(seconds, rate, level, band, 10 * seed + k), rate)
        channels = {}
        for name, quantity in rig.quantities().items():
            values = records[name] + draw.normal(0.0, 5e-3 * records[name].std(), len(records[name]))
            values = values * (scale or {}).get(name, 1.0)
            channels[name] = Channel(name=name, samples=values, quantity=quantity, unit=SI_UNIT[quantity])
        runs.append(Run(id=f"r{k}", configuration="unlocked", sample_rate=rate, gain=level, channels=channels,
                        excitation="random", band=band))  # fmt: skip
    return Campaign(runs=tuple(runs), source="strange")


def dry(force: float, slow: float) -> Law:
    """Dry friction, smooth below a velocity."""
    return lambda e, r: np.asarray(force * np.tanh(r / slow))


def play(stiffness: float, half: float) -> Law:
    """What a clearance of half on either side takes from a spring."""
    return lambda e, r: np.asarray(-stiffness * np.clip(e, -half, half))


def cubic(stiffness: float) -> Law:
    """A spring that hardens."""
    return lambda e, r: np.asarray(stiffness * e**3)
