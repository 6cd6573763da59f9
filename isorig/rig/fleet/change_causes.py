"""The cause of a change: diagnoses the campaign after it with the fit from before it as the baseline."""

import hashlib
import math
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np

from isorig.analysis.fitting.solve import base_parameters
from isorig.analysis.model.parameter_units import unit_of
from isorig.rig.diagnose.many import shared_out
from isorig.rig.errors import REFUSALS
from isorig.rig.files.rigfile import read_model
from isorig.rig.fleet.catalogue import Catalogue, key_of
from isorig.rig.fleet.history import Fleet, Incident, TrackedRig, followed
from isorig.rig.fleet.policy import POLICY
from isorig.rig.fleet.sentences import incident_words


class ChangeToExplain(msgspec.Struct, frozen=True, kw_only=True):
    """A change whose cause is searched for."""

    catalogue: str  #: Folder of the catalogue.
    name: str  #: Name of the file with the explanations.
    #: The rig, and the diagnoses used.
    rig: str
    version: str
    baseline: str
    #: Content of the recording before the change, and of the one that raised the alarm.
    before: str
    after: str
    path: str  #: Path of the latter.
    #: Level of each parameter before the change, and its campaign-to-campaign scatter (relative for a positive parameter).
    levels: dict[str, float]
    scatter: dict[str, float]
    #: Parameters that raised an alarm, with the standard uncertainties of their changes, relative for a positive parameter.
    changed: dict[str, float]


def name_of(fleet: Fleet, incident: Incident) -> str:
    """Name of the file with a change's explanations."""
    rig = fleet.rigs[incident.rig]
    parts = (rig.name, rig.version, fleet.baseline, rig.campaigns[incident.alarm].content, str(incident.last_before))
    return hashlib.sha256("|".join(parts).encode()).hexdigest()[:24]


def questions(catalogue: Catalogue, fleet: Fleet) -> Iterator[ChangeToExplain]:
    """The changes whose cause was not searched for yet."""
    known = catalogue.explained()
    for incident in fleet.incidents:
        name = name_of(fleet, incident)
        # A cause that the diagnoses name from then on is the cause of the change.
        if name not in known and not incident.named:
            rig = fleet.rigs[incident.rig]
            levels, scatter = _before(fleet, rig, incident)
            yield ChangeToExplain(
                catalogue=str(catalogue.folder.resolve()), name=name, rig=rig.name, version=rig.version, baseline=fleet.baseline,
                before=rig.campaigns[incident.last_before].content, after=rig.campaigns[incident.alarm].content,
                path=rig.campaigns[incident.alarm].path, levels=levels, scatter=scatter,
                changed={track.name: change.std for track, change in incident.changes},
            )  # fmt: skip


def _before(fleet: Fleet, rig: TrackedRig, incident: Incident) -> tuple[dict[str, float], dict[str, float]]:
    begun = max((i.first for i in rig.incidents if i.first < incident.first), default=0)
    levels, scatter = {}, {}
    for name, track in rig.tracks.items():
        own = [k for k, campaign in enumerate(track.campaigns) if begun <= campaign <= incident.last_before]
        if own:
            weights = 1.0 / track.series.variance(fleet.scatter[name].variance)[own]
            level = float(np.average(track.series.value[own], weights=weights))
            levels[name] = track.plain(level)
            relative = 1.0 if track.log else 1.0 / max(abs(level), 1e-300)
            scatter[name] = relative * math.sqrt(fleet.scatter[name].variance + 1.0 / float(weights.sum()))
    return levels, scatter


def explain(question: ChangeToExplain) -> str:
    """Search for the cause of a change and store its explanations; returns why not, if recording or earlier fit are unusable."""
    try:
        Catalogue(Path(question.catalogue)).put_change(question.name, _explained(question))
    except (*REFUSALS, OSError) as refusal:
        return str(refusal)
    return ""


def _explained(question: ChangeToExplain) -> list[dict[str, object]]:
    from isorig.analysis.trends.difference import CauseOfChange, explanations
    from isorig.rig.files.recording import read

    catalogue = Catalogue(Path(question.catalogue))
    folder = catalogue.diagnosis(key_of(question.before, question.version, question.baseline))
    # The model that the rig was followed with: its baseline, or that with a cause named before.
    earlier = read_model(folder / "model.json")[0]
    known = [f for f in base_parameters(earlier) if f.path in question.levels]
    earlier = earlier.replace({f.path: question.levels[f.path] for f in known})
    scatter = {f.path: question.scatter[f.path] * (1.0 if f.log else abs(question.levels[f.path])) for f in known}
    own, _, fitted = read_model(catalogue.diagnosis(key_of(question.after, question.version, question.baseline)) / "model.json")
    today = {f.path: own.get(f.path) for f in fitted if f.path in question.levels}
    found = explanations(read(question.path), earlier, scatter, today=today, changed=question.changed)
    # A row without a cause records that the search was done.
    nothing = CauseOfChange(
        cause="", location="", parameter="", unit="", old=math.nan, new=math.nan, std=math.nan, share=math.nan, misfit=math.nan
    )
    return [
        {
            **msgspec.structs.asdict(question), **vars(one), "rank": rank,
            "unit": one.unit or unit_of(one.parameter) if one.parameter else "",
        }
        for rank, one in enumerate(found[:POLICY.kept_explanations] or [nothing])
    ]  # fmt: skip


def search_causes(
    catalogue: Catalogue, baseline: str, *, scheduler: str | None, false_per_month: float | None = None
) -> Iterator[str]:
    """Track the fleet, search for the causes of new changes, and yield a line for each.

    A cause that cannot be searched for (its recording is gone) is reported and tried again the next time.
    """
    answers = catalogue.answers()
    if not (answers[answers.baseline == baseline].started.notna()).any():
        return
    fleet = followed(answers, baseline, false_per_month=false_per_month)
    by_name = {name_of(fleet, incident): incident for incident in fleet.incidents}
    for question, failure in shared_out(explain, questions(catalogue, fleet), scheduler):
        sentence = incident_words(fleet, by_name[question.name], None if failure else catalogue.change(question.name))
        yield sentence + (f"; its cause cannot be determined: {failure}" if failure else "")
