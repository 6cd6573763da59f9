"""Sampled accelerations of a linear rig against its transfer function in closed form: what the fine grid costs."""

import numpy as np
import pytest

from isorig.analysis.simulate import Excitation, simulate
from isorig.analysis.simulate.sampling import AS_IT_IS, interpolate
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.four_set_ups import head_to_table

RATE = 1024.0


@pytest.mark.parametrize("frequency", [5.0, 40.0, 164.0, 300.0])
def test_eight_steps_a_sample_are_enough(frequency: float) -> None:
    n, settled = 16384, 12288
    drive = np.cos(2.0 * np.pi * frequency * np.arange(n) / RATE)
    values = {**THESIS, "motor_damping": 0.3, "table_damping": 0.2, "heatblock_damping": 0.05}
    seen = simulate(wire_bonder(values, friction=False), Excitation.prepare(drive, RATE)).channels["table"][settled:-64]
    turn = np.exp(2j * np.pi * frequency * np.arange(settled, n - 64) / RATE)
    parts = np.linalg.lstsq(np.stack([turn.real, -turn.imag], axis=1), seen, rcond=None)[0]
    want = head_to_table(values, np.array([frequency]))[0]
    assert abs(complex(*parts) / want - 1.0) < 2e-4


@pytest.mark.parametrize("share", [0.02, 0.1, 0.2, 0.3, 0.4])
def test_the_interpolation_neither_adds_nor_loses_amplitude(share: float) -> None:
    # A ripple of 1e-4 across a resonance is a bias of 1e-4 of its damping.
    n, over = 2048, 8
    fine = interpolate(np.sin(2.0 * np.pi * share * np.arange(n)), over, AS_IT_IS)[256 * over : -256 * over]
    true = np.sin(2.0 * np.pi * share * (np.arange(n * over) / over))[256 * over : -256 * over]
    assert np.abs(fine - true).max() < 2.5e-5
