"""Forms that the equations of motion refute before any simulation: the equations with each form in the model."""

from collections.abc import Mapping
from itertools import combinations

from isorig.analysis.diagnose.kinds import kind_of
from isorig.analysis.diagnose.policy import POLICY
from isorig.analysis.diagnose.suspects import BROKEN, COMPARABLE, REFUTED, TELLS
from isorig.analysis.equations.ranking import HINTS, removed
from isorig.analysis.fitting.ladder import BEHIND

#: A cause and its place.
Key = tuple[str, str]
#: Residual of each equation over noise, by name.
Residuals = Mapping[str, float]


def comparable_forms(before: Residuals, after: Mapping[Key, Residuals]) -> frozenset[Key]:
    """The forms that are worth a simulation.

    One is not if another one at its place removes more than twice as much of all equations together, or if others remove more
    than twice as much of every equation, or repair it and leave far less. All are where no form removes much of any equation;
    of forces with a memory all if the best at their place is one, whose values at the start tell little.

    Parameters
    ----------
    before
        The equations without a form.
    after
        Those with each form in the model.
    """
    least = {name: min(left[name] for left in after.values()) for name in before} if after else {}
    most = {name: _share(before, least, name) for name in least}
    if max(most.values(), default=0.0) < TELLS:
        return frozenset(after)
    whole = {key: removed(before, left) for key, left in after.items()}

    def repairs(key: Key, name: str) -> bool:
        close = least[name] >= REFUTED or after[key][name] <= BEHIND * max(least[name], HINTS)
        return close and most[name] > 0.0 and _share(before, after[key], name) >= COMPARABLE * most[name]

    def kept(key: Key) -> bool:
        best = max((other for other in after if other[1] == key[1]), key=lambda other: whole[other])
        if {kind_of(key[0]), kind_of(best[0])} == {"memory"}:
            return True
        rivals = whole[best] < TELLS or whole[key] >= COMPARABLE * whole[best]
        return rivals and any(repairs(key, name) for name in before)

    return frozenset(key for key in after if kept(key))


def shows_two(before: Residuals, after: Mapping[Key, Residuals]) -> bool:
    """Whether each of two forms at different places repairs the equations that the other one leaves broken, and none all."""
    broken = [name for name, value in before.items() if value >= BROKEN]

    def repaired(*keys: Key) -> bool:
        least = {name: min(after[key][name] for key in keys) for name in broken}
        return all(_share(before, least, name) >= POLICY.explained for name in broken)

    pairs = (pair for pair in combinations(after, 2) if pair[0][1] != pair[1][1])
    return not any(repaired(key) for key in after) and any(repaired(*pair) for pair in pairs)


def _share(before: Residuals, after: Residuals, name: str) -> float:
    # Share of one equation's excess residual that goes.
    return removed({name: before[name]}, after)
