"""Oracle: worst, mean and ratios by hand, from known limits."""

import pytest

from diagrams.envelope.limit_search import SearchParams
from diagrams.envelope.limit_tables import LimitTables, direction_words
from diagrams.envelope.moment import Moment
from diagrams.envelope.references import MOMENT
from tests.diagrams.envelope.made_up_trials import (
    made_up_envelope,
    read_table,
)

ALL = "all_with_cross_over"
LEFT = Moment.parse("left swing 25 %")
SEARCH = SearchParams(resolution=0.1, stride=4, largest=2.0)
# The paper has 1.15, 0.41 and no 45 degrees; the limits are 1.86 and 0.82.
CELLS = {
    (ALL, MOMENT, 0.0): 1.3,
    (ALL, MOMENT, 45.0): 0.8,
    (ALL, MOMENT, 90.0): 0.3,
}


def tables_of(cells, speed=2.0, **options):
    envelope = made_up_envelope(cells, SEARCH, **options)
    return LimitTables(envelope=envelope, speed=speed)


def test_a_row_for_each_direction_beside_the_paper_and_the_limit():
    first, second, third = read_table(tables_of(CELLS).details(ALL, MOMENT))
    assert first == {
        "direction": "0° forward",
        "recovered [m/s]": "1.30",
        "fails at": "1.40",
        "paper [m/s]": "1.15",
        "/ paper": "1.13",
        "limit [m/s]": "1.86",
        "/ limit": "0.70",
        "/ sqrt(g z)": "0.650",
        "complete": "yes",
    }
    assert second["direction"] == "45°"
    assert second["recovered [m/s]"] == "0.80"
    assert second["paper [m/s]"] == second["/ limit"] == "–"
    assert (third["direction"], third["/ paper"]) == ("90° left", "0.73")


def test_worst_and_mean_are_over_the_directions():
    """Ratios are over those two directions that the paper has, too.

    1.3 / 1.15 = 1.130, 0.3 / 0.41 = 0.732, mean 0.931;
    1.3 / 1.86 = 0.699, 0.3 / 0.82 = 0.366, mean 0.532.
    """
    (row,) = read_table(tables_of(CELLS).summary(MOMENT))
    assert row == {
        "worst / mean": f"`{ALL}`",
        "recovered [m/s]": "0.30 / 0.80",
        "paper [m/s]": "0.41 / 0.78",
        "/ paper": "0.73 / 0.93",
        "limit [m/s]": "0.82 / 1.34",
        "/ limit": "0.37 / 0.53",
        "/ sqrt(g z)": "0.150 / 0.400",
        "complete": "3 of 3",
    }


def test_what_is_not_known_is_no_column():
    tables = tables_of(CELLS, speed=None, robot="atlas")
    expected = ["worst / mean", "recovered [m/s]", "complete"]
    assert list(read_table(tables.summary(MOMENT))[0]) == expected
    row = read_table(tables.details(ALL, MOMENT))[0]
    expected = ["direction", "recovered [m/s]", "fails at", "complete"]
    assert list(row) == expected


def test_cells_that_are_not_complete_say_so():
    cells = {**CELLS, ("step", MOMENT, 0.0): 0.5}
    tables = tables_of(cells, is_unfinished=lambda c: c[2] == 45.0)
    rows = read_table(tables.details(ALL, MOMENT))
    assert [row["complete"] for row in rows] == ["yes", "no", "yes"]
    figures = [row["recovered [m/s]"] for row in rows]
    assert figures == ["1.30", "~0.80", "0.30"]
    rows = read_table(tables.details("step", MOMENT))
    assert [r["complete"] for r in rows] == ["yes", "not begun", "not begun"]
    assert rows[1]["recovered [m/s]"] == rows[1]["fails at"] == "–"
    rows = read_table(tables.summary(MOMENT))
    assert [row["complete"] for row in rows] == ["1 of 3", "2 of 3"]
    figures = [row["recovered [m/s]"] for row in rows]
    assert figures == ["0.50 / 0.50", "0.30 / ~0.80"]


def test_mechanisms_that_were_not_begun_at_a_moment_have_an_empty_row():
    cells = {**CELLS, ("step", LEFT, 0.0): 0.5}
    step, _ = read_table(tables_of(cells).summary(MOMENT))
    assert step["worst / mean"] == "`step`"
    assert (step["recovered [m/s]"], step["complete"]) == ("–", "0 of 3")


def test_a_limit_beyond_the_largest_push_is_only_a_bound():
    tables = tables_of({(ALL, MOMENT, 0.0): 9.0})
    (row,) = read_table(tables.details(ALL, MOMENT))
    assert (row["recovered [m/s]"], row["fails at"]) == (">=2.00", "–")
    for text in (tables.summary(MOMENT), tables.over_moments()):
        (row,) = read_table(text)
        assert row["recovered [m/s]"] == ">=2.00 / >=2.00"


def test_a_mean_is_a_bound_if_any_limit_is_but_the_worst_is_not():
    """By hand: (2.0 + 0.3) / 2 = 1.15, or more."""
    tables = tables_of({(ALL, MOMENT, 0.0): 9.0, (ALL, MOMENT, 90.0): 0.3})
    (row,) = read_table(tables.summary(MOMENT))
    assert row["recovered [m/s]"] == "0.30 / >=1.15"


def test_the_worst_of_all_moments_is_named():
    cells = {**CELLS, (ALL, LEFT, 45.0): 0.2, (ALL, LEFT, 90.0): 0.9}
    (row,) = read_table(tables_of(cells).over_moments())
    assert row["recovered [m/s]"] == "0.20 / 0.70"
    assert row["worst is"] == "45°, left swing 25 %"
    assert row["complete"] == "5 of 6"


def test_a_worst_that_is_not_complete_is_marked():
    tables = tables_of(CELLS, is_unfinished=lambda c: c[2] == 90.0)
    (row,) = read_table(tables.over_moments())
    assert row["recovered [m/s]"] == "~0.30 / ~0.80"
    assert (row["worst is"], row["complete"]) == (
        "90° left, right swing 25 %",
        "2 of 3",
    )


@pytest.mark.parametrize(
    ("direction", "words"),
    [(0.0, "0° forward"), (22.5, "22.5°"), (270.0, "270° right")],
)
def test_directions_have_words(direction, words):
    assert direction_words(direction) == words
