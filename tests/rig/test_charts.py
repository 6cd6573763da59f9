"""Charts as data."""

import numpy as np

from isorig.rig.report.charts import PHASE_ENDS, unjoined


def test_a_phase_close_to_180_degrees_is_one_line() -> None:
    shown = unjoined(np.array([-170.0, -179.0, 178.0, -178.0, 175.0, -170.0]))
    assert shown.tolist() == [-170.0, -179.0, -182.0, -178.0, -185.0, -170.0]


def test_a_phase_that_wraps_is_interrupted_there_and_stays_in_the_panel() -> None:
    shown = unjoined(np.array([-90.0, -170.0, 175.0, 90.0, -160.0, 100.0]))
    assert np.isnan(shown).tolist() == [False, True, False, True, True, False]
    assert unjoined(np.array([10.0, 20.0])).tolist() == [10.0, 20.0]
    noisy = np.degrees(np.angle(np.exp(1j * (np.pi + np.random.default_rng(1).normal(0.0, 0.2, 500)))))
    drawn = unjoined(noisy)
    assert np.nanmin(drawn) >= PHASE_ENDS[0]
    assert np.nanmax(drawn) <= PHASE_ENDS[1]
    assert np.nanmax(np.abs(np.diff(drawn))) <= 180.0
