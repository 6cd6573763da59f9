"""The page of a fleet: an overview of all rigs, latest changes first, and a page for each rig; one file that works offline."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.wording import capitalized, words
from isorig.rig.fleet.change_causes import name_of
from isorig.rig.fleet.history import Fleet, Incident, Track, TrackedRig
from isorig.rig.fleet.policy import POLICY
from isorig.rig.fleet.sentences import (
    bad_campaigns,
    cause_words,
    changes_words,
    coinciding_events,
    difference_words,
    explained,
    incident_words,
    parameter_words,
    period,
    state_of,
    with_unit,
)
from isorig.rig.report.charts import Chart, ChartTrace, Mark, Panel
from isorig.rig.report.page import Cell, Page, PageLink, Report, Section, Sparkline, Table, build_report
from isorig.rig.report.sections import number

#: Changes listed on the first page, the latest first, and recordings without an answer that it lists.
LATEST, NAMED = 40, 20
#: Campaigns listed on a rig's page, the latest first.
LISTED = 60

SHORT = (
    "One row for each rig, those with the latest changes first. A small chart shows a parameter over the latest campaigns, each "
    "with its own scale; a dot is the first campaign after a change."
)
SCATTER = (
    "A parameter raises an alarm if it leaves its level by more than the campaign-to-campaign scatter of one rig. The table "
    "shows the standard deviation between campaigns, estimated from all rigs, the standard uncertainty of a fit, and the "
    "thresholds of the CUSUM charts."
)
OVER_TIME = (
    "Each campaign's fit with its standard uncertainty, and the level that it is compared with. Shaded: date of a change, with "
    "95 % certainty."
)

Explanations = Mapping[str, Sequence[dict[str, Any]]]


def fleet_page(fleet: Fleet, explanations: Explanations) -> str:
    """The report as HTML; `explanations` are the rows of each change's file, by its name."""
    rigs = fleet.in_order
    anchors = {rig.name: f"rig{k}" for k, rig in enumerate(rigs)}
    report = Report(
        title=f"Fleet of {len(rigs)} rigs",
        verdict=_verdict(fleet),
        summary=_summary(fleet),
        sections=[
            _changes(fleet, explanations, anchors), _glance(fleet, rigs, anchors), _odd(fleet, anchors), _scatter(fleet),
            *_without(fleet),
        ],
        pages=[_page(fleet, rig, explanations, anchors) for rig in rigs],
    )  # fmt: skip
    return build_report(report)


def _verdict(fleet: Fleet) -> str:
    changed = [incident for incident in fleet.incidents if incident.confirmed]
    if not changed:
        return "No rig has changed."
    count = len({incident.rig for incident in changed})
    return f"{count} of {len(fleet.rigs)} rigs have changed, {changed[0].rig} last ({period(fleet, changed[0])})."


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if share >= 1.0 else f"{100.0 * share:.2g} %"


def fitted_percent(share: float) -> str:
    """A relative standard uncertainty; one above the value itself says that the fits do not determine it.

    Examples
    --------
    >>> fitted_percent(0.0123), fitted_percent(4.1e8)
    ('1.2 %', 'not identifiable')
    """
    return "not identifiable" if share >= 1.0 else _percent(share)


def _summary(fleet: Fleet) -> list[str]:
    campaigns = [c for rig in fleet.rigs.values() for c in rig.campaigns]
    first, last = (end(campaigns, key=lambda c: c.started).day for end in (min, max))
    rate = fleet.false_per_month
    often = f"{rate:.2g} a month" if rate >= 1.0 else f"one in {1.0 / rate:.2g} months"
    sentences = [
        f"{len(campaigns)} campaigns from {first} to {last}, diagnosed with the {fleet.baseline} "
        f"baseline by version {', '.join(sorted({rig.version for rig in fleet.rigs.values()}))}.",
        f"False alarms expected in the whole fleet: at most {often}.",
    ]
    waiting = sum(rig.waiting for rig in fleet.rigs.values())
    if waiting:
        sentences.append(
            f"{waiting} campaigns are not tracked yet: rigs are tracked in one version of the program only, so run rig fleet "
            "update until the same version has diagnosed all campaigns."
        )
    return sentences


def _tabled(title: str, columns: Sequence[str], rows: Sequence[Sequence[Cell]], *text: str) -> Section:
    return Section(title=title, text=text, tables=[Table(columns=columns, rows=rows)])


def _changes(fleet: Fleet, explanations: Explanations, anchors: Mapping[str, str]) -> Section:
    if not fleet.incidents:
        return Section(title="What changed", text=["No parameter has left its level, and no new cause is named."])
    rows: list[tuple[Cell, ...]] = []
    for incident in fleet.incidents[:LATEST]:
        found = explanations.get(name_of(fleet, incident))
        named = "; ".join(words(n.cause) for n in incident.named)
        rows.append(
            (
                PageLink(text=incident.rig, page=anchors[incident.rig]), period(fleet, incident),
                "; ".join(changes_words(incident)) or "verdict",
                named or ("not searched for" if found is None else explained(found)),
                fleet.rigs[incident.rig].campaigns[incident.alarm].day,
            )
        )  # fmt: skip
    more = len(fleet.incidents) - len(rows)
    earlier = [f"{more} earlier changes are on the rigs' pages."] if more > 0 else []
    return _tabled("What changed", ("rig", "changed", "what", "cause", "alarm"), rows, *earlier)


def _glance(fleet: Fleet, rigs: Sequence[TrackedRig], anchors: Mapping[str, str]) -> Section:
    names = [name for name in fleet.scatter if sum(name in rig.tracks for rig in rigs) > len(rigs) / 2]
    rows = [
        (
            PageLink(text=rig.name, page=anchors[rig.name]), state_of(fleet, rig), rig.campaigns[-1].day,
            rig.campaigns[-1].verdict, *(_spark(rig.tracks[name]) if name in rig.tracks else "–" for name in names),
        )
        for rig in rigs
    ]  # fmt: skip
    return _tabled("All rigs", ("rig", "state", "last", "verdict", *map(parameter_words, names)), rows, SHORT)


def _spark(track: Track) -> Cell:
    text = f"{parameter_words(track.name)}: now {with_unit(track.level, track.unit)}"
    return Sparkline(values=track.values, description=text, marked=[change.first for change in track.followed.changes])


def _odd(fleet: Fleet, anchors: Mapping[str, str]) -> Section:
    odd = [(name, found, rig, fleet.rigs[rig].tracks[name]) for name, found in fleet.siblings.items() for rig in found.outliers]
    if not odd:
        return Section(title="Outlying rigs", text=["No rig differs from the others by more than their spread."])
    rows = [
        (
            PageLink(text=rig, page=anchors[rig]), parameter_words(name), with_unit(track.level, track.unit),
            with_unit(track.plain(found.mean), track.unit), difference_words(found.deviations[rig]),
        )
        for name, found, rig, track in odd
    ]  # fmt: skip
    columns = ("rig", "parameter", "its level", "the others' mean", "difference, standard deviations of the others")
    text = "These rigs differ from the others by more than their spread, even if they have not changed."
    return _tabled("Outlying rigs", columns, rows, text)


def _scatter(fleet: Fleet) -> Section:
    rows = []
    for name, found in fleet.scatter.items():
        tracks = [rig.tracks[name] for rig in fleet.rigs.values() if name in rig.tracks]
        log, unit = tracks[0].log, tracks[0].unit
        between, fitted = found.variance**0.5, float(np.median(np.concatenate([track.series.std for track in tracks])))
        sizes = (_percent(between), fitted_percent(fitted)) if log else (with_unit(between, unit, 2), with_unit(fitted, unit, 2))
        limits = fleet.limits.get(name)
        shown = "too few campaigns" if limits is None else ", ".join(f"{limit:.2g}" for limit in limits)
        rows.append((parameter_words(name), *sizes, f"{found.freedom:.0f}", shown))
    columns = ("parameter", "between campaigns", "of a fit", "degrees of freedom", "thresholds")
    return _tabled("Campaign-to-campaign scatter", columns, rows, SCATTER)


def _without(fleet: Fleet) -> list[Section]:
    if not fleet.notes:
        return []
    more = len(fleet.notes) - NAMED
    text = [f"{note}." if not note.endswith(".") else note for note in fleet.notes[:NAMED]]
    return [
        Section(
            title="Recordings that are not tracked", text=[*text, *([f"And {more} more: rig fleet show."] if more > 0 else [])]
        )
    ]


def _page(fleet: Fleet, rig: TrackedRig, explanations: Explanations, anchors: Mapping[str, str]) -> Page:
    sections = [_change_section(fleet, incident, explanations) for incident in reversed(rig.incidents)]
    far = [
        f"{campaign.name} ({campaign.day}) is an outlier in {', '.join(names)}, but its neighbours are not: a bad campaign."
        for campaign, names in bad_campaigns(rig)
    ]
    if far:
        sections.append(Section(title="Outlying campaigns", text=far))
    sections += [_parameters(fleet, rig), Section(title="Over time", charts=[_chart(rig)]), _campaigns(rig)]
    return Page(name=anchors[rig.name], title=rig.name, verdict=capitalized(f"{state_of(fleet, rig)}."), sections=sections)


def _change_section(fleet: Fleet, incident: Incident, explanations: Explanations) -> Section:
    found = explanations.get(name_of(fleet, incident))
    rig = fleet.rigs[incident.rig]
    rows = []
    for track, change in incident.changes:
        own = [rig.campaigns[track.campaigns[k]] for k in (max(change.earliest - 1, 0), change.latest, change.alarm)]
        rows.append(
            (
                parameter_words(track.name), number(track.plain(change.before), 4), number(track.plain(change.after), 4),
                track.unit, track.moved(change), f"{change.size:+.1f}", change.kind,
                f"{own[0].day} to {own[1].day}", own[2].day,
            )
        )  # fmt: skip
    columns = ("parameter", "before", "after", "unit", "by", "standard deviations", "kind", "when (95 %)", "alarm")
    tables = [Table(columns=columns, rows=rows)] if rows else []
    text = [f"{incident_words(fleet, incident, None)}.", *coinciding_events(fleet, incident)]
    if incident.named:
        text.append("The cause that the diagnosis names is the cause of this change.")
    elif found is None:
        text.append("The cause of this change was not searched for yet: run rig fleet update.")
    elif not found:
        text.append("The diagnosis of the difference finds no cause beyond the campaign-to-campaign scatter.")
    else:
        text.append(f"The diagnosis of the difference, with the fit from before as the baseline: {explained(found)}.")
        tables.append(
            Table(
                columns=("cause", "improvement relative to the best", "as likely as the best"),
                rows=[
                    (cause_words(row), f"{100.0 * row['share']:.3g} %", "yes" if row["alike"] else "no")
                    for row in found
                    if row["share"] >= POLICY.listed_explanation
                ],
            )
        )
    return Section(title=f"Change, {period(fleet, incident)}", text=text, tables=tables)


def _parameters(fleet: Fleet, rig: TrackedRig) -> Section:
    odd = fleet.outlying_in(rig.name)
    rows = []
    for name, track in rig.tracks.items():
        std = track.level * track.followed.std if track.log else track.followed.std
        away = difference_words(fleet.siblings[name].deviations[rig.name])
        rows.append(
            (parameter_words(name), number(track.level, 5), number(std, 2), track.unit, away, "odd" if name in odd else "")
        )
    columns = ("parameter", "level", "std", "unit", "difference, standard deviations", "")
    return _tabled("Parameters compared with the other rigs", columns, rows)


def _chart(rig: TrackedRig) -> Chart:
    tracks = list(rig.tracks.values())
    traces, marks = [], []
    for panel, track in enumerate(tracks):
        x, y = _levels(track)
        traces.append(
            ChartTrace(name="campaign", x=track.series.time, y=track.values, spread=track.stds, panel=panel, style="points")
        )
        traces.append(ChartTrace(name="level", x=x, y=y, role="extended", panel=panel))
        marks += [
            Mark(begin=float(track.series.time[max(c.earliest - 1, 0)]), end=float(track.series.time[c.latest]), panel=panel)
            for c in track.followed.changes
        ]
    return Chart(
        name=f"{rig.name}-parameters",
        caption=OVER_TIME,
        panels=[Panel(label=_label(track)) for track in tracks],
        traces=traces, x_label="", x_log=False, x_date=True, marks=marks,
    )  # fmt: skip


def _label(track: Track) -> str:
    return parameter_words(track.name).replace(" of ", " of\n").replace(" at ", "\nat ") + (
        f", {track.unit}" if track.unit not in ("", "1") else ""
    )


def _levels(track: Track) -> tuple[FloatArray, FloatArray]:
    # A constant level between changes; a drift as a slope.
    time, changes = track.series.time, track.followed.changes
    firsts = [change.first for change in changes]
    first_level = changes[0].before if changes else track.followed.level
    x, y = [], []
    for change, begin, end in zip([None, *changes], [0, *firsts], [*firsts, len(time)], strict=True):
        ends = time[[begin, max(end - 1, begin)]]
        level = np.full(2, first_level if change is None else change.after)
        if change is not None and change.kind == "drift":
            level = change.before + change.slope * (ends - time[max(change.first - 1, 0)])
        x += [*ends, np.nan]
        y += [*level, np.nan]
    whole = np.array(y[:-1])
    return np.array(x[:-1]), np.exp(whole) if track.log else whole


def _campaigns(rig: TrackedRig) -> Section:
    rows = [
        (c.name, c.day, c.verdict, words(", ".join(sorted(c.causes))) or "–", c.content[:12])
        for c in reversed(rig.campaigns[-LISTED:])
    ]
    more = len(rig.campaigns) - len(rows)
    earlier = [f"{more} earlier ones are in the catalogue."] if more > 0 else []
    return _tabled("Campaigns", ("campaign", "began", "verdict", "named", "content"), rows, *earlier)
