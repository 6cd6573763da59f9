"""Where the engine's matrices are in memory."""

from __future__ import annotations

import pytest

from isorig.analysis.simulate.compiled import compile_rig
from isorig.rig.wire_bonder.description import wire_bonder


@pytest.mark.parametrize("rate", [512.0, 1000.0, 2048.0])
def test_every_column_is_one_line_of_the_cache(rate: float) -> None:
    rig = compile_rig(wire_bonder(), "unlocked", 1.0 / rate).rig
    assert rig.whole.ctypes.data % 64 == rig.series.ctypes.data % 64 == 0
    assert rig.whole.flags.c_contiguous
    assert rig.series.flags.c_contiguous
