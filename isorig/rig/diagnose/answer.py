"""The answer of a diagnosis: the content of its findings, and its files."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import msgspec

from isorig.analysis.campaign import Campaign
from isorig.analysis.diagnose.budget import Budget
from isorig.analysis.diagnose.diagnosis import Diagnosis
from isorig.analysis.diagnose.policy import POLICY
from isorig.analysis.diagnose.step import Step
from isorig.analysis.errors import AnalysisError
from isorig.analysis.fitting.score import RESAMPLED
from isorig.analysis.fitting.solve import Fit
from isorig.analysis.fitting.uncertainty import uncertain_values
from isorig.analysis.model.parameter_units import physical_parameters, unit_of
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.simulate.natural import lowest_mode
from isorig.analysis.spectra.hits import looks_hit
from isorig.analysis.wording import first_of, with_article
from isorig.rig.files import findings as stored
from isorig.rig.files.output import write_text
from isorig.rig.files.rigfile import write_model
from isorig.rig.files.rivals import write_rivals
from isorig.rig.frf.transfer import levels_in_words
from isorig.rig.report.diagnosis import diagnosis_page

#: Shortest run, in periods of the slowest mode. Chosen: of the 40 % of it that is held out, twenty periods remain.
PERIODS = 50.0
#: Number of given masses that are named.
MASSES = 4
#: What a reader must know of the uncertainties if the time ended before they were computed.
ROUGH = "The time limit ended before the uncertainties were computed; those given are of a coarser fit."


def findings_of(
    diagnosis: Diagnosis, campaign: Campaign, origin: Mapping[str, str], limit: float | None = None
) -> stored.Findings:
    """The content of findings.json, as a reader of the file gets it.

    The baseline of a rig with its own description is that description, with or without friction. `origin` is the baseline's name,
    the name and hash of the recording, and the version of this program; the given time limit is in s.
    """
    improvement = diagnosis.improvement
    baseline, extended = (_budget(budget) for budget in diagnosis.budgets)
    name = "description" if campaign.description is not None else origin["baseline"]
    force = diagnosis.required_force
    rough = diagnosis.extended.known is None and diagnosis.extended.free and force is None
    remarks = [
        _of_given_masses(diagnosis, campaign), diagnosis.zero_errors, diagnosis.spread,
        *missing(campaign, diagnosis.baseline.model), ROUGH if rough else "",
    ]  # fmt: skip
    adequacy = stored.Adequacy(
        worst=diagnosis.worst, threshold=diagnosis.enough, baseline_rig=diagnosis.calibration,
        how="Largest ratio, over runs and channels, of the error to that allowed by noise and simulation accuracy; in cases of "
        f"doubt the threshold is {POLICY.beyond_calibration:g} times the largest such ratio of data simulated with the baseline "
        "and its noise.",
    )  # fmt: skip
    relative = ", the measured motion relative to the imposed one where that is less" if diagnosis.baseline.model.imposed else ""
    holdout = stored.HeldOut(
        baseline=diagnosis.baseline_error, extended=diagnosis.extended_error, noise_floor=diagnosis.floor,
        baseline_interval=improvement.before, extended_interval=improvement.after,
        removed=improvement.removed if diagnosis.steps else 0.0, removed_interval=improvement.removed_interval,
        interval=f"95 % of {RESAMPLED} draws of held-out blocks (bootstrap)",
        how="Median over runs and channels of rms(predicted - measured) / rms(measured) over "
        f"{diagnosis.division.how}{relative}.",
    )  # fmt: skip
    findings = stored.Findings(
        origin=dict(origin), verdict=msgspec.convert(diagnosis.verdict, stored.DiagnosisVerdict),
        doubts=msgspec.convert(diagnosis.doubts, list[stored.DoubtfulValue], from_attributes=True),
        baseline=stored.FittedBaseline(name=name, parameters=_parameters(diagnosis.baseline)),
        extended=stored.FittedExtension(parameters=_parameters(diagnosis.extended)),
        discrepancies=msgspec.convert(diagnosis.discrepancies, list[stored.Misfit], from_attributes=True),
        evidence=[sign.text for sign in diagnosis.signs], remarks=[*filter(None, remarks)], adequacy=adequacy,
        tolerance=diagnosis.tolerance, cut_short=diagnosis.cut_short,
        pointed=diagnosis.pointed
        and msgspec.convert({"kind": diagnosis.pointed[0], "location": diagnosis.pointed[1]}, stored.KindAt),
        required_force=None if force is None else stored.RequiredForce(
            baseline=force.before, extended=force.after, follows=force.follows
        ),
        chain_errors=None if diagnosis.chain_errors is None else [*diagnosis.chain_errors],
        time_limit_s=limit, driven=_driven(campaign, diagnosis.baseline.model),
        steps=[_step(step, share, diagnosis.extended) for step, share in zip(diagnosis.steps, diagnosis.shares, strict=True)],
        candidates=msgspec.convert(diagnosis.considered, list[stored.TriedCause], from_attributes=True),
        budget=stored.Budgets(baseline=baseline, extended=extended),
        indistinguishable=[
            [stored.CauseAt(cause=cause, location=at) for cause, at in ((step.cause, step.location), *step.indistinguishable)]
            for step in diagnosis.steps
            if step.indistinguishable
        ],
        holdout=holdout,
    )  # fmt: skip
    return stored.as_read(findings)


def _parameters(fitted: Fit) -> dict[str, stored.Value]:
    std, model = fitted.std, fitted.model
    return {path: stored.Value(value=value, std=std[path], unit=unit_of(path, model)) for path, value in fitted.values.items()}


def _of_given_masses(diagnosis: Diagnosis, campaign: Campaign) -> str:
    # What the uncertainties of the named forces and stiffnesses take as exact, unless its own uncertainty is stated.
    model, fitted = diagnosis.baseline.model, diagnosis.extended
    known = {*fitted.values, *uncertain_values(campaign.known, fitted)}
    held = [b.name for b in model.bodies if f"bodies.{b.name}.mass" not in known and b.name not in model.imposed]
    forces = any(unit.startswith("N") and std > 0.0 for step in diagnosis.steps for _, std, unit in step.parameters.values())
    if not (held and forces):
        return ""
    what = "masses" if any(model.body(name).motion == "straight" for name in held) else "moments of inertia"
    return (
        f"Uncertainties are given the described {what} ({first_of([*map(with_article, held)], MASSES)}): forces, stiffnesses and "
        "dampings may be off by as many per cent as these are; state how well they are known (mass_std) to include that."
    )


def missing(campaign: Campaign, model: RigModel) -> list[str]:
    """A sentence for each thing that a recording of this rig lacks."""
    said = []
    runs = campaign.runs
    if len(runs) == 1:
        said.append(
            "There is only one run: whether an error depends on the level of the drive is not known; record a second level."
        )
    # A released run, or that of a hammer, ends when the rig stands still, and has no drive to repeat.
    drive = model.drive.channel
    driven = [run for run in runs if run.excitation != "free" and not looks_hit(run, drive)]
    slowest = 0.0
    with suppress(AnalysisError):
        slowest = lowest_mode(model)
    short = [run for run in driven if slowest and run.duration * slowest < PERIODS]
    if short:
        which = f"run {short[0].id!r}" + (f" and {len(short) - 1} more" if len(short) > 1 else "")
        said.append(
            f"Shorter than {PERIODS:.0f} periods of the slowest mode ({slowest:.3g} Hz): {which}; "
            f"record at least {PERIODS / slowest:.0f} s."
        )
    if driven and not any(run.repeat_of or run.period for run in driven):
        said.append("No drive was played twice (repeat_of), so the disturbance is not measured.")
    return said + (levels_in_words(replace(campaign, runs=tuple(driven)), drive) if driven else [])


def _driven(campaign: Campaign, model: RigModel) -> bool:
    return any(
        run.excitation != "free" and any(run.read(drive.channel).std() > 0.0 for drive in model.drives) for run in campaign.runs
    )


def _share(share: tuple[float, float, float]) -> stored.Share:
    value, low, high = share
    return stored.Share(value=value, low=low, high=high)


def _budget(budget: Budget) -> stored.ErrorBudget:
    return stored.ErrorBudget(
        **{nature: _share(share) for nature, share in budget.shares.items()},
        by_channel={name: dict(shares) for name, shares in budget.by_channel.items()},
        by_configuration={name: dict(shares) for name, shares in budget.by_configuration.items()},
        how=budget.how,
    )


def _step(step: Step, share: tuple[float, float, float], fitted: Fit) -> stored.NamedCause:
    # The parameters of a law that no fit changes are listed, too.
    laws = {r.path.rpartition(".")[0] for r in step.reported if ".law" in r.path}
    held = [p for p in physical_parameters(fitted.model) if p.rpartition(".")[0] in laws and p not in fitted.values]
    return stored.NamedCause(
        cause=step.cause, location=step.location, kind=step.kind, form=step.form, level="form" if step.form else "kind",
        closest_form=stored.ClosestForm(cause=step.closest[0], share=step.closest[1]) if step.closest else None,
        share=_share(share),
        curve=msgspec.convert(step.curve, stored.FreeShape, from_attributes=True) if step.curve else msgspec.UNSET,
        parameters={name: stored.Value(value=value, std=std, unit=unit) for name, (value, std, unit) in step.parameters.items()},
        held={
            path.rpartition(".")[2]: stored.HeldValue(value=fitted.model.get(path), unit=unit_of(path, fitted.model))
            for path in held
        },
        rivals=msgspec.convert(step.rivals, list[stored.OtherCause], from_attributes=True),
        evidence=list(step.evidence), confidence=step.confidence, holdout_error_before=step.before,
        holdout_error_after=step.after,
    )  # fmt: skip


def write_answer(
    folder: Path, diagnosis: Diagnosis, campaign: Campaign, origin: Mapping[str, str], *, limit: float | None = None,
    page: bool = True,
) -> stored.Findings:  # fmt: skip
    """Write findings.json, both models, rivals.json and, unless `page` is False, report.html into a folder.

    findings.json is written last: where it is, the answer is complete.
    """
    findings = findings_of(diagnosis, campaign, origin, limit)
    html = diagnosis_page(diagnosis, campaign, findings) if page else None
    write_model(folder / "baseline.json", diagnosis.baseline.model, origin=campaign.started, fitted=diagnosis.baseline.free)
    write_model(folder / "model.json", diagnosis.extended.model, origin=campaign.started, fitted=diagnosis.extended.free)
    write_rivals(folder, diagnosis, campaign, origin)
    if html is not None:
        write_text(folder / "report.html", html)
    stored.write_findings(folder, findings)
    return findings
