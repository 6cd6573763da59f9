"""The counts of investigations on a table made by hand."""

import pandas as pd
from tally import STANDARD, foreign_section, further_runs, investigations, pairs_parted, shapeless

COLUMNS = ("kind", "size", "seed", "way", "named", "right", "open", "first_open", "further", "seconds", "ended")
FOUND = pd.DataFrame(
    [
        ("end_stop", 1.0, 1, "proposed", "end_stop at isolation", 1, "", "a | b", 1, 35.0, "Identified cause."),
        ("end_stop", 1.0, 1, "repeat", "end_stop at isolation", 1, "a | b", "a | b", 2, 65.0, "The limit of 4 runs is reached."),
        ("end_stop", 1.0, 1, "random", "end_stop at isolation", 1, "", "a | b", 2, 65.0, "Identified cause."),
        ("wrong_mass", 0.33, 2, "proposed", "wrong_mass at head", 1, "a | b", "a | b", 0, 25.0, "No allowed run does."),
        ("none", 1.0, 3, "proposed", "sensor_gain at head", 0, "", "", 3, 95.0, "Identified cause."),
    ],
    columns=COLUMNS,
)  # fmt: skip
PLAN = pd.DataFrame(
    [("end_stop", 1.0, 1, 0, "a+b"), ("wrong_mass", 0.33, 2, 1, "a+b"), ("other", 1.0, 9, 1, "")],
    columns=("kind", "size", "seed", "right", "alike"),
)


def test_the_standard_plan_takes_so_many_seconds() -> None:
    assert STANDARD == 510.0


def test_counts_by_what_is_hidden() -> None:
    rows = {row[0]: row[1:] for row in investigations(FOUND, PLAN)}
    assert list(rows) == ["catalogued cause, full size", "catalogued cause, a third of full size", "no effect"]
    right, forms, shared, seconds = rows["catalogued cause, full size"]
    assert right.startswith("1 of 1")
    assert forms == "1"
    assert shared == "1 and 0 of 1"
    assert seconds == "35 s (35 to 35 s)"
    assert rows["no effect"][0].startswith("0 of 1")
    assert rows["no effect"][2] == "0 and 0 of 0"


def test_a_free_shape_is_no_form_of_the_catalogue() -> None:
    assert shapeless("end_stop at isolation+sensor_gain at head")
    assert shapeless("")
    assert not shapeless("end_stop at isolation+spring_shape at table")


def test_further_runs_count_where_the_right_cause_is_left_alone() -> None:
    """Repeating the run leaves two causes, one of them right: it never ends."""
    proposed, repeat, random = further_runs(FOUND)
    assert proposed[1:3] == ("1 of 1", "1")
    assert repeat[1:3] == ("0 of 1", "more than twice those proposed")
    assert random[1:3] == ("1 of 1", "2")


def test_pairs_that_the_standard_plan_left() -> None:
    said = pairs_parted(FOUND, PLAN)
    assert "indistinguishable causes in 2 of 2 envelopes; investigations distinguished 1 of these and reported for 1" in said
    assert "2 of 3 investigations had several possible causes: 1 ended with one, 1 with the" in said


def test_foreign_rigs_are_counted_by_group_and_every_wrong_name_is_told() -> None:
    columns = ("seed", "family", "group", "outcome", "hidden", "verdict", "named", "processor_s")
    rows = [
        (1, "chain", "one cause, full size, clean", "right", "iwan at l0", "explained", "memory at l0", 9.0),
        (2, "stage", "one cause, full size, clean", "wrong", "iwan at rail", "explained", "backlash at rail", 12.0),
        (3, "base", "no cause, clean", "right", "", "adequate", "", 4.0),
    ]
    page = foreign_section(pd.DataFrame(rows, columns=columns))
    assert "| one cause, full size, clean | 1 of 2: 50.0 % (9.5 to 90.5 %) | 0 | 0 | 0 | 1 |" in page
    assert "Wrong: backlash at rail for iwan at rail (seed 2, stage)." in page
