"""Texts and figures of the screen: the content and the session's state, in one tree for the page."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import msgspec

from isorig.rig.acquire.notes import Note
from isorig.rig.acquire.policy import LARGE_SHARE, SMALL_SHARE
from isorig.rig.view.levels import ChannelLevel
from isorig.rig.view.messages import Judgement, Planned, SessionState
from isorig.rig.view.snapshot import ShownRun, Snapshot

#: Mode of the screen: its own session, a session in another terminal, or playback of a recording.
Mode = Literal["session", "watch", "replay"]
#: Seconds without a sample after which a watched run no longer counts as measuring.
QUIET = 3.0


@dataclass(frozen=True, kw_only=True)
class Subject:
    """The subject of the screen: name, mode, the session's runs if known, earlier notes."""

    title: str
    mode: Mode
    planned: Sequence[Planned] = ()
    notes: Sequence[Note] = ()


def state_of(subject: Subject, picture: Snapshot, standing: SessionState | None) -> dict[str, Any]:
    """All that the page shows except its plots, as plain values; `standing` is None where another process has the session."""
    session = standing or SessionState(notes=tuple(subject.notes))
    age = time.monotonic() - picture.grown if picture.grown else None
    phase = session.phase if standing is not None else _phase(subject, picture, age)
    # The results of this session's own checks come first.
    judged = {name: run.judged for name, run in picture.runs.items() if run.judged is not None} | session.judged
    runs = _runs(subject, picture, standing, judged)
    shown = picture.runs.get(picture.shown)
    lasting = phase == "measures"
    return {
        "title": subject.title, "mode": subject.mode, "phase": phase, "text": session.text, "may": list(session.may),
        "run": _about(session.run or picture.shown, runs, known=bool(subject.planned)), "asked": session.run,
        "last": session.last,
        "session_left": sum(max(run["of"] - run["seconds"], 0.0) for run in runs if run["state"] in ("planned", "now"))
        if subject.planned else None,
        "shown": picture.shown, "lost": 0 if shown is None else shown.lost, "age": age if lasting else None,
        "damaged": session.damaged, "overloads": session.overloads,
        "channels": [] if shown is None else [_channel(level, picture.runs) for level in shown.levels],
        "limits": [SMALL_SHARE, LARGE_SHARE], "averaged": picture.averaged, "isolated": picture.isolated,
        "advice": list(picture.advice) if lasting and picture.advice else _advice(picture, judged),
        "verdict": _verdict(subject, {name: judged[name] for name in picture.runs if name in judged}), "runs": runs,
        "equations": None if session.equations is None else {
            "text": session.equations.sentence, "limit": session.equations.limit,
            "bars": [{"name": name, "residual": value} for name, value in session.equations.residuals.items()],
        },
        "notes": msgspec.to_builtins(session.notes),
    }  # fmt: skip


def _phase(subject: Subject, picture: Snapshot, age: float | None) -> str:
    if not picture.runs:
        return "begins"
    if all(run.whole for run in picture.runs.values()) and all(item.id in picture.runs for item in subject.planned):
        return "over"
    return "measures" if age is not None and age < QUIET else "quiet"


def _runs(
    subject: Subject, picture: Snapshot, standing: SessionState | None, judged: Mapping[str, Judgement]
) -> list[dict[str, Any]]:
    planned = {item.id: item for item in subject.planned}
    planned |= {name: run.planned for name, run in picture.runs.items() if name not in planned}
    now = standing.run if standing is not None and standing.phase == "measures" else ""
    alone = len({about.configuration for about in planned.values()}) == 1
    rows = []
    for name, about in planned.items():
        run = picture.runs.get(name)
        whole = run is not None and run.whole
        if name == now or (standing is None and run is not None and not whole):
            state = "now"
        elif standing is not None and name in standing.stopped:
            state = "stopped"
        else:
            state = "taken" if whole or name in judged else "planned"
        found = judged.get(name, Judgement(good=True, advice=()))
        seconds = 0.0 if run is None else run.seconds
        if standing is not None and name == now:
            seconds = standing.seconds
        rows.append(
            {
                "id": name, "set_up": "" if alone else about.configuration, "gain": about.gain, "of": about.seconds or seconds,
                "seconds": seconds, "lost": 0 if run is None else run.lost, "state": state, "good": found.good,
                "advice": list(found.advice),
            }
        )  # fmt: skip
    return rows


def _about(name: str, runs: list[dict[str, Any]], *, known: bool) -> dict[str, Any] | None:
    number = next((k for k, run in enumerate(runs) if run["id"] == name), None)
    return None if number is None else {**runs[number], "number": number + 1, "count": len(runs) if known else None}


def _channel(level: ChannelLevel, runs: Mapping[str, ShownRun]) -> dict[str, Any]:
    over = [name for name, run in runs.items() if any(item.over for item in run.levels if item.name == level.name)]
    return {**msgspec.structs.asdict(level), "over": over}


def _advice(picture: Snapshot, judged: Mapping[str, Judgement]) -> list[str]:
    # Of the last run that has any.
    for name in reversed(list(picture.runs)):
        if name in judged and judged[name].advice:
            return [f"{name}: {sentence}" for sentence in judged[name].advice]
    return []


def _verdict(subject: Subject, judged: Mapping[str, Judgement]) -> str:
    # Only the post-run checks: a diagnosis is another command.
    if not judged:
        return "Provisional: no run has been measured yet."
    taken = f"{len(judged)} of {len(subject.planned)} runs" if subject.planned else f"{len(judged)} runs"
    bad = [name for name, found in judged.items() if not found.good]
    with_advice = [name for name, found in judged.items() if found.good and found.advice]
    result = f"repeat {', '.join(bad)}" if bad else "no run needs to be repeated"
    findings = f"; findings in {', '.join(with_advice)}" if with_advice else ""
    rest = "" if bad or with_advice else ", no findings"
    return f"Provisional, {taken} checked: {result}{findings}{rest}."
