"""Where a diagnosis points: the marked place of the sketch, and the force there, measured and of both models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from isorig.analysis.campaign import Channel, FloatArray, Run
from isorig.analysis.diagnose.link_force import EDGE
from isorig.analysis.diagnose.step import Step
from isorig.analysis.diagnose.surface import passed
from isorig.analysis.fitting.score import held_out
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.model.rig_model import GROUND, Link, RigModel
from isorig.rig.report.before_after import Force, HeldOutRecord, Over, PlaceForce
from isorig.rig.report.charts import Role
from isorig.rig.report.misfit import Simulated
from isorig.rig.report.sections import words

#: What the force of a kind of cause is shown over.
OVER: Mapping[str, Over] = {
    "spring_shape": "deflection", "damping_shape": "velocity", "friction_shape": "velocity", "memory": "deflection",
    "drift": "deflection",
}  # fmt: skip
#: Seconds at the end of a record that are not shown: there the interpolation of the drive lacks its next samples.
ENDS = 0.1
#: Least number of samples of a force that is shown.
FEWEST = 200


def marks(model: RigModel, steps: Sequence[Step]) -> dict[str, str]:
    """Paths of the places of steps in the rig's sketch, each with the cause in a word."""
    found = {}
    for step in steps:
        path = _path(model, step)
        if path:
            found[path] = words(step.form or step.cause)
    return found


def _path(model: RigModel, step: Step) -> str:
    place = step.location
    if step.cause == "imperfect_lock":
        return "lock"
    parts = {
        "sensors": [sensor.channel for sensor in model.sensors], "drive": [drive.channel for drive in model.drives],
        "bodies": [body.name for body in model.bodies], "contacts": [contact.name for contact in model.contacts],
        "links": [link.name for link in model.links],
    }  # fmt: skip
    order = {
        "sensor": ("sensors", "drive"), "known_value": ("bodies", "drive"), "added_motion": ("bodies", "links"),
        "friction_shape": ("contacts", "links"),
    }.get(step.kind, ("links", "contacts"))  # fmt: skip
    return next((f"{kind}.{place}" for kind in order if place in parts[kind]), "")


def joint_of(model: RigModel, step: Step) -> Link | None:
    """The link at a step's place: its own, or the one parallel to its contact."""
    for link in model.links:
        if link.name == step.location:
            return link
    ends = next(({c.a, c.b} for c in model.contacts if c.name == step.location), None)
    return next((link for link in model.links if {link.a, link.b} == ends), None)


def place_force(
    link: Link, trials: Sequence[Trial], models: Mapping[tuple[str, Role], tuple[RigModel, Simulated]]
) -> PlaceForce | None:
    """The force in a link on held-out data of the run in which the extension improves it most.

    None if the bodies beyond the link are not all measured. The baseline is the first of the models, which have their simulations
    of all runs.
    """
    (baseline, _), *_ = models.values()
    free = [
        trial
        for trial in trials
        if trial.motion is None and link.name not in baseline.configurations[trial.run.configuration].rigid
    ]
    found = [at for trial in free if (at := _in_run(link, trial, models)) is not None]
    return max(found, key=lambda at: at.improvement, default=None)


def _in_run(link: Link, trial: Trial, models: Mapping[tuple[str, Role], tuple[RigModel, Simulated]]) -> PlaceForce | None:
    owners = [owner for owner, _ in models.values()]
    edge = round(EDGE * trial.sample_rate)
    first = max(trial.fitted - edge, 0)
    # The deflection of a link is that of its first end relative to its second.
    end, sign = (link.b, -1.0) if link.a == GROUND else (link.a, 1.0)

    def held_out(rows: FloatArray, *by: RigModel) -> Force | None:
        # By the masses of the first of the models whose bodies beyond the link are all measured.
        record = _record(trial, rows)
        known = next((seen for model in by if (seen := passed(model, link, record)) is not None), None)
        if known is None:
            return None
        d, v, force = (values[first:] for values in known)
        return Force(deflection=sign * d, velocity=sign * v, force=force)

    measured = held_out(trial.measured, *reversed(owners))
    forces = {
        key: force
        for key, (owner, responses) in models.items()
        if (force := held_out(np.stack([responses[trial.run.id][name] for name in trial.channels]), owner, owners[0])) is not None
    }
    if measured is None or next(iter(models)) not in forces or len(measured.force) < FEWEST:
        return None
    return PlaceForce(
        place=link.name, run=trial.run.id, time=(edge + first + np.arange(len(measured.force))) / trial.sample_rate,
        measured=measured, models=forces, spring=owners[-1].link(link.name).stiffness,
        rotary=owners[0].body(end).motion == "rotation",
    )  # fmt: skip


def _record(trial: Trial, rows: FloatArray) -> Run:
    # A trial as a run, with measured or simulated responses; it ends at the first gap.
    n = trial.samples
    channels = {
        name: replace(trial.run.channels[name], samples=trial.run.read(name)[:n], scale=1.0, offset=0.0)
        for name in trial.run.channels
    }
    for name, row in zip(trial.channels, rows, strict=True):
        channels[name] = Channel(name=name, samples=row[:n], quantity=trial.run.channels[name].quantity)
    return replace(trial.run, channels=channels, gaps=(), spectra=())


def held_out_records(
    trials: Sequence[Trial], judged: Sequence[Trial], models: Mapping[tuple[str, Role], Simulated]
) -> list[HeldOutRecord]:
    """Every channel of every run on held-out data, with the models' simulations by name and role.

    Held out is the part of the `judged` runs after their `fitted` samples.
    """
    # A channel that hardly moves in a run is judged by how it moves in the others.
    held = {trial.run.id: trial for trial in judged}
    trials = [trial for trial in trials if trial.run.id in held]
    sizes = {
        name: max(float(np.std(trial.measured[trial.channels.index(name)])) for trial in trials if name in trial.channels)
        for trial in trials
        for name in trial.channels
    }
    found = []
    for trial in trials:
        part = held_out(held[trial.run.id])
        part = slice(part.start, part.stop - round(ENDS * trial.sample_rate))
        for row, name in enumerate(trial.channels):
            found.append(
                HeldOutRecord(
                    run=trial.run.id, channel=name, unit=trial.unit_of(name), sample_rate=trial.sample_rate,
                    start=part.start / trial.sample_rate, measured=trial.measured[row][part],
                    models={key: responses[trial.run.id][name][part] for key, responses in models.items()},
                    noise=float(trial.noise[row]), size=sizes[name],
                )
            )  # fmt: skip
    return found
