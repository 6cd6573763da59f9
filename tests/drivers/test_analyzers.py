"""The analyzers' dialogues byte by byte, over a pseudo-terminal and over TCP."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from campaign import SHORT
from contract import Case, Served, Situation
from far import LinesFar

from isorig.drivers.block import Status
from isorig.drivers.errors import ConnectionLostError, InstrumentError, ProtocolError
from isorig.drivers.hp35670a import Hp35670aInstrument
from isorig.drivers.link import linked
from isorig.drivers.simulated.analyzers import Simulated35670a, SimulatedSr785
from isorig.drivers.simulated.commanded import Faults, Simulation
from isorig.drivers.simulated.served import TcpWire, served
from isorig.drivers.sr785 import Sr785Instrument

SPECTRUM = (np.linspace(0.0, 800.0, 801), 1.0 / (1.0 + np.arange(801.0)))
RECORD = (np.arange(1024) / 1024.0, np.sin(np.arange(1024.0)))
SHOWS = ("0", "1")
FEEDS = ("XTIM:VOLT 1", "XFR:POW:COH 1,2")


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("wire", ["pty", "tcp"])
def test_sr785_dialogue(order: str, wire: str) -> None:
    peer = SimulatedSr785({0: SPECTRUM, 1: RECORD}, Simulation(), order=order)
    with served(peer, TcpWire() if wire == "tcp" else None) as port:
        instrument = Sr785Instrument(port, SHOWS, waits=SHORT)
        instrument.measure(5.0)
        spectrum, record = instrument.records()
        instrument.close()
    assert peer.heard == [
        "OUTX1", "*ESR?", "STRT", "DSPS?1", "DSPS?1", "NAVG?0", "NAVG?0", "INPS?", "*ESR?",
        "DSPN?0", "DSPN?0", "DBIN?0,0", "DBIN?0,400", "DBIN?0,800", "DSPB?0", "DSPB?0", "DSPY?0,400",
        "DSPN?1", "DSPN?1", "DBIN?1,0", "DBIN?1,512", "DBIN?1,1023", "DSPB?1", "DSPB?1", "DSPY?1,512",
    ]  # fmt: skip
    np.testing.assert_allclose(spectrum.x, SPECTRUM[0], rtol=1e-9)
    np.testing.assert_array_equal(spectrum.values, SPECTRUM[1].astype(np.float32))
    np.testing.assert_array_equal(record.values, RECORD[1].astype(np.float32))
    assert (spectrum.averages, spectrum.status) == (10, Status.GOOD)


def test_sr785_reports_an_overload_and_an_unknown_command() -> None:
    with served(SimulatedSr785({0: SPECTRUM}, Simulation(faults=Faults(overload=1.0)))) as port:
        instrument = Sr785Instrument(port, SHOWS[:1], waits=SHORT)
        instrument.measure(5.0)
        assert instrument.records()[0].status == Status.OVERLOAD
        instrument._send("SRAT 1024")
        with pytest.raises(InstrumentError, match="a command is unknown"):
            instrument.measure(5.0)
        instrument.close()


def test_hp35670a_dialogue() -> None:
    peer = Simulated35670a({"XTIM:VOLT 1": RECORD, "XFR:POW:COH 1,2": SPECTRUM}, Simulation())
    with served(peer) as port:
        instrument = Hp35670aInstrument(port, FEEDS, waits=SHORT)
        instrument.measure(5.0)
        record, coherence = instrument.records()
        instrument.close()
    assert peer.heard == [
        "*ESE 1;*SRE 32", "FORM:DATA REAL,32", "CALC1:FEED 'XTIM:VOLT 1'", "CALC2:FEED 'XFR:POW:COH 1,2'", "SYST:ERR?",
        "*CLS", "ABOR;INIT:IMM;*OPC", "*STB?", "*STB?", "SYST:ERR?",
        "CALC1:X:DATA?", "CALC1:X:DATA?", "CALC1:DATA?", "CALC1:DATA?",
        "CALC2:X:DATA?", "CALC2:X:DATA?", "CALC2:DATA?", "CALC2:DATA?",
    ]  # fmt: skip
    np.testing.assert_array_equal(record.values, RECORD[1].astype(np.float32))
    np.testing.assert_array_equal(coherence.values, SPECTRUM[1].astype(np.float32))


def test_hp35670a_block_bytes_and_bad_values() -> None:
    holes = RECORD[1].copy()
    holes[5] = -9.9e37
    assert Simulated35670a._block(np.array([1.0])).hex() == "2331" + "34" + "3f800000" + "0a"
    with served(Simulated35670a({"XTIM:VOLT 1": (RECORD[0], holes)}, Simulation())) as port:
        instrument = Hp35670aInstrument(port, FEEDS[:1], waits=SHORT)
        instrument.measure(5.0)
        record = instrument.records()[0]
        instrument.close()
    assert len(record.values) == 1023
    assert record.status == Status.LOST


def test_hp35670a_refuses_a_feed_it_does_not_have() -> None:
    with served(Simulated35670a({}, Simulation())) as port, pytest.raises(InstrumentError, match="Undefined header"):
        Hp35670aInstrument(port, FEEDS, waits=SHORT)


class Silent:
    unplugged = False

    def step(self, data: bytes) -> bytes:
        return b""


class Chatty:
    unplugged = False

    def step(self, data: bytes) -> bytes:
        return b"nonsense" if data else b""


def test_what_does_not_answer_or_answers_nonsense_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    with served(Silent()) as port, pytest.raises(ConnectionLostError, match="did not send a line"):
        Sr785Instrument(port, SHOWS, waits=SHORT)
    with served(Chatty()) as port:
        instrument = Hp35670aInstrument.__new__(Hp35670aInstrument)
        instrument._link = linked(port, baud_rate=9600, waits=SHORT)
        with pytest.raises(ProtocolError, match="a block begins with #"):
            instrument._block("CALC1:DATA?")
        instrument._link.close()


@contextmanager
def serve_sr785(situation: Situation) -> Iterator[Served]:
    answers = {
        "*ESR?": b"0\n", "INPS?": b"1\n" if situation.overload_at is not None else b"0\n", "DSPS?": b"1\n", "NAVG?": b"10\n",
        "STYP?": b"2\n", "NAMP?": b"500,mVpk\n", "SRCO?": b"1\n",
    }  # fmt: skip
    far = LinesFar({} if situation.silent else answers)
    with far:
        yield Served(far.port, lambda: _last(far, "SRCO ") == "SRCO 1", far.unplug)


@contextmanager
def serve_hp35670a(situation: Situation) -> Iterator[Served]:
    answers = {"*STB?": b"+32\n", "SYST:ERR?": b'+0,"No Error"\n', "SOUR:VOLT?": b"0.5\n", "OUTP?": b"1\n"}
    far = LinesFar({} if situation.silent else answers)
    with far:
        yield Served(far.port, lambda: _last(far, "OUTP O") == "OUTP ON", far.unplug)


def _last(far: LinesFar, begin: str) -> str:
    return next((line for line in reversed(far.lines) if line.startswith(begin)), "")


CASES = (
    Case(kind="sr785", serve=serve_sr785, rate=256.0),
    Case(kind="35670a", serve=serve_hp35670a, rate=256.0, reports=False),
)
