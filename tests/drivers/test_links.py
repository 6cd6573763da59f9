"""Analyzers at a line, at VISA resources (pyvisa-py, pyvisa-sim) and at Prologix adapters: one interface, the same results."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
import pytest
from campaign import SHORT
from far import Far, LinesFar, PrologixFar, TcpLines, TcpPrologix, within

from isorig.drivers import visa
from isorig.drivers.block import InstrumentRecord
from isorig.drivers.errors import ConnectionLostError, DriverError, InstrumentError, ProtocolError, SettingError
from isorig.drivers.hp35670a import Hp35670aInstrument
from isorig.drivers.link import PrologixLink, linked
from isorig.drivers.port import Port
from isorig.drivers.sr785 import Sr785Instrument

Answers = dict[str, bytes | Callable[[str], bytes]]
VALUES, PLACES = np.float32([1, 2, 3, 4]), np.float32([0, 1, 2, 3])


def sr785_answers() -> Answers:
    return {
        "*ESR?": b"0\n", "INPS?": b"0\n", "DSPS?": b"1\n", "NAVG?": b"10\n", "DSPN?": b"4\n",
        "DBIN?": lambda c: c[-1:].encode() + b"\n", "DSPB?": VALUES.astype("<f4").tobytes(), "DSPY?": b"3\n",
    }  # fmt: skip


def hp_answers() -> Answers:
    blocks = {name: b"#216" + values.astype(">f4").tobytes() + b"\n" for name, values in (("X:", PLACES), ("", VALUES))}
    return {
        "*STB?": b"+32\n", "SYST:ERR?": b'+0,"No Error"\n', "CALC1:X:DATA?": blocks["X:"], "CALC1:DATA?": blocks[""],
    }  # fmt: skip


KINDS: dict[type, tuple[Callable[[], Answers], str]] = {
    Sr785Instrument: (sr785_answers, "0"), Hp35670aInstrument: (hp_answers, "XTIM:VOLT 1"),
}  # fmt: skip


@pytest.fixture(autouse=True)
def packaged_backend(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PYVISA_LIBRARY", raising=False)


class SimulatedDevice:
    """A device for pyvisa-sim whose answers come from a table; the library gives them with END, byte by byte."""

    delimiter = ";"

    def __init__(self, answers: Answers) -> None:
        self.answers, self._out = answers, deque[bytearray]()
        self.lines: list[str] = []

    def write(self, data: bytes) -> None:
        command = data.decode().strip()
        self.lines.append(command)
        fitting = [key for key in self.answers if command.startswith(key)]
        if fitting:
            answer = self.answers[max(fitting, key=len)]
            found = answer(command) if callable(answer) else answer
            if found:
                self._out.append(bytearray(found))

    def read(self) -> tuple[bytes, bool]:
        if not self._out:
            return b"", False
        first = bytes([self._out[0].pop(0)])
        if self._out[0]:
            return first, False
        self._out.popleft()
        return first, True


@contextmanager
def simulated(answers: Answers, monkeypatch: pytest.MonkeyPatch, folder: Path, resource: str) -> Iterator[SimulatedDevice]:
    """A resource of pyvisa-sim."""
    definitions = folder / "devices.yaml"
    definitions.write_text('spec: "1.1"\ndevices: {}\nresources: {}\n')
    monkeypatch.setenv("PYVISA_LIBRARY", f"{definitions}@sim")
    device = SimulatedDevice(answers)
    manager = visa.manager()
    manager.visalib.devices._internal[resource] = device  # type: ignore[attr-defined]
    try:
        yield device
    finally:
        manager.close()


WIRES = ("line", "serial resource", "socket resource", "simulated GPIB", "simulated VXI-11", "adapter", "adapter over TCP")


@contextmanager
def wired(wire: str, answers: Answers, monkeypatch: pytest.MonkeyPatch, folder: Path) -> Iterator[tuple[str, LinesFar]]:
    """The name of a port with these answers, and its far end."""
    if wire.startswith("simulated"):
        resource = "GPIB0::11::INSTR" if wire == "simulated GPIB" else "TCPIP0::10.0.0.5::inst0::INSTR"
        with simulated(answers, monkeypatch, folder, resource) as device:
            yield resource, device  # type: ignore[misc]
        return
    kinds = {"adapter": PrologixFar, "adapter over TCP": TcpPrologix, "socket resource": TcpLines}
    with kinds.get(wire, LinesFar)(answers) as far:
        if isinstance(far, PrologixFar):
            far.status = lambda: 32
        name = {
            "line": far.port, "serial resource": f"ASRL{far.port}::INSTR", "socket resource": getattr(far, "resource", ""),
            "adapter": f"GPIB::11@{far.port}", "adapter over TCP": f"GPIB0::11::INSTR@{far.port}",
        }[wire]  # fmt: skip
        yield name, far


def measured(kind: type, name: str) -> InstrumentRecord:
    """A measurement with one display."""
    with closing(kind(name, [KINDS[kind][1]], SHORT)) as instrument:
        instrument.measure(0.5)
        (record,) = instrument.records()
        return record  # type: ignore[no-any-return]


@pytest.mark.parametrize("wire", WIRES)
@pytest.mark.parametrize("kind", KINDS)
def test_both_analyzers_measure_over_every_wire(kind: type, wire: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with wired(wire, KINDS[kind][0](), monkeypatch, tmp_path) as (name, far):
        record = measured(kind, name)
    np.testing.assert_array_equal(record.values, VALUES)
    np.testing.assert_array_equal(record.x, PLACES)
    if kind is Sr785Instrument:
        # Answers go where they are read.
        lines = wire in ("line", "serial resource", "socket resource")
        assert [line for line in far.lines if line.startswith("OUTX")] == ["OUTX1" if lines else "OUTX0"]


BAD = (b"", b"nan\n", b"1" * 3000, b"\xff\xfe\n", b"#9999999999")


@pytest.mark.parametrize("wire", ["serial resource", "socket resource", "simulated GPIB", "adapter"])
@pytest.mark.parametrize("told", BAD)
def test_a_bad_answer_over_any_wire_is_refused_in_a_sentence(
    told: bytes, wire: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for kind, word in ((Sr785Instrument, "NAVG?"), (Sr785Instrument, "DSPB?"), (Hp35670aInstrument, "CALC1:DATA?")):
        with (
            wired(wire, KINDS[kind][0]() | {word: told}, monkeypatch, tmp_path) as (name, _),
            within(6.0),
            pytest.raises(DriverError) as refusal,
        ):
            measured(kind, name)
        assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("wire", ["serial resource", "socket resource", "simulated GPIB", "adapter"])
def test_a_block_of_another_length_is_refused(wire: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    whole = hp_answers()["CALC1:DATA?"]
    assert isinstance(whole, bytes)
    doubled = () if wire == "simulated GPIB" else (whole + whole,)  # a simulated resource has no status byte that shows it
    for told in (whole[:-5], whole[:5] + whole[6:], *doubled):
        with (
            wired(wire, hp_answers() | {"CALC1:DATA?": told}, monkeypatch, tmp_path) as (name, _),
            pytest.raises(DriverError),
        ):
            measured(Hp35670aInstrument, name)


@pytest.mark.parametrize("wire", ["serial resource", "socket resource", "adapter"])
def test_an_answer_that_nobody_requested_is_noticed(wire: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with (
        wired(wire, {"ONE": b"1\n2\n"}, monkeypatch, tmp_path) as (name, far),
        closing(linked(name, baud_rate=9600, waits=SHORT)) as link,
    ):
        link.send("ONE")
        assert link.line() == b"1"
        if isinstance(far, PrologixFar):
            far._answer = b"3\n"
        with pytest.raises(ProtocolError, match=r"(more than was|that was not) requested"):
            link.expect_nothing()


def test_the_adapter_is_set_up_as_controller_and_escapes_what_it_would_take_for_its_own() -> None:
    with PrologixFar({"A+B": b"yes\n"}) as far, closing(linked(f"GPIB::11@{far.port}", baud_rate=9600, waits=SHORT)) as link:
        link.clear()
        link.send("A+B\x1b")
        assert link.line() == b"yes"
        assert far.lines == ["A+B\x1b"]
        assert far.settings | {"mode": "1", "auto": "0", "eoi": "1", "eos": "2", "addr": "11", "savecfg": "0"} == far.settings
        assert "++clr" in far.commands


def test_the_analyzer_waits_for_the_service_request_of_the_adapter() -> None:
    with PrologixFar(hp_answers()) as far:
        far.status = lambda: 32 * (far.commands.count("++srq") > 2)
        record = measured(Hp35670aInstrument, f"GPIB::11@{far.port}")
        assert "*STB?" not in far.lines
        assert far.lines[:2] == ["*ESE 1;*SRE 32", "FORM:DATA REAL,32"]
        assert far.commands.count("++srq") == 3
    np.testing.assert_array_equal(record.values, VALUES)


def test_a_measurement_does_not_end_with_the_event_of_the_one_before() -> None:
    done, stuck = [False], list[bool]()

    def obey(command: str) -> bytes:
        # The event stays set until it is cleared.
        done[0] = command != "*CLS" and (done[0] or not stuck)
        return b""

    with (
        PrologixFar(hp_answers() | {"*CLS": obey, "ABOR": obey}, status=lambda: 32 * done[0]) as far,
        closing(Hp35670aInstrument(f"GPIB::11@{far.port}", ["XTIM:VOLT 1"], waits=SHORT)) as analyzer,
    ):
        analyzer.measure(0.5)
        stuck.append(True)
        with pytest.raises(InstrumentError, match=r"did not finish within 0\.1 s"):
            analyzer.measure(0.1)


@pytest.mark.parametrize("adapter", [
    {"++ver": b""}, {"++ver": b"\xff\x00\n"}, {"++ver": b"x" * 400}, {"++spoll": b"300\n"}, {"++spoll": b"none\n"},
    {"++spoll": b""},
])  # fmt: skip
def test_what_is_no_adapter_is_refused_in_a_sentence(adapter: dict[str, bytes]) -> None:
    with PrologixFar(hp_answers(), adapter=adapter) as far, within(4.0), pytest.raises(DriverError) as refusal:
        measured(Hp35670aInstrument, f"GPIB::11@{far.port}")
    assert "\n" not in str(refusal.value)


def test_an_address_that_is_none_is_refused() -> None:
    with pytest.raises(SettingError, match="has the GPIB address 31; give 0 to 30"):
        linked("GPIB::31@/dev/none", baud_rate=9600, waits=SHORT)
    with pytest.raises(ConnectionLostError, match="cannot be opened"):
        linked("GPIB::11@/dev/none", baud_rate=9600, waits=SHORT)


@pytest.mark.parametrize("name", [
    "TCPIP0::127.0.0.1::1::SOCKET", "ASRL/dev/none::INSTR", "GPIB0::11::INSTR", "USB0::1::2::3::INSTR", "TCPIP::::INSTR",
    "VXI0::1::INSTR",
])  # fmt: skip
def test_a_resource_that_is_not_there_is_refused_in_a_sentence(name: str) -> None:
    with within(8.0), pytest.raises(DriverError) as refusal:
        measured(Hp35670aInstrument, name)
    assert name in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_missing_package_and_a_missing_backend_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYVISA_LIBRARY", "/nowhere/libvisa.so@ivi")
    with pytest.raises(SettingError, match="correct PYVISA_LIBRARY"):
        linked("GPIB0::11::INSTR", baud_rate=9600, waits=SHORT)
    monkeypatch.setitem(sys.modules, "pyvisa", None)
    with pytest.raises(SettingError, match=r"install it with pip install 'isorig\[visa\]'"):
        linked("GPIB0::11::INSTR", baud_rate=9600, waits=SHORT)


def test_a_line_needs_no_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyvisa", None)
    with LinesFar(sr785_answers()) as far, closing(linked(far.port, baud_rate=9600, waits=SHORT)) as link:
        assert isinstance(link, Port)
        assert link.status_byte() is None
    with PrologixFar({}) as adapter, closing(linked(f"GPIB::11@{adapter.port}", baud_rate=9600, waits=SHORT)) as link:
        assert isinstance(link, PrologixLink)
        assert link.status_byte() == 0


class Events:
    """A resource whose backend reports service requests, as NI-VISA does."""

    def __init__(self) -> None:
        self.waited: list[int] = []

    def enable_event(self, kind: object, mechanism: object) -> None: ...

    def wait_on_event(self, kind: object, milliseconds: int, *, capture_timeout: bool) -> None:
        self.waited.append(milliseconds)


def test_a_service_request_is_awaited_where_the_backend_reports_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with (
        simulated({}, monkeypatch, tmp_path, "GPIB0::11::INSTR"),
        closing(linked("GPIB0::11::INSTR", baud_rate=9600, waits=SHORT)) as link,
    ):
        link.wait(0.01)
        events = Events()
        link._resource, link._events = events, True  # type: ignore[attr-defined]
        link.wait(0.25)
        assert events.waited == [250]
        link._resource = None  # type: ignore[attr-defined]


def test_a_resource_that_goes_is_reported() -> None:
    class Going(TcpLines):
        def hear(self, data: bytes) -> None:
            self.over.set()

    with Going({}) as far, closing(linked(far.resource, baud_rate=9600, waits=SHORT)) as link, within(4.0):
        link.send("*IDN?")
        far.unplug()
        with pytest.raises(ConnectionLostError):
            link.line()
    assert issubclass(Going, Far)
