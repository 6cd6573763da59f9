"""From the open questions of diagnoses to the next runs: the question, the candidates, and the proposal with reasons."""

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Literal, NamedTuple

import msgspec
import numpy as np

from isorig.analysis.campaign import Campaign
from isorig.analysis.deadline import Deadline
from isorig.analysis.errors import AnalysisError
from isorig.analysis.model.limits import Limits
from isorig.analysis.model.linear import floats
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.proposals.choice import Choice, Chosen, Comparison, Question, choose
from isorig.analysis.proposals.hypotheses import hypotheses
from isorig.analysis.proposals.limits import LargestMotions, largest_of, reached_so_far
from isorig.analysis.proposals.menu import CandidateRun, candidate_runs, covers_all_modes, run_at_rest
from isorig.analysis.proposals.policy import POLICY as PROPOSALS
from isorig.analysis.proposals.precision import KnownPrecision, parameter_by_name, runs_for_uncertainty
from isorig.analysis.proposals.prediction import Key, Prospect, Variant, evaluated, models_within_limits
from isorig.analysis.proposals.remedies import Remedy, another_sensor, beyond_limits, pair_distance
from isorig.analysis.simulate import simulate
from isorig.analysis.spectra.noise import noise_levels
from isorig.rig.acquire.plan import RunPlan
from isorig.rig.errors import PlanError
from isorig.rig.files.rivals import OpenSet, Rivals
from isorig.rig.next.policy import POLICY
from isorig.rig.next.runs import candidate, drive_scale, existing_runs, prospect, run_words

#: Verdicts with an error that no named cause explains, and the question where no candidate cause came near.
UNNAMED = ("unexplained", "partly explained")
NO_CAUSE = "No candidate cause explains the error. Does another excitation reveal its cause?"
EXAMPLE = "give a parameter and a relative uncertainty, e.g. links.spring.damping=2%"


@dataclass(frozen=True, kw_only=True)
class Situation:
    """What is known when the next run is to be chosen."""

    rivals: Rivals  #: The diagnosis that counts, the last.
    taken: Sequence[Prospect]  #: Runs in hand, with their drives.
    limits: Limits  #: Limits for a run; a limit that is not given is what the runs so far reached.
    scale: float  #: The rig's drive over the planned one.
    plans: Mapping[str, RunPlan] = field(default_factory=dict)  #: Runs of earlier plans by id: their drives can be played again.
    declined: Set[str] = frozenset()  #: Runs that the operator did not want, as they are described.

    @property
    def explains(self) -> Variant:
        """The model that explains the runs best."""
        return self.rivals.explains.variant()

    @property
    def start_time(self) -> float:
        """Seconds from the campaign's first sample to the next run's."""
        ends = [run.start_time + run.seconds for run in self.rivals.runs]
        return max(ends, default=-POLICY.pause) + POLICY.pause

    @property
    def configuration(self) -> str:
        """The one that the rig was left in."""
        last = max(self.rivals.runs, key=lambda run: run.start_time, default=None)
        return next(iter(self.explains.model.configurations)) if last is None else last.configuration

    def prospect(self, run: CandidateRun) -> Prospect:
        """A run with its drive, as the next one."""
        return prospect(run, self.rivals.sample_rate, self.start_time, self.scale)

    def run_words(self, run: CandidateRun) -> str:
        """A run in one line."""
        return run_words(run, alone=len(self.explains.model.configurations) == 1)

    def candidates(self) -> tuple[CandidateRun, ...]:
        """All candidate runs within the limits that need no simulation."""
        repeatable = [
            (name, candidate(run))
            for name, run in self.plans.items()
            if run.played and run.repeat_of is None and any(taken.id == name for taken in self.rivals.runs)
        ]
        seed = 1 + len(self.rivals.runs)
        runs = candidate_runs(self.explains.model, self.limits, self.rivals.sample_rate, seed=seed, repeatable=repeatable)
        # A linear step from a first guess is not meaningful: the first run must allow a fit of every parameter.
        allowed = runs if self.taken else tuple(run for run in runs if covers_all_modes(self.explains.model, run))
        return tuple(run for run in allowed if self.run_words(run) not in self.declined)

    def raised(self, factor: float) -> tuple[CandidateRun, ...]:
        """The strongest runs where the highest gain is raised by a factor."""
        assert self.limits.gains is not None
        highest = factor * self.limits.gains[1]
        limits = msgspec.structs.replace(self.limits, gains=(0.0, highest))
        runs = candidate_runs(self.explains.model, limits, self.rivals.sample_rate)
        strongest = (run for run in runs if run.gain == highest and run.seconds <= PROPOSALS.broad_run)
        return tuple(run for run in strongest if run.excitation in ("random", "moves"))


@dataclass(frozen=True, kw_only=True)
class Proposed:
    """A run of a proposal: the comparison of causes behind it, or `remarks` that say why it is taken.

    `peaks` is what the surviving models reach in it, where they were simulated.
    """

    run: CandidateRun
    choice: Choice | None = None
    remarks: tuple[str, ...] = ()
    peaks: LargestMotions | None = None


#: What a proposal is about: causes that the data cannot tell apart, causes of which none earned a name, whether the remainder is
#: reproducible at all, causes that have not been searched for yet, or a parameter's deviation.
ProposalKind = Literal["rivals", "undecided", "reproducible", "untested", "parameter"]


@dataclass(frozen=True, kw_only=True)
class Proposal:
    """What to measure next: the runs, best first; none where no allowed run gains anything.

    `chosen` is the comparison behind them, without `unreached` candidates that there was no time for; `asked` is the question,
    where it is another than the kind's own; `remedies` are pairs of causes that no allowed run distinguishes, and what would.
    """

    kind: ProposalKind
    runs: tuple[Proposed, ...] = ()
    chosen: Chosen | None = None
    unreached: int = 0
    asked: str = ""
    remedies: Mapping[tuple[Key, Key], Sequence[Remedy]] = field(default_factory=dict)


def single_driven(model: RigModel) -> RigModel:
    """The rig, if it has a single drive. Raises PlanError if it has several: their levels would have to be chosen together."""
    if model.more_drives:
        raise PlanError(
            f"the rig {model.name!r} has the drives {', '.join(model.drive_channels)}, and runs are proposed "
            "for a rig with a single drive; choose its next run by hand"
        )
    return model


def situation(
    diagnoses: Sequence[Rivals], limits: Limits, plans: Mapping[str, RunPlan] | None = None, declined: Set[str] = frozenset()
) -> Situation:
    """What several diagnoses of one rig, the last one counting, say together. Raises PlanError if they are of different rigs, of
    one that no spring holds, or of one that was never driven."""
    last = diagnoses[-1]
    model = last.explains.model
    plans = plans or {}
    if floats(model):
        raise PlanError(
            f"the rig {model.name!r} has a body that no spring holds, whose motion cannot be predicted; "
            "choose its next run by hand"
        )
    single_driven(model)
    names = [tuple(each.explains.model.configurations) for each in diagnoses]
    if len({(d.explains.model.name, n) for d, n in zip(diagnoses, names, strict=True)}) > 1:
        raise PlanError("the diagnoses are of different rigs; give diagnoses of one rig")
    # What was ruled out as the only cause may be there in addition to another one.
    ruled_out = {key for each in diagnoses for key in each.ruled_out} - set(last.named) if len(last.named) < 2 else set()
    open_ = [_without_ruled_out(one, ruled_out) if one.why == "indistinguishable" else one for one in last.open]
    open_.sort(key=lambda one: one.why == "undecided")
    earlier = [run for each in diagnoses[:-1] for run in each.runs]
    both = msgspec.structs.replace(last, open=open_, runs=[*earlier, *last.runs])
    if both.runs and not any(run.driven for run in both.runs):
        raise PlanError(
            f"no run of {last.campaign} was driven, so no drive can be proposed; release the rig from another position, and "
            "repeat one release"
        )
    scale = drive_scale(both.runs)
    taken = existing_runs(both.runs, plans, last.sample_rate, scale)
    return Situation(
        rivals=both,
        taken=taken,
        limits=_completed_limits(both, model, limits, taken),
        scale=scale,
        plans=plans,
        declined=declined,
    )


def _without_ruled_out(one: OpenSet, ruled_out: Set[Key]) -> OpenSet:
    # A set without the causes that an earlier run ruled out; a twin has the equations of one of them, so it goes with the last.
    models = [model for model in one.models if model.key not in ruled_out]
    twins = [key for key in one.twins if models and key not in ruled_out]
    return msgspec.structs.replace(
        one, models=models, twins=twins, unfitted=[key for key in one.unfitted if key not in ruled_out]
    )


def _completed_limits(rivals: Rivals, model: RigModel, limits: Limits, taken: Sequence[Prospect]) -> Limits:
    # Limits that are not given are what the runs so far reached.
    driven = [run for run in rivals.runs if run.driven]
    gains = limits.gains or ((0.0, max(run.gain for run in driven)) if driven else None)
    bands = [run.band for run in driven if run.band is not None]
    band = limits.band or ((min(b[0] for b in bands), max(b[1] for b in bands)) if bands else None)
    if gains is None or band is None:
        raise PlanError(
            "neither the limits nor the runs so far determine the allowed gains and band; give limits.gains and limits.band"
        )
    stated = reached_so_far(limits, model, largest_of([one.peaks([model]) for one in taken])) if taken else limits
    return msgspec.structs.replace(stated, gains=gains, band=band, seconds=limits.seconds or POLICY.longest_run)


def propose(
    now: Situation, *, budget: float = 60.0, work: float = POLICY.comparison_seconds, most: int = PROPOSALS.most_runs,
    tell: Callable[[str], None] = lambda text: None,
) -> Proposal:  # fmt: skip
    """The next runs, for the most pressing question that is open.

    Indistinguishable causes come first, then causes that are not certain, then causes that are not identifiable so far. The runs
    may take `budget` seconds of measuring together, their comparison `work` seconds of processor time; there are at most `most`,
    in addition to one at rest.
    """
    found = _most_pressing(now, _Allowed(budget, most, Deadline(work), tell))
    return replace(found, runs=(*_rest_first(now), *found.runs))


class _Allowed(NamedTuple):
    # Seconds of measuring and number of the runs, time to compare them, and what receives its progress.
    budget: float
    most: int
    deadline: Deadline
    tell: Callable[[str], None]


def _most_pressing(now: Situation, allowed: _Allowed) -> Proposal:
    for one in now.rivals.open:
        variants = tuple(model.variant() for model in one.models)
        if len(variants) < 2:
            continue
        if one.why == "undecided" and (again := _repetition(now, allowed.budget)) is not None:
            return Proposal(kind="reproducible", runs=(again,))
        kind: ProposalKind = "rivals" if one.why == "indistinguishable" else "undecided"
        return _compared(now, kind, Question(truths=variants, rivals=variants), now.candidates(), allowed)
    if now.rivals.verdict in UNNAMED and (again := _repetition(now, allowed.budget)) is not None:
        return Proposal(kind="reproducible", runs=(again,))
    if now.rivals.verdict in UNNAMED and (stronger := _stronger_run(now, allowed.budget)) is not None:
        return Proposal(kind="undecided", runs=(stronger,), asked=NO_CAUSE)
    question = Question(truths=_hypothetical_causes(now), rivals=(now.explains,), supposed=True)
    # At a single frequency many causes change amplitude and phase alike: a sine shows that there is a cause, not which one.
    broad = tuple(run for run in now.candidates() if run.excitation != "sine")
    found = _compared(now, "untested", question, broad, allowed)
    return found if found.runs else _compared(now, "untested", question, now.candidates(), allowed)


def _compared(
    now: Situation, kind: ProposalKind, question: Question, runs: Sequence[CandidateRun], allowed: _Allowed
) -> Proposal:
    budget, most, deadline, tell = allowed
    prospects = [now.prospect(run) for run in runs]
    # Where the time runs out those that were compared are a fair sample.
    prospects = [prospects[k] for k in np.random.default_rng(2).permutation(len(prospects))]
    comparison = Comparison(question, now.rivals.noise, now.taken)
    with deadline:
        seen = comparison.seen(prospects, now.limits, tell)
    surviving = (*question.rivals, *(question.truths if question.supposed else (now.explains,)))
    models = [model for variant in surviving for model in models_within_limits(variant)]

    def kept(one: Prospect) -> LargestMotions:
        return one.peaks(models, whole=True)

    def beyond(factor: float) -> list[Prospect]:
        return [now.prospect(run) for run in now.raised(factor)]

    found = choose(comparison, seen, now.limits, kept, configuration=now.configuration, budget=budget, most=most)
    remedies = {}
    # Whichever of the two causes is the truth; hypothetical causes have one rival only.
    pairs = dict.fromkeys((min(keys), max(keys)) for keys in ((apart.truth.key, apart.rival.key) for apart in found.best))
    for pair in () if question.supposed else pairs:
        if pair_distance(found.best, pair) < PROPOSALS.indistinguishable:
            with deadline:
                cures = beyond_limits(comparison, pair, beyond, kept, tell), another_sensor(comparison, seen, pair, tell)
            remedies[pair] = [cure for cure in cures if cure is not None]
    return Proposal(
        kind=kind, runs=tuple(Proposed(run=one.prospect.run, choice=one, peaks=one.peaks) for one in found.choices),
        chosen=found, unreached=len(prospects) - found.compared - len(seen.refused), remedies=remedies,
    )  # fmt: skip


def _hypothetical_causes(now: Situation) -> tuple[Variant, ...]:
    # Sizes are relative to the peaks of the strongest allowed runs.
    model, rate, limits = now.explains.model, now.rivals.sample_rate, now.limits
    strong = [run for run in candidate_runs(model, limits, rate) if limits.gains is not None and run.gain == limits.gains[1]]
    seen = [now.prospect(run) for run in strong if run.excitation in ("random", "moves")]
    peaks = [one.peaks([model]) for one in (*seen, *now.taken)]
    reached = largest_of([found for found in peaks if not found.beyond(limits)] or peaks)
    return hypotheses(model, reached, rate)


def _repetition(now: Situation, budget: float) -> Proposed | None:
    # The drive of the run with the largest misfit, if no drive was repeated yet: is the remaining error reproducible?
    if any(run.repeat_of is not None for run in now.rivals.runs):
        return None
    names = [now.rivals.worst, *(run.id for run in now.rivals.runs)]
    name = next((each for each in names if each in now.plans), "")
    plan = now.plans.get(name)
    if plan is None or not plan.played or plan.seconds > budget:
        return None
    return Proposed(run=replace(candidate(plan), repeat_of=name))


def _stronger_run(now: Situation, budget: float) -> Proposed | None:
    # Where no candidate cause explains the error: the random drive, not measured yet, under which a link moves furthest beyond
    # what the runs so far reached, in the configuration of the largest error. What an unknown cause depends on is then seen over
    # the widest range.
    if not now.taken:
        # No drive of the runs so far can be generated again, so what they reached is unknown.
        return None
    model = now.explains.model
    where = {run.configuration for run in now.rivals.runs if run.id == now.rivals.worst} or set(model.configurations)
    known = {(run.configuration, run.excitation, run.gain, run.band) for run in now.rivals.runs}
    runs = [
        r
        for r in now.candidates()
        if r.excitation == "random" and r.repeat_of is None and r.seconds <= min(PROPOSALS.broad_run, budget)
    ]
    runs = [r for r in runs if r.configuration in where and (r.configuration, r.excitation, r.gain, r.band) not in known]
    reached = largest_of([one.peaks([model]) for one in now.taken]).stroke
    ranked = []
    for one in map(now.prospect, runs):
        peaks = one.peaks([model])
        if not peaks.beyond(now.limits):
            ratios = [size / reached[name] for name, size in peaks.stroke.items() if reached.get(name, 0.0) > 0.0]
            ranked.append((max(ratios, default=0.0), one))
    models = models_within_limits(now.explains)
    for ratio, one in sorted(ranked, key=lambda item: -item[0]):
        peaks = one.peaks(models, whole=True)
        if ratio > 1.0 and not peaks.beyond(now.limits):
            return Proposed(run=one.run, peaks=peaks, remarks=(f"A link moves {ratio:.2g} times as far as in the runs so far.",))
    return None


def _rest_first(now: Situation) -> tuple[Proposed, ...]:
    # A run at rest, where what the runs so far show of the noise may be the rig's own motion: friction moves at all frequencies.
    if any(run.excitation == "free" for run in now.rivals.runs):
        return ()
    model = now.explains.model
    shown = [
        one.measured(simulate(model, one.excitation(), configuration=one.run.configuration, start_time=one.start_time).channels)
        for one in now.taken
    ]
    own = noise_levels(Campaign(runs=tuple(shown)), model.drive_channels) if shown else {}
    hidden = [name for name, level in now.rivals.noise.items() if own.get(name, np.inf) > POLICY.own_motion * level]
    return (Proposed(run=run_at_rest(model, now.limits)),) if hidden else ()


def required_uncertainty(text: str) -> tuple[str, float]:
    """Parameter and required relative uncertainty from the command line, e.g. links.spring.damping=2%. Raises PlanError if the
    text is not valid."""
    name, _, size = text.partition("=")
    try:
        percent = float(size.strip().removesuffix("%"))
    except ValueError:
        percent = -1.0
    if not name.strip() or not size.strip().endswith("%") or not (isfinite(percent) and percent > 0.0):
        raise PlanError(f"--for is {text!r}; {EXAMPLE}")
    return name.strip(), percent / 100.0


def propose_for(now: Situation, name: str, wanted: float, *, budget: float, tell: Callable[[str], None]) -> Proposal:
    """The runs after which a parameter has the wanted relative uncertainty. Raises PlanError if the rig has no such parameter, or
    it does not depend on fitted values."""
    variant = now.explains
    try:
        known = KnownPrecision(variant, parameter_by_name(variant.model, name), now.rivals.noise, now.taken)
    except AnalysisError as error:
        raise PlanError(f"--for {name}: {error}") from None
    runs = [
        replace(run, seconds=min(PROPOSALS.longer * run.seconds, now.limits.seconds or run.seconds)) for run in now.candidates()
    ]
    prospects = [now.prospect(run) for run in runs if run.repeat_of is None]
    with Deadline(POLICY.comparison_seconds):
        candidates = evaluated(prospects, known.information, tell)
    models = models_within_limits(variant)
    found = runs_for_uncertainty(
        known, candidates, now.limits, lambda one: one.peaks(models, whole=True), wish=wanted,
        configuration=now.configuration, budget=budget,
    )  # fmt: skip
    how = "the error bars of the transfer functions" if known.linear else "the waveforms"
    std = known.std(known.now)
    sentences = [
        f"{name} is {known.value:.5g} now, with a standard uncertainty of {_percent(std)}; {_percent(wanted)} "
        f"is required. {len(candidates)} candidate runs were compared by {how} that they would give."
    ]
    last = found[-1].std if found else std
    if std <= wanted:
        sentences.append("The required uncertainty is reached already.")
    elif last > wanted:
        sentences.append(f"No allowed runs of {budget:g} s together reach it; these reach {_percent(last)}.")
    return Proposal(
        kind="parameter", asked=" ".join(sentences), unreached=len(prospects) - len(candidates),
        runs=tuple(
            Proposed(
                run=item.prospect.run, peaks=item.peaks,
                remarks=(f"It reduces the standard uncertainty of {name} to {_percent(item.std)}.",),
            )
            for item in found
        ),
    )  # fmt: skip


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %"
