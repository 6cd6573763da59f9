"""The conclusion of a diagnosis in four sentences: the cause with its size, the error, what was ruled out, what to do next.

It is derived from the content of findings.json alone, so a page, the terminal and a summary of old answers agree.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot, inf

from isorig.analysis.diagnose.causes import CATALOGUE
from isorig.analysis.diagnose.causes.base import Kind
from isorig.analysis.diagnose.policy import POLICY
from isorig.analysis.fitting.excess import SIMULATION_LIMIT
from isorig.analysis.fitting.residual_analysis import UNRELATED
from isorig.analysis.wording import MULTIPLE, fall, first_of, in_per_cent, noise_alone, sized, with_article, with_std, words
from isorig.rig.files.findings import CauseAt, Findings, HeldValue, NamedCause, TriedCause, Value

#: What a cause is, by its name in the findings: {place}, and its parameters by name, as value with uncertainty; and without
#: parameters that are zero within their uncertainty, or that its law does not have.
PHRASES: Mapping[str, str] = {cause.name: cause.phrase for cause in CATALOGUE}
WITHOUT: Mapping[str, Mapping[tuple[str, ...], str]] = {cause.name: cause.phrases_without for cause in CATALOGUE}
KINDS: Mapping[Kind, str] = {
    "spring_shape": "a nonlinear spring force over deflection",
    "damping_shape": "a nonlinear damping force",
    "friction_shape": "a dry friction level",
    "memory": "a force that depends on the history of the motion",
    "drift": "a value that changes during the session",
    "added_motion": "an additional degree of freedom",
    "known_value": "a wrong given value",
    "sensor": "a channel's static curve or transfer function",
}
#: What a part of an unexplained error is, by its name in the budget.
NATURES: Mapping[str, str] = {
    "noise": "is the noise of the sensors",
    "disturbance": "is motion that the drive did not cause",
    "linear": "could be removed by a linear model with more modes",
    "amplitude": "changes with the amplitude, as small nonlinearities of several parts do",
    "time": "changes during the session",
}
#: Lower limit of a part's 95 % interval from which the part is most of the error.
MOST = 0.5
#: Number of ruled-out causes that are named.
NAMED = 3
#: Error that named causes leave, in multiples of what noise and the simulation cause, above which a part of the answer is said
#: to be missing. Chosen: 14 of 101 answers to rigs of other programs left more; 13 lacked a cause or had the nearest form.
OPEN = 4.0
#: Units of time of a drift, the longest first: the first one that is no longer than the session counts.
TIMES: Mapping[str, float] = {"hour": 3600.0, "minute": 60.0, "second": 1.0}
NOT_AVAILABLE = "not available"


@dataclass(frozen=True, kw_only=True)
class Conclusion:
    """What a colleague would answer."""

    check: str  #: What to check before anything else is believed; empty if nothing.
    #: The verdict, the causes with their sizes, the held-out errors before and after, and what noise alone would cause.
    answer: str
    #: The fitted causes: those of the kind and place to which the equations of motion point, those that were rejected, and those
    #: that were not; empty if nothing was fitted.
    ruled_out: str
    next: str  #: What to do.

    @property
    def lines(self) -> list[str]:
        """All sentences, without empty ones."""
        return [line for line in (self.check, self.answer, self.ruled_out, self.next) if line]


def conclude(findings: Findings, folder: str | None = None) -> Conclusion:
    """The conclusion from the findings; `folder` is where they are, None for a page next to them."""
    doubts = " ".join(doubt.text for doubt in findings.doubts)
    return Conclusion(
        check=f"Check units, channels and given values first: {doubts}" if doubts else "",
        answer=f"{_found(findings)}; {_error(findings)}",
        ruled_out=_ruled_out(findings),
        next=_next(findings, folder),
    )


def cause_in_words(step: NamedCause) -> str:
    """A step of the findings: its cause, place and parameters."""
    place, values = with_article(step.location), step.parameters
    if step.form is None:
        near = f", closest to {words(step.closest_form.cause)}" if step.closest_form else ", of no catalogued form"
        return f"{KINDS[step.kind]} at {place}{_over_position(step)}{near}"
    shown = {name: _size(row) for name, row in values.items()} | _derived(values)
    if "drift_rate" in values:
        shown["change"] = _change(values["drift_rate"], step.held.get("until"))
    try:
        others = WITHOUT.get(step.cause, {})
        stated = {name for name, row in values.items() if not _is_zero(row)}
        phrase = next((other for names, other in others.items() if stated.isdisjoint(names)), PHRASES[step.cause])
        phrase = phrase if step.kind == "sensor" else phrase.replace("the {place}", "{place}")
        return phrase.format(place=words(step.location) if step.kind == "sensor" else place, **shown)
    except KeyError:  # a cause, or its parameters, that these phrases do not have
        listed = ", ".join(f"{words(name)} {size}" for name, size in shown.items() if name in values)
        return f"{words(step.cause)} at {place}" + (f", {listed}" if listed else "")


def _over_position(step: NamedCause) -> str:
    # The least and the largest value of a friction or damping that depends on the position, where the runs reach.
    if not step.curve or (step.kind, step.curve.over) not in (("friction_shape", "position"), ("damping_shape", "deflection")):
        return ""
    low, high = step.curve.reached
    levels = [value for place, value, _ in step.curve.points if low <= place <= high and value is not None]
    least, largest = (sized(end(levels, default=0.0), step.curve.value_unit) for end in (min, max))
    return f" that depends on the {step.curve.over}, from {least} to {largest}"


def _is_zero(row: Value) -> bool:
    return row.value is not None and row.std is not None and abs(row.value) < row.std


def _size(row: Value, factor: float = 1.0) -> str:
    if row.value is None:
        return NOT_AVAILABLE
    return sized(factor * row.value, row.unit, None if row.std is None else factor * row.std)


def _change(rate: Value, session: HeldValue | None) -> str:
    # A drift's rate in 1/s in per cent of the constant, over a unit of time that fits the session's length in s.
    if rate.value is None:
        return NOT_AVAILABLE
    length = session.value if session is not None and session.value is not None else inf
    name, unit = next(((name, unit) for name, unit in TIMES.items() if unit <= length), ("second", 1.0))
    value, std = 100.0 * unit * rate.value, 100.0 * unit * (rate.std or 0.0)
    return f"{with_std(value, std, sign=True) if std else f'{value:+.3g}'} % per {name}"


def _derived(values: Mapping[str, Value]) -> dict[str, str]:
    # Sizes that are easier to picture than the parameters themselves.
    found = {}
    if "clearance" in values:
        row = values["clearance"]
        found = {"play": _size(row, 2.0), "clearance_alone": _size(Value(value=row.value, std=None, unit=row.unit))}
    if "stroke" in values:
        end = values["end"].value if "end" in values else None
        found["at_end"] = {1.0: " (only of positive deflection)", -1.0: " (only of negative deflection)"}.get(end or 0.0, "")
    if "delay" in values and (delay := values["delay"]).value is not None:
        # A drive that acts later than its record tells is ahead of what it moves.
        size = _size(Value(value=abs(delay.value), std=delay.std, unit=delay.unit))
        found["shifted"] = f"{'late' if delay.value >= 0.0 else 'ahead of the others'} by {size}"
    return found


def _found(findings: Findings) -> str:
    verdict = findings.verdict
    if verdict == "adequate":
        return f"adequate: the model explains the data {_down_to(findings)}"
    if findings.doubts and all(candidate.holdout_error is None for candidate in findings.candidates):
        return f"{verdict}: no cause was searched for, because the records contradict the description"
    late = "; the time limit ended the search for causes before all were tried" if findings.cut_short else ""
    if findings.pointed is not None:
        kind, place = KINDS[findings.pointed.kind], with_article(findings.pointed.location)
        return f"{verdict}: the equations of motion of the records point to {kind} at {place}, which no fit confirms yet{late}"
    if not findings.steps:
        return (
            f"{verdict}: the model misfits, and no place and kind of cause is certain enough to be named{_nature(findings)}{late}"
        )
    return f"{verdict}: {', and '.join(cause_in_words(step) for step in findings.steps)}{late}"


def _down_to(findings: Findings) -> str:
    # What bounds the error of an adequate model: the user's tolerance, what repeated runs do not share, what else is related to
    # neither drive nor motion, or the noise.
    worst, threshold = findings.adequacy.worst, findings.adequacy.threshold
    if findings.tolerance and worst is not None and threshold is not None and worst >= threshold:
        return f"to within the tolerance of {in_per_cent(findings.tolerance)}"
    if findings.chain_errors is not None:
        listed = f" ({', '.join(findings.chain_errors)})" if findings.chain_errors else ""
        return f"down to small errors of its channels{listed} and to what is {UNRELATED}"
    if not _disturbed(findings):
        return "down to the noise"
    known = "the disturbance between repeated runs"
    return f"down to {known if _is_measured(findings) else f'what is {UNRELATED}'}"


def _disturbed(findings: Findings) -> bool:
    # Whether more of the error is motion that the drive did not cause than noise of the sensors.
    shares = findings.budget.extended
    return (shares.disturbance.value or 0.0) > (shares.noise.value or 0.0)


def _is_measured(findings: Findings) -> bool:
    # Whether the noise floor contains the disturbance, as repeated runs show it.
    return not _leaves_more_than_noise(findings)


def _nature(findings: Findings) -> str:
    # What most of the unexplained error is, where that is certain.
    for nature, what in NATURES.items():
        share = getattr(findings.budget.extended, nature)
        if (share.low or 0.0) >= MOST:
            return f"; {in_per_cent(share.value)} of the error's power {what}"
    return ""


def _error(findings: Findings) -> str:
    holdout = findings.holdout
    required = _required(findings)
    if _is_lost(findings):
        return f"no simulation follows this motion, but {required}"
    falls, left = f"is {in_per_cent(holdout.baseline)}", holdout.baseline
    if findings.steps:
        falls, left = fall(holdout.baseline, holdout.extended), holdout.extended
    disturbed, size = _disturbed(findings) and _is_measured(findings), noise_alone(holdout.noise_floor)
    # The floor is an estimate: an error below it is no contradiction.
    below = left < holdout.noise_floor
    noise = f"noise {'and disturbance alone are' if disturbed else 'alone is'} {size}"
    if below:
        noise = f"below what noise{' and disturbance' * disturbed} may cause ({size})"
    is_open = findings.verdict == "explained" and not below and _leaves_more_than_noise(findings, OPEN)
    rest = required or ("the excess is not noise: a smaller cause, or a part of this one, is not found" if is_open else "")
    return "; ".join(filter(None, (f"the error on held-out data {falls}, {noise}", rest)))


def _is_lost(findings: Findings) -> bool:
    # Whether no simulation follows the motion, so that the required force alone shows the cause.
    return findings.required_force is not None and not findings.required_force.follows


def _required(findings: Findings) -> str:
    # What the last cause leaves of the force that the recorded motion requires at its place, if that shows the cause.
    force = findings.required_force
    if force is None or not findings.steps:
        return ""
    return (
        f"of the force that the motion requires at {findings.steps[-1].location} the model leaves {in_per_cent(force.extended)} "
        f"on held-out data, and the model without the cause {in_per_cent(force.baseline)}"
    )


def _ruled_out(findings: Findings) -> str:
    unconfirmed, out = _fitted(findings, "not confirmed"), _removing(_fitted(findings, "ruled out"))
    named = {(step.cause, step.location) for step in findings.steps}
    # What is said to be closest to a named curve is not said to be ruled out.
    closest = {(step.closest_form.cause, step.location) for step in findings.steps if step.closest_form is not None}
    out = [pair for pair in out if (pair[1].cause, pair[1].location) not in closest]
    # Those that the data cannot distinguish from a named cause are listed as such.
    open_ones = ("main contributor",) if findings.steps else ("main contributor", "one of several")
    unsure = [pair for pair in _removing(_fitted(findings, *open_ones)) if (pair[1].cause, pair[1].location) not in named]
    said = []
    there = findings.pointed and (findings.pointed.kind, findings.pointed.location)
    lost = [pair for pair in unconfirmed if (pair[1].kind, pair[1].location) != there or pair[0] > findings.holdout.baseline]
    unconfirmed = [pair for pair in unconfirmed if pair not in lost]
    if unconfirmed:
        said.append(f"Of this kind and place, not confirmed, with the error each leaves: {_listed(unconfirmed)}.")
    if unsure:
        which = "each leaves" if len(unsure) > 1 else "it leaves"
        said.append(f"Not certain enough to be named, with the error {which}: {_listed(unsure)}.")
    # What leaves less than the model with its causes, or than the cause that is not certain, was tried on top of these.
    reached = findings.holdout.extended if findings.steps else min((error for error, _ in unsure), default=0.0)
    further = [pair for pair in out if pair[0] < reached]
    out = [pair for pair in out if pair not in further]
    further = [pair for pair in further if POLICY.matters * pair[0] < reached]
    if further and reached >= findings.holdout.noise_floor:
        said.append(f"Tried in addition, and not certain, with the error then left: {_listed(further)}.")
    if out:
        said.append(f"{ruled_out_in_words(findings)}, with the error each leaves: {_listed(out)}.")
    if lost:
        said.append(f"Neither confirmed nor ruled out, because no fit followed the motion: {_listed(lost)}.")
    for named_one, *alike in findings.indistinguishable:
        it = _at(named_one) if len(findings.steps) > 1 else "it"
        said.append(f"Not distinguishable from {it} by these runs: {', '.join(map(_at, alike))}.")
    return " ".join(said)


def _at(one: CauseAt) -> str:
    return f"{words(one.cause)} at {with_article(one.location)}"


def ruled_out_in_words(findings: Findings) -> str:
    """What the causes that were rejected are: a cause that was fitted alone may still be there in addition to another one."""
    return "Ruled out as the only cause" if len(findings.steps) > 1 or _leaves_more_than_noise(findings) else "Ruled out"


def _leaves_more_than_noise(findings: Findings, times: float | None = None) -> bool:
    # Whether the last model's error is clearly above the noise, by default so that there may be another cause.
    threshold = times or findings.adequacy.threshold or POLICY.enough
    return findings.holdout.extended > threshold * hypot(findings.holdout.noise_floor, SIMULATION_LIMIT)


def _removing(fitted: Sequence[tuple[float, TriedCause]]) -> list[tuple[float, TriedCause]]:
    # Those that leave less than the model without them.
    return [pair for pair in fitted if pair[1].share is not None and pair[1].share > 0.0]


def _fitted(findings: Findings, *standings: str) -> list[tuple[float, TriedCause]]:
    # Fitted candidates of some status with their held-out errors, the smallest first.
    fitted = [(c.holdout_error, c) for c in findings.candidates if c.standing in standings and c.holdout_error is not None]
    return sorted(fitted, key=lambda pair: pair[0])


def _listed(fitted: Sequence[tuple[float, TriedCause]]) -> str:
    return first_of([f"{words(c.cause)} at {with_article(c.location)} ({_left(error)})" for error, c in fitted], NAMED)


def _left(error: float) -> str:
    # A simulation whose error is many times the signal does not follow the motion at all; by how much says nothing.
    return "loses the motion" if error >= MULTIPLE else in_per_cent(error)


def _next(findings: Findings, folder: str | None) -> str:
    model = "model.json" if folder is None else f"{folder}/model.json"
    if findings.doubts:
        return "Next: correct what is doubtful above, then diagnose again."
    if findings.cut_short:
        return "Next: repeat with more time (--seconds); causes may have been missed."
    if findings.indistinguishable or findings.verdict in ("unexplained", "partly explained"):
        another = "no run was driven, so release the rig from another position, repeat one release, then diagnose again"
        proposed = f"rig next {folder or 'on this folder'} proposes the run that decides what is open"
        unsure = ([one.location for one in group if one.cause == "wrong_mass"] for group in findings.indistinguishable)
        masses = " and ".join(next((map(with_article, places) for places in unsure if len(places) > 1), ()))
        weigh = f"weigh {masses}, because these runs do not show which of the given masses is wrong"
        return f"Next: {weigh if masses else proposed if findings.driven else another}."
    if findings.verdict == "adequate":
        return f"Next: use the model: rig predict {model} predicts other runs."
    if any(step.kind in ("sensor", "known_value") for step in findings.steps):
        return f"Next: correct the recording or the description; {model} contains the correction (rig predict)."
    if_followed = f", or predict with {model}, which contains the cause (rig predict)"
    return f"Next: repair the place{'; no simulation predicts this motion' if _is_lost(findings) else if_followed}."
