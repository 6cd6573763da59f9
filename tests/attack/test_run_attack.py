"""The attacks by chance themselves: what they count, and that a wrong outcome is counted as wrong."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "rig"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "drivers"))

from run_attack import COMMANDS, DRIVERS, Kept, Portion, Result, Row, attack, page, portions, rows_of

from isorig.drivers.kinds import kinds


def test_every_kind_is_attacked_as_often_as_asked_with_different_seeds() -> None:
    asked = portions(600, 120, 300, 5)
    counts: Counter[str] = Counter()
    for portion in asked:
        number = portion.call[2] if portion.kind != "input" else portion.call[1].partition("=")[2]
        counts[portion.what] += int(number)
    assert counts == {"power-loss images": 600, **dict.fromkeys(DRIVERS, 120), **dict.fromkeys(COMMANDS, 300)}
    assert len({portion.name for portion in asked}) == len(asked)


def test_a_run_that_ends_early_has_attacked_all_kinds_alike() -> None:
    asked = portions(500, 100, 500, 1)
    kinds = {portion.what for portion in asked}
    assert {portion.what for portion in asked[: len(kinds)]} == kinds


def test_every_driver_and_every_kind_of_input_is_attacked() -> None:
    import fuzzing
    from campaign import ATTEMPTS

    assert set(DRIVERS) == set(ATTEMPTS) == set(kinds())
    assert set(COMMANDS.values()) <= set(fuzzing.KINDS)


def test_a_portion_of_images_is_counted_and_a_crash_is_wrong(tmp_path: Path) -> None:
    (image,) = portions(10, 0, 0, 3)
    crash = tmp_path / "crash.py"
    crash.write_text("import os; os.abort()")
    silent = tmp_path / "silent.py"
    silent.write_text('print(\'{"case": "x", "wrong": "silent: 3"}\'); print(\'{"right": 2}\')')
    asked, kept = [image, Portion("input", "crash", (str(crash),)), Portion("fault", "silent", (str(silent),))], Kept(None)
    attack(asked, 2, kept)
    rows = rows_of(asked, kept)
    assert [row.count for row in rows] == [10, 0, 2]
    assert [len(row.bad) for row in rows] == [0, 1, 1]


def test_an_interrupted_run_goes_on_where_it_ended(tmp_path: Path) -> None:
    counting = tmp_path / "counting.py"
    counting.write_text(f"open({str(tmp_path / 'runs')!r}, 'a').write('x'); print('{{\"right\": 2}}'); print('a sentence')")
    first, second = (Portion("fault", "x", (str(counting), seed)) for seed in "12")
    attack([first], 2, Kept(tmp_path / "results"))
    kept = Kept(tmp_path / "results")
    attack([first, second], 2, kept)
    assert (tmp_path / "runs").read_text() == "xx"
    assert [row.count for row in rows_of([first, second], kept)] == [4]
    assert kept.results == Kept(tmp_path / "results").results
    assert kept.results[second.name].said == ["a sentence"]
    assert isinstance(kept.results[first.name], Result)


def test_a_run_that_is_cut_short_counts_what_it_has_tried_and_repeats_it_later(tmp_path: Path) -> None:
    patient = tmp_path / "patient.py"
    patient.write_text(
        "import signal, sys, threading\nover = threading.Event()\nsignal.signal(signal.SIGTERM, lambda *args: over.set())\n"
        "over.wait(60.0)\nprint('{\"accepted\": 3}')\n"
    )
    plain = tmp_path / "plain.py"
    plain.write_text("import time\ntime.sleep(60.0)")
    asked = [Portion("fault", "patient", (str(patient),)), Portion("fault", "plain", (str(plain),))]
    kept = Kept(tmp_path / "results")
    attack(asked, 2, kept, 5.0)
    (row,) = rows_of(asked, kept)
    assert (row.what, row.count, row.bad) == ("patient", 3, [])
    patient.write_text("print('{\"accepted\": 5}')")
    attack(asked[:1], 2, kept)
    assert [row.count for row in rows_of(asked, Kept(tmp_path / "results"))] == [5]


def test_the_page_states_counts_seeds_and_what_was_wrong() -> None:
    rows = [
        Row("image", "power-loss images", Counter(torn=7)), Row("fault", "framed", Counter(right=5, told=1)),
        Row("input", "check", Counter(refused=9, accepted=2), ["hang"]),
    ]  # fmt: skip
    text = page(rows, seed=4, seconds=1800.0, workers=2, machine="8 cores", more=["- an hour"])
    assert "Last run: 24 attacks, seeds from 4 on, 0.50 hours in total in\nprocesses of which 2 ran at a time" in text
    assert "(8 cores); **1 wrong**." in text
    assert "| framed | 6 | 5 | 1 | 0 |" in text
    assert "| check | 11 | 2 | 9 | 1 |" in text
    assert text.endswith("## Long runs\n\n- an hour\n")


@pytest.mark.study
def test_an_hour_of_a_watched_folder() -> None:
    from fleet_day import main

    assert main(1.0, 3) == 0
