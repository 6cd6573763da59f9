"""Two simultaneous causes: if no form explains the data alone, second forms are added to the promising first ones.

One cause may mask another: alone neither fits well, and the better of the two may be wrong. On the first moments of a run a fit
takes a fraction of a second, and only a complete model agrees with the data there, so many pairs can be tried.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import msgspec

from isorig.analysis.diagnose.causes import CATALOGUE
from isorig.analysis.diagnose.causes.base import Evidence
from isorig.analysis.diagnose.kinds import kind_of
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.ladder import TELLING, Race, Rung, Running, tried
from isorig.analysis.fitting.screen import Progress, Screen
from isorig.analysis.fitting.solve import Fit
from isorig.analysis.model.rig_model import RigModel

#: Number of first causes with added second ones, of second ones fitted for each, and of pairs fitted to the end.
FIRSTS, SECONDS, FINISHED = 4, 4, 3
#: A second cause that is predicted to leave less than this share of the misfit gets this many times the rung's steps: two large
#: effects converge slowly. Chosen.
STRIKING, PATIENCE = 0.2, 4
#: A first cause whose misfit exceeds that of the best by this factor gets no second one. Chosen: two causes that mask each other
#: remove similar parts, and a pair is also found from its other cause.
FIRST_BEHIND = 3.0
#: Number of rungs on which pairs are searched until some agree: the second cause may show later in a run than the first; and the
#: seconds of each run beyond which only the first rung is searched: longer ones take most of the time. Chosen.
LENGTHS, LONGEST = 3, 2.0
#: A pair whose misfit, in allowed errors, is below this is complete on a rung: no further first causes are tried.
AGREES = 1.0
#: Maximum predicted share of the first cause's misfit that a second one leaves: otherwise it is not fitted.
PROMISED = 0.5


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two causes and the fit of a model that has both.

    Parameters
    ----------
    first, second
        The causes; the second extends the model that the first has extended.
    alone, fit
        The fits with the first one alone, on a short interval, and with both.
    """

    first: Candidate
    second: Candidate
    alone: Fit
    fit: Fit

    @property
    def keys(self) -> frozenset[tuple[str, str]]:
        """Cause and place of both."""
        return frozenset((self.first.key, self.second.key))


def pairs(run: Race, rungs: Sequence[Rung], seen: Callable[[RigModel], Evidence], progress: Progress) -> list[Pair]:
    """Pairs of forms that agree with the data on every rung from the first that distinguishes candidates, best first.

    Parameters
    ----------
    run
        The elimination of the single forms.
    rungs
        Its rungs.
    seen
        The evidence for a model.
    progress
        Called with one line for each fit.
    """
    for at, singles in searched(run, rungs):
        if found := _complete(singles, rungs[at], seen, progress):
            break
    else:
        return []
    for rung in rungs[at + 1 :]:
        longer = replace(rung, steps=PATIENCE * rung.steps)
        climbed = [(pair, tried(pair.fit.model, pair.fit.free, longer)) for pair in _distinct(found)]
        found = [
            Pair(first=pair.first, second=pair.second, alone=pair.alone, fit=done)
            for pair, done in climbed
            if done is not None and done.cost < TELLING and pair.second.plausible(done.model)
        ]
    return _distinct(found)[:FINISHED]


def searched(run: Race, rungs: Sequence[Rung]) -> list[tuple[int, Running]]:
    """The rungs on which pairs are searched, by index, with the single forms there.

    Where a single form agrees with the data, no second one shows.
    """
    shown = [(at, singles) for at, singles in run.telling if singles and singles[0][1].cost >= TELLING][:LENGTHS]
    return [each for k, each in enumerate(shown) if k == 0 or rungs[each[0]].seconds <= LONGEST]


def firsts(singles: Running) -> Running:
    """The single forms, best first, to which second ones are added."""
    return [single for single in singles[:FIRSTS] if single[1].cost <= FIRST_BEHIND * singles[0][1].cost]


def _complete(
    singles: Running, rung: Rung, seen: Callable[[RigModel], Evidence], progress: Progress
) -> list[Pair]:  # fmt: skip
    # Pairs that agree with the data on a rung.
    found: list[Pair] = []
    queue = firsts(singles)
    while queue:
        first, alone = queue.pop(0)
        model = msgspec.structs.replace(alone.model, free=tuple(free.path for free in alone.free))
        evidence = seen(model)
        candidates = [c for cause in CATALOGUE for c in cause.candidates(model, evidence)]
        screened = Screen(alone, rung.problem).ranked([c for c in candidates if _apart(c, first)])
        for item in (item for item in screened[:SECONDS] if item.cost < PROMISED * alone.cost):
            second = item.candidate
            progress(f"fitting {first.cause} ({first.location}) and {second.cause} ({second.location})")
            free = second.parameters(alone.model, alone.free)
            steps = PATIENCE * rung.steps if item.cost < STRIKING * alone.cost else rung.steps
            longer = replace(rung, steps=steps)
            fits = [done for start in item.models if (done := tried(start, free, longer)) and second.plausible(done.model)]
            both = min(fits, key=lambda done: done.cost, default=None)
            if both is not None and both.cost < TELLING:
                found.append(Pair(first=first, second=second, alone=alone, fit=both))
        best = min(found, key=lambda pair: pair.fit.cost, default=None)
        if best is not None and best.fit.cost < AGREES:
            # Alternatives to the first cause are found from the second one.
            queue = [single for single in singles if single[0].key == best.second.key and first.key == best.first.key]
    return found


def _apart(second: Candidate, first: Candidate) -> bool:
    # Two forms at one place imitate a form outside the catalogue, except friction with a spring or damper.
    kinds = {kind_of(first.cause), kind_of(second.cause)}
    return first.location != second.location or kinds in ({"friction_shape", "spring_shape"}, {"friction_shape", "damping_shape"})


def _distinct(found: Sequence[Pair]) -> list[Pair]:
    # The same two in either order are one pair.
    ranked = sorted(found, key=lambda pair: pair.fit.cost)
    return [pair for k, pair in enumerate(ranked) if all(pair.keys != other.keys for other in ranked[:k])]
