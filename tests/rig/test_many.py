"""Many campaigns at once: what the pool does beside its work."""

from pathlib import Path

import psutil

from rig.cli import main
from rig.many import diagnose_files


def test_nothing_listens_to_other_machines(tmp_path: Path) -> None:
    torn = tmp_path / "torn.h5"
    torn.write_bytes(b"no recording")
    outcomes = diagnose_files([(torn, tmp_path / "out")], "coulomb")
    first = next(outcomes)  # the pool is open as long as the answers are not all taken
    listening = {c.laddr.ip for c in psutil.Process().net_connections() if c.status == psutil.CONN_LISTEN}
    assert listening <= {"127.0.0.1", "::1"}
    assert first.verdict == "refused"
    assert list(outcomes) == []
    assert not (tmp_path / "out").exists()


def test_names_must_differ(tmp_path: Path, capsys) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "same.h5").write_bytes(b"")
    files = [str(tmp_path / folder / "same.h5") for folder in ("a", "b")]
    assert main(["diagnose", *files, "-o", str(tmp_path / "out")]) == 2
    assert "two recordings are named 'same'" in capsys.readouterr().err


def test_empty_folder(tmp_path: Path, capsys) -> None:
    assert main(["diagnose", str(tmp_path), "-o", str(tmp_path / "out")]) == 2
    assert "no recording was given" in capsys.readouterr().err
