"""Instrument, session and reader as processes of their own, as at the rig."""

from __future__ import annotations

import io
import json
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from isorig.drivers.simulated.commanded import Simulation
from isorig.drivers.simulated.served import served
from isorig.drivers.simulated.streams import SimulatedDataq
from isorig.rig.cli import main
from isorig.rig.files.recording import read
from isorig.rig.virtual.demo import virtual_instrument

RIG = (sys.executable, "-m", "isorig")
FRAMED = """
rig = {head_mass = 6.5}
[instrument]
kind = "framed"
port = "by hand"
sample_rate = 1024.0
[channels]
head = {input = 0, sensitivity = 0.2, sensor = "352C33", place = "motor head", direction = "+y"}
motor = {input = 1, sensitivity = 0.2}
[[runs]]
id = "a"
configuration = "unlocked"
gain = 70.0
excitation = "random"
band = [0.5, 20.0]
seconds = 16.0
"""
ON_CAN = """
[instrument]
kind = "mti600"
port = "by hand"
sample_rate = 400.0
[channels]
motor = {input = 1, sensitivity = 1.0}
[[runs]]
id = "a"
configuration = "unlocked"
gain = 70.0
excitation = "other"
seconds = 2.0
"""


def session(folder: Path, plan: str, port: str, *options: str) -> subprocess.Popen[str]:
    """`rig acquire`, begun."""
    (folder / "plan.toml").write_text(plan)
    call = [*RIG, "acquire", str(folder / "plan.toml"), "--port", port, "-o", str(folder / "c.h5"), *options]
    return subprocess.Popen(call, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def appears(path: Path) -> None:
    end = time.monotonic() + 30.0
    while not path.exists():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_a_simulated_instrument_leaves_no_port_behind() -> None:
    with virtual_instrument(0) as port:
        assert Path(port).is_symlink()
    assert not Path(port).parent.exists()


def test_a_recording_is_followed_over_tcp_and_stopped_and_resumed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "c.h5"
    with virtual_instrument(0, "--tcp", "--speed", "4") as port:
        number = int(port.removeprefix("socket://127.0.0.1:"))
        if sys.platform == "linux":
            # All of 127/8 is this machine; what listens on every address would answer here.
            with pytest.raises(ConnectionRefusedError):
                socket.create_connection(("127.0.0.2", number), timeout=5.0)
        stopped = session(tmp_path, FRAMED, port, "--yes", "--json")
        assert stopped.stdout is not None
        assert json.loads(stopped.stdout.readline())["event"] == "live"
        stopped.send_signal(signal.SIGINT)
        _, said = stopped.communicate(timeout=120.0)
        assert stopped.returncode == 130
        assert f"the measured data are in {output}" in said
        assert said.endswith("rig: stopped by the operator\n")
        assert "Traceback" not in said
        assert 0 < len(read(output).runs[0]) < 16 * 1024

        resumed = session(tmp_path, FRAMED, port, "--yes", "--resume", "--json")
        appears(output.with_name("c.h5.partial"))
        assert main(["frf", str(output), "--follow", "-o", str(tmp_path / "frf"), "--resolution", "1"]) == 0
        lines, _ = resumed.communicate(timeout=120.0)
    looks = [line for line in capsys.readouterr().out.splitlines() if line.startswith("c.h5, ")]
    assert len(looks) >= 2
    assert all("so far" in look for look in looks[:-1])
    assert "c.h5, 16 s in all" in looks[-1]
    assert (tmp_path / "frf" / "frf.json").exists()
    assert json.loads(lines.splitlines()[-1])["tally"] == {"stored": 16 * 1024, "lost": 0, "overloads": 0}


def test_can_over_a_serial_line_between_processes_asked_and_answered_in_json(tmp_path: Path) -> None:
    with virtual_instrument(0, "--kind", "mti600", "--drop", "0.01", "--first-tick", "65400") as port:
        assert Path(port).resolve().parent == Path("/dev/pts")
        taken = session(tmp_path, ON_CAN, port, "--json")
        assert taken.stdout is not None
        assert json.loads(taken.stdout.readline()) == {"event": "ask", "configuration": "unlocked"}
        told, said = taken.communicate("\n", timeout=120.0)
        assert taken.returncode == 0, said
    lines = [json.loads(line) for line in told.splitlines()]
    assert {line["event"] for line in lines} == {"live", "taken"}
    run = read(tmp_path / "c.h5").runs[0]
    lost = sum(gap.count for gap in run.gaps)
    assert len(run) + lost >= 800
    assert lines[-1]["tally"] == {"stored": len(run), "lost": lost, "overloads": 0}
    assert 0.3 < run.read("motor").std() < 5.0


def test_without_an_answer_no_run_is_started(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "plan.toml").write_text(ON_CAN.replace('"mti600"', '"di1100"\nfull_scale = 10.0').replace("400.0", "2000.0"))
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    with served(SimulatedDataq(lambda n, rate: np.zeros((n, 2), np.int16), Simulation())) as port:
        assert main(["acquire", str(tmp_path / "plan.toml"), "--port", port, "-o", str(tmp_path / "c.h5")]) == 2
    assert "standard input is closed" in capsys.readouterr().err
    assert not list(tmp_path.glob("c.h5*"))


def test_a_recording_is_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "c.h5").write_text("dear to somebody")
    (tmp_path / "plan.toml").write_text(FRAMED)
    assert main(["acquire", str(tmp_path / "plan.toml"), "-o", str(tmp_path / "c.h5")]) == 2
    assert "already exists" in capsys.readouterr().err
    assert (tmp_path / "c.h5").read_text() == "dear to somebody"
