"""Sentences of proposals for rigs other than the wire bonder."""

from __future__ import annotations

import msgspec
import numpy as np
from open_questions import end_stop, hardening, rivals
from some_findings import findings, named

from isorig.analysis.fitting.solve import positive
from isorig.analysis.model.limits import Limits
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.proposals.choice import Choice, Chosen, PairDistance
from isorig.analysis.proposals.limits import LargestMotions
from isorig.analysis.proposals.menu import CandidateRun, run_at_rest
from isorig.analysis.proposals.precision import named_parameters, unit_of_parameter
from isorig.analysis.proposals.prediction import Prospect, Variant
from isorig.rig.files.rigfile import SHIPPED, read_description
from isorig.rig.files.rivals import FittedModel, OpenSet, fitted_model
from isorig.rig.next.investigation import diagnosis_sentences
from isorig.rig.next.page import proposal_sections
from isorig.rig.next.plan_file import plan_text, virtual_instrument_of
from isorig.rig.next.proposal import Proposal, Proposed, Situation, situation
from isorig.rig.next.sentences import inseparable, reasons, summary, twins


def explained(model: RigModel) -> FittedModel:
    """A model with one fitted parameter."""
    path = model.free[0]
    return fitted_model("", "", model, (positive(path, model.get(path)),), np.eye(1) * 1e-8)


def at(model: RigModel, limits: Limits) -> Situation:
    """Two runs of a rig."""
    return situation([rivals(explains=explained(model))], limits, {}, frozenset())


def shipped(name: str) -> RigModel:
    return read_description(SHIPPED[name])[0]


def test_parameters_have_units() -> None:
    def named(rig: RigModel) -> dict[str, str]:
        return {name: unit_of_parameter(name, rig) for name in named_parameters(rig)}

    assert named(shipped("one-mass-rail")) == {
        "stage_mass": "kg", "stage_frequency": "Hz", "stage_damping": "1", "friction_force": "N",
    }  # fmt: skip
    assert named(shipped("belt-pair"))["motor_mass"] == "kg m^2"


def test_twins_of_a_cause_that_was_ruled_out_are_ruled_out() -> None:
    last = rivals(
        OpenSet(why="indistinguishable", models=[hardening()], twins=[("wrong_mass", "head")], unfitted=[hardening().key])
    )
    before = rivals(ruled_out=[hardening().key])
    (left,) = situation([before, last], Limits(), {}, frozenset()).rivals.open
    assert (left.models, left.twins, left.unfitted) == ([], [], [])
    assert twins(situation([before, last], Limits(), {}, frozenset()).rivals) == []
    assert len(twins(situation([last], Limits(), {}, frozenset()).rivals)) == 1


def test_a_cause_that_was_ruled_out_alone_may_be_there_beside_another() -> None:
    open_one = OpenSet(why="indistinguishable", models=[hardening()])
    before = rivals(ruled_out=[hardening().key])
    last = rivals(open_one, named=[("end_stop", "isolation"), ("channel_delay", "motor")])
    (left,) = situation([before, last], Limits(), {}, frozenset()).rivals.open
    assert left.models == [hardening()]
    two = findings(steps=[named(), named(location="mount")])
    for found, said in ((findings(), "Ruled out: "), (two, "Ruled out as the only cause: ")):
        sentences = diagnosis_sentences(rivals(ruled_out=[hardening().key], verdict="explained"), found)
        assert any(sentence.startswith(said) for sentence in sentences)


def test_why_a_rig_rests() -> None:
    """Friction is the reason only where there is a contact."""
    for name, rubs in (("two-carts", False), ("one-mass-rail", True)):
        model = shipped(name)
        said = " ".join(reasons(Proposed(run=run_at_rest(model, Limits())), Proposal(kind="untested"), at(model, Limits())))
        assert "the rig's own motion masks the noise" in said
        assert ("friction excites all frequencies" in said) == rubs


def test_uses_have_units() -> None:
    run = CandidateRun(configuration="unlocked", excitation="random", gain=1.0, seconds=10.0, band=(1.0, 40.0))
    for name, link, drive, stroke in (("two-carts", "wall", "V", "mm"), ("belt-pair", "belt", "N m", "mrad")):
        model = shipped(name)
        limits = Limits(drive=138.0, stroke={link: 0.5})
        peaks = LargestMotions(drive=28.6, force=28.6, stroke={link: 0.02}, channels={}, speed={})
        used = Proposed(run=run, peaks=peaks)
        said = " ".join(reasons(used, Proposal(kind="untested"), at(model, limits)))
        assert f"a drive of 28.6 of 138 {drive}" in said
        assert f"20 of 500 {stroke} at the {link}" in said


def test_units_keep_their_capitals() -> None:
    model = shipped("two-carts")
    run = CandidateRun(configuration="unlocked", excitation="random", gain=1.0, seconds=10.0, band=(1.0, 40.0))
    proposal = Proposal(kind="undecided", runs=(Proposed(run=run),))
    text = " ".join(proposal_sections(proposal, at(model, Limits()), ["next-1"])[0].text)
    assert text.startswith("Random drive from 1 to 40 Hz")


def test_a_cause_is_named_once() -> None:
    model = shipped("two-carts")
    variants = [Variant(cause=c, location=p, model=model, free=(), covariance=at(model, Limits()).explains.covariance)
                for c, p in (("backlash", "wall"), ("hardening_stiffness", "wall"))]  # fmt: skip
    run = CandidateRun(configuration="unlocked", excitation="random", gain=1.0, seconds=10.0, band=(1.0, 40.0))
    apart = tuple(
        PairDistance(truth=one, rival=variants[0], distance=9.0 + k, probability=1.0)
        for k, one in enumerate((*variants, variants[1]))
    )
    prospect = Prospect(run=run, drive=at(model, Limits()).explains.covariance.ravel(), sample_rate=200.0, start_time=0.0)
    choice = Choice(
        prospect=prospect,
        apart=apart,
        probability=0.9,
        gained=0.4,
        peaks=LargestMotions(drive=1.0, force=1.0, stroke={}, channels={}, speed={}),
        predicted_pairs=(),
    )
    said = " ".join(reasons(Proposed(run=run, choice=choice), Proposal(kind="untested"), at(model, Limits())))
    assert said.count("backlash at wall") == 1
    assert said.count("hardening stiffness at wall") == 1


def test_masses_that_no_run_tells_apart_are_to_be_weighed() -> None:
    pair = ("wrong_mass", "m1"), ("wrong_mass", "table")
    proposal = Proposal(kind="rivals", chosen=Chosen(choices=(), best=(), compared=3), remedies={pair: ()})
    assert inseparable(proposal)[-1] == "Weigh m1 and the table."


def test_only_equal_equations_are_twins() -> None:
    """A cause that was not fitted is no twin: more time decides it, not a balance."""
    found = rivals(OpenSet(why="indistinguishable", models=[hardening(), end_stop()], unfitted=[("backlash", "isolation")]))
    said = " ".join(summary(Proposal(kind="rivals"), found))
    assert twins(found) == []
    assert "does not exclude backlash at isolation, but did not fit it in full: diagnose again with more --seconds" in said
    assert "Weigh" not in said


def test_a_plan_for_people() -> None:
    """The sample rate has no rounding errors, and a force sensor is none of acceleration."""
    model = shipped("one-mass-rail")
    found = msgspec.structs.replace(rivals(explains=explained(model)), sample_rate=1024.0000000477723)
    text = plan_text(virtual_instrument_of(found), {})
    assert "sample_rate = 1024.0\n" in text
    assert "virtual accelerometer" not in text
    assert 'sensor = "virtual sensor of force"' in text
    assert 'unit = "m"' in text
