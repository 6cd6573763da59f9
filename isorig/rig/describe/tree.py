"""Drawing of a rig in the terminal: bodies, joints, drives and sensors, and which values are known."""

from __future__ import annotations

from rich.tree import Tree

from isorig.analysis.campaign import SI_UNIT
from isorig.analysis.model.parameter_units import factor_unit, unit_of
from isorig.analysis.model.rig_model import GROUND, Contact, Link, RigModel
from isorig.rig.files.tomlfile import plain


def drawn(model: RigModel) -> Tree:
    """The rig as a tree from the ground: springs, dampers and contacts with their values, bodies with drive and sensors.

    A joint between two bodies that are already in the tree is shown at one of them, with an arrow to the other.
    """
    tree = Tree("ground (fixed)", highlight=False)
    places = {GROUND: tree}
    left: list[Link | Contact] = [*model.links, *model.contacts]
    waiting = [body.name for body in model.bodies]
    while left:
        joint = next((one for one in left if one.a in places or one.b in places), None)
        if joint is None:  # a body that no joint connects to the ground
            name = next(name for name in waiting if name not in places)
            places[name] = Tree(_body(model, name), highlight=False)
            tree.add(places[name])
            continue
        left.remove(joint)
        near, far = (joint.b, joint.a) if joint.b in places else (joint.a, joint.b)
        branch = places[near].add(_joint(model, joint))
        if far in places:
            branch.label = f"{branch.label} → {far}"
        else:
            places[far] = branch.add(_body(model, far))
    for name in waiting:
        if name not in places:
            tree.add(_body(model, name))
    for sensor in model.sensors:
        if sensor.force_in is not None:
            tree.add(f"● {sensor.channel}: {sensor.quantity} in {sensor.force_in}, {SI_UNIT[sensor.quantity]}")
    return tree


def _body(model: RigModel, name: str) -> str:
    lines = [f"[{name}] {_number(model, f'bodies.{name}.mass')}"]
    for drive in model.drives:
        quantity = f"{drive.channel}: {drive.quantity.replace('_', ' ')}, {SI_UNIT[drive.quantity]}"
        if drive.imposes == name:
            lines.append(f"  ◄ motion imposed by {quantity}")
        if name in drive.pushes:
            unit = factor_unit(model, drive)
            free = " ?" if drive is model.drive and "drive.factor" in model.free else ""
            factor = f"{drive.factor:.4g}{'' if unit == '1' else f' {unit}'}{free}"
            parts = [part for part in (f"{drive.pushes[name]:g}", factor) if part != "1"]
            lines.append(f"  ◄ pushed by {' × '.join([*parts, quantity])}")
    for sensor in model.sensors:
        if sensor.body == name:
            base = "" if sensor.relative_to == GROUND else f" relative to {sensor.relative_to}"
            lines.append(f"  ● {sensor.channel}: {sensor.quantity.replace('_', ' ')}{base}, {SI_UNIT[sensor.quantity]}")
    return "\n".join(lines).replace("[", r"\[")


def _joint(model: RigModel, joint: Link | Contact) -> str:
    if isinstance(joint, Contact):
        said = [_law(model, joint.law, f"contacts.{joint.name}.law")]
        sign = "≈"
    else:
        keys = {"stiffness": "spring", "damping": "damper"}
        said = [f"{word} {_number(model, f'links.{joint.name}.{key}')}" for key, word in keys.items() if getattr(joint, key)]
        said += [_law(model, law, f"links.{joint.name}.laws.{k}") for k, law in enumerate(joint.laws)]
        sign = "⌇"
    arms = [f"{factor:+g} × {name}" for name, factor in joint.arms.items()]
    acts = f" (on {joint.a} − {joint.b} {' '.join(arms)})" if arms else ""
    return f"{sign} {joint.name}: {', '.join(said) or 'nothing'}{acts}".replace("[", r"\[")


def _law(model: RigModel, law: object, path: str) -> str:
    tree = plain(law)
    name = str(tree.pop("law"))
    values = [
        f"{key.replace('_', ' ')} {_number(model, f'{path}.{key}')}" if isinstance(value, float) else key
        for key, value in tree.items()
    ]
    return f"{name.replace('_', ' ')} ({', '.join(values)})"


def _number(model: RigModel, path: str) -> str:
    unit = unit_of(path, model)
    return f"{model.get(path):.4g}{'' if unit == '1' else f' {unit}'}{' ?' if path in model.free else ''}"
