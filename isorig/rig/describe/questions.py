"""Questions about a rig, and the model from the answers."""

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import TypeVar, get_args

import msgspec

from isorig.analysis.campaign import MOTION, ROTARY, SI_UNIT, Quantity
from isorig.analysis.errors import ModelError
from isorig.analysis.laws import Coulomb
from isorig.analysis.model.rig_model import GROUND, Body, Contact, Drive, Link, RigModel, Sensor
from isorig.analysis.model.spring import spring
from isorig.rig.errors import PlanError

Ask = Callable[[str], str]
T = TypeVar("T")
#: Maximum number of unusable answers to a question, so that a script with wrong answers ends.
TRIES = 5
NUMBER = r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?"


@dataclass
class _Parts:
    bodies: dict[str, Body]
    links: list[Link] = field(default_factory=list)
    contacts: list[Contact] = field(default_factory=list)
    sensors: list[Sensor] = field(default_factory=list)


def asked(ask: Ask) -> RigModel:
    """Ask for a rig with `ask`, which shows a question and returns the answer's line as `input` does; the model from the answers.

    Raises PlanError if the answers end too early, or a question has no usable answer after `TRIES` tries.
    """
    print("Press Enter alone to accept the answer in [brackets]. SI units: kg, N/m, Hz, s.\n")
    name = _answer(ask, "What is the rig called? [rig] ", lambda text: text or "rig")
    parts = _Parts(_answer(
        ask, "Its moving bodies, each with its mass in kg, or its moment of inertia in kg m2 if it turns\n"
        "  (e.g.: frame 40 kg, stage 2 kg, rotor 0.02 kg m2): ", _bodies,
    ))  # fmt: skip
    for body in parts.bodies.values():
        _joints(ask, parts, body)
    drive = _answer(
        ask, "Its drive: channel, quantity, driven body, and force per unit if the quantity is not a force\n"
        "  (e.g.: hammer force frame / u voltage stage 4): ", lambda text: _drive(text, parts.bodies),
    )  # fmt: skip
    question = "A sensor: channel, body, quantity (e.g.: a1 frame acceleration)"
    parts.sensors.append(_answer(ask, f"{question}: ", lambda text: _sensor(text, parts)))
    while sensor := _answer(ask, f"{question} (Enter: no further sensor): ", lambda text: text and _sensor(text, parts)):
        parts.sensors.append(sensor)
    masses = _answer(ask, "Bodies with unknown mass, which is fitted [none]: ", lambda text: _names(text, parts.bodies))
    known_factor = drive.quantity in ("force", "torque") or _answer(
        ask, "Is the drive's factor known? y/n [n] ", lambda text: text.lower().startswith("y")
    )
    free = [f"links.{link.name}.{key}" for link in parts.links for key in ("stiffness", "damping") if getattr(link, key)]
    free += [f"contacts.{contact.name}.law.friction_force" for contact in parts.contacts]
    free += [f"bodies.{body}.mass" for body in masses] + ([] if known_factor else ["drive.factor"])
    try:
        return RigModel(
            name=name, bodies=tuple(parts.bodies.values()), links=tuple(parts.links), contacts=tuple(parts.contacts),
            drive=drive, sensors=tuple(parts.sensors), free=tuple(free),
        )  # fmt: skip
    except ModelError as error:
        raise PlanError(f"these answers do not describe a rig: {error}; run rig describe --new again") from None


def _answer(ask: Ask, question: str, use: Callable[[str], T]) -> T:
    for _ in range(TRIES):
        try:
            return use(ask(question).strip())
        except EOFError:
            raise PlanError(f"the answers end before the question {_first_line(question)}; answer all of them") from None
        except (PlanError, ModelError) as error:
            print(f"  {error}")
    raise PlanError(f"the question {_first_line(question)} has no usable answer after {TRIES} tries; nothing was written")


def _first_line(question: str) -> str:
    return repr(question.strip().partition("\n")[0])


def _bodies(text: str) -> dict[str, Body]:
    found: dict[str, Body] = {}
    for part in text.split(","):
        match = re.fullmatch(rf"\s*(\w+)\s+({NUMBER})\s*(kg)?\s*(m\^?2|m²)?\s*", part)
        if match is None:
            raise PlanError(f"{part.strip()!r} is not a body with its mass; write for example frame 40 kg, stage 2 kg")
        if match[1] in found or match[1] == GROUND:
            raise PlanError(f"the name {match[1]!r} is already used; give each body another name")
        body = Body(name=match[1], mass=float(match[2]), motion="rotation" if match[4] else "straight")
        if not body.mass > 0.0:
            raise PlanError(f"{body.name} has mass {body.mass:g}; give one above zero")
        found[body.name] = body
    return found


def _joints(ask: Ask, parts: _Parts, body: Body) -> None:
    earlier = [GROUND, *(name for name in parts.bodies if name != body.name)]
    question = f"What is {body.name} joined to ({', '.join(earlier)})?"
    base = _answer(ask, f"{question} [ground] ", lambda text: _one_of(text or GROUND, earlier))
    while base:
        _joint(ask, parts, body, base)
        base = _answer(ask, f"{question} [no further joint] ", lambda text: text and _one_of(text, earlier))


def _joint(ask: Ask, parts: _Parts, body: Body, base: str) -> None:
    name = body.name if base == GROUND else f"{body.name}_{base}"
    while any(link.name == name for link in parts.links):
        name += "_2"
    stiff, damper, friction, example = ("N/m", "N s/m", "N", "25000")
    if body.motion == "rotation":
        stiff, damper, friction, example = ("N m/rad", "N m s/rad", "N m", "12")
    sprung = _answer(
        ask, f"The spring between {body.name} and {base}: its stiffness in {stiff}, or the frequency of {body.name} on it "
        f"(e.g.: {example} / 5.1 Hz / none): ", lambda text: _spring(text, name, body, base),
    )  # fmt: skip
    usual, what = "0", f"Its damper in {damper}"
    if sprung.stiffness:
        usual, what = "0.02", f"Its damping ratio, or its damper in {damper} (e.g.: 0.02 / 30 {damper})"
    link = _answer(ask, f"{what} [{usual}] ", lambda text: _damped(text or usual, sprung, body))
    if link.stiffness or link.damping:
        parts.links.append(link)
    force = _answer(ask, f"Dry friction there, in {friction} [0] ", lambda text: _number(text or "0"))
    if force > 0.0:
        parts.contacts.append(Contact(name=name, a=body.name, b=base, law=Coulomb(friction_force=force)))
    if not (link.stiffness or link.damping or force):
        print(f"  {body.name} is not joined to {base}.")


def _one_of(name: str, names: Collection[str]) -> str:
    if name not in names:
        raise PlanError(f"{name!r} is unknown; allowed are {', '.join(names)}")
    return name


def _number(text: str) -> float:
    match = re.match(NUMBER, text)
    if match is None or float(match[0]) < 0.0:
        raise PlanError(f"{text!r} is not a number of zero or more; write for example 25000")
    return float(match[0])


def _spring(text: str, name: str, body: Body, base: str) -> Link:
    if text.lower() in ("none", "no", "0"):
        return Link(name=name, a=body.name, b=base)
    value = _number(text)
    if text.lower().rstrip().endswith("hz"):
        return spring(name, body.name, base, mass=body.mass, frequency=value, damping_ratio=0.0)
    return Link(name=name, a=body.name, b=base, stiffness=value)


def _damped(text: str, link: Link, body: Body) -> Link:
    value = _number(text)
    per = re.fullmatch(NUMBER, text.strip())
    if per and value < 1.0 and link.stiffness:
        value = 2.0 * value * (link.stiffness * body.mass) ** 0.5
    return msgspec.structs.replace(link, damping=value)


def _quantity(text: str) -> Quantity:
    allowed = get_args(Quantity)
    if text not in allowed:
        raise PlanError(f"{text!r} is not a quantity; give one of {', '.join(name for name in allowed if name != 'gain')}")
    return text  # type: ignore[return-value]


def _drive(text: str, bodies: Mapping[str, Body]) -> Drive:
    words = text.split()
    if len(words) not in (3, 4):
        raise PlanError(
            "give channel, quantity and body, and the newtons per unit of any other quantity than a force: u voltage stage 4"
        )
    channel, quantity, body = words[0], _quantity(words[1]), _one_of(words[2], bodies)
    own = quantity in ("force", "torque")
    if not own and len(words) == 3:
        raise PlanError(f"a {quantity} is not a force; add the newtons per {SI_UNIT[quantity]}, at least as a first guess")
    factor = _number(words[3]) if len(words) == 4 else 1.0
    return Drive(channel=channel, quantity=quantity, factor=factor, pushes={body: 1.0})


def _sensor(text: str, parts: _Parts) -> Sensor:
    words = text.split()
    if len(words) != 3:
        raise PlanError("give channel, body and quantity, for example x1 stage displacement")
    if any(sensor.channel == words[0] for sensor in parts.sensors):
        raise PlanError(f"the channel {words[0]!r} is already used; give each sensor another channel")
    quantity, body = _quantity(words[2]), _one_of(words[1], parts.bodies)
    if quantity not in MOTION:
        raise PlanError(f"a {quantity} is not a motion of a body; give one of {', '.join(MOTION)}")
    if quantity in ROTARY and parts.bodies[body].motion == "straight":
        raise PlanError(f"{body} moves in a straight line and has no {quantity}; give displacement, velocity or acceleration")
    return Sensor(channel=words[0], body=body, quantity=quantity)


def _names(text: str, bodies: Mapping[str, Body]) -> list[str]:
    names = [] if text.lower() in ("", "none") else re.split(r"[\s,]+", text)
    return [_one_of(name, bodies) for name in names]
