"""Oracle: tables as they are written by hand."""

import pytest

from diagrams.envelope.markdown import table

TABLE = """\
| name   | value | other value |
|:-------|------:|------------:|
| a      |  1.25 |           – |
| `long` |     x |         yes |
"""


def test_columns_are_as_wide_as_they_must_be():
    rows = [["a", "1.25", "–"], ["`long`", "x", "yes"]]
    assert table(["name", "value", "other value"], rows) == TABLE


def test_a_bar_in_a_cell_is_not_the_end_of_it():
    lines = table(["a", "b"], [["x|y", "1"]]).splitlines()
    assert lines[2] == "| x\\|y |   1 |"
    assert len({len(line) for line in lines}) == 1


def test_rows_must_fit_the_head():
    with pytest.raises(ValueError, match="zip"):
        table(["a", "b"], [["1"]])
