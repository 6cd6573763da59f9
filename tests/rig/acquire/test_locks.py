"""One session at a time on a port, whatever the port and the folder for temporary files are called."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "drivers"))

from far import Far, FramedFar
from test_sessions_attacked import killed, session, wait_for

from isorig.drivers.errors import ConnectionLostError
from isorig.drivers.port import Port
from isorig.rig.acquire.locks import identities, port_locked
from isorig.rig.errors import PlanError

#: Spellings of one address of this computer that `socket` resolves.
SAME = (
    "socket://127.0.0.1:4000", "socket://localhost:4000", "socket://LOCALHOST:4000", "socket://127.1:4000",
    "socket://127.0.0.1:04000", "socket://2130706433:4000", "socket://0x7f.1:4000", "socket://[::ffff:127.0.0.1]:4000",
    "socket://127.0.0.1:4000/", "socket://127.0.0.1:4000?logging=debug", "socket://user@127.0.0.1:4000",
    "socket://user:word@127.0.0.1:4000/a?b", "socket://0.0.0.0:4000", "socket://127.0.0.2:4000", "rfc2217://127.0.0.1:4000",
    "SOCKET://127.0.0.1:4000",
)  # fmt: skip


@pytest.mark.parametrize("port", SAME)
def test_one_address_is_one_port(port: str) -> None:
    assert identities(port) & identities(SAME[0])
    with port_locked(SAME[0]), pytest.raises(PlanError, match="is in use by another session"), port_locked(port):
        pass


def test_other_ports_and_hosts_are_other_ports() -> None:
    others = ["socket://127.0.0.1:4001", "socket://192.0.2.1:4000", "socket://[2001:db8::1]:4000", "/dev/null", "COM3", "a b"]
    seen = [identities(port) for port in (SAME[0], *others)]
    assert len(frozenset().union(*seen)) == sum(map(len, seen))
    with port_locked(SAME[0]), port_locked("socket://127.0.0.1:4001"):
        pass


def test_a_device_is_one_port_under_all_of_its_names(tmp_path: Path) -> None:
    link, node = tmp_path / "tty", tmp_path / "node"
    link.symlink_to("/dev/null")
    names = ["/dev/null", "/dev/../dev/null", str(link)]
    try:
        os.mknod(node, 0o20666, Path("/dev/null").stat().st_rdev)
        names.append(str(node))
    except PermissionError:
        pass
    assert len({identities(name) for name in names}) == 1


def test_the_name_of_a_device_is_one_port_in_every_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = identities("cDAQ1")
    monkeypatch.chdir(tmp_path)
    assert identities("cDAQ1") == here != identities("cDAQ2")


def test_another_folder_for_temporary_files_shares_no_port(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    with FramedFar(frames=10**9, speed=1.0) as far, killed(session(tmp_path, far.port)) as first:
        wait_for(lambda: far.sent > 4)
        heard = far.heard
        with killed(session(tmp_path / "other", far.port, env={**os.environ, "TMPDIR": str(tmp_path / "other")})) as second:
            _, said = second.communicate(timeout=30)
            assert second.returncode == 2
        assert f"is in use by another session (process {first.pid})" in said.decode()
        assert far.heard == heard


def test_a_serial_line_is_opened_for_one_program(tmp_path: Path) -> None:
    opened = "import sys; from isorig.drivers.port import Port; Port(sys.argv[1], baud_rate=9600)"
    with Far() as far, closing(Port(far.port, baud_rate=9600)):
        with pytest.raises(ConnectionLostError, match="cannot be opened"):
            Port(far.port, baud_rate=9600)
        other = subprocess.run([sys.executable, "-c", opened, far.port], capture_output=True, text=True, check=False, timeout=60)
        assert "ConnectionLostError" in other.stderr
