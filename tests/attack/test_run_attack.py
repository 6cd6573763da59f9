"""The attacks by chance themselves: what they count, and that a wrong outcome is counted as wrong."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "rig"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "drivers"))

from run_attack import COMMANDS, DRIVERS, Portion, Row, attack, page, portions

from isorig.drivers.kinds import kinds


def test_every_kind_is_attacked_as_often_as_asked_with_different_seeds(tmp_path: Path) -> None:
    asked = list(portions(600, 120, 300, 5, tmp_path))
    counts: Counter[str] = Counter()
    for portion in asked:
        number = portion.call[2] if portion.kind != "input" else portion.call[1].partition("=")[2]
        counts[portion.what] += int(number)
    assert counts == {"power-loss images": 600, **dict.fromkeys(DRIVERS, 120), **dict.fromkeys(COMMANDS, 300)}
    assert len({tuple(portion.call) for portion in asked}) == len(asked)


def test_every_driver_and_every_kind_of_input_is_attacked() -> None:
    import fuzzing
    from campaign import ATTEMPTS

    assert set(DRIVERS) == set(ATTEMPTS) == set(kinds())
    assert set(COMMANDS.values()) <= set(fuzzing.KINDS)


def test_a_portion_of_images_is_counted_and_a_crash_is_wrong(tmp_path: Path) -> None:
    (image,) = portions(10, 0, 0, 3, tmp_path)
    crash = tmp_path / "crash.py"
    crash.write_text("import os; os.abort()")
    silent = tmp_path / "silent.py"
    silent.write_text('print(\'{"case": "x", "wrong": "silent: 3"}\'); print(\'{"right": 2}\')')
    rows = attack([image, Portion("input", "crash", (str(crash),)), Portion("fault", "silent", (str(silent),))], 2)
    assert [row.count for row in rows] == [10, 0, 2]
    assert [len(row.bad) for row in rows] == [0, 1, 1]


def test_the_page_states_counts_seeds_and_what_was_wrong() -> None:
    rows = [
        Row("image", "power-loss images", Counter(torn=7)), Row("fault", "framed", Counter(right=5, told=1)),
        Row("input", "check", Counter(refused=9, accepted=2), ["hang"]),
    ]  # fmt: skip
    text = page(rows, seed=4, seconds=1800.0, workers=2, machine="8 cores", more=["- an hour"])
    assert "Last run: 24 attacks, seeds from 4 on, 0.50 hours in 2\nprocesses (8 cores); **1 wrong**." in text
    assert "| framed | 6 | 5 | 1 | 0 |" in text
    assert "| check | 11 | 2 | 9 | 1 |" in text
    assert text.endswith("## Long runs\n\n- an hour\n")


@pytest.mark.study
def test_an_hour_of_a_watched_folder() -> None:
    from fleet_day import main

    assert main(1.0, 3) == 0
