"""Oracle: the limits from which the trials were made up."""

import math

import pytest

from diagrams.envelope.envelope_data import (
    characteristic_speed,
    envelope_of,
    losses,
    mark,
)
from diagrams.envelope.limit_search import Limit, SearchParams
from diagrams.envelope.moment import Moment
from diagrams.envelope.references import MOMENT
from tests.diagrams.envelope.made_up_trials import (
    SEARCH,
    identity_of,
    made_up_envelope,
    made_up_rows,
    paper_times,
)

ALL = "all_with_cross_over"
LEFT = Moment.parse("left swing 50 %")
LATE = Moment.parse("right swing 75 %")


def test_finds_the_limits_again():
    """They are multiples of the resolution, so found without an error."""
    limits = {
        cell: round(value / SEARCH.resolution) * SEARCH.resolution
        for cell, value in paper_times(1.1).items()
    }
    envelope = made_up_envelope(limits)
    assert set(envelope.limits) == set(limits)
    for cell, found in envelope.limits.items():
        assert found.recovered == pytest.approx(limits[cell], abs=1e-9)
        assert found.failed == pytest.approx(found.recovered + 0.02)
        assert found.complete
    assert not envelope.missing


def test_rows_may_come_in_any_order():
    rows = made_up_rows(paper_times(1.0))
    one = envelope_of(identity_of(), rows)
    two = envelope_of(identity_of(), rows[::-1])
    assert one.limits == two.limits
    assert one.curve(ALL, MOMENT) == two.curve(ALL, MOMENT)
    assert list(two.curve(ALL, MOMENT)) == [30.0 * i for i in range(12)]


def test_names_are_in_the_order_of_the_paper_and_its_moment_is_first():
    cells = {
        (name, moment, direction): 0.2
        for name in (ALL, "icp_only", "step_swing")
        for moment in (LATE, LEFT, MOMENT)
        for direction in (270.0, 0.0)
    }
    envelope = made_up_envelope(cells)
    assert envelope.mechanisms == ("icp_only", "step_swing", ALL)
    assert envelope.moments == (MOMENT, LEFT, LATE)
    assert envelope.directions == (0.0, 270.0)


def test_says_which_cells_are_not_complete_or_not_begun():
    cells = {("step", MOMENT, 0.0): 0.3, ("step", MOMENT, 90.0): 0.2}
    cells[ALL, MOMENT, 0.0] = 0.5
    hurried = ("step", MOMENT, 90.0)
    envelope = made_up_envelope(cells, is_unfinished=lambda c: c == hurried)
    assert envelope.missing == [hurried, (ALL, MOMENT, 90.0)]
    assert envelope.limits[hurried] == Limit(
        recovered=pytest.approx(0.2),
        failed=pytest.approx(0.22),
        complete=False,
    )
    assert list(envelope.curve(ALL, MOMENT)) == [0.0]


@pytest.mark.parametrize("outcome", ["fell", "error", "crashed", "hung"])
def test_only_a_recovery_is_one(outcome):
    """Oracle: by hand; 0.1 m/s is recovered from, 0.2 m/s is not."""
    search = SearchParams(resolution=0.1, stride=1, replicas=1)
    rows = made_up_rows({("step", MOMENT, 0.0): 0.5}, search)
    rows = [dict(row) for row in rows if row["delta_v"] < 0.25]
    rows[1]["outcome"] = outcome
    (found,) = envelope_of(identity_of(search), rows).limits.values()
    assert found == Limit(recovered=0.1, failed=0.2, complete=True)


def test_tells_where_more_mechanisms_recover_less():
    """Oracle: by hand; 0.02 m/s less is no less, 0.04 m/s is.

    In two steps of 0.02 m/s it is 0.04 m/s less than the best.
    """
    cells = {
        ("icp_only", MOMENT, 0.0): 0.40,
        ("step", MOMENT, 0.0): 0.38,
        ("step_swing", MOMENT, 0.0): 0.36,
        ("icp_only", MOMENT, 90.0): 0.20,
        ("step", MOMENT, 90.0): 0.22,
        ("step_swing", MOMENT, 90.0): 0.20,
    }
    (loss,) = losses(made_up_envelope(cells))
    assert (loss.moment, loss.direction_deg) == (MOMENT, 0.0)
    assert (loss.fewer, loss.more) == ("icp_only", "step_swing")
    assert loss.by_fewer.recovered == pytest.approx(0.40)
    assert loss.by_more.recovered == pytest.approx(0.36)
    assert loss.final
    (loss,) = losses(made_up_envelope(cells, is_unfinished=lambda c: True))
    assert not loss.final


def test_one_coarse_step_less_is_no_less():
    """Oracle: by hand; limits are known to 0.1 m/s only."""
    search = SearchParams(resolution=0.1)
    cells = {
        ("icp_only", MOMENT, angle): 0.5 + 0.1 * angle for angle in (0.0, 1.0)
    }
    cells |= {("step", MOMENT, 0.0): 0.4, ("step", MOMENT, 1.0): 0.4}
    (loss,) = losses(made_up_envelope(cells, search))
    assert loss.direction_deg == 1.0


@pytest.mark.parametrize(
    ("resolution", "text"), [(0.02, "0.30"), (0.1, "0.30"), (0.005, "0.300")]
)
def test_writes_velocities_to_the_digit_that_tells_limits_apart(
    resolution, text
):
    search = SearchParams(resolution=resolution)
    cells = {("step", MOMENT, 0.0): 0.2}
    assert made_up_envelope(cells, search).words(0.3) == text


def test_marks_what_is_not_sure():
    """Oracle: by hand; a mark of several is that of the least sure one."""
    sure = Limit(recovered=0.5, failed=0.52, complete=True)
    bound = Limit(recovered=3.0, failed=None, complete=True)
    open_end = Limit(recovered=0.3, failed=None, complete=False)
    assert mark([]) == mark([sure]) == ""
    assert mark([sure, bound]) == ">="
    assert mark([sure, open_end, bound]) == "~"
    envelope = made_up_envelope({("step", MOMENT, 0.0): 0.2})
    words = [envelope.limit_words(x) for x in (sure, bound, open_end)]
    assert words == ["0.50", ">=3.00", "~0.30"]


def test_an_envelope_needs_a_trial():
    with pytest.raises(ValueError, match="rows = .*at least one trial"):
        envelope_of(identity_of(), [])


def test_the_speed_of_a_robot_is_that_of_its_height():
    """Oracle: sqrt(g z), with com_height of Nadia's robot.yaml."""
    expected = math.sqrt(9.81 * 0.888)
    assert characteristic_speed("nadia") == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("robot", ["nobody", "/nowhere/robot.yaml"])
def test_the_speed_of_an_unknown_robot_is_not_known(robot):
    assert characteristic_speed(robot) is None
