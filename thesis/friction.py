"""python -m thesis.friction FOLDER: writes the figures of the page on friction, pictures/friction-*.png, to a folder."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.figure import Figure

from isorig.analysis import laws
from isorig.analysis.campaign import FloatArray
from isorig.analysis.model.rig_model import Body, Contact, Drive, Link, RigModel, Sensor
from isorig.analysis.simulate import Excitation, Trace, trace
from isorig.analysis.simulate.excitation import half_sine
from isorig.rig.frf.figures import save
from isorig.rig.wire_bonder.description import one_mass, three_mass, two_mass
from thesis.printed_law import LiteralRun, literal_run

#: The thesis's half sine in N. Its duration is not given: at 0.05 s a mass held by 200 N stays at its largest displacement, as in
#: Fig. 7; after pulses longer than about 0.07 s the spring pulls it back.
PEAK, PULSE, START = 500.0, 0.05, 0.1
RATE, SECONDS = 2048.0, 1.2
#: Duration of the pulse for the literal replay, s: after a longer one the table still moves when the motor has stopped.
LITERAL_PULSE = 0.1
#: The contact laws in one figure, with the same sliding force where they have one.
CONTACTS: dict[str, laws.FrictionLaw] = {
    "viscous": laws.Viscous(viscous_coefficient=30.0),
    "Coulomb": laws.Coulomb(friction_force=10.0),
    "Coulomb with static": laws.Coulomb(friction_force=10.0, static_force=16.0),
    "Stribeck, exponential": laws.Stribeck(friction_force=10.0, static_force=16.0, stribeck_velocity=0.05),
    "Stribeck, rational": laws.Stribeck(friction_force=10.0, static_force=16.0, stribeck_velocity=0.05, shape="rational"),
    "arctan": laws.Arctan(friction_force=10.0, smoothing_velocity=0.02),
    "arctan, static and viscous": laws.Arctan(
        friction_force=10.0, static_force=16.0, stribeck_velocity=0.05, smoothing_velocity=0.005, viscous_coefficient=15.0
    ),
    "Karnopp": laws.Karnopp(friction_force=10.0, static_force=16.0, band=0.03),
    "Karnopp, falling and viscous": laws.Karnopp(
        friction_force=10.0, static_force=16.0, band=0.03, stribeck_velocity=0.05, viscous_coefficient=15.0
    ),
    "asymmetric": laws.Asymmetric(forward_force=6.0, backward_force=12.0, forward_viscosity=10.0),
    "Dahl": laws.Dahl(friction_force=10.0, bristle_stiffness=2e3),
    "LuGre": laws.LuGre(
        friction_force=10.0, static_force=16.0, stribeck_velocity=0.05, bristle_stiffness=2e3, bristle_damping=20.0
    ),
}
#: The link laws in another figure.
LINKS: dict[str, laws.LinkLaw] = {
    "hardening": laws.Cubic(cubic_stiffness=3e5),
    "softening": laws.Cubic(cubic_stiffness=-6e4),
    "bounded softening": laws.BoundedSoftening(softening=0.8, scale=0.01),
    "backlash": laws.Backlash(clearance=0.01),
    "end stop": laws.EndStop(stroke=0.025, contact_stiffness=4e3, contact_damping=5.0),
    "quadratic damping": laws.QuadraticDamping(quadratic_damping=60.0),
    "drift": laws.Drift(drift_rate=0.15),
}


def rubbed(law: laws.FrictionLaw, *, stiffness: float = 800.0) -> RigModel:
    """A mass of 1 kg on a soft spring with friction on the ground."""
    return RigModel(
        name="one law", bodies=(Body(name="m", mass=1.0),),
        links=(Link(name="spring", a="m", stiffness=stiffness, damping=8.0),),
        contacts=(Contact(name="rubbing", a="m", law=law),),
        drive=Drive(channel="force", factor=1.0, pushes={"m": 1.0}, quantity="force"), sensors=SENSORS,
    )  # fmt: skip


def sprung(law: laws.LinkLaw, *, stiffness: float = 500.0) -> RigModel:
    """A mass of 1 kg on a spring with a law."""
    return RigModel(
        name="one law", bodies=(Body(name="m", mass=1.0),),
        links=(Link(name="spring", a="m", stiffness=stiffness, damping=2.0, laws=(law,)),),
        drive=Drive(channel="force", factor=1.0, pushes={"m": 1.0}, quantity="force"), sensors=SENSORS,
    )  # fmt: skip


SENSORS = (Sensor(channel="x", body="m", quantity="displacement"), Sensor(channel="v", body="m", quantity="velocity"))


def swung(model: RigModel, peak: float, *, rate: float = 8192.0, seconds: float = 4.0) -> Trace:
    """The model with a sine force of 1 Hz and a smooth start, linear between the samples."""
    t = np.arange(round(seconds * rate)) / rate
    drive = peak * np.sin(2.0 * np.pi * t) * np.minimum(t, 1.0)
    return trace(model, Excitation.prepare(drive, rate, oversample=1))


def contacts_figure() -> Figure:
    """Force over velocity, and over displacement for laws with memory."""
    figure = Figure(figsize=(10.0, 7.0), layout="constrained")
    for ax, (name, law) in zip(figure.subplots(3, 4, squeeze=True).flat, CONTACTS.items(), strict=False):
        found = swung(rubbed(law), 28.0)
        x, v, f = found.response.channels["x"], found.response.channels["v"], found.friction["rubbing"]
        last = slice(2 * 8192, None)
        if isinstance(law, laws.Dahl | laws.LuGre):
            ax.plot(1e3 * x[last], f[last], lw=1.0)
            ax.set(xlabel="displacement, mm")
        else:
            ax.plot(v[last], f[last], lw=1.0)
            ax.set(xlabel="velocity, m/s")
        ax.set(title=name, ylabel="force, N")
        ax.grid(alpha=0.3)
    for ax in figure.axes[len(CONTACTS) :]:
        ax.remove()
    return figure


def links_figure() -> Figure:
    """Force of a spring with each law over its elongation (over velocity for damping), compared with the linear spring."""
    figure = Figure(figsize=(10.0, 5.0), layout="constrained")
    for ax, (name, law) in zip(figure.subplots(2, 4).flat, LINKS.items(), strict=False):
        found = swung(sprung(law), 16.0)
        x, v, f = found.response.channels["x"], found.response.channels["v"], found.transmitted["spring"]
        fast = isinstance(law, laws.QuadraticDamping)
        elastic = f - 500.0 * x if fast else f - 2.0 * v
        place = v if fast else 1e3 * x
        ax.plot(place, elastic, lw=1.0)
        ax.plot(place, 2.0 * v if fast else 500.0 * x, "--", lw=0.8, color="0.5")
        ax.set(title=name, xlabel="velocity, m/s" if fast else "elongation, mm", ylabel="force, N")
        ax.grid(alpha=0.3)
    figure.axes[-1].remove()
    return figure


def pulse(length: float = PULSE) -> FloatArray:
    """The thesis's half sine of 500 N, at `RATE`."""
    return half_sine(samples=round(SECONDS * RATE), sample_rate=RATE, peak=PEAK, length=length, start=START)


def struck(model: RigModel, length: float = PULSE) -> Trace:
    """A rig with that half sine as its drive."""
    return trace(model, Excitation.prepare(pulse(length), RATE))


def reversals(friction: FloatArray, least: float = 1.0) -> int:
    """Number of sign changes of a friction force above `least` (N)."""
    signs = np.sign(friction[np.abs(friction) > least])
    return int(np.count_nonzero(np.diff(signs)))


def one_mass_figure(friction: float) -> Figure:
    """Fig. 7 and 8: displacement, and the friction force with the sticking intervals."""
    return _figure(one_mass(friction=friction))


def two_mass_figure() -> Figure:
    """Fig. 10."""
    return _figure(two_mass())


def _figure(model: RigModel) -> Figure:
    found = struck(model)
    t = np.arange(round(SECONDS * RATE)) / RATE
    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    for name, x in found.response.channels.items():
        above.plot(t, 1e3 * x, lw=1.1, label=name)
    below.plot(t, found.friction["isolation"], lw=1.0, color="tab:red", label="friction")
    below.fill_between(
        t, 0.0, 1.0, where=found.held["isolation"] > 0.5, transform=below.get_xaxis_transform(), alpha=0.15, color="0.3",
        label="held",
    )  # fmt: skip
    above.set(ylabel="displacement, mm")
    below.set(ylabel="friction, N", xlabel="time, s")
    for ax in (above, below):
        ax.legend(fontsize=8)
        ax.grid(alpha=0.3)
    return figure


def literal(
    velocity: Literal["relative", "own"], model: RigModel | None = None, *, holding: Literal["body", "contact"] = "body",
    length: float = LITERAL_PULSE,
) -> LiteralRun:  # fmt: skip
    """The thesis's integration of a rig (its three masses) under the half sine; see `thesis.printed_law`."""
    return literal_run(model or three_mass(), pulse(length), RATE, velocity=velocity, holding=holding)


def literal_figure(velocity: Literal["relative", "own"]) -> Figure:
    """Fig. 12 and 13: friction by the thesis's law and solver, compared with located stick and slip events."""
    found, right = literal(velocity), struck(three_mass(), LITERAL_PULSE)
    t = np.arange(round(SECONDS * RATE)) / RATE
    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    slip = right.response.channels["motor"] - right.response.channels["table"]
    above.plot(t, 1e3 * (found.states[:, 2] - found.states[:, 0]), lw=1.1, label=f"thesis's law, {velocity} velocity")
    above.plot(t, 1e3 * slip, "--", lw=1.0, label="located stick and slip")
    below.plot(t, found.friction, lw=0.6, label=f"thesis's law, {velocity} velocity")
    below.plot(t, right.friction["isolation"], lw=1.0, label="located stick and slip")
    above.set(ylabel="motor relative to table, mm")
    below.set(ylabel="friction, N", xlabel="time, s")
    for ax in (above, below):
        ax.legend(fontsize=8)
        ax.grid(alpha=0.3)
    return figure


PICTURES: dict[str, Callable[[], Figure]] = {
    "laws": contacts_figure,
    "links": links_figure,
    "fig7": lambda: one_mass_figure(200.0),
    "fig8": lambda: one_mass_figure(20.0),
    "fig10": two_mass_figure,
    "fig12": lambda: literal_figure("relative"),
    "fig13": lambda: literal_figure("own"),
}


def main() -> None:
    """Write the figures."""
    folder = Path(sys.argv[1]) if len(sys.argv) == 2 else Path("docs")
    for name, draw in PICTURES.items():
        path = folder / "pictures" / f"friction-{name}.png"
        save(draw(), path)
        print(path)


if __name__ == "__main__":
    main()
