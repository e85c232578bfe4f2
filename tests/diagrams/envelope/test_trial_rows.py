"""A row is a line and a line is a row; the oracle is the way back."""

import csv

import pytest

from diagrams.envelope.trial_rows import (
    COLUMNS,
    csv_line,
    key_of,
    line_of,
    parse_cells,
    sort_key,
)
from tests.diagrams.envelope.made_up_trials import made_up_rows, paper_times


def cells_of(line):
    (cells,) = csv.reader([line], strict=True)
    return cells


def test_every_row_comes_back_as_it_was():
    rows = made_up_rows(paper_times(1.0))
    assert [parse_cells(cells_of(line_of(row))) for row in rows] == rows


def test_no_digit_of_a_number_is_lost():
    value = 0.1 + 0.2
    row = parse_cells(cells_of(line_of({"max_icp_error_m": value})))
    assert row["max_icp_error_m"] == value


@pytest.mark.parametrize("text", ["a\nb", "a\r\nb", "a\u2028b", "a\x0bb"])
def test_a_row_is_one_line_whatever_is_said(text):
    """Oracle: every way that Python knows to end a line."""
    line = line_of({"reason": f'"{text}", said she'})
    assert len(line.splitlines()) == 1
    assert line.endswith("\n")
    row = parse_cells(cells_of(line))
    assert row["reason"] == '"a b", said she'


def test_what_is_not_known_is_empty_and_comes_back_as_none():
    row = parse_cells(cells_of(line_of({"max_torque_ratio": None})))
    assert row["max_torque_ratio"] is None
    assert row["replica"] is None
    assert row["reason"] == ""


def test_lists_are_written_with_semicolons():
    row = parse_cells(cells_of(line_of({"predicted_at_touchdowns": [2, -1]})))
    assert row["predicted_at_touchdowns"] == "2;-1"


def test_refuses_cells_that_are_no_row():
    with pytest.raises(ValueError, match="must have 24 cells, has 3"):
        parse_cells(["a", "b", "c"])
    cells = ["x" if name == "replica" else "" for name in COLUMNS]
    with pytest.raises(ValueError, match="replica = 'x': must be a number"):
        parse_cells(cells)


def test_sorts_fewer_mechanisms_before_more():
    """Oracle: the columns of the paper's figure, not the alphabet."""
    names = ["step_swing", "all_with_cross_over", "icp_only", "step"]
    rows = [
        {
            "mechanisms": name,
            "phase": "right swing 25 %",
            "direction_deg": 0.0,
            "delta_v": size,
            "replica": replica,
        }
        for name in names
        for size, replica in ((0.5, 1), (0.5, 0), (0.04, 3))
    ]
    ordered = sorted(rows, key=sort_key)
    assert [row["mechanisms"] for row in ordered[::3]] == [
        "icp_only",
        "step",
        "step_swing",
        "all_with_cross_over",
    ]
    assert [key_of(row)[3:] for row in ordered[:3]] == [
        (0.04, 3),
        (0.5, 0),
        (0.5, 1),
    ]


def test_a_line_is_what_a_table_reads():
    """Oracle: the csv module's own quotes."""
    assert csv_line(["a", "b,c", 'd"e']) == 'a,"b,c","d""e"\n'
