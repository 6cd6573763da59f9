"""Where a diagnosis points: the marked place of the sketch, and the force there, measured and of both models."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from isorig.analysis.campaign import Channel, FloatArray, Run
from isorig.analysis.diagnose.link_force import EDGE
from isorig.analysis.diagnose.step import Step
from isorig.analysis.diagnose.surface import passed
from isorig.analysis.equations.forms import element_force, force_of
from isorig.analysis.equations.system import Equations
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.model.rig_model import GROUND, Link, RigModel
from isorig.analysis.wording import sized_unit, with_article, words
from isorig.rig.report.charts import Chart, ChartTrace, Panel, Style
from isorig.rig.report.misfit import BASELINE, Named, Simulated

Over = Literal["deflection", "velocity"]
#: What the force of a kind of cause is shown over.
OVER: Mapping[str, Over] = {
    "spring_shape": "deflection", "damping_shape": "velocity", "friction_shape": "velocity", "memory": "deflection",
    "drift": "deflection",
}  # fmt: skip
#: Least number of samples of a force that is shown.
FEWEST = 200
#: Points of a force drawn as dots, and of a model's so that those stay visible; bins of a mean curve with equal counts,
#: and the share of samples outside of them.
DOTS, FEWER, BINS, OUTSIDE = 900, 300, 60, 0.002
#: What the lines of a force are, as a sentence.
Curves = Literal["mean", "by direction", "samples"]
LEGEND: Mapping[Curves, str] = {
    "mean": "Lines are means over bins.", "by direction": "Lines are means over bins, forward and backward apart.",
    "samples": "Dots are samples.",
}  # fmt: skip
#: How the force of a kind of cause is shown over the deflection, if not by its mean.
SHOWN: Mapping[str, Curves] = {"friction_shape": "by direction", "memory": "samples"}
#: A point that interrupts a line, shape (2, 1).
GAP = np.full((2, 1), np.nan)


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
        "sensors": [sensor.channel for sensor in model.sensors], "drive": model.drive_channels,
        "bodies": [body.name for body in model.bodies], "contacts": [contact.name for contact in model.contacts],
        "links": [link.name for link in model.links],
    }  # fmt: skip
    orders: dict[str, tuple[str, ...]] = {
        "sensor": ("sensors", "drive"), "known_value": ("bodies", "drive"), "added_motion": ("bodies", "links"),
        "friction_shape": ("contacts", "links"), "wrong_stiffness": ("links",),
    }  # fmt: skip
    order = orders.get(step.cause) or orders.get(step.kind, ("links", "contacts"))
    return next((f"{kind}.{place}" for kind in order if place in parts[kind]), "")


def joint_of(model: RigModel, step: Step) -> Link | None:
    """The link at a step's place: its own, or the one parallel to its contact."""
    for link in model.links:
        if link.name == step.location:
            return link
    ends = next(({c.a, c.b} for c in model.contacts if c.name == step.location), None)
    return next((link for link in model.links if {link.a, link.b} == ends), None)


@dataclass(frozen=True, kw_only=True)
class Force:
    """The force in a joint, measured or of a model: deflection, velocity and force in SI units, each shape (samples,)."""

    deflection: FloatArray
    velocity: FloatArray
    force: FloatArray


@dataclass(frozen=True, kw_only=True)
class PlaceForce:
    """The force at a place in a run: from the records, and of each model by name and role, the baseline's first.

    `spring` is the stiffness whose force is subtracted over the velocity, N/m, so that friction and damping remain; of a `rotary`
    place deflections are angles and forces torques.
    """

    place: str
    origin: str  #: What the forces are from, and in which runs.
    measured: Force
    models: Mapping[Named, Force]
    spring: float = 0.0
    rotary: bool = False

    @property
    def errors(self) -> list[float]:
        """Standard deviation of the error of each model's force, N."""
        return [float(np.std(one.force - self.measured.force)) for one in self.models.values()]

    @property
    def misfit(self) -> float:
        """Error of the baseline's force, as a share of the measured force."""
        return self.errors[0] / max(float(np.std(self.measured.force)), 1e-300)

    @property
    def improvement(self) -> float:
        """By how much the extension reduces the error of the force, N; without one, the error."""
        before, *after = self.errors
        return before - sum(after)


def force_chart(at: PlaceForce, over: Over, curves: Curves = "mean") -> Chart:
    """The measured force as dots, and curves of it and of the models' forces, over deflection or velocity."""
    quantity, length, force_unit = ("torque", "rad", "N m") if at.rotary else ("force", "m", "N")
    spring = at.spring if over == "velocity" else 0.0

    def shown(one: Force) -> tuple[FloatArray, FloatArray]:
        return one.velocity if over == "velocity" else one.deflection, one.force - spring * one.deflection

    (x_scale, x_name), (y_scale, y_name) = (
        sized_unit(float(np.abs(values).max(initial=0.0)), name)
        for values, name in zip(shown(at.measured), (f"{length}/s" if over == "velocity" else length, force_unit), strict=True)
    )

    def samples(one: Force, most: int) -> tuple[FloatArray, FloatArray]:
        x, y = (values[:: max(1, len(values) // most)] for values in shown(one))
        return x / x_scale, y / y_scale

    def curve(one: Force) -> tuple[FloatArray, FloatArray]:
        ways = (one.velocity > 0.0, one.velocity < 0.0) if curves == "by direction" else (np.ones(len(one.velocity), dtype=bool),)
        parts = [np.stack(mean_over(*(values[way] for values in shown(one)))) for way in ways if np.any(way)]
        x, y = np.concatenate([part for mean in parts for part in (mean, GAP)][:-1], axis=1)
        return x / x_scale, y / y_scale

    x, y = samples(at.measured, DOTS)
    traces = [ChartTrace(name="measured, samples", x=x, y=y, role="noise", style="dots")]
    if curves != "samples":
        x, y = curve(at.measured)
        traces.append(ChartTrace(name="measured, mean", x=x, y=y, role="measured"))
    for (name, role), one in at.models.items():
        x, y = samples(one, FEWER) if curves == "samples" else curve(one)
        style: Style = "dots" if curves == "samples" else "dash" if name == BASELINE[0] else "solid"
        traces.append(ChartTrace(name=name, x=x, y=y, role=role, style=style))
    without = " without the linear spring's" if spring else ""
    return Chart(
        name=f"force-{at.place}",
        caption=f"{quantity.capitalize()} in {with_article(at.place)}{without} over {over}, {at.origin}. {LEGEND[curves]}",
        panels=[Panel(label=f"{quantity}, {y_name}")], traces=traces, x_label=f"{over}, {x_name}", x_log=False,
    )  # fmt: skip


def mean_over(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean of y and of x in bins of x with equal counts, each shape (bins,)."""
    edges = np.quantile(x, np.linspace(OUTSIDE, 1.0 - OUTSIDE, BINS + 1))
    place = np.searchsorted(edges, x, side="right") - 1
    kept = (place >= 0) & (place < BINS)
    count = np.bincount(place[kept], minlength=BINS)
    there = count > 0
    sums = [np.bincount(place[kept], values[kept], minlength=BINS)[there] / count[there] for values in (x, y)]
    return np.asarray(sums[0]), np.asarray(sums[1])


def place_force(link: Link, trials: Sequence[Trial], models: Mapping[Named, tuple[RigModel, Simulated]]) -> PlaceForce | None:
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


def _in_run(link: Link, trial: Trial, models: Mapping[Named, tuple[RigModel, Simulated]]) -> PlaceForce | None:
    owners = [owner for owner, _ in models.values()]
    first = max(trial.held_out.start - round(EDGE * trial.sample_rate), 0)
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
        place=link.name, measured=measured, models=forces, spring=owners[-1].link(link.name).stiffness,
        origin=f"run {trial.run.id}, held-out data: from the records (drive minus inertia of the bodies beyond it), and from "
        "each model's simulation",
        rotary=owners[0].body(end).motion == "rotation",
    )  # fmt: skip


def equation_force(place: str, equations: Equations, models: Mapping[Named, RigModel]) -> PlaceForce | None:
    """The force at a place in all runs, from the equation of motion that contains it; None if no such equation does.

    The baseline is the first of the models.
    """
    element = next((each for each in equations.elements() if place in each.names), None)
    force = None if element is None else element_force(equations, element.name, None)
    if element is None or force is None or len(force.force) < FEWEST:
        return None
    link, baseline = element.link, next(iter(models.values()))
    moved = baseline.bodies[int(np.argmax(np.abs(element.weights)))]

    def along(values: FloatArray) -> Force:
        return Force(deflection=force.deflection, velocity=force.velocity, force=values)

    return PlaceForce(
        place=place, measured=along(force.force), models={n: along(force_of(m, element, force)) for n, m in models.items()},
        spring=0.0 if link is None else link.stiffness, rotary=moved.motion == "rotation",
        origin="all runs: from the records (the equation of motion that contains it), and from each model along the recorded "
        "motion",
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
