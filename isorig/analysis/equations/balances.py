"""The equations of motion that a rig's description and its sensors support."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.equations.motion import Combinations, estimate_of
from isorig.analysis.model.linear import ROUNDED, floats, moving_together
from isorig.analysis.model.rig_model import Contact, Link, RigModel, weights_of

#: Up to this number of bodies all sets of bodies are considered, above it the single bodies and what lies beyond each link.
ALL_SETS = 10


@dataclass(frozen=True, kw_only=True)
class Element:
    """A link, a contact, or both between the same two ends: one elongation, and the force over it."""

    #: Its parts; None if it has none of them.
    link: Link | None
    contact: Contact | None
    weights: FloatArray  #: Of the coordinates in its elongation, shape (bodies,).
    #: The name of the link, or else of the contact; "friction of" it where a link between other ends has the same name.
    name: str

    @property
    def names(self) -> frozenset[str]:
        """The names under which causes have their place here."""
        return frozenset(part.name for part in (self.link, self.contact) if part is not None)

    def has_ends_of(self, other: Element) -> bool:
        """Whether it lies between the same ends as another one: their motion is one, and only the sum of their forces shows."""
        return other.name != self.name and _parallel(self.weights, other.weights)


def elements(model: RigModel) -> tuple[Element, ...]:
    """The rig's elements: contacts are joined with the link between the same ends."""
    found: list[Element] = []
    free = list(model.contacts)
    for link in model.links:
        weights = weights_of(model, link)
        mate = next((c for c in free if _parallel(weights_of(model, c), weights)), None)
        if mate is not None and not any(f.contact is mate for f in found):
            free.remove(mate)
            found.append(Element(link=link, contact=mate, weights=weights, name=link.name))
        else:
            found.append(Element(link=link, contact=None, weights=weights, name=link.name))
    taken = {link.name for link in model.links}
    for contact in free:
        name = f"friction of {contact.name}" if contact.name in taken else contact.name
        weights = weights_of(model, contact)
        found.append(Element(link=None, contact=contact, weights=weights, name=name))
    return tuple(found)


def _parallel(a: FloatArray, b: FloatArray) -> bool:
    return bool(np.array_equal(a, b) or np.array_equal(a, -b))


@dataclass(frozen=True, kw_only=True)
class Balance:
    """An equation: the drive and the inertia of a set of bodies equal the forces of the elements that join them to the others."""

    #: The set: each body with the weight of its inertia, one unless a gear or a lever joins it to the others.
    weights: Mapping[str, float]
    #: The elements whose forces act on the set, with the sign of the force (weight of the element's force in the equation).
    crossing: tuple[tuple[Element, float], ...]
    pushes: Mapping[str, float]  #: Weight of each drive's force on the set, by channel; only the drives that push it.
    configurations: tuple[str, ...]  #: The configurations in which it holds.
    #: Channels of force sensors whose force acts on the set, with its sign.
    forces: Mapping[str, float] = field(default_factory=dict)

    @property
    def bodies(self) -> tuple[str, ...]:
        """The set."""
        return tuple(self.weights)

    @property
    def name(self) -> str:
        """What it sums up, for messages."""
        return " + ".join(self.bodies) if self.bodies else f"force in {self.crossing[0][0].name}"

    @property
    def rubs(self) -> bool:
        """Whether a contact acts on the set."""
        return any(element.contact is not None for element, _ in self.crossing)

    def contains(self, element: Element) -> bool:
        """Whether the element's force is in the equation."""
        return any(other.name == element.name for other, _ in self.crossing)

    def others(self, element: Element) -> tuple[tuple[Element, float], ...]:
        """The elements besides one, with their signs."""
        return tuple((other, sign) for other, sign in self.crossing if other.name != element.name)


@dataclass(frozen=True, kw_only=True)
class Lock:
    """The equation of a rigid link: its ends move alike. With an elastic lock they differ by its force over its stiffness."""

    element: Element  #: The element that is rigid, or whose contact sticks.
    configuration: str  #: The configuration in which it is rigid.
    #: A balance that contains only this element's force while it is free: it gives the force of the lock; None if there is none.
    beyond: Balance | None

    @property
    def name(self) -> str:
        """What it states, for messages."""
        return f"lock of {self.element.name}"


def balances(model: RigModel, combos: Combinations | None = None) -> tuple[Balance, ...]:
    """The equations that the sensors support: for each element and each body the one with the fewest elements.

    Where no spring holds the rig, also that of all bodies: a slow motion hardly strains the joints between them, and the sensors'
    noise is most of their elongations.

    A set of bodies gives an equation if all their accelerations are measured, and the elongations of all elements that act on it.
    An equation of bodies whose motion is estimated alone would repeat the estimate.
    """
    combos = combos or Combinations(model)
    parts = elements(model)
    known = [body for body in combos.measured if body not in model.imposed]
    index = {body.name: k for k, body in enumerate(model.bodies)}
    measured = {part.name: combos.of(part.weights, 0) is not None for part in parts}
    pushed = {body for drive in model.drives for body in drive.pushes}
    found: list[Balance] = []
    for bodies in _sets(known):
        y = moving_together(model, bodies, next((name for name in bodies if name in pushed), bodies[0]))
        crossing = tuple((part, sign) for part in parts if abs(sign := float(y @ part.weights)) > ROUNDED)
        if not crossing or any(not measured[part.name] for part, _ in crossing) or set(bodies) <= set(combos.estimated):
            continue
        if not _connected(model, bodies):
            continue
        valid = tuple(
            name
            for name, setup in model.configurations.items()
            if not any(part.link and part.link.name in setup.rigid for part, _ in crossing)
        )
        if not valid:
            continue
        pushes = {
            drive.channel: float(sum(weight * y[index[body]] for body, weight in drive.pushes.items())) for drive in model.drives
        }
        found.append(
            Balance(
                weights={name: float(y[index[name]]) for name in bodies}, crossing=crossing, configurations=valid,
                pushes={channel: weight for channel, weight in pushes.items() if weight != 0.0},
            )
        )  # fmt: skip
    return (*_chosen(found, parts, known, combos), *_gauged(model, parts, measured))


def _gauged(model: RigModel, parts: Sequence[Element], measured: Mapping[str, bool]) -> list[Balance]:
    # The equations of force sensors: in a link, or in the actuator that imposes a motion.
    found = []
    for sensor in model.sensors:
        what, _, name = (sensor.force_in or "").partition(".")
        if what == "links":
            crossing = tuple((part, 1.0) for part in parts if part.link is not None and part.link.name == name)
            bodies: tuple[str, ...] = ()
        elif what == "drive":
            (body,) = (drive.imposes for drive in model.drives if drive.channel == name)
            k = next(k for k, other in enumerate(model.bodies) if other.name == body)
            crossing = tuple((part, float(part.weights[k])) for part in parts if part.weights[k] != 0.0)
            bodies = (body,) if body else ()
        else:
            continue
        free = tuple(
            name
            for name, setup in model.configurations.items()
            if not any(part.link is not None and part.link.name in setup.rigid for part, _ in crossing)
        )
        if crossing and free and all(measured[part.name] for part, _ in crossing):
            weights = dict.fromkeys(bodies, 1.0)
            found.append(
                Balance(weights=weights, crossing=crossing, pushes={}, configurations=free, forces={sensor.channel: 1.0})
            )
    return found


def locks(model: RigModel, found: Sequence[Balance], combos: Combinations | None = None) -> tuple[Lock, ...]:
    """The equations of the rigid links whose ends are measured."""
    combos = combos or Combinations(model)
    listed = []
    for name, setup in model.configurations.items():
        if setup.lock_stiffness is not None:
            continue
        for part in elements(model):
            if part.link is not None and part.link.name in setup.rigid and combos.of(part.weights, 2) is not None:
                beyond = next((b for b in found if len(b.crossing) == 1 and b.contains(part)), None)
                listed.append(Lock(element=part, configuration=name, beyond=beyond))
    return tuple(listed)


def _sets(known: Sequence[str]) -> list[tuple[str, ...]]:
    if len(known) <= ALL_SETS:
        return [chosen for size in range(1, len(known) + 1) for chosen in combinations(known, size)]
    return [(name,) for name in known] + [tuple(known)]


def _connected(model: RigModel, bodies: Sequence[str]) -> bool:
    # Joined to each other by links or contacts; a set of separate groups repeats their equations.
    left, reached = set(bodies[1:]), {bodies[0]}
    while True:
        grown = {name for joint in model.joints if joint.joined & reached for name in joint.joined & left}
        if not grown:
            return not left
        reached |= grown
        left -= grown


def is_measured(balance: Balance, combos: Combinations) -> bool:
    """Whether all motions in an equation are measured, and none is estimated."""
    channels = {channel for part, _ in balance.crossing for channel in combos.of(part.weights, 0) or {}}
    estimates = {estimate_of(body) for body in combos.estimated}
    return not set(balance.bodies) & set(combos.estimated) and not channels & estimates


def _chosen(
    found: Sequence[Balance], parts: Sequence[Element], known: Sequence[str], combos: Combinations
) -> tuple[Balance, ...]:  # fmt: skip
    def size(balance: Balance) -> tuple[int, int]:
        terms = sum((part.link is not None) + (part.contact is not None) for part, _ in balance.crossing)
        return terms, len(balance.bodies)

    chosen: list[Balance] = []
    # What is measured throughout tells more than a shorter equation with an estimate.
    measured = [b for b in found if is_measured(b, combos)] if combos.estimated else []
    for group in (found, measured):
        for part in parts:
            best = min((b for b in group if b.contains(part)), key=size, default=None)
            if best is not None and best not in chosen:
                chosen.append(best)
    for body in known:
        if body not in combos.estimated and not any(body in balance.bodies for balance in chosen):
            best = min((b for b in found if body in b.bodies), key=size, default=None)
            if best is not None:
                chosen.append(best)
    if floats(combos.model):
        chosen += [balance for balance in found if set(balance.bodies) == set(known) and balance not in chosen]
    return tuple(chosen)
