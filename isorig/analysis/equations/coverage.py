"""Which places of a rig its equations of motion contain, from its description, and where one more sensor would help most."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from isorig.analysis.equations.balances import Balance, balances, elements, locks
from isorig.analysis.equations.hidden import estimable
from isorig.analysis.equations.motion import Combinations, estimate_of
from isorig.analysis.model.rig_model import RigModel, Sensor


@dataclass(frozen=True, kw_only=True)
class Coverage:
    """The places in a rig's equations of motion."""

    #: Names of the links and contacts in each equation, and of the channels and estimated motions that it needs, by its name.
    equations: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]]
    #: The equations that a fault at each link and contact breaks, by its name: those that contain it, and those with the motion
    #: of a body without a sensor that is estimated with it.
    places: Mapping[str, frozenset[str]]

    @property
    def unseen(self) -> tuple[str, ...]:
        """The places in no equation."""
        return tuple(name for name, inside in self.places.items() if not inside)

    @property
    def alike(self) -> tuple[tuple[str, ...], ...]:
        """Places in the same equations: only their different motions separate them."""
        groups: dict[frozenset[str], list[str]] = {}
        for name, inside in self.places.items():
            if inside:
                groups.setdefault(inside, []).append(name)
        return tuple(tuple(group) for group in groups.values() if len(group) > 1)

    @property
    def lack(self) -> tuple[int, int]:
        """What a further sensor can improve: the number of unseen places, and of places that share their equations."""
        return len(self.unseen), sum(len(group) for group in self.alike)


def coverage(model: RigModel) -> Coverage:
    """The places in the equations that a rig's sensors support; its values do not matter."""
    combos = Combinations(model, estimable(model))
    found = balances(model, combos)
    equations = {
        balance.name: (tuple(part.name for part, _ in balance.crossing), _channels(model, combos, balance)) for balance in found
    }
    for lock in locks(model, found, combos):
        ends = combos.of(lock.element.weights, 2) or {}
        equations[lock.name] = ((lock.element.name,), tuple(channel for channel in model.channels if channel in ends))
    through = _estimated_with(model, combos)
    places = {
        part.name: frozenset(
            name
            for name, (inside, needed) in equations.items()
            if part.name in inside or through.get(part.name, frozenset()) & set(needed)
        )
        for part in elements(model)
    }
    return Coverage(equations=equations, places=places)


def _estimated_with(model: RigModel, combos: Combinations) -> dict[str, frozenset[str]]:
    # The estimated motions that each link enters: those of the bodies at its ends, and of all that are estimated with these.
    names = [body.name for body in model.bodies]
    ends = {part.name: {names[k] for k in np.flatnonzero(part.weights)} & set(combos.estimated) for part in elements(model)}
    for _ in range(len(ends)):  # a chain of bodies grows by one link in each pass
        ends = {name: set().union(one, *(other for other in ends.values() if one & other)) for name, one in ends.items()}
    return {name: frozenset(estimate_of(body) for body in bodies) for name, bodies in ends.items()}


def _channels(model: RigModel, combos: Combinations, balance: Balance) -> tuple[str, ...]:
    needed = {*balance.pushes, *balance.forces}
    for part, _ in balance.crossing:
        needed |= set(combos.of(part.weights, 0) or {})
    for body in balance.bodies:
        weights = np.zeros(len(model.bodies))
        weights[[other.name for other in model.bodies].index(body)] = 1.0
        needed |= set(combos.of(weights, 2) or {})
    return tuple(name for name in (*model.channels, *map(estimate_of, combos.estimated)) if name in needed)


def best_further_sensor(model: RigModel) -> tuple[str, Coverage] | None:
    """The body whose acceleration would improve the coverage most, and the coverage with it; None if none improves it."""
    measured = Combinations(model).measured
    tried = [
        (
            body.name,
            coverage(replace(model, sensors=(*model.sensors, Sensor(channel=f"further sensor: {body.name}", body=body.name)))),
        )
        for body in model.bodies
        if body.name not in measured
    ]
    best = min(tried, key=lambda pair: pair[1].lack, default=None)
    return best if best is not None and best[1].lack < coverage(model).lack else None
