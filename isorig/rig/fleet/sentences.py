"""Sentences about a fleet: what changed, when, by how much, and coinciding events."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from isorig.analysis.trends.change import DatedChange
from isorig.analysis.wording import sized, words
from isorig.rig.fleet.catalogue import StoredAnswer
from isorig.rig.fleet.history import DiagnosedCampaign, Fleet, Incident, Track, TrackedRig
from isorig.rig.fleet.policy import POLICY


def parameter_words(name: str) -> str:
    """A parameter in words: "links.isolation.stiffness" is the stiffness of isolation."""
    parts = name.split(".")
    if parts[0] in ("links", "contacts", "bodies", "sensors"):
        return f"{words(parts[-1])} of {words(parts[1])}"
    if len(parts) == 3:
        return f"{words(parts[0])} at {words(parts[1])}, {words(parts[2])}"
    return words(" ".join(parts))


def answer_words(answer: StoredAnswer) -> str:
    """An answer in a line."""
    parts = (answer.verdict, words(answer.cause), answer.reason)
    return f"{answer.rig} {answer.campaign}: {'; '.join(part for part in parts if part)}"


def period(fleet: Fleet, incident: Incident) -> str:
    """Its date, with 95 % certainty."""
    campaigns = fleet.rigs[incident.rig].campaigns
    before, after = campaigns[incident.last_before], campaigns[incident.first_after]
    return f"{before.day} to {after.day}"


def with_unit(value: float, unit: str, digits: int = 4) -> str:
    """A value to significant digits in a unit of its size; a ratio has none.

    Examples
    --------
    >>> with_unit(14370.0, "N/m"), with_unit(1.0204, "1")
    ('14.37 kN/m', '1.02')
    """
    return f"{value:.{digits}g}" if unit in ("", "1") else sized(value, unit, digits=digits)


def change_words(track: Track, change: DatedChange) -> str:
    """A change of a parameter in words."""
    before, after = (with_unit(track.plain(value), track.unit) for value in (change.before, change.after))
    text = f"{parameter_words(track.name)} {track.moved(change)} (from {before} to {after}; {change.kind})"
    return text if abs(change.size) >= POLICY.confirmed_change else f"{text}, not confirmed by the campaigns since"


def changes_words(incident: Incident) -> list[str]:
    """The most significant changes of a date in words, and the number of the others."""
    more = len(incident.changes) - POLICY.stated_changes
    first = [change_words(track, change) for track, change in incident.changes[: POLICY.stated_changes]]
    return [*first, f"{more} more parameters"] if more > 0 else first


def explained(rows: Sequence[Mapping[str, object]]) -> str:
    """The explanations of a change, from the rows of its file."""
    if not rows:
        return "no cause found beyond the campaign-to-campaign scatter"
    first, *others = [cause_words(row) for row in rows if row["alike"]]
    return first + (f"; as likely: {', '.join(others)}" if others else "")


def cause_words(row: Mapping[str, object]) -> str:
    """An explanation in a clause."""
    old, unit = float(str(row["old"])), str(row["unit"])
    after = with_unit(float(str(row["new"])), unit)
    cause, place = words(str(row["cause"])), words(str(row["location"]))
    if math.isfinite(old):
        return f"{cause} of {place} from {with_unit(old, unit)} to {after}"
    return f"{cause} at {place}, {words(str(row['parameter']))} {after}"


def incident_words(fleet: Fleet, incident: Incident, rows: Sequence[Mapping[str, object]] | None) -> str:
    """A change of a rig in a line; `rows` are its explanations, None if they were not searched for."""
    parts, campaigns = changes_words(incident), fleet.rigs[incident.rig].campaigns
    if incident.named:
        causes = " and ".join(f"{words(named.cause)} (named from {campaigns[named.first].day} on)" for named in incident.named)
        then = f"; {'; '.join(parts)}" if parts else ""
        return f"{incident.rig} changed, {period(fleet, incident)}: the diagnosis names the cause, {causes}{then}"
    why = "" if rows is None else f"; explained by {explained(rows)}" if rows else f"; {explained(rows)}"
    return f"{incident.rig} changed, {period(fleet, incident)}: {'; '.join(parts)}{why}"


def coinciding_events(fleet: Fleet, incident: Incident) -> list[str]:
    """Sentences about events that coincide with a change."""
    rig = fleet.rigs[incident.rig]
    begin, end = rig.campaigns[incident.last_before].started, rig.campaigns[incident.first_after].started
    sentences = []
    others = [
        other for other in fleet.incidents
        if other.rig != rig.name and other.confirmed
        and begin < fleet.rigs[other.rig].campaigns[other.first].started <= end
    ]  # fmt: skip
    if others:
        names = ", ".join(dict.fromkeys(other.rig for other in others))
        sentences.append(
            f"Changed at the same time: {names}. A common reason is possible (surroundings, method, sensors' calibration)."
        )
    sentences += _pause(rig, incident)
    before, after = rig.campaigns[incident.last_before], rig.campaigns[incident.alarm]
    if before.verdict != after.verdict:
        sentences.append(f"The verdict changed from {before.verdict} ({before.name}) to {after.verdict} ({after.name}).")
    gone, new = sorted(before.causes - after.causes), sorted(after.causes - before.causes)
    if gone:
        sentences.append(f"No longer named: {words(', '.join(gone))}.")
    if new:
        sentences.append(f"Named since: {words(', '.join(new))}.")
    return sentences or ["No coinciding event is known."]


def _pause(rig: TrackedRig, incident: Incident) -> list[str]:
    steps = np.diff([c.started for c in rig.campaigns])
    usual = float(np.median(steps))
    here = slice(incident.last_before, max(incident.first_after, incident.last_before + 1))
    longest = int(np.argmax(steps[here])) + incident.last_before
    if steps[longest] <= POLICY.reported_pause * usual:
        return []
    return [
        f"The rig was not measured for {steps[longest]:.0f} days from {rig.campaigns[longest].day} on "
        f"({usual:.0f} days are usual)."
    ]


def bad_campaigns(rig: TrackedRig) -> list[tuple[DiagnosedCampaign, list[str]]]:
    """Outlying campaigns between regular ones, with the outlying parameters."""
    found: dict[int, list[str]] = {}
    for track in rig.tracks.values():
        for k in track.followed.outlying:
            found.setdefault(track.campaigns[k], []).append(parameter_words(track.name))
    return [(rig.campaigns[k], names) for k, names in sorted(found.items())]


def state_of(fleet: Fleet, rig: TrackedRig) -> str:
    """A rig in a few words: its last change, whether it is an outlier, whether campaigns wait."""
    parts = []
    last = rig.last_change
    if last is not None:
        parts.append(f"changed {rig.campaigns[last.first].day}")
    odd = fleet.outlying_in(rig.name)
    if odd:
        parts.append("outlier in " + ", ".join(parameter_words(name) for name in odd))
    if rig.waiting:
        parts.append(f"{rig.waiting} campaigns wait for a diagnosis by the same version")
    return "; ".join(parts) or "unchanged"


def difference_words(away: float) -> str:
    """A difference from the other rigs in words; a dash if there are too few of them."""
    return "–" if math.isnan(away) else f"{away:+.1f}"
