"""The first screen of a measurement's page: what was measured, whether the isolation works, what is wrong, what to do next."""

from collections.abc import Mapping, Sequence

import numpy as np

from isorig.analysis.campaign import Campaign, Run, broad
from isorig.analysis.diagnose.misfit import Discrepancy
from isorig.analysis.isolation.ratio import MOSTLY_STUCK, Isolated, stuck_share
from isorig.analysis.parameters.joint_fit import Characterization
from isorig.analysis.wording import of_signal, state, with_article, words
from isorig.rig.report.frequency import isolation_chart
from isorig.rig.report.misfit import Named, Simulated, second_chart, worst_second
from isorig.rig.report.page import AnsweredQuestion, First, Section
from isorig.rig.report.sections import HOLD_OUT, channels_table
from isorig.rig.report.sketch import sketch
from isorig.rig.wire_bonder.design_study import BOND, bonding
from isorig.rig.wire_bonder.isolation import ComparedRatios

#: Name in a recording for the required isolation of the heatblock, as a share of its vibration.
WISH = "wished_isolation"
#: The isolation in the thesis's first simulation: the requirement if a recording gives none.
PROMISED = 0.98
#: Text if there is no advice.
NOTHING = "The model can be used for rig predict, rig isolation and rig design."
#: rms force divided by friction at which the motor mostly slides.
SLIDES = 1.2


def first_screen(
    campaign: Campaign, found: Characterization, compared: ComparedRatios | None, wrong: Sequence[Discrepancy],
    asked: Sequence[str], models: Mapping[Named, Simulated],
) -> First:  # fmt: skip
    """The first screen of a measurement with its parameters; the discrepancies and the advice that was `asked` for have the most
    important ones first."""
    second = second_chart(worst_second(found.trials, found.trials, models))
    return First(
        sketch=sketch(found.fit.model),
        measured=Section(title="What was measured", text=[_runs(campaign)], tables=[channels_table(campaign)]),
        answers=[
            *([] if found.head_mass is None else [_job(campaign, found, compared)]),
            _model(found, compared, wrong),
            AnsweredQuestion(
                question="What next?",
                short="Nothing is missing" if not asked else "Measure again" if found.adequate else "Search for the cause",
                text=asked[:1] or [NOTHING],
            ),
        ],
        pictures=[isolation_chart(compared)] if compared is not None else [] if second is None else [second],
    )


def _runs(campaign: Campaign) -> str:
    configurations = "" if campaign.alone else " and ".join(sorted({r.configuration for r in campaign.runs}, reverse=True)) + ", "
    gains = ", ".join(f"{gain:g}" for gain in sorted({run.gain for run in campaign.runs}, reverse=True))
    seconds = sum(run.duration for run in campaign.runs)
    virtual = any("virtual" in c.about.get("sensor", "") for run in campaign.runs for c in run.channels.values())
    kind = "A virtual rig without real sensors. " if virtual else ""
    return f"{kind}{len(campaign.runs)} runs, {seconds:.0f} s in total, {configurations}at gain {gains}."


def _job(campaign: Campaign, found: Characterization, compared: ComparedRatios | None) -> AnsweredQuestion:
    question = "Does the isolation work?"
    measured = None if compared is None else compared.isolated.get("measured")
    if measured is None:
        reason = "No gain was measured both unlocked and locked above the isolation frequency, so the recording does not show it."
        return AnsweredQuestion(question=question, short="Not known", text=[reason])
    wish = campaign.known.get(WISH, PROMISED)
    low, high = measured.interval
    verdict = "Yes" if low >= wish else "No" if high < wish else "Perhaps"
    short = f"{verdict}: {_percent(measured.share)} isolated, {_percent(wish)} required"
    text = (
        f"95 % interval {_percent(low)} to {_percent(high)}: reduction of the heatblock's vibration, unlocked relative to locked "
        f"with the same drive, from {measured.band[0]:.3g} to {measured.band[1]:.3g} Hz at gain {measured.gain:.3g}."
    )
    stated = (
        "The recording gives the requirement."
        if WISH in campaign.known
        else f"The recording gives no requirement ({WISH}): {_percent(PROMISED)} is from the thesis's first simulation of a move."
    )
    return AnsweredQuestion(question=question, short=short, text=[text, stated, *_bonded(campaign, found)])


def _bonded(campaign: Campaign, found: Characterization) -> list[str]:
    # The isolation during a move differs from that in a band of noise: friction matters less for larger accelerations.
    if campaign.description is not None:
        return []
    held, free = bonding(found.fit.model, BOND).values()
    return [
        f"During a move of {1e3 * BOND.distance:g} mm in {1e3 * BOND.seconds:g} ms the fitted model isolates "
        f"{_percent(1.0 - free.largest / held.largest)}: the heatblock moves {1e6 * free.largest:.2g} µm relative to the table; "
        f"the bond allows ±{1e6 * BOND.tolerance:g} µm."
    ]


def _model(found: Characterization, compared: ComparedRatios | None, wrong: Sequence[Discrepancy]) -> AnsweredQuestion:
    question = "What is wrong with the model?"
    if found.adequate:
        short = "Only single bands differ" if wrong else "No discrepancy found"
        text = (
            f"It explains the runs down to the noise: its error is {of_signal(found.error)}, that of noise alone "
            f"{found.noise_alone}."
        )
        if wrong:
            text += f" The bands that differ by more than their noise ({len(wrong)}) are listed below."
    else:
        short = f"Its error is {of_signal(found.error)}"
        text = f"Noise alone would cause {found.noise_alone}."
        if wrong:
            worst = wrong[0]
            where = state(worst.configuration, worst.gain, alone=len(found.fit.model.configurations) == 1)
            text += (
                f" Its error is largest at {with_article(worst.channel)}, {where}, from "
                f"{worst.band_hz[0]:.3g} to {worst.band_hz[1]:.3g} Hz."
            )
    return AnsweredQuestion(question=question, short=short, text=[text, *([] if compared is None else _cost(compared.isolated))])


def _cost(isolated: dict[str, Isolated]) -> list[str]:
    if not {"measured", "simulated"} <= isolated.keys():
        return []
    off = 100.0 * (isolated["simulated"].share - isolated["measured"].share)
    how = f"{abs(off):.2g} percentage points too {'high' if off > 0.0 else 'low'}"
    if abs(off) <= 196.0 * isolated["measured"].std:
        how = "within the measurement's interval"
    return [f"It predicts {_percent(isolated['simulated'].share)} isolated, {how}."]


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"


def advice(campaign: Campaign, found: Characterization) -> list[str]:
    """Sentences, most important first: stronger excitation, missing second gains, unidentified parameters, held-out runs."""
    notes = [] if found.adequate else ["Run rig diagnose on this recording: it searches for the cause of the remaining error."]
    unknown = [(name if found.head_mass is None else words(name), e.note) for name, e in found.table.items() if e.value is None]
    if found.head_mass is None:
        notes += [f"{name} is not determined ({note})." for name, note in unknown]
    else:
        friction = found.table["friction_force"].value
        unlocked = {run.gain: run for run in broad(campaign.select(configuration="unlocked"))}
        if friction is not None:
            notes += [text for gain in sorted(unlocked) if (text := _stuck(found, unlocked[gain], friction))]
        notes += [
            f"The {name} is not identifiable ({note}): excite its frequency band more strongly or for longer."
            for name, note in unknown
        ]
        peak = found.table["heatblock_frequency"].value
        reached = {run.gain for run in broad(campaign.runs) if peak and (run.band is None or run.band[0] < peak < run.band[1])}
        if peak is not None and len(reached) < 2:
            notes.append(
                f"Only one gain excites the heatblock's peak at {peak:.4g} Hz: measure this band at a second gain, locked and "
                "unlocked, to distinguish mass loading from friction and other nonlinearities."
            )
    if not any(run.use == "holdout" for run in campaign.runs):
        notes.append(HOLD_OUT)
    return notes


def _stuck(found: Characterization, run: Run, friction: float) -> str:
    share = stuck_share(found.fit.model, run)
    if share <= MOSTLY_STUCK:
        return ""
    force = found.fit.model.drive.factor * float(np.std(run.read(found.fit.model.drive.channel)))
    band = "" if run.band is None else f" from {run.band[0]:g} to {run.band[1]:g} Hz"
    return (
        f"At gain {run.gain:g}{band} the head's rms force is {force:.2g} N and friction is {friction:.3g} N, so that "
        f"the motor is stuck {100 * share:.0f} % of the time and the rig behaves like a locked one: use a narrower band and a "
        f"drive about {max(SLIDES * friction / force, 1.5):.2g} times stronger to measure the isolation there."
    )
