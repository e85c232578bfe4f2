"""The table says what the limits are, and what is not sure of them."""

import pytest

from diagrams.envelope.envelope_data import envelope_of
from diagrams.envelope.limit_search import SearchParams
from diagrams.envelope.moment import Moment
from diagrams.envelope.recovered_table import table_lines
from tests.diagrams.envelope.made_up_trials import identity_of, made_up_rows

SWING = Moment("swing", "right", 0.25)
LIMITS = {
    ("icp_only", SWING, 0.0): 0.31,
    ("icp_only", SWING, 90.0): 0.12,
    ("all_with_cross_over", SWING, 90.0): 1.23,
}


def lines_of(limits=LIMITS, search=None, change=lambda row: None, **more):
    search = search or SearchParams(resolution=0.1, stride=2, replicas=2)
    rows = made_up_rows(limits, search, **more)
    for row in rows:
        change(row)
    return table_lines(envelope_of(identity_of(search), rows))


def test_has_a_line_for_each_direction_and_a_column_for_each_set():
    """Oracle: the limits, rounded down to the resolution by hand."""
    assert lines_of() == [
        "",
        "largest recovered push [m/s], right swing 25 %",
        "direction  icp_only  all_with_cross_over",
        "        0      0.30                    -",
        "       90      0.10                 1.20",
        "",
    ]


def test_marks_what_is_not_confirmed():
    cell = ("icp_only", SWING, 0.0)
    lines = lines_of(is_unfinished=lambda tried: tried == cell)
    (line,) = (line for line in lines if line.startswith("        0"))
    assert line.split()[1].startswith("~0.")
    assert "~ the search is not complete" in lines


def test_marks_what_may_be_larger_and_keeps_the_columns_apart():
    """Oracle: by hand; `step` is shorter than its figure."""
    limits = {("step", SWING, 0.0): 9.0, ("step", SWING, 90.0): 0.5}
    assert lines_of(limits)[2:] == [
        "direction    step",
        "        0  >=3.00",
        "       90    0.50",
        ">= nothing larger was tried",
        "",
    ]


def test_says_nothing_of_what_is_complete():
    assert not [line for line in lines_of() if "~" in line or ">" in line]


@pytest.mark.parametrize(
    ("resolution", "shown"), [(0.05, "0.30"), (0.025, "0.300"), (1e-2, "0.31")]
)
def test_shows_as_many_digits_as_the_resolution_has(resolution, shown):
    search = SearchParams(resolution=resolution, stride=8, replicas=1)
    lines = lines_of({("icp_only", SWING, 0.0): 0.31 + 1e-9}, search)
    assert lines[3].split() == ["0", shown]


def test_has_a_table_for_each_moment():
    later = Moment("transfer", "left", 0.5)
    limits = LIMITS | {("icp_only", later, 0.0): 0.2}
    titles = [line for line in lines_of(limits) if line.startswith("largest")]
    assert [title.partition(", ")[2] for title in titles] == [
        "right swing 25 %",
        "left transfer 50 %",
    ]


@pytest.mark.parametrize("outcome", ["crashed", "hung", "error"])
def test_counts_the_trials_that_did_not_end(outcome):
    def change(row):
        if row["outcome"] != "recovered" and row["replica"] == 0:
            row["outcome"] = outcome

    lines = lines_of(change=change)
    (line,) = (line for line in lines if "did not run" in line)
    search = SearchParams(resolution=0.1, stride=2, replicas=2)
    rows = made_up_rows(LIMITS, search)
    odd = sum(r["outcome"] != "recovered" and r["replica"] == 0 for r in rows)
    assert line.startswith(f"{odd} of {len(rows)} trials did not run")
