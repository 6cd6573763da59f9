"""Flat tops of records: a clipped record has them, a command of few levels does not."""

from __future__ import annotations

import numpy as np
import pytest

from isorig.analysis.campaign import SI_UNIT, Campaign, Channel, Run
from isorig.analysis.diagnose.observe import FLAT_SAMPLES, flat_tops
from isorig.analysis.equations.motion import LEVELS

TIME = np.arange(4000) / 400.0


def campaign(samples: np.ndarray) -> Campaign:
    channel = Channel(name="motor", samples=samples, quantity="force", unit=SI_UNIT["force"])
    run = Run(id="r", configuration="normal", sample_rate=400.0, gain=1.0, channels={"motor": channel})
    return Campaign(runs=(run,), source="test")


def found(samples: np.ndarray) -> dict[str, float]:
    return flat_tops(campaign(samples), {"motor": float(np.abs(samples).max())})


def test_a_clipped_record_has_flat_tops() -> None:
    assert found(np.clip(np.sin(2 * np.pi * 3.1 * TIME), -0.8, 0.8)) == {"motor": pytest.approx(0.8, rel=2e-3)}


@pytest.mark.parametrize("count", [FLAT_SAMPLES - 1, FLAT_SAMPLES])
def test_flat_tops_begin_at_their_number_of_samples(count: int) -> None:
    samples = np.linspace(0.0, 0.9, len(TIME))
    samples[:count] = 1.0
    assert bool(found(samples)) is (count >= FLAT_SAMPLES)


@pytest.mark.parametrize(("levels", "flat"), [(LEVELS - 1, False), (LEVELS, True)])
def test_a_command_of_few_levels_has_none(levels: int, flat: bool) -> None:
    assert bool(found(np.floor(TIME).astype(int) % levels / levels)) is flat
