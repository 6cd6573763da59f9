"""The design of any rig: which parameters may vary, what is to be small, and the best values within the limits."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from isorig.analysis.campaign import BROAD, SI_UNIT, Campaign, FloatArray, Run
from isorig.analysis.errors import DataError, ModelError
from isorig.analysis.isolation.optimum import (
    FREQUENCY,
    Optimum,
    Outcome,
    Target,
    Varied,
    optimum,
    outcomes,
    value_of,
    with_values,
)
from isorig.analysis.model.limits import Limits
from isorig.analysis.model.parameter_units import unit_of
from isorig.analysis.model.refusals import explained
from isorig.analysis.model.rig_model import RigModel, Usual
from isorig.analysis.simulate.free_run import excitation_of
from isorig.analysis.simulate.move_profile import Move, head_acceleration
from isorig.rig.errors import PlanError
from isorig.rig.files.output import write_csv, write_json, write_text
from isorig.rig.files.parameter_table import read_parameters
from isorig.rig.files.rigfile import GivenRig, description_text
from isorig.rig.files.tomlfile import read_toml
from isorig.rig.frf.figures import Figure, gridded, ratio_figure, save
from isorig.rig.isolation.transmissibility import transmissibility
from isorig.rig.model.prediction import Model, predicted
from isorig.rig.virtual.levels import BEGIN, MOVE_RATE
from isorig.rig.virtual.simulated_recording import synthetic_drive, usual_run

#: Quantiles of the drawn parameter sets that are shown.
DRAWN = (0.05, 0.95)
#: The share of the rigs between them, in words.
WITHIN = f"{100.0 * (DRAWN[1] - DRAWN[0]):g} %"


class TargetPlan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What is to be small; channels and configurations default to those of the description."""

    what: Literal["transmissibility", "ratio", "rms"] = "transmissibility"
    response: str | None = None
    reference: str | None = None
    configurations: tuple[str, ...] = ()
    band: tuple[float, float] | None = None


class ParameterPlan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Input of the design."""

    vary: tuple[Varied, ...]  #: The parameters that may vary.
    target: TargetPlan = TargetPlan()  #: What is to be as small as possible.
    limits: Limits = Limits()  #: Limits, in addition to those of the description.
    safety: float = 1.0  #: Every limit is divided by this factor.
    drive: dict[str, Any] = {}  #: The drive; by default the usual one of the description.
    moves: tuple[Move, ...] = ()  #: Instead of it moves, for a drive whose channel is an acceleration.


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """Outcomes over one parameter with all others at their best values; the quantiles of the drawn rigs, shape (2, points)."""

    values: FloatArray
    outcomes: Sequence[Outcome]
    drawn: FloatArray | None


@dataclass(frozen=True, kw_only=True)
class ParameterDesign:
    """The result: what was asked, the search's result, a sweep for each parameter, and targets of the drawn rigs."""

    rig: RigModel
    target: Target
    found: Optimum
    sweeps: Mapping[str, Sweep]
    spread: tuple[float, float] | None
    run: Run


def is_parameter_plan(path: Path) -> bool:
    """Whether a design plan says which parameters may vary."""
    return "vary" in read_toml(path, dict, "a design plan")


def read_parameter_plan(path: Path) -> ParameterPlan:
    """Read and validate a design plan. Raises PlanError, a sentence with the key and what is allowed, if it is invalid."""
    plan = read_toml(path, ParameterPlan, "a design plan")
    if not plan.vary:
        raise PlanError(f"{path}: vary is empty; give at least one parameter with low and high")
    if not 1.0 <= plan.safety < math.inf:
        raise PlanError(f"{path}: safety is {plan.safety:g}; give a factor of 1 or more")
    if plan.moves and plan.drive:
        raise PlanError(f"{path}: there are moves and a drive; give one of them")
    return plan


def designed_parameters(
    plan: ParameterPlan, given: GivenRig, parameters: Path | None, *, points: int, draws: int, seed: int
) -> ParameterDesign:
    """Search the best values, sweep each parameter around them, and repeat the sweeps for drawn rigs.

    `points` is the number of designs before the refinement, and of points in each sweep.
    The free parameters that do not vary are drawn independently from their standard uncertainties in `parameters`, the
    parameters.json of `rig characterize` for this rig; without it, none are drawn. Raises PlanError if the plan names something
    that the rig does not have.
    """
    rig = given.model
    for each in plan.vary:
        _check(rig, each)
    run = _run(plan, rig, seed)
    target = _target(rig, plan.target, run)
    limits = _limits(rig, plan)
    drive = excitation_of(rig, run, oversample=1 if plan.moves else 4)
    try:
        found = optimum(rig, plan.vary, target, limits, drive, points=points, seed=seed)
    except DataError as error:
        raise PlanError(str(error)) from None
    drawn = [] if parameters is None else _drawn(rig, parameters, {v.parameter for v in plan.vary}, draws, seed)

    def tried(rigs: Sequence[RigModel]) -> list[Outcome]:
        return outcomes(rigs, target, limits, drive)

    sweeps = {v.parameter: _sweep(found, drawn, v, points, tried) for v in plan.vary}
    spread = None
    if drawn:
        low, high = np.quantile([each.value for each in tried([with_values(d, found.values) for d in drawn])], DRAWN)
        spread = float(low), float(high)
    return ParameterDesign(rig=rig, target=target, found=found, sweeps=sweeps, spread=spread, run=run)


def _check(rig: RigModel, varied: Varied) -> None:
    here = f"vary: {varied.parameter}"
    try:
        present = value_of(rig, varied.parameter)
        if not 0.0 < varied.low < varied.high < math.inf:
            raise PlanError(f"{here} may vary from {varied.low:g} to {varied.high:g}; give 0 < low < high")
        for value in (varied.low, varied.high):
            with_values(rig, {varied.parameter: value})
    except (ModelError, DataError) as error:
        raise PlanError(f"{here}: {error}") from None
    if varied.parameter.startswith(("sensors.", "drive.chain", "more_drives.")) or not math.isfinite(present):
        raise PlanError(f"{here} is not a property of the rig; give a mass, a stiffness, a damping or a parameter of a law")


def _run(plan: ParameterPlan, rig: RigModel, seed: int) -> Run:
    first = next(iter(rig.configurations))
    if plan.moves:
        if rig.more_drives or rig.drive.quantity != "acceleration":
            raise PlanError(
                f"moves need a single drive whose channel is an acceleration; the drive of {rig.name} is "
                f"{', '.join(f'{d.channel} ({d.quantity})' for d in rig.drives)}, so give drive instead"
            )
        channel = synthetic_drive(rig, usual_run(rig, first)).runs[0].channels[rig.drive.channel]
        samples = head_acceleration(plan.moves, MOVE_RATE)
        return Run(
            id="moves", configuration=first, sample_rate=MOVE_RATE, gain=1.0, excitation="moves",
            channels={rig.drive.channel: replace(channel, samples=samples)}, started=BEGIN,
        )  # fmt: skip
    given = {**msgspec.to_builtins(rig.usual), **plan.drive}
    try:
        usual = msgspec.convert(given, Usual)
    except msgspec.ValidationError as error:
        raise PlanError(f"drive: {explained(str(error), given, Usual, 'this table')}") from None
    described = msgspec.structs.replace(rig, usual=usual)
    recipe = usual_run(described, first)
    return synthetic_drive(described, replace(recipe, seed=seed)).runs[0]


def _target(rig: RigModel, plan: TargetPlan, run: Run) -> Target:
    reference = plan.reference or rig.drive.channel
    response = plan.response or next((sensor.channel for sensor in reversed(rig.sensors) if sensor.channel != reference), "")
    for name in (response, reference):
        if name not in rig.channels:
            raise PlanError(
                f"target names the channel {name!r}, which {rig.name} does not have; it has {', '.join(rig.channels)}"
            )
    count = 2 if plan.what == "ratio" else 1
    configurations = plan.configurations or tuple(rig.configurations)[:count]
    if len(configurations) != count or not set(configurations) <= rig.configurations.keys():
        raise PlanError(
            f"target.configurations is {list(configurations)}; a {plan.what} needs {count} of {', '.join(rig.configurations)}"
        )
    band = plan.band or run.band or (1.0 / run.duration, run.sample_rate / 2.0)
    if not 0.0 <= band[0] < band[1] <= run.sample_rate / 2.0:
        raise PlanError(f"target.band is {list(band)}; give [lowest, highest] in Hz, at most {run.sample_rate / 2.0:g}")
    return Target(what=plan.what, response=response, reference=reference, configurations=configurations, band=band)


def _limits(rig: RigModel, plan: ParameterPlan) -> Limits:
    try:
        limits = rig.limits_within(plan.limits)
    except ModelError as error:
        raise PlanError(str(error)) from None
    return Limits(
        stroke={name: most / plan.safety for name, most in limits.stroke.items()},
        channels={name: most / plan.safety for name, most in limits.channels.items()},
    )


def _drawn(rig: RigModel, path: Path, varied: set[str], draws: int, seed: int) -> list[RigModel]:
    table = read_parameters(path).values
    stds = {name: std for name, (_, std) in table.items() if name in rig.free and name not in varied and std > 0.0}
    if not stds:
        raise PlanError(
            f"{path} has no standard uncertainty of a free parameter of {rig.name} that does not vary; give the parameters.json "
            "of rig characterize for this rig, or omit it"
        )
    generator = np.random.default_rng(seed)
    drawn = []
    for _ in range(draws):
        # Most parameters are positive; draws far below are limited.
        values = {name: generator.normal(rig.get(name), std) for name, std in stds.items()}
        drawn.append(rig.replace({n: v if rig.get(n) <= 0.0 else max(v, 0.01 * rig.get(n)) for n, v in values.items()}))
    return drawn


def _sweep(
    found: Optimum, drawn: Sequence[RigModel], varied: Varied, points: int, tried: Callable[[Sequence[RigModel]], list[Outcome]]
) -> Sweep:
    values = varied.at(np.linspace(0.0, 1.0, points))
    rigs = [with_values(found.model, {varied.parameter: float(v)}) for v in values]
    # Each drawn rig has the best values of all other varied parameters.
    others = [with_values(d, {**found.values, varied.parameter: float(v)}) for d in drawn for v in values]
    draws = np.array([each.value for each in tried(others)]).reshape(len(drawn), len(values))
    return Sweep(values=values, outcomes=tried(rigs), drawn=np.quantile(draws, DRAWN, axis=0) if drawn else None)


def parameter_unit(parameter: str, rig: RigModel) -> str:
    """Unit of a varied parameter."""
    return "Hz" if parameter.startswith("links.") and parameter.endswith(f".{FREQUENCY}") else unit_of(parameter, rig)


def target_name(design: ParameterDesign) -> tuple[str, str]:
    """The target in words, and its unit."""
    target = design.target
    unit, other = (SI_UNIT[design.rig.quantities[name]] for name in (target.response, target.reference))
    over, unit = {
        "rms": ("", unit),
        "ratio": ("", "1"),
        "transmissibility": (f" / rms of {target.reference}", "1" if unit == other else f"{unit} per {other}"),
    }[target.what]
    where = f"{' / '.join(target.configurations)}, {target.band[0]:g} to {target.band[1]:g} Hz"
    return f"rms of {target.response}{over}, {where}", unit


def design_sentences(design: ParameterDesign) -> list[str]:
    """The result in words."""
    found, (name, unit) = design.found, target_name(design)
    unit = "" if unit == "1" else f" {unit}"
    said = [
        f"{parameter}: {value_of(design.rig, parameter):.4g} -> {value:.4g} {parameter_unit(parameter, design.rig)}"
        for parameter, value in found.values.items()
    ]
    low, high = design.spread or (0.0, 0.0)
    spread = f" ({WITHIN} of the rigs drawn from the uncertainties: {low:.4g} to {high:.4g})" if design.spread else ""
    said.append(f"{name}: {found.present.value:.4g} -> {found.best.value:.4g}{unit}{spread}; {found.designs} designs simulated")
    for limit, share in found.best.used.items():
        said.append(f"{limit}: {100 * found.present.used[limit]:.3g} % -> {100 * share:.3g} % of the allowed value")
    if not found.best.inside:
        said.append("No design within the bounds keeps all limits: this is the closest one; give wider bounds or other limits.")
    for parameter in found.at_bound:
        said.append(f"{parameter} is at a bound of its range: a wider range may contain a better design.")
    return said


def write_parameter_design(folder: Path, design: ParameterDesign) -> list[str]:
    """Write design.json, designed.toml, a table for each sweep, and the figures; returns the sentences."""
    found, said = design.found, design_sentences(design)
    name, unit = target_name(design)
    for parameter, sweep in design.sweeps.items():
        columns = {"value": sweep.values, "target": np.array([each.value for each in sweep.outcomes])}
        for limit in found.best.used:
            columns[limit.replace(" ", "_")] = np.array([each.used[limit] for each in sweep.outcomes])
        if sweep.drawn is not None:
            columns |= dict(zip(("target_low", "target_high"), sweep.drawn, strict=True))
        write_csv(folder / f"sweep-{parameter}.csv", columns)
    save(sweeps_figure(design), folder / "sweeps.png")
    if design.run.excitation in BROAD and design.target.response not in design.rig.drive_channels:
        save(response_figure(design), folder / "response.png")
    write_text(folder / "designed.toml", description_text(found.model))
    content: dict[str, Any] = {
        "format": "rig-parameter-design", "format_version": 1, "rig": design.rig.name,
        "target": {"name": name, "unit": unit, **msgspec.to_builtins(design.target)},
        "parameters": {
            parameter: {
                "present": value_of(design.rig, parameter), "best": value, "unit": parameter_unit(parameter, design.rig),
                "at_bound": parameter in found.at_bound,
            }
            for parameter, value in found.values.items()
        },
        **{
            name: {"target": outcome.value, "share_of_limit": outcome.used, "inside": outcome.inside}
            for name, outcome in (("present", found.present), ("best", found.best))
        },
        "best_of_drawn": design.spread, "designs": found.designs,
        "text": said,
    }  # fmt: skip
    write_json(folder / "design.json", content)
    return said


def sweeps_figure(design: ParameterDesign) -> Figure:
    """The target over each varied parameter, with the others at their best values; designs beyond a limit are shaded."""
    figure = Figure(figsize=(9.0, 3.4 * len(design.sweeps) + 0.4), layout="constrained")
    name, unit = target_name(design)
    rows = figure.subplots(len(design.sweeps), 1, squeeze=False)[:, 0]
    for axis, (parameter, sweep) in zip(rows, design.sweeps.items(), strict=True):
        values = np.array([each.value for each in sweep.outcomes])
        axis.plot(sweep.values, values, lw=1.4, label="others at their best values")
        if sweep.drawn is not None:
            axis.fill_between(sweep.values, *sweep.drawn, alpha=0.25, lw=0, label=f"{WITHIN} of the drawn rigs")
        beyond = np.array([not each.inside for each in sweep.outcomes])
        if beyond.any():
            axis.fill_between(
                sweep.values, 0.0, 1.0, where=beyond.tolist(), transform=axis.get_xaxis_transform(), color="tab:red", alpha=0.12,
                lw=0, label="beyond a limit",
            )  # fmt: skip
        present = value_of(design.rig, parameter)
        axis.axvline(present, color="0.6", lw=0.9, label=f"present, {present:.4g}")
        best = design.found.values[parameter]
        axis.axvline(best, color="tab:green", ls=":", lw=1.4, label=f"best, {best:.4g}")
        axis.set(xscale="log", yscale="log", xlabel=f"{parameter}, {parameter_unit(parameter, design.rig)}")
        axis.legend(fontsize=8)
    figure.supylabel(f"{name}{'' if unit == '1' else f', {unit}'}", fontsize=8)
    return gridded(figure)


def response_figure(design: ParameterDesign) -> Figure:
    """The transfer function behind the target, of the present rig and of the best one, estimated from simulated runs."""
    target, rig = design.target, design.rig
    relative = target.configurations[1] if target.what == "ratio" else ""
    runs = tuple(replace(design.run, id=name, configuration=name) for name in target.configurations)
    drives = Campaign(runs=runs, description=description_text(rig), source=rig.name)
    found = transmissibility(
        predicted(rig, drives), [Model(name="best", rig=design.found.model)], reference=target.reference,
        response=target.response, configurations=(target.configurations[0], relative),
        resolution=max(0.25, 8.0 / design.run.duration),
    )  # fmt: skip
    curves = {"present" if r.name == "measured" else r.name: (r.frequency, r.value, r.std) for r in found.ratios}
    words = " relative to ".join(target.configurations)
    return ratio_figure(curves, f"{rig.name}: |{target.response} / {target.reference}|, {words}", found.unit)
