"""A fleet as tables on a terminal."""

from collections.abc import Callable

from isorig.analysis.wording import first_of
from isorig.rig.errors import RigError
from isorig.rig.fleet.history import Fleet, Track, TrackedRig
from isorig.rig.fleet.sentences import change_words, difference_words, parameter_words, state_of
from isorig.rig.process.terminal import show_table
from isorig.rig.report.sections import number

#: Names listed where a given one is unknown.
SHOWN = 12


def show_fleet(fleet: Fleet, show: Callable[[str], None]) -> None:
    """All rigs, the one that changed last first."""
    rows = [(rig.name, str(len(rig.campaigns)), rig.campaigns[-1].day, rig.campaigns[-1].verdict, state_of(fleet, rig))
            for rig in fleet.in_order]  # fmt: skip
    show_table(f"{len(fleet.rigs)} rigs, {fleet.baseline} baseline", ("rig", "campaigns", "last", "verdict", "state"), rows)
    for note in fleet.notes:
        show(note)


def show_rig(fleet: Fleet, name: str) -> None:
    """One rig: its parameters compared with the other rigs."""
    rig = _rig_of(fleet, name)
    odd = fleet.outlying_in(name)
    rows = []
    for parameter, track in rig.tracks.items():
        changes = "; ".join(
            f"{rig.campaigns[track.campaigns[c.first]].day} {track.moved(c)} ({c.kind})" for c in track.followed.changes
        )
        rows.append(
            (
                parameter_words(parameter), number(track.level, 5), track.unit,
                difference_words(fleet.siblings[parameter].deviations[name]) + (" outlier" if parameter in odd else ""),
                changes or "–",
            )
        )  # fmt: skip
    show_table(f"{name}: {len(rig.campaigns)} campaigns", ("parameter", "level", "unit", "against others", "changes"), rows)


def show_parameter(fleet: Fleet, parameter: str, rig: str | None) -> None:
    """One parameter: campaign by campaign of one rig, or the levels of all rigs."""
    name = _parameter_of(fleet, parameter)
    if rig is not None:
        _show_track(_rig_of(fleet, rig), name)
        return
    found = fleet.siblings[name]
    rows = []
    for each, away in sorted(found.deviations.items(), key=lambda item: -abs(item[1])):
        track = fleet.rigs[each].tracks[name]
        last = next((change_words(track, change) for change in reversed(track.followed.changes)), "–")
        rows.append((each, number(track.level, 5), difference_words(away), "outlier" if each in found.outliers else "", last))
    unit = fleet.rigs[next(iter(found.deviations))].tracks[name].unit
    show_table(f"{parameter_words(name)}, {unit}", ("rig", "level", "against others", "", "last change"), rows)


def _show_track(rig: TrackedRig, name: str) -> None:
    if name not in rig.tracks:
        raise RigError(f"{rig.name} has no parameter {name!r}; it has {', '.join(rig.tracks)}")
    track = rig.tracks[name]
    events = _events(track)
    rows = [
        (c.day, c.name, number(v, 6), number(s, 2), c.verdict, "; ".join(events.get(k, [])))
        for k, (c, v, s) in enumerate(
            zip((rig.campaigns[at] for at in track.campaigns), track.values.tolist(), track.stds.tolist(), strict=True)
        )
    ]
    columns = ("began", "campaign", "value", "std", "verdict", "")
    show_table(f"{rig.name}: {parameter_words(name)}, {track.unit}", columns, rows)


def _events(track: Track) -> dict[int, list[str]]:
    events: dict[int, list[str]] = {}
    for change in track.followed.changes:
        events.setdefault(change.first, []).append(f"changed {track.moved(change)} ({change.kind})")
        events.setdefault(change.alarm, []).append("alarm")
    for k in track.followed.outlying:
        events.setdefault(k, []).append("outlier")
    return events


def _rig_of(fleet: Fleet, name: str) -> TrackedRig:
    if name not in fleet.rigs:
        raise RigError(f"there is no rig {name!r}; there are {first_of(list(fleet.rigs), SHOWN)}")
    return fleet.rigs[name]


def _parameter_of(fleet: Fleet, name: str) -> str:
    # The full name of a parameter, given by it or by its displayed name.
    for known in fleet.siblings:
        if name in (known, parameter_words(known)):
            return known
    known = first_of([parameter_words(each) for each in fleet.siblings], SHOWN)
    raise RigError(f"there is no parameter {name!r}; there are {known}")
