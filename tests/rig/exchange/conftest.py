"""A small recording for exchange."""

from pathlib import Path

import numpy as np
import pytest

from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.rig.files.recording import write


@pytest.fixture(scope="session")
def campaign() -> Campaign:
    """Two runs with four channels: raw integers with a scale, as a converter gives them."""
    generator = np.random.default_rng(4)
    runs = []
    for name, configuration, gain, n in (("u70", "unlocked", 70.0, 4096), ("l7", "locked", 7.0, 2048)):
        head = generator.integers(-20000, 20000, n).astype(np.int32)
        records = {"head": head, "motor": head // 2 + 5, "table": np.roll(head, 3) // 3, "heatblock": -head // 4}
        channels = {k: Channel(name=k, samples=v, scale=1e-3, full_scale=50.0) for k, v in records.items()}
        runs.append(
            Run(
                id=name, configuration=configuration, sample_rate=1024.0, gain=gain, channels=channels, excitation="random",
                band=(0.5, 400.0),
            )
        )  # fmt: skip
    return Campaign(runs=tuple(runs), known={"head_mass": 6.5, "motor_mass": 16.4})


@pytest.fixture
def recording(tmp_path: Path, campaign: Campaign) -> Path:
    """The same as a file."""
    path = tmp_path / "campaign.h5"
    write(path, campaign)
    return path
