"""The answer that a colleague would give: phrases of all causes, units by size, what was ruled out, what to do."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
from some_findings import findings, named

from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.analysis.diagnose.policy import POLICY
from isorig.analysis.fitting.excess import SIMULATION_LIMIT
from isorig.analysis.fitting.solve import Fit
from isorig.analysis.simulate.natural import natural_modes
from isorig.analysis.wording import SIZED, in_per_cent, noise_alone, sized
from isorig.rig.cli import main
from isorig.rig.diagnose.answer import PERIODS, _of_given_masses, missing
from isorig.rig.files.findings import Findings, NamedCause, RequiredForce, read_findings
from isorig.rig.files.recording import write
from isorig.rig.files.rigfile import read_rig, write_model
from isorig.rig.frf.transfer import transfer_functions
from isorig.rig.model.prediction import predicted
from isorig.rig.report.conclusion import OPEN, cause_in_words, conclude
from isorig.rig.report.sections import unbroken
from isorig.rig.virtual.simulated_recording import described_campaign
from isorig.rig.wire_bonder.description import wire_bonder

DOUBT = {"parameter": "sensors", "kind": "unit", "ratio": 9.81, "text": "Doubtful unit."}


def step(**more: Any) -> NamedCause:
    """A step of the findings of play in a coupling."""
    return msgspec.convert(named(**more), NamedCause)


def test_the_answer_names_the_cause_with_its_size_and_the_error() -> None:
    said = conclude(findings(), "out")
    assert said.answer == (
        "explained: play of 0.5000 ± 0.0003 mm in the coupling (0.25 mm either way); "
        "the error on held-out data falls from 35 % to 1.3 %, noise alone is about 1.2 %"
    )
    assert said.ruled_out == (
        "Ruled out, with the error each leaves: hardening stiffness at the coupling (12 %), softening stiffness at the coupling "
        "(20 %), end stop at the coupling (30 %), and 1 more."
    )
    assert "out/model.json" in said.next
    assert said.lines == [said.answer, said.ruled_out, said.next]


@pytest.mark.parametrize(("times", "told"), [(0.99, False), (1.01, True)])
def test_an_explanation_far_above_the_noise_is_said_to_lack_a_part(times: float, told: bool) -> None:
    found = findings()
    left = times * OPEN * np.hypot(found.holdout.noise_floor, SIMULATION_LIMIT)
    large = msgspec.structs.replace(found, holdout=msgspec.structs.replace(found.holdout, extended=left))
    assert ("a part of this one, is not found" in conclude(large, "out").answer) is told


def test_what_was_tried_on_top_of_an_uncertain_cause_does_not_rule_it_out() -> None:
    tried = [msgspec.to_builtins(each) for each in findings().candidates]
    tried[0] |= {"standing": "main contributor", "holdout_error": 0.1}
    tried[1] |= {"standing": "ruled out", "holdout_error": 0.09}
    said = conclude(findings(verdict="unexplained", steps=[], candidates=tried[:2])).ruled_out
    unsure, further = (tried[k]["cause"].replace("_", " ") for k in (0, 1))
    assert said.startswith(f"Not certain enough to be named, with the error it leaves: {unsure}")
    assert f"Tried in addition, and not certain, with the error then left: {further}" in said


def test_what_leaves_more_alone_is_not_ruled_out_beside_another_cause() -> None:
    both = findings(steps=[named(), named(cause="channel_delay", kind="sensor", form="channel_delay", location="motor")])
    assert conclude(both).ruled_out.startswith("Ruled out as the only cause, with the error each leaves: hardening stiffness")


@pytest.mark.parametrize(("extended", "alone"), [(1.49 * 0.0126, ""), (1.51 * 0.0127, " as the only cause")])
def test_what_is_ruled_out_may_be_a_further_cause_while_an_error_above_the_noise_is_left(extended: float, alone: str) -> None:
    """The noise is 1.2 % of the signal, the accuracy of the simulation 0.4 %."""
    found = findings()
    found = msgspec.structs.replace(found, holdout=msgspec.structs.replace(found.holdout, extended=extended))
    assert conclude(found).ruled_out.startswith(f"Ruled out{alone}, with the error each leaves: hardening stiffness")


@pytest.mark.parametrize("standing", ["main contributor", "ruled out"])
def test_what_leaves_as_much_as_the_model_without_it_is_not_listed(standing: str) -> None:
    useless = msgspec.structs.replace(findings().candidates[0], standing=standing, share=-0.01, holdout_error=0.36)
    assert conclude(findings(verdict="adequate", steps=[], candidates=[msgspec.to_builtins(useless)])).ruled_out == ""


@pytest.mark.parametrize(("factor", "listed"), [(POLICY.matters + 0.01, True), (POLICY.matters - 0.01, False)])
def test_what_was_tried_in_addition_must_leave_less_than_the_answer(factor: float, listed: bool) -> None:
    tried = msgspec.structs.replace(findings().candidates[0], holdout_error=findings().holdout.extended / factor)
    assert bool(conclude(findings(candidates=[msgspec.to_builtins(tried)])).ruled_out) is listed


def test_a_fit_elsewhere_is_not_of_the_kind_and_place_that_the_equations_show() -> None:
    """It left more than the model with the cause before it, though less than the baseline."""
    elsewhere = msgspec.structs.replace(findings().candidates[0], location="gas", standing="not confirmed", holdout_error=0.15)
    said = conclude(findings(candidates=[msgspec.to_builtins(elsewhere)])).ruled_out
    assert said == "Neither confirmed nor ruled out, because no fit followed the motion: end stop at the gas (15 %)."


def test_what_was_tried_on_top_of_the_answer_is_no_rival_of_it() -> None:
    tried = [msgspec.to_builtins(each) for each in findings().candidates]
    tried[1]["holdout_error"] = 0.9 * findings().holdout.extended
    said = conclude(findings(candidates=tried)).ruled_out
    assert said.startswith(f"Tried in addition, and not certain, with the error then left: {tried[1]['cause'].replace('_', ' ')}")
    assert "Ruled out, with the error each leaves: " in said


def test_a_cause_to_which_the_equations_point_is_not_ruled_out() -> None:
    """Its fit leaves much of the error where no simulation follows the records."""
    tried = findings().candidates
    pointed = {"kind": "spring_shape", "location": "coupling"}
    unconfirmed = [msgspec.to_builtins(msgspec.structs.replace(tried[0], standing="not confirmed", holdout_error=0.29))]
    others = [msgspec.to_builtins(msgspec.structs.replace(each, location="mount")) for each in tried[1:]]
    found = findings(verdict="unexplained", steps=[], pointed=pointed, candidates=unconfirmed + others)
    said = conclude(found, "out")
    assert "point to a nonlinear spring force over deflection at the coupling, which no fit confirms yet" in said.answer
    assert said.ruled_out == (
        "Of this kind and place, not confirmed, with the error each leaves: end stop at the coupling (29 %). "
        "Ruled out, with the error each leaves: hardening stiffness at the mount (12 %), softening stiffness at the mount "
        "(20 %), stiffness drift at the mount (34 %)."
    )


def test_a_fit_that_leaves_more_than_the_model_without_it_rules_nothing_out() -> None:
    first, *others = findings().candidates
    lost = msgspec.structs.replace(first, standing="not confirmed", holdout_error=2.0 * findings().holdout.baseline)
    said = conclude(findings(candidates=[lost, *others])).ruled_out
    assert f"Neither confirmed nor ruled out, because no fit followed the motion: {first.cause.replace('_', ' ')}" in said


@pytest.mark.parametrize(
    ("end", "said"),
    [(1.0, "20.00 ± 0.10 mm (only of positive deflection)"), (-1.0, "only of negative"), (0.0, "0.10 mm, contact")],
)
def test_a_stop_at_one_end_only_says_which(end: float, said: str) -> None:
    values = {"stroke": (0.02, 1e-4, "m"), "contact_stiffness": (9e4, 1e3, "N/m"), "end": (end, 0.0, "1")}
    parameters = {name: {"value": value, "std": std, "unit": unit} for name, (value, std, unit) in values.items()}
    assert said in cause_in_words(step(cause="end_stop", form="end_stop", parameters=parameters))


@pytest.mark.parametrize(
    ("rate", "std", "until", "said"),
    [
        (0.07519, 0.00014, 20.0, "by +7.519 ± 0.014 % per second"),
        (-2e-4, 1e-5, 900.0, "by -1.20 ± 0.06 % per minute"),
        (1e-5, 2e-6, 7200.0, "by +3.6 ± 0.7 % per hour"),
        (1e-5, None, None, "by +3.6 % per hour"),
    ],
)
def test_a_drift_is_given_in_per_cent_over_a_time_that_fits_the_session(
    rate: float, std: float | None, until: float | None, said: str
) -> None:
    parameters = {"drift_rate": {"value": rate, "std": std, "unit": "1/s"}}
    held = {"until": {"value": until, "unit": "s"}} if until else {}
    words = cause_in_words(step(cause="damping_drift", form="damping_drift", parameters=parameters, held=held))
    assert words == f"a damping of the coupling that changes {said}"


def test_an_error_of_many_times_the_signal_loses_the_motion() -> None:
    first, *others = findings().candidates
    lost = findings(candidates=[msgspec.structs.replace(first, holdout_error=5e11), *others])
    assert conclude(lost).ruled_out.endswith("stiffness drift at the coupling (34 %), and 1 more.")
    lost = findings(candidates=[msgspec.structs.replace(first, holdout_error=5e11)])
    assert conclude(lost).ruled_out == "Ruled out, with the error each leaves: end stop at the coupling (loses the motion)."


def test_a_numbered_place_has_no_article_and_an_error_below_the_noise_floor_is_stated() -> None:
    found = findings(steps=[named(location="l2")])
    found = msgspec.structs.replace(found, holdout=msgspec.structs.replace(found.holdout, extended=0.006))
    assert "mm in l2 (0.25 mm either way)" in conclude(found).answer
    assert conclude(found).answer.endswith("falls from 35 % to 0.60 %, below what noise may cause (about 1.2 %)")


def test_a_model_that_errs_less_than_noise_has_nothing_tried_on_top_of_it() -> None:
    tried = msgspec.structs.replace(findings().candidates[0], holdout_error=0.002)
    found = findings(candidates=[msgspec.to_builtins(tried)])
    found = msgspec.structs.replace(found, holdout=msgspec.structs.replace(found.holdout, extended=0.006))
    assert conclude(found).ruled_out == ""


def test_of_several_causes_the_one_that_another_may_replace_is_named() -> None:
    """Of masses of which these runs show one to be wrong, both are to be weighed: no run tells which."""
    mass = named(cause="wrong_mass", kind="known_value", form="wrong_mass", location="m1")
    group = [{"cause": "wrong_mass", "location": "m1"}, {"cause": "wrong_mass", "location": "table"}]
    said = conclude(findings(steps=[named(), mass], indistinguishable=[group]))
    assert "Not distinguishable from wrong mass at m1 by these runs: wrong mass at the table." in said.ruled_out
    assert said.next == ("Next: weigh m1 and the table, because these runs do not show which of the given masses is wrong.")


def test_what_bounds_the_error_of_an_adequate_model_is_said() -> None:
    """The noise, what repeated runs do not share, or the user's tolerance."""
    found = msgspec.to_builtins(findings(verdict="adequate", steps=[]))
    assert "down to the noise; " in conclude(msgspec.convert(found, Findings)).answer
    shares = found["budget"]["extended"]
    shares["disturbance"], shares["noise"] = ({"value": value, "low": value, "high": value} for value in (0.9, 0.1))
    said = conclude(msgspec.convert(found, Findings)).answer
    assert "down to the disturbance between repeated runs; " in said
    assert said.endswith("noise and disturbance alone are about 1.2 %")
    found["holdout"]["extended"] = 4.0 * found["holdout"]["noise_floor"]  # no repeated runs measured it
    said = conclude(msgspec.convert(found, Findings)).answer
    assert "down to what is related to neither the drive nor the motion beyond 0.80 % of the signal; " in said
    assert said.endswith("noise alone is about 1.2 %")
    found["tolerance"] = 0.4
    assert "to within the tolerance of 40 %; " in conclude(msgspec.convert(found, Findings)).answer


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"verdict": "adequate", "steps": []}, ["adequate: the model explains", "is 35 %", "rig predict out/model.json"]),
        ({"verdict": "unexplained", "steps": []}, ["no place and kind of cause is certain", "rig next out"]),
        (
            {"verdict": "unexplained", "steps": [], "driven": False},
            ["Next: no run was driven, so release the rig from another position, repeat one release"],
        ),
        ({"verdict": "partly explained"}, ["partly explained: play of", "rig next out"]),
        ({"cut_short": True}, ["the time limit ended the search", "--seconds"]),
        ({"doubts": [DOUBT]}, ["given values first: Doubtful unit.", "diagnose again"]),
        (
            {"indistinguishable": [[{"cause": "backlash", "location": "coupling"}, {"cause": "end_stop", "location": "mount"}]]},
            ["Not distinguishable from it by these runs: end stop at the mount.", "rig next out"],
        ),
    ],
)  # fmt: skip
def test_every_verdict_says_what_to_do(more: dict[str, Any], words: list[str]) -> None:
    said = " ".join(conclude(findings(**more), "out").lines)
    assert [word for word in words if word not in said] == []


def test_a_kind_without_a_form_is_named_with_the_closest_form() -> None:
    without = {"cause": "spring_shape", "form": None, "level": "kind", "parameters": {}}
    closest = {"cause": "softening_stiffness", "share": 0.7}
    assert cause_in_words(step(**without, closest_form=closest)) == (
        "a nonlinear spring force over deflection at the coupling, closest to softening stiffness"
    )
    assert cause_in_words(step(**without)).endswith("at the coupling, of no catalogued form")


def test_a_friction_that_depends_on_the_position_is_told_with_its_levels() -> None:
    points = [[-0.2, 9.0, None], [-0.1, 0.5, 0.1], [0.0, 2.0, 0.1], [0.1, 3.5, 0.1]]
    curve = {"over": "position", "unit": "m", "value_unit": "N", "points": points, "reached": [-0.12, 0.1]}
    rubs = {"cause": "friction_shape", "kind": "friction_shape", "form": None, "level": "kind", "parameters": {}}
    assert cause_in_words(step(**rubs, curve=curve)) == (
        "a dry friction level at the coupling that depends on the position, from 0.5 N to 3.5 N, of no catalogued form"
    )
    assert "position" not in cause_in_words(step(**rubs, curve=curve | {"over": "speed"}))


def test_the_closest_form_is_not_said_to_be_ruled_out() -> None:
    shaped = named(form=None, level="kind", cause="spring_shape", closest_form={"cause": "hardening_stiffness", "share": 0.7})
    said = conclude(findings(steps=[shaped]))
    assert "closest to hardening stiffness" in said.answer
    assert "hardening stiffness" not in said.ruled_out
    assert "softening stiffness at the coupling (20 %)" in said.ruled_out


def test_a_drive_that_acts_later_is_ahead_of_the_others() -> None:
    def said(delay: float) -> str:
        late = {"cause": "channel_delay", "location": "motor", "kind": "sensor", "form": "channel_delay"}
        return cause_in_words(step(**late, parameters={"delay": {"value": delay, "std": 1e-5, "unit": "s"}}))

    assert said(2e-3) == "the motor channel is late by 2.000 ± 0.010 ms"
    assert said(-2e-3) == "the motor channel is ahead of the others by 2.000 ± 0.010 ms"


@pytest.mark.parametrize(("play", "said"), [(1.01e-6, "play of"), (0.99e-6, "friction of 17.6 ± 0.3 N behind a spring of")])
def test_a_play_that_is_zero_within_its_uncertainty_is_not_mentioned(play: float, said: str) -> None:
    values = {
        "clearance": {"value": play, "std": 1e-6, "unit": "m"},
        "spring_stiffness": {"value": 8.8e4, "std": 1e3, "unit": "N/m"},
        "friction_force": {"value": 17.6, "std": 0.3, "unit": "N"},
    }
    slips = {"cause": "play_and_friction", "location": "mount", "kind": "memory", "form": "play_and_friction"}
    assert cause_in_words(step(**slips, parameters=values)).startswith(said)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"cubic_stiffness": {"value": -0.62, "std": 0.02, "unit": "N/m^3"}}, "cubic stiffness -0.62 ± 0.02 N/m³"),
        (
            {"softening": {"value": 0.4, "std": 0.01, "unit": "1"}, "scale": {"value": 2e-3, "std": 1e-4, "unit": "m"}},
            "it loses 40.0 ± 1.0 % of its stiffness beyond 2.00 ± 0.10 mm",
        ),
    ],
)
def test_a_softening_spring_is_told_by_the_values_of_its_law(values: dict[str, dict[str, Any]], said: str) -> None:
    softens = {"cause": "softening_stiffness", "location": "mount", "kind": "spring_shape", "form": "softening_stiffness"}
    assert cause_in_words(step(**softens, parameters=values)).endswith(said)


@pytest.mark.parametrize(
    ("backward", "said"),
    [
        (0.0, "friction at the mount of 27.7 ± 1.2 N forward and 12.2 ± 1.2 N backward"),
        (212.0, "12.2 ± 1.2 N backward, and damping of 0 ± 14 N s/m forward and 212 ± 3 N s/m backward"),
    ],
)
def test_friction_that_differs_by_direction_is_told_with_its_dampings_unless_both_are_zero(backward: float, said: str) -> None:
    values = {
        "forward_force": {"value": 27.7, "std": 1.2, "unit": "N"},
        "backward_force": {"value": 12.2, "std": 1.2, "unit": "N"},
        "forward_viscosity": {"value": 0.0, "std": 14.0, "unit": "N s/m"},
        "backward_viscosity": {"value": backward, "std": 3.0, "unit": "N s/m"},
    }
    differs = {"cause": "asymmetric_friction", "location": "mount", "kind": "friction_shape", "form": "asymmetric_friction"}
    assert cause_in_words(step(**differs, parameters=values)).endswith(said)


def test_a_cause_without_a_phrase_lists_its_parameters() -> None:
    worn = {"cause": "worn_gear", "location": "mount", "kind": "memory", "form": "worn_gear"}
    gap = {"value": 2e-5, "std": 1e-6, "unit": "m"}
    assert cause_in_words(step(**worn, parameters={"tooth_gap": gap})) == "worn gear at the mount, tooth gap 20.0 ± 1.0 µm"
    unknown = {"tooth_gap": {**gap, "std": None}, "wear": {"value": None, "std": None, "unit": "1"}}
    assert cause_in_words(step(**worn, parameters=unknown)) == "worn gear at the mount, tooth gap 20 µm, wear not available"


@pytest.mark.parametrize("unit", SIZED)
def test_a_size_in_a_unit_is_the_value(unit: str) -> None:
    for value in np.geomspace(1e-6, 1e9, 46):
        number, name = re.fullmatch(r"(\S+) ?(.*)", sized(float(value), unit, digits=6)).groups()  # type: ignore[union-attr]
        scale = next(s for _, s, n in SIZED[unit] if n == name)
        assert float(number) * scale == pytest.approx(value, rel=1e-5)


def test_shares_have_two_digits() -> None:
    shares = (0.002, 0.0954, 0.0996, 0.35, 1.5, 23.0)
    assert [in_per_cent(share) for share in shares] == ["0.20 %", "9.5 %", "10 %", "35 %", "150 %", "23 times the signal"]
    assert noise_alone(0.0042) == "about 0.42 %"


def test_numbers_stay_with_their_units() -> None:
    assert (
        unbroken("play of 0.5 ± 0.1 mm in it, 35 % to 2 N.")
        == "play of 0.5\u00a0±\u00a00.1\u00a0mm in it, 35\u00a0% to 2\u00a0N."
    )


def runs(levels: list[float], seconds: float = 60.0, **more: Any) -> Campaign:
    rng = np.random.default_rng(0)
    names = ("head", "motor", "table", "heatblock")

    def channels(level: float) -> dict[str, Channel]:
        return {name: Channel(name=name, samples=level * rng.normal(size=round(256 * seconds))) for name in names}

    common: dict[str, Any] = {"configuration": "unlocked", "sample_rate": 256.0, "gain": 1.0, "excitation": "random", **more}
    return Campaign(runs=tuple(Run(id=f"r{k}", channels=channels(level), **common) for k, level in enumerate(levels)))


def test_what_a_recording_lacks_is_said() -> None:
    model = wire_bonder()
    assert missing(runs([1.0, 1.0], repeat_of="r0"), model) == []
    assert [said.split(":")[0] for said in missing(runs([1.0], repeat_of="r0"), model)] == ["There is only one run"]
    (said,) = missing(runs([1.0, 1.0]), model)
    assert "No drive was played twice" in said
    slowest = natural_modes(model, "unlocked")[0].frequency
    long_enough, too_short = (PERIODS / slowest * factor for factor in (1.02, 0.97))
    assert missing(runs([1.0, 1.0], long_enough, repeat_of="r0"), model) == []
    (said,) = missing(runs([1.0, 1.0], too_short, repeat_of="r0"), model)
    assert "run 'r0' and 1 more; record at least" in said


def test_a_mass_with_a_stated_uncertainty_is_not_taken_as_exact() -> None:
    model = wire_bonder()
    stated = tuple(msgspec.structs.replace(body, mass_std=0.1 if body.name == "motor" else 0.0) for body in model.bodies)
    fit = Fit(model=msgspec.structs.replace(model, bodies=stated), free=(), covariance=np.eye(0), cost=1.0, evaluations=0)
    named = SimpleNamespace(parameters={"friction_force": (1.0, 0.1, "N")})
    said = _of_given_masses(SimpleNamespace(baseline=fit, extended=fit, steps=(named,)), runs([1.0]))  # type: ignore[arg-type]
    assert said.startswith("Uncertainties are given the described masses (the table, the heatblock): ")


def test_a_released_run_lacks_neither_length_nor_a_repeated_drive() -> None:
    model = wire_bonder()
    released = runs([1.0, 1.0], seconds=1.0, excitation="free")
    assert missing(released, model) == []
    driven = runs([1.0])
    assert [said.split(" (")[0] for said in missing(Campaign(runs=(*released.runs, *driven.runs)), model)] == [
        "No drive was played twice"
    ]


def test_runs_of_one_gain_with_several_levels_are_not_averaged_and_that_is_said() -> None:
    campaign = runs([6.0, 15.0, 15.5, 35.0], repeat_of="r0")
    (said,) = missing(campaign, wire_bonder())
    assert re.search(r"at gain 1 differ in level: the rms of head is 3[45]\.?\d? m/s\^2, 15\.\d m/s\^2, [56]\.?\d* m/s\^2", said)
    found = transfer_functions(campaign, responses=["table"], resolution=4.0)
    assert [len(item.runs) for item in found] == [1, 2, 1]
    assert len({item.name for item in found}) == len({item.label for item in found}) == 3
    # Levels that differ by less than the ratio are one level.
    assert len(transfer_functions(runs([1.0, 1.2]), responses=["table"], resolution=4.0)) == 1
    # Another excitation or band is another kind of run, whatever its level.
    mixed = runs([1.0, 3.0])
    mixed = replace(mixed, runs=(mixed.runs[0], replace(mixed.runs[1], band=(1.0, 50.0))))
    assert len(transfer_functions(mixed, responses=["table"], resolution=4.0)) == 1


@pytest.mark.parametrize("as_recorded", [False, True])
def test_predict_says_whether_the_file_has_the_faults_of_the_sensors(
    as_recorded: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = read_rig("two-carts")
    write(tmp_path / "c.h5", described_campaign(given, seed=1, seconds=2.0))
    write_model(tmp_path / "model.json", given.model.replace({"sensors.x2.chain.gain": 1.07}))
    call = ["predict", str(tmp_path / "model.json"), str(tmp_path / "c.h5"), "-o", str(tmp_path / "p.h5")]
    assert main([*call, *(["--as-recorded"] if as_recorded else [])]) == 0
    assert ("the true response of x2" in capsys.readouterr().out) == (not as_recorded)


def test_predict_says_the_error_by_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = read_rig("two-carts")
    campaign = described_campaign(given, seed=1, seconds=6.0, noise=0.02)
    write(tmp_path / "c.h5", campaign)
    write_model(tmp_path / "model.json", given.model)
    assert main(["predict", str(tmp_path / "model.json"), str(tmp_path / "c.h5"), "-o", str(tmp_path / "p.h5")]) == 0
    said = capsys.readouterr().out
    other = predicted(given.model, campaign)
    for run, simulated in zip(campaign.runs, other.runs, strict=True):
        row = next(line.split() for line in said.splitlines() if line.strip().startswith(run.id))
        for k, name in enumerate(("x1", "x2")):
            y = run.read(name)
            error = np.sqrt(np.mean((simulated.read(name) - y) ** 2) / np.mean(y**2))
            assert float(row[1 + 2 * k]) == pytest.approx(100.0 * error, rel=0.06)


def test_findings_of_the_command_agree_with_its_last_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = read_rig("one-mass-rail")
    write(tmp_path / "c.h5", described_campaign(given, seed=2, seconds=6.0))
    assert main(["diagnose", str(tmp_path / "c.h5"), "-o", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    found = read_findings(tmp_path / "out")
    conclusion = conclude(found, str(tmp_path / "out"))
    assert f"c: {conclusion.answer}\n" in said
    assert said.rstrip().endswith(conclusion.next)
    assert all(remark in said for remark in found.remarks)
    page = (tmp_path / "out" / "report.html").read_text()
    first = page[: page.index("<main>")]
    assert conclude(found).answer[1:].split("; the error on")[0] in first
    assert first.count('class="chart') == 4


@pytest.mark.parametrize(("low", "said"), [(0.51, True), (0.49, False)])
def test_what_most_of_an_unexplained_error_is_stands_in_the_answer(low: float, said: bool) -> None:
    budget = msgspec.to_builtins(findings().budget.extended) | {"amplitude": {"value": 0.9, "low": low, "high": 0.98}}
    unexplained = findings(verdict="unexplained", steps=[], budget={"baseline": budget, "extended": budget})
    assert ("; 90 % of the error's power changes with the amplitude" in conclude(unexplained).answer) == said


@pytest.mark.parametrize(
    ("listed", "said"),
    [(["base is 0.2 ms late", "top reads 1.1 % more"], " (base is 0.2 ms late, top reads 1.1 % more)"), ([], "")],
)
def test_small_errors_of_channels_stand_in_the_answer_of_an_adequate_model(listed: list[str], said: str) -> None:
    answer = conclude(findings(verdict="adequate", steps=[], chain_errors=listed)).answer
    assert (
        f"down to small errors of its channels{said} and to what is related to neither the drive nor the motion beyond " in answer
    )


def test_an_answer_by_the_required_force_promises_no_prediction() -> None:
    """The error of a simulation that cannot follow the motion says nothing."""
    said = conclude(msgspec.structs.replace(findings(), required_force=RequiredForce(baseline=0.4, extended=0.0035)), "out")
    assert "the model leaves 0.35 % on held-out data, and the model without the cause 40 %" in said.answer
    assert "rig predict" not in said.next
    assert "falls from" not in said.answer
    # A second cause that noise hides from the simulation: the first one is in its error.
    both = findings(steps=[*findings().steps, *findings().steps])
    force = RequiredForce(baseline=0.4, extended=0.0035, follows=True)
    said = conclude(msgspec.structs.replace(both, required_force=force), "out")
    assert "falls from" in said.answer
    assert "the model leaves 0.35 % on held-out data, and the model without the cause 40 %" in said.answer
    assert "rig predict" in said.next
