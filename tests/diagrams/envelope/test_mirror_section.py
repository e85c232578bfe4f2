"""Oracle: limits on both sides, chosen by hand, and the difference of each."""

from functools import partial

from diagrams.envelope.limit_search import SearchParams
from diagrams.envelope.mirror_section import mirror_section
from diagrams.envelope.moment import Moment
from diagrams.envelope.references import MOMENT
from diagrams.envelope.report_text import report_text
from diagrams.envelope.sweep_flags import directions
from tests.diagrams.envelope.made_up_trials import (
    made_up_envelope,
    read_table,
)

LEFT = Moment.parse("left swing 25 %")
LATE = Moment.parse("left swing 75 %")
SEARCH = SearchParams(resolution=0.1, stride=4)
envelope_from = partial(made_up_envelope, search=SEARCH)


def test_compares_with_the_mirrored_push_and_shows_the_worst():
    """0.8 beside 1.0 is worse than 1.9 beside 2.0; 0 is its own mirror."""
    found = mirror_section(
        envelope_from(
            {
                ("step", MOMENT, 0.0): 2.0,
                ("step", MOMENT, 30.0): 0.8,
                ("step", MOMENT, 330.0): 1.4,
                ("step", LEFT, 0.0): 1.9,
                ("step", LEFT, 30.0): 1.4,
                ("step", LEFT, 330.0): 1.0,
                ("icp_only", MOMENT, 90.0): 0.4,
                ("icp_only", LEFT, 270.0): 0.4,
            }
        )
    )
    first, second = read_table(found)
    assert first == {
        "worst pair": "90° left, right swing 25 %",
        "mechanisms": "`icp_only`",
        "right [m/s]": "0.40",
        "left [m/s]": "0.40",
        "difference": "0 %",
    }
    assert second["worst pair"] == "30°, right swing 25 %"
    assert (second["right [m/s]"], second["left [m/s]"]) == ("0.80", "1.00")
    assert second["difference"] == "20 %"


def test_limits_that_are_not_complete_are_not_compared():
    """The worst pair of those that are: 0.5 beside 1.0, not 0.2 beside 1.0."""
    cells = {
        ("step", MOMENT, 0.0): 0.2,
        ("step", LEFT, 0.0): 1.0,
        ("step", MOMENT, 90.0): 1.0,
        ("step", LEFT, 270.0): 0.5,
    }
    for unfinished in (MOMENT, LEFT):
        hurried = ("step", unfinished, 0.0)
        found = envelope_from(cells, is_unfinished=hurried.__eq__)
        (row,) = read_table(mirror_section(found))
        assert row["worst pair"] == "90° left, right swing 25 %"
        assert row["difference"] == "50 %"
    found = envelope_from(cells, is_unfinished=lambda c: c[1] == LEFT)
    assert mirror_section(found) == ""


def test_a_limit_that_may_be_larger_is_marked():
    cells = {("step", MOMENT, 0.0): 9.0, ("step", LEFT, 0.0): 1.5}
    (row,) = read_table(mirror_section(envelope_from(cells)))
    assert (row["right [m/s]"], row["left [m/s]"]) == (">=3.00", "1.50")


def test_finds_mirrored_directions_that_are_no_round_number():
    """Oracle: the directions of the flag; all but 0 have another mirror."""
    cells = {
        ("step", moment, angle): 1.0 - 0.1 * i
        for moment in (MOMENT, LEFT)
        for i, angle in enumerate(directions("7"))
    }
    (row,) = read_table(mirror_section(envelope_from(cells)))
    assert {row["right [m/s]"], row["left [m/s]"]} == {"0.90", "0.40"}


def test_a_limit_of_nothing_on_both_sides_is_no_difference():
    cells = {("step", MOMENT, 0.0): 0.0, ("step", LEFT, 0.0): 0.0}
    (row,) = read_table(mirror_section(envelope_from(cells)))
    assert row["difference"] == "0 %"


def test_other_directions_and_moments_are_no_mirror():
    cells = {("step", MOMENT, 30.0): 0.8, ("step", LEFT, 30.0): 0.8}
    assert mirror_section(envelope_from(cells)) == ""
    cells = {("step", MOMENT, 0.0): 0.8, ("step", LATE, 0.0): 0.8}
    assert mirror_section(envelope_from(cells)) == ""


def test_is_in_the_report_only_where_there_is_something_to_compare():
    one_side = {("step", MOMENT, 0.0): 0.8}
    both = envelope_from(one_side | {("step", LEFT, 0.0): 0.8})
    assert mirror_section(both) in report_text(both, None, [])
    heading = "## Is the left as good as the right?"
    assert heading in report_text(both, None, [])
    assert heading not in report_text(envelope_from(one_side), None, [])
