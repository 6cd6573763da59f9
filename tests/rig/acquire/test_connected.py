"""What is connected: each bus with the library's own types, and the plan that is proposed for each kind."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import numpy as np
import pytest
from serial.tools import list_ports, list_ports_common

from isorig.drivers import connected
from isorig.drivers.kinds import Connected, kinds
from isorig.rig.acquire.plan_check import read_plan
from isorig.rig.acquire.plan_draft import draft_plan
from isorig.rig.cli import main
from isorig.rig.files.recording import read

FAR_ENDS = Path(__file__).resolve().parents[2] / "drivers"


@pytest.fixture
def far_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """The far ends of drivers' tests."""
    monkeypatch.syspath_prepend(str(FAR_ENDS))


@pytest.fixture
def nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is connected."""
    for search in ("serial_ports", "visa_resources", "can_interfaces", "ni_devices", "sound_devices"):
        monkeypatch.setattr(connected, search, list)


def serial_port(device: str, **about: object) -> list_ports_common.ListPortInfo:
    port = list_ports_common.ListPortInfo(device)
    for name, value in about.items():
        setattr(port, name, value)
    return port


def test_serial_ports_have_their_usb_names(monkeypatch: pytest.MonkeyPatch) -> None:
    ports = [
        serial_port("/dev/ttyUSB0", description="FT232R USB UART", manufacturer="FTDI", vid=0x0403, pid=0x6001),
        serial_port("/dev/ttyACM0", description="DI-1100", manufacturer="DATAQ", vid=0x0683, pid=0x1101, serial_number="5C76"),
    ]
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
    first, second = connected.serial_ports()
    assert (first.port, first.name) == ("/dev/ttyACM0", "DATAQ DI-1100 USB 0683:1101 serial number 5C76")
    assert first.recognized == ("di1100",)
    assert second.recognized == ()
    assert {"framed", "lines", "sr785", "di1100", "mti600"} <= set(second.possible)
    assert "nidaqmx" not in second.possible


def test_visa_resources_are_listed_and_asked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "devices.yaml").write_text(
        """
spec: "1.1"
devices:
  analyzer:
    eom:
      GPIB INSTR: {q: "\\n", r: "\\n"}
    error: ERROR
    dialogues:
      - q: "*IDN?"
        r: "HEWLETT-PACKARD,35670A,3340A00152,A.00.02"
resources:
  GPIB0::11::INSTR: {device: analyzer}
  GPIB0::12::INSTR: {device: analyzer}
"""
    )
    monkeypatch.setenv("PYVISA_LIBRARY", f"{tmp_path}/devices.yaml@sim")
    found = connected.visa_resources()
    assert [one.port for one in found] == ["GPIB0::11::INSTR", "GPIB0::12::INSTR"]
    assert found[0].recognized == ()
    assert connected.with_identity(found[0]).recognized == ("35670a",)


def test_can_interfaces_without_hardware_are_not_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    def detected(interfaces: list[str]) -> list[dict[str, str]]:
        # A search for servers of socketcand listens on the network for seconds.
        assert {"virtual", "udp_multicast", "slcan", "serial", "socketcand"}.isdisjoint(interfaces)
        return [{"interface": name, "channel": "can0"} for name in interfaces if name == "socketcan"]

    monkeypatch.setattr(can, "detect_available_configs", detected)
    (one,) = connected.can_interfaces()
    assert (one.port, one.possible, dict(one.settings)) == ("can0", ("mti600",), {"bus": "socketcan"})
    assert 'bus = "socketcan"' in draft_plan(one, "mti600")


def test_the_modules_of_an_ni_chassis_belong_to_it(far_ends: None, tmp_path: Path) -> None:
    from ni_device import chassis

    with chassis():
        (one,) = connected.ni_devices()
    assert (one.port, one.name, one.possible) == ("cDAQ1", "NI cDAQ-9178", ("nidaqmx",))
    text = draft_plan(one, "nidaqmx")
    (tmp_path / "plan.toml").write_text(text)
    plan = read_plan(tmp_path / "plan.toml")
    assert len(plan.instrument.settings.inputs) == 8
    assert plan.instrument.settings.output == "cDAQ1Mod3/ao0"
    without = Connected(bus="ni", port="Dev1", name="", settings={"inputs": ["Dev1/ai0", "Dev1/ai1"]})
    (tmp_path / "plan.toml").write_text(draft_plan(without, "nidaqmx"))
    plan = read_plan(tmp_path / "plan.toml")
    assert plan.instrument.settings.output == ""
    assert plan.runs[0].excitation == "other"
    assert {channel.input for channel in plan.channels.values()} == {0, 1}


def test_sound_interfaces_are_listed(far_ends: None) -> None:
    import sound_device

    with sound_device.card(sound_device.Device()):
        (one,) = connected.sound_devices()
    assert (one.port, one.name, one.possible) == ("card", "here, 2 inputs, 2 outputs", ("sound",))


@pytest.mark.parametrize("kind", sorted(kinds()))
def test_the_proposed_plan_of_every_kind_is_valid(kind: str, tmp_path: Path) -> None:
    output = tmp_path / "plan.toml"
    assert main(["instruments", "--draft", "--kind", kind, "--port", "virtual", "-o", str(output)]) == 0
    plan = read_plan(output)
    assert (plan.instrument.kind, plan.instrument.port) == (kind, "virtual")
    assert len(plan.runs) == 1


@contextmanager
def connected_kind(kind: str) -> Iterator[str]:
    """A simulated instrument of a kind that `rig instruments` finds under this port, or the port of a virtual one."""
    if kind == "nidaqmx":
        from ni_device import Device, chassis

        with chassis(Device(speed=1.0)):
            yield "cDAQ1"
    elif kind == "sound":
        from sound_device import Device as Interface
        from sound_device import card

        with card(Interface(rate=48000.0)):
            yield "card"
    else:
        yield "virtual"


@pytest.mark.parametrize("kind", sorted(kinds()))
def test_from_an_empty_folder_to_a_checked_recording(far_ends: None, kind: str, tmp_path: Path) -> None:
    plan, output = tmp_path / "plan.toml", str(tmp_path / "c.h5")
    with connected_kind(kind) as port:
        assert main(["instruments", "--draft", "--kind", kind, "--port", port, "-o", str(plan)]) == 0
        text = plan.read_text(encoding="utf-8")
        plan.write_text(text.replace("seconds = 10.0", "seconds = 2.0"), encoding="utf-8")
        # Some inputs count samples, which looks like a disconnected sensor, and a busy host delays a simulated instrument.
        assert main(["acquire", str(plan), "--yes", "--force", "--json", "-o", output]) == 0
        assert main(["check", output]) == 0
    (run,) = read(output).runs
    assert len(run) + sum(gap.count for gap in run.gaps) >= 2.0 * run.sample_rate
    assert run.channels
    assert any(np.asarray(channel.samples).any() for channel in run.channels.values())


@pytest.mark.parametrize(("kind", "port"), [("nidaqmx", "cDAQ1"), ("sound", "card")])
def test_a_draft_for_what_was_found_lists_its_inputs_and_output(far_ends: None, kind: str, port: str, tmp_path: Path) -> None:
    plan = tmp_path / "plan.toml"
    with connected_kind(kind):
        assert main(["instruments", "--draft", "--port", port, "-o", str(plan)]) == 0
    assert read_plan(plan).instrument.port == port
    assert read_plan(plan).runs[0].excitation == "random"


def test_the_recognized_instrument_is_planned(
    nothing: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = Connected(bus="serial", port="/dev/ttyACM0", name="DATAQ DI-1100")
    other = Connected(bus="serial", port="/dev/ttyACM1", name="DATAQ DI-1100")
    plan = tmp_path / "plan.toml"
    monkeypatch.setattr(connected, "serial_ports", lambda: [one])
    assert main(["instruments", "--draft", "-o", str(plan)]) == 0
    assert read_plan(plan).instrument.port == "/dev/ttyACM0"
    assert main(["instruments", "--draft", "-o", str(plan)]) == 2
    assert "already exists" in capsys.readouterr().err
    monkeypatch.setattr(connected, "serial_ports", lambda: [one, other])
    assert main(["instruments", "--draft", "-o", str(tmp_path / "b.toml")]) == 2
    assert "di1100 at /dev/ttyACM0, di1100 at /dev/ttyACM1); give --port and --kind" in capsys.readouterr().err
    assert main(["instruments", "--draft", "--port", "/dev/ttyACM1", "-o", str(tmp_path / "b.toml")]) == 0
    assert main(["instruments", "--draft", "--kind", "tape", "--port", "x", "-o", str(tmp_path / "c.toml")]) == 2
    assert main(["instruments", "--draft"]) == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b.toml", "plan.toml"]


def test_the_list_names_kinds_and_what_could_not_be_searched(
    nothing: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["instruments"]) == 0
    assert "nothing is connected" in capsys.readouterr().out
    monkeypatch.setattr(connected, "serial_ports", lambda: [Connected(bus="serial", port="/dev/ttyACM0", name="DATAQ")])
    monkeypatch.undo()
    monkeypatch.setattr(list_ports, "comports", lambda: [serial_port("/dev/ttyACM0", manufacturer="DATAQ")])
    monkeypatch.setattr(can, "detect_available_configs", lambda interfaces: [])
    for package in ("pyvisa", "nidaqmx", "sounddevice"):
        monkeypatch.setitem(sys.modules, package, None)
    assert main(["instruments"]) == 0
    said = capsys.readouterr().out
    assert "serial  /dev/ttyACM0  DATAQ\n        kind: di1100" in said
    assert said.count("not searched: ") == 3
    assert main(["instruments", "--json"]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert json.loads(line)["recognized"] == ["di1100"]


def test_the_searches_run_side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    # Each search ends when all have begun.
    begun = threading.Barrier(5)

    def search() -> list[Connected]:
        begun.wait(timeout=30.0)
        return []

    for name in ("serial_ports", "visa_resources", "can_interfaces", "ni_devices", "sound_devices"):
        monkeypatch.setattr(connected, name, search)
    assert connected.connected() == ([], [])


@pytest.mark.parametrize("call", ["main(['--help'])", "main(['acquire', '--help'])", "kinds()"])
def test_libraries_of_instruments_are_imported_only_when_they_are_used(call: str) -> None:
    heavy = "{'pyvisa', 'nidaqmx', 'sounddevice', 'scipy.signal', 'numba'}"
    imports = "import sys\nfrom isorig.rig.cli import main\nfrom isorig.drivers.kinds import kinds"
    code = f"{imports}\n{call}\nsys.exit(str({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert done.stderr.strip() == "set()"
