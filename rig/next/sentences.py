"""A proposal in words: what each run is for, what it cannot part, and what would."""

from __future__ import annotations

from collections.abc import Sequence

from isorig.analysis.model.limits import Limits
from isorig.analysis.proposals.choice import Apart, Choice
from isorig.analysis.proposals.limits import DEFLECTION, Peaks
from isorig.analysis.proposals.policy import CANNOT, HIGHER, RESOLVES, WILL
from isorig.analysis.proposals.prediction import Variant
from isorig.analysis.proposals.remedies import SECOND, Remedy
from isorig.rig.next.proposal import Proposal, Proposed, Situation
from isorig.rig.next.runs import described
from isorig.rig.report.sections import words

#: Causes that a sentence lists by name.
LISTED = 4
ASKED = {
    "rivals": "Which of the causes that the data cannot tell apart is it?",
    "undecided": "Which of the causes that explain part of the error, none well enough to be named, is it?",
    "reproducible": "Is what no cause explains the same when the same drive is played again?",
    "untested": "Is there a cause that the runs so far could not have shown?",
}


def cause(variant: Variant) -> str:
    """A cause at its place."""
    return f"{words(variant.cause)} at {variant.location}" if variant.cause else "the model without a further cause"


def reasons(item: Proposed, proposal: Proposal, now: Situation) -> list[str]:
    """Why a run is taken: sentences."""
    if item.run.rests:
        hidden = "In the runs so far the rig's own motion hides the noise, since friction excites all frequencies."
        return ["At rest the sensors show their own noise and hum.", hidden if now.rivals.runs else "Nobody knows these yet."]
    told = list(item.told)
    if item.choice is not None:
        supposed = proposal.kind == "untested"
        told += [*(_shows(item.choice) if supposed else _parts(item.choice)), _after(item.choice, supposed)]
    elif item.run.repeat_of is not None:
        told.append(
            f"It plays the drive of {item.run.repeat_of} again: what the two runs do not share was not caused by the drive, and "
            "no model can explain it."
        )
    return [*told, *([] if item.peaks is None else _uses(item.peaks, now.limits))]


def _parts(choice: Choice) -> list[str]:
    told = []
    for apart in sorted(choice.apart, key=lambda apart: -apart.distance)[:LISTED]:
        told.append(
            f"If it is {cause(apart.truth)}, {cause(apart.rival)}, refitted to all runs, will err by {_errors(apart.distance)} "
            f"in this run: {_chance(apart)}."
        )
    return told


def _chance(apart: Apart) -> str:
    if apart.distance >= WILL:
        return "that parts them"
    return "that may part them" if apart.distance > CANNOT else "that does not part them"


def _shows(choice: Choice) -> list[str]:
    shown = sorted((apart for apart in choice.apart if apart.distance >= WILL), key=lambda apart: -apart.distance)
    names = list(dict.fromkeys(cause(apart.truth) for apart in shown))
    if not names:
        return []
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return [
        f"With the runs so far it would show, at the smallest size worth finding, {', '.join(names[:LISTED])}{more}; "
        f"{names[0]} by {_errors(shown[0].distance)}."
    ]


def _after(choice: Choice, supposed: bool) -> str:
    if supposed:
        return (
            f"Of all causes of the catalogue at that size, {100 * choice.probability:.0f} % would have shown after it, "
            f"{100 * choice.gained:.0f} % because of it."
        )
    return f"The probability that one cause stands after it is {choice.probability:.2f}."


def _uses(peaks: Peaks, limits: Limits) -> list[str]:
    uses = [
        f"{1e3 * peaks.stroke[name]:.3g} of {1e3 * most:.3g} mm at the {name}"
        for name, most in limits.stroke.items()
        if peaks.stroke.get(name, 0.0) > 0.0
    ]
    if limits.drive is not None:
        uses.append(f"a drive of {peaks.drive:.3g} of {limits.drive:.3g}")
    if limits.force is not None:
        uses.append(f"{peaks.force:.3g} of {limits.force:.3g} N")
    if not uses:
        return []
    return [f"In simulations with every surviving cause and its uncertainty it reaches at most {', '.join(uses)}."]


def _errors(distance: float) -> str:
    return f"{distance:.2g} standard errors" if distance < 100.0 else "more than 100 standard errors"


def inseparable(proposal: Proposal) -> list[str]:
    """Pairs of surviving causes that no allowed run parts, each with what would."""
    told = []
    assert proposal.chosen is not None or not proposal.remedies
    for pair, cures in proposal.remedies:
        best = max(
            (a.distance for a in proposal.chosen.best if {a.truth.key, a.rival.key} == set(pair)), default=0.0
        ) if proposal.chosen else 0.0  # fmt: skip
        one, other = (f"{words(cause)} at {place}" for cause, place in pair)
        count = proposal.chosen.compared if proposal.chosen else 0
        told.append(f"No allowed run parts {one} from {other}: the best of {count} candidates leaves them {_errors(best)} apart.")
        told += [_cure(cure) for cure in cures] or ["Neither three times the gain nor another displacement sensor would."]
    return told


def _cure(cure: Remedy) -> str:
    apart = f"they would lie {_errors(cure.distance)} apart"
    if cure.channel:
        place = cure.channel.removeprefix(SECOND).removeprefix(DEFLECTION)
        sensor = f"a displacement sensor across the {place} that resolves {1e6 * RESOLVES:g} µm"
        if cure.channel.startswith(SECOND):
            sensor = f"a second accelerometer on the {place}, {1e3 * HIGHER:g} mm above the first"
        return f"With {sensor} {apart} in an allowed run: {described(cure.prospect.run)}."
    stroke = max(cure.peaks.stroke.items(), key=lambda item: item[1]) if cure.peaks is not None and cure.peaks.stroke else None
    needs = "" if stroke is None else f", which deflects the {stroke[0]} by up to {1e3 * stroke[1]:.3g} mm"
    return f"Beyond the limits {apart}: {described(cure.prospect.run)}{needs}."


def twins(proposal: Proposal) -> list[str]:
    """Pairs of causes that lead to the same equations."""
    return [
        f"{words(one[0]).capitalize()} at {one[1]} and {words(other[0])} at {other[1]} lead to the same equations of motion: no "
        "run of this rig parts them. Weigh the mass or calibrate the sensor."
        for one, other in proposal.twins
    ]


def untested(proposal: Proposal, most: int = 8) -> list[str]:
    """Causes that none of the compared runs would show."""
    if proposal.chosen is None or proposal.kind != "untested":
        return []
    names = [cause(apart.truth) for apart in proposal.chosen.best if apart.distance < CANNOT]
    names = list(dict.fromkeys(names))
    if not names:
        return []
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return [f"None of the compared runs alone would show, at the smallest size worth finding: {', '.join(names[:most])}{more}."]


def summary(proposal: Proposal) -> list[str]:
    """The proposal in some sentences: the question, what cannot be parted, what was compared."""
    told = [proposal.asked or ASKED[proposal.kind]]
    if not proposal.runs:
        told.append("No run is proposed: none that is allowed gains anything.")
    told += inseparable(proposal) + twins(proposal) + untested(proposal)
    if proposal.chosen is not None:
        told.append(_counted(proposal))
    return told


def _counted(proposal: Proposal) -> str:
    assert proposal.chosen is not None
    told = f"{proposal.chosen.compared} candidate runs were compared"
    if proposal.chosen.refused:
        told += f", {len(proposal.chosen.refused)} more would exceed a limit"
    if proposal.unreached:
        told += f", and for {proposal.unreached} there was no time"
    return f"{told}."


def listed(names: Sequence[str]) -> str:
    """Names in a row."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
