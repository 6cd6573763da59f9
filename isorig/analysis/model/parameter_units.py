"""The parameters of a model by their path, and their units."""

import re

from isorig.analysis.campaign import SI_UNIT
from isorig.analysis.laws import LAWS, Law
from isorig.analysis.model.rig_model import GROUND, Drive, RigModel

#: Of the parts of a rig other than laws, and of every law's parameters.
UNITS = {
    "mass": "kg", "factor": "kg", "stiffness": "N/m", "damping": "N s/m", "lock_stiffness": "N/m", "lock_damping": "N s/m",
    "delay": "s", "lag": "s", "limit": "m/s^2", **{name: p.unit for law in LAWS for name, p in law.parameters.items()},
}  # fmt: skip
#: The same for a rotating part, factor by factor: moment of inertia, torque, angle.
ROTATIONAL = {"kg": "kg m^2", "N": "N m", "m": "rad"}


def unit_of(path: str, model: RigModel | None = None) -> str:
    """SI unit of the parameter at a dotted path; "1" if it has none.

    With a model, rotating parts have the units of a rotation, and the drive's factor has the unit that follows from its channel.
    """
    *way, last = path.split(".")
    while last.isdigit() and way:  # a point of a curve
        *way, last = way
    unit = UNITS.get(last, "1")
    if model is None or not way:
        return unit
    if path == "drive.factor":
        return factor_unit(model, model.drive)
    if path.startswith(("drive.limit", "drive.curve")):
        return SI_UNIT[model.drive.quantity]
    if last in ("offset", "limit", "gain", "bend") and "chain" in way:
        channel = model.drive if way[0] == "drive" else model.sensor(way[1])
        return "1" if last == "gain" else SI_UNIT[channel.quantity]
    turns = {body.name for body in model.bodies if body.motion == "rotation"}
    if way[0] in ("bodies", "links", "contacts"):
        name = way[1]
        if way[0] == "bodies":
            part = name
        else:
            joint = model.link(name) if way[0] == "links" else model.contact(name)
            part = joint.a if joint.a != GROUND else joint.b
        if part in turns:
            return rotational(unit)
    return unit


def rotational(unit: str) -> str:
    """The unit of the same parameter of a rotating part: N m/rad for N/m."""
    return re.sub(r"[A-Za-z]+", lambda found: ROTATIONAL.get(found[0], found[0]), unit)


def factor_unit(model: RigModel, drive: Drive) -> str:
    """Unit of a drive's factor: force (or torque) per unit of its channel."""
    turns = bool(drive.pushes) and all(model.body(name).motion == "rotation" for name in drive.pushes)
    if drive.quantity == ("torque" if turns else "force"):
        return "1"
    if drive.quantity == "acceleration" and not turns:
        return "kg"
    per = SI_UNIT[drive.quantity]
    return f"{'N m' if turns else 'N'}/{f'({per})' if ' ' in per or '/' in per else per}"


def physical_parameters(model: RigModel) -> tuple[str, ...]:
    """Paths of masses, stiffnesses, dampings, the numbers of laws and the drive's factor; without those that are absent."""
    paths = [f"bodies.{body.name}.mass" for body in model.bodies]
    for link in model.links:
        paths += [f"links.{link.name}.{key}" for key in ("stiffness", "damping") if getattr(link, key)]
        paths += [path for k, law in enumerate(link.laws) for path in _numbers(law, f"links.{link.name}.laws.{k}")]
    for contact in model.contacts:
        paths += _numbers(contact.law, f"contacts.{contact.name}.law")
    return tuple(paths if model.drive.imposes is not None else [*paths, "drive.factor"])


def _numbers(law: Law, path: str) -> list[str]:
    return [f"{path}.{name}" for name in law.__struct_fields__ if isinstance(getattr(law, name), float)]
