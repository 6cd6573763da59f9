"""The suspects of a step: the kinds of causes and their places that the equations of motion of the records point to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from math import pi

import numpy as np

from isorig.analysis.deadline import ask_time
from isorig.analysis.diagnose.causes import CATALOGUE, FOUND_AS, proposed
from isorig.analysis.diagnose.causes.base import Evidence, Kind
from isorig.analysis.diagnose.free_shapes import finer, free_shapes
from isorig.analysis.diagnose.kinds import OVER_VELOCITY, kind_of
from isorig.analysis.diagnose.policy import POLICY
from isorig.analysis.equations.balances import Element
from isorig.analysis.equations.columns import DRY_FRICTION, INTERVALS, OVER_DEFLECTION, OVER_POSITION, PERIODIC, RARE_STOP
from isorig.analysis.equations.forms import (
    ElementForce,
    element_force,
    fitted_form,
    scales_of,
    shape_of,
    solved_values,
    start_values,
)
from isorig.analysis.equations.ranking import HINTS, Explanation, Ranking, ranking, score_of, share_left
from isorig.analysis.equations.system import CHANNEL_FAULTS, HOLDS, Equations
from isorig.analysis.errors import ModelError
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.solve import Fit, Free
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.wording import in_per_cent

#: Score below which the best explanation removes nothing worth mentioning: a tenth of the excess removed has a score of 0.05.
LEAST_SCORE = 0.05
#: Explanations whose score is below this share of the best one are not suspected. Chosen: the right one had at least half of the
#: best score in the sealed campaigns in which it was not the best.
ALIKE = 0.4
#: Number of suspects, unless more are as good as the best one (`NEARLY`).
MOST = 3
#: Residual from which an equation is broken, and the share of it that may remain once it is repaired. Chosen: twice the residual
#: up to which sound rigs stay; half of the excess, as a further step must remove (`Policy.of_rest`).
BROKEN, REPAIRED = 2.0 * HOLDS, 0.5
#: Residual of an equation that refutes an explanation if the best one leaves no equation broken. Chosen: three times that of a
#: broken one, since the best explanation may gain by its freedom.
REFUTED = 3.0 * BROKEN
#: Pitch in rad of a force that repeats once per turn, and the number of turns up to which a curve over the deflection shows it:
#: there it has four points per turn.
TURN, MOST_TURNS = 2.0 * pi, INTERVALS / 4.0
#: Starting points of a candidate, and the ratio of their remaining forces up to which they are alike.
STARTS, SAME = 2, 1.3
#: Share of a broken equation's excess residual that its own best explanation must remove to be suspected. Chosen: as a
#: main contributor (`Policy.main`).
OWN = POLICY.main
#: Score from which the equations show a kind and place alone, and its distance from the next: half of the excess, and twice less
#: of it left than by any other.
SHOWN, APART = 0.3, 0.3
#: Ratio of the best score to that of every other kind or place from which the only broken equation shows the best kind at its
#: only link or contact. Chosen: the place is certain then, and another kind removes less than half.
ONLY = 2.0
#: Share of the equations' excess residuals from which a contribution is stated. Chosen: a tenth, as `LEAST_SCORE`.
CONTRIBUTES = 0.1
#: Share of the best score from which an explanation is as good: it is always suspected, and its free shapes are fitted.
NEARLY = 0.8
#: Share of what the best candidate removes from the misfit of a link's recorded force that another one must remove to be
#: simulated. Chosen: the right form removed nearly all in every sealed campaign, wrong ones of another shape less than a third.
COMPARABLE = 0.5
#: Share of a link's rms force that a curve may leave there to be the only cause. Chosen: as errors of the sensors do.
LITTLE = 0.3
#: Share of the mean square force that the best candidate must remove for such a comparison: else noise decides it.
TELLS = 0.5
#: Share of the mean square force that the free shape removes which a form may leave and stand for the shape; and the ratio of
#: their remaining forces (as `Policy.form_alike`). Chosen: right forms left less than 1 %, those of another power 4 % and more.
STANDS, STANDS_ALIKE = 0.02, POLICY.form_alike
#: Share of the mean square force left at a place with a memory that one of another kind must remove there. Chosen: relaxation
#: removed a fifth to nearly all of it where it was in the rig, and an eighth next to a friction of no catalogued form.
OTHER_MEMORY = 0.2
#: Periods in the range of the deflection below which a force that repeats may be another curve. Chosen: the force of a spring
#: with play looked like 2 to 4 of them.
FEW_PERIODS = 6.0
#: Causes that the equations do not see, or that their evidence already locates: they are always tried where they are proposed.
ALWAYS = frozenset(cause.name for cause in CATALOGUE if cause.always_tried)


@dataclass(frozen=True, kw_only=True)
class _Begun:
    # Starting points of a candidate with the rms force in N that each leaves (none where the equations do not tell); the
    # explanation behind it.
    models: Sequence[tuple[float | None, RigModel]]
    explanation: Explanation | None

    @property
    def left(self) -> float | None:
        return min((left for left, _ in self.models if left is not None), default=None)


@dataclass(frozen=True, kw_only=True, eq=False)
class Suspects:
    """The suspected kinds and places."""

    ranking: Ranking  #: All explanations.
    chosen: tuple[Explanation, ...]  #: The suspected ones, best first.
    #: Names of links and contacts by those under which they are suspected: a contact and a link between the same ends have one
    #: place.
    places: Mapping[str, frozenset[str]]
    equations: Equations  #: The equations behind them.
    #: Whether no explanation repairs an equation with the causes found so far as they were fitted: only a simulation in which
    #: these are fitted again with it can tell.
    tentative: bool = False
    _values: dict[Explanation, tuple[dict[str, float], ElementForce | None]] = field(default_factory=dict)
    _fits: dict[tuple[object, ...], _Begun] = field(default_factory=dict)
    _without: dict[tuple[Explanation, bytes], float | None] = field(default_factory=dict)

    @property
    def others(self) -> Suspects | None:
        """Those of other kinds or places that would be suspected without these; None if there are none."""
        mine = {(item.kind, item.place) for item in self.chosen}
        left = [item for item in self.ranking.explanations if (item.kind, item.place) not in mine]
        chosen = () if self.tentative else suspected(left, self.ranking.residuals)
        return replace(self, chosen=chosen, _values={}, _fits={}) if chosen else None

    def includes(self, cause: str, location: str) -> bool:
        """Whether a cause at a place is suspected."""
        return any(self._is(explanation, cause, location) for explanation in self.chosen)

    def _at(self, explanation: Explanation, location: str) -> bool:
        return location in self.places.get(explanation.place, frozenset({explanation.place}))

    def _is(self, explanation: Explanation, cause: str, location: str) -> bool:
        if not self._at(explanation, location):
            return False
        if explanation.what in FOUND_AS and cause != explanation.kind:
            # Next to one force with a memory, the records do not show which kind of memory another one has; and few periods are
            # inflections of a curve.
            other = self._remembers(location) or (explanation.what == PERIODIC and self._has_few_periods(explanation))
            return cause in FOUND_AS[explanation.what] or (kind_of(cause) == explanation.kind and other)
        kind = kind_of(cause)
        # A friction or damping that depends on the position is none over velocity.
        elsewhere = explanation.what in (OVER_POSITION, OVER_DEFLECTION)
        return kind == explanation.kind or (not elsewhere and _alike(kind, explanation.kind))

    def _has_few_periods(self, explanation: Explanation) -> bool:
        # Whether a force that repeats has so few periods in the range of the deflection that it may be another curve.
        _, force = self._solved(explanation)
        return force is not None and bool(np.ptp(force.deflection) < FEW_PERIODS * explanation.values["pitch"])

    def _remembers(self, location: str) -> bool:
        # Whether a link or contact has a law with a memory in the model.
        model = self.equations.model
        laws = [law for link in model.links if link.name == location for law in link.laws]
        return any(law.remembers for law in [*laws, *(contact.law for contact in model.contacts if contact.name == location)])

    def only(self, kind: Kind, place: str) -> bool:
        """Whether all that is suspected is of one kind at one place."""
        return all(item.kind == kind and self._at(item, place) for item in self.chosen)

    def alike(self, one: tuple[str, str], other: tuple[str, str]) -> bool:
        """Whether two causes, each with its location, are at one place and of kinds that the equations cannot distinguish."""
        here, there = (self.places.get(location, frozenset({location})) for _, location in (one, other))
        return bool(here & there) and _alike(kind_of(one[0]), kind_of(other[0]))

    def score_of(self, cause: str, location: str) -> float:
        """Score of the explanation of which a cause at a place is a form; 0 if there is none."""
        return max((item.score for item in self.chosen if self._is(item, cause, location)), default=0.0)

    def shown(self, kind: str, place: str) -> bool:
        """Whether no explanation of another kind or place comes close to this one in all equations, or in a broken one.

        Nothing is shown where all equations hold.
        """
        mine = [e for e in self.chosen if self._is(e, kind, place)]
        others = [e for e in self.ranking.explanations if not self._is(e, kind, place)]
        if not mine or self.tentative or self.ranking.worst < HOLDS:
            return False
        pairs = [(max(e.score for e in mine), max((e.score for e in others), default=0.0))]
        for name, before in self.ranking.residuals.items():
            if before >= BROKEN:
                own, other = (min((e.residuals[name] for e in group), default=before) for group in (mine, others))
                pairs.append((score_of({name: before}, {name: own}), score_of({name: before}, {name: other})))
        return any(score >= SHOWN and score > other + APART for score, other in pairs)

    def show_another(self, cause: str, location: str) -> bool:
        """Whether an equation without estimated motions shows another kind than a cause has at its place, and nothing else."""
        best = self.chosen[0]
        clear = self.exact and self.clear is not None and self.shown(best.kind, best.place)
        return clear and self._at(best, location) and not self.blamed(cause, location)

    @property
    def broken(self) -> bool:
        """Whether an equation does not hold for certain."""
        return self.ranking.worst >= BROKEN

    @property
    def shows(self) -> bool:
        """Whether the best explanation is more than a guess."""
        return self.chosen[0].score >= SHOWN

    @property
    def rare(self) -> bool:
        """Whether the best explanation acts in a few events only."""
        return self.chosen[0].what == RARE_STOP.name

    @property
    def exact(self) -> bool:
        """Whether the best explanation repairs a broken equation in which no motion is estimated."""
        before, after = self.ranking.residuals, self.chosen[0].residuals
        return any(
            before[one.name] >= BROKEN and after[one.name] <= REPAIRED * before[one.name]
            for one in self.equations.balances
            if one.name in before and one.name not in self.equations.with_estimates
        )

    @property
    def remains(self) -> float:
        """The largest residual that the best explanation leaves, over noise."""
        return max(self.chosen[0].residuals.values())

    def blamed(self, cause: str, place: str) -> bool:
        """Whether no explanation of another kind or place is clearly better."""
        return self.score_of(cause, place) >= NEARLY * self.chosen[0].score

    def otherwise(self, cause: str, place: str) -> bool:
        """Whether a cause at a place is a form of an explanation that is not the best one, and nearly as good."""
        best, *others = self.chosen
        return any(item.score >= NEARLY * best.score and self._is(item, cause, place) for item in others)

    def left(self, candidate: Candidate, current: Sequence[Free]) -> float:
        """The rms force in N that a candidate leaves of its link's recorded force; 0 where the equations do not tell."""
        return self._begun(candidate, current).left or 0.0

    def curve(self, current: Fit, evidence: Evidence) -> tuple[Candidate, RigModel] | None:
        """The free shape of the best explanation with values from a link's recorded force; None if that is not known."""
        begun = ((shape, self._begun(shape, current.free)) for shape in self.shapes(current, evidence))
        known = [(one.left, shape, one) for shape, one in begun if one.explanation is self.chosen[0] and one.left is not None]
        least = min(known, key=lambda item: item[0], default=None)
        return None if least is None else (least[1], least[2].models[0][1])

    @property
    def clear(self) -> tuple[str, str] | None:
        """The kind and place that the equations show and no other; None if they show none."""
        best = self.chosen[0]
        shown = self.broken and (self.shown(best.kind, best.place) or self._only(best))
        return (best.kind, best.place) if shown else None

    def _only(self, best: Explanation) -> bool:
        # Whether all equations hold but that of one link or contact, at which the best explanation is, by far.
        broken = [one for one in self.equations.balances if self.ranking.residuals.get(one.name, 0.0) >= HOLDS]
        others = (e.score for e in self.ranking.explanations if (e.kind, e.place) != (best.kind, best.place))
        crossing = [element.name for balance in broken for element, _ in balance.crossing]
        return crossing == [best.place] and best.score >= max(LEAST_SCORE, ONLY * max(others, default=0.0))

    @property
    def clearly(self) -> str:
        """The same as a sentence; empty if they show none."""
        best, before = self.chosen[0], self.ranking.residuals
        if self.clear is None:
            return ""
        repaired = max(before, key=lambda name: before[name] / max(best.residuals[name], 1.0))
        which = "the largest residual, that of" if before[repaired] == self.ranking.worst else "the residual of"
        return (
            f"{best.what} ({best.place}) reduces {which} {repaired}, from {before[repaired]:.3g} to "
            f"{best.residuals[repaired]:.3g} times the noise."
        )

    @property
    def spread(self) -> str:
        """A sentence on the largest contributions where no single one explains most of the residuals; empty where one does."""
        parts: dict[tuple[str, str], float] = {}
        for item in self.ranking.explanations:
            left = share_left(self.ranking.residuals, item.residuals)
            parts.setdefault((item.what, item.place), 0.0 if left is None else 1.0 - left)
        largest = sorted(((share, *key) for key, share in parts.items() if share >= CONTRIBUTES), reverse=True)[:MOST]
        if not self.broken or self.shows or self.clear or not largest:
            return ""
        listed = ", ".join(f"{what} ({place}) {in_per_cent(share)}" for share, what, place in largest)
        return f"No single cause explains the residuals of the equations of motion; the largest contributions: {listed}."

    def leaves_another(self, current: Fit, evidence: Evidence) -> bool:
        """Whether the best explanation is one of several: it shows, but leaves an equation broken.

        Those with its link count by the force that a curve leaves there, where the equations give it.
        """
        if not self.shows:
            return False
        best = self.chosen[0]
        left, bare = self._of_curve(best, current, evidence), self._bare(best, current)
        known = left is not None and bare is not None
        with_link = {b.name for b in self.equations.balances if known and any(best.place in e.names for e, _ in b.crossing)}
        others = any(value >= BROKEN for name, value in best.residuals.items() if name not in with_link)
        return others or (left is not None and bare is not None and left > LITTLE * bare)

    def _of_curve(self, explanation: Explanation, current: Fit, evidence: Evidence) -> float | None:
        # The rms force in N that a curve leaves at an explanation's place; None if the equations do not tell.
        begun = (self._begun(shape, current.free) for shape in self.shapes(current, evidence))
        return min((one.left for one in begun if one.explanation is explanation and one.left is not None), default=None)

    def shapes(self, current: Fit, evidence: Evidence, *, refuted: bool = False) -> list[Candidate]:
        """The free shapes of the best explanations' kinds and places, or of all chosen ones if no simulation follows these."""
        best = [item for item in self.chosen if refuted or item.score >= NEARLY * self.chosen[0].score]
        leading = replace(self, chosen=tuple(best))
        found = [shape for shape in free_shapes(current.model, evidence) if leading.includes(shape.cause, shape.location)]
        return self._comparable(self._smallest(found, current), current)

    def _smallest(self, shapes: Sequence[Candidate], current: Fit) -> list[Candidate]:
        # Of several curves of one kind at one place the one with the fewest points that leaves as little of the recorded force.
        chosen: list[Candidate] = []
        by_key: dict[tuple[str, str], list[tuple[float, Candidate]]] = {}
        for shape in shapes:
            begun = self._begun(shape, current.free)
            if begun.left is None:
                chosen.append(shape)
                continue
            by_key.setdefault(shape.key, []).append((begun.left, shape))
            while (denser := finer(by_key[shape.key][-1][1], begun.models[0][1])) is not None:
                begun = self._begun(denser, current.free)
                if begun.left is None or STANDS_ALIKE * begun.left > by_key[shape.key][-1][0]:
                    break
                by_key[shape.key].append((begun.left, denser))
        for pairs in by_key.values():
            least = min(left for left, _ in pairs)
            enough = (shape for left, shape in pairs if left <= STANDS_ALIKE * least)
            chosen.append(min(enough, key=lambda shape: len(shape.free)))
        return chosen

    @property
    def untested(self) -> frozenset[tuple[str, str]]:
        """Causes and places that no equation shows, even if they are large: only a simulation tells."""
        return frozenset(("wrong_mass", body) for body in self.equations.unscaled)

    def candidates(self, current: Fit, evidence: Evidence) -> list[Candidate]:
        """The catalogue's candidates at the suspected places, and those that are always tried."""
        every = proposed(current.model, self.located(evidence))
        found = [c for c in every if c.cause in ALWAYS or c.key in self.untested or self.includes(c.cause, c.location)]
        found = [c for c in found if self._shows_memory(c, current)]
        found = [c for c in found if kind_of(c.cause) != "memory" or not self._outdone(c, found, current)]
        curves = {e: left for e in self.chosen if (left := self._of_curve(e, current, evidence)) is not None}
        return self._comparable(found, current, curves)

    def _shows_memory(self, candidate: Candidate, current: Fit) -> bool:
        # Whether a memory of another kind than the suspected one, next to one in the model, removes enough of the recorded force.
        explanation = self._explanation_of(candidate)
        if explanation is None or candidate.cause in FOUND_AS.get(explanation.what, {candidate.cause}):
            return True
        left, bare = self._begun(candidate, current.free).left, self._bare(explanation, current)
        return left is not None and bare is not None and bool(left**2 <= (1.0 - OTHER_MEMORY) * bare**2)

    def _outdone(self, candidate: Candidate, others: Sequence[Candidate], current: Fit) -> bool:
        # Whether a force without memory at a candidate's place, a form of a better explanation, leaves a smaller share of the
        # recorded force. A simulation with the candidate would take long: its force is then almost that of dry friction.
        own = self._share_of_force(candidate, current)
        there = (c for c in others if c.location == candidate.location and kind_of(c.cause) == "friction_shape")
        better = (found for c in there if (found := self._share_of_force(c, current)) is not None)
        return own is not None and any(score > own[0] and share < own[1] for score, share in better)

    def _share_of_force(self, candidate: Candidate, current: Fit) -> tuple[float, float] | None:
        # Score of a candidate's explanation, and the share of the recorded force's rms without a cause that it leaves.
        begun = self._begun(candidate, current.free)
        bare = self._bare(begun.explanation, current) if begun.explanation is not None else None
        return (begun.explanation.score, begun.left / bare) if begun.explanation and begun.left is not None and bare else None

    def _comparable(
        self, candidates: Sequence[Candidate], current: Fit, curves: Mapping[Explanation, float] | None = None
    ) -> list[Candidate]:
        # Those that explain a link's recorded force as well as any other one of any kind and as the curves there, which leave
        # these rms forces, as far as this can be known without a simulation.
        begun = {id(candidate): self._begun(candidate, current.free) for candidate in candidates}
        left = {key: (one.explanation, one.left) for key, one in begun.items() if one.explanation and one.left is not None}
        # What noise may leave without a cause compares none.
        bare = {e: found for e, _ in left.values() if (found := self._bare(e, current)) and found > self._allowed(e)}
        removed = {key: (e.place, 1.0 - (rest / bare[e]) ** 2) for key, (e, rest) in left.items() if e in bare}
        best: dict[str, float] = {}
        for place, share in (
            *removed.values(), *((e.place, 1.0 - (rest / bare[e]) ** 2) for e, rest in (curves or {}).items() if e in bare)
        ):  # fmt: skip
            best[place] = max(best.get(place, 0.0), share)
        least = {place: COMPARABLE * share if share >= TELLS else -np.inf for place, share in best.items()}
        return [c for c in candidates if id(c) not in removed or removed[id(c)][1] >= least[removed[id(c)][0]]]

    def _bare(self, explanation: Explanation, current: Fit) -> float | None:
        # The rms force that the model leaves without a cause there, N.
        key = explanation, current.model.encoded
        if key not in self._without:
            (_, force), element, solved = self._solved(explanation), self._element(explanation.place), None
            if force is not None and element is not None:
                solved = fitted_form(current.model, current.free, element, force)
            self._without[key] = None if solved is None else solved.left
        return self._without[key]

    def _allowed(self, explanation: Explanation) -> float:
        # The rms force that noise allows any form to leave there, N.
        _, force = self._solved(explanation)
        return 0.0 if force is None else force.allowed

    def stands(self, candidate: Candidate, current: Fit, evidence: Evidence) -> bool:
        """Whether a form of one of the best explanations leaves as little of a link's recorded force as any curve there, or is a
        level of dry friction with which an equation holds."""
        begun = self._begun(candidate, current.free)
        explanation, left = begun.explanation, begun.left
        if explanation is None or explanation.score < NEARLY * self.chosen[0].score:
            return False
        if explanation.what == DRY_FRICTION.name and self._is_level(candidate):
            return True
        if left is None:
            return False
        bare, (_, force) = self._bare(explanation, current), self._solved(explanation)
        if force is None or bare is None or left**2 > (1.0 - TELLS) * bare**2:
            return False
        curves = (float(np.sqrt(np.mean(force.left**2))), self._of_curve(explanation, current, evidence))
        of_curve = min(left for left in curves if left is not None)
        beyond = left**2 - of_curve**2
        return of_curve < bare and left <= STANDS_ALIKE * of_curve and beyond <= STANDS * (bare**2 - of_curve**2)

    def located(self, evidence: Evidence) -> Evidence:
        """The evidence with the frequencies that the equations show, and the recorded motion of suspected elements, not the
        simulated one."""
        found = tuple(item.values["frequency"] for item in self.chosen if "frequency" in item.values)
        deflection, speed = dict(evidence.deflection), dict(evidence.speed)
        pitches = {
            name: pitch for item in reversed(self.chosen) if (pitch := self._pitch(item)) is not None
            for name in self.places.get(item.place, frozenset())
        }  # fmt: skip
        for item in reversed(self.chosen):  # the best explanation of a place gives its motion
            _, force = self._solved(item)
            if force is None:
                continue
            for name in self.places.get(item.place, frozenset()):
                deflection[name] = float(np.abs(force.deflection).max())
                speed[name] = float(np.abs(force.velocity).max())
        return replace(
            evidence, misfit_frequencies=found or evidence.misfit_frequencies, deflection=deflection, speed=speed, pitches=pitches
        )  # fmt: skip

    def _pitch(self, item: Explanation) -> float | None:
        # The pitch with which a force may repeat over the deflection: the one that was found, or a turn of a body that no spring
        # holds, which has a heavy side.
        element = self._element(item.place)
        if "pitch" in item.values or element is None or element.link is None:
            return item.values.get("pitch")
        turns = self.equations.model.body(element.link.a).motion == "rotation" and not element.link.arms
        _, force = self._solved(item)
        if not turns or element.link.stiffness or item.what != "force over deflection" or force is None:
            return None
        return TURN if np.ptp(force.deflection) <= MOST_TURNS * TURN else None

    def started(self, candidate: Candidate, current: Sequence[Free]) -> list[RigModel]:
        """Starting points of a candidate: the rig's parameters and its own ones from the equations where these determine them."""
        models = self._begun(candidate, current).models
        least = min((left or 0.0 for left, _ in models), default=0.0)
        most = 1 if candidate.shape is not None else STARTS
        near = [(left, model) for left, model in models if (left or 0.0) <= SAME * least]
        return [model for k, (left, model) in enumerate(near) if left is None or k < most]

    def _begun(self, candidate: Candidate, current: Sequence[Free]) -> _Begun:
        key = *candidate.key, tuple(free.path for free in candidate.free), candidate.shape, candidate.starts[0].encoded
        if key not in self._fits:
            self._fits[key] = self._begin(candidate, current)
        return self._fits[key]

    def _begin(self, candidate: Candidate, current: Sequence[Free]) -> _Begun:
        explanation = self._explanation_of(candidate)
        if explanation is None:
            return _Begun(models=[(None, start) for start in candidate.starts], explanation=None)
        kept = {free.path for free in candidate.parameters(candidate.starts[0], current)} - {f.path for f in candidate.free}
        every, force = self._solved(explanation)
        values, level = {path: value for path, value in every.items() if path in kept}, self._level(candidate)
        if (kind_of(candidate.cause), explanation.kind) == ("friction_shape", "memory"):
            # The friction that holds a body at rest does not follow from its motion; values fitted without it may be far off.
            starts = [*candidate.starts]
            for start in candidate.starts:
                with suppress(ModelError):  # values that exclude the candidate's own
                    starts.append(_with_values(start, values, candidate))
            starts += [starts[-1].replace(level)] if level else []
            return _Begun(models=[(None, start) for start in starts], explanation=explanation)
        element = self._element(candidate.location)
        # What acts in a few events has left the fitted values as they are.
        rare = explanation.what == RARE_STOP.name
        found: list[tuple[float | None, RigModel]] = []
        for start in candidate.starts:
            ask_time()
            with suppress(ModelError):  # values that exclude the candidate's own
                model = start if rare else _with_values(start, values, candidate)
                own = level if explanation.what == DRY_FRICTION.name else _own_values(candidate, explanation, model)
                model = model.replace(own)
                solved = None
                if force is not None and element is not None:
                    free = [*candidate.free, *(f for f in current if f.path in kept and not rare)]
                    solved = fitted_form(model, free, element, force, robust=not rare)
                found.append((solved.left, model.replace(solved.values)) if solved is not None else (None, model))
        return _Begun(models=sorted(found, key=lambda pair: pair[0] or 0.0), explanation=explanation)

    def _explanation_of(self, candidate: Candidate) -> Explanation | None:
        # The best explanation of which a candidate is a form.
        return next((e for e in self.chosen if self._is(e, candidate.cause, candidate.location)), None)

    def _level(self, candidate: Candidate) -> dict[str, float]:
        # The level of a dry friction that the model lacks, from the equations.
        paths = {free.path for free in candidate.free if free.path.startswith("contacts.")}
        at = (e for e in self.ranking.explanations if e.what == DRY_FRICTION.name and self._at(e, candidate.location))
        explanation = next(at, None) if paths else None
        values = {} if explanation is None else solved_values(self.equations, explanation)
        return {path: value for path, value in values.items() if path in paths}

    def _is_level(self, candidate: Candidate) -> bool:
        # Whether a candidate is the constant level of dry friction with which an equation holds, sample by sample.
        if [free.path for free in candidate.free] != [*self._level(candidate)]:
            return False
        found = (
            self.equations.in_time(balance, element, sliding=True)
            for balance in self.equations.balances
            for element, _ in balance.crossing
            if candidate.location in element.names
        )
        return any(each is not None and each[0].residual(each[1]) < HINTS for each in found)

    def recorded(self, candidate: Candidate) -> tuple[Element, ElementForce] | None:
        """The element of a suspected candidate and its recorded force; None if the equations do not give it."""
        explanation, element = self._explanation_of(candidate), self._element(candidate.location)
        force = self._solved(explanation)[1] if explanation is not None else None
        return (element, force) if element is not None and force is not None else None

    def _solved(self, explanation: Explanation) -> tuple[dict[str, float], ElementForce | None]:
        if explanation not in self._values:
            shape = shape_of(explanation)
            scales = scales_of(self.equations, explanation)
            force = None if shape is None else element_force(self.equations, explanation.place, shape, scales)
            self._values[explanation] = start_values(self.equations, explanation), force
        return self._values[explanation]

    def _element(self, place: str) -> Element | None:
        return next((e for e in self.equations.elements() if place in e.names), None)


def _with_values(start: RigModel, values: Mapping[str, float], candidate: Candidate) -> RigModel:
    # The values of the equations in a candidate's starting point, without those of a contact's law that exclude the candidate's
    # own: sliding friction above a breakaway force.
    try:
        return start.replace(values)
    except ModelError:
        law = f"contacts.{candidate.location}."
        return start.replace({path: value for path, value in values.items() if not path.startswith(law)})


def _own_values(candidate: Candidate, explanation: Explanation, model: RigModel) -> dict[str, float]:
    # A candidate's own parameters as far as the equations give them.
    values, paths = explanation.values, [free.path for free in candidate.free]
    if explanation.what in CHANNEL_FAULTS and len(paths) == 1 and candidate.cause != "wrong_mass":
        return {paths[0]: values["value"]}
    if explanation.what == "gain" and paths == ["drive.factor"]:
        return {paths[0]: model.get(paths[0]) / values["value"]}
    if explanation.what == "mass" and len(paths) == 1:
        return {paths[0]: values["mass"]}
    if explanation.what == "elastic lock":
        return {path: values["stiffness"] for path in paths if path.endswith("lock_stiffness")}
    if explanation.what == "resonator" and values["mass"] > 0.0:
        mass, own = values["mass"], 2.0 * pi * values["frequency"]
        given = {"mass": mass, "stiffness": mass * own**2, "damping": 2.0 * values["damping"] * mass * own}
        return {path: given[path.rpartition(".")[2]] for path in paths if path.rpartition(".")[2] in given}
    return {}


def suspects(equations: Equations, *, further: bool = False) -> Suspects | None:
    """What the equations of motion of the records point to; None if they cannot say.

    If causes were found already (`further`), a suspect must repair an equation that they leave broken.
    """
    if not equations.residuals():
        return None
    ranked = ranking(equations)
    listed = [item for item in ranked.explanations if not further or _repairs_alone(item, ranked)]
    chosen = suspected(listed, ranked.residuals, further=further)
    tentative = further and not chosen and ranked.worst >= BROKEN
    if tentative:
        chosen = tuple([item for item in ranked.explanations if item.score >= LEAST_SCORE and item.kind != "memory"][:MOST])
    if not chosen:
        return None
    places = {element.name: element.names for element in equations.elements()}
    return Suspects(ranking=ranked, chosen=chosen, places=places, equations=equations, tentative=tentative)


def _alike(kind: str, other: str) -> bool:
    # Whether the equations cannot distinguish two kinds at one place.
    return kind == other or {kind, other} == OVER_VELOCITY


def _repairs_alone(item: Explanation, ranked: Ranking) -> bool:
    # Whether an explanation repairs an equation, or, where disturbances keep it broken, removes much of it and no other one does.
    if repairs(ranked.residuals, item.residuals):
        return True
    others = [e for e in ranked.explanations if e.place != item.place or not _alike(e.kind, item.kind)]
    return any(
        value >= BROKEN
        and value - item.residuals[name] >= OWN * (value - 1.0)
        and value - min((e.residuals[name] for e in others), default=value) <= REPAIRED * (value - item.residuals[name])
        for name, value in ranked.residuals.items()
    )


def repairs(before: Mapping[str, float], after: Mapping[str, float]) -> bool:
    """Whether an explanation repairs an equation in good part: a broken one, or one in which a simulated error may show."""

    def most(residual: float) -> float:
        if residual >= BROKEN:
            return REPAIRED * residual
        return 1.0 + REPAIRED * (residual - 1.0) if residual >= HINTS else -np.inf

    return any(after[name] <= most(value) for name, value in before.items())


def suspected(
    explanations: Sequence[Explanation], before: Mapping[str, float], *, further: bool = False
) -> tuple[Explanation, ...]:  # fmt: skip
    """The best explanations of different kinds and places, and of each broken equation what repairs it most.

    They come best first; `before` has the residual of each equation without any.
    """
    best = max((item.score for item in explanations), default=0.0)
    chosen: list[Explanation] = []
    holds = bool(explanations) and all(value < BROKEN for value in explanations[0].residuals.values())
    for item in explanations:
        if best < LEAST_SCORE or item.score < (ALIKE if len(chosen) < MOST else NEARLY) * best:
            break
        if holds and any(value >= REFUTED for value in item.residuals.values()):
            continue
        if all((item.kind, item.place, item.what) != (other.kind, other.place, other.what) for other in chosen):
            chosen.append(item)
    # No regression shows every force with a memory: where the best explanation leaves much, such a force there may be behind it;
    # where its place is certain and no cause was found yet, even one that looks like no such force (play with much friction
    # behind it is almost a spring).
    if chosen and not any(item.kind == "memory" for item in chosen):
        leaves = any(value >= BROKEN and chosen[0].residuals[name] >= BROKEN for name, value in before.items())
        elsewhere = max((item.score for item in explanations if item.place != chosen[0].place), default=0.0)
        certain = not further and chosen[0].score >= SHOWN + max(elsewhere, 0.0)
        least = -np.inf if certain else LEAST_SCORE
        there = (item for item in explanations if item.kind == "memory" and item.place == chosen[0].place)
        chosen += [item for item in there if leaves and item.score >= least][:1]
    # What is largest over noise may be a disturbance that hardly moves the rig.
    for name, whole in before.items():
        own = min(explanations, key=lambda item: item.residuals[name], default=None)
        if own is None or whole < BROKEN or own.residuals[name] - 1.0 > (1.0 - OWN) * (whole - 1.0):
            continue
        if all(whole - item.residuals[name] < NEARLY * (whole - own.residuals[name]) for item in chosen):
            chosen.append(own)
    return tuple(chosen)
