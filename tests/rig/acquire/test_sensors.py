"""Sensors against the laboratory's list and their memories: before a run, and in the recording."""

from __future__ import annotations

from datetime import date
from pathlib import Path

import pytest

from isorig.rig.acquire.plan import Plan
from isorig.rig.acquire.plan_check import read_plan
from isorig.rig.acquire.policy import SENSITIVITY_DIFFERENCE
from isorig.rig.acquire.sensors import Sheet, compare, memories, read_list
from isorig.rig.cli import main
from isorig.rig.errors import PlanError
from isorig.rig.files.recording import read

TODAY = date(2026, 6, 1)
LIST = """serial_number,model,sensitivity,unit,calibrated,due
1001,352C33,98.0665,mV/g,2026-01-15,2027-01-15
1002,352C33,0.0102,V/(m/s^2),2026-02-01,2027-02-01
30985,4507,95.858,mV/(m/s^2),2022-11-07,2023-11-07
"""
PLAN = """sensors = "sensors.csv"
[instrument]
kind = "lines"
port = "virtual"
sample_rate = 100.0
start = ["go"]
stop = ["halt"]
fields = [{what = "count", wrap = 65536}, {what = "skip"}, {}, {}, {}, {}]
[channels.head]
input = 0
sensitivity = 0.01
serial_number = "1001"
calibrated = "2026-01-15"
[channels.motor]
input = 3
sensitivity = 0.0102
serial_number = "1002"
[[runs]]
id = "a"
configuration = "unlocked"
gain = 1.0
excitation = "other"
seconds = 1.0
"""


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    (tmp_path / "sensors.csv").write_text(LIST)
    (tmp_path / "plan.toml").write_text(PLAN)
    return tmp_path


def plan(lab: Path, *changes: tuple[str, str]) -> Plan:
    text = PLAN
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (lab / "plan.toml").write_text(text)
    return read_plan(lab / "plan.toml")


def test_a_list_is_read_in_the_units_of_plans(lab: Path) -> None:
    found = read_list(lab / "sensors.csv")
    assert found["1001"].sensitivity == pytest.approx(0.01)
    assert found["1002"].sensitivity == pytest.approx(0.0102)
    assert found["1001"].due == date(2027, 1, 15)
    assert compare(plan(lab), found, {}, TODAY) == []


@pytest.mark.parametrize(("change", "says"), [
    (("serial_number = \"1002\"", "serial_number = \"1001\""), "head and motor name the same sensor 1001"),
    (("serial_number = \"1002\"", "serial_number = \"77\""), "names the sensor 77, which is not in"),
    (("0.01\n", "0.0102\n"), "sensitivity of head is 0.0102 in the plan and 0.01 in sensors.csv"),
    (("2026-01-15", "2026-01-16"), "calibrated on 2026-01-16 by the plan, on 2026-01-15 by sensors.csv"),
])  # fmt: skip
def test_a_contradiction_with_the_list_is_reported(change: tuple[str, str], says: str, lab: Path) -> None:
    found = compare(plan(lab, change), read_list(lab / "sensors.csv"), {}, TODAY)
    assert any(says in text for text in found)


def test_the_boundaries_of_dates_and_sensitivities(lab: Path) -> None:
    known = read_list(lab / "sensors.csv")
    assert compare(plan(lab), known, {}, date(2027, 1, 15)) == []
    (text,) = compare(plan(lab), known, {}, date(2027, 1, 16))
    assert text == "the calibration of 1001 (head) expired on 2027-01-15, by sensors.csv; have it calibrated"
    assert any("after today" in text for text in compare(plan(lab), known, {}, date(2026, 1, 14)))
    for factor, count in (
        (1.0 + 0.99 * SENSITIVITY_DIFFERENCE, 0),
        (1.0 + 1.01 * SENSITIVITY_DIFFERENCE, 1),
        (1.0 - 1.01 * SENSITIVITY_DIFFERENCE, 1),
    ):
        changed = plan(lab, ("sensitivity = 0.01\n", f"sensitivity = {0.01 * factor:.9g}\n"))
        assert len(compare(changed, known, {}, TODAY)) == count


def test_swapped_sensors_are_found_by_their_memories(lab: Path) -> None:
    sheets = {"head": Sheet(serial_number="1002", sensitivity=None), "motor": Sheet(serial_number="1001", sensitivity=None)}
    found = compare(plan(lab), {}, sheets, TODAY)
    assert found[0] == "the sensor at input 0 (head) is 1002, not 1001, which the plan has at motor: exchange the cables"
    assert len(found) == 2
    (text,) = compare(plan(lab), {}, {"head": Sheet(serial_number="9", sensitivity=None)}, TODAY)
    assert text.endswith("is 9, not 1001; correct serial_number")


@pytest.mark.parametrize(("text", "says"), [
    ("", "has 0 rows"), ("a,b\n", "lacks the columns serial_number, sensitivity, unit"),
    ("serial_number,sensitivity,unit\n,1,V/N\n", "row 2 has no serial number"),
    ("serial_number,sensitivity,unit\n1,1,V/K\n", "row 2 has the unit 'V/K'"),
    ("serial_number,sensitivity,unit\n1,nan,V/N\n", "has the sensitivity 'nan'"),
    ("serial_number,sensitivity,unit\n1,0,V/N\n", "has the sensitivity '0'"),
    ("serial_number,sensitivity,unit\n1\n", "has the unit ''"),
    ("serial_number,sensitivity,unit,due\n1,1,V/N,1.2.2026\n", "has the date '1.2.2026'"),
    ("serial_number,sensitivity,unit\n1,1,V/N\n1,2,V/N\n", "a second time"),
])  # fmt: skip
def test_a_list_that_cannot_be_is_refused(text: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "sensors.csv").write_text(text)
    with pytest.raises(PlanError, match=says):
        read_list(tmp_path / "sensors.csv")


def test_a_list_that_is_no_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "sensors.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(PlanError, match="is not CSV text"):
        read_list(tmp_path / "sensors.csv")
    with pytest.raises(PlanError, match="cannot be read"):
        read_list(tmp_path / "none.csv")


def test_memories_are_read_through_the_instrument(lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "drivers"))
    from ni_device import Device, chassis
    from test_teds import PUBLISHED, reversed_bits

    from isorig.rig.acquire.instruments import opened

    text = PLAN[PLAN.index("[channels.head]") :]
    inputs = '["cDAQ1Mod1/ai0", "cDAQ1Mod1/ai1", "cDAQ1Mod1/ai2", "cDAQ1Mod1/ai3"]'
    head = f'[instrument]\nkind = "nidaqmx"\nport = "cDAQ1"\nsample_rate = 100.0\ninputs = {inputs}\n'
    (lab / "plan.toml").write_text(head + text)
    planned = read_plan(lab / "plan.toml")
    with chassis(Device(memories={"cDAQ1Mod1/ai3": reversed_bits(PUBLISHED)})), opened(planned, "cDAQ1") as instrument:
        found_there = memories(planned, instrument)
    assert found_there["motor"].serial_number == "30985"
    found = compare(planned, {}, found_there, TODAY)
    assert any("input 3 (motor) is 30985, not 1002" in text for text in found)
    assert any("expired on 2023-11-07, by its memory" in text for text in found)


def test_a_force_sensor_is_compared_by_what_the_instrument_reads(lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "drivers"))
    from ni_device import Device, chassis
    from test_teds import FORCE

    from isorig.rig.acquire.instruments import opened

    def told(changed: str, new: str) -> list[str]:
        text = """[instrument]
kind = "nidaqmx"
port = "cDAQ1"
sample_rate = 100.0
inputs = ["cDAQ1Mod1/ai0"]
[channels.force]
input = 0
sensitivity = 0.002248
quantity = "force"
unit = "N"
"""
        (lab / "plan.toml").write_text(text.replace(changed, new))
        planned = read_plan(lab / "plan.toml", runs=False)
        # 2.248 mV/N.
        device = Device(memories={"cDAQ1Mod1/ai0": FORCE}, forces={"cDAQ1Mod1/ai0": (2.248, 15891)})
        with chassis(device), opened(planned, "cDAQ1") as instrument:
            return compare(planned, {}, memories(planned, instrument), TODAY)

    assert told("", "") == []
    assert told("0.002248", "0.00230") == [
        "the sensitivity of force is 0.0023 in the plan and 0.002248 in its memory; correct the one that is wrong"
    ]
    assert told('quantity = "force"\nunit = "N"\n', "") == [
        "force is acceleration in the plan, and its sensor measures force by its memory; correct one"
    ]


def test_the_command_and_the_session(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan(lab, ("2026-01-15", "2026-01-16"))
    assert main(["sensors", str(lab / "plan.toml")]) == 2
    said = capsys.readouterr()
    assert "head: input 0, 1001, 0.01 V per m/s^2, calibrated 2026-01-15" in said.out
    assert "calibrated on 2026-01-16 by the plan" in said.err
    call = ["acquire", str(lab / "plan.toml"), "--yes", "--json", "-o", str(lab / "c.h5")]
    assert main(call) == 2
    assert "the session was not started: head was calibrated" in capsys.readouterr().err
    assert not (lab / "c.h5").exists()
    assert main([*call, "--force"]) == 0
    about = read(lab / "c.h5").runs[0].channels["head"].about
    assert (about["serial_number"], about["calibrated"]) == ("1001", "2026-01-16")
    plan(lab, ('sensors = "sensors.csv"\n', ""))
    assert main(["sensors", str(lab / "plan.toml")]) == 2
    with pytest.raises(PlanError, match="write the date as 2026-01-31"):
        plan(lab, ("2026-01-15", "15.1.2026"))
