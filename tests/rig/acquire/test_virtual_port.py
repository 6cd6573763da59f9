"""The port "virtual" serves every kind of instrument whose far end is simulated, also one that a user has added."""

from __future__ import annotations

from pathlib import Path

import pytest

from isorig.drivers import kinds as registry
from isorig.rig.acquire.simulated_instruments import simulated_kinds
from isorig.rig.cli import main
from isorig.rig.files.recording import read

PLAN = """
[rig]
head_mass = 6.5
[[runs]]
id = "a"
configuration = "unlocked"
gain = 70.0
excitation = "other"
seconds = 3.0
[instrument]
kind = "{kind}"
port = "/dev/none"
{example}
"""


#: Reached through a library, not by bytes on a wire: their tests exchange the library's device.
LIBRARIES = {"nidaqmx", "sound"}


def test_every_kind_on_a_wire_is_simulated() -> None:
    assert set(simulated_kinds()) == set(registry.kinds()) - LIBRARIES


# A framed instrument plays the drive: the tests of sessions use it.
@pytest.mark.parametrize("kind", sorted(set(registry.kinds()) - {"framed"} - LIBRARIES))
def test_the_virtual_port_measures_with_any_kind(kind: str, tmp_path: Path) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(PLAN.format(kind=kind, example=registry.kinds()[kind].example), encoding="utf-8")
    assert main(["acquire", str(plan), "--port", "virtual", "--yes", "--json", "-o", str(tmp_path / "c.h5")]) == 0
    (run,) = read(tmp_path / "c.h5").runs
    assert run.duration >= 3.0
    assert 0.3 < run.read("motor").std() < 5.0


def test_a_kind_without_a_far_end_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["virtual", "instrument", "--kind", "cassette", "--seconds", "1"]) == 2
    assert "the kind 'cassette' cannot be simulated; available are di1100, framed" in capsys.readouterr().err
