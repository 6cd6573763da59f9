"""Selects the next run: the largest increase in the probability that one cause is identified, per cost."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.fitting.screen import Progress
from isorig.analysis.model.limits import Limits
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.proposals.limits import LargestMotions
from isorig.analysis.proposals.menu import CandidateRun, cost
from isorig.analysis.proposals.policy import POLICY
from isorig.analysis.proposals.prediction import (
    Key,
    Moments,
    Predicted,
    Prospect,
    Variant,
    distance,
    drawn_models,
    evaluated,
    refit,
    remaining_distance,
)


def distinguishing_probability(distances: float | FloatArray) -> FloatArray:
    """Probability that a run distinguishes two causes at this distance: 0 and 1 at the policy's limits, logarithmic between."""
    low, high = POLICY.indistinguishable, POLICY.distinguishable
    between = np.log(np.maximum(distances, 1e-12) / low) / np.log(high / low)
    return np.asarray(np.clip(between, 0.0, 1.0))


@dataclass(frozen=True, kw_only=True)
class Question:
    """The open question: causes that may be true, and the causes each could be mistaken for."""

    truths: tuple[Variant, ...]  #: The remaining causes, each with at least one model; or hypothetical causes.
    rivals: tuple[Variant, ...]  #: Fitted models that a true cause may be mistaken for; each is compared with all except itself.
    #: Whether the causes are only hypothetical. What the existing runs would have shown of them then counts as known.
    supposed: bool = False


@dataclass(frozen=True, kw_only=True)
class PairDistance:
    """Distance of a true cause from a refitted rival after some runs: the mean over models drawn for the true cause."""

    truth: Variant
    rival: Variant
    distance: float
    probability: float


@dataclass(frozen=True, kw_only=True)
class PredictedPair:
    """Predictions of two causes for a run, in the channel where they differ most, with the rival refitted."""

    truth: Variant
    rival: Variant
    channel: str
    sample_rate: float  #: Hz.
    #: The records, shape (n,), in the channel's unit.
    of_truth: FloatArray
    of_rival: FloatArray
    allowed: float  #: Allowed error of a sample (noise and accuracy of the simulation), in the channel's unit.
    distance: float  #: Their distance there, in allowed errors.


@dataclass(frozen=True, kw_only=True)
class Choice:
    """A proposed run."""

    prospect: Prospect  #: The run and its drive.
    #: That one cause is identified after it and the runs proposed before it; for hypothetical causes: the share that would be
    #: revealed.
    probability: float
    gained: float  #: Increase due to this run.
    apart: tuple[PairDistance, ...]  #: Distances with this run alone, for every true cause and rival.
    peaks: LargestMotions  #: Peaks of the remaining models in it.
    predicted_pairs: tuple[PredictedPair, ...]  #: The predictions for causes that the run distinguishes, the closest pairs first.


@dataclass(frozen=True, kw_only=True)
class Chosen:
    """A proposal: the runs, best first; none if no allowed run is informative.

    `best` has for every true cause and rival the largest distance with a single allowed run; `compared` is the number of compared
    candidates, `refused` those rejected for a limit, with the reasons.
    """

    choices: tuple[Choice, ...]
    best: tuple[PairDistance, ...]
    compared: int
    refused: Mapping[CandidateRun, str] = field(default_factory=dict)


#: Result of a run by true cause and rival, for each model drawn for the true cause.
Pairs = dict[tuple[int, int], list[Moments]]


@dataclass(frozen=True, kw_only=True)
class ComparedRuns:
    """Candidate runs evaluated for a question, and those rejected for a limit, with the reasons."""

    pairs: Sequence[tuple[Prospect, Pairs]]
    refused: Mapping[CandidateRun, str]


class Comparison:
    """Candidate runs compared for one question, with the noise by channel (standard deviation, including the drive) and the
    existing runs."""

    def __init__(self, question: Question, noise: Mapping[str, float], in_hand: Sequence[Prospect]) -> None:
        self._question, self._noise = question, noise
        self._reference = question.rivals[0].model
        count = 1 if question.supposed else POLICY.compared_draws
        # The models drawn for every true cause that is not settled, the fitted one first.
        self._drawn = {
            i: [truth, *(Variant(cause=truth.cause, location=truth.location, model=m) for m in drawn_models(truth, count, 3)[1:])]
            for i, truth in enumerate(question.truths)
        }
        # All hypothetical causes have equal weight, independent of the number of their possible places.
        places = Counter(truth.cause for truth in question.truths)
        self._weights = [1.0 / places[truth.cause] if question.supposed else 1.0 for truth in question.truths]
        self._hand = [self._moments(prospect) for prospect in in_hand]
        if question.supposed and in_hand:
            # What the existing runs would have shown needs no further run.
            known = {i for i, group in self._distances_by_truth([]).items() if min(a.probability for a in group) >= 1.0}
            self._drawn = {i: models for i, models in self._drawn.items() if i not in known}
        if not question.supposed:
            # Remaining causes were fitted to the existing runs, so they agree there. A model drawn for the true cause differs,
            # and the rival would have been fitted to its data.
            self._hand = [
                {key: [replace(one, slope=one.slope - drawn[0].slope) for one in drawn] for key, drawn in pairs.items()}
                for pairs in self._hand
            ]

    def _moments(self, prospect: Prospect) -> Pairs:
        return _pairs(Predicted(prospect, self._noise, self._reference), self._drawn, self._question.rivals)

    def seen(self, prospects: Sequence[Prospect], limits: Limits, progress: Progress) -> ComparedRuns:
        """The candidates within the limits by a first simulation, evaluated for the question.

        `progress` is called before each; when the deadline in force is over, the candidates compared so far are the answer.
        """
        models = [rival.model for rival in self._question.rivals]
        found = evaluated(prospects, lambda one: one.peaks(models).beyond(limits) or self._moments(one), progress)
        return ComparedRuns(
            pairs=[(prospect, pairs) for prospect, pairs in found if not isinstance(pairs, str)],
            refused={prospect.run: why for prospect, why in found if isinstance(why, str)},
        )

    def predicted_pairs(self, prospect: Prospect, pairs: Pairs) -> tuple[PredictedPair, ...]:
        """Predictions of causes that a run distinguishes, the closest pairs first."""
        seen = Predicted(prospect, self._noise, self._reference)
        found = []
        for k, rival in enumerate(self._question.rivals):
            slopes, own = seen.slopes(rival), seen.records([rival])[0]
            for i, (truth, *_) in self._drawn.items():
                if truth.key == rival.key:
                    continue
                step = refit(rival.free, [run[i, k][0] for run in (*self._hand, pairs)])
                apart = remaining_distance(pairs[i, k][0], step)
                row = int(np.argmax(apart))
                if not POLICY.indistinguishable < apart[row] < np.inf:
                    continue
                channel, lines = seen.channels[row], own[row] + slopes.rows[row] @ step
                found.append(
                    PredictedPair(
                        truth=truth, rival=rival, channel=channel, sample_rate=prospect.sample_rate,
                        of_truth=seen.record(seen.records([truth])[0, row], channel), of_rival=seen.record(lines, channel),
                        allowed=float(seen.allowed[row]), distance=float(apart[row]),
                    )
                )  # fmt: skip
        return tuple(sorted(found, key=lambda pair: pair.distance)[: POLICY.shown_pairs])

    def with_sensors(self, prospect: Prospect, added: Callable[[RigModel], RigModel], pair: tuple[Key, Key]) -> dict[str, float]:
        """Distance of a pair of causes in a run with each of several additional sensors alone, by channel.

        `added` adds the sensors to a model. Their noise is that of the drive channel, except for displacement sensors.
        """
        fitted = [replace(rival, model=added(rival.model)) for rival in self._question.rivals]
        drawn = {
            i: [replace(one, model=added(one.model)) for one in models]
            for i, models in self._drawn.items()
            if models[0].key in pair
        }
        reference = added(self._reference)
        quiet = self._noise.get(reference.drive.channel, 0.0)
        further = [s for s in reference.sensors if all(s.channel != own.channel for own in self._reference.sensors)]
        levels = {s.channel: POLICY.sensor_resolution if s.quantity == "displacement" else quiet for s in further}
        pairs = _pairs(Predicted(prospect, {**self._noise, **levels}, reference), drawn, fitted)
        apart = np.zeros(len(reference.sensors))
        for (i, k), found in pairs.items():
            for n, moments in enumerate(found if fitted[k].key in pair else ()):
                step = refit(fitted[k].free, [*(run[i, k][n] for run in self._hand), moments])
                apart = np.maximum(apart, remaining_distance(moments, step))
        return {s.channel: size for s, size in zip(reference.sensors, apart.tolist(), strict=True) if s in further}

    def distances(self, pairs: Sequence[Pairs]) -> list[PairDistance]:
        """Distance of every true cause from every rival after some further runs."""
        return [apart for group in self._distances_by_truth(pairs).values() for apart in group]

    def probability(self, pairs: Sequence[Pairs]) -> float:
        """Probability that one cause is identified after some further runs; for hypothetical causes the revealed share."""
        groups = self._distances_by_truth(pairs)
        chances = [min((a.probability for a in groups.get(i, ())), default=1.0) for i in range(len(self._weights))]
        return float(np.average(chances, weights=self._weights)) if chances else 1.0

    def _distances_by_truth(self, pairs: Sequence[Pairs]) -> dict[int, list[PairDistance]]:
        counted = [self._question.supposed] * len(self._hand) + [True] * len(pairs)
        groups: dict[int, list[PairDistance]] = {i: [] for i in self._drawn}
        for i, models in self._drawn.items():
            for k, rival in enumerate(self._question.rivals):
                if rival.key == models[0].key:
                    continue
                runs = [[run[i, k][n] for run in (*self._hand, *pairs)] for n in range(len(models))]
                sizes = np.array([distance(rival.free, seen, counted) for seen in runs])
                chance = float(distinguishing_probability(sizes).mean())
                groups[i].append(PairDistance(truth=models[0], rival=rival, distance=float(np.median(sizes)), probability=chance))
        return groups


def _pairs(seen: Predicted, drawn: Mapping[int, Sequence[Variant]], fitted: Sequence[Variant]) -> Pairs:
    own = seen.records(fitted)
    records = iter(seen.records([variant for models in drawn.values() for variant in models]))
    of_truth = {i: [next(records) for _ in models] for i, models in drawn.items()}
    found: Pairs = {}
    for k, rival in enumerate(fitted):
        slopes = seen.slopes(rival)
        for i, models in drawn.items():
            if models[0].key != rival.key:
                found[i, k] = [seen.moments(record, own[k], slopes) for record in of_truth[i]]
    return found


def choose(
    comparison: Comparison, seen: ComparedRuns, limits: Limits, kept: Callable[[Prospect], LargestMotions], *, configuration: str,
    budget: float, most: int = POLICY.most_runs,
) -> Chosen:  # fmt: skip
    """The runs to measure, in order: the largest increase in probability per cost, each in addition to those before it.

    The budget is in seconds of measuring for all runs together. `kept` gives the peaks of all remaining models, and models drawn
    from their uncertainty, in a candidate simulated in full length; `configuration` is the present one of the rig.
    """
    left = list(seen.pairs)
    refused = dict(seen.refused)
    taken: list[Pairs] = []
    choices: list[Choice] = []
    now = comparison.probability([])
    while len(choices) < most and (affordable := [item for item in left if item[0].run.seconds <= budget]):
        after = [comparison.probability([*taken, pairs]) for _, pairs in affordable]
        costs = [cost(prospect.run, configuration, limits) for prospect, _ in affordable]
        best = int(np.argmax((np.array(after) - now) / costs))
        (prospect, pairs), then = affordable[best], after[best]
        if then - now < POLICY.worthwhile_gain:
            break
        left = [item for item in left if item[0] is not prospect]
        peaks = kept(prospect)
        why = peaks.beyond(limits)
        if why:
            refused[prospect.run] = why
            continue
        choices.append(
            Choice(
                prospect=prospect, probability=then, gained=then - now, apart=tuple(comparison.distances([pairs])), peaks=peaks,
                predicted_pairs=comparison.predicted_pairs(prospect, pairs),
            )
        )  # fmt: skip
        taken.append(pairs)
        now, budget, configuration = then, budget - prospect.run.seconds, prospect.run.configuration
    farthest: dict[tuple[Key, Key], PairDistance] = {}
    for apart in (apart for _, pairs in seen.pairs for apart in comparison.distances([pairs])):
        key = apart.truth.key, apart.rival.key
        farthest[key] = max(farthest.get(key, apart), apart, key=lambda each: each.distance)
    return Chosen(choices=tuple(choices), best=tuple(farthest.values()), compared=len(seen.pairs), refused=refused)
