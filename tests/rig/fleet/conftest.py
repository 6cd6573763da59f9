"""Small recordings, and a catalogue's files."""

from __future__ import annotations

from pathlib import Path

import pytest

from isorig.rig.files.recording import write
from isorig.rig.files.rigfile import read_rig
from isorig.rig.virtual.simulated_recording import described_campaign


@pytest.fixture(scope="session")
def pool(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Six different recordings of two carts, each diagnosed in a fifth of a second."""
    folder = tmp_path_factory.mktemp("pool")
    files = [folder / f"{k}.h5" for k in range(6)]
    for k, file in enumerate(files):
        write(file, described_campaign(read_rig("two-carts"), seed=k, seconds=3.0))
    return files


@pytest.fixture
def measured(tmp_path: Path, pool: list[Path]) -> Path:
    """A folder of two rigs with two recordings each."""
    folder = tmp_path / "measured"
    for k, name in enumerate(("rig-a/w1", "rig-a/w2", "rig-b/w1", "rig-b/w2")):
        place = folder / f"{name}.h5"
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(pool[k].read_bytes())
    return folder
