"""The built-in rigs: the wire bonder and the thesis's one-, two- and three-mass rigs."""

from collections.abc import Callable, Mapping

from isorig.analysis.errors import ModelError
from isorig.analysis.given import flag, given_mapping, number
from isorig.analysis.laws import Coulomb
from isorig.analysis.model.rig_model import GROUND, Body, Configuration, Contact, Drive, RigModel, Sensor
from isorig.analysis.model.spring import spring

#: The links to what the bodies are mounted on.
LINKS = {"table": "table", "heatblock": "heatblock", "motor": "isolation"}
FREE = ("bodies.table.mass", *(f"links.{link}.{key}" for link in LINKS.values() for key in ("stiffness", "damping")))
FRICTION = "contacts.isolation.law.friction_force"

#: The rig in words, for the reports of recordings without a description.
SUMMARY = (
    "The motor of a wire bonder is mounted on springs and bearings on the machine's table; its head pushes it one way and moves "
    "the other. Unlocked, the motor recoils on its springs; locked, it is clamped to the table. The vibration of the heatblock "
    "on the table must be small. Accelerometers are mounted on head, motor, table and heatblock."
)

#: Table 4 of the thesis, the breakaway force of its gauge, and an assumed head (see docs/thesis.md).
THESIS: Mapping[str, float] = {
    "head_mass": 6.5,
    "table_mass": 80.0, "table_frequency": 10.8, "table_damping": 0.015,
    "heatblock_mass": 6.0, "heatblock_frequency": 164.5, "heatblock_damping": 0.009,
    "motor_mass": 16.4, "motor_frequency": 5.06, "motor_damping": 0.073,
    "friction_force": 20.0,
}  # fmt: skip


def wire_bonder(values: Mapping[str, float] = THESIS, *, friction: bool = True) -> RigModel:
    """Table on ground, heatblock and isolated motor on the table, dry friction between motor and table.

    Parameters
    ----------
    values
        The names of `THESIS`: masses in kg, uncoupled frequencies in Hz, damping ratios, friction force in N.
    friction
        Whether there is a contact between motor and table.

    Raises
    ------
    ArgumentError
        The values are of another type.
    ModelError
        One of them is missing, or contradicts physics.

    Examples
    --------
    >>> import isorig as iso
    >>> iso.wire_bonder().contacts[0].law
    Coulomb(friction_force=20.0, static_force=None)
    >>> iso.wire_bonder(friction=False).contacts
    ()
    """
    given_mapping(values, "the argument values", 'a mapping; give one, for example {**THESIS, "friction_force": 12.0}')
    flag(friction, "the argument friction")
    for name in THESIS:
        if name not in values and (friction or name != "friction_force"):
            raise ModelError(f"the values of the wire bonder lack {name!r}, but it needs {', '.join(THESIS)}; add it")
        number(values.get(name, 0.0), f"the value {name}")
    return _mounted(
        "wire bonder",
        {body: (values[f"{body}_mass"], values[f"{body}_frequency"], values[f"{body}_damping"]) for body in LINKS},
        values["friction_force"] if friction else None,
        drive=Drive(channel="head", factor=values["head_mass"], pushes={"motor": -1.0}),
        sensors=tuple(Sensor(channel=body, body=body) for body in ("motor", "table", "heatblock")),
        free=(*FREE, FRICTION) if friction else FREE,
    )


def one_mass(*, friction: float = 20.0) -> RigModel:
    """The thesis's first step (Fig. 6-8): 5 Hz and 0.25 with friction to ground; the mass of 15 kg is from the next step."""
    return _early("one mass", {"motor": (15.0, 5.0, 0.25)}, friction)


def two_mass() -> RigModel:
    """The thesis's second step (Fig. 9-10): 300 kg at 10 Hz and 0.25 to ground, on it 15 kg at 5 Hz and 0.25 with friction."""
    return _early("two masses", {"table": (300.0, 10.0, 0.25), "motor": (15.0, 5.0, 0.25)})


def three_mass() -> RigModel:
    """The thesis's third step (Fig. 11-13): as `two_mass`, and a heatblock of 15 kg at 166 Hz and 0.05 on the table."""
    bodies = {"table": (300.0, 10.0, 0.25), "heatblock": (15.0, 166.0, 0.05), "motor": (15.0, 5.0, 0.25)}
    return _early("three masses", bodies)


def _early(name: str, bodies: Mapping[str, tuple[float, float, float]], friction: float = 20.0) -> RigModel:
    return _mounted(
        name, bodies, friction,
        drive=Drive(channel="force", factor=1.0, pushes={"motor": 1.0}, quantity="force"),
        sensors=tuple(Sensor(channel=body, body=body, quantity="displacement") for body in bodies),
    )  # fmt: skip


def _mounted(
    name: str, bodies: Mapping[str, tuple[float, float, float]], friction: float | None, *, drive: Drive,
    sensors: tuple[Sensor, ...], free: tuple[str, ...] = (),
) -> RigModel:  # fmt: skip
    # Mass, uncoupled frequency and damping ratio by body: on the table, if there is one. Friction at the motor, if any.
    base = {body: "table" if body != "table" and "table" in bodies else GROUND for body in bodies}
    links = tuple(
        spring(LINKS[body], body, base[body], mass=mass, frequency=frequency, damping_ratio=ratio)
        for body, (mass, frequency, ratio) in bodies.items()
    )
    contacts: tuple[Contact, ...] = ()
    if friction is not None:
        contacts = (Contact(name="isolation", a="motor", b=base["motor"], law=Coulomb(friction_force=friction)),)
    return RigModel(
        name=name, bodies=tuple(Body(name=body, mass=mass) for body, (mass, _, _) in bodies.items()), links=links,
        contacts=contacts, drive=drive, sensors=sensors, free=free,
        configurations={"unlocked": Configuration(), "locked": Configuration(rigid=("isolation",))},
    )  # fmt: skip


#: The built-in rigs by their names in commands.
BUILT_IN: Mapping[str, Callable[[], RigModel]] = {
    "wire-bonder": wire_bonder, "one-mass": one_mass, "two-mass": two_mass, "three-mass": three_mass,
}  # fmt: skip
