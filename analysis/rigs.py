"""The built-in rigs: the wire bonder and the thesis's one-, two- and three-mass rigs, as values."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi

from analysis.errors import ModelError
from analysis.laws import Coulomb
from analysis.model import Body, Configuration, Contact, Drive, Link, RigModel, Sensor

FREE = (
    "bodies.table.mass",
    "links.table.stiffness",
    "links.table.damping",
    "links.heatblock.stiffness",
    "links.heatblock.damping",
    "links.isolation.stiffness",
    "links.isolation.damping",
)
FRICTION = "contacts.isolation.law.friction_force"

#: Table 4 of the thesis, the breakaway force of its gauge, and an assumed head (see docs/thesis.md).
THESIS: Mapping[str, float] = {
    "head_mass": 6.5,
    "table_mass": 80.0, "table_frequency": 10.8, "table_damping": 0.015,
    "heatblock_mass": 6.0, "heatblock_frequency": 164.5, "heatblock_damping": 0.009,
    "motor_mass": 16.4, "motor_frequency": 5.06, "motor_damping": 0.073,
    "friction_force": 20.0,
}  # fmt: skip


def spring(name: str, a: str, b: str, *, mass: float, frequency: float, damping_ratio: float) -> Link:
    """A link from the uncoupled figures: k = (2 pi f)^2 m, c = 2 zeta sqrt(k m) (thesis, Eq. 1-3)."""
    if mass <= 0.0 or frequency < 0.0 or damping_ratio < 0.0:
        raise ModelError(
            f"link {name!r}: mass {mass:g} kg, frequency {frequency:g} Hz and damping ratio {damping_ratio:g} "
            "must be positive; correct the negative one"
        )
    omega = 2.0 * pi * frequency
    return Link(name=name, a=a, b=b, stiffness=omega**2 * mass, damping=2.0 * damping_ratio * omega * mass)


def wire_bonder(values: Mapping[str, float] = THESIS, *, friction: bool = True) -> RigModel:
    """Table on ground, heatblock and isolated motor on the table, dry friction between motor and table.

    Parameters
    ----------
    values
        The names of `THESIS`: masses in kg, uncoupled frequencies in Hz, damping ratios, friction force in N.
    friction
        Whether the contact between motor and table is there at all.
    """
    bodies = ("table", "heatblock", "motor")
    links = tuple(
        spring(
            "isolation" if body == "motor" else body,
            body,
            "ground" if body == "table" else "table",
            mass=values[f"{body}_mass"],
            frequency=values[f"{body}_frequency"],
            damping_ratio=values[f"{body}_damping"],
        )
        for body in bodies
    )
    contacts = (
        (Contact(name="isolation", a="motor", b="table", law=Coulomb(friction_force=values["friction_force"])),)
        if friction
        else ()
    )
    return RigModel(
        name="wire bonder",
        bodies=tuple(Body(name=body, mass=values[f"{body}_mass"]) for body in bodies),
        links=links,
        contacts=contacts,
        drive=Drive(channel="head", factor=values["head_mass"], pushes={"motor": -1.0}),
        sensors=tuple(Sensor(channel=body, body=body) for body in ("motor", "table", "heatblock")),
        configurations={"unlocked": Configuration(), "locked": Configuration(rigid=("isolation",))},
        free=(*FREE, FRICTION) if friction else FREE,
    )
