"""A proposal in words: the purpose of each run, what it cannot distinguish, and what would."""

from collections.abc import Sequence

from isorig.analysis.campaign import SI_UNIT
from isorig.analysis.model.limits import Limits
from isorig.analysis.model.parameter_units import unit_of
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.proposals.choice import Choice, PairDistance
from isorig.analysis.proposals.limits import LargestMotions
from isorig.analysis.proposals.policy import POLICY as PROPOSALS
from isorig.analysis.proposals.prediction import Key, Variant
from isorig.analysis.proposals.remedies import SECOND, Remedy, pair_distance
from isorig.analysis.simulate.gauges import DEFLECTION
from isorig.analysis.wording import capitalized, first_of, with_article, words
from isorig.rig.files.rivals import Rivals
from isorig.rig.next.policy import POLICY
from isorig.rig.next.proposal import Proposal, Proposed, Situation
from isorig.rig.next.runs import run_words

ASKED = {
    "rivals": "Which of the indistinguishable causes is the true one?",
    "undecided": "Which of the causes that explain part of the error, but are not certain, is the true one?",
    "reproducible": "Is the unexplained error reproducible with the same drive?",
    "untested": "Is there a cause that is not identifiable from the runs so far?",
}


def named(key: Key) -> str:
    """A cause at its place."""
    return f"{words(key[0])} at {key[1]}"


def cause(variant: Variant) -> str:
    """The cause that a model has, with what distinguishes it from others of the same cause at its place."""
    return f"{named(variant.key)} {variant.detail}".rstrip() if variant.cause else "the model without a further cause"


def reasons(item: Proposed, proposal: Proposal, now: Situation) -> list[str]:
    """The reasons for a run, in sentences."""
    if item.run.rests:
        why = ", because friction excites all frequencies" if now.explains.model.contacts else ""
        hidden = f"In the runs so far the rig's own motion masks the noise{why}."
        return ["At rest the sensors show their own noise and hum.", hidden if now.rivals.runs else "They are not known yet."]
    sentences = list(item.remarks)
    if item.choice is not None:
        supposed = proposal.kind == "untested"
        sentences += [*(_shows(item.choice) if supposed else _parts(item.choice)), _after(item.choice, supposed)]
    elif item.run.repeat_of is not None:
        sentences.append(
            f"It repeats the drive of {item.run.repeat_of}: the difference between the two runs is not caused by the drive, so "
            "no model can explain it."
        )
    return [*sentences, *([] if item.peaks is None else _uses(item.peaks, now.limits, now.explains.model))]


def _parts(choice: Choice) -> list[str]:
    sentences = []
    for apart in sorted(choice.apart, key=lambda apart: -apart.distance)[: POLICY.listed]:
        sentences.append(
            f"If {cause(apart.truth)} is true, the error of {cause(apart.rival)}, refitted to all runs, is "
            f"{_errors(apart.distance)} in this run: {_chance(apart)}."
        )
    return sentences


def _chance(apart: PairDistance) -> str:
    if apart.distance >= PROPOSALS.distinguishable:
        return "this distinguishes them"
    return "this may distinguish them" if apart.distance > PROPOSALS.indistinguishable else "this does not distinguish them"


def _shows(choice: Choice) -> list[str]:
    shown = sorted(
        (apart for apart in choice.apart if apart.distance >= PROPOSALS.distinguishable), key=lambda apart: -apart.distance
    )
    if not shown:
        return []
    first, *others = dict.fromkeys(cause(apart.truth) for apart in shown)
    names = [f"{first} (by {_errors(shown[0].distance)})", *others]
    return [f"Together with the runs so far it would reveal, at the smallest relevant size, {first_of(names, POLICY.listed)}."]


def _after(choice: Choice, supposed: bool) -> str:
    if supposed:
        return (
            f"Of all causes of the catalogue at that size, {100 * choice.probability:.0f} % would be revealed after it, "
            f"{100 * choice.gained:.0f} % because of it."
        )
    return f"The probability that one cause is identified after it is {choice.probability:.2f}."


def _uses(peaks: LargestMotions, limits: Limits, model: RigModel) -> list[str]:
    # Strokes in mm, of rotations in mrad.
    units = {name: f"m{unit_of(f'links.{name}.laws.0.stroke', model)}" for name in limits.stroke}
    uses = [
        f"{1e3 * peaks.stroke[name]:.3g} of {1e3 * most:.3g} {units[name]} at {with_article(name)}"
        for name, most in limits.stroke.items()
        if peaks.stroke.get(name, 0.0) > 0.0
    ]
    if limits.drive is not None:
        uses.append(f"a drive of {peaks.drive:.3g} of {limits.drive:.3g} {SI_UNIT[model.drive.quantity]}")
    if limits.force is not None:
        uses.append(f"{peaks.force:.3g} of {limits.force:.3g} N")
    if not uses:
        return []
    return [f"In simulations with every remaining cause and its uncertainty it reaches at most {', '.join(uses)}."]


def _errors(distance: float) -> str:
    return (
        f"{distance:.2g} standard errors"
        if distance < POLICY.stated_distance
        else f"more than {POLICY.stated_distance:g} standard errors"
    )


def inseparable(proposal: Proposal) -> list[str]:
    """Pairs of remaining causes that no allowed run distinguishes, each with what would."""
    if proposal.chosen is None:
        return []
    sentences = []
    for pair, cures in proposal.remedies.items():
        one, other = map(named, pair)
        sentences.append(
            f"No allowed run distinguishes {one} from {other}: their distance in the best of {proposal.chosen.compared} "
            f"candidates is {_errors(pair_distance(proposal.chosen.best, pair))}."
        )
        sentences += [_cure(cure) for cure in cures] or ["Neither three times the gain nor another displacement sensor would."]
        if all(cause == "wrong_mass" for cause, _ in pair):
            sentences.append(f"Weigh {' and '.join(with_article(place) for _, place in pair)}.")
    return sentences


def _cure(cure: Remedy) -> str:
    apart = f"their distance would be {_errors(cure.distance)}"
    if cure.channel:
        place = cure.channel.removeprefix(SECOND).removeprefix(DEFLECTION)
        sensor = f"a displacement sensor across the {place} with a resolution of {1e6 * PROPOSALS.sensor_resolution:g} µm"
        if cure.channel.startswith(SECOND):
            sensor = f"a second accelerometer on the {place}, {1e3 * PROPOSALS.second_sensor_height:g} mm above the first"
        return f"With {sensor}, {apart} in an allowed run: {run_words(cure.prospect.run)}."
    stroke = max(cure.peaks.stroke.items(), key=lambda item: item[1]) if cure.peaks is not None and cure.peaks.stroke else None
    needs = "" if stroke is None else f", which deflects the {stroke[0]} by up to {1e3 * stroke[1]:.3g} mm"
    return f"Beyond the limits, {apart}: {run_words(cure.prospect.run)}{needs}."


def twins(rivals: Rivals) -> list[str]:
    """Pairs of open causes with the same equations."""
    return [
        f"{capitalized(named(key))} and {named(one.models[0].key)} have the same equations of motion: no "
        "run of this rig distinguishes them. Weigh the mass or calibrate the sensor."
        for one in rivals.open
        for key in one.twins
    ]


def unfitted(rivals: Rivals) -> list[str]:
    """Causes that the diagnosis leaves open, but did not fit in full."""
    names = list(dict.fromkeys(named(key) for one in rivals.open for key in one.unfitted))
    return [] if not names else [
        f"The diagnosis does not exclude {first_of(names, POLICY.listed)}, but did not fit it in full: diagnose again with more "
        "--seconds."
    ]  # fmt: skip


def untested(proposal: Proposal) -> list[str]:
    """Causes that none of the compared runs would reveal."""
    if proposal.chosen is None or proposal.kind != "untested":
        return []
    names = list(
        dict.fromkeys(cause(apart.truth) for apart in proposal.chosen.best if apart.distance < PROPOSALS.indistinguishable)
    )
    if not names:
        return []
    return [f"None of the compared runs alone would reveal, at the smallest relevant size: {first_of(names, 2 * POLICY.listed)}."]


def summary(proposal: Proposal, rivals: Rivals) -> list[str]:
    """The proposal in sentences: the question, what cannot be distinguished, what was compared."""
    sentences = [proposal.asked or ASKED[proposal.kind]]
    if not proposal.runs:
        sentences.append("No run is proposed: no allowed run is informative.")
    if proposal.kind != "parameter":
        sentences += inseparable(proposal) + twins(rivals) + unfitted(rivals) + untested(proposal)
    if proposal.chosen is not None:
        sentences.append(_counted(proposal))
    return sentences


def _counted(proposal: Proposal) -> str:
    assert proposal.chosen is not None
    text = f"{proposal.chosen.compared} candidate runs were compared"
    if proposal.chosen.refused:
        text += f", {len(proposal.chosen.refused)} more would exceed a limit"
    if proposal.unreached:
        text += f", and {proposal.unreached} were not reached within the time limit"
    return f"{text}."


def listed(keys: Sequence[Key]) -> str:
    """Causes in a row."""
    *first, last = map(named, keys)
    return f"{', '.join(first)} and {last}" if first else last
