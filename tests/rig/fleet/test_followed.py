"""A fleet followed: what is told of rigs, of versions, of what else happened."""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_up import FRICTION, PARAMETERS, SPRING, Shift, drawn_fleet, write_catalogue

from isorig.rig.cli import main
from isorig.rig.errors import RigError
from isorig.rig.fleet.history import followed
from isorig.rig.fleet.sentences import bad_campaigns, coinciding_events, incident_words, state_of


def test_one_of_fifty_changes() -> None:
    fleet = followed(drawn_fleet(1, campaigns=24, shifts=[Shift(rig=7, first=14, by={FRICTION: -6.0})]), "coulomb")
    [incident] = fleet.rigs["rig-007"].incidents
    [(track, change)] = incident.changes
    assert track.name == FRICTION
    assert (change.kind, change.first) == ("step", 14)
    assert change.after - change.before == pytest.approx(-0.18, abs=0.03)
    assert incident.alarm <= 16
    told = incident_words(fleet, incident, [])
    assert told.startswith("rig-007 changed, 2026-04-06 to 2026-04-13: friction force of isolation -1")
    assert told.endswith("; step); no cause found beyond the campaign-to-campaign scatter")
    assert state_of(fleet, fleet.rigs["rig-007"]).startswith("changed 2026-04-13")


def test_drift_is_one_change() -> None:
    fleet = followed(drawn_fleet(2, campaigns=40, shifts=[Shift(rig=9, first=10, by={SPRING: -0.5}, drift=True)]), "coulomb")
    [incident] = [i for i in fleet.rigs["rig-009"].incidents if i.changes[0][0].name == SPRING]
    [(_, change)] = incident.changes
    assert change.kind == "drift"
    assert abs(change.first - 10) <= 3
    assert change.slope == pytest.approx(-0.5 * 0.01 / 7.0, rel=0.2)


def test_a_cause_that_is_new_is_a_change_and_one_that_was_always_there_is_none() -> None:
    shifts = [
        Shift(rig=3, first=12, by={}, cause="imperfect_lock at lock", seen=1.0),
        Shift(rig=4, first=0, by={}, cause="extra_mode at table", seen=1.0),
        Shift(rig=5, first=15, by={}, cause="sensor_gain at motor", seen=1.0),
    ]
    frame = drawn_fleet(3, campaigns=16, shifts=shifts)  # one campaign alone names the gain
    fleet = followed(frame, "coulomb")
    [lock] = [i for i in fleet.rigs["rig-003"].incidents if i.named]
    assert [(n.cause, n.first, n.alarm) for n in lock.named] == [("imperfect_lock at lock", 12, 13)]
    assert (lock.last_before, lock.first_after) == (11, 12)
    assert "Named since: imperfect lock at lock." in coinciding_events(fleet, lock)
    assert not [i for name in ("rig-004", "rig-005") for i in fleet.rigs[name].incidents if i.named]


def test_a_cause_indistinguishable_from_a_known_one_is_not_new() -> None:
    frame = drawn_fleet(4, rigs=6, campaigns=16)
    mine = frame.rig == "rig-000"
    weeks = frame.campaign.str[-3:].astype(int)
    frame.loc[mine, "cause"] = np.where(weeks[mine] < 10, "wrong_mass at head", "sensor_gain at head")
    frame.loc[mine, "alike"] = "sensor_gain at head + wrong_mass at head"
    assert not followed(frame, "coulomb").rigs["rig-000"].incidents


def test_a_new_version_alarms_only_when_it_has_caught_up() -> None:
    """Version 2 finds ten per cent less friction everywhere: no rig has changed."""
    old = drawn_fleet(5, rigs=10, campaigns=20)
    new = old.assign(version="2", value=np.where(old.parameter == FRICTION, 0.9 * old.value, old.value))
    weeks = new.campaign.str[-3:].astype(int)
    begun = pd.concat([old[old.campaign.str[-3:].astype(int) < 15], new[weeks >= 15]])
    fleet = followed(begun, "coulomb")
    assert {rig.version for rig in fleet.rigs.values()} == {"1"}
    assert {len(rig.campaigns) for rig in fleet.rigs.values()} == {15}
    assert {rig.waiting for rig in fleet.rigs.values()} == {5}
    assert "5 campaigns wait for a diagnosis by the same version" in state_of(fleet, fleet.rigs["rig-000"])
    done = pd.concat([old[old.campaign.str[-3:].astype(int) < 15], new])
    fleet = followed(done, "coulomb")
    assert {(rig.version, len(rig.campaigns), rig.waiting) for rig in fleet.rigs.values()} == {("2", 20, 0)}
    assert not [i for i in fleet.incidents if i.changes[0][0].name == FRICTION]
    # Followed as one series it would have alarmed everywhere.
    mixed = followed(begun.assign(version="1"), "coulomb")
    assert len({i.rig for i in mixed.incidents if FRICTION in {t.name for t, _ in i.changes}}) >= 8


def test_what_else_happened_then() -> None:
    shifts = [Shift(rig=1, first=12, by={FRICTION: 8.0}), Shift(rig=2, first=12, by={SPRING: 8.0})]
    frame = drawn_fleet(6, campaigns=20, shifts=shifts)
    late = frame.campaign.str[-3:].astype(int) >= 12
    frame.loc[late & (frame.rig == "rig-001"), "started"] += timedelta(days=60)
    fleet = followed(frame, "coulomb")
    [incident] = [i for i in fleet.rigs["rig-001"].incidents if i.changes[0][0].name == FRICTION]
    told = " ".join(coinciding_events(fleet, incident))
    assert "Changed at the same time: rig-002." in told
    assert "The rig was not measured for 67 days from 2026-03-23 on (7 days are usual)." in told


def test_an_odd_rig_and_a_bad_campaign() -> None:
    frame = drawn_fleet(7, campaigns=16)
    frame.loc[(frame.rig == "rig-011") & (frame.parameter == SPRING), "value"] *= 1.4
    frame.loc[(frame.rig == "rig-012") & (frame.campaign == "week-008") & (frame.parameter == FRICTION), "value"] *= 0.5
    fleet = followed(frame, "coulomb")
    assert fleet.siblings[SPRING].outliers == ("rig-011",)
    assert not [i for i in fleet.rigs["rig-011"].incidents if i.confirmed]
    assert not [i for i in fleet.rigs["rig-012"].incidents if i.changes and i.changes[0][0].name == FRICTION]
    assert [(c.name, names) for c, names in bad_campaigns(fleet.rigs["rig-012"])] == [
        ("week-008", ["friction force of isolation"])
    ]


def test_few_campaigns_raise_no_alarm_and_unusable_ones_are_reported() -> None:
    frame = drawn_fleet(8, rigs=1, campaigns=4, shifts=[Shift(rig=0, first=2, by={FRICTION: 50.0})])
    fleet = followed(frame, "coulomb")
    assert fleet.limits == {}
    assert fleet.incidents == []
    frame.loc[frame.campaign == "week-001", "started"] = pd.NaT
    frame.loc[frame.campaign == "week-003", ["verdict", "reason"]] = ["refused", "it is damaged"]
    fleet = followed(frame, "coulomb")
    assert [c.name for c in fleet.rigs["rig-000"].campaigns] == ["week-000", "week-002"]
    assert any("week-003: refused; it is damaged" in note for note in fleet.notes)
    assert any("week-001 is not tracked: the recording does not give its start time" in note for note in fleet.notes)
    with pytest.raises(RigError, match="no campaign was diagnosed with the linear baseline yet"):
        followed(frame, "linear")
    with pytest.raises(RigError, match="give a positive one"):
        followed(frame, "coulomb", false_per_month=0.0)


def test_show(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    write_catalogue(tmp_path, drawn_fleet(1, rigs=8, campaigns=24, shifts=[Shift(rig=7, first=14, by={FRICTION: -8.0})]))

    def shown(*words: str) -> str:
        assert main(["fleet", "show", "-c", str(tmp_path), *words]) == 0
        return capsys.readouterr().out

    assert "8 rigs, coulomb baseline" in shown()
    assert shown().index("rig-007") < shown().index("rig-000")  # what changed comes first
    one = shown("--rig", "rig-007")
    assert "2026-04-13" in one
    assert one.count("\n") > len(PARAMETERS)
    both = shown("--rig", "rig-007", "--parameter", "friction force of isolation")
    assert both.count("week-") == 24
    assert "alarm" in both
    assert "rig-003" in shown("--parameter", FRICTION)
    for words, says in ((("--rig", "rig-9"), "there is no rig 'rig-9'"), (("--parameter", "colour"), "there is no parameter")):
        assert main(["fleet", "show", "-c", str(tmp_path), *words]) == 2
        assert says in capsys.readouterr().err


def test_a_rig_with_a_cause_changes_once() -> None:
    """Campaigns whose diagnosis misses the cause have biased values: these are no second change, and neither is the cause."""
    shift = Shift(rig=3, first=8, by={SPRING: 30.0}, cause="end_stop at isolation", seen=1.0)
    frame = drawn_fleet(5, campaigns=20, shifts=[shift])
    weeks = frame.campaign.str[-3:].astype(int)
    missed = (frame.rig == "rig-003") & weeks.isin([10, 11, 14])
    frame.loc[missed, "cause"] = ""
    frame.loc[missed & (frame.parameter == SPRING), "value"] *= 1.4
    fleet = followed(frame, "coulomb")
    [incident] = fleet.rigs["rig-003"].incidents
    assert [one.cause for one in incident.named] == ["end_stop at isolation"]
    assert not {10, 11, 14} & set(fleet.rigs["rig-003"].tracks[SPRING].campaigns)
    told = incident_words(fleet, incident, None)
    assert "the diagnosis names the cause, end stop at isolation (named from 2026-03-02 on)" in told
    assert "explained by" not in told


def test_a_campaign_that_no_model_explains_may_be_the_first_with_the_cause() -> None:
    """The first campaign after a change is not always explained: the change may be before it, and its values do not count."""
    shift = Shift(rig=3, first=7, by={SPRING: 30.0}, cause="end_stop at isolation", seen=1.0)
    frame = drawn_fleet(5, campaigns=20, shifts=[shift])
    missed = (frame.rig == "rig-003") & (frame.campaign == "week-007")
    frame.loc[missed, "cause"], frame.loc[missed, "verdict"] = "", "unexplained"
    fleet = followed(frame, "coulomb")
    [incident] = fleet.rigs["rig-003"].incidents
    assert (incident.last_before, incident.first_after) == (6, 8)
    assert 7 not in fleet.rigs["rig-003"].tracks[SPRING].campaigns
    assert "2026-02-16 to 2026-03-02" in incident_words(fleet, incident, None)


def test_a_rig_that_was_never_explained_is_dated_by_the_name() -> None:
    frame = drawn_fleet(5, campaigns=20, shifts=[Shift(rig=3, first=7, by={}, cause="end_stop at isolation", seen=1.0)])
    before = (frame.rig == "rig-003") & (frame.campaign.str[-3:].astype(int) < 7)
    frame.loc[before, "verdict"] = "unexplained"
    [incident] = followed(frame, "coulomb").rigs["rig-003"].incidents
    assert (incident.last_before, incident.first) == (6, 7)


@pytest.mark.parametrize(("absent", "kept"), [(2, 0), (3, 3)])
def test_a_cause_that_is_gone(absent: int, kept: int) -> None:
    """After as many campaigns without it as decide on a cause, it is repaired: they count again."""
    shift = Shift(rig=3, first=6, by={}, cause="end_stop at isolation", seen=1.0)
    frame = drawn_fleet(6, campaigns=16, shifts=[shift])
    weeks = frame.campaign.str[-3:].astype(int)
    frame.loc[(frame.rig == "rig-003") & (weeks >= 16 - absent), "cause"] = ""
    track = followed(frame, "coulomb").rigs["rig-003"].tracks[SPRING]
    assert len([k for k in track.campaigns if k >= 16 - absent]) == kept
